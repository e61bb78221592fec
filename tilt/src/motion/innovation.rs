//! The innovation: what the acceleration has beside the vertical that the rate has predicted.
//!
//! In: the acceleration along the frame's level axes, sample by sample. Out: the same behind a
//! low-pass, as a vector in the housing's axes, with standard deviations. A wrong vertical lets
//! gravity into it: 1 mg is 0.057 deg. What the machine itself accelerates is in it, too, and two
//! channels of one housing have that in common; the difference of their innovations is of errors
//! alone.
//!
//! Left out: judging it. What contradicts for long while gravity is quiet is in `quiet`.

use super::frame::Frame;
use super::{Motion, MotionState, fit};
use crate::chain::Invalid;
use crate::root::root;
use crate::uncertainty::Uncertainty;

/// The low-pass has one pole with a time constant of 2^6 samples: 0.16 s at 400 samples/s.
const SHIFT: u32 = 6;

/// The acceleration beside the predicted vertical, behind a low-pass of 64 samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Innovation {
    /// By acceleration minus predicted by the rate, in the housing's axes, 2^-26 g per step; it is
    /// square to the predicted vertical. For small angles it is the difference of both verticals:
    /// 2^-26 rad per step.
    pub beside: [i32; 3],
    /// Its standard deviation in one direction by this channel alone (k = 1): the uncertainty of
    /// the predicted vertical without what contradicts it, 2^-26 g per step.
    pub own: u32,
    /// The root mean square of the machine's acceleration in one direction lately, 2^-26 g per
    /// step: of the worst 32 samples, held for seconds. Other channels of the housing share it.
    pub shared: u32,
}

/// The acceleration along both level axes behind the low-pass, 2^-26 g per step.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Smoothed([i64; 2]);

impl Smoothed {
    /// Adds one sample.
    #[inline(always)]
    pub(super) fn add(&mut self, level: &[i64; 2]) {
        for (held, level) in self.0.iter_mut().zip(level) {
            *held += (level - *held) >> SHIFT;
        }
    }

    /// As a vector in the housing's axes.
    fn in_housing(&self, frame: &Frame) -> [i32; 3] {
        let mut vector = [0i64; 3];
        for (part, axis) in self.0.iter().zip(frame.level()) {
            for (sum, component) in vector.iter_mut().zip(axis) {
                *sum += (i64::from(fit(*part)) * i64::from(*component)) >> 30;
            }
        }
        vector.map(fit)
    }
}

impl Motion {
    /// The innovation of the newest sample.
    ///
    /// # Errors
    /// Why there is none: [`Invalid::NoSample`] before the vertical is followed, and
    /// [`Invalid::OverRange`] where the gyroscope has left its range since.
    pub fn innovation(&self, state: &MotionState) -> Result<Innovation, Invalid> {
        if !state.running {
            return Err(state.reason(Invalid::NoSample));
        }
        Ok(Innovation {
            beside: state.smoothed.in_housing(&state.frame),
            own: in_radians(state.unshared),
            shared: self.acceleration(state.change),
        })
    }

    /// From a mean square of the velocity gained in a block (2^-45 (g s)^2) to a root mean square
    /// of acceleration, 2^-26 g.
    fn acceleration(&self, change: i64) -> u32 {
        let gained = root(change.unsigned_abs().min(1 << 56) << 7);
        // A block is 32 periods: 2^-15 s per step.
        let block_q15 = u64::from(self.period_q32 >> 12);
        let mean = (u64::from(gained) << 15).checked_div(block_q15);
        mean.and_then(|mean| u32::try_from(mean).ok())
            .unwrap_or(u32::MAX)
    }
}

/// From steps of an angle to 2^-26 rad.
const fn in_radians(uncertainty: Uncertainty) -> u32 {
    // 2 pi / 64 in 2^-16.
    ((uncertainty.0 as u64 * 6434) >> 16) as u32
}
