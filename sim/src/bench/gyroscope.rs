//! The calibration of the gyroscopes: bias in the chamber, scale and axes by turns of the motor.
//!
//! In: an instrument whose accelerometers are calibrated, and the bias over temperature from the
//! chamber. Out: each node's [`RateCorrection`], set in its calibration, and a
//! [`GyroscopeReport`]. The reference is gravity as the node's own accelerometer shows it before
//! and after each turn; how far the motor says it has turned takes no part.
//!
//! The motor turns the housing in three mounts, so about each of its axes, from rest to rest by 90
//! and by 180 deg. In the third mount, on edge, it turns about z: without it a slewing machine
//! would tilt the vertical by what z has of the level axes.
//!
//! Left out: what the scale does over temperature and under acceleration.

use instant::Instant;
use tilt::calibration::FitError;
use tilt::calibration::gyroscope::{
    Accuracy, EARTH_RATE, FittedBias, FittedGains, GainFit, TurnSum, correction,
};
use tilt::chain::{Chain, Correction};
use tilt::composition::Place;
use tilt::filter::Filtered;
use tilt::rate::RateCorrection;

use super::characterise::{Mean, mean_of_both};
use super::{Bench, BenchError, Mode};
use crate::TICK_S;
use crate::instrument::Side;
use crate::motion::Mover;
use crate::rig::Mount;

/// Where the motor rests in each mount, deg: turns of 90 and 180 deg, to and fro, and nowhere back
/// to where one began.
const STATIONS_DEG: [f64; 8] = [-90.0, 0.0, 90.0, -90.0, 45.0, -45.0, 90.0, 0.0];

/// Speed of the turns, deg/s: that of the paper's swing.
const SPEED_DEG_S: f64 = 80.0;

/// How long the motor rests before a mean is taken, s: the ringing fades, the filter follows.
const SETTLE_S: f64 = 0.7;

/// Length of a mean, s.
const MEAN_S: f64 = 1.0;

/// What the turns are known to: the vertical to 0.02 deg, noise of 5 mdps per root of Hz, and the
/// bias of the rest before the turn, to which the earth adds.
const ACCURACY: Accuracy = Accuracy {
    vertical: 0.02 * DEGREE,
    noise: 0.005 * DEGREE,
    bias: 2.0 * EARTH_RATE,
};

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// The largest standard uncertainty of a gain.
const LARGEST: f64 = 0.001;

const STEP: &str = "gyroscope calibration";

/// How the calibration of a gyroscope went, for one node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroscopeReport {
    /// Bias over temperature, with its uncertainty.
    pub bias: FittedBias,
    /// Scale and axes, with their uncertainties.
    pub gains: FittedGains,
}

/// One node's gyroscope on the motor.
struct Turned {
    bias: FittedBias,
    /// Sum over the rests of what was read above the bias of the chamber, rad/s.
    above: [f64; 3],
    rests: f64,
    fit: GainFit,
}

/// A turn that goes on, of one node.
struct Going {
    sum: TurnSum,
    /// What the node read at rest before it, rad/s.
    rest: [f64; 3],
    last: Option<Instant>,
}

impl Going {
    /// Adds the newest sample, if it is a new one.
    fn follow(&mut self, side: &Side) {
        let channel = &side.node.channel;
        let (Some((_, at)), Some(rate)) = (channel.filtered(), channel.measured_rate()) else {
            return;
        };
        let since = self.last.replace(at).map(|last| at.micros_since(last));
        if let Some(since_us) = since.filter(|since_us| *since_us > 0) {
            let rate = rate.rad_s();
            let rate = [0, 1, 2].map(|axis| rate[axis] - self.rest[axis]);
            self.sum.sample(rate, since_us as f64 * 1e-6);
        }
    }
}

impl Bench {
    /// Calibrates both gyroscopes by turns of the motor; nothing where the mode has none.
    ///
    /// Errors: a fit that is refused, a silent node.
    pub fn calibrate_gyroscopes(&mut self) -> Result<Option<[GyroscopeReport; 2]>, BenchError> {
        let (Mode::Dynamic, Some(biases)) = (self.mode, self.biases) else {
            return Ok(None);
        };
        let mut turned = biases.map(|bias| Turned {
            bias,
            above: [0.0; 3],
            rests: 0.0,
            fit: GainFit::new(ACCURACY),
        });
        for mount in [Mount::X, Mount::Y, Mount::Z] {
            self.mount(mount, 0.0, 0.0);
            self.turn_between_rests(&mut turned)?;
        }
        self.mount(Mount::X, 0.0, 0.0);
        let mut reports = Vec::new();
        for (node, turned) in turned.iter().enumerate() {
            let (report, rates) = finish(turned).map_err(|error| BenchError::Fit {
                step: STEP,
                node: node + 1,
                error,
            })?;
            self.instrument.sides[node].settings.chain.calibration.rates = Some(rates);
            reports.push(report);
        }
        Ok(reports.try_into().ok())
    }

    /// All turns of one mount.
    fn turn_between_rests(&mut self, turned: &mut [Turned; 2]) -> Result<(), BenchError> {
        let [first, others @ ..] = STATIONS_DEG;
        self.turn_to(first, SPEED_DEG_S, SETTLE_S);
        let mut before = self.rest()?;
        for station_deg in others {
            let mut going = [0, 1].map(|node| {
                let mean = &before[node];
                Going {
                    sum: TurnSum::new(self.vertical(node, mean), turned[node].fit.present()),
                    rest: mean.rate,
                    last: None,
                }
            });
            self.follow_turn(station_deg, &mut going);
            let after = self.rest()?;
            for node in 0..2 {
                let turned = &mut turned[node];
                let end = self.vertical(node, &after[node]);
                let turn = going[node].sum.finish(end);
                turned.fit.add(&turn.map_err(|error| BenchError::Fit {
                    step: STEP,
                    node: node + 1,
                    error,
                })?);
                let chamber = turned.bias.at(before[node].temperature);
                let above = before[node].rate.iter().zip(chamber);
                for (sum, (rate, chamber)) in turned.above.iter_mut().zip(above) {
                    *sum += rate - chamber;
                }
                turned.rests += 1.0;
            }
            before = after;
        }
        Ok(())
    }

    /// Turns the motor there, sample by sample, until its ringing has faded.
    fn follow_turn(&mut self, station_deg: f64, going: &mut [Going; 2]) {
        let arrival_s = self.rig.command(station_deg, SPEED_DEG_S).unwrap_or(0.0);
        let ends_s = arrival_s + SETTLE_S;
        while self.instrument.time_s() < ends_s {
            let motion = self.rig.step(self.instrument.time_s() + TICK_S);
            self.instrument.tick(&motion);
            for (going, side) in going.iter_mut().zip(&self.instrument.sides) {
                going.follow(side);
            }
        }
    }

    fn rest(&mut self) -> Result<[Mean; 2], BenchError> {
        let Self {
            instrument, rig, ..
        } = self;
        mean_of_both(instrument, rig, 0.0, MEAN_S, STEP)
    }

    /// The vertical that a node's accelerometer shows, of length 1.
    fn vertical(&self, node: usize, mean: &Mean) -> [f64; 3] {
        upright(&self.instrument.sides[node].settings.chain, mean)
    }
}

/// The direction of a mean acceleration by a chain's calibration.
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

fn finish(turned: &Turned) -> Result<(GyroscopeReport, RateCorrection), FitError> {
    let gains = turned.fit.solve_all(LARGEST)?;
    let mut bias = turned.bias;
    for (bias, above) in bias.bias.iter_mut().zip(turned.above) {
        *bias += above / turned.rests.max(1.0);
    }
    let rates = correction(&bias, &gains)?;
    Ok((GyroscopeReport { bias, gains }, rates))
}
