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
//! velocity. A machine comes back to where it was: the velocity is zero in the mean, with a spread
//! that is measured, while gravity in a tilted frame would make it grow without end. So a Kalman
//! filter compares the velocity with zero and divides what it sees among its sixteen states:
//! velocity and tilt of two axes each, the gyroscope's bias, and its nine errors of scale and
//! alignment. How fast the vertical follows the acceleration is nobody's choice: the filter
//! follows it quickly after fast turns, when the gyroscope's errors have added up, and slowly
//! while the machine accelerates much.
//!
//! The rate turns the frame with every sample, the filter runs once in [`BLOCK`] samples. What it
//! knows of the motion between is what the samples add up to, so nothing is lost by that.
//!
//! # Uncertainty
//! It is the filter's own, and the accelerometer's offset beside it, which gravity cannot show.
//! It grows with every turn and while the velocity is large, and shrinks when the machine is
//! quiet. It is that of the vertical in one direction, so of one slope.
//!
//! Left out: samples that are missing (who knows of a gap starts anew), heading, and
//! accelerations that last for longer than the machine's motion usually does, like the long curve
//! of a road vehicle: they look like tilt to any sensor without a speed of its own.

mod block;
mod covariance;
mod frame;
mod gyroscope;
#[cfg(test)]
mod reference;
mod settings;
#[cfg(test)]
mod tests;

pub use settings::{Expected, Motion};

use crate::chain::Invalid;
use crate::root::root;
use crate::uncertainty::Uncertainty;
use crate::vector::Corrected;
use block::Block;
use covariance::{Covariance, Observation};
use frame::Frame;
use gyroscope::Gyroscope;

/// Samples from one run of the filter to the next: 40 ms at 400 samples/s.
pub const BLOCK: u32 = 16;

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
    /// A vector of length one, 2^-30 per step; its length is right to 5e-5 up to 2 000 deg/s at 400
    /// samples/s.
    pub up: [i32; 3],
    /// Its standard uncertainty (k = 1) in any one direction.
    pub uncertainty: Uncertainty,
}

/// What the estimator remembers; [`MotionState::default`] has seen nothing yet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MotionState {
    /// `None` until the first block has shown where up is.
    tracking: Option<Tracking>,
    /// The block that shows where up is.
    start: Start,
    /// The frame follows the housing.
    running: bool,
    /// The gyroscope was over its range, and the vertical has not been found again since.
    lost: bool,
}

/// The acceleration of the first block, in the housing's axes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Start {
    accel: [i64; 3],
    samples: u32,
}

/// All that is estimated.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Tracking {
    frame: Frame,
    gyroscope: Gyroscope,
    /// Velocity along the frame's two level axes, 2^-29 g s per step.
    velocity: [i32; 2],
    /// Mean square of the velocity along one axis, held for a while; 2^-31 of (4 g s)^2.
    speed: i64,
    covariance: Covariance,
    block: Block,
    uncertainty: Uncertainty,
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
        let in_range = rate.rate.iter().all(|r| r.unsigned_abs() < self.rate_range);
        let tracking = match &mut state.tracking {
            Some(tracking) if state.running && in_range => tracking,
            _ => return Err(self.find_up(state, accel, in_range)),
        };
        let Some(turn) = self.angle(tracking.gyroscope.correct(rate)) else {
            return Err(self.find_up(state, accel, false));
        };
        tracking.frame.turn(turn);
        let measurable = |a: &i32| a.unsigned_abs() < self.accel_range;
        let seen = accel.accel.iter().all(measurable);
        tracking.block.add(&tracking.frame, turn, accel, seen);
        if tracking.block.samples() >= BLOCK {
            self.filter(tracking);
            state.lost &= tracking.uncertainty > self.limit;
        }
        let vertical = self.vertical(tracking, turn);
        vertical
            .filter(|_| !state.lost)
            .ok_or(state.reason(Invalid::Settling))
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
        let before = state.tracking.take();
        let (gyroscope, mut covariance) = before.map_or_else(
            || (Gyroscope::default(), Covariance::new(self.priors())),
            |before| (before.gyroscope, before.covariance),
        );
        covariance.forget_motion(self.priors());
        state.tracking = Some(Tracking {
            frame,
            gyroscope,
            velocity: [0; 2],
            speed: self.velocity_floor,
            block: Block::default(),
            uncertainty: self.uncertainty(covariance.tilt()),
            covariance,
        });
        state.running = true;
    }

    /// A rate (2^-24 rad/s) as the angle of one period (2^-30 rad), up to a quarter of a radian.
    fn angle(&self, rate: [i32; 3]) -> Option<[i32; 3]> {
        let period = i64::from(self.period_q32);
        let angle = rate.map(|r| (i64::from(r) * period + (1 << 25)) >> 26);
        let fits = angle.iter().all(|a| a.abs() < 1 << 28);
        fits.then(|| angle.map(|a| a as i32))
    }

    /// One run of the filter at the end of a block.
    fn filter(&self, tracking: &mut Tracking) {
        let block = core::mem::take(&mut tracking.block);
        let levers = block.levers(self.period_q32);
        let covariance = &mut tracking.covariance;
        covariance.propagate(&levers, (self.period_q32 >> 2) as i32);
        covariance.spread(self.noise(block.square()), self.priors());
        let Some(gained) = block.gained(self.period_q32) else {
            // An accelerometer at its end says nothing of the velocity.
            covariance.forget_velocity();
            tracking.velocity = [0; 2];
            tracking.uncertainty = self.uncertainty(covariance.tilt());
            return;
        };
        for (v, gained) in tracking.velocity.iter_mut().zip(gained) {
            *v = fit(i64::from(*v) + gained);
        }
        let noise = self.zero_velocity_noise(tracking);
        let mut observation = Observation::new(tracking.velocity, noise);
        tracking.covariance.observe(&mut observation);
        tracking.frame.tilt(observation.tilt());
        tracking.gyroscope.add(observation.errors());
        tracking.velocity = observation.velocity();
        tracking.uncertainty = self.uncertainty(tracking.covariance.tilt());
    }

    /// Variance of "the velocity is zero" for one block, from the spread that was seen lately.
    fn zero_velocity_noise(&self, tracking: &mut Tracking) -> i64 {
        let square = |v: i32| i64::from(v) * i64::from(v);
        let [x, y] = tracking.velocity;
        let now = ((square(x) >> 1) + (square(y) >> 1)) >> 31;
        let held = tracking.speed - ((tracking.speed * i64::from(self.decay_q31)) >> 31);
        tracking.speed = held.max(now).max(self.velocity_floor);
        let noise = (tracking.speed * i64::from(self.weight_q16)) >> 16;
        noise.clamp(1 << 16, 1 << 37)
    }

    /// From a variance of tilt (2^-31 of (2^-2 rad)^2) to a standard uncertainty.
    fn uncertainty(&self, tilt: i32) -> Uncertainty {
        let variance = i64::from(tilt.max(0)) + i64::from(self.accel_variance);
        let root = root(variance.unsigned_abs().min(u64::from(u32::MAX)) << 32);
        // The unit's root, 2^-17.5 rad, is 3687.5 steps of an angle; the root has 16 bits more.
        Uncertainty(((u64::from(root) * 3687 + u64::from(root >> 1)) >> 16) as u32)
    }

    /// The vertical now, ahead of the frame by what the gyroscope is late; `None` where it is less
    /// known than the limit asks for.
    fn vertical(&self, tracking: &Tracking, turn: [i32; 3]) -> Option<Vertical> {
        let delay = i64::from(self.delay_q16);
        let ahead = turn.map(|a| fit((i64::from(a) * delay) >> 16).clamp(-(1 << 28), 1 << 28));
        (tracking.uncertainty <= self.limit).then(|| Vertical {
            up: tracking.frame.up_after(ahead),
            uncertainty: tracking.uncertainty,
        })
    }
}

impl MotionState {
    /// Starts anew, as after a gap, and keeps what is known of the gyroscope.
    pub fn restart(&mut self) {
        self.start = Start::default();
        self.running = false;
    }

    /// The gyroscope's bias as estimated, 2^-32 rad/s per step; `None` before the start.
    pub fn bias(&self) -> Option<[i32; 3]> {
        self.tracking.as_ref().map(|t| t.gyroscope.bias())
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
        let mean = self.accel.map(|sum| fit(sum / i64::from(BLOCK)));
        *self = Self::default();
        Frame::upright(mean)
    }
}

/// Cut off at the ends of 32 bits.
const fn fit(value: i64) -> i32 {
    if value > i32::MAX as i64 {
        i32::MAX
    } else if value < i32::MIN as i64 {
        i32::MIN
    } else {
        value as i32
    }
}

/// `a` times `b` without `bits` of the product, rounded.
#[inline(always)]
const fn product(a: i32, b: i32, bits: u32) -> i64 {
    (a as i64 * b as i64 + (1 << (bits - 1))) >> bits
}
