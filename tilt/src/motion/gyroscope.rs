//! The gyroscope's own errors: bias, scale and alignment, as far as they are known.
//!
//! In: a measured [`Rate`], and corrections of what is known. Out: the angle by which the housing
//! turned within a sample, 2^-30 rad per step. Bias in 2^-32 rad/s, scale and alignment in 2^-32
//! per step, so that they stay below half a rad/s and a half.

use super::Rate;

/// The largest angle of one sample, a quarter of a radian.
const LARGEST: i64 = 1 << 28;

/// Bias of each axis, and what each axis (row) wrongly adds of each true rate (column).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Gyroscope {
    /// Of a sample, 2^-32 s per step.
    period_q32: u32,
    bias: [i32; 3],
    gain: [[i32; 3]; 3],
    /// From rates to angles, 2^-36 s per step; and the bias as an angle, 2^-60 rad per step.
    matrix: [[i32; 3]; 3],
    offset: [i64; 3],
}

/// Changes of [`Gyroscope`]: three of the bias, then nine of scale and alignment, row by row.
pub(super) type Errors = [i32; 12];

impl Gyroscope {
    /// Forgets all errors; the period is up to 0.01 s.
    pub(super) fn forget(&mut self, period_q32: u32) {
        self.period_q32 = period_q32;
        self.bias = [0; 3];
        self.gain = [[0; 3]; 3];
        self.refresh();
    }

    /// The angle of one sample without the errors; `None` above a quarter of a radian.
    pub(super) fn angle(&self, rate: Rate) -> Option<[i32; 3]> {
        let [x, y, z] = rate.rate;
        let mut angle = [0; 3];
        let rows = self.matrix.iter().zip(&self.offset);
        for (angle, (row, offset)) in angle.iter_mut().zip(rows) {
            let [a, b, c] = *row;
            let product = |a: i32, r: i32| i64::from(a) * i64::from(r);
            let sum = product(a, x) + product(b, y) + product(c, z);
            let turned = (sum - offset) >> 30;
            if turned.abs() >= LARGEST {
                return None;
            }
            *angle = turned as i32;
        }
        Some(angle)
    }

    /// Takes corrections in the unit of the filter's states, 2^-35 per step; scale and alignment
    /// stay within `most_gain`.
    pub(super) fn add(&mut self, errors: &Errors, most_gain: i32) {
        let own = self.bias.iter_mut().chain(self.gain.iter_mut().flatten());
        for (value, error) in own.zip(errors) {
            *value = value.saturating_add((error >> 3) + ((error >> 2) & 1));
        }
        for gain in self.gain.iter_mut().flatten() {
            *gain = (*gain).max(-most_gain).min(most_gain);
        }
        self.refresh();
    }

    /// The bias, 2^-32 rad/s per step.
    pub(super) const fn bias(&self) -> [i32; 3] {
        self.bias
    }

    /// What follows from errors and period: (1 - gain) times the period, and that times the bias.
    fn refresh(&mut self) {
        let period = i64::from(self.period_q32);
        let [bx, by, bz] = self.bias.map(i64::from);
        for (row, gains) in self.matrix.iter_mut().zip(&self.gain) {
            *row = gains.map(|gain| ((i64::from(gain) * -period) >> 28) as i32);
        }
        let [[a, _, _], [_, b, _], [_, _, c]] = &mut self.matrix;
        for diagonal in [a, b, c] {
            *diagonal += (period << 4) as i32;
        }
        for (offset, [a, b, c]) in self.offset.iter_mut().zip(self.matrix) {
            // Half a step of an angle belongs to it, which then rounds.
            let angle = i64::from(a) * bx + i64::from(b) * by + i64::from(c) * bz;
            *offset = (angle >> 8) - (1 << 29);
        }
    }
}
