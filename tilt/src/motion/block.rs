//! What the samples between two runs of the filter add up to.
//!
//! In: the frame, the turn and the acceleration of each sample. Out, at the end: the velocity
//! gained, and by how much each error of the gyroscope has tilted the frame meanwhile (its lever).

use super::BLOCK;
use super::frame::Frame;
use crate::saturate::saturate;
use crate::vector::Corrected;

/// By how much an error of one unit tilts the frame about each of its level axes within a block;
/// 2^-27 per step of the ratio of the filter's units (covariance.rs).
pub(super) type Levers = [[i32; 12]; 2];

/// The levers are taken in every fourth sample: the frame has turned little meanwhile, and a lever
/// off by a few per cent makes the filter hardly worse.
const STRIDE: u32 = 4;

/// Sums over up to [`BLOCK`] samples.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Block {
    samples: u32,
    /// Turn within the last samples, 2^-30 rad per step.
    turn: [i32; 3],
    /// Turn within the whole block, 2^-30 rad per step; cut off at the ends.
    whole: [i32; 3],
    /// Acceleration along the level axes, 2^-26 g per step.
    accel: [i64; 2],
    /// Acceleration along the vertical of every fourth sample, 2^-26 g per step.
    vertical: i64,
    /// The level axes, 2^-27 per step.
    axes: [[i32; 3]; 2],
    /// Component i of each level axis times the turn about axis j, 2^-27 rad per step.
    turns: [[[i32; 3]; 3]; 2],
    /// Square of the turns, 2^-58 rad^2 per step.
    square: i64,
    /// The accelerometer was at its end.
    blind: bool,
}

/// What a block shows of rest and of gravity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shown {
    /// Turn about each axis of the housing, 2^-30 rad per step.
    pub(super) turned: [i32; 3],
    /// Square of the mean acceleration, 2^-52 g^2 per step.
    pub(super) length_square: u64,
}

impl Block {
    /// Samples so far.
    pub(super) const fn samples(&self) -> u32 {
        self.samples
    }

    /// Adds one sample; `turn` below 2^28, and `seen` where the acceleration was within range.
    pub(super) fn add(&mut self, frame: &Frame, turn: [i32; 3], accel: Corrected, seen: bool) {
        // Axis by axis: a loop takes three times as long.
        let [along_x, along_y] = frame.level_part(accel);
        let [accel_x, accel_y] = &mut self.accel;
        *accel_x += along_x;
        *accel_y += along_y;
        let ([x, y, z], [turn_x, turn_y, turn_z]) = (turn, &mut self.turn);
        *turn_x = turn_x.wrapping_add(x);
        *turn_y = turn_y.wrapping_add(y);
        *turn_z = turn_z.wrapping_add(z);
        self.blind |= !seen;
        self.samples += 1;
        if self.samples.is_multiple_of(STRIDE) {
            self.vertical += frame.up_part(accel);
            self.take_levers(frame);
        }
    }

    /// Adds what the axes are, and what the last samples have turned.
    fn take_levers(&mut self, frame: &Frame) {
        let turn = core::mem::take(&mut self.turn);
        for (sum, t) in self.whole.iter_mut().zip(&turn) {
            *sum = sum.saturating_add(*t);
            // Of each sample, as if they were alike.
            self.square += i64::from(t >> 2) * i64::from(t >> 2);
        }
        let rows = self.axes.iter_mut().zip(&mut self.turns);
        for ((sums, turns), axis) in rows.zip(frame.level()) {
            for ((sum, row), component) in sums.iter_mut().zip(turns).zip(axis) {
                *sum = sum.wrapping_add(component >> 3);
                for (cell, t) in row.iter_mut().zip(&turn) {
                    *cell = cell.wrapping_add(upper(*component >> 1, *t));
                }
            }
        }
    }

    /// Velocity gained along the level axes, 2^-30 g s per step; `None` where the accelerometer
    /// was at its end. `period_q32` is that of a sample, 2^-32 s.
    pub(super) fn gained(&self, period_q32: u32) -> Option<[i32; 2]> {
        // Half of the period, which then fits a signed number.
        let half = (period_q32 >> 1) as i32;
        let gain = |sum: i64| saturate((i64::from(saturate(sum >> 6)) * i64::from(half)) >> 21);
        (!self.blind).then(|| self.accel.map(gain))
    }

    /// What rest and gravity show in.
    pub(super) fn shown(&self) -> Shown {
        let [x, y] = self.accel.map(|sum| saturate(sum / i64::from(BLOCK)));
        let z = saturate(self.vertical / i64::from(BLOCK / STRIDE));
        let square = |a: i32| (i64::from(a) * i64::from(a)).unsigned_abs();
        Shown {
            turned: self.whole,
            length_square: square(x) + square(y) + square(z),
        }
    }

    /// Sum of the squares of the turns, 2^-30 rad^2 per step.
    pub(super) const fn square(&self) -> i64 {
        self.square >> 28
    }

    /// The levers of all twelve errors.
    pub(super) fn levers(&self, period_q32: u32) -> Levers {
        const LARGEST: i32 = 1 << 27;
        let mut levers = [[0; 12]; 2];
        let sums = self.axes.iter().zip(&self.turns);
        for (out, (axis, turns)) in levers.iter_mut().zip(sums) {
            // Four samples for each axis, and four units of an error in one of tilt.
            let bias = axis.iter().map(|sum| upper(*sum, period_q32 as i32));
            let gain = turns.iter().flatten().map(|sum| sum >> 2);
            for (out, lever) in out.iter_mut().zip(bias.chain(gain)) {
                *out = lever.clamp(-LARGEST, LARGEST);
            }
        }
        levers
    }
}

/// The upper half of a product, rounded down.
#[inline(always)]
const fn upper(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

const _: () = assert!(
    BLOCK <= 32 && BLOCK.is_multiple_of(STRIDE),
    "sums of more samples do not fit, and the levers of others are left out"
);
