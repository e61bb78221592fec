//! What both channels of an instrument sent at one SYNC, and the difference between them.
//!
//! In: TPDO 1 and TPDO 3 (docs/canopen.md) as they come. Out: a [`Round`] with the angles of both
//! channels, their difference A - B, and the band in which a difference is no more than both
//! uncertainties allow.
//!
//! TPDO 3 has the angles as measured, also while the pair disagrees and TPDO 1 has 8000h, and
//! finer; so the difference is formed of these where both channels have sent them, and else of
//! TPDO 1. The two are not mixed: presets and offsets are in TPDO 1 only.
//!
//! Left out: which frames belong to one SYNC (`pair`).

use super::exchange::{Measured, slope_minus};
use serde::{Deserialize, Serialize};

/// The coverage factor of the band.
const COVERAGE: f64 = 2.0;

/// One SYNC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, PartialOrd, Ord)]
pub struct Round {
    /// When it was seen, or the first frame after it; ns.
    pub time_ns: u64,
    /// TPDO 1 of both channels: slope X and Y while they may be used, 0.001 deg.
    pub slopes: [Option<[Option<i32>; 2]>; 2],
    /// TPDO 3 of both channels.
    pub measured: [Option<Measured>; 2],
}

impl Round {
    /// A SYNC after which nothing was sent yet.
    pub fn at(time_ns: u64) -> Self {
        Self {
            time_ns,
            ..Self::default()
        }
    }

    /// True when nothing was sent.
    pub fn is_empty(&self) -> bool {
        self.slopes.iter().all(Option::is_none) && self.measured.iter().all(Option::is_none)
    }

    /// True when both channels sent TPDO 3.
    pub fn is_of_measured(&self) -> bool {
        self.measured.iter().all(Option::is_some)
    }

    /// The angle of a channel on an axis, 0.001 deg: as measured where that was sent.
    pub fn angle(&self, side: usize, axis: usize) -> Option<i32> {
        match (self.measured.get(side)?, self.slopes.get(side)?) {
            (Some(measured), _) => measured.mdeg(axis),
            (None, slopes) => *slopes.as_ref()?.get(axis)?,
        }
    }

    /// Channel A minus channel B on an axis, 0.001 deg.
    pub fn difference(&self, axis: usize) -> Option<i32> {
        match &self.measured {
            [Some(a), Some(b)] => a.minus(b, axis),
            _ => self.slope_difference(axis),
        }
    }

    /// The same of TPDO 1, with the presets and offsets of both channels in it.
    pub fn slope_difference(&self, axis: usize) -> Option<i32> {
        let [Some(a), Some(b)] = &self.slopes else {
            return None;
        };
        Some(slope_minus((*a.get(axis)?)?, (*b.get(axis)?)?))
    }

    /// The expanded uncertainty (k = 2) of the difference on an axis, 0.001 deg.
    pub fn band_mdeg(&self, axis: usize) -> Option<f64> {
        let [Some(a), Some(b)] = &self.measured else {
            return None;
        };
        let (a, b) = (a.uncertainty_mdeg(axis)?, b.uncertainty_mdeg(axis)?);
        // Both are from 1 to 2^14: no square is too large or too small.
        Some(COVERAGE * (a * a + b * b).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exchange::tests::measured;

    #[test]
    fn the_difference_goes_the_shorter_way_round() {
        let mut row = Round {
            measured: [measured(0x7F_FFFF, 40), measured(-0x80_0000, 40)],
            ..Round::default()
        };
        assert_eq!(row.difference(0), Some(0));
        row.measured = [None; 2];
        row.slopes = [
            Some([Some(179_990), Some(10)]),
            Some([Some(-179_990), Some(40)]),
        ];
        assert_eq!(
            [row.difference(0), row.difference(1)],
            [Some(-20), Some(-30)]
        );
    }

    #[test]
    fn as_measured_goes_before_the_slopes() {
        let row = Round {
            measured: [measured(466, 40), measured(0, 40)],
            slopes: [Some([None; 2]), Some([None; 2])],
            ..Round::default()
        };
        assert_eq!((row.angle(0, 0), row.difference(0)), (Some(10), Some(10)));
        let band = 2.0 * 2_f64.sqrt() * 2_f64.powf(0.5);
        assert!((row.band_mdeg(0).unwrap() - band).abs() < 1e-9);
    }
}
