//! What is known of sixteen errors together: a Kalman filter's covariance in 32 bits.
//!
//! The states: velocity along the two level axes, tilt about them, and the gyroscope's twelve
//! errors (bias, then scale and alignment row by row). Each has a unit, so that a standard
//! deviation of one unit is the largest that occurs: velocity 2 g s, tilt 2^-2 rad, bias
//! 2^-4 rad/s, scale and alignment 2^-4. A variance is in 2^-31 of the product of two units, and is
//! kept below half of that, so that what is computed of it fits; the smallest is 3e-4 deg,
//! 8e-5 deg/s and 1.3e-6 as a standard deviation.
//!
//! In: the levers of the gyroscope's errors, the noise of a block, and the velocity, which is
//! zero in the mean. Out: corrections of all states, and the variance of the tilt.
//!
//! Rounding takes or adds half of the last bit at random; the noise of a block, which is a hundred
//! of it, covers that.

use super::block::Levers;
use super::gyroscope::Errors;
use super::product;
use crate::root::root;
use crate::saturate::saturate;

/// The states of motion: velocity x, velocity y, tilt about x, tilt about y.
const MOTION: usize = 4;
/// The gyroscope's errors.
const ERRORS: usize = 12;

/// All states.
const STATES: usize = MOTION + ERRORS;
/// The largest variance.
pub(super) const LARGEST: i32 = 1 << 30;

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
    /// Of the scale of one axis.
    pub(super) scale: i32,
    /// Of one number of alignment.
    pub(super) gain: i32,
}

impl Variances {
    fn errors(&self) -> impl Iterator<Item = i32> {
        let (scale, gain) = (self.scale, self.gain);
        let rows = [scale, gain, gain, gain, scale, gain, gain, gain, scale];
        core::iter::repeat_n(self.bias, 3).chain(rows)
    }
}

/// The covariance of all states.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Covariance {
    /// Of each state with those of motion: symmetric in the first four rows.
    motion: [Row; STATES],
    /// Of the gyroscope's errors with each other; the upper triangle is not used.
    errors: [[i32; ERRORS]; ERRORS],
}

impl Covariance {
    /// Forgets everything: states that have nothing to do with each other.
    pub(super) fn forget(&mut self, variances: Variances) {
        self.forget_motion(variances);
        self.errors = [[0; ERRORS]; ERRORS];
        for (cell, variance) in self.error_variances().zip(variances.errors()) {
            *cell = variance;
        }
    }

    /// Forgets the motion, and keeps what is known of the gyroscope.
    pub(super) fn forget_motion(&mut self, variances: Variances) {
        self.motion = [[0; MOTION]; STATES];
        let [vx, vy, x, y] = self.motion_variances();
        (*vx, *vy) = (variances.velocity, variances.velocity);
        (*x, *y) = (variances.tilt, variances.tilt);
    }

    /// Forgets the velocity: from now on it has this variance, and is not shared with anything.
    pub(super) fn forget_velocity(&mut self, variance: i32) {
        for [x, y, _, _] in &mut self.motion {
            (*x, *y) = (0, 0);
        }
        let [x, y, ..] = &mut self.motion;
        *x = [variance, 0, 0, 0];
        *y = [0, variance, 0, 0];
    }

    /// The tilt about each axis is less certain by `variance`.
    pub(super) fn widen_tilt(&mut self, variance: i64) {
        let [_, _, x, y] = self.motion_variances();
        for cell in [x, y] {
            *cell = saturate(i64::from(*cell) + variance).min(LARGEST);
        }
    }

    /// Variance of the tilt, the mean of both axes.
    pub(super) const fn tilt(&self) -> i32 {
        let [_, _, [_, _, x, _], [_, _, _, y], ..] = &self.motion;
        x.midpoint(*y)
    }

    /// Carries the covariance over a block: the gyroscope's errors tilt the frame, and a tilted
    /// frame lets gravity into the velocity. `fall` is the velocity for a tilt, 2^-30 of the ratio
    /// of their units.
    pub(super) fn propagate(&mut self, levers: &Levers, fall: i32) {
        let [about_x, about_y] = levers;
        let by = [self.shared_with(about_x), self.shared_with(about_y)];
        let [spread_x, spread_y] = self.spread_of(levers);
        let both = [
            weighted(about_x, &spread_x),
            weighted(about_x, &spread_y),
            weighted(about_y, &spread_y),
        ];
        let [vx, vy, tilt_x, tilt_y, cross @ ..] = &mut self.motion;
        for (([_, _, x, y], sx), sy) in cross.iter_mut().zip(&spread_x).zip(&spread_y) {
            *x = x.wrapping_sub(*sx);
            *y = y.wrapping_sub(*sy);
        }
        tilt_by([tilt_x, tilt_y], by, both);
        [vx[2], vy[2], vx[3], vy[3]] = [tilt_x[0], tilt_x[1], tilt_y[0], tilt_y[1]];
        for [vx, vy, x, y] in &mut self.motion {
            *vx = saturate(i64::from(*vx) + product(*y, fall, 30));
            *vy = saturate(i64::from(*vy) - product(*x, fall, 30));
        }
        let [vx, vy, x, y, ..] = &mut self.motion;
        for ((vx, vy), (x, y)) in vx.iter_mut().zip(vy).zip(x.iter().zip(y)) {
            *vx = saturate(i64::from(*vx) + product(*y, fall, 30));
            *vy = saturate(i64::from(*vy) - product(*x, fall, 30));
        }
        self.mirror();
    }

    /// Products of the errors' covariance with both levers, in the units of covariance.
    fn spread_of(&self, [about_x, about_y]: &Levers) -> Levers {
        let mut sums = [(0i64, 0i64); ERRORS];
        for (i, row) in self.errors.iter().enumerate() {
            let lever = |levers: &[i32; ERRORS]| levers.get(i).map_or(0, |l| i64::from(*l));
            let own = (lever(about_x), lever(about_y));
            let mut sum = (0i64, 0i64);
            // Below the diagonal each number counts for its row and for its column.
            let others = sums.iter_mut().zip(about_x.iter().zip(about_y));
            for (p, (other, (x, y))) in row.iter().zip(others).take(i) {
                let p = i64::from(*p);
                sum.0 += p * i64::from(*x);
                sum.1 += p * i64::from(*y);
                other.0 += p * own.0;
                other.1 += p * own.1;
            }
            let diagonal = row.get(i).map_or(0, |p| i64::from(*p));
            if let Some(cell) = sums.get_mut(i) {
                cell.0 += sum.0 + diagonal * own.0;
                cell.1 += sum.1 + diagonal * own.1;
            }
        }
        [
            sums.map(|(x, _)| shortened(x)),
            sums.map(|(_, y)| shortened(y)),
        ]
    }

    /// What a lever makes of the covariance of errors and motion.
    fn shared_with(&self, lever: &[i32; ERRORS]) -> Row {
        let [_, _, _, _, cross @ ..] = &self.motion;
        let mut sums = [0i64; MOTION];
        for (row, l) in cross.iter().zip(lever) {
            for (sum, p) in sums.iter_mut().zip(row) {
                *sum += i64::from(*p) * i64::from(*l);
            }
        }
        sums.map(shortened)
    }

    /// Adds the noise of a block; that of the gyroscope's errors up to what they were at first.
    pub(super) fn spread(&mut self, noise: Variances, most: Variances) {
        let [vx, vy, x, y] = self.motion_variances();
        // What is less known than at first is not known; more would not fit.
        for cell in [vx, vy] {
            *cell = cell.saturating_add(noise.velocity).min(LARGEST);
        }
        for cell in [x, y] {
            *cell = cell.saturating_add(noise.tilt).min(LARGEST);
        }
        let cells = self.error_variances().zip(noise.errors());
        for ((cell, noise), most) in cells.zip(most.errors()) {
            if *cell < most {
                *cell = cell.saturating_add(noise);
            }
        }
    }

    /// The scale of each axis has changed with temperature: `variance` more of it is unknown.
    pub(super) fn warm(&mut self, variance: i32) {
        const SCALES: [usize; 3] = [3, 7, 11];
        for at in SCALES {
            let cell = self.errors.get_mut(at).and_then(|row| row.get_mut(at));
            if let Some(cell) = cell {
                *cell = cell.saturating_add(variance).min(LARGEST);
            }
        }
    }

    /// Compares both velocities with zero, one after the other.
    pub(super) fn observe(&mut self, observation: &mut Observation) {
        let mut column = [0; STATES];
        for (cell, [vx, ..]) in column.iter_mut().zip(&self.motion) {
            *cell = *vx;
        }
        let [variance, ..] = column;
        let by_x = observation.take(0, variance, &column);
        // What the first leaves of the second one's column.
        let [_, own, ..] = by_x;
        for ((cell, [_, vy, ..]), share) in column.iter_mut().zip(&self.motion).zip(&by_x) {
            *cell = vy.wrapping_sub(upper(i64::from(own) * i64::from(*share)));
        }
        let [_, variance, ..] = column;
        let by_y = observation.take(1, variance, &column);
        self.take_away(&by_x, &by_y);
        for cell in self.motion_variances() {
            *cell = (*cell).max(1);
        }
        for cell in self.error_variances() {
            *cell = (*cell).max(1);
        }
    }

    /// Takes from all covariances what two observations have told; the shares are square roots of
    /// covariance with 16 bits more.
    fn take_away(&mut self, by_x: &[i32; STATES], by_y: &[i32; STATES]) {
        for ((row, x), y) in self.motion.iter_mut().zip(by_x).zip(by_y) {
            take_from(row, [*x, *y], by_x, by_y);
        }
        let [_, _, _, _, by_x @ ..] = by_x;
        let [_, _, _, _, by_y @ ..] = by_y;
        let rows = self.errors.iter_mut().zip(by_x.iter().zip(by_y));
        for (i, (row, (x, y))) in rows.enumerate() {
            let (row, _) = row.split_at_mut_checked(i + 1).unwrap_or_default();
            take_from(row, [*x, *y], by_x, by_y);
        }
    }

    /// The upper triangle of the motion's covariance from the lower one.
    fn mirror(&mut self) {
        let [[_, a, b, c], [d, _, e, f], [g, h, _, i], [j, k, l, _], ..] = &mut self.motion;
        (*a, *b, *c, *e, *f, *i) = (*d, *g, *j, *h, *k, *l);
    }

    fn motion_variances(&mut self) -> [&mut i32; MOTION] {
        let [[vx, ..], [_, vy, ..], [_, _, x, _], [_, _, _, y], ..] = &mut self.motion;
        [vx, vy, x, y]
    }

    fn error_variances(&mut self) -> impl Iterator<Item = &mut i32> {
        let rows = self.errors.iter_mut().enumerate();
        rows.filter_map(|(i, row)| row.get_mut(i))
    }
}

/// The tilt's own rows: less what the errors share with the motion, and what they spread.
fn tilt_by([x, y]: [&mut Row; 2], [by_x, by_y]: [Row; 2], [xx, xy, yy]: [i32; 3]) {
    let less = |cell: &mut i32, by: i64| *cell = saturate(i64::from(*cell) - by);
    let twice = |a: i32, b: i32, both: i32| i64::from(a) + i64::from(b) - i64::from(both);
    less(&mut x[0], by_x[0].into());
    less(&mut x[1], by_x[1].into());
    less(&mut y[0], by_y[0].into());
    less(&mut y[1], by_y[1].into());
    less(&mut x[2], twice(by_x[2], by_x[2], xx));
    less(&mut y[2], twice(by_x[3], by_y[2], xy));
    less(&mut y[3], twice(by_y[3], by_y[3], yy));
    x[3] = y[2];
}

/// Both velocities compared with zero, and what follows for all states.
#[derive(Clone, Debug)]
pub(super) struct Observation {
    /// As integrated, 2^-31 of the unit.
    velocity: [i32; 2],
    /// Variance of one velocity about zero.
    noise: i64,
    /// Corrections, 2^-31 of the units.
    states: [i32; STATES],
}

impl Observation {
    /// Of the velocities, 2^-30 g s per step, which scatter about zero with variance `noise`,
    /// 2^8 to 2^37.
    pub(super) const fn new(velocity: [i32; 2], noise: i64) -> Self {
        Self {
            velocity,
            noise,
            states: [0; STATES],
        }
    }

    /// Corrections by one axis, whose velocity has `variance`, and `column` with all states. Gives
    /// the share that each state has in it.
    fn take(&mut self, axis: usize, variance: i32, column: &[i32; STATES]) -> [i32; STATES] {
        const MOST: i64 = 1 << 30;
        let scale = inverse_root(i64::from(variance) + self.noise);
        let velocity = self.velocity.get(axis).map_or(0, |v| i64::from(*v));
        let known = self.states.get(axis).map_or(0, |v| i64::from(*v));
        let missing = i64::from(saturate(-velocity - known));
        // In standard deviations, 2^-28.5 per step; two are the most that the noise, which has
        // seen this velocity, leaves.
        let missing = ((missing * i64::from(scale)) >> 21).clamp(-MOST, MOST) as i32;
        let mut shares = [0; STATES];
        let states = self.states.iter_mut().zip(column);
        for (share, (state, p)) in shares.iter_mut().zip(states) {
            *share = saturate((i64::from(*p) * i64::from(scale)) >> 18);
            *state = saturate(i64::from(*state) + product(*share, missing, 29));
        }
        shares
    }

    /// The velocities as corrected, 2^-30 g s per step.
    pub(super) const fn velocity(&self) -> [i32; 2] {
        let [x, y] = self.velocity;
        let [cx, cy, ..] = self.states;
        [x.saturating_add(cx), y.saturating_add(cy)]
    }

    /// Tilt of the frame about its level axes, 2^-30 rad per step.
    pub(super) const fn tilt(&self) -> [i32; 2] {
        let [_, _, x, y, ..] = self.states;
        [(x >> 3) + ((x >> 2) & 1), (y >> 3) + ((y >> 2) & 1)]
    }

    /// Corrections of the gyroscope's errors, 2^-35 per step.
    pub(super) const fn errors(&self) -> &Errors {
        let [_, _, _, _, errors @ ..] = &self.states;
        errors
    }
}

/// Sum of products with a lever, in the units of covariance.
fn weighted(lever: &[i32; ERRORS], values: &[i32; ERRORS]) -> i32 {
    let terms = lever.iter().zip(values);
    shortened(terms.map(|(l, v)| i64::from(*l) * i64::from(*v)).sum())
}

/// A sum of products with levers in the units of covariance.
fn shortened(sum: i64) -> i32 {
    saturate((sum + (1 << 26)) >> 27)
}

/// The upper half of a product, rounded.
#[inline(always)]
const fn upper(product: i64) -> i32 {
    ((product >> 32) as i32).wrapping_add((product as u32 >> 31) as i32)
}

/// Takes from a row what both observations have told of it.
fn take_from(row: &mut [i32], [own_x, own_y]: [i32; 2], by_x: &[i32], by_y: &[i32]) {
    for ((cell, x), y) in row.iter_mut().zip(by_x).zip(by_y) {
        // Both together are no more than the variance was.
        let x = i64::from(own_x) * i64::from(*x);
        let y = i64::from(own_y) * i64::from(*y);
        *cell = cell.wrapping_sub(upper(x.wrapping_add(y)));
    }
}

/// 2^34 by the square root of `value`, which is 2^8 to 2^38.
fn inverse_root(value: i64) -> i32 {
    let value = value.clamp(1 << 8, 1 << 38).unsigned_abs();
    let root = root(value << 24);
    let inverse = (1u64 << 46).checked_div(u64::from(root));
    inverse.map_or(0, |inverse| inverse as i32)
}

#[cfg(test)]
impl Covariance {
    /// True where some states could have this covariance: it has a root (Cholesky), but for what
    /// rounding takes from a variance.
    pub(super) fn is_one(&self) -> bool {
        let cell = |i: usize, j: usize| match j.checked_sub(MOTION) {
            None => self.motion[i][j],
            Some(j) => self.errors[i - MOTION][j],
        };
        let mut root = [[0.0; STATES]; STATES];
        for i in 0..STATES {
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
