//! What is known of sixteen errors together: a Kalman filter's covariance in 32 bits.
//!
//! The states: velocity along the two level axes, tilt about them, and the gyroscope's twelve
//! errors (bias, then scale and alignment row by row). Each has a unit, so that a standard
//! deviation of one unit is the largest that occurs: velocity 4 g s, tilt 2^-2 rad, bias
//! 2^-4 rad/s, scale and alignment 2^-4. A variance is in 2^-31 of the product of two units; the
//! smallest is 3e-4 deg, 8e-5 deg/s and 1.3e-6 as a standard deviation.
//!
//! In: the levers of the gyroscope's errors, the noise of a block, and the velocity, which is
//! zero in the mean. Out: corrections of all states, and the variance of the tilt.
//!
//! Rounding takes or adds half of the last bit at random; the noise of a block, which is a hundred
//! of it, covers that.

use super::block::Levers;
use super::gyroscope::Errors;
use super::{fit, product};
use crate::root::root;

/// The states of motion: velocity x, velocity y, tilt about x, tilt about y.
const MOTION: usize = 4;
/// The gyroscope's errors.
const ERRORS: usize = 12;

/// Covariance of one state, or of one error, with the four states of motion.
type Row = [i32; MOTION];

/// Variances of the states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Variances {
    /// Of the velocity along one axis.
    pub(super) velocity: i32,
    /// Of the tilt about one axis.
    pub(super) tilt: i32,
    /// Of the bias of one axis.
    pub(super) bias: i32,
    /// Of one number of scale or alignment.
    pub(super) gain: i32,
}

impl Variances {
    fn errors(&self) -> impl Iterator<Item = i32> {
        core::iter::repeat_n(self.bias, 3).chain(core::iter::repeat_n(self.gain, 9))
    }
}

/// The covariance of all states.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Covariance {
    /// Of the motion, symmetric.
    motion: [Row; MOTION],
    /// Of each error of the gyroscope with the motion.
    cross: [Row; ERRORS],
    /// Of these errors with each other; the upper triangle is not used.
    errors: [[i32; ERRORS]; ERRORS],
}

impl Covariance {
    /// Of states that have nothing to do with each other.
    pub(super) fn new(variances: Variances) -> Self {
        let mut covariance = Self {
            motion: [[0; MOTION]; MOTION],
            cross: [[0; MOTION]; ERRORS],
            errors: [[0; ERRORS]; ERRORS],
        };
        covariance.forget_motion(variances);
        for (cell, variance) in covariance.error_variances().zip(variances.errors()) {
            *cell = variance;
        }
        covariance
    }

    /// Forgets the motion, and keeps what is known of the gyroscope.
    pub(super) fn forget_motion(&mut self, variances: Variances) {
        let [velocity, tilt] = [variances.velocity, variances.tilt];
        self.cross = [[0; MOTION]; ERRORS];
        self.motion = [
            [velocity, 0, 0, 0],
            [0, velocity, 0, 0],
            [0, 0, tilt, 0],
            [0, 0, 0, tilt],
        ];
    }

    /// Forgets the velocity: 2 g s, about anything that moves.
    pub(super) fn forget_velocity(&mut self) {
        const LARGE: i32 = 1 << 29;
        for row in self.motion.iter_mut().chain(&mut self.cross) {
            let [x, y, _, _] = row;
            (*x, *y) = (0, 0);
        }
        let [x, y, _, _] = &mut self.motion;
        *x = [LARGE, 0, 0, 0];
        *y = [0, LARGE, 0, 0];
    }

    /// Variance of the tilt, the mean of both axes.
    pub(super) const fn tilt(&self) -> i32 {
        let [_, _, [_, _, x, _], [_, _, _, y]] = &self.motion;
        x.midpoint(*y)
    }

    /// Carries the covariance over a block: the gyroscope's errors tilt the frame, and a tilted
    /// frame lets gravity into the velocity. `fall` is the velocity for a tilt, 2^-30 of the ratio
    /// of their units.
    pub(super) fn propagate(&mut self, levers: &Levers, fall: i32) {
        let [about_x, about_y] = levers;
        let spread = [self.spread_of(about_x), self.spread_of(about_y)];
        let by = levers.map(|lever| self.shared_with(&lever));
        let both = spread.map(|s| levers.map(|lever| weighted(&lever, &s)));
        for (k, row) in self.cross.iter_mut().enumerate() {
            let [_, _, x, y] = row;
            for (cell, s) in [x, y].into_iter().zip(&spread) {
                *cell = fit(i64::from(*cell) - s.get(k).map_or(0, |s| i64::from(*s)));
            }
        }
        self.tilt_by(&by, &both);
        for row in self.motion.iter_mut().chain(&mut self.cross) {
            *row = fallen(*row, fall);
        }
        let [vx, vy, x, y] = &mut self.motion;
        add_row(vx, y, fall);
        add_row(vy, x, fall.saturating_neg());
        self.mirror();
    }

    /// Product of the errors' covariance with a lever, in the units of covariance.
    fn spread_of(&self, lever: &[i32; ERRORS]) -> [i32; ERRORS] {
        let mut sums = [0i64; ERRORS];
        for (i, row) in self.errors.iter().enumerate() {
            let own = lever.get(i).copied().unwrap_or(0);
            let mut sum = 0i64;
            // Below the diagonal each number counts for its row and for its column.
            for ((p, l), other) in row.iter().zip(lever).zip(&mut sums).take(i) {
                sum += i64::from(*p) * i64::from(*l);
                *other += i64::from(*p) * i64::from(own);
            }
            let diagonal = row.get(i).map_or(0, |p| i64::from(*p) * i64::from(own));
            if let Some(cell) = sums.get_mut(i) {
                *cell += sum + diagonal;
            }
        }
        sums.map(|sum| fit((sum + (1 << 26)) >> 27))
    }

    /// What a lever makes of the covariance of errors and motion.
    fn shared_with(&self, lever: &[i32; ERRORS]) -> [i64; MOTION] {
        let mut sums = [0i64; MOTION];
        for (row, l) in self.cross.iter().zip(lever) {
            for (sum, p) in sums.iter_mut().zip(row) {
                *sum += i64::from(*p) * i64::from(*l);
            }
        }
        sums.map(|sum| (sum + (1 << 26)) >> 27)
    }

    /// The tilt's own rows: less what the errors share with the motion, and what they spread.
    fn tilt_by(&mut self, by: &[[i64; MOTION]; 2], both: &[[i64; 2]; 2]) {
        let [[xvx, xvy, xx, xy], [yvx, yvy, yx, yy]] = *by;
        let [[sxx, sxy], [_, syy]] = *both;
        let [vx, vy, x, y] = &mut self.motion;
        let less = |cell: &mut i32, by: i64| *cell = fit(i64::from(*cell) - by);
        less(&mut x[0], xvx);
        less(&mut x[1], xvy);
        less(&mut x[2], 2 * xx - sxx);
        less(&mut x[3], xy + yx - sxy);
        less(&mut y[0], yvx);
        less(&mut y[1], yvy);
        less(&mut y[3], 2 * yy - syy);
        y[2] = x[3];
        (vx[2], vy[2], vx[3], vy[3]) = (x[0], x[1], y[0], y[1]);
    }

    /// Adds the noise of a block; that of scale and alignment up to what they were at first.
    pub(super) fn spread(&mut self, noise: Variances, most: Variances) {
        let [[vx, ..], [_, vy, ..], [_, _, x, _], [_, _, _, y]] = &mut self.motion;
        for cell in [vx, vy] {
            *cell = cell.saturating_add(noise.velocity);
        }
        for cell in [x, y] {
            // What is less known than at first is not known; more would not fit.
            *cell = cell.saturating_add(noise.tilt).min(1 << 30);
        }
        let cells = self.error_variances().zip(noise.errors());
        for ((cell, noise), most) in cells.zip(most.errors()) {
            if *cell < most {
                *cell = cell.saturating_add(noise);
            }
        }
    }

    /// Compares both velocities with zero, one after the other.
    pub(super) fn observe(&mut self, observation: &mut Observation) {
        self.observe_axis::<0>(observation);
        self.observe_axis::<1>(observation);
        let [[vx, ..], [_, vy, ..], [_, _, x, _], [_, _, _, y]] = &mut self.motion;
        for cell in [vx, vy, x, y] {
            *cell = (*cell).max(1);
        }
        for cell in self.error_variances() {
            *cell = (*cell).max(1);
        }
    }

    fn observe_axis<const AXIS: usize>(&mut self, observation: &mut Observation) {
        let variance = i64::from(self.motion[AXIS][AXIS]);
        let scale = inverse_root(variance + observation.noise);
        let share = |p: i32| fit((i64::from(p) * i64::from(scale)) >> 23);
        let motion = self.motion.map(|row| share(row[AXIS]));
        let errors = self.cross.map(|row| share(row[AXIS]));
        observation.take(AXIS, scale, &motion, &errors);
        for (row, own) in self.motion.iter_mut().zip(&motion) {
            take_away(row, *own, &motion);
        }
        for (row, own) in self.cross.iter_mut().zip(&errors) {
            take_away(row, *own, &motion);
        }
        for (i, (row, own)) in self.errors.iter_mut().zip(&errors).enumerate() {
            take_away(row.iter_mut().take(i + 1), *own, &errors);
        }
    }

    /// The upper triangle of the motion's covariance from the lower one.
    fn mirror(&mut self) {
        let [[_, a, b, c], [d, _, e, f], [g, h, _, i], [j, k, l, _]] = &mut self.motion;
        (*a, *b, *c, *e, *f, *i) = (*d, *g, *j, *h, *k, *l);
    }

    fn error_variances(&mut self) -> impl Iterator<Item = &mut i32> {
        let rows = self.errors.iter_mut().enumerate();
        rows.filter_map(|(i, row)| row.get_mut(i))
    }
}

/// Both velocities compared with zero, and what follows for all states.
#[derive(Clone, Debug)]
pub(super) struct Observation {
    /// As integrated, 2^-31 of the unit.
    velocity: [i32; 2],
    /// Variance of one velocity about zero.
    noise: i64,
    /// Corrections, 2^-31 of the units.
    motion: [i32; MOTION],
    errors: Errors,
}

impl Observation {
    /// Of the velocities, 2^-29 g s per step, which scatter about zero with variance `noise`,
    /// 2^16 to 2^37.
    pub(super) const fn new(velocity: [i32; 2], noise: i64) -> Self {
        Self {
            velocity,
            noise,
            motion: [0; MOTION],
            errors: [0; ERRORS],
        }
    }

    /// Corrections by one axis, whose states share `motion` and `errors` with it.
    fn take(&mut self, axis: usize, scale: i32, motion: &[i32; MOTION], errors: &Errors) {
        const LARGEST: i64 = 1 << 30;
        let velocity = self.velocity.get(axis).map_or(0, |v| i64::from(*v));
        let known = self.motion.get(axis).map_or(0, |v| i64::from(*v));
        let missing = i64::from(fit(-velocity - known));
        // In standard deviations, 2^-28.5 per step; two are the most that the noise, which has
        // seen this velocity, leaves.
        let missing = (missing * i64::from(scale)) >> 25;
        let missing = missing.clamp(-LARGEST, LARGEST) as i32;
        let corrections = self.motion.iter_mut().chain(&mut self.errors);
        for (correction, share) in corrections.zip(motion.iter().chain(errors)) {
            *correction = fit(i64::from(*correction) + product(*share, missing, 28));
        }
    }

    /// The velocities as corrected, 2^-29 g s per step.
    pub(super) const fn velocity(&self) -> [i32; 2] {
        let [x, y] = self.velocity;
        let [cx, cy, _, _] = self.motion;
        [x.saturating_add(cx), y.saturating_add(cy)]
    }

    /// Tilt of the frame about its level axes, 2^-30 rad per step.
    pub(super) const fn tilt(&self) -> [i32; 2] {
        let [_, _, x, y] = self.motion;
        [(x >> 3) + ((x >> 2) & 1), (y >> 3) + ((y >> 2) & 1)]
    }

    /// Corrections of the gyroscope's errors, 2^-35 per step.
    pub(super) const fn errors(&self) -> &Errors {
        &self.errors
    }
}

/// Sum of products with a lever, in the units of covariance.
fn weighted(lever: &[i32; ERRORS], values: &[i32; ERRORS]) -> i64 {
    let terms = lever.iter().zip(values);
    let sum: i64 = terms.map(|(l, v)| i64::from(*l) * i64::from(*v)).sum();
    (sum + (1 << 26)) >> 27
}

/// One row after the fall: velocity x by the tilt about y, velocity y by that about x, reversed.
fn fallen([vx, vy, x, y]: Row, fall: i32) -> Row {
    let vx = fit(i64::from(vx) + product(y, fall, 30));
    let vy = fit(i64::from(vy) - product(x, fall, 30));
    [vx, vy, x, y]
}

/// Adds `factor` (2^-30) times a row.
fn add_row(row: &mut Row, other: &Row, factor: i32) {
    for (cell, o) in row.iter_mut().zip(other) {
        *cell = fit(i64::from(*cell) + product(*o, factor, 30));
    }
}

/// Takes `own` times `shares` from a row; both are square roots of covariance with 15 bits more.
fn take_away<'a>(row: impl IntoIterator<Item = &'a mut i32>, own: i32, shares: &[i32]) {
    for (cell, share) in row.into_iter().zip(shares) {
        *cell = fit(i64::from(*cell) - product(own, *share, 30));
    }
}

/// 2^38 by the square root of `value`, which is 2^16 to 2^38.
fn inverse_root(value: i64) -> i32 {
    let value = value.clamp(1 << 16, 1 << 38).unsigned_abs();
    let root = root(value << 24);
    let inverse = (1u64 << 50).checked_div(u64::from(root));
    inverse.map_or(0, |inverse| inverse as i32)
}

#[cfg(test)]
impl Covariance {
    /// True where some states could have this covariance: it has a root (Cholesky), but for what
    /// rounding takes from a variance.
    pub(super) fn is_one(&self) -> bool {
        const ALL: usize = MOTION + ERRORS;
        let cell = |i: usize, j: usize| match (i.checked_sub(MOTION), j.checked_sub(MOTION)) {
            (None, _) => self.motion[i][j],
            (Some(i), None) => self.cross[i][j],
            (Some(i), Some(j)) => self.errors[i][j],
        };
        let mut root = [[0.0; ALL]; ALL];
        for i in 0..ALL {
            for j in 0..=i {
                let known: f64 = (0..j).map(|k| root[i][k] * root[j][k]).sum();
                let left = f64::from(cell(i, j)) - known;
                if i == j && left <= -50.0 {
                    return false;
                }
                root[i][j] = if i == j {
                    left.max(1.0).sqrt()
                } else {
                    left / root[j][j]
                };
            }
        }
        true
    }
}
