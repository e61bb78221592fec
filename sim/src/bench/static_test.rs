//! The static test (R16): the motor stands at known angles and both nodes are read.
//!
//! In: a calibrated instrument, a mount, a list of angles. Out: a [`StaticPoint`] per angle with
//! the truth and what both nodes said. In product mode a reading is one
//! sample, as a user would take it; in paper mode it is a mean (assumption A4).
//!
//! Erratum E5: on knots of the table (10 deg steps of a 1 deg table) the paper's table error does
//! not show, so the test is run on random angles as well, and both are reported.

use tilt::angle::{Angle, Axes};
use tilt::chain::Measurement;
use tilt::cross_check::THRESHOLD;
use tilt::filter::Filtered;

use super::calibrate::STEP_S;
use super::characterise::{Mean, mean_of_both};
use super::statistics::Tally;
use super::{Bench, Mode};
use crate::rig::Mount;

/// What one node said at one angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodePoint {
    /// The reading, deg; absent when the node had none.
    pub angle_deg: Option<f64>,
    /// Its standard uncertainty, deg.
    pub uncertainty_deg: f64,
    /// Reading minus truth, deg, the short way round.
    pub error_deg: f64,
}

/// Both nodes at one angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StaticPoint {
    /// True angle of the shaft, deg.
    pub truth_deg: f64,
    /// Node 1 and node 2.
    pub nodes: [NodePoint; 2],
    /// Node 1 minus node 2, deg, where both measured.
    pub delta_deg: Option<f64>,
    /// Whether they differed by more than the 0.40 deg of R12.
    pub warning: bool,
}

/// R16: -90 to 90 deg in steps of 10.
pub fn knots() -> Vec<f64> {
    (-9..=9).map(|i| f64::from(i) * 10.0).collect()
}

impl Bench {
    /// Random angles between -`range_deg` and `range_deg`.
    pub fn random_angles(&mut self, count: usize, range_deg: f64) -> Vec<f64> {
        (0..count)
            .map(|_| self.rng.range(-range_deg, range_deg))
            .collect()
    }

    /// Stands at each of `angles_deg` in turn and reads both nodes.
    pub fn static_test(&mut self, mount: Mount, angles_deg: &[f64]) -> Vec<StaticPoint> {
        angles_deg
            .iter()
            .map(|&angle_deg| {
                self.turn_to(angle_deg, 80.0, STEP_S);
                self.static_reading(mount)
            })
            .collect()
    }

    /// What the instrument should show where the shaft stands: the shaft's angle, and for a slope,
    /// which has nothing beyond the vertical, what is left of it on this side.
    fn truth_deg(&self) -> f64 {
        let shaft_deg = self.rig.shaft().true_deg;
        if self.mode != Mode::OneAxis && shaft_deg.abs() > 90.0 {
            shaft_deg.signum() * (180.0 - shaft_deg.abs())
        } else {
            shaft_deg
        }
    }

    /// One reading of both nodes where the shaft stands, as the mode takes it.
    pub fn static_reading(&mut self, mount: Mount) -> StaticPoint {
        self.static_reading_over(mount, self.read_over_s())
    }

    /// How long the mode averages a reading at standstill, s; 0 is one sample.
    pub(super) fn read_over_s(&self) -> f64 {
        match self.mode {
            Mode::Paper => self.paper.read_over_s,
            Mode::Product | Mode::Dynamic | Mode::OneAxis => 0.0,
        }
    }

    /// Turns to `angle_deg` and takes one reading of one sample, whatever the mode averages.
    pub fn single_reading(&mut self, mount: Mount, angle_deg: f64) -> StaticPoint {
        self.turn_to(angle_deg, 80.0, STEP_S);
        self.static_reading_over(mount, 0.0)
    }

    /// One reading of both nodes, of their mean acceleration over `mean_s`; of one sample where
    /// that is 0.
    ///
    /// A node that gives no samples has no reading.
    pub(super) fn static_reading_over(&mut self, mount: Mount, mean_s: f64) -> StaticPoint {
        let truth_deg = self.truth_deg();
        let readings = if mean_s > 0.0 {
            let Self {
                instrument, rig, ..
            } = self;
            match mean_of_both(instrument, rig, 0.0, mean_s, "static test") {
                Ok(means) => [0, 1].map(|node| self.of_mean(node, &means[node], mount)),
                Err(_) => [None; 2],
            }
        } else {
            let pair = self.instrument.sync();
            pair.readings.map(|r| of_axis(r, mount).ok().map(one))
        };
        StaticPoint::new(truth_deg, readings)
    }

    /// Angle and standard uncertainty of a mean acceleration, deg.
    fn of_mean(&self, node: usize, mean: &Mean, mount: Mount) -> Option<(f64, f64)> {
        let filtered = Filtered {
            accel: mean.accel.map(|a| a.round() as i32),
        };
        let chain = &self.instrument.sides[node].settings.chain;
        let found = of_axis(chain.evaluate(filtered, mean.temperature), mount).ok()?;
        Some((found.angle.degrees(), found.unshared.degrees()))
    }
}

/// What the mount turns, of both slopes.
pub(super) fn of_axis<T>(axes: Axes<T>, mount: Mount) -> T {
    match mount {
        Mount::X | Mount::Z => axes.x,
        Mount::Y => axes.y,
    }
}

fn one(m: Measurement) -> (f64, f64) {
    (m.angle.degrees(), m.uncertainty.degrees())
}

impl StaticPoint {
    /// Of the truth and, for each node, angle and standard uncertainty, all in deg.
    fn new(truth_deg: f64, readings: [Option<(f64, f64)>; 2]) -> Self {
        let nodes = readings.map(|reading| NodePoint {
            angle_deg: reading.map(|(angle_deg, _)| angle_deg),
            uncertainty_deg: reading.map_or(f64::NAN, |(_, uncertainty_deg)| uncertainty_deg),
            error_deg: reading.map_or(f64::NAN, |(angle_deg, _)| wrap(angle_deg - truth_deg)),
        });
        let delta_deg = match readings {
            [Some((a, _)), Some((b, _))] => Some(wrap(a - b)),
            _ => None,
        };
        let threshold_deg = Angle(THRESHOLD as i32).degrees();
        Self {
            truth_deg,
            nodes,
            delta_deg,
            warning: delta_deg.is_some_and(|delta| delta.abs() > threshold_deg),
        }
    }
}

/// To -180..180 deg.
pub fn wrap(degrees: f64) -> f64 {
    degrees - 360.0 * (degrees / 360.0).round()
}

/// Errors of one node over a list of points.
pub fn errors(points: &[StaticPoint], node: usize) -> Tally {
    let mut tally = Tally::default();
    for point in points.iter().filter(|p| p.nodes[node].angle_deg.is_some()) {
        tally.add(point.nodes[node].error_deg);
    }
    tally
}

/// Size of the difference between the nodes over a list of points.
pub fn differences(points: &[StaticPoint]) -> Tally {
    let mut tally = Tally::default();
    points
        .iter()
        .filter_map(|p| p.delta_deg)
        .for_each(|d| tally.add(d.abs()));
    tally
}
