//! What the samples between two runs of the filter add up to.
//!
//! In: the frame, the turn and the acceleration of each sample. Out, at the end: the velocity
//! gained, and by how much each error of the gyroscope has tilted the frame meanwhile (its lever).

use super::frame::Frame;
use super::{BLOCK, fit};
use crate::vector::Corrected;

/// By how much an error of one unit tilts the frame about each of its level axes within a block;
/// 2^-27 per step of the ratio of the filter's units (covariance.rs).
pub(super) type Levers = [[i32; 12]; 2];

/// Sums over up to [`BLOCK`] samples.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Block {
    samples: u32,
    /// Acceleration along the level axes, 2^-26 g per step.
    accel: [i64; 2],
    /// The level axes, 2^-30 per step.
    axes: [[i64; 3]; 2],
    /// Component i of each level axis times the turn about axis j, 2^-60 rad per step.
    turns: [[[i64; 3]; 3]; 2],
    /// Square of the turns, 2^-60 rad^2 per step.
    square: i64,
    /// The accelerometer was at its end.
    blind: bool,
}

impl Block {
    /// Samples so far.
    pub(super) const fn samples(&self) -> u32 {
        self.samples
    }

    /// Adds one sample; `turn` below 2^28, and `seen` where the acceleration was within range.
    pub(super) fn add(&mut self, frame: &Frame, turn: [i32; 3], accel: Corrected, seen: bool) {
        for (sum, a) in self.accel.iter_mut().zip(frame.level_part(accel)) {
            *sum += i64::from(a);
        }
        let rows = self.axes.iter_mut().zip(&mut self.turns);
        for ((sums, turns), axis) in rows.zip(frame.level()) {
            for ((sum, row), component) in sums.iter_mut().zip(turns).zip(axis) {
                *sum += i64::from(*component);
                for (cell, t) in row.iter_mut().zip(&turn) {
                    *cell += i64::from(*component) * i64::from(*t);
                }
            }
        }
        let squares = turn.map(|t| i64::from(t) * i64::from(t));
        self.square += squares.iter().sum::<i64>();
        self.blind |= !seen;
        self.samples += 1;
    }

    /// Velocity gained along the level axes, 2^-29 g s per step; `None` where the accelerometer
    /// was at its end. `period_q32` is that of a sample, 2^-32 s.
    pub(super) fn gained(&self, period_q32: u32) -> Option<[i64; 2]> {
        let gain = |sum: i64| (sum * i64::from(period_q32) + (1 << 28)) >> 29;
        (!self.blind).then(|| self.accel.map(gain))
    }

    /// Sum of the squares of the turns, 2^-30 rad^2 per step.
    pub(super) const fn square(&self) -> i64 {
        self.square >> 30
    }

    /// The levers of all twelve errors.
    pub(super) fn levers(&self, period_q32: u32) -> Levers {
        const LARGEST: i32 = 1 << 27;
        let period = i64::from(period_q32);
        let mut levers = [[0; 12]; 2];
        let sums = self.axes.iter().zip(&self.turns);
        for (out, (axis, turns)) in levers.iter_mut().zip(sums) {
            let bias = axis.iter().map(|sum| (sum * period) >> 37);
            let gain = turns.iter().flatten().map(|sum| sum >> 35);
            for (out, lever) in out.iter_mut().zip(bias.chain(gain)) {
                *out = fit(lever).clamp(-LARGEST, LARGEST);
            }
        }
        levers
    }
}

const _: () = assert!(BLOCK <= 16, "sums of more samples do not fit into 64 bits");
