//! A simulated instrument in a hand that goes from rest to rest, its gyroscopes followed as over a
//! bus; for tests of what their turns show.
//!
//! In: a seed, poses and temperatures. Out: readings at rest, logs of the gyroscopes, and their
//! true gains.
//!
//! Left out: the bus, and a motor's errors.

use sim::bench::{Mode, World};
use sim::instrument::{Instrument, Side};
use sim::motion::{Motion, Mover};
use sim::network::hand::{Hand, Pose};
use sim::rng::Rng;
use tilt::calibration::least_squares::invert;
use tilt::chain::Calibration;
use tilt::fusion::MeasuredSum;

use crate::fit::{Stand, by_motor};
use crate::gains::Rest;
use crate::motor::Axis;
use crate::reading::Reading;
use crate::turned::Log;

/// An instrument in a hand, and its gyroscopes followed.
pub struct Held {
    pub instrument: Instrument,
    hand: Hand,
    /// Of each node.
    pub logs: [Log; 2],
    /// Time between two looks, ms.
    pub look_ms: u64,
    ticks: u64,
    die_c: f64,
    /// Where both nodes rested so far.
    pub rests: Vec<[Rest; 2]>,
}

/// 2034h sub 5.
fn snapshot(side: &Side) -> [u8; 8] {
    let MeasuredSum { sum, samples, .. } = side.node.channel.measured_sum();
    let [n0, n1] = samples.to_le_bytes();
    let [[x0, x1], [y0, y1], [z0, z1]] = sum.map(|sum| ((sum >> 11) as i16).to_le_bytes());
    [n0, n1, x0, x1, y0, y1, z0, z1]
}

/// Mean rate as the sums have it, rad/s, over these samples.
fn mean(from: MeasuredSum, to: MeasuredSum) -> [f64; 3] {
    let count = f64::from(to.samples.wrapping_sub(from.samples));
    let sum = |axis: usize| f64::from(to.sum[axis].wrapping_sub(from.sum[axis]));
    [0, 1, 2].map(|axis| sum(axis) / 65_536.0 / count)
}

impl Held {
    /// At rest, with looks so far apart.
    pub fn new(seed: u64, look_ms: u64) -> Self {
        let world = World::NOMINAL;
        let settings = world.settings(Mode::Dynamic);
        let parts = world.parts_of(Mode::Dynamic);
        let mut instrument = Instrument::new(&settings, &Mode::Dynamic.check(), &parts, seed, 0);
        instrument.start();
        let mut held = Self {
            instrument,
            hand: Hand::new(Rng::stream(seed, "hand")),
            logs: Default::default(),
            look_ms,
            ticks: 0,
            die_c: 25.0,
            rests: Vec::new(),
        };
        held.hand.set_rate(80.0);
        held.pass(1.0);
        held
    }

    fn tick(&mut self, motion: &Motion) {
        self.instrument.tick(motion);
        self.ticks += 1;
        if self.ticks.is_multiple_of(self.look_ms) {
            for (log, side) in self.logs.iter_mut().zip(&self.instrument.sides) {
                log.take(snapshot(side));
            }
        }
    }

    /// Lets time pass.
    pub fn pass(&mut self, seconds: f64) {
        for _ in 0..(seconds * 1000.0) as u64 {
            let motion = self.hand.step(0.0);
            self.tick(&motion);
        }
    }

    /// Goes there and rests; what both nodes read.
    pub fn rest(&mut self, pitch_deg: f64, roll_deg: f64) -> [Reading; 2] {
        assert!(self.hand.go(Pose {
            pitch_deg,
            roll_deg
        }));
        while !self.hand.is_still() {
            self.pass(0.1);
        }
        self.pass(0.7);
        let from = [0, 1].map(|node| self.logs[node].mark());
        let mut sums = [[0.0; 3]; 2];
        for _ in 0..120 {
            self.pass(0.01);
            for (sum, side) in sums.iter_mut().zip(&self.instrument.sides) {
                let (filtered, _) = side.node.channel.filtered().unwrap();
                for (sum, accel) in sum.iter_mut().zip(filtered.accel) {
                    *sum += f64::from(accel) / 120.0;
                }
            }
        }
        let reading = |node: usize| Reading {
            accel: sums[node],
            scatter_mg: 0.0,
            temperature_c: self.celsius(node),
            angle_deg: [Err(0); 2],
            rate_rad_s: self.logs[node]
                .rest(from[node], self.logs[node].mark())
                .ok(),
        };
        let readings = [reading(0), reading(1)];
        self.rests.push([0, 1].map(|node| Rest {
            reading: readings[node].clone(),
            marks: [from[node], self.logs[node].mark()],
            gaps: 0,
            checks: false,
        }));
        readings
    }

    /// What the thermometer of a node reports, degC, to a degree as 6511h has it.
    pub fn celsius(&self, node: usize) -> f64 {
        let channel = &self.instrument.sides[node].node.channel;
        (f64::from(channel.temperature().unwrap().0) / 256.0).round()
    }

    /// Brings both dies to this temperature, degC, by 2 degC/s: a node does not believe a jump.
    pub fn heat(&mut self, degc: f64) {
        while self.die_c != degc {
            self.die_c += (degc - self.die_c).clamp(-0.2, 0.2);
            self.instrument.set_die_temperature(self.die_c);
            self.pass(0.1);
        }
        self.pass(5.0);
    }

    /// The accelerometers' calibration, by a motor without an error.
    pub fn accelerometers(&mut self) -> [Calibration; 2] {
        let mut stands = Vec::new();
        for axis in [Axis::X, Axis::Y] {
            for deg in (-5..=5).map(|n| 15.0 * f64::from(n)) {
                let (pitch, roll) = if axis == Axis::X {
                    (0.0, deg)
                } else {
                    (deg, 0.0)
                };
                stands.push(Stand {
                    axis,
                    reference_deg: deg,
                    readings: self.rest(pitch, roll).to_vec(),
                });
            }
        }
        self.rests.clear();
        [0, 1].map(|node| {
            let before = &self.instrument.sides[node].settings.chain.calibration;
            by_motor(before, node, &stands, 0.001).unwrap().calibration
        })
    }

    /// M of both gyroscopes: the inverse of what they make of 100 deg/s either way.
    pub fn truth(&mut self) -> [[[f64; 3]; 3]; 2] {
        let mut columns = [[[0.0; 3]; 3]; 2];
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let mut rate_dps = [0.0; 3];
                rate_dps[axis] = 100.0 * sign;
                let motion = Motion {
                    force_g: [0.0, 0.0, 1.0],
                    rate_dps,
                    ..Motion::default()
                };
                // What is in the part's filter is out first.
                (0..200).for_each(|_| self.tick(&motion));
                let from = [0, 1].map(|n| self.instrument.sides[n].node.channel.measured_sum());
                (0..20_000).for_each(|_| self.tick(&motion));
                for (node, column) in columns.iter_mut().enumerate() {
                    let to = self.instrument.sides[node].node.channel.measured_sum();
                    let mean = mean(from[node], to);
                    for (row, mean) in mean.iter().enumerate() {
                        column[row][axis] += sign * mean / 200f64.to_radians();
                    }
                }
            }
        }
        columns.map(|column| invert(column).unwrap())
    }
}
