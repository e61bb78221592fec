//! The same estimator in real numbers, with all matrices written out: what the integers are held
//! against. It shares no arithmetic with them.

use super::quiet::DRIFT_BLOCKS;
use super::settings::{DOUBT, DOUBTED_S, FOUND};
use super::{BLOCK, Expected};

const N: usize = 16;
type Vec3 = [f64; 3];
type Matrix = [[f64; N]; N];

pub(super) fn cross([a, b, c]: Vec3, [x, y, z]: Vec3) -> Vec3 {
    [b * z - c * y, c * x - a * z, a * y - b * x]
}

pub(super) fn dot(a: Vec3, b: Vec3) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(super) fn unit(v: Vec3) -> Vec3 {
    let length = dot(v, v).sqrt();
    v.map(|v| v / length)
}

/// `v`, which stands still, as seen from what turned by `angle` (rad).
pub(super) fn turned(v: Vec3, angle: Vec3) -> Vec3 {
    let size = dot(angle, angle).sqrt();
    if size < 1e-12 {
        return v;
    }
    let axis = angle.map(|a| a / size);
    let (sin, cos) = size.sin_cos();
    let across = cross(v, axis);
    let along = dot(axis, v) * (1.0 - cos);
    [0, 1, 2].map(|i| v[i] * cos + across[i] * sin + axis[i] * along)
}

pub(super) struct Reference {
    e: Expected,
    /// Level axes and up, in the housing's axes.
    pub(super) axes: [Vec3; 3],
    pub(super) bias: Vec3,
    gain: [Vec3; 3],
    velocity: [f64; 2],
    seen: f64,
    expected: f64,
    change: f64,
    gained: [f64; 2],
    before: [f64; 2],
    whole: Vec3,
    quiet: u32,
    at_rest: bool,
    first: [f64; 5],
    /// Velocity, tilt, bias, gain.
    p: Matrix,
    turn: Vec3,
    levers: [[f64; 12]; 2],
    square: f64,
    samples: u32,
}

impl Reference {
    /// From where up is.
    pub(super) fn new(e: Expected, up: Vec3) -> Self {
        let mut p = [[0.0; N]; N];
        for (i, row) in p.iter_mut().enumerate() {
            row[i] = match i {
                0 | 1 => 2.0 * e.start_speed,
                2 | 3 => e.start,
                4..=6 => e.bias,
                _ => e.gain,
            }
            .powi(2);
        }
        let beside = if up[0].abs() < 0.5 {
            [1.0, 0.0, 0.0]
        } else if up[2].abs() < 0.5 {
            [0.0, 0.0, 1.0]
        } else {
            [0.0, 1.0, 0.0]
        };
        let second = unit(cross(up, beside));
        Self {
            e,
            axes: [cross(second, up), second, up],
            bias: [0.0; 3],
            gain: [[0.0; 3]; 3],
            velocity: [0.0; 2],
            seen: 0.0,
            expected: e.start_speed.powi(2),
            change: 0.0,
            gained: [0.0; 2],
            before: [0.0; 2],
            whole: [0.0; 3],
            quiet: 0,
            at_rest: false,
            first: [0.0; 5],
            p,
            turn: [0.0; 3],
            levers: [[0.0; 12]; 2],
            square: 0.0,
            samples: 0,
        }
    }

    /// Takes a rate (rad/s) and an acceleration (g).
    pub(super) fn step(&mut self, rate: Vec3, accel: Vec3) {
        let free = [0, 1, 2].map(|i| rate[i] - self.bias[i]);
        let true_rate = [0, 1, 2].map(|i| free[i] - dot(self.gain[i], free));
        let angle = true_rate.map(|r| r * self.e.period_s);
        self.axes = self.axes.map(|axis| turned(axis, angle));
        for (gained, axis) in self.gained.iter_mut().zip(self.axes) {
            *gained += dot(axis, accel) * self.e.period_s;
        }
        for ((sum, whole), angle) in self.turn.iter_mut().zip(&mut self.whole).zip(angle) {
            *sum += angle;
            *whole += angle;
        }
        self.samples += 1;
        if self.samples.is_multiple_of(4) {
            self.take_levers();
        }
        if self.samples == BLOCK {
            self.filter();
            self.samples = 0;
            self.square = 0.0;
            self.levers = [[0.0; 12]; 2];
        }
    }

    fn take_levers(&mut self) {
        for (levers, axis) in self.levers.iter_mut().zip(self.axes) {
            for (i, component) in axis.iter().enumerate() {
                levers[i] += component * 4.0 * self.e.period_s;
                for (j, angle) in self.turn.iter().enumerate() {
                    levers[3 + 3 * i + j] += component * angle;
                }
            }
        }
        self.square += dot(self.turn, self.turn) / 4.0;
        self.turn = [0.0; 3];
    }

    fn filter(&mut self) {
        let e = self.e;
        let block_s = e.period_s * f64::from(BLOCK);
        let mut f = [[0.0; N]; N];
        for (i, row) in f.iter_mut().enumerate() {
            row[i] = 1.0;
        }
        let mut tilt = f;
        for a in 0..2 {
            for (k, lever) in self.levers[a].iter().enumerate() {
                tilt[2 + a][4 + k] = -lever;
            }
        }
        let mut fall = f;
        (fall[0][3], fall[1][2]) = (block_s, -block_s);
        f = times(&fall, &tilt);
        self.p = times(&times(&f, &self.p), &transposed(&f));
        let turning = e.rate_defect.powi(2) / e.period_s * self.square;
        for i in 0..N {
            let (walk, most) = match i {
                0 | 1 => (e.accel_noise.powi(2) * block_s, f64::MAX),
                2 | 3 => (e.rate_noise.powi(2) * block_s + turning, f64::MAX),
                4..=6 => (e.bias_walk.powi(2) * block_s, e.bias.powi(2)),
                _ => (e.gain.powi(2) * block_s / e.gain_memory_s, e.gain.powi(2)),
            };
            if self.p[i][i] < most {
                self.p[i][i] += walk;
            }
        }
        self.look_for_rest(block_s);
        let mean = |v: [f64; 2]| v.iter().map(|v| v * v).sum::<f64>() / 2.0;
        let fade = 1.0 - (block_s / e.hold_s * 65536.0).round() / 65536.0;
        self.change = mean(self.before).max(self.change * fade);
        self.seen *= fade;
        let speed = if self.at_rest {
            let tilt = self.p[2][2].midpoint(self.p[3][3]).sqrt();
            if self.seen <= e.least_speed.powi(2) && tilt < FOUND {
                self.expected = 0.0;
            }
            e.rest_speed.powi(2)
        } else {
            self.seen = self.seen.max(mean(self.velocity));
            self.seen.max(self.expected).max(e.least_speed.powi(2))
        };
        let [least, most] = e.swing_s.map(|s| s / block_s);
        let blocks = (speed / self.change).sqrt().clamp(least, most);
        let noise = speed * 2.0 * blocks;
        let mut x = [0.0; N];
        for a in 0..2 {
            let variance = self.p[a][a] + noise;
            let gain: [f64; N] = core::array::from_fn(|i| self.p[i][a] / variance);
            let missing = -self.velocity[a] - x[a];
            for i in 0..N {
                x[i] += gain[i] * missing;
            }
            for (row, gain_i) in self.p.iter_mut().zip(gain) {
                for (cell, gain_j) in row.iter_mut().zip(gain) {
                    *cell -= gain_i * gain_j * variance;
                }
            }
        }
        self.correct(&x);
    }

    fn look_for_rest(&mut self, block_s: f64) {
        let e = self.e;
        let slow = self.whole.iter().all(|w| w.abs() < e.rest_rate * block_s);
        let ([x, y], [turn_x, turn_y, turn_z]) = (self.gained, self.whole);
        let now = [x, y, turn_x, turn_y, turn_z];
        let [accel, rate] = [e.rest_accel, e.rest_rate_change].map(|c| c * block_s);
        let most = [accel, accel, rate, rate, rate];
        let alike = |other: &[f64]| {
            let mut both = now.iter().zip(other).zip(most);
            both.all(|((now, other), most)| (now - other).abs() < most)
        };
        let steady = alike(&self.before);
        let square = self.gained.iter().map(|g| g * g).sum::<f64>() / 2.0;
        let tilt = 25.0 * self.p[2][2].midpoint(self.p[3][3]) * block_s.powi(2);
        let level = square < tilt + (e.rest_accel * block_s).powi(2);
        let tilt = self.p[2][2].midpoint(self.p[3][3]).sqrt();
        let vague = tilt > DOUBT;
        let doubted = vague && !self.at_rest;
        if self.quiet == 0 || (vague != self.at_rest && !alike(&self.first)) {
            (self.quiet, self.at_rest, self.first) = (0, false, now);
        } else if !doubted && self.quiet.is_multiple_of(DRIFT_BLOCKS) {
            (self.first[0], self.first[1]) = (x, y);
        }
        let at_rest = slow && steady && level;
        self.quiet = if at_rest { self.quiet + 1 } else { 0 };
        let enough = if doubted { DOUBTED_S } else { e.rest_after_s };
        let begins = self.quiet > (enough / block_s) as u32 && !self.at_rest;
        self.at_rest = at_rest && (self.at_rest || begins);
        if begins {
            self.velocity = self.gained.map(|gained| -gained);
            for a in 0..2 {
                self.p[a] = [0.0; N];
                self.p.iter_mut().for_each(|row| row[a] = 0.0);
                self.p[a][a] = e.rest_speed.powi(2);
            }
        }
        for (velocity, gained) in self.velocity.iter_mut().zip(self.gained) {
            *velocity += gained;
        }
        self.before = self.gained;
        (self.gained, self.whole) = ([0.0; 2], [0.0; 3]);
    }

    fn correct(&mut self, x: &[f64; N]) {
        let block_s = self.e.period_s * f64::from(BLOCK);
        let [turn_x, turn_y, turn_z] = [4, 5, 6].map(|i| -block_s * x[i]);
        let more = [block_s * x[3], -block_s * x[2], turn_x, turn_y, turn_z];
        for gained in [&mut self.before[..], &mut self.first] {
            gained.iter_mut().zip(more).for_each(|(g, m)| *g += m);
        }
        for (velocity, x) in self.velocity.iter_mut().zip(x) {
            *velocity += x;
        }
        for i in 0..3 {
            self.bias[i] += x[4 + i];
            for j in 0..3 {
                let most = 2.0 * self.e.gain;
                let gain = self.gain[i][j] + x[7 + 3 * i + j];
                self.gain[i][j] = gain.clamp(-most, most);
            }
        }
        let [first, second, up] = self.axes;
        let up = unit([0, 1, 2].map(|i| up[i] + x[2] * second[i] - x[3] * first[i]));
        let moved = [0, 1, 2].map(|i| first[i] + x[3] * self.axes[2][i]);
        let second = unit(cross(up, moved));
        self.axes = [cross(second, up), second, up];
    }

    /// Standard uncertainty of the vertical in one direction, rad.
    pub(super) fn uncertainty(&self) -> f64 {
        let tilt = (self.p[2][2] + self.p[3][3]) / 2.0;
        (tilt + self.e.accel_offset.powi(2)).sqrt()
    }
}

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    core::array::from_fn(|i| core::array::from_fn(|j| (0..N).map(|k| a[i][k] * b[k][j]).sum()))
}

fn transposed(a: &Matrix) -> Matrix {
    core::array::from_fn(|i| core::array::from_fn(|j| a[j][i]))
}
