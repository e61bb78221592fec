//! From a vector of acceleration to an angle, in integers.
//!
//! In: a [`Corrected`] vector in the housing frame. Out: an [`Angle`] with the full circle at
//! 2^32, so that wrapping is free and one step is 8.4e-8 deg. The two-axis formula uses all three
//! axes and therefore keeps its sensitivity at every tilt (errata E6 and E7); the one-axis formula
//! covers 360 deg. Harmonics mend what an affine correction cannot: the part's nonlinearity.
//! Uncertainty is in `uncertainty`, the paper's table in `table`.

use crate::vector::Corrected;

/// An angle: full circle = 2^32, wraps, one step is 8.4e-8 deg.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Angle(pub i32);

/// Steps of [`Angle`] per degree.
pub const STEPS_PER_DEGREE: f64 = 4_294_967_296.0 / 360.0;

impl Angle {
    /// The nearest angle to `degrees`; -180 to +180, larger values wrap.
    pub const fn from_degrees(degrees: f64) -> Self {
        let steps = degrees * STEPS_PER_DEGREE;
        let rounded = if steps < 0.0 {
            steps - 0.5
        } else {
            steps + 0.5
        };
        Self(rounded as i64 as i32)
    }

    /// In degrees, -180 to just under +180.
    pub const fn degrees(self) -> f64 {
        self.0 as f64 / STEPS_PER_DEGREE
    }

    /// `self - other` the short way round.
    pub const fn minus(self, other: Self) -> Self {
        Self(self.0.wrapping_sub(other.0))
    }

    /// `self + other`, wrapping at half a turn.
    pub const fn plus(self, other: Self) -> Self {
        Self(self.0.wrapping_add(other.0))
    }

    /// Size without sign, in steps: 0 to 2^31.
    pub const fn magnitude(self) -> u32 {
        self.0.unsigned_abs()
    }

    /// Cosine and sine as f64, good to 9e-6 (the integer table of `idsp`).
    pub fn cos_sin(self) -> (f64, f64) {
        let (cos, sin) = idsp::cossin(self.0);
        let scale = 1.0 / 2_147_483_648.0;
        (f64::from(cos) * scale, f64::from(sin) * scale)
    }
}

/// One value for each of the two axes: X (CiA 410 "long", the paper's X) and Y ("lateral").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Axes<T> {
    /// Slope X: atan2(x, hypot(y, z)), positive when the housing's x axis points up.
    pub x: T,
    /// Slope Y: atan2(y, hypot(x, z)).
    pub y: T,
}

/// Length of (a, b), in the unit of the arguments; error under one unit.
pub fn hypot(a: i32, b: i32) -> i32 {
    // One instruction each; `pow` would be a loop.
    let square = |c: i32| (i64::from(c) * i64::from(c)).unsigned_abs();
    let sum = square(a) + square(b);
    i32::try_from(crate::root::root(sum)).unwrap_or(i32::MAX)
}

/// Slope X and slope Y of a two-axis instrument, each -90 to +90 deg.
///
/// Each is independent of the other axis, where the paper's one-axis table reads 7.05 deg for a
/// true roll of 10 deg at 45 deg pitch (erratum E7). Error of the integer arithmetic: under
/// 2e-4 deg.
pub fn slopes(vector: Corrected) -> Axes<Angle> {
    slopes_beside(vector, beside(vector))
}

/// What slope X and slope Y don't take part in: the length of the other two components.
pub fn beside(vector: Corrected) -> Axes<i32> {
    let [x, y, z] = vector.accel;
    Axes {
        x: hypot(y, z),
        y: hypot(x, z),
    }
}

/// [`slopes`] where [`beside`] is known already.
pub fn slopes_beside(vector: Corrected, beside: Axes<i32>) -> Axes<Angle> {
    let [x, y, _] = vector.accel;
    Axes {
        x: Angle(idsp::atan2(x, beside.x)),
        y: Angle(idsp::atan2(y, beside.y)),
    }
}

/// The angle of a one-axis 360 deg instrument: atan2(x, z).
pub fn turn(vector: Corrected) -> Angle {
    let [x, _, z] = vector.accel;
    Angle(idsp::atan2(x, z))
}

/// Three harmonics of the angle, added to it: sum of c_k cos(k a) + s_k sin(k a), k = 1..3.
///
/// They take up what is left after the affine correction, mainly the quadratic and cubic
/// nonlinearity of the part (the study in the sensor specification: 0.031 deg with, see there).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Harmonics {
    /// Cosine amplitudes for k = 1, 2, 3, in steps of [`Angle`].
    pub cosine: [i32; 3],
    /// Sine amplitudes for k = 1, 2, 3, in steps of [`Angle`].
    pub sine: [i32; 3],
}

impl Harmonics {
    /// The correction to add at `angle`.
    pub fn correction(&self, angle: Angle) -> Angle {
        let mut phase = 0i32;
        let mut sum = 0i64;
        for (&c, &s) in self.cosine.iter().zip(&self.sine) {
            phase = phase.wrapping_add(angle.0);
            let (cos, sin) = idsp::cossin(phase);
            sum += i64::from(c) * i64::from(cos) + i64::from(s) * i64::from(sin);
        }
        Angle((sum >> 31) as i32)
    }

    /// The corrected angle.
    pub fn apply(&self, angle: Angle) -> Angle {
        angle.plus(self.correction(angle))
    }

    /// The corrected slope, kept within +-90 deg: a slope has nothing beyond the vertical.
    ///
    /// There it folds, so that whatever is off makes it smaller. A correction that does as well
    /// would come on top of that, and one that does not is cut off; so in the last 0.7 deg it goes
    /// down to nothing.
    pub fn apply_to_slope(&self, slope: Angle) -> Angle {
        const QUARTER: i32 = 1 << 30;
        const LAST_BITS: u32 = 23;
        let left = (1u32 << 30).saturating_sub(slope.magnitude());
        let share = left.min(1 << LAST_BITS);
        let correction = (i64::from(self.correction(slope).0) * i64::from(share)) >> LAST_BITS;
        Angle((i64::from(slope.0) + correction).clamp((-QUARTER).into(), QUARTER.into()) as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ONE_G;
    use std::f64::consts::PI;

    fn vector(x: f64, y: f64, z: f64) -> Corrected {
        Corrected {
            accel: [x, y, z].map(|v| (v * f64::from(ONE_G)).round() as i32),
        }
    }

    #[test]
    fn degrees_round_trip() {
        for d in [-180.0, -90.0, -0.4, 0.0, 0.001, 45.0, 179.9] {
            assert!((Angle::from_degrees(d).degrees() - d).abs() < 5e-8, "{d}");
        }
        assert_eq!(Angle::from_degrees(350.0), Angle::from_degrees(-10.0));
        assert_eq!(Angle::from_degrees(90.0).0, 1 << 30);
    }

    #[test]
    fn slopes_are_right_to_2e4_deg_and_independent_e7() {
        for i in -900..=900 {
            let t = f64::from(i) * 0.1;
            let (s, c) = (t * PI / 180.0).sin_cos();
            let (ws, wc) = (10.0 * PI / 180.0f64).sin_cos();
            let got = slopes(vector(s, c * ws, c * wc)).x.degrees();
            assert!((got - t).abs() < 2e-4, "{t}: {got}");
        }
    }

    #[test]
    fn one_axis_table_formula_would_read_7_05_e7() {
        // arcsin of the y axis alone, at 45 deg pitch and 10 deg true roll.
        let y = (10.0 * PI / 180.0f64).sin() * (45.0 * PI / 180.0f64).cos();
        assert!((y.asin() * 180.0 / PI - 7.05).abs() < 0.005);
    }

    #[test]
    fn turn_covers_the_circle() {
        for i in -1799..=1799 {
            let t = f64::from(i) * 0.1;
            let (s, c) = (t * PI / 180.0).sin_cos();
            let got = turn(vector(s, 0.3, c)).degrees();
            assert!((got - t).abs() < 2e-4, "{t}: {got}");
        }
    }

    #[test]
    fn harmonics_add_the_sum() {
        let a = |d: f64| (d * STEPS_PER_DEGREE) as i32;
        let h = Harmonics {
            cosine: [a(0.05), a(-0.02), a(0.01)],
            sine: [a(0.03), a(0.02), a(-0.04)],
        };
        for d in [-170.0, -90.0, -30.0, 0.0, 10.0, 77.0, 135.0f64] {
            let r = d * PI / 180.0;
            let want = 0.05 * r.cos() - 0.02 * (2.0 * r).cos()
                + 0.01 * (3.0 * r).cos()
                + 0.03 * r.sin()
                + 0.02 * (2.0 * r).sin()
                - 0.04 * (3.0 * r).sin();
            let got = h
                .apply(Angle::from_degrees(d))
                .minus(Angle::from_degrees(d))
                .degrees();
            assert!((got - want).abs() < 5e-6, "{d}: {got} {want}");
        }
    }

    #[test]
    fn the_fold_at_the_vertical_was_corrected_on_the_wrong_side() {
        // The affine correction left 0.05 deg at the vertical: z is off by as much.
        let h = Harmonics {
            cosine: [0; 3],
            sine: [-(0.05 * STEPS_PER_DEGREE) as i32, 0, 0],
        };
        let off = 0.05f64.to_radians();
        for degrees in [90.0f64, 89.98, 89.9] {
            let (s, c) = degrees.to_radians().sin_cos();
            let raw = slopes(vector(s, 0.0, c - off)).x;
            let error = h.apply_to_slope(raw).degrees() - degrees;
            assert!(error.abs() < 0.06, "{degrees}: {error}");
            assert!(degrees < 90.0 || h.apply(raw).degrees() - degrees < -0.09);
        }
        let below = Angle::from_degrees(89.0);
        assert_eq!(h.apply_to_slope(below), h.apply(below));
    }

    #[test]
    fn a_slope_stays_within_a_quarter_turn() {
        let h = Harmonics {
            cosine: [0; 3],
            sine: [1 << 20, 0, 0],
        };
        assert_eq!(h.apply_to_slope(Angle(1 << 30)), Angle(1 << 30));
        assert_eq!(h.apply_to_slope(Angle(-1 << 30)), Angle(-1 << 30));
    }

    #[test]
    fn extremes_do_not_overflow() {
        for v in [i32::MIN, i32::MAX, 0, 1, -1] {
            for w in [i32::MIN, i32::MAX, 0] {
                let _ = slopes(Corrected { accel: [v, w, v] });
                let _ = turn(Corrected { accel: [v, w, w] });
            }
        }
    }
}
