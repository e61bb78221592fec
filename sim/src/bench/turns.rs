//! Turns of the motor from rest to rest, as both gyroscopes follow them.
//!
//! In: where the motor rests in each mount. Out: for each turn and node the means before and after
//! it and the rates in between, from which the fits of `gyroscope` take their equations once the
//! node's accelerometer is calibrated. The angle that the motor reports takes no part.
//!
//! The motor turns the housing in three mounts, so about each of its axes. In the third mount, on
//! edge, it turns about z: without it a slewing machine would tilt the vertical by what z has of
//! the level axes. In the chamber the product's motor does so by a tilt of its other axis.
//!
//! Left out: the fits.

use instant::Instant;
use tilt::calibration::FitError;
use tilt::calibration::gyroscope::{Turn, TurnSum};
use tilt::chain::{Chain, Correction};
use tilt::composition::Place;
use tilt::filter::Filtered;
use tilt::sample::Temperature;

use super::characterise::{Mean, mean_of_both};
use super::{Bench, BenchError};
use crate::TICK_S;
use crate::instrument::Side;
use crate::motion::Mover;
use crate::rig::Mount;

/// Speed of the turns, deg/s: that of the paper's swing.
const SPEED_DEG_S: f64 = 80.0;

/// How long the motor rests before a mean is taken, s: the ringing fades, the filter follows.
const SETTLE_S: f64 = 0.7;

/// Length of a mean, s.
const MEAN_S: f64 = 1.0;

/// A turn of one node.
#[derive(Clone, Debug)]
pub struct Turned {
    /// At the rest before it.
    pub before: Mean,
    after: Mean,
    /// What the node read in between, rad/s, each with how long it stands, s.
    rates: Vec<([f64; 3], f64)>,
    last: Option<Instant>,
}

impl Turned {
    fn from(before: Mean) -> Self {
        Self {
            before,
            after: before,
            rates: Vec::new(),
            last: None,
        }
    }

    /// Adds the newest sample, if it is a new one.
    fn follow(&mut self, side: &Side) {
        let channel = &side.node.channel;
        let (Some((_, at)), Some(rate)) = (channel.filtered(), channel.measured_rate()) else {
            return;
        };
        let since = self.last.replace(at).map(|last| at.micros_since(last));
        if let Some(since_us) = since.filter(|since_us| *since_us > 0) {
            self.rates.push((rate.rad_s(), since_us as f64 * 1e-6));
        }
    }

    /// Its equations, with the verticals by a node's calibration and the best gains so far. The
    /// bias is that of both rests.
    ///
    /// Errors: a turn that shows nothing, or ends elsewhere.
    pub fn turn(&self, chain: &Chain, gains: [[f64; 3]; 3]) -> Result<Turn, FitError> {
        let mut sum = TurnSum::new(upright(chain, &self.before), gains);
        for (rate, dt_s) in &self.rates {
            let bias = |axis: usize| (self.before.rate[axis] + self.after.rate[axis]) / 2.0;
            sum.sample([0, 1, 2].map(|axis| rate[axis] - bias(axis)), *dt_s);
        }
        sum.finish(upright(chain, &self.after))
    }

    /// Mean of the part's temperature at both rests.
    pub fn temperature(&self) -> Temperature {
        let [before, after] = [&self.before, &self.after].map(|mean| mean.temperature.0);
        Temperature(before.midpoint(after))
    }
}

impl Bench {
    /// The turns from station to station, deg, in all three mounts.
    ///
    /// Errors: a silent node.
    pub(super) fn turn_in_all_mounts(
        &mut self,
        stations_deg: &[f64],
        step: &'static str,
    ) -> Result<[Vec<Turned>; 2], BenchError> {
        let mut turns = [Vec::new(), Vec::new()];
        for mount in [Mount::X, Mount::Y, Mount::Z] {
            self.mount(mount, 0.0, 0.0);
            self.turn_between_rests(stations_deg, step, &mut turns)?;
        }
        self.mount(Mount::X, 0.0, 0.0);
        Ok(turns)
    }

    /// All turns of one mount.
    fn turn_between_rests(
        &mut self,
        stations_deg: &[f64],
        step: &'static str,
        turns: &mut [Vec<Turned>; 2],
    ) -> Result<(), BenchError> {
        let Some((first, others)) = stations_deg.split_first() else {
            return Ok(());
        };
        self.turn_to(*first, SPEED_DEG_S, SETTLE_S);
        let mut before = self.rest(step)?;
        for station_deg in others {
            let mut turned = before.map(Turned::from);
            self.follow_turn(*station_deg, &mut turned);
            before = self.rest(step)?;
            for ((turns, mut turned), after) in turns.iter_mut().zip(turned).zip(before) {
                turned.after = after;
                turns.push(turned);
            }
        }
        Ok(())
    }

    /// Turns the motor there, sample by sample, until its ringing has faded.
    fn follow_turn(&mut self, station_deg: f64, turned: &mut [Turned; 2]) {
        let arrival_s = self.rig.command(station_deg, SPEED_DEG_S).unwrap_or(0.0);
        let ends_s = arrival_s + SETTLE_S;
        while self.instrument.time_s() < ends_s {
            let motion = self.rig.step(self.instrument.time_s() + TICK_S);
            self.instrument.tick(&motion);
            for (turned, side) in turned.iter_mut().zip(&self.instrument.sides) {
                turned.follow(side);
            }
        }
    }

    fn rest(&mut self, step: &'static str) -> Result<[Mean; 2], BenchError> {
        let Self {
            instrument, rig, ..
        } = self;
        mean_of_both(instrument, rig, 0.0, MEAN_S, step)
    }
}

/// The vertical that a mean acceleration shows by a chain's calibration, of length 1.
fn upright(chain: &Chain, mean: &Mean) -> [f64; 3] {
    let filtered = Filtered {
        accel: mean.accel.map(|a| a.round() as i32),
    };
    let model = &chain.calibration.temperature;
    let compensated = model.apply(filtered, mean.temperature);
    let accel = match &chain.calibration.correction {
        Correction::TwoAxis { vector, .. } | Correction::OneAxis { vector, .. } => {
            vector.get().apply(compensated).accel
        }
        Correction::Tables { .. } => compensated.accel,
    };
    let accel = accel.map(f64::from);
    let length = accel.iter().map(|a| a * a).sum::<f64>().sqrt();
    accel.map(|a| a / length)
}
