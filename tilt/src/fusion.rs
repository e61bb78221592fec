//! What a gyroscope adds to a chain: the vertical sample by sample, while the machine moves.
//!
//! In: one sample's calibrated acceleration and its rate of turn, with the measured time between
//! samples. Out: the verticals of the last two samples, from which the chain reads the angle at
//! any instant near them, and the reason where there is none.
//!
//! The rate is corrected by its own calibration at the present temperature, and by the part's
//! clock: the estimator ([`motion`](crate::motion)) reckons with nominal periods, and a part whose
//! samples are 3 % further apart turns by 3 % more from one to the next.
//!
//! Left out: the low-pass. A vertical is not filtered, so its delay is the part's alone, which
//! [`Expected::delay_s`](crate::motion::Expected) makes up for.

use crate::chain::Invalid;
use crate::motion::{Expected, Motion, MotionState, Rate, Vertical};
use crate::rate::{RateAt, RateCorrection};
use crate::sample::{RateRange, Temperature};
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
    /// 2^40 over the nominal time between samples, 1/256 us.
    per_period_q40: u64,
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
            per_period_q40: (1_099_511_627_776.0 / (expected.period_s * 256e6) + 0.5) as u64,
        })
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
        state.previous = core::mem::replace(&mut state.latest, latest);
    }

    /// The rate that would turn the housing as far within a nominal period.
    fn by_clock(&self, rate: Rate, period_q8: u32) -> Rate {
        let ratio_q30 = (u64::from(period_q8) * self.per_period_q40) >> 10;
        let ratio_q30 = ratio_q30.min(1 << 31).cast_signed();
        Rate {
            rate: rate.rate.map(|rate| {
                let turned = (i64::from(rate) * ratio_q30 + (1 << 29)) >> 30;
                turned.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
            }),
        }
    }
}

/// What fusion remembers between samples.
#[derive(Clone, Debug)]
pub struct FusionState {
    motion: MotionState,
    rates: RateAt,
    /// The rate of the last sample before its correction, in the sensor's axes: what a calibration
    /// memorises.
    pub(crate) measured: Rate,
    latest: Result<Vertical, Invalid>,
    previous: Result<Vertical, Invalid>,
}

impl Default for FusionState {
    fn default() -> Self {
        Self {
            motion: MotionState::default(),
            rates: RateCorrection::IDENTITY.at(Temperature::REFERENCE),
            measured: Rate::default(),
            latest: Err(Invalid::NoSample),
            previous: Err(Invalid::NoSample),
        }
    }
}

impl FusionState {
    /// The die has this temperature from now on.
    pub fn temperature(&mut self, correction: &RateCorrection, temperature: Temperature) {
        self.rates = correction.at(temperature);
    }

    /// Begins anew after a gap; what was found of the gyroscope is kept.
    pub fn restart(&mut self) {
        self.motion.restart();
        self.latest = Err(Invalid::NoSample);
        self.previous = Err(Invalid::NoSample);
    }

    /// The verticals of the last two samples, the older one first.
    ///
    /// # Errors
    /// Why one of them is not known.
    pub fn verticals(&self) -> Result<[Vertical; 2], Invalid> {
        Ok([self.previous?, self.latest?])
    }

    /// The rate of the last sample before its correction, in the sensor's axes: what a calibration
    /// memorises.
    pub const fn measured(&self) -> Rate {
        self.measured
    }

    /// The gyroscope's bias as estimated beside its calibration, 2^-32 rad/s per step.
    pub fn bias(&self) -> Option<[i32; 3]> {
        self.motion.bias()
    }
}
