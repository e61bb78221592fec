//! The vertical while the machine moves, from a gyroscope and an accelerometer.
//!
//! In, sample by sample: [`Rate`] and [`Corrected`] acceleration, both in the housing's axes. Out:
//! the [`Vertical`] at this moment in the housing's axes with its standard uncertainty, or the
//! reason why it is not known.
//!
//! # How
//! The rate turns a frame whose third axis is the vertical; the direction of the other two drifts
//! freely and does not matter. In that frame the acceleration beside the vertical is the
//! machine's own, and whatever part of gravity a wrong vertical lets in. Its integral is a
//! velocity. A machine comes back to where it was: its velocity is zero in the mean, while gravity
//! in a tilted frame would make it grow without end. So a Kalman filter compares the velocity with
//! zero and divides what it sees among its sixteen states: velocity and tilt of two axes each, the
//! gyroscope's bias, and its nine errors of scale and alignment.
//!
//! How far the velocity may be from zero is measured: the largest lately, for as long as it takes
//! the acceleration to turn it round. At rest, which hardly a turn and a steady acceleration show,
//! it is a centimetre per second. So how fast the vertical follows the acceleration is nobody's
//! choice: quickly at rest and after fast turns, when the gyroscope's errors have added up, and
//! slowly while the machine accelerates much.
//!
//! The rate turns the frame with every sample, the filter runs once in [`BLOCK`] samples. What it
//! knows of the motion between is what the samples add up to.
//!
//! # Uncertainty
//! It is the filter's own, and the accelerometer's offset beside it, which gravity cannot show.
//! It grows with every turn, with the gyroscope's temperature and while the velocity is large, and
//! shrinks when the machine is quiet. It is that of the vertical in one direction, so of one slope.
//!
//! Quiet gravity beside the vertical is in it as soon as it is seen; where it stays there, the
//! vertical is found anew (module `quiet`). So it is where the velocity is more than a machine's.
//!
//! Left out: samples that are missing (who knows of a gap starts anew), heading, and
//! accelerations that last for longer than the machine's motion usually does, like the long curve
//! of a road vehicle: they look like tilt to any sensor without a speed of its own, and the
//! uncertainty does not contain them.

mod block;
#[cfg(test)]
mod contradiction_tests;
mod covariance;
pub(crate) mod frame;
mod gyroscope;
mod quiet;
#[cfg(test)]
mod reference;
mod settings;
#[cfg(test)]
mod tests;

pub use settings::{Expected, Motion};

use crate::chain::Invalid;
use crate::root::root;
use crate::sample::Temperature;
use crate::saturate::saturate;
use crate::temperature::from_reference;
use crate::uncertainty::Uncertainty;
use crate::vector::Corrected;
use block::Block;
use covariance::{Covariance, Observation};
use frame::Frame;
use gyroscope::Gyroscope;
use quiet::Quiet;

/// Samples from one run of the filter to the next: 80 ms at 400 samples/s.
pub const BLOCK: u32 = 32;

/// Change of temperature that counts, 2^-8 degC: 2 degC.
const LEAST_WARMED: u32 = 2 * 256;

/// Rate of turn in the housing's axes, 2^-24 rad/s per step: +-7 334 deg/s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rate {
    /// About the housing's x, y and z axes, right-handed.
    pub rate: [i32; 3],
}

/// Steps of [`Rate`] in one rad/s.
pub const RATE_STEPS: f64 = 16_777_216.0;

/// The direction that points up, in the housing's axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vertical {
    /// A vector of length one, 2^-30 per step; its length is right to 1e-4 up to 2 000 deg/s at 400
    /// samples/s.
    pub up: [i32; 3],
    /// Its standard uncertainty (k = 1) in any one direction.
    pub uncertainty: Uncertainty,
    /// The part of it that another channel of the housing does not share: all but quiet gravity
    /// beside the vertical, which the other one has, too, where the machine gains speed.
    pub unshared: Uncertainty,
}

/// What the estimator remembers; [`MotionState::default`] has seen nothing yet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MotionState {
    /// The block that shows where up is.
    start: Start,
    /// The frame follows the housing.
    running: bool,
    /// Something is known of the gyroscope.
    learned: bool,
    /// The gyroscope was over its range, and the vertical has not been found again since.
    lost: bool,
    frame: Frame,
    gyroscope: Gyroscope,
    /// Velocity along the frame's two level axes, 2^-30 g s per step.
    velocity: [i32; 2],
    /// Mean square of the velocity along one axis that was seen, held for a while; 2^-31 of
    /// (2 g s)^2.
    seen: i64,
    /// The same that was expected at the start, until a rest before which hardly any was seen.
    expected: i64,
    /// The same of the velocity gained in a block; 2^-47 of (2 g s)^2.
    change: i64,
    quiet: Quiet,
    /// How far the gyroscope's temperature is from 25 degC, as its scale takes account of it;
    /// 2^-8 degC.
    warmed: i32,
    covariance: Covariance,
    block: Block,
    /// How far corrections have moved the vertical, see [`MotionState::take_corrected`].
    corrected: [i32; 3],
    /// With what contradicts, and without it.
    uncertainty: Uncertainty,
    unshared: Uncertainty,
}

/// The acceleration of the first block, in the housing's axes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Start {
    accel: [i64; 3],
    samples: u32,
}

impl Motion {
    /// Takes one sample: what the housing's axes turn by, and what accelerates them.
    ///
    /// Fails with [`Invalid::NoSample`] before the first block is full, with
    /// [`Invalid::OverRange`] from where the gyroscope leaves its range until the vertical is
    /// known again, and with [`Invalid::Settling`] where its uncertainty is above the limit.
    pub fn step(
        &self,
        state: &mut MotionState,
        rate: Rate,
        accel: Corrected,
    ) -> Result<Vertical, Invalid> {
        let in_range = self.reaches(rate);
        if !(state.running && in_range) {
            return Err(self.find_up(state, accel, in_range));
        }
        let Some(turn) = state.gyroscope.angle(rate) else {
            return Err(self.find_up(state, accel, false));
        };
        state.frame.turn(turn);
        let measurable = |a: i32| a.unsigned_abs() < self.accel_range;
        // Axis by axis, here and below: a loop takes three times as long.
        let [x, y, z] = accel.accel;
        let seen = measurable(x) && measurable(y) && measurable(z);
        state.block.add(&state.frame, turn, accel, seen);
        if state.block.samples() >= BLOCK {
            let before = state.frame.up();
            self.filter(state);
            let moved = state.frame.up().into_iter().zip(before);
            for (sum, (now, before)) in state.corrected.iter_mut().zip(moved) {
                *sum = sum.wrapping_add(now.wrapping_sub(before));
            }
            state.lost &= state.uncertainty > self.limit;
        }
        if state.lost || state.uncertainty > self.limit {
            return Err(state.reason(Invalid::Settling));
        }
        Ok(Vertical {
            up: self.up(&state.frame, turn),
            uncertainty: state.uncertainty,
            unshared: state.unshared,
        })
    }

    /// True where the gyroscope is within its range on every axis.
    pub fn reaches(&self, rate: Rate) -> bool {
        let within = |r: i32| r.unsigned_abs() < self.rate_range;
        let [x, y, z] = rate.rate;
        within(x) && within(y) && within(z)
    }

    /// A sample without a frame: adds it to the first block, and gives the reason. What cannot be
    /// followed begins a new block.
    fn find_up(&self, state: &mut MotionState, accel: Corrected, in_range: bool) -> Invalid {
        if in_range {
            if let Some(frame) = state.start.add(accel) {
                self.start(state, frame);
            }
        } else {
            state.restart();
            state.lost = true;
        }
        state.reason(Invalid::NoSample)
    }

    /// Begins to follow the housing; what is known of the gyroscope already is kept.
    fn start(&self, state: &mut MotionState, frame: Frame) {
        if state.learned {
            state.covariance.forget_motion(self.priors(state.warmed));
        } else {
            state.gyroscope.forget(self.period_q32);
            state.covariance.forget(self.priors(state.warmed));
        }
        (state.running, state.learned) = (true, true);
        state.frame = frame;
        state.velocity = [0; 2];
        (state.seen, state.expected) = (0, self.start_speed);
        state.change = 0;
        state.quiet = Quiet::default();
        state.block = Block::default();
        self.state_uncertainty(state);
    }

    /// One run of the filter at the end of a block.
    fn filter(&self, state: &mut MotionState) {
        let levers = state.block.levers(self.period_q32);
        let gained = state.block.gained(self.period_q32);
        let (square, shown) = (state.block.square(), state.block.shown());
        state.block = Block::default();
        // A block, in units of tilt by units of velocity: four periods.
        let fall = self.period_q32 as i32;
        state.covariance.propagate(&levers, fall);
        let priors = self.priors(state.warmed);
        state.covariance.spread(self.noise(square), priors);
        match gained {
            Some(gained) => {
                self.look_for_rest(state, shown, gained);
                self.observe(state, gained);
            }
            None => {
                state.quiet = Quiet::default();
                // An accelerometer at its end says nothing of the velocity.
                state.covariance.forget_velocity(1 << 29);
                state.velocity = [0; 2];
            }
        }
        self.state_uncertainty(state);
        if self.refuted(state) {
            self.begin_again(state);
        }
    }

    /// The vertical is wrong: finds it anew. What was found of the gyroscope is kept, but is less
    /// certain than at first, since it may be what was wrong.
    fn begin_again(&self, state: &mut MotionState) {
        state.restart();
        if !self.is_vague(state) {
            state.covariance.forget(self.doubted(state.warmed));
        }
        state.uncertainty = Uncertainty(u32::MAX);
    }

    /// The gyroscope has this temperature from now on.
    ///
    /// Its scale changes with that by what no calibration has, and is less known from then on.
    pub fn temperature(&self, state: &mut MotionState, temperature: Temperature) {
        let warmed = from_reference(temperature) as i32;
        // Less is the thermometer's noise, and would add up.
        if warmed.abs_diff(state.warmed) < LEAST_WARMED {
            return;
        }
        if state.learned {
            state.covariance.warm(self.of_warmth(state.warmed, warmed));
        }
        state.warmed = warmed;
    }

    /// Compares the velocity, which has `gained` so much, with zero, and corrects all states.
    fn observe(&self, state: &mut MotionState, gained: [i32; 2]) {
        for (v, gained) in state.velocity.iter_mut().zip(gained) {
            *v = v.saturating_add(gained);
        }
        let noise = self.zero_velocity_noise(state, gained);
        let mut observation = Observation::new(state.velocity, noise);
        state.covariance.observe(&mut observation);
        let [x, y] = observation.tilt();
        state.frame.tilt([x, y]);
        let fall = self.period_q32 as i32;
        let errors = observation.errors();
        // A block of the same rate turns by a corrected bias less: 2^-35 rad/s, 32 samples.
        let [a, b, c, ..] = *errors;
        let less = |error: i32| -product(error, fall, 32);
        let [gained_x, gained_y] = [product(y, fall, 27), -product(x, fall, 27)];
        let more = [gained_x, gained_y, less(a), less(b), less(c)].map(saturate);
        state.quiet.corrected(&more);
        state.gyroscope.add(errors, self.most_gain(state.warmed));
        state.velocity = observation.velocity();
    }

    /// Variance of "the velocity is zero" for one block, from what was seen lately.
    ///
    /// It is that of a velocity that keeps its direction for a while, which is about the velocity
    /// by the acceleration; the longer, the fewer of the blocks tell something new.
    fn zero_velocity_noise(&self, state: &mut MotionState, gained: [i32; 2]) -> i64 {
        let fade = |held: i64| held - ((held >> 16) * i64::from(self.decay_q16));
        let change = (mean_square(gained) >> 15).max(fade(state.change));
        let seen = fade(state.seen << 16) >> 16;
        let speed = if state.quiet.at_rest() {
            // What was seen may come again. What was expected at the start has not come where
            // hardly any was seen before this rest, of a vertical that has been found: with one
            // that is off by more than half a degree a velocity may have passed for tilt.
            state.seen = seen;
            if seen <= self.least_speed && state.covariance.tilt() < self.found {
                state.expected = 0;
            }
            // Whatever velocity is left has come from a wrong vertical.
            i64::from(self.rest_variance)
        } else {
            let seen = seen.max(mean_square(state.velocity) >> 31);
            state.seen = seen;
            seen.max(state.expected).max(self.least_speed)
        };
        state.change = change;
        // Blocks for which it keeps its direction, 2^-8.
        let ratio = speed.unsigned_abs().min(u64::from(u32::MAX)) << 32;
        let blocks = ratio.checked_div(change.max(1).unsigned_abs());
        let blocks = i64::from(root(blocks.unwrap_or(0)));
        // A clamp of two variables could panic.
        let weight = (2 * blocks).min(self.most_weight_q8);
        let weight = weight.max(self.least_weight_q8);
        let noise = (speed * weight) >> 8;
        noise.clamp(1 << 8, 1 << 37)
    }

    /// Brings both uncertainties up to date.
    fn state_uncertainty(&self, state: &mut MotionState) {
        state.unshared = self.deviation(state, 0);
        state.uncertainty = match Self::contradiction(state) {
            0 => state.unshared,
            beside => self.deviation(state, beside),
        };
    }

    /// The standard uncertainty of tilt (2^-31 of (2^-2 rad)^2) and accelerometer, and of a
    /// variance more.
    fn deviation(&self, state: &MotionState, more: i64) -> Uncertainty {
        let tilt = i64::from(state.covariance.tilt().max(0));
        let variance = tilt + i64::from(self.accel_variance) + more;
        let root = root(variance.unsigned_abs().min(u64::from(u32::MAX)) << 32);
        // The unit's root, 2^-17.5 rad, is 3687.5 steps of an angle; the root has 16 bits more.
        Uncertainty(((u64::from(root) * 3687 + u64::from(root >> 1)) >> 16) as u32)
    }

    /// The vertical now, ahead of the frame by what the gyroscope is late.
    fn up(&self, frame: &Frame, turn: [i32; 3]) -> [i32; 3] {
        if self.delay_q16 == 0 {
            return frame.up();
        }
        let delay = i64::from(self.delay_q16);
        let ahead = turn.map(|a| (i64::from(a) * delay) >> 16);
        frame.up_after(ahead.map(|a| a.clamp(-(1 << 28), 1 << 28) as i32))
    }
}

impl MotionState {
    /// Starts anew, as after a gap, and keeps what is known of the gyroscope.
    pub fn restart(&mut self) {
        self.start = Start::default();
        self.running = false;
    }

    /// Starts anew as at first: what was found of the gyroscope has come from a sensor that
    /// measures wrongly.
    pub fn forget(&mut self) {
        self.restart();
        self.learned = false;
        self.lost = false;
    }

    /// How far corrections have moved the vertical since this was last asked for, in the housing's
    /// axes, 2^-30 per step. A vertical from before is moved by it: what is between the two is then
    /// what the housing has turned.
    pub fn take_corrected(&mut self) -> [i32; 3] {
        core::mem::take(&mut self.corrected)
    }

    /// The gyroscope's bias as estimated, 2^-32 rad/s per step; `None` before the start.
    pub fn bias(&self) -> Option<[i32; 3]> {
        self.learned.then(|| self.gyroscope.bias())
    }

    /// Why there is no vertical: the lost one, or `otherwise`.
    const fn reason(&self, otherwise: Invalid) -> Invalid {
        if self.lost {
            Invalid::OverRange
        } else {
            otherwise
        }
    }
}

impl Start {
    /// Adds one sample; a full block shows where up is, unless there was no gravity in it.
    fn add(&mut self, accel: Corrected) -> Option<Frame> {
        for (sum, a) in self.accel.iter_mut().zip(accel.accel) {
            *sum += i64::from(a);
        }
        self.samples += 1;
        if self.samples < BLOCK {
            return None;
        }
        let mean = self.accel.map(|sum| saturate(sum / i64::from(BLOCK)));
        *self = Self::default();
        Frame::upright(mean)
    }
}

/// Mean of two squares.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn mean_square([x, y]: [i32; 2]) -> i64 {
    let square = |v: i32| i64::from(v) * i64::from(v);
    (square(x) >> 1) + (square(y) >> 1)
}

/// `a` times `b` without `bits` of the product, rounded.
#[inline(always)]
const fn product(a: i32, b: i32, bits: u32) -> i64 {
    (a as i64 * b as i64 + (1 << (bits - 1))) >> bits
}
