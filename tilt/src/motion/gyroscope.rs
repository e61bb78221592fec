//! The gyroscope's own errors: bias, scale and alignment, as far as they are known.
//!
//! In: a measured [`Rate`], and corrections of what is known. Out: the rate without the errors,
//! 2^-24 rad/s per step. Bias in 2^-32 rad/s, scale and alignment in 2^-32 per step, so that they
//! stay below half a rad/s and a half.

use super::{Rate, fit};

/// Bias of each axis, and what each axis (row) wrongly adds of each true rate (column).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Gyroscope {
    bias: [i32; 3],
    gain: [[i32; 3]; 3],
}

/// Changes of [`Gyroscope`]: three of the bias, then nine of scale and alignment, row by row.
pub(super) type Errors = [i32; 12];

impl Gyroscope {
    /// The rate without the errors; 2^-24 rad/s per step, cut off at the ends.
    pub(super) fn correct(&self, rate: Rate) -> [i32; 3] {
        let [x, y, z] = rate.rate;
        let [bx, by, bz] = self.bias.map(|b| (b >> 8) + ((b >> 7) & 1));
        let free = [
            x.saturating_sub(bx),
            y.saturating_sub(by),
            z.saturating_sub(bz),
        ];
        let mut out = free;
        for (out, row) in out.iter_mut().zip(&self.gain) {
            let terms = row.iter().zip(&free);
            let wrong: i64 = terms.map(|(g, r)| i64::from(*g) * i64::from(*r)).sum();
            *out = fit(i64::from(*out) - ((wrong + (1 << 31)) >> 32));
        }
        out
    }

    /// Takes corrections in the unit of the filter's states, 2^-35 per step.
    pub(super) fn add(&mut self, errors: &Errors) {
        let own = self.bias.iter_mut().chain(self.gain.iter_mut().flatten());
        for (value, error) in own.zip(errors) {
            *value = value.saturating_add((error >> 3) + ((error >> 2) & 1));
        }
    }

    /// The bias, 2^-32 rad/s per step.
    pub(super) const fn bias(&self) -> [i32; 3] {
        self.bias
    }
}
