//! What the two channels send each other at each SYNC: TPDO 3 and TPDO 4 (docs/canopen.md).
//!
//! In: the eight bytes of each out of a black box, or what was decoded of the bus. Out: angles with
//! their uncertainty or the reason why there is none, the difference of two of them, acceleration,
//! and how much the sensor shakes.

use serde::{Deserialize, Serialize};
use std::sync::LazyLock;

use device::exchange::Exchange;

/// Steps of TPDO 3 in a full circle: two to the power of this.
const CIRCLE_BITS: u32 = 24;

/// The full circle, 0.001 deg.
const CIRCLE_MDEG: i32 = 360_000;

/// The lowest quality that stands for an angle.
const FIRST_ANGLE: u8 = 32;

/// Units of an acceleration in 1 g.
const PER_G: f64 = 8192.0;

/// Energy above 150 Hz of the channel's own noise; 8 steps double it.
const OWN_NOISE: u8 = 64;

/// Standard uncertainty of each quality that stands for an angle, 0.001 deg.
static UNCERTAINTY_MDEG: LazyLock<[f64; 256]> = LazyLock::new(|| {
    std::array::from_fn(|quality| 2_f64.powf((quality as f64 - f64::from(FIRST_ANGLE)) / 16.0))
});

/// TPDO 3 of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, PartialOrd, Ord)]
pub struct Measured {
    /// X and Y in steps of a 2^24th of the circle.
    steps: [i32; 2],
    /// Quality of X and Y.
    quality: [u8; 2],
}

impl Measured {
    /// Reads the bytes of a TPDO 3; `None` when there are not eight.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let mut exchange = Exchange::NOTHING;
        exchange.take_angles(bytes.try_into().ok()?);
        Some(Self::of(&exchange))
    }

    /// The part of an exchange that TPDO 3 carries.
    pub const fn of(exchange: &Exchange) -> Self {
        Self {
            steps: exchange.angle,
            quality: exchange.quality,
        }
    }

    /// The angle of an axis, steps of a 2^24th of the circle; `None` where there is none.
    pub fn steps(&self, axis: usize) -> Option<i32> {
        let is_angle = *self.quality.get(axis)? >= FIRST_ANGLE;
        self.steps.get(axis).copied().filter(|_| is_angle)
    }

    /// The angle of an axis, 0.001 deg; `None` where there is none.
    pub fn mdeg(&self, axis: usize) -> Option<i32> {
        self.steps(axis).map(to_mdeg)
    }

    /// Why there is no angle, as 2025h numbers it: of the first axis that has a reason.
    pub fn reason(&self) -> Option<u8> {
        let mut reasons = self.quality.iter().copied();
        reasons.find(|quality| (1..FIRST_ANGLE).contains(quality))
    }

    /// The quality of an axis as it was sent.
    pub fn quality(&self, axis: usize) -> Option<u8> {
        self.quality.get(axis).copied()
    }

    /// Standard uncertainty of an axis, 0.001 deg; `None` where it is not known.
    pub fn uncertainty_mdeg(&self, axis: usize) -> Option<f64> {
        let quality = *self.quality.get(axis)?;
        let known = (FIRST_ANGLE..u8::MAX).contains(&quality);
        known.then(|| UNCERTAINTY_MDEG[usize::from(quality)])
    }

    /// This channel's angle minus the other one's, the shorter way round, 0.001 deg.
    pub fn minus(&self, other: &Self, axis: usize) -> Option<i32> {
        let steps = self.steps(axis)?.wrapping_sub(other.steps(axis)?);
        Some(to_mdeg((steps << 8) >> 8))
    }
}

/// One slope minus another one, the shorter way round, 0.001 deg.
pub(super) fn slope_minus(own_mdeg: i32, other_mdeg: i32) -> i32 {
    let apart = i64::from(own_mdeg) - i64::from(other_mdeg);
    let (circle, half) = (i64::from(CIRCLE_MDEG), i64::from(CIRCLE_MDEG) / 2);
    ((apart + half).rem_euclid(circle) - half) as i32
}

fn to_mdeg(steps: i32) -> i32 {
    let scaled = i64::from(steps) * i64::from(CIRCLE_MDEG);
    // To the nearest one.
    ((scaled + (1 << (CIRCLE_BITS - 1))) >> CIRCLE_BITS) as i32
}

/// TPDO 4 of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Activity {
    /// Acceleration along the housing's X, Y and Z, g; `None` where there is none.
    pub force_g: [Option<f64>; 3],
    /// The instant of the SYNC on the sender's clock, 2 ms, the low byte.
    pub clock: u8,
    /// Energy above 150 Hz as it was sent.
    pub energy: u8,
}

impl Activity {
    /// Reads the bytes of a TPDO 4; `None` when there are not eight.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let mut exchange = Exchange::NOTHING;
        exchange.take_backing(bytes.try_into().ok()?);
        let force = |raw: i16| (raw != i16::MIN).then_some(f64::from(raw) / PER_G);
        Some(Self {
            force_g: exchange.vector.map(force),
            clock: exchange.captured,
            energy: exchange.activity,
        })
    }

    /// The energy in multiples of the channel's own noise; `None` without samples.
    pub fn noise(&self) -> Option<f64> {
        let steps = f64::from(self.energy) - f64::from(OWN_NOISE);
        (self.energy > 0).then(|| 2_f64.powf(steps / 8.0))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// TPDO 3 with this X, Y at 0, and one quality.
    pub fn measured(x_steps: i32, quality: u8) -> Option<Measured> {
        let [low, middle, high, _] = x_steps.to_le_bytes();
        Measured::read(&[low, middle, high, 0, 0, 0, quality, quality])
    }

    #[test]
    fn angles_are_read_with_sign_and_quality() {
        let eighth = measured(-(1 << 21), 48).unwrap();
        assert_eq!(eighth.mdeg(0), Some(-45_000));
        assert_eq!(eighth.uncertainty_mdeg(0), Some(2.0));
        assert_eq!(eighth.reason(), None);
        let none = measured(77, 15).unwrap();
        assert_eq!((none.mdeg(0), none.reason()), (None, Some(15)));
        assert_eq!(measured(0, 255).unwrap().uncertainty_mdeg(1), None);
        assert_eq!(Measured::read(&[0; 7]), None);
    }
}
