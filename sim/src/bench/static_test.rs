//! The static test (R16): the motor stands at known angles and both nodes are read.
//!
//! In: a calibrated instrument, a mount, a list of angles. Out: a [`StaticPoint`] per angle with
//! the truth and what both nodes said. One reading per angle, as a user would take it, no mean.
//!
//! Erratum E5: on knots of the table (10 deg steps of a 1 deg table) the paper's table error does
//! not show, so the test is run on random angles as well, and both are reported.

use tilt::chain::Measurement;
use tilt::cross_check::THRESHOLD;

use super::calibrate::STEP_S;
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

    /// What the instrument should say where the shaft stands: the shaft's angle, and for a slope,
    /// which has nothing beyond the vertical, what is left of it on this side.
    fn truth_deg(&self) -> f64 {
        let shaft_deg = self.rig.shaft().true_deg;
        if self.mode != Mode::OneAxis && shaft_deg.abs() > 90.0 {
            shaft_deg.signum() * (180.0 - shaft_deg.abs())
        } else {
            shaft_deg
        }
    }

    /// One reading of both nodes where the shaft stands.
    pub fn static_reading(&mut self, mount: Mount) -> StaticPoint {
        let truth_deg = self.truth_deg();
        let pair = self.instrument.sync();
        let axis = pair
            .readings
            .map(|r| if mount == Mount::X { r.x } else { r.y });
        let delta = pair.verdict.delta();
        let delta = if mount == Mount::X { delta.x } else { delta.y };
        let warning = delta.is_some_and(|d| d.magnitude() > THRESHOLD);
        StaticPoint {
            truth_deg,
            nodes: axis.map(|m| node_point(m.ok(), truth_deg)),
            delta_deg: delta.map(|d| d.degrees()),
            warning,
        }
    }
}

fn node_point(measurement: Option<Measurement>, truth_deg: f64) -> NodePoint {
    let angle_deg = measurement.map(|m| m.angle.degrees());
    NodePoint {
        angle_deg,
        uncertainty_deg: measurement.map_or(f64::NAN, |m| m.uncertainty.degrees()),
        error_deg: angle_deg.map_or(f64::NAN, |a| wrap(a - truth_deg)),
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
