//! Count, extremes, mean, scatter and percentiles of a quantity that comes value by value.
//!
//! In: whole numbers, 0.001 deg or whatever the caller counts in. Out: exact sums, so that the
//! tally of two halves joined equals the tally of the whole to the last bit.
//!
//! Left out: when a value came (`bins`).

use super::histogram::Histogram;
use super::join::{Join, join_fields};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

/// A turn, 0.001 deg.
const TURN_MDEG: i64 = 360_000;

/// Values so far.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tally {
    count: u64,
    sum: i128,
    squares: u128,
    #[serde(deserialize_with = "in_order")]
    extremes: Option<(i32, i32)>,
    /// How often each value came.
    pub histogram: Histogram,
}

impl Tally {
    /// Takes a value.
    #[inline]
    pub fn add(&mut self, value: i32) {
        self.count += 1;
        self.sum += i128::from(value);
        let size = u64::from(value.unsigned_abs());
        self.squares += u128::from(size * size);
        let (least, most) = self.extremes.unwrap_or((value, value));
        self.extremes = Some((least.min(value), most.max(value)));
        self.histogram.add(value);
    }

    /// Number of values.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// The least and the greatest value.
    pub const fn extremes(&self) -> Option<(i32, i32)> {
        self.extremes
    }

    /// The mean.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum as f64 / self.count as f64)
    }

    /// Of angles in 0.001 deg: how many of them are a turn behind the others, since the values lie
    /// around a half turn; 0 where they don't, and where they are all around.
    fn behind(&self) -> u64 {
        let (least, most) = self.extremes.unwrap_or_default();
        let beyond = TURN_MDEG - (i64::from(most) - i64::from(least));
        match self.histogram.widest_gap() {
            Some((width, below)) if width > beyond && least < 0 && most > 0 => below,
            _ => 0,
        }
    }

    /// The mean of angles in 0.001 deg, more than -180 deg and up to 180 deg: those around a half
    /// turn have it there, and not on the other side.
    pub fn mean_angle(&self) -> Option<f64> {
        let turns = i128::from(self.behind()) * i128::from(TURN_MDEG);
        let mean =
            (self.count > 0).then(|| self.sum.wrapping_add(turns) as f64 / self.count as f64)?;
        let turn = TURN_MDEG as f64;
        Some(if mean > turn / 2.0 { mean - turn } else { mean })
    }

    /// The standard deviation of angles; `None` also where they lie around a half turn, of which
    /// the sums do not have it.
    pub fn angle_deviation(&self) -> Option<f64> {
        if self.behind() > 0 {
            return None;
        }
        self.deviation()
    }

    /// The root of the mean square.
    pub fn rms(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squares as f64 / self.count as f64).sqrt())
    }

    /// The standard deviation of the values about their mean; `None` for fewer than two.
    pub fn deviation(&self) -> Option<f64> {
        let count = i128::from(self.count);
        if count < 2 {
            return None;
        }
        // Exact in whole numbers, where a difference of two large floats would not be; floats are
        // for sums that no log comes to.
        let squares = i128::try_from(self.squares).ok();
        let products = squares.and_then(|squares| count.checked_mul(squares));
        let about = products.zip(self.sum.checked_mul(self.sum));
        let about = about.and_then(|(products, square)| products.checked_sub(square));
        let roughly = || count as f64 * self.squares as f64 - (self.sum as f64).powi(2);
        let about = about.map_or_else(roughly, |about| about as f64);
        let variance = about / (count as f64 * (count - 1) as f64);
        Some(variance.max(0.0).sqrt())
    }
}

impl Join for Tally {
    fn join(&mut self, other: &Self) {
        join_fields! { self, other: count, histogram }
        // A sum that saturates would depend on the order where signs differ; one that wraps does
        // not. Sums of values wrap only beyond 2^96 of them; a forged one may have any size.
        self.sum = self.sum.wrapping_add(other.sum);
        self.squares = self.squares.saturating_add(other.squares);
        if let Some((least, most)) = other.extremes {
            let own = self.extremes.unwrap_or((least, most));
            self.extremes = Some((own.0.min(least), own.1.max(most)));
        }
    }
}

/// The least and the greatest value, as they are read.
fn in_order<'de, D: Deserializer<'de>>(from: D) -> Result<Option<(i32, i32)>, D::Error> {
    let extremes = Option::<(i32, i32)>::deserialize(from)?;
    match extremes {
        Some((least, most)) if least > most => {
            Err(D::Error::custom("a least value is above the greatest"))
        }
        _ => Ok(extremes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_deviation_are_those_of_the_book() {
        let mut tally = Tally::default();
        assert_eq!((tally.mean(), tally.deviation()), (None, None));
        for value in [2, 4, 4, 4, 5, 5, 7, 9] {
            tally.add(value);
        }
        assert_eq!(tally.mean(), Some(5.0));
        assert_eq!(tally.rms(), Some(29.0_f64.sqrt()));
        let expected = (32.0_f64 / 7.0).sqrt();
        assert!((tally.deviation().unwrap() - expected).abs() < 1e-12);
        assert_eq!(tally.extremes(), Some((2, 9)));
    }

    #[test]
    fn readings_around_a_half_turn_had_their_mean_on_the_other_side() {
        let of = |values: &[i32]| {
            let mut tally = Tally::default();
            values.iter().for_each(|value| tally.add(*value));
            (tally.mean_angle(), tally.angle_deviation().is_some())
        };
        let around = [179_970, -179_990, 179_980, -179_960];
        assert_eq!(of(&around), (Some(180_000.0), false));
        assert_eq!(of(&[179_970, -179_950]), (Some(-179_990.0), false));
        assert_eq!(
            of(&[180_000, -179_900, -179_900]),
            (Some(-179_933.0 - 1.0 / 3.0), false)
        );
        // A swing of more than a half turn through zero, and readings all around, stay as they are.
        let swing: Vec<i32> = (-100..=100).map(|deg| deg * 1000).collect();
        assert_eq!(of(&swing), (Some(0.0), true));
        let all: Vec<i32> = (-1800..=1799).map(|tenth| tenth * 100).collect();
        assert_eq!(of(&all), (Some(-50.0), true));
        assert_eq!(of(&[-30_000, 30_000]), (Some(0.0), true));
        assert_eq!(of(&[]), (None, false));
        // Merged halves know it as well.
        let (mut one, mut other) = (Tally::default(), Tally::default());
        one.add(179_900);
        other.add(-179_900);
        one.join(&other);
        assert_eq!(one.mean_angle(), Some(180_000.0));
    }

    #[test]
    fn a_small_scatter_far_from_zero_is_not_lost() {
        let mut tally = Tally::default();
        for n in 0..1_000_000 {
            tally.add(1_000_000_000 + n % 2);
        }
        assert!((tally.deviation().unwrap() - 0.5).abs() < 1e-6);
    }
}
