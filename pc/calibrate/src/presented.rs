//! What a node adds to its angles before it shows them: inversion and offsets of each slope.
//!
//! In: a node on a bus. Out: the slopes that do not read as measured (CiA 410, 60x1h to 60x4h by
//! their 32-bit twins). A calibration is of the angles as measured, so what was zeroed before it
//! is off by what the calibration has changed.
//!
//! Left out: changing any of it, which `plumb zero` and `plumb set` do.

use bus_master::fault::Fault;
use bus_master::node::Node;
use device::profile::{Parameter, Slope};
use serde::Serialize;

/// Slopes X and Y, by the index of the 32-bit object.
const SLOPES: [(&str, u16); 2] = [("X", 0x6110), ("Y", 0x6120)];

/// A slope that does not read as measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Presented {
    /// X or Y.
    pub slope: &'static str,
    /// Bit 0 of 6111h or 6121h.
    pub inverted: bool,
    /// What is added to the angle, deg: offset and differential offset while they count.
    pub offset_deg: f64,
}

impl Presented {
    /// What it does, for a sentence.
    pub fn words(&self) -> String {
        let (slope, offset_deg) = (self.slope, self.offset_deg);
        match self.inverted {
            true => format!("slope {slope} is inverted, with an offset of {offset_deg:.2} deg"),
            false => format!("slope {slope} has an offset of {offset_deg:.2} deg"),
        }
    }
}

/// The slopes of a node that do not read as measured.
///
/// Errors: a node that does not answer.
pub fn of(node: &mut Node<'_>) -> Result<Vec<Presented>, Fault> {
    let unit_deg = f64::from(node.number(0x6000, 0)?.unwrap_or(10)) / 1000.0;
    let mut all = Vec::new();
    for (name, index) in SLOPES {
        let mut slope = Slope::new();
        for distance in [1, 3, 4] {
            let read = node.number(index + distance, 0)?;
            if let Some((parameter, read)) = Parameter::new(distance).zip(read) {
                slope.load(parameter, read.cast_signed());
            }
        }
        if slope.is_inverted() || slope.shift() != 0 {
            all.push(Presented {
                slope: name,
                inverted: slope.is_inverted(),
                offset_deg: f64::from(slope.shift()) * unit_deg,
            });
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_added_to_a_slope_has_words() {
        let presented = |inverted| Presented {
            slope: "X",
            inverted,
            offset_deg: -1.994,
        };
        assert_eq!(
            presented(false).words(),
            "slope X has an offset of -1.99 deg"
        );
        assert_eq!(
            presented(true).words(),
            "slope X is inverted, with an offset of -1.99 deg"
        );
    }
}
