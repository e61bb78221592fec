//! A frame that does not turn with the housing: two level axes and the vertical.
//!
//! In: the angle by which the housing turned within a sample, 2^-30 rad per step, and small
//! corrections of the tilt. Out: the three axes, each a vector in the housing's axes, 2^-30 per
//! step. The third power of the angle is the last that counts: at a quarter of a radian a sample
//! the fourth would be 1.6e-4.

use super::{fit, product};
use crate::root::root;
use crate::vector::Corrected;

/// One, as a component of an axis.
const ONE: i32 = 1 << 30;

/// The two level axes and the vertical, in the housing's axes; 2^-30 per step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Frame {
    level: [[i32; 3]; 2],
    up: [i32; 3],
}

impl Frame {
    /// The frame whose vertical points along `accel`; `None` below half a g, which is no gravity.
    pub(super) fn upright(accel: [i32; 3]) -> Option<Self> {
        // A quarter of the scale, so that three squares fit.
        let quarter = accel.map(|a| a >> 2);
        let square = |a: i32| (i64::from(a) * i64::from(a)).unsigned_abs();
        let length = root(quarter.iter().map(|a| square(*a)).sum());
        if length < 1 << 23 {
            return None;
        }
        let part = |a: i32| {
            let whole = (i64::from(a) << 30).checked_div(i64::from(length));
            fit(whole.unwrap_or(0)).clamp(-ONE, ONE)
        };
        let mut frame = Self {
            level: [[0; 3]; 2],
            up: quarter.map(part),
        };
        // Any axis that is not along the vertical does; this one is beside it by half at least.
        let [x, _, z] = frame.up;
        let beside = if x.unsigned_abs() < ONE.unsigned_abs() / 2 {
            [ONE, 0, 0]
        } else if z.unsigned_abs() < ONE.unsigned_abs() / 2 {
            [0, 0, ONE]
        } else {
            [0, ONE, 0]
        };
        frame.level[0] = beside;
        for _ in 0..8 {
            frame.square_up();
        }
        Some(frame)
    }

    /// Turns the housing by `angle`; the frame stays.
    pub(super) fn turn(&mut self, angle: [i32; 3]) {
        let [first, second] = &mut self.level;
        *first = turned(*first, angle);
        self.up = turned(self.up, angle);
        *second = cross(self.up, *first);
    }

    /// The vertical after the housing has turned by `angle` more.
    pub(super) fn up_after(&self, angle: [i32; 3]) -> [i32; 3] {
        turned(self.up, angle)
    }

    /// What of an acceleration lies along the two level axes, in its unit.
    pub(super) fn level_part(&self, accel: Corrected) -> [i32; 2] {
        self.level.map(|axis| dot(axis, accel.accel))
    }

    /// The two level axes.
    pub(super) const fn level(&self) -> &[[i32; 3]; 2] {
        &self.level
    }

    /// Corrects the frame, which is turned against the true one by small angles about its two
    /// level axes, 2^-30 rad per step; and squares it up.
    pub(super) fn tilt(&mut self, [x, y]: [i32; 2]) {
        let [first, second] = self.level;
        let up = self.up;
        self.level[0] = plus(first, share(up, y));
        self.up = plus(plus(up, share(second, x)), share(first, y.saturating_neg()));
        self.square_up();
    }

    /// Brings lengths and right angles, which are nearly right, nearer: one step of Newton's.
    fn square_up(&mut self) {
        let [first, second] = &mut self.level;
        self.up = lengthened(self.up);
        let along = dot(*first, self.up);
        let beside = plus(*first, share(self.up, along.saturating_neg()));
        *first = lengthened(beside);
        *second = cross(self.up, *first);
    }
}

/// `axis`, which stands still, as the housing sees it after it turned by `angle`.
fn turned(axis: [i32; 3], angle: [i32; 3]) -> [i32; 3] {
    let once = cross(axis, angle);
    let twice = cross(once, angle);
    let thrice = cross(twice, angle);
    let axis = plus(axis, once.map(i64::from));
    let axis = plus(axis, twice.map(|t| i64::from(t >> 1)));
    plus(axis, thrice.map(|t| i64::from(t / 6)))
}

/// A vector and a change of it.
fn plus([x, y, z]: [i32; 3], [a, b, c]: [i64; 3]) -> [i32; 3] {
    let sum = |v: i32, change: i64| fit(i64::from(v) + change);
    [sum(x, a), sum(y, b), sum(z, c)]
}

/// `part` (2^-30) of a vector.
fn share(vector: [i32; 3], part: i32) -> [i64; 3] {
    vector.map(|v| product(v, part, 30))
}

/// The vector product of two vectors, 2^-30 per step.
fn cross([ax, ay, az]: [i32; 3], [bx, by, bz]: [i32; 3]) -> [i32; 3] {
    let part = |a: i32, b: i32, c: i32, d: i32| {
        let difference = i64::from(a) * i64::from(b) - i64::from(c) * i64::from(d);
        fit((difference + (1 << 29)) >> 30)
    };
    [
        part(ay, bz, az, by),
        part(az, bx, ax, bz),
        part(ax, by, ay, bx),
    ]
}

/// The scalar product with an axis of length one, in the other vector's unit.
fn dot([ax, ay, az]: [i32; 3], [bx, by, bz]: [i32; 3]) -> i32 {
    let product = |a: i32, b: i32| i64::from(a) * i64::from(b);
    fit((product(ax, bx) + product(ay, by) + product(az, bz) + (1 << 29)) >> 30)
}

/// A vector of nearly length one, nearer to it: times (3 - square) / 2.
fn lengthened(vector: [i32; 3]) -> [i32; 3] {
    let square = dot(vector, vector);
    let factor = fit((3 * i64::from(ONE) - i64::from(square)) >> 1);
    vector.map(|v| fit(product(v, factor, 30)))
}
