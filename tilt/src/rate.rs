//! The correction of a gyroscope: bias over temperature, scale, axis directions and mounting.
//!
//! In: a measured [`Rate`], with the nominal scale and along the sensor's axes, and the sensor's
//! own [`Temperature`]. Out: the true [`Rate`] about the housing's axes, right-handed, 2^-24 rad/s
//! per step. With d = T - 25 degC:
//!
//! ```text
//! true = M diag(1 + s d) (measured - b),   b = b0 + d (b1 + b2 d)
//! ```
//!
//! What depends on temperature is computed by [`RateCorrection::at`], once for each new
//! temperature. [`RateAt::apply`] then costs nine products of 32 bits by 32 for a sample.
//!
//! # Rounding
//! The result is rounded to the nearest step, half a step upwards. What `at` computes is rounded
//! down: the bias by up to 4e-9 rad/s (2.2e-7 deg/s), an entry of the matrix by up to 2e-9.
//! Nothing overflows: the result saturates at +-128 rad/s, and each entry of the matrix is held
//! within 1/4 of the identity's.
//!
//! Left out: fitting (see `calibration::gyroscope`), smoothing of the thermometer (the caller's),
//! and sensitivity to acceleration.

use crate::motion::{RATE_STEPS, Rate};
use crate::sample::Temperature;
use crate::saturate::saturate;
use crate::temperature::{from_reference, quadratic};

/// One in the unit of the matrix.
const ONE: i32 = 1 << 30;

/// How far an entry of the matrix may be from the identity's, 2^-30 per step: 1/4.
const LARGEST_ERROR: i32 = ONE / 4;

/// The errors of one gyroscope in its housing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RateCorrection {
    /// M: row i gives housing axis i, column j takes sensor axis j; 2^-30 per step. Each entry is
    /// within 1/4 of the identity's.
    pub matrix: [[i32; 3]; 3],
    /// s: what the scale of each sensor axis lacks, 2^-38 per degC, up to 0.0078; 0 where it was
    /// not measured.
    pub scale1_q38: [i32; 3],
    /// b0: bias of each sensor axis at 25 degC, 2^-30 rad/s per step (5.3e-8 deg/s), up to
    /// 114 deg/s.
    pub bias_q30: [i32; 3],
    /// b1 of each sensor axis, 2^-38 rad/s per degC, up to 0.44 (deg/s)/degC.
    pub bias1_q38: [i32; 3],
    /// b2 of each sensor axis, 2^-46 rad/s per degC^2, up to 0.0017 (deg/s)/degC^2.
    pub bias2_q46: [i32; 3],
}

/// The same in real numbers, as the fits find it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RealRateCorrection {
    /// M: housing axis by sensor axis.
    pub matrix: [[f64; 3]; 3],
    /// s of each sensor axis, 1 per degC.
    pub scale1: [f64; 3],
    /// b0 of each sensor axis, rad/s.
    pub bias: [f64; 3],
    /// b1 of each sensor axis, rad/s per degC.
    pub bias1: [f64; 3],
    /// b2 of each sensor axis, rad/s per degC^2.
    pub bias2: [f64; 3],
}

/// A [`RateCorrection`] at one temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RateAt {
    /// M diag(1 + s d), 2^-30 per step.
    matrix: [[i32; 3]; 3],
    /// What to subtract from the product: the matrix times the bias, less half a step of the
    /// result, so that it is rounded; 2^-54 rad/s per step.
    offset: [i64; 3],
    /// What the temperature adds to the standard uncertainty of the scale of two channels with
    /// such a calibration, 2^-16.
    scale_share: u16,
}

/// What a degree away from 25 degC adds to the standard uncertainty of the scale of two channels
/// where the slopes of both are known, 2^-16: 0.0015 %.
///
/// Fits of simulated parts state up to 0.0012 %, 0.0017 % for two, and come within half of it. The
/// worst that `plumb characterise` takes states 0.003 %: at 70 degC two of them are four standard
/// deviations within what the cross-check allows.
const SLOPES_KNOWN: u32 = 1;

/// The same where they are not, 0.0076 %: 0.005 % of either part \[ASSUME\], as independent.
const SLOPES_OPEN: u32 = 5;

impl RateCorrection {
    /// Leaves a rate as it is.
    pub const IDENTITY: Self = Self {
        matrix: [[ONE, 0, 0], [0, ONE, 0], [0, 0, ONE]],
        scale1_q38: [0; 3],
        bias_q30: [0; 3],
        bias1_q38: [0; 3],
        bias2_q46: [0; 3],
    };

    /// The nearest correction to one in real numbers.
    ///
    /// `None` when a number is not finite or outside its range: an entry of the matrix further
    /// than 1/4 from the identity's, and the others beyond that of their field in
    /// [`RateCorrection`].
    pub fn from_real(real: &RealRateCorrection) -> Option<Self> {
        let mut errors = real.matrix;
        for value in diagonal(&mut errors) {
            *value -= 1.0;
        }
        if !errors.iter().flatten().all(|error| error.abs() <= 0.25) {
            return None;
        }
        let steps = |values: [f64; 3], bits: i32| {
            let one = (1u64 << bits) as f64;
            let [x, y, z] = values.map(|value| nearest(value * one));
            Some([x?, y?, z?])
        };
        let [x, y, z] = real.matrix.map(|row| steps(row, 30));
        Some(Self {
            matrix: [x?, y?, z?],
            scale1_q38: steps(real.scale1, 38)?,
            bias_q30: steps(real.bias, 30)?,
            bias1_q38: steps(real.bias1, 38)?,
            bias2_q46: steps(real.bias2, 46)?,
        })
    }

    /// The same in real numbers.
    pub fn real(&self) -> RealRateCorrection {
        let real = |steps: [i32; 3], bits: i32| {
            let one = (1u64 << bits) as f64;
            steps.map(|steps| f64::from(steps) / one)
        };
        RealRateCorrection {
            matrix: self.matrix.map(|row| real(row, 30)),
            scale1: real(self.scale1_q38, 38),
            bias: real(self.bias_q30, 30),
            bias1: real(self.bias1_q38, 38),
            bias2: real(self.bias2_q46, 46),
        }
    }

    /// Whether each entry of the matrix is within 1/4 of the identity's, as it has to be.
    pub fn is_near_identity(&self) -> bool {
        let all = self.matrix.as_flattened().iter();
        let mut both = all.zip(Self::IDENTITY.matrix.as_flattened());
        both.all(|(entry, unit)| entry.abs_diff(*unit) <= LARGEST_ERROR.unsigned_abs())
    }

    /// The correction at `temperature`, which is held within -40..85 degC.
    pub fn at(&self, temperature: Temperature) -> RateAt {
        let d = from_reference(temperature);
        let matrix = self.matrix_at(d);
        let bias = self.bias_at(d);
        let mut offset = [0; 3];
        for (offset, row) in offset.iter_mut().zip(&matrix) {
            // Each product is below 2^61.4 in 2^-60 rad/s, and the sum below 2^61.9.
            let products = row.iter().zip(bias);
            let sum: i64 = products.map(|(&m, b)| i64::from(m) * i64::from(b)).sum();
            *offset = (sum >> 6) - (1 << 29);
        }
        RateAt {
            matrix,
            offset,
            scale_share: self.scale_share(d),
        }
    }

    /// See [`RateAt::scale_share`]; a single axis without a slope counts for all.
    fn scale_share(&self, d: i64) -> u16 {
        let open = self.scale1_q38.contains(&0);
        let per_c = if open { SLOPES_OPEN } else { SLOPES_KNOWN };
        // d is below 2^14.1.
        ((d.unsigned_abs() as u32 * per_c) >> 8) as u16
    }

    /// The matrix at a distance from 25 degC, 2^-8 degC.
    fn matrix_at(&self, d: i64) -> [[i32; 3]; 3] {
        // 2^-30 per step; d is below 2^14.1, so it is below 2^29.1.
        let scale = self.scale1_q38.map(|s| (i64::from(s) * d) >> 16);
        let mut matrix = self.matrix;
        for (row, unit) in matrix.iter_mut().zip(Self::IDENTITY.matrix) {
            for ((entry, unit), scale) in row.iter_mut().zip(unit).zip(scale) {
                let scaled = i64::from(*entry) + ((i64::from(*entry) * scale) >> 30);
                let error = scaled - i64::from(unit);
                let held = error.clamp(-i64::from(LARGEST_ERROR), i64::from(LARGEST_ERROR));
                *entry = unit + held as i32;
            }
        }
        matrix
    }

    /// The bias at a distance from 25 degC (2^-8 degC), 2^-30 rad/s per step.
    fn bias_at(&self, d: i64) -> [i32; 3] {
        let mut bias = self.bias_q30;
        let slopes = self.bias1_q38.iter().zip(&self.bias2_q46);
        for (bias, (&b1, &b2)) in bias.iter_mut().zip(slopes) {
            *bias = saturate(i64::from(*bias) + quadratic(b1, b2, d));
        }
        bias
    }
}

impl RateAt {
    /// What its temperature adds to the standard uncertainty of the scale of two channels with
    /// such a calibration, 2^-16: less where the slope of each axis is known.
    pub const fn scale_share(&self) -> u16 {
        self.scale_share
    }

    /// The true rate; saturates at +-128 rad/s (7 334 deg/s).
    pub fn apply(&self, measured: Rate) -> Rate {
        let [x, y, z] = measured.rate;
        let product = |m: i32, r: i32| i64::from(m) * i64::from(r);
        let mut rate = [0; 3];
        for (rate, (row, offset)) in rate.iter_mut().zip(self.matrix.iter().zip(&self.offset)) {
            let [a, b, c] = *row;
            // The sizes of a row add up to 1.75 at most, so the sum is below 2^61.9.
            let sum = product(a, x) + product(b, y) + product(c, z) - offset;
            *rate = saturate(sum >> 30);
        }
        Rate { rate }
    }
}

impl Rate {
    /// In rad/s.
    pub fn rad_s(self) -> [f64; 3] {
        self.rate.map(|rate| f64::from(rate) / RATE_STEPS)
    }
}

/// The entries that the identity has as 1.
fn diagonal(matrix: &mut [[f64; 3]; 3]) -> [&mut f64; 3] {
    let [[xx, _, _], [_, yy, _], [_, _, zz]] = matrix;
    [xx, yy, zz]
}

/// The nearest step; `None` where it does not fit or is no number.
fn nearest(steps: f64) -> Option<i32> {
    let rounded = if steps < 0.0 {
        steps - 0.5
    } else {
        steps + 0.5
    };
    (rounded.abs() < 2_147_483_648.0).then_some(rounded as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::least_squares::times;
    use proptest::array::{uniform3, uniform9};
    use proptest::prelude::*;

    const RAD: f64 = core::f64::consts::PI / 180.0;

    fn real(errors: [f64; 9], bias: [[f64; 3]; 3], scale1: [f64; 3]) -> RealRateCorrection {
        let [a, b, c, d, e, f, g, h, i] = errors;
        let mut matrix = [[a, b, c], [d, e, f], [g, h, i]];
        for value in diagonal(&mut matrix) {
            *value += 1.0;
        }
        let [bias, bias1, bias2] = bias.map(|row| row.map(|value| value * RAD));
        RealRateCorrection {
            matrix,
            scale1,
            bias,
            bias1,
            bias2,
        }
    }

    /// The same in real arithmetic, rad/s.
    fn expected(real: &RealRateCorrection, measured: Rate, temperature: Temperature) -> [f64; 3] {
        let d = f64::from(temperature.0) / 256.0 - 25.0;
        let mut rate = measured.rad_s();
        for (i, rate) in rate.iter_mut().enumerate() {
            let bias = real.bias[i] + d * (real.bias1[i] + d * real.bias2[i]);
            *rate = (*rate - bias) * (1.0 + real.scale1[i] * d);
        }
        times(&real.matrix, rate)
    }

    #[test]
    fn identity_is_identity() {
        for rate in [[0, 1, -1], [i32::MAX, i32::MIN, 12_345]] {
            for temperature in [-100, 25, 85, 500].map(Temperature::from_celsius) {
                let at = RateCorrection::IDENTITY.at(temperature);
                assert_eq!(at.apply(Rate { rate }), Rate { rate });
            }
        }
    }

    #[test]
    fn half_a_step_is_rounded_upwards() {
        let quarter_more = ONE + ONE / 4;
        let correction = RateCorrection {
            matrix: [[quarter_more, 0, 0], [0, quarter_more, 0], [0, 0, ONE]],
            ..RateCorrection::IDENTITY
        };
        let at = correction.at(Temperature::REFERENCE);
        let apply = |x, y| at.apply(Rate { rate: [x, y, 7] }).rate;
        assert_eq!(apply(1, 3), [1, 4, 7]);
        assert_eq!(apply(2, -2), [3, -2, 7]);
        assert_eq!(apply(-1, -3), [-1, -4, 7]);
    }

    #[test]
    fn the_ranges_that_a_part_needs_fit_and_others_are_refused() {
        let largest = real([0.1; 9], [[20.0; 3], [0.1; 3], [0.001; 3]], [0.001; 3]);
        assert!(RateCorrection::from_real(&largest).is_some());
        let refused = |change: &dyn Fn(&mut RealRateCorrection)| {
            let mut real = largest;
            change(&mut real);
            RateCorrection::from_real(&real).is_none()
        };
        assert!(refused(&|r| r.matrix[1][2] = 0.26));
        assert!(refused(&|r| r.matrix[0][0] = f64::NAN));
        assert!(refused(&|r| r.bias[1] = 2.0));
        assert!(refused(&|r| r.bias1[2] = -0.008));
        assert!(refused(&|r| r.bias2[0] = f64::INFINITY));
        assert!(refused(&|r| r.scale1[0] = f64::NAN));
    }

    #[test]
    fn each_entry_of_the_matrix_may_be_a_quarter_off_the_identity() {
        for place in 0..9 {
            for (off, near) in [(ONE / 4, true), (ONE / 4 + 1, false), (i32::MIN, false)] {
                let mut rates = RateCorrection::IDENTITY;
                let entry = &mut rates.matrix.as_flattened_mut()[place];
                *entry = entry.wrapping_add(off);
                assert_eq!(rates.is_near_identity(), near, "{place} {off}");
            }
        }
    }

    #[test]
    fn a_bias_of_a_millionth_of_a_degree_per_second_and_a_scale_of_1e_8_are_kept() {
        let mut small = real([0.0; 9], [[1e-6; 3], [0.0; 3], [0.0; 3]], [0.0; 3]);
        let kept = RateCorrection::from_real(&small).unwrap();
        let found = f64::from(kept.bias_q30[0]) / f64::from(ONE) / RAD;
        assert!((found - 1e-6).abs() < 3e-8, "{found}");
        small.matrix[0][0] += 1e-8;
        let kept = RateCorrection::from_real(&small).unwrap();
        assert!((kept.matrix[0][0] - ONE - 10).abs() <= 1);
    }

    proptest! {
        /// One step of the result is 6e-8 rad/s: half of it by rounding, and 1e-8 for each rad/s
        /// by the formats.
        #[test]
        fn follows_real_arithmetic(
            errors in uniform9(-0.1..0.1),
            bias in uniform3(-20.0..20.0),
            bias1 in uniform3(-0.1..0.1),
            bias2 in uniform3(-0.001..0.001),
            scale1 in uniform3(-5e-4..5e-4),
            rate in uniform3(-600_000_000..600_000_000),
            temperature in -40 * 256..85 * 256,
        ) {
            let real = real(errors, [bias, bias1, bias2], scale1);
            let (rate, temperature) = (Rate { rate }, Temperature(temperature));
            let correction = RateCorrection::from_real(&real).unwrap();
            prop_assert_eq!(RateCorrection::from_real(&correction.real()), Some(correction));
            prop_assert!(correction.is_near_identity());
            let found = correction.at(temperature).apply(rate).rad_s();
            let most = rate.rad_s().iter().fold(0.0, |most: f64, r| most.max(r.abs()));
            for (found, expected) in found.iter().zip(expected(&real, rate, temperature)) {
                let limit = 0.51 / RATE_STEPS + 1e-8 * (1.0 + most);
                prop_assert!((found - expected).abs() < limit, "{} {}", found, expected);
            }
        }

        /// Whatever a damaged record holds.
        #[test]
        fn saturates_and_never_overflows(
            fields in prop::array::uniform21(extreme()),
            rate in uniform3(extreme()),
            temperature in extreme(),
        ) {
            let [a, b, c, d, e, f, g, h, i, rest @ ..] = fields;
            let [s, t, u, j, k, l, m, n, o, p, q, r] = rest;
            let damaged = RateCorrection {
                matrix: [[a, b, c], [d, e, f], [g, h, i]],
                scale1_q38: [s, t, u],
                bias_q30: [j, k, l],
                bias1_q38: [m, n, o],
                bias2_q46: [p, q, r],
            };
            damaged.at(Temperature(temperature)).apply(Rate { rate });
        }
    }

    fn extreme() -> impl Strategy<Value = i32> {
        prop_oneof![Just(i32::MIN), Just(i32::MAX), any::<i32>()]
    }
}
