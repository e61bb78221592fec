//! The dynamic test (R17): +-40 deg at 80 deg/s, ten cycles, read 50 times a second.
//!
//! In: a calibrated instrument, a mount and a lever arm. Out: errors of each node as the readings
//! arrive, and aligned by the latency that each reading declares; and samples for the figures.
//!
//! Erratum E2: an RMSE of 0.10 deg is not possible un-aligned, because the paper's filter alone
//! lags 0.64 deg at that speed; so both figures are given. Erratum E15: an accelerometer cannot
//! tell motion from tilt; the lever arm shows how much that is.

use std::collections::VecDeque;

use tilt::chain::Reading;
use tilt::cross_check::THRESHOLD;

use super::Bench;
use super::static_test::of_axis;
use super::statistics::Tally;
use crate::TICK_S;
use crate::instrument::Pair;
use crate::motion::Mover;
use crate::rig::Mount;

/// R17: ends of the swing, speed and cycles.
const SWING_DEG: f64 = 40.0;
const SPEED_DEG_S: f64 = 80.0;
const CYCLES: u32 = 10;
/// Rest at each end [ASSUME].
const REST_S: f64 = 0.2;
/// Readings are taken every 20 ms.
const SYNC_TICKS: u64 = 20;
/// How far back the truth is kept, in ticks.
const HISTORY: usize = 400;

/// One reading for the figures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicPoint {
    /// Since the start of the test, s.
    pub time_s: f64,
    /// True angle now, deg.
    pub truth_deg: f64,
    /// What the nodes show now, deg.
    pub nodes_deg: [Option<f64>; 2],
    /// True angle at the instant that each node's reading declares, deg.
    pub truth_then_deg: [f64; 2],
}

/// What the test found.
#[derive(Clone, Debug, Default)]
pub struct DynamicResult {
    /// Errors against the truth at the instant of reading, per node, deg: of the angle of that very
    /// moment, where there is a gyroscope.
    pub as_it_arrives: [Tally; 2],
    /// Errors against the truth at the instant that the reading declares, per node, deg.
    pub aligned: [Tally; 2],
    /// Declared latency, per node, ms.
    pub latency_ms: [Tally; 2],
    /// Size of the difference between the nodes, deg.
    pub difference: Tally,
    /// Readings that were invalid.
    pub invalid: u64,
    /// Readings in which the nodes differed by more than the 0.40 deg of R12.
    pub warnings: u64,
    /// All readings in order.
    pub points: Vec<DynamicPoint>,
}

/// True angles of the last ticks, newest last.
struct History(VecDeque<f64>);

impl History {
    fn push(&mut self, angle_deg: f64) {
        if self.0.len() == HISTORY {
            self.0.pop_front();
        }
        self.0.push_back(angle_deg);
    }

    fn back(&self, seconds: f64) -> f64 {
        let newest = self.0.len().saturating_sub(1) as f64;
        let position = (newest - seconds / TICK_S).clamp(0.0, newest);
        let below = self
            .0
            .get(position.floor() as usize)
            .copied()
            .unwrap_or(0.0);
        let above = self
            .0
            .get(position.ceil() as usize)
            .copied()
            .unwrap_or(below);
        below + (position - position.floor()) * (above - below)
    }
}

impl Bench {
    /// Runs the test of R17 in `mount` with the sensor `lever_arm_m` from the axis.
    pub fn dynamic_test(&mut self, mount: Mount, lever_arm_m: f64) -> DynamicResult {
        self.mount(mount, 0.0, lever_arm_m);
        self.turn_to(-SWING_DEG, SPEED_DEG_S, 3.0);
        let mut result = DynamicResult::default();
        let mut history = History(VecDeque::with_capacity(HISTORY));
        let start_s = self.instrument.time_s();
        for leg in 0..2 * CYCLES {
            let target = if leg % 2 == 0 { SWING_DEG } else { -SWING_DEG };
            let arrival_s = self.rig.command(target, SPEED_DEG_S).unwrap_or(0.0);
            let ticks = ((arrival_s - self.instrument.time_s() + REST_S) / TICK_S) as u64;
            for tick in 0..ticks {
                let motion = self.rig.step(self.instrument.time_s() + TICK_S);
                self.instrument.tick(&motion);
                history.push(self.rig.shaft().true_deg);
                if tick % SYNC_TICKS == 0 {
                    let time_s = self.instrument.time_s() - start_s;
                    let pair = self.instrument.sync();
                    note(&mut result, &pair, mount, &history, time_s);
                }
            }
        }
        result
    }
}

fn note(result: &mut DynamicResult, pair: &Pair, mount: Mount, history: &History, time_s: f64) {
    let truth_deg = history.back(0.0);
    let mut nodes_deg = [None; 2];
    let mut truth_then_deg = [truth_deg; 2];
    let slope = |reading: &Reading| of_axis(*reading, mount);
    for (node, (reading, now)) in pair.readings.iter().zip(&pair.now).enumerate() {
        let (Ok(m), Ok(now)) = (slope(reading), slope(now)) else {
            result.invalid += 1;
            continue;
        };
        let angle_deg = m.angle.degrees();
        let latency_s = f64::from(m.latency_us) * 1e-6;
        nodes_deg[node] = Some(angle_deg);
        result.as_it_arrives[node].add(now.angle.degrees() - truth_deg);
        truth_then_deg[node] = history.back(latency_s);
        result.aligned[node].add(angle_deg - truth_then_deg[node]);
        result.latency_ms[node].add(latency_s * 1000.0);
    }
    if let [Some(a), Some(b)] = nodes_deg {
        result.difference.add((a - b).abs());
    }
    let delta = of_axis(pair.verdict.delta(), mount);
    result.warnings += u64::from(delta.is_some_and(|d| d.magnitude() > THRESHOLD));
    result.points.push(DynamicPoint {
        time_s,
        truth_deg,
        nodes_deg,
        truth_then_deg,
    });
}
