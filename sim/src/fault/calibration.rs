//! A bit of a calibration that flips in RAM.
//!
//! In: a calibration and a stream of random numbers. Out: the calibration with one bit of one
//! entry of its matrix turned over, and what is needed to turn it back.
//!
//! Left out: the tables of paper mode, which give no way in.

use tilt::chain::{Calibration, Correction};

use crate::rng::Rng;

/// The lowest bit that flips: 1/64 g/g of an entry in 2^-30, nearly a degree when the axis that
/// it multiplies feels one g. The highest is the one below the sign: 1 g/g.
const LOWEST_BIT: u32 = 24;
/// See [`LOWEST_BIT`].
const BITS: u32 = 7;

/// One flipped bit of a calibration's matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corruption {
    row: usize,
    column: usize,
    before: i32,
    after: i32,
}

/// A whole number below `count`, all alike.
fn below(count: u32, rng: &mut Rng) -> u32 {
    (rng.uniform() * f64::from(count)) as u32
}

fn entry(calibration: &mut Calibration, row: usize, column: usize) -> Option<&mut i32> {
    match &mut calibration.correction {
        Correction::TwoAxis { vector, .. } | Correction::OneAxis { vector, .. } => {
            vector.matrix.get_mut(row)?.get_mut(column)
        }
        Correction::Tables { .. } => None,
    }
}

impl Corruption {
    /// Flips a high bit of an entry, both drawn. `None`, and nothing happens, for tables.
    pub fn flip(calibration: &mut Calibration, rng: &mut Rng) -> Option<Self> {
        let (row, column) = (below(3, rng) as usize, below(3, rng) as usize);
        let bit = LOWEST_BIT + below(BITS, rng);
        let entry = entry(calibration, row, column)?;
        let before = *entry;
        *entry ^= 1 << bit;
        Some(Self {
            row,
            column,
            before,
            after: *entry,
        })
    }

    /// Turns the bit back, unless another calibration has come in the meantime.
    pub fn undo(self, calibration: &mut Calibration) {
        if let Some(entry) = entry(calibration, self.row, self.column)
            && *entry == self.after
        {
            *entry = self.before;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Mode;

    #[test]
    fn a_high_bit_of_one_entry_flips_and_flips_back() {
        let mut rng = Rng::stream(1, "flip");
        for _ in 0..100 {
            let sound = Mode::Product.settings().chain.calibration;
            let mut calibration = sound.clone();
            let corruption = Corruption::flip(&mut calibration, &mut rng).expect("a matrix");
            let (Correction::TwoAxis { vector: a, .. }, Correction::TwoAxis { vector: b, .. }) =
                (&sound.correction, &calibration.correction)
            else {
                panic!("the product has a matrix")
            };
            let flat = |matrix: [[i32; 3]; 3]| matrix.into_iter().flatten();
            let flipped: Vec<_> = (flat(a.matrix).zip(flat(b.matrix)))
                .map(|(a, b)| a ^ b)
                .filter(|bits| *bits != 0)
                .collect();
            assert_eq!(flipped.len(), 1);
            assert!(flipped[0].count_ones() == 1 && flipped[0] >= 1 << LOWEST_BIT);
            corruption.undo(&mut calibration);
            assert_eq!(calibration, sound);
        }
    }

    #[test]
    fn a_calibration_that_came_in_the_meantime_stays() {
        let mut rng = Rng::stream(1, "flip");
        let sound = Mode::Product.settings().chain.calibration;
        let mut calibration = sound.clone();
        let corruption = Corruption::flip(&mut calibration, &mut rng).expect("a matrix");
        calibration.clone_from(&sound);
        corruption.undo(&mut calibration);
        assert_eq!(calibration, sound);
    }
}
