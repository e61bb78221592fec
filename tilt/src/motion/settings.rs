//! What the estimator is told of its sensors and of the machine, and what becomes of it.
//!
//! In: [`Expected`], real numbers with units. Out: [`Motion`], the same as integers in the units
//! of `covariance`. It is evaluated when the program is built, or at start; the path of a sample
//! has no real number.

use super::BLOCK;
use super::covariance::{LARGEST, Variances};
use crate::saturate::saturate;
use crate::uncertainty::Uncertainty;

/// What is expected of gyroscope, accelerometer and motion; standard deviations (k = 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// From sample to sample, s: 0.0005 to 0.01.
    pub period_s: f64,
    /// How late the gyroscope's rate is against the moment of its sample, s: its own filter. The
    /// vertical is given for the moment of the sample; up to 16 periods.
    pub delay_s: f64,
    /// White noise of the rate, rad/s per square root of Hz.
    pub rate_noise: f64,
    /// What is left of each rate, as a share of it, that scale and alignment do not explain, times
    /// the square root of the time for which it lasts, square root of s.
    pub rate_defect: f64,
    /// Bias of one axis at first, rad/s: up to 0.044.
    pub bias: f64,
    /// How the bias wanders, rad/s per square root of s.
    pub bias_walk: f64,
    /// Scale and alignment at first: up to 0.044. More than twice as much is never believed: where
    /// a lever arm makes acceleration follow the turns, it looks like scale.
    pub gain: f64,
    /// Change of scale per degree of temperature that the calibration does not have, 1/degC: up to
    /// 2e-4.
    pub gain_per_degree: f64,
    /// Time after which a change of scale and alignment by as much is no surprise, s.
    pub gain_memory_s: f64,
    /// White noise of the acceleration and of what shakes it, g per square root of Hz.
    pub accel_noise: f64,
    /// What the vertical at rest is off by in one direction, rad: the accelerometer's offset.
    pub accel_offset: f64,
    /// For how long the machine's velocity keeps its direction, s: the least and the most that is
    /// believed of what is seen.
    pub swing_s: [f64; 2],
    /// For how long a velocity that was seen counts as one that may come again, s.
    pub hold_s: f64,
    /// Velocity that a machine may have at the start, g s.
    pub start_speed: f64,
    /// The least velocity that a machine is believed to have while it moves, g s.
    pub least_speed: f64,
    /// Velocity that no machine has, g s, root mean square of both axes: what is seen beyond it has
    /// come from a wrong vertical, which is found anew. The same happens to a machine that gains
    /// more speed than that, and then its acceleration may be taken for tilt.
    pub most_speed: f64,
    /// Rate about each axis below which it may be at rest, rad/s.
    pub rest_rate: f64,
    /// Change of the acceleration, from one block to the next, below which it may be at rest, g.
    pub rest_accel: f64,
    /// Change of the rate about each axis within a rest, rad/s.
    pub rest_rate_change: f64,
    /// Time for which all of this has to last, s.
    pub rest_after_s: f64,
    /// Velocity against the ground, or against a steady speed, that it is believed to have at rest,
    /// g s.
    pub rest_speed: f64,
    /// By how much the length of the acceleration may differ from 1 g where it is gravity, g.
    pub gravity: f64,
    /// Time for which a quiet machine's gravity has to contradict the vertical until that is found
    /// anew, s: longer than a machine gains speed at a steady rate.
    pub refuted_after_s: f64,
    /// Vertical at the start, rad: up to 0.17.
    pub start: f64,
    /// Above this uncertainty there is no vertical, rad.
    pub limit: f64,
    /// The gyroscope's full scale, rad/s.
    pub rate_range: f64,
    /// The accelerometer's full scale, g.
    pub accel_range: f64,
}

impl Expected {
    /// A six-axis part of the industrial class, calibrated, at 400 samples/s.
    ///
    /// The figures of motion were found with recordings of a sensor carried by hand (BROAD, Data
    /// 6(7):72, 2021); none of them needs to be right to better than a factor of two. A wheel
    /// loader drives at 10 m/s \[ASSUME\].
    pub const INDUSTRIAL: Self = Self {
        period_s: 0.0025,
        delay_s: 0.0,
        rate_noise: 1.75e-4,
        rate_defect: 1.58e-3,
        bias: 0.017_45,
        bias_walk: 8.7e-5,
        gain: 0.005,
        gain_per_degree: 5.0e-5,
        gain_memory_s: 1000.0,
        accel_noise: 0.001,
        accel_offset: 0.004_4,
        swing_s: [0.25, 1.0],
        hold_s: 5.0,
        start_speed: 0.1,
        least_speed: 0.01,
        most_speed: 1.0,
        rest_rate: 0.03,
        rest_accel: 0.005,
        rest_rate_change: 0.006,
        rest_after_s: 0.4,
        rest_speed: 0.001,
        gravity: 0.02,
        refuted_after_s: 3.0,
        start: 0.14,
        limit: 0.105,
        rate_range: 34.9,
        accel_range: 15.9,
    };

    /// The same with the calibration of `calibration::gyroscope`, on a machine.
    ///
    /// Noise of the rate is that of the ISM330DHCX's data sheet, 5 mdps per root of Hz; of the
    /// acceleration it is twice that of the part, 60 ug per root of Hz. What calibration leaves
    /// \[ASSUME\]: 0.1 % of scale and alignment, and 0.17 deg/s of bias, from one power-on to the
    /// next and over the years; the bias wanders with what gravity does to it as the housing turns.
    /// A machine at rest moves by 3 mm/s at most, its engine idling \[ASSUME\].
    pub const CALIBRATED: Self = Self {
        rate_noise: 1.0e-4,
        rate_defect: 3.0e-4,
        bias: 0.003,
        bias_walk: 5.0e-5,
        gain: 0.001,
        accel_noise: 1.5e-4,
        rest_speed: 0.0003,
        // The calibration's budget has it.
        accel_offset: 0.0,
        ..Self::INDUSTRIAL
    };
}

/// The estimator's configuration: [`Expected`] in integers.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// 2^-32 s per step.
    pub(super) period_q32: u32,
    /// In 2^-16 periods.
    pub(super) delay_q16: i32,
    /// Steps of a rate.
    pub(super) rate_range: u32,
    /// Steps of an acceleration.
    pub(super) accel_range: u32,
    /// At the start.
    prior: Variances,
    /// What scale and alignment are at the most, 2^-32.
    most_gain: i32,
    /// The same that a change of temperature adds, for 2^-8 degC; and its variance, for 1 degC.
    most_gain_warmed: i32,
    warmth: i32,
    /// Of one block without turns.
    noise: Variances,
    /// Variance of tilt for the square of turns (2^-30 rad^2), 2^-20 per step.
    defect_q20: u32,
    /// What a velocity's square loses in a block, 2^-16.
    pub(super) decay_q16: u32,
    /// Variance of a block's velocity for its mean square, the least and the most, 2^-8.
    pub(super) least_weight_q8: i64,
    pub(super) most_weight_q8: i64,
    /// Mean squares of velocities: at the start, the least, the most, at rest.
    pub(super) start_speed: i64,
    pub(super) least_speed: i64,
    pub(super) most_speed: i32,
    pub(super) rest_variance: i32,
    /// The largest turn of a block at rest, 2^-30 rad.
    pub(super) rest_turn: u32,
    /// The largest change from block to block of the velocity gained, 2^-30 g s, and of the turns,
    /// 2^-30 rad.
    pub(super) rest_change: [u32; 5],
    /// Blocks at rest until it counts.
    pub(super) rest_blocks: u32,
    /// Squares of an acceleration that is gravity, 2^-52 g^2.
    pub(super) gravity: core::ops::RangeInclusive<u64>,
    /// Variance of tilt above which rest takes longer, and how many blocks.
    pub(super) doubt: i32,
    /// Variance of tilt below which the vertical has been found.
    pub(super) found: i32,
    pub(super) doubted_blocks: u32,
    /// Blocks of contradiction until the vertical is found anew.
    pub(super) refuted_blocks: u32,
    /// Variance of the vertical by the accelerometer.
    pub(super) accel_variance: i32,
    /// The largest uncertainty.
    pub(super) limit: Uncertainty,
}

/// The units of the states: 2 g s, 2^-2 rad, 2^-4 rad/s, 2^-4.
const VELOCITY: f64 = 2.0;
const TILT: f64 = 0.25;
const ERROR: f64 = 0.0625;

/// Standard uncertainty of a vertical that is hardly known, rad: five of it explain 0.17 g beside.
pub(super) const DOUBT: f64 = 0.035;

/// The same of one that has been found, rad: what was expected of the machine at the start is no
/// longer needed.
pub(super) const FOUND: f64 = 0.009;

/// For how long rest has to last there, s.
pub(super) const DOUBTED_S: f64 = 0.7;

/// Variance of the bias of a gyroscope that gravity has contradicted, of 2 deg/s.
const DOUBTED_BIAS: i32 = variance(0.035, ERROR);

impl Motion {
    /// From real numbers; `None` where one is outside what [`Expected`] says of it, negative or
    /// not a number.
    pub const fn new(e: &Expected) -> Option<Self> {
        if !sound(e) {
            return None;
        }
        let block_s = e.period_s * BLOCK as f64;
        let prior = Variances {
            velocity: variance(2.0 * e.start_speed, VELOCITY),
            tilt: variance(e.start, TILT),
            bias: variance(e.bias, ERROR),
            scale: variance(e.gain, ERROR),
            gain: variance(e.gain, ERROR),
        };
        let noise = Variances {
            velocity: walk(e.accel_noise, VELOCITY, block_s),
            tilt: walk(e.rate_noise, TILT, block_s),
            bias: walk(e.bias_walk, ERROR, block_s),
            scale: walk(e.gain, ERROR, block_s / e.gain_memory_s),
            gain: walk(e.gain, ERROR, block_s / e.gain_memory_s),
        };
        let gain = (e.rest_accel * block_s * 1_073_741_824.0) as u32;
        let change = (e.rest_rate_change * block_s * 1_073_741_824.0) as u32;
        let steps_per_radian = crate::angle::STEPS_PER_DEGREE * (180.0 / core::f64::consts::PI);
        Some(Self {
            period_q32: (e.period_s * 4_294_967_296.0 + 0.5) as u32,
            delay_q16: (e.delay_s / e.period_s * 65536.0 + 0.5) as i32,
            rate_range: (e.rate_range * super::RATE_STEPS) as u32,
            accel_range: (e.accel_range * crate::ONE_G as f64) as u32,
            prior,
            most_gain: (2.0 * e.gain * 4_294_967_296.0) as i32,
            most_gain_warmed: (2.0 * e.gain_per_degree / 256.0 * 4_294_967_296.0) as i32,
            warmth: variance(e.gain_per_degree, ERROR),
            noise,
            // A square in 2^-30 rad^2 has 2^5 units of covariance.
            defect_q20: (e.rate_defect * e.rate_defect / e.period_s * 33_554_432.0 + 0.5) as u32,
            decay_q16: (block_s / e.hold_s * 65_536.0 + 0.5) as u32,
            least_weight_q8: (2.0 * e.swing_s[0] / block_s * 256.0 + 0.5) as i64,
            most_weight_q8: (2.0 * e.swing_s[1] / block_s * 256.0 + 0.5) as i64,
            start_speed: variance(e.start_speed, VELOCITY) as i64,
            least_speed: variance(e.least_speed, VELOCITY) as i64,
            most_speed: square(e.most_speed / VELOCITY),
            rest_variance: variance(e.rest_speed, VELOCITY),
            rest_turn: (e.rest_rate * block_s * 1_073_741_824.0) as u32,
            rest_change: [gain, gain, change, change, change],
            rest_blocks: (e.rest_after_s / block_s + 1.0) as u32,
            gravity: length_square(1.0 - e.gravity)..=length_square(1.0 + e.gravity),
            doubt: variance(DOUBT, TILT),
            found: variance(FOUND, TILT),
            doubted_blocks: (DOUBTED_S / block_s + 1.0) as u32,
            refuted_blocks: (e.refuted_after_s / block_s + 1.0) as u32,
            accel_variance: variance(e.accel_offset, TILT),
            limit: Uncertainty((e.limit * steps_per_radian) as u32),
        })
    }

    /// Variances at the start, so far (2^-8 degC) from 25 degC.
    pub(super) const fn priors(&self, warmed: i32) -> Variances {
        let scale = self.prior.scale.saturating_add(self.of_warmth(0, warmed));
        Variances {
            scale: if scale < LARGEST { scale } else { LARGEST },
            ..self.prior
        }
    }

    /// Variances of a gyroscope that gravity has contradicted, so far from 25 degC.
    pub(super) const fn doubted(&self, warmed: i32) -> Variances {
        Variances {
            bias: DOUBTED_BIAS,
            ..self.priors(warmed)
        }
    }

    /// Variance that a change of temperature adds to the scale; both temperatures from 25 degC,
    /// 2^-8 degC.
    ///
    /// A scale that follows the temperature in a straight line from where it was calibrated.
    pub(super) const fn of_warmth(&self, from: i32, to: i32) -> i32 {
        let change = from.abs_diff(to) as i64;
        let both = from.unsigned_abs() as i64 + to.unsigned_abs() as i64;
        saturate((self.warmth as i64 * ((change * both) >> 8)) >> 8)
    }

    /// The largest scale and alignment, so far (2^-8 degC) from 25 degC; 2^-32.
    pub(super) const fn most_gain(&self, warmed: i32) -> i32 {
        self.most_gain + self.most_gain_warmed * warmed.abs()
    }

    /// Noise of a block in which the squares of the turns add up to `square`, 2^-30 rad^2.
    pub(super) fn noise(&self, square: i64) -> Variances {
        // The least that saturates by far, with room for the product.
        let turning = (square.min(1 << 42) * i64::from(self.defect_q20)) >> 20;
        Variances {
            tilt: saturate(i64::from(self.noise.tilt) + turning),
            ..self.noise
        }
    }
}

/// Square of a standard deviation, which is below its unit; at least one step.
const fn variance(deviation: f64, unit: f64) -> i32 {
    square(deviation / unit) + 1
}

/// Square of a share, 2^-31.
const fn square(share: f64) -> i32 {
    (share * share * 2_147_483_648.0) as i32
}

/// Square of an acceleration in g, 2^-52.
const fn length_square(accel: f64) -> u64 {
    (accel * accel * 4_503_599_627_370_496.0) as u64
}

/// Variance of a random walk after `time_s`.
const fn walk(per_root_s: f64, unit: f64, time_s: f64) -> i32 {
    let share = per_root_s / unit;
    (share * share * time_s * 2_147_483_648.0) as i32 + 1
}

/// True where every number is within its bounds.
const fn sound(e: &Expected) -> bool {
    let bounds = [
        (e.period_s, 0.0005, 0.01),
        (e.delay_s / e.period_s, 0.0, 16.0),
        (e.rate_noise, 0.0, 0.1),
        (e.rate_defect, 0.0, 0.1),
        (e.bias, 0.0, 0.044),
        (e.bias_walk, 0.0, 0.01),
        (e.gain, 0.0, 0.044),
        (e.gain_per_degree, 0.0, 2e-4),
        (e.gain_memory_s, 1.0, 1e6),
        (e.accel_noise, 0.0, 1.0),
        (e.accel_offset, 0.0, 0.17),
        (e.swing_s[0], 0.01, 10.0),
        (e.swing_s[1], 0.01, 10.0),
        (e.hold_s, 0.5, 1e3),
        (e.start_speed, 0.001, 1.0),
        (e.least_speed, 0.001, 1.0),
        (e.most_speed, 0.001, 1.9),
        (e.rest_rate, 0.0, 1.0),
        (e.rest_accel, 0.0, 1.0),
        (e.rest_rate_change, 0.0, 1.0),
        (e.rest_after_s, 0.0, 1e3),
        (e.rest_speed, 0.0001, 1.0),
        (e.gravity, 0.0, 0.5),
        (e.refuted_after_s, 0.0, 1e3),
        (e.start, 0.0, 0.17),
        (e.limit, 0.0, 1.0),
        (e.rate_range, 0.0, 127.0),
        (e.accel_range, 0.0, 31.9),
    ];
    let mut at = 0;
    while at < bounds.len() {
        let (value, low, high) = bounds[at];
        // A number that is none fails each comparison.
        if !(value >= low && value <= high) {
            return false;
        }
        at += 1;
    }
    true
}
