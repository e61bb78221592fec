//! The turns between the rests of a dwell, as a gyroscope followed them, short enough for a file.
//!
//! In: the rests of a dwell with the logs of the gyroscopes. Out: for each turn and channel the
//! readings of the accelerometer before and after it and what the rates came to between, or why it
//! could not be followed. The vertical takes no part in these numbers, so that the accelerometer's
//! temperature model may be found later.
//!
//! Left out: the fit (`scale`), and who turns (`stands`, `run`).

use serde::{Deserialize, Serialize};
use tilt::ONE_G;
use tilt::calibration::gyroscope::{Rotation, Turn};
use tilt::chain::Calibration;
use tilt::rate::RateCorrection;

use crate::gains::{BadTurn, Rest, rotation, upright, way};
use crate::session::Node;
use crate::turned::Log;

/// Numbers of a rotation are kept to so many parts of one: 1e-9.
const PARTS: f64 = 1e9;

/// A turn of one channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Followed {
    /// It was followed.
    Turned(Box<Turned>),
    /// It was not.
    LeftOut {
        /// Why.
        left_out: String,
    },
}

/// What one channel measured of a turn. The gains are those of its calibration as found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Turned {
    /// Mean acceleration in the sensor's axes at the rest before.
    pub before_g: [f64; 3],
    /// The same at the rest after it.
    pub after_g: [f64; 3],
    /// What the sensor told of its temperature, mean of both rests.
    pub turn_degc: f64,
    /// How long it took, by the node's samples.
    pub duration_s: f64,
    /// The way, summed over the axes.
    pub way_rad: f64,
    /// From the axes of the housing at the start to those at the end.
    pub frame: [[f64; 3]; 3],
    /// How the gains turn the start: housing axis by sensor axis, a vector each.
    pub by_gain_rad: [[[f64; 3]; 3]; 3],
}

/// The gains that the rates of a turn are taken with: those that a node was found with.
fn gains(rates: Option<&RateCorrection>) -> [[f64; 3]; 3] {
    rates.unwrap_or(&RateCorrection::IDENTITY).real().matrix
}

/// The turns between these rests, by turn and channel.
pub fn followed(nodes: &[Node], logs: &[Log], rests: &[Vec<Rest>]) -> Vec<Vec<Followed>> {
    let turn = |pair: &[Vec<Rest>]| {
        let rests = pair[0].iter().zip(&pair[1]);
        let channels = nodes.iter().zip(logs).zip(rests);
        let one = |((node, log), (from, to)): ((&Node, &Log), (&Rest, &Rest))| {
            let gains = gains(node.calibration.rates.as_ref());
            let turned = Turned::new(log, node.period_s, gains, from, to);
            match turned {
                Ok(turned) => Followed::Turned(Box::new(turned)),
                Err(bad) => Followed::LeftOut {
                    left_out: bad.to_string(),
                },
            }
        };
        channels.map(one).collect()
    };
    rests.windows(2).map(turn).collect()
}

impl Followed {
    /// Whether each of its numbers is one.
    pub fn is_finite(&self) -> bool {
        let Self::Turned(turned) = self else {
            return true;
        };
        let matrices = turned.frame.iter().chain(turned.by_gain_rad.as_flattened());
        let vectors = matrices.chain([&turned.before_g, &turned.after_g]);
        let single = [turned.turn_degc, turned.duration_s, turned.way_rad];
        let mut numbers = vectors.flatten().chain(&single);
        numbers.all(|number| number.is_finite())
    }
}

impl Turned {
    /// The turn from one rest to the next with these gains.
    ///
    /// Errors: why it could not be followed.
    pub fn new(
        log: &Log,
        period_s: f64,
        gains: [[f64; 3]; 3],
        from: &Rest,
        to: &Rest,
    ) -> Result<Self, BadTurn> {
        let way = way(log, period_s, from, to)?;
        let Rotation {
            frame,
            sums,
            way: way_rad,
            duration_s,
            ..
        } = rotation(&way, gains);
        let accel_g = |rest: &Rest| rest.reading.accel.map(|a| a / f64::from(ONE_G));
        let temperatures = from.reading.temperature_c + to.reading.temperature_c;
        Ok(Self {
            before_g: accel_g(from),
            after_g: accel_g(to),
            turn_degc: temperatures / 2.0,
            duration_s: rounded(duration_s),
            way_rad: rounded(way_rad),
            frame: frame.map(|row| row.map(rounded)),
            by_gain_rad: sums.map(|row| row.map(|sum| sum.map(rounded))),
        })
    }

    /// The equations of the turn, with the verticals by this calibration; its gyroscope was found
    /// with the correction `before`.
    ///
    /// Errors: a turn that shows nothing, or ends elsewhere.
    pub fn turn(
        &self,
        calibration: &Calibration,
        before: &RateCorrection,
    ) -> Result<Turn, BadTurn> {
        let rotation = Rotation {
            gains: gains(Some(before)),
            frame: self.frame,
            sums: self.by_gain_rad,
            way: self.way_rad,
            duration_s: self.duration_s,
        };
        let [before, after] = [self.before_g, self.after_g].map(|accel_g| {
            let accel = accel_g.map(|g| g * f64::from(ONE_G));
            upright(calibration, accel, self.turn_degc)
        });
        Ok(rotation.between(before, after)?)
    }
}

fn rounded(number: f64) -> f64 {
    (number * PARTS).round() / PARTS
}
