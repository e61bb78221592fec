//! How far a channel has turned: the sum of its rates, so that two gyroscopes can be compared
//! without a turn between two looks being lost.
//!
//! In: the rate of every sample about the housing's axes. Out, at the instant of a reading: the
//! angle turned since the start, which wraps, and the energy of what no machine does from one
//! sample to the next ([`Activity`]). Sums are compared and not rates, since two parts sample at
//! different times: a rate differs by what it changes in between, an angle hardly.
//!
//! Angles about three axes do not add up to an orientation. From one look to the next the housing
//! turns by a degree or two: what the order of the axes makes of that is half the product of two
//! such turns, and alike in both channels.
//!
//! Left out: the comparison (`cross_check::rates`).

use crate::health::Activity;
use crate::motion::Rate;

/// What one channel's gyroscope reports of one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Turned {
    /// The angle turned about each axis of the housing, by its own calibration, since some start;
    /// 2^-18 of a circle (1.4 mdeg), so it wraps at 45 deg either way.
    pub angle: [i16; 3],
    /// Energy of the second difference of its samples since the look before, against the part's
    /// own noise.
    pub activity: Activity,
    /// The bias that the channel has found beside its calibration, 2^-32 rad/s; `None` where there
    /// is none yet, and always for the other channel, which does not tell it.
    pub bias: Option<[i32; 3]>,
    /// Standard uncertainty of the channel's acceleration itself, which its angle's is not where
    /// the machine moves, 2^-26 g; 0 for the other channel, which does not tell it.
    pub accel: u32,
    /// What the part's temperature adds to the standard uncertainty of the scale of two channels
    /// with a calibration like its own, 2^-16; 0 for the other channel, which does not tell it.
    pub scale_share: u16,
}

/// Of a circle (2^-32) in 2^-24 rad/s times 1 us, 2^-32 per step: 2^8 / (2 pi) 1e-6 2^32.
const PER_US_Q32: f64 = 256.0 / core::f64::consts::TAU * 1e-6 * 4_294_967_296.0;

/// [`PER_US_Q32`] as an integer, 174 992.
const MICROSECOND_Q32: i64 = (PER_US_Q32 + 0.5) as i64;

/// A nominal period of `period_s` in the unit of [`TurnedState::turn`].
pub(crate) const fn per_period_q32(period_s: f64) -> i32 {
    (PER_US_Q32 * period_s * 1e6 + 0.5) as i32
}

/// Half a step of [`Turned::angle`], 2^-64 of a circle.
const HALF_STEP: i64 = 1 << 45;

/// Fewest samples of a look at the energy.
const SHORTEST: u16 = 4;

/// Samples after a gap whose second difference has what was before it.
const WARM_UP: u8 = 2;

/// The sums of one channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct TurnedState {
    /// 2^-64 of a circle, wrapping.
    sum: [i64; 3],
    /// The rate of the last sample, 2^-24 rad/s.
    rate: [i32; 3],
    /// Its change from the sample before.
    change: [i32; 3],
    /// Something is missing since the last look.
    gap: bool,
    /// Samples since a gap, up to [`WARM_UP`].
    warm: u8,
    /// Squares of the second differences, 2^-36 (rad/s)^2, and their number.
    energy: u64,
    samples: u16,
}

impl TurnedState {
    /// A sample, which counts for `times` periods.
    pub(crate) fn turn(&mut self, rate: Rate, per_period_q32: i32, times: u32) {
        let turned = i64::from(per_period_q32) * i64::from(times);
        let mut energy = 0;
        let axes = self
            .sum
            .iter_mut()
            .zip(&mut self.rate)
            .zip(&mut self.change);
        // By reference: an array that is used up costs a call for each of its values.
        for (((sum, before), change), &rate) in axes.zip(&rate.rate) {
            *sum = sum.wrapping_add(i64::from(rate).wrapping_mul(turned));
            let change_now = rate.wrapping_sub(*before);
            // 2^-18 rad/s are 0.2 mdeg/s, and 4000 deg/s have room.
            let second = i64::from(change_now.wrapping_sub(*change) >> 6);
            energy += (second * second) as u64;
            (*before, *change) = (rate, change_now);
        }
        if self.warm < WARM_UP {
            self.warm += 1;
        } else if self.samples < u16::MAX {
            self.energy = self.energy.saturating_add(energy);
            self.samples += 1;
        }
    }

    /// Samples are missing, or of no use.
    pub(crate) const fn interrupt(&mut self) {
        self.gap = true;
        self.warm = 0;
    }

    /// The angle `before_us` before the last sample, at most a few periods; `None` where
    /// something is missing since the last time that this was asked for.
    ///
    /// `level_q8` is the energy of the part's own noise, log2 in 1/256.
    pub(crate) fn take(&mut self, before_us: i64, level_q8: i32) -> Option<Turned> {
        let gap = core::mem::take(&mut self.gap);
        let activity = self.take_activity(gap, level_q8);
        let before = before_us.clamp(-20_000, 20_000) * MICROSECOND_Q32;
        let mut angle = [0; 3];
        for (angle, (sum, rate)) in angle.iter_mut().zip(self.sum.iter().zip(&self.rate)) {
            let sum = sum.wrapping_sub(i64::from(*rate).wrapping_mul(before));
            *angle = (sum.wrapping_add(HALF_STEP) >> 46) as i16;
        }
        (!gap).then_some(Turned {
            angle,
            activity,
            bias: None,
            accel: 0,
            scale_share: 0,
        })
    }

    fn take_activity(&mut self, gap: bool, level_q8: i32) -> Activity {
        if gap {
            (self.energy, self.samples) = (0, 0);
            return Activity::GAP;
        }
        if self.samples < SHORTEST {
            return Activity::NONE;
        }
        let energy = core::mem::take(&mut self.energy);
        let samples = core::mem::take(&mut self.samples);
        Activity::of_energy(energy, samples, level_q8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a sample of the part, s.
    const PERIOD_S: f64 = 0.0024;
    const PER_PERIOD: i32 = per_period_q32(PERIOD_S);

    fn rate(dps: f64) -> Rate {
        Rate {
            rate: [(dps.to_radians() * 16_777_216.0).round() as i32, 0, 0],
        }
    }

    #[test]
    fn the_sum_is_the_angle_however_often_it_wraps() {
        let mut state = TurnedState::default();
        let mut whole = 0.0;
        for sample in 0..200_000 {
            let dps = 300.0 * (f64::from(sample) * 1e-4).sin() + 40.0;
            state.turn(rate(dps), PER_PERIOD, 1);
            whole += dps * PERIOD_S;
        }
        let angle = state.take(0, 0).unwrap().angle;
        let steps = (whole / 360.0 * 262_144.0).round() as i64 as i16;
        assert!(angle[0].wrapping_sub(steps).abs() <= 8, "{angle:?} {steps}");
        assert_eq!(angle[1..], [0, 0]);
    }

    #[test]
    fn between_two_samples_it_is_on_the_line_of_the_last() {
        let mut state = TurnedState::default();
        for _ in 0..100 {
            state.turn(rate(90.0), PER_PERIOD, 1);
        }
        let [now, before] = [0, 1200].map(|us| state.take(us, 0).unwrap().angle[0]);
        // 90 deg/s for 1.2 ms are 78.6 steps.
        assert!((78..=79).contains(&(now - before)), "{now} {before}");
    }

    #[test]
    fn what_is_missing_gives_no_angle_once() {
        let mut state = TurnedState::default();
        state.turn(rate(1.0), PER_PERIOD, 1);
        assert!(state.take(0, 0).is_some());
        state.interrupt();
        assert_eq!(state.take(0, 0), None);
        assert!(state.take(0, 0).is_some());
    }

    #[test]
    fn a_steady_change_of_the_rate_is_no_activity_and_noise_is() {
        let mut state = TurnedState::default();
        for sample in 0..20 {
            state.turn(rate(f64::from(sample)), PER_PERIOD, 1);
        }
        let quiet = state.take(0, 0).unwrap().activity;
        for sample in 0..20 {
            state.turn(rate(f64::from(sample % 2)), PER_PERIOD, 1);
        }
        let loud = state.take(0, 0).unwrap().activity;
        assert!(loud.0 > quiet.0 + 100, "{quiet:?} {loud:?}");
        assert_eq!(state.take(0, 0).unwrap().activity, Activity::NONE);
    }
}
