//! Calibration by a motor: sweep, fit or tables, write, verification round.
//!
//! In: a session and a motor. Out: what was found and what was left, for the report. Each slope is
//! swept upwards and downwards for a fit on the host, so that the motor's error by direction
//! averages out; for the paper's tables upwards only, in its own steps.
//!
//! Left out: judging the result, and giving back the old calibration (`run`).

use std::time::Duration;

use device::calibration::motor::Command;
use tilt::chain::Correction;
use tilt::table::Rule;

use super::error::CalibrateError;
use super::finish::NODES;
use super::fit::{self, Fitted, Stand};
use super::motor::{Axis, Motor};
use super::reading::Reading;
use super::session::{Session, encode};

/// Settling after the motor has stopped, s: that of the filter, and of what rings.
pub const SETTLE_S: f64 = 0.4;

/// The same in paper mode, whose filter is of 2 Hz.
const SETTLE_PAPER_S: f64 = 1.0;

/// Readings of a stand.
const READINGS: u32 = 10;

/// How far apart readings are, s.
pub const APART_S: f64 = 0.03;

/// Scatter of a stand that is still one, mg.
pub const STILL_MG: f64 = 4.0;

/// How often a stand is tried before the housing counts as shaking.
const TRIES: usize = 4;

/// Angles of the verification round of a slope, deg: none of them on a step of whole degrees.
const SLOPE_CHECKS: [f64; 8] = [-77.5, -52.5, -27.5, -7.5, 7.5, 27.5, 52.5, 77.5];

/// The same of a turn.
const TURN_CHECKS: [f64; 10] = [
    -162.5, -127.5, -82.5, -52.5, -17.5, 17.5, 52.5, 82.5, 127.5, 162.5,
];

/// What a table may err between two of its points `step_deg` apart, deg, at the steepest angle of
/// the verification round; 0 for other corrections.
///
/// The nearest point is half a step away. A straight line between two points of a sine is off by
/// its sag, an eighth of the step's square times the tangent of the angle, in radians.
pub fn between_points_deg(correction: &Correction, step_deg: f64) -> f64 {
    let Correction::Tables { rule, .. } = correction else {
        return 0.0;
    };
    let steepest_deg = SLOPE_CHECKS.into_iter().fold(0.0, f64::max);
    match rule {
        Rule::Nearest | Rule::PrintedQuarter => step_deg / 2.0,
        Rule::Linear => {
            let sag = step_deg.to_radians().powi(2) / 8.0 * steepest_deg.to_radians().tan();
            sag.to_degrees()
        }
    }
}

/// What the nodes of an instrument are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Tables for each slope (the paper's mode).
    Tables,
    /// Two slopes by vector.
    TwoAxis,
    /// One angle of 360 deg by vector.
    OneAxis,
}

impl Kind {
    /// The kind that all nodes of a session share.
    ///
    /// Errors: [`CalibrateError::Request`].
    pub fn of(session: &Session) -> Result<Self, CalibrateError> {
        let mut kinds = session.nodes.iter().map(|node| node.kind);
        let first = kinds.next().ok_or(NODES)?;
        if kinds.any(|kind| kind != first) {
            return Err(CalibrateError::Request(
                "the nodes measure in different ways (2030h, 2062h sub 2): calibrate them one by \
                 one with --nodes",
            ));
        }
        Ok(match first {
            0 => Self::Tables,
            1 => Self::TwoAxis,
            _ => Self::OneAxis,
        })
    }

    /// The slopes that are calibrated.
    pub const fn axes(self) -> &'static [Axis] {
        match self {
            Self::OneAxis => &[Axis::X],
            Self::Tables | Self::TwoAxis => &[Axis::X, Axis::Y],
        }
    }

    /// Whole degrees between stands when nothing is said.
    pub const fn step(self) -> u32 {
        match self {
            Self::Tables => 1,
            Self::TwoAxis | Self::OneAxis => 5,
        }
    }

    /// Settling behind a movement, s.
    pub const fn settle_s(self) -> f64 {
        match self {
            Self::Tables => SETTLE_PAPER_S,
            Self::TwoAxis | Self::OneAxis => SETTLE_S,
        }
    }

    const fn checks(self) -> &'static [f64] {
        match self {
            Self::OneAxis => &TURN_CHECKS,
            Self::Tables | Self::TwoAxis => &SLOPE_CHECKS,
        }
    }

    /// Angles of a sweep: multiples of the step, from one end to the other. A turn stops short of
    /// its end, where +180 and -180 deg are the same.
    fn angles(self, step: u32) -> Vec<f64> {
        let step = i32::try_from(step.max(1)).unwrap_or(90);
        let end = match self {
            Self::OneAxis => 179,
            Self::Tables | Self::TwoAxis => 90,
        };
        let count = end / step;
        (-count..=count).map(|n| f64::from(n * step)).collect()
    }
}

/// What a round by motor has given.
#[derive(Debug)]
pub struct Swept {
    /// Stands of the sweep, with what the nodes read by the calibration found.
    pub found: Vec<Stand>,
    /// The fit of each node; none where the nodes made tables.
    pub fits: Vec<Fitted>,
    /// Stands of the verification round, with the calibration left.
    pub left: Vec<Stand>,
}

/// A motor with what is told while it turns.
pub struct Bench<'a> {
    /// The nodes.
    pub session: &'a mut Session,
    /// The motor.
    pub motor: &'a mut Motor,
    /// Where live residuals go, a line each.
    pub tell: &'a dyn Fn(&str),
    /// Standard uncertainty of the motor, deg.
    pub reference_deg: f64,
}

impl Bench<'_> {
    /// The whole of it: sweep, new calibration in the nodes, verification round.
    ///
    /// Errors: whatever goes wrong; the nodes may then hold something new.
    pub fn calibrate(&mut self, kind: Kind, step: u32) -> Result<Swept, CalibrateError> {
        level(self.session, self.motor, kind.axes())?;
        let (found, fits) = match kind {
            Kind::Tables => (self.make_tables(step)?, Vec::new()),
            Kind::TwoAxis | Kind::OneAxis => self.fit_and_write(kind, step)?,
        };
        (self.tell)("verification round");
        let mut left = Vec::new();
        for axis in kind.axes() {
            for deg in kind.checks() {
                left.push(self.stand(kind, *axis, *deg)?);
            }
            self.turn(*axis, 0.0)?;
        }
        Ok(Swept { found, fits, left })
    }

    fn fit_and_write(
        &mut self,
        kind: Kind,
        step: u32,
    ) -> Result<(Vec<Stand>, Vec<Fitted>), CalibrateError> {
        let mut found = Vec::new();
        let upwards = kind.angles(step);
        for axis in kind.axes() {
            let both_ways = upwards.iter().chain(upwards.iter().rev());
            for deg in both_ways {
                found.push(self.stand(kind, *axis, *deg)?);
            }
            self.turn(*axis, 0.0)?;
        }
        let mut fits = Vec::new();
        for (place, node) in self.session.nodes.iter().enumerate() {
            let fitted = fit::by_motor(&node.calibration, place, &found, self.reference_deg);
            fits.push(fitted.map_err(|error| CalibrateError::Fit(node.id, error))?);
        }
        for (place, fitted) in fits.iter().enumerate() {
            self.session.write(place, &encode(&fitted.calibration))?;
        }
        Ok((found, fits))
    }

    /// The paper's procedure: each node memorises its own table (2060h).
    fn make_tables(&mut self, step: u32) -> Result<Vec<Stand>, CalibrateError> {
        let nodes = self.session.nodes.len();
        let mut found = Vec::new();
        let made = (|| {
            for (axis, command) in [(Axis::X, Command::StartX), (Axis::Y, Command::StartY)] {
                (0..nodes).try_for_each(|place| self.session.run_command(place, command))?;
                for deg in Kind::Tables.angles(step) {
                    let stand = self.stand(Kind::Tables, axis, deg)?;
                    for place in 0..nodes {
                        self.session.memorise(place, stand.reference_deg)?;
                    }
                    found.push(stand);
                }
                self.turn(axis, 0.0)?;
            }
            for place in 0..nodes {
                self.session.nodes[place].changed = true;
                self.session.run_command(place, Command::Finish)?;
            }
            Ok(())
        })();
        if made.is_err() {
            for place in 0..nodes {
                // A node without an open run refuses, which is as well.
                let _ = self.session.run_command(place, Command::Abandon);
            }
        }
        made.map(|()| found)
    }

    fn turn(&mut self, axis: Axis, deg: f64) -> Result<(), CalibrateError> {
        turn(self.session, self.motor, axis, deg)
    }

    /// Turns, waits for a standstill, reads.
    fn stand(&mut self, kind: Kind, axis: Axis, deg: f64) -> Result<Stand, CalibrateError> {
        self.turn(axis, deg)?;
        let reference_deg = self.motor.position_deg(axis)?;
        let at = format!("at slope {} of {deg} deg", axis.letter());
        let readings = still(self.session, kind.settle_s(), READINGS, &at)?;
        let stand = Stand {
            axis,
            reference_deg,
            readings,
        };
        (self.tell)(&live(&stand, self.session));
        Ok(stand)
    }
}

/// Turns a motor; what passes on the bus meanwhile is heard, Ctrl-C included.
///
/// Errors: those of the motor, a lost bus, and [`CalibrateError::Interrupted`].
pub fn turn(
    session: &mut Session,
    motor: &mut Motor,
    axis: Axis,
    deg: f64,
) -> Result<(), CalibrateError> {
    let turned = session.meanwhile(Duration::ZERO, |wait| motor.turn(axis, deg, wait))?;
    Ok(turned?)
}

/// Takes these axes to their stop: a run that was cut may have left one of them turned.
///
/// Errors: see [`turn`].
pub fn level(
    session: &mut Session,
    motor: &mut Motor,
    axes: &[Axis],
) -> Result<(), CalibrateError> {
    let mut axes = axes.iter();
    axes.try_for_each(|axis| turn(session, motor, *axis, 0.0))
}

/// Means of `count` readings of a housing that stands still, `settle_s` behind a movement. `at`
/// names where it stands.
///
/// Errors: [`CalibrateError::Restless`] when it goes on shaking, and those of the nodes.
pub fn still(
    session: &mut Session,
    settle_s: f64,
    count: u32,
    at: &str,
) -> Result<Vec<Reading>, CalibrateError> {
    let mut restless = None;
    for _ in 0..TRIES {
        session.settle(settle_s)?;
        let readings = session.read(count, APART_S)?;
        let worst = readings.iter().map(|r| r.scatter_mg).enumerate();
        let worst = worst.reduce(|a, b| if b.1 > a.1 { b } else { a });
        match worst {
            Some((place, mg)) if mg > STILL_MG => restless = Some((place, mg)),
            _ => return Ok(readings),
        }
    }
    let (place, mg) = restless.unwrap_or_default();
    let node = session.nodes[place].id;
    Err(CalibrateError::Restless(node, at.to_owned(), mg))
}

/// A line about a stand: what each channel reads less the reference.
fn live(stand: &Stand, session: &Session) -> String {
    let mut line = format!(
        "slope {} {:8.3} deg:",
        stand.axis.letter(),
        stand.reference_deg
    );
    for (place, node) in session.nodes.iter().enumerate() {
        line += &match stand.error_deg(place) {
            Ok(error) => format!("  {} {error:+.3} deg", node.letter()),
            Err(reason) => format!("  {} no angle (reason {reason})", node.letter()),
        };
    }
    line
}

/// The largest scatter of the stands' readings of a node, mg.
pub fn scatter_mg(stands: &[Stand], node: usize) -> f64 {
    fit::rms(stands.iter().map(|stand| stand.readings[node].scatter_mg))
}

/// Standard uncertainty of a mean of a stand's readings by their scatter, deg.
pub fn mean_uncertainty_deg(stands: &[Stand], node: usize) -> f64 {
    // One axis of three, and the readings as independent.
    let one_axis_mg = scatter_mg(stands, node) / 3f64.sqrt();
    (one_axis_mg / 1000.0 / f64::from(READINGS).sqrt()).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_angle_of_the_verification_round_is_one_of_a_sweep() {
        for kind in [Kind::Tables, Kind::TwoAxis, Kind::OneAxis] {
            for step in 1..=45 {
                let swept = kind.angles(step);
                assert!(kind.checks().iter().all(|check| !swept.contains(check)));
                assert!(swept.len() % 2 == 1 && swept.contains(&0.0));
            }
        }
        assert_eq!(Kind::Tables.angles(1).len(), 181);
    }
}
