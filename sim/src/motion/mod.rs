//! What moves the housing: one interface for the motor rig, a fixed pose and the excavator.
//!
//! In: the time, once per tick of [`crate::TICK_S`]. Out: the specific force that the housing
//! feels, in g along its own axes, how it turns, and the true attitude that the instrument should
//! report.
//! Frame: a housing at rest and level feels (0, 0, +1) g. Slope X is
//! atan2(x, hypot(y, z)), slope Y is atan2(y, hypot(x, z)), both of gravity alone.
//! Left out: the earth's own rotation, 0.004 deg/s, and the site's own gravity: 1 g is
//! [`STANDARD_GRAVITY_M_S2`] everywhere.

pub mod vibration;

use tilt::calibration::algebra::cross;

/// Standard gravity, m/s^2 (the value that defines 1 g, CGPM 1901).
pub const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// What the housing feels at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Specific force along the housing's axes, g: gravity, motion and vibration together.
    pub force_g: [f64; 3],
    /// Rate of turn about the housing's axes, right-handed, deg/s: the mean of this tick.
    pub rate_dps: [f64; 3],
    /// Where the housing truly stands.
    pub attitude: Attitude,
}

/// True attitude, degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attitude {
    /// Slope X (CiA 410 "long", the paper's X axis), -90..=90.
    pub slope_x_deg: f64,
    /// Slope Y (CiA 410 "lateral", the paper's Y axis), -90..=90.
    pub slope_y_deg: f64,
    /// The driven rotation: motor shaft or arm. Not wrapped, so it may pass 180.
    pub turn_deg: f64,
}

impl Attitude {
    /// The attitude of a housing that feels this gravity (any length above zero) while the
    /// driven rotation stands at `turn_deg`.
    #[inline]
    pub fn from_gravity(gravity_g: [f64; 3], turn_deg: f64) -> Attitude {
        let [x, y, z] = gravity_g;
        Attitude {
            slope_x_deg: slope_deg(x, y, z),
            slope_y_deg: slope_deg(y, x, z),
            turn_deg,
        }
    }
}

/// asin(along / length). The arctangent form keeps its digits near 90 degrees, where the
/// arcsine loses half of them.
#[inline]
fn slope_deg(along: f64, across: f64, down: f64) -> f64 {
    along
        .atan2((across * across + down * down).sqrt())
        .to_degrees()
}

/// Anything that moves the housing.
pub trait Mover {
    /// What the housing feels at `time_s`. Called once per tick of [`crate::TICK_S`] with
    /// increasing time, s; vibration advances by one tick at each call.
    fn step(&mut self, time_s: f64) -> Motion;
}

/// A value for each axis and one more that nobody reads: two pairs, and processors do pairs at
/// once.
pub(crate) type Lanes = [f64; 4];

/// A force in lanes, the last one 0.
#[inline]
pub(crate) fn lanes([x, y, z]: [f64; 3]) -> Lanes {
    [x, y, z, 0.0]
}

/// What this gives for each lane.
#[inline(always)]
pub(crate) fn each(value: impl Fn(usize) -> f64) -> Lanes {
    [value(0), value(1), value(2), value(3)]
}

/// The axes of lanes.
#[inline]
pub(crate) fn axes([x, y, z, _]: Lanes) -> [f64; 3] {
    [x, y, z]
}

/// A sum of two forces, g.
#[inline]
pub(crate) fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// The rate of a housing in which "up" goes from one direction to another within a tick, both of
/// length one, deg/s. It does not turn about the vertical itself.
#[inline]
pub(crate) fn rate_dps(before: [f64; 3], after: [f64; 3]) -> [f64; 3] {
    // What stands still goes the other way in the axes of a housing that turns.
    let per_tick = 1f64.to_degrees() / crate::TICK_S;
    cross(after, before).map(|sine| sine * per_tick)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn level_reads_zero_on_both_slopes() {
        let level = Attitude::from_gravity([0.0, 0.0, 1.0], 0.0);
        assert_eq!(level, Attitude::default());
    }

    #[test]
    fn slopes_follow_the_signs_of_their_axes() {
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let x = Attitude::from_gravity([sin, 0.0, cos], 30.0);
        let y = Attitude::from_gravity([0.0, -sin, cos], 0.0);
        assert!((x.slope_x_deg - 30.0).abs() < 1e-12 && x.slope_y_deg == 0.0);
        assert!((y.slope_y_deg + 30.0).abs() < 1e-12 && y.slope_x_deg == 0.0);
    }

    #[test]
    fn slopes_fold_at_ninety_and_keep_their_digits_there() {
        let at = |deg: f64| {
            let (sin, cos) = deg.to_radians().sin_cos();
            Attitude::from_gravity([sin, 0.0, cos], deg).slope_x_deg
        };
        assert!((at(89.9999) - 89.9999).abs() < 1e-10);
        assert!((at(120.0) - 60.0).abs() < 1e-10);
    }
}
