//! What a gyroscope adds to a chain: the vertical sample by sample, while the machine moves.
//!
//! In: one sample's calibrated acceleration and its rate of turn, with the measured time between
//! samples. Out: the verticals of the last two samples, from which the chain reads the angle at
//! any instant near them, the reason where there is none, and the corrected rate of turn.
//!
//! The rate is corrected by its own calibration at the present temperature, and by the part's
//! clock: the estimator ([`motion`](crate::motion)) reckons with nominal periods, and a part whose
//! samples are 3 % further apart turns by 3 % more from one to the next.
//!
//! Left out: the low-pass. A vertical is not filtered, so its delay is the part's alone, which
//! [`Expected::delay_s`](crate::motion::Expected) makes up for.

use crate::chain::Invalid;
use crate::health::log2_q8;
use crate::motion::{Expected, Motion, MotionState, Rate, Vertical};
use crate::rate::{RateAt, RateCorrection};
use crate::sample::{RateRange, Temperature};
use crate::saturate::saturate;
use crate::temperature::CompensationAt;
use crate::turned::{Turned, TurnedState, per_period_q32};
use crate::vector::Corrected;

/// The configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Fusion {
    /// The estimator.
    pub motion: Motion,
    /// Range of the gyroscope.
    pub range: RateRange,
    /// Latency of the aligned angle, us: between one period and four.
    pub latency_us: u32,
    /// Identical codes of all axes, and of any one, that a gyroscope in order does not give in a
    /// row; `None` for one without noise, which stands still by right.
    repeats: Option<[u8; 2]>,
    /// 2^40 over the nominal time between samples, 1/256 us.
    per_period_q40: u64,
    /// A nominal period for [`TurnedState::turn`].
    turned_q32: i32,
    /// Energy of the second difference of the part's own noise, log2 in 1/256.
    level_q8: i32,
}

impl Fusion {
    /// `None` where the estimator's expectations are out of their bounds.
    pub const fn new(expected: &Expected, range: RateRange, latency_us: u32) -> Option<Self> {
        let Some(motion) = Motion::new(expected) else {
            return None;
        };
        Some(Self {
            motion,
            range,
            latency_us,
            repeats: Some(REPEATS),
            per_period_q40: (1_099_511_627_776.0 / (expected.period_s * 256e6) + 0.5) as u64,
            turned_q32: per_period_q32(expected.period_s),
            level_q8: noise_level_q8(expected),
        })
    }

    /// The same for a gyroscope without noise, whose codes stand still by right.
    pub const fn without_noise(mut self) -> Self {
        self.repeats = None;
        self
    }

    /// Takes a sample: acceleration in the housing's axes, and the rate that was memorised.
    ///
    /// `period_q8` is the measured time between samples, 1/256 us. `missing` samples before this
    /// one are taken to have been like it.
    pub fn sample(&self, state: &mut FusionState, accel: Corrected, period_q8: u32, missing: u32) {
        let rate = self.by_clock(state.rates.apply(state.measured), period_q8);
        for _ in 0..missing {
            // Its vertical is of no instant that is asked for.
            let _ = self.motion.step(&mut state.motion, rate, accel);
        }
        let latest = self.motion.step(&mut state.motion, rate, accel);
        if self.motion.reaches(rate) {
            state.turned.turn(rate, self.turned_q32, missing + 1);
        } else {
            state.turned.interrupt();
        }
        state.previous = core::mem::replace(&mut state.latest, latest);
        // A correction is no turn: it must not count for one between the two verticals, or ahead.
        let corrected = state.motion.take_corrected();
        if let Ok(previous) = &mut state.previous {
            // By reference: an array that is used up costs a call for each of its values.
            for (up, moved) in previous.up.iter_mut().zip(&corrected) {
                *up = up.wrapping_add(*moved);
            }
        }
    }

    /// The rate that would turn the housing as far within a nominal period.
    fn by_clock(&self, rate: Rate, period_q8: u32) -> Rate {
        let ratio_q30 = (u64::from(period_q8) * self.per_period_q40) >> 10;
        let ratio_q30 = ratio_q30.min(1 << 31).cast_signed();
        Rate {
            rate: rate.rate.map(|rate| {
                let turned = (i64::from(rate) * ratio_q30 + (1 << 29)) >> 30;
                saturate(turned)
            }),
        }
    }
}

/// Energy of a sample's second difference by noise alone, log2 in 1/256, in the unit of
/// [`TurnedState`]: three axes, six variances each.
const fn noise_level_q8(expected: &Expected) -> i32 {
    let steps = expected.rate_noise * 262_144.0;
    log2_q8((18.0 * steps * steps / (2.0 * expected.period_s)) as u64)
}

/// Repeats that no gyroscope in order gives: all axes 24 ms, one axis 96 ms at 417 samples/s.
///
/// With 3.3 steps of white noise the likeliest code comes with a probability of 0.12; six of all
/// axes or fifteen of one are below 1e-13 a sample. More, since the part's low-pass makes
/// neighbours alike \[ASSUME\].
const REPEATS: [u8; 2] = [10, 40];

/// What fusion remembers between samples.
#[derive(Clone, Debug)]
pub struct FusionState {
    motion: MotionState,
    rates: RateAt,
    /// What temperature does to the acceleration.
    compensation: CompensationAt,
    /// The rate of the last sample before its correction, in the sensor's axes: what a calibration
    /// memorises.
    measured: Rate,
    turned: TurnedState,
    latest: Result<Vertical, Invalid>,
    previous: Result<Vertical, Invalid>,
    /// Repeats of all codes at once, and of each axis' code, so far.
    repeated_all: u8,
    repeated: [u8; 3],
    measured_sum: MeasuredSum,
}

/// The measured rate summed up since the start, in the sensor's axes, before its correction: two
/// of these differ by the turn between them, however rarely they are read. All of it wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeasuredSum {
    /// Sum over the samples, 2^-16 rad/s per step. Each sample is rounded down, so a mean is low
    /// by up to one step, at rest as in a turn.
    pub sum: [i32; 3],
    /// Samples.
    pub samples: u16,
    /// How often samples were missing before one that came, and how many were filled there.
    pub gaps: u16,
}

impl Default for FusionState {
    fn default() -> Self {
        Self {
            motion: MotionState::default(),
            rates: RateCorrection::IDENTITY.at(Temperature::REFERENCE),
            compensation: CompensationAt::default(),
            measured: Rate::default(),
            turned: TurnedState::default(),
            latest: Err(Invalid::NoSample),
            previous: Err(Invalid::NoSample),
            repeated_all: 0,
            repeated: [0; 3],
            measured_sum: MeasuredSum::default(),
        }
    }
}

impl FusionState {
    /// The die has this temperature from now on, and `compensation` is what that does to the
    /// acceleration.
    pub fn temperature(
        &mut self,
        fusion: &Fusion,
        correction: &RateCorrection,
        compensation: CompensationAt,
        temperature: Temperature,
    ) {
        fusion.motion.temperature(&mut self.motion, temperature);
        self.rates = correction.at(temperature);
        self.compensation = compensation;
    }

    /// What the temperature does to the acceleration.
    pub(crate) const fn compensation(&self) -> &CompensationAt {
        &self.compensation
    }

    /// Begins anew after a gap; what was found of the gyroscope is kept.
    pub fn restart(&mut self) {
        self.measured_sum.gaps = self.measured_sum.gaps.wrapping_add(1);
        self.motion.restart();
        self.turned.interrupt();
        self.latest = Err(Invalid::NoSample);
        self.previous = Err(Invalid::NoSample);
    }

    /// Begins anew as at first: the sensor has measured wrongly, and whatever was found meanwhile
    /// with it.
    pub fn forget(&mut self) {
        self.motion.forget();
        self.latest = Err(Invalid::NoSample);
        self.previous = Err(Invalid::NoSample);
    }

    /// Memorises what the gyroscope read, in its own axes.
    pub(crate) fn memorise(&mut self, rate: Rate) {
        let before = core::mem::replace(&mut self.measured, rate);
        self.add(rate);
        let count = |again: bool, repeats: &mut u8| {
            *repeats = if again { repeats.saturating_add(1) } else { 0 };
        };
        // Axis by axis: loops over both would cost more than all the rest.
        let ([x, y, z], [old_x, old_y, old_z]) = (rate.rate, before.rate);
        let [of_x, of_y, of_z] = &mut self.repeated;
        let (again_x, again_y, again_z) = (x == old_x, y == old_y, z == old_z);
        count(again_x && again_y && again_z, &mut self.repeated_all);
        count(again_x, of_x);
        count(again_y, of_y);
        count(again_z, of_z);
    }

    /// Adds a sample to the sum: some ten instructions.
    fn add(&mut self, Rate { rate: [x, y, z] }: Rate) {
        let [sum_x, sum_y, sum_z] = &mut self.measured_sum.sum;
        *sum_x = sum_x.wrapping_add(x >> 8);
        *sum_y = sum_y.wrapping_add(y >> 8);
        *sum_z = sum_z.wrapping_add(z >> 8);
        self.measured_sum.samples = self.measured_sum.samples.wrapping_add(1);
    }

    /// What the gyroscope has measured since the start; of the gaps those that were too long to
    /// be filled.
    pub const fn measured_sum(&self) -> MeasuredSum {
        self.measured_sum
    }

    /// True where the gyroscope's codes repeat as those of no part in order do.
    fn stuck(&self, fusion: &Fusion) -> bool {
        fusion.repeats.is_some_and(|[all, one]| {
            self.repeated_all >= all || self.repeated.iter().any(|repeats| *repeats >= one)
        })
    }

    /// The verticals of the last two samples, the older one first.
    ///
    /// # Errors
    /// Why one of them is not known: [`Invalid::Stuck`] where the gyroscope's codes stand still,
    /// and otherwise that of [`Motion::step`].
    pub fn verticals(&self, fusion: &Fusion) -> Result<[Vertical; 2], Invalid> {
        if self.stuck(fusion) {
            return Err(Invalid::Stuck);
        }
        Ok([self.previous?, self.latest?])
    }

    /// The rate of the last sample before its correction, in the sensor's axes: what a calibration
    /// memorises.
    pub const fn measured(&self) -> Rate {
        self.measured
    }

    /// How far the channel has turned, `before_us` before the last sample.
    pub(crate) fn take_turned(
        &mut self,
        fusion: &Fusion,
        before_us: i64,
        accel: u32,
    ) -> Option<Turned> {
        let bias = self.bias();
        let turned = self.turned.take(before_us, fusion.level_q8)?;
        Some(Turned {
            bias,
            accel,
            scale_share: self.rates.scale_share(),
            ..turned
        })
    }

    /// What was turned since the last look is of no use.
    pub(crate) const fn interrupt_turned(&mut self) {
        self.turned.interrupt();
    }

    /// The rate of the last sample about the housing's axes: corrected by its calibration, and by
    /// the bias that was found beside it.
    pub fn rate(&self) -> Rate {
        let mut corrected = self.rates.apply(self.measured);
        let bias = self.bias().unwrap_or_default();
        for (rate, bias) in corrected.rate.iter_mut().zip(&bias) {
            // From 2^-32 to 2^-24 rad/s per step.
            *rate = rate.saturating_sub((bias + 128) >> 8);
        }
        corrected
    }

    /// The gyroscope's bias as estimated beside its calibration, 2^-32 rad/s per step.
    pub fn bias(&self) -> Option<[i32; 3]> {
        self.motion.bias()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_grow_by_each_sample_and_a_long_gap_is_counted() {
        let mut state = FusionState::default();
        for _ in 0..70_000 {
            state.memorise(Rate {
                rate: [256 * 4_000, -256, 255],
            });
        }
        let MeasuredSum { sum, samples, gaps } = state.measured_sum();
        let wrapped = 4_000_i64 * 70_000;
        assert_eq!(sum, [wrapped as i32, -70_000, 0]);
        assert_eq!((samples, gaps), (70_000_u32 as u16, 0));
        state.restart();
        assert_eq!(state.measured_sum().gaps, 1);
        assert_eq!(state.measured_sum().sum, sum);
    }
}
