//! A frame that does not turn with the housing: two level axes and the vertical.
//!
//! In: the angle by which the housing turned within a sample, 2^-30 rad per step, and small
//! corrections of the tilt. Out: the three axes, each a vector in the housing's axes, 2^-30 per
//! step. The third power of the angle is the last that counts: at a quarter of a radian a sample
//! the fourth would be 1.6e-4.
//!
//! Axes are of length one to a few per cent at the worst, so what is computed of them stays below
//! 2 and is not cut off.

use super::product;
use crate::root::root;
use crate::saturate::saturate;
use crate::vector::Corrected;

/// One, as a component of an axis.
const ONE: i32 = 1 << 30;

/// The two level axes and the vertical, in the housing's axes; 2^-30 per step.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
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
            saturate(whole.unwrap_or(0)).clamp(-ONE, ONE)
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
        let turn = Turn::of(angle);
        let [first, second] = &mut self.level;
        *first = turn.apply(*first);
        self.up = turn.apply(self.up);
        *second = cross(self.up, *first);
    }

    /// The vertical.
    pub(super) const fn up(&self) -> [i32; 3] {
        self.up
    }

    /// The vertical after the housing has turned by `angle` more.
    pub(super) fn up_after(&self, angle: [i32; 3]) -> [i32; 3] {
        Turn::of(angle).apply(self.up)
    }

    /// What of an acceleration lies along the two level axes, in its unit.
    pub(super) fn level_part(&self, accel: Corrected) -> [i64; 2] {
        let [first, second] = self.level;
        [scalar(first, accel.accel), scalar(second, accel.accel)]
    }

    /// What of an acceleration lies along the vertical, in its unit.
    pub(super) fn up_part(&self, accel: Corrected) -> i64 {
        scalar(self.up, accel.accel)
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
        let along = scalar(*first, self.up) as i32;
        let beside = plus(*first, share(self.up, along.saturating_neg()));
        *first = lengthened(beside);
        *second = cross(self.up, *first);
    }
}

/// How what stands still turns in the axes of a housing that turns; 2^-30 per step, one row for
/// each component of the result.
pub struct Turn([[i32; 3]; 3]);

impl Turn {
    /// By an angle below a quarter of a radian about each axis.
    pub fn of([x, y, z]: [i32; 3]) -> Self {
        let times = |a: i32, b: i32| ((i64::from(a) * i64::from(b)) >> 30) as i32;
        let (xx, yy, zz) = (times(x, x), times(y, y), times(z, z));
        let (xy, yz, zx) = (times(x, y) >> 1, times(y, z) >> 1, times(z, x) >> 1);
        // The sine's second term, which is a sixth of the third power.
        let sixth = times(xx + yy + zz, ONE / 6);
        let [x, y, z] = [
            x - times(x, sixth),
            y - times(y, sixth),
            z - times(z, sixth),
        ];
        Self([
            [ONE - ((yy + zz) >> 1), xy + z, zx - y],
            [xy - z, ONE - ((zz + xx) >> 1), yz + x],
            [zx + y, yz - x, ONE - ((xx + yy) >> 1)],
        ])
    }

    /// A vector that stands still, in the axes of the housing behind the turn; any unit.
    pub fn apply(&self, axis: [i32; 3]) -> [i32; 3] {
        let [x, y, z] = self.0;
        [
            scalar_here(x, axis) as i32,
            scalar_here(y, axis) as i32,
            scalar_here(z, axis) as i32,
        ]
    }
}

/// A vector and a change of it.
fn plus([x, y, z]: [i32; 3], [a, b, c]: [i64; 3]) -> [i32; 3] {
    let sum = |v: i32, change: i64| saturate(i64::from(v) + change);
    [sum(x, a), sum(y, b), sum(z, c)]
}

/// `part` (2^-30) of a vector.
fn share(vector: [i32; 3], part: i32) -> [i64; 3] {
    vector.map(|v| product(v, part, 30))
}

/// The vector product of two axes, or of two vectors, in 2^-30 of the product of their units.
pub(crate) fn cross([ax, ay, az]: [i32; 3], [bx, by, bz]: [i32; 3]) -> [i32; 3] {
    let part = |a: i32, b: i32, c: i32, d: i32| {
        let difference = i64::from(a) * i64::from(b) - i64::from(c) * i64::from(d);
        ((difference + (1 << 29)) >> 30) as i32
    };
    [
        part(ay, bz, az, by),
        part(az, bx, ax, bz),
        part(ax, by, ay, bx),
    ]
}

/// The scalar product with an axis, in the other vector's unit.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn scalar(a: [i32; 3], b: [i32; 3]) -> i64 {
    scalar_here(a, b)
}

/// [`scalar`], where a call would cost as much.
#[inline(always)]
fn scalar_here([ax, ay, az]: [i32; 3], [bx, by, bz]: [i32; 3]) -> i64 {
    let product = |a: i32, b: i32| i64::from(a) * i64::from(b);
    (product(ax, bx) + product(ay, by) + product(az, bz) + (1 << 29)) >> 30
}

/// A vector of nearly length one, nearer to it: times (3 - square) / 2.
fn lengthened(vector: [i32; 3]) -> [i32; 3] {
    let factor = saturate((3 * i64::from(ONE) - scalar(vector, vector)) >> 1);
    vector.map(|v| saturate(product(v, factor, 30)))
}
