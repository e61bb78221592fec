//! Turns of a motor, from rest to rest, for the gyroscopes of an instrument that has them.
//!
//! In: a session whose nodes have a new accelerometer's calibration, and a motor. Out: what has
//! come of it for each node, with the new correction in those nodes that have one. A node whose
//! gyroscope is refused keeps the correction that it had.
//!
//! The motor turns about one axis at a time, which turns the housing about its x or y and never
//! about z. Turns with the other axis tilted show z too, on a table that turns so; one that refuses
//! leaves z as it was before.
//!
//! Left out: the fit (`gains`), and turns by hand (`by_hand`).

use super::by_motor::{Kind, level, still, turn};
use super::error::CalibrateError;
use super::gains::{Demand, Outcome, Refused, Rest, solve};
use super::motor::{Axis, Motor};
use super::reading::Reading;
use super::scpi::DeviceError;
use super::session::{Session, decode, encode};
use super::turned::Log;

/// Where the motor rests on each axis, deg: turns of 90 and 180 deg, to and fro, and nowhere back
/// to where one began.
const STATIONS_DEG: [f64; 9] = [-90.0, 0.0, 90.0, -90.0, 45.0, -45.0, 90.0, -90.0, 0.0];

/// With the other axis tilted by [`TILT_DEG`].
const TILTED_DEG: [f64; 5] = [-TILT_DEG, TILT_DEG, -TILT_DEG, TILT_DEG, 0.0];
const TILT_DEG: f64 = 35.0;

/// Where turns end that check the fit, deg.
const CHECKS_DEG: [f64; 4] = [60.0, -75.0, 30.0, 0.0];

/// Readings of a rest: 1.2 s.
const READINGS: u32 = 40;

/// Settling of a rest, s.
const SETTLE_S: f64 = 0.7;

/// Fewest turns that go into the fit, of some 28.
const FEWEST: usize = 14;

/// Standard uncertainty of the accelerometer's vertical but for what its fit leaves, deg.
pub const VERTICAL_DEG: f64 = 0.02;

/// How often a node with its new correction is asked for an angle, which its estimator has to find.
const TRIES: usize = 5;

/// A motor with what is told while it turns.
pub struct Turns<'a> {
    /// The nodes.
    pub session: &'a mut Session,
    /// The motor.
    pub motor: &'a mut Motor,
    /// Where live figures go, a line each.
    pub tell: &'a dyn Fn(&str),
    /// Of each node what the fit of its accelerometer leaves, deg rms.
    pub residual_deg: &'a [f64],
}

impl Turns<'_> {
    /// Turns, fits, writes; nothing where the nodes have no gyroscope.
    ///
    /// Errors: those of motor and nodes; a gyroscope that is refused is none.
    pub fn calibrate(&mut self, kind: Kind) -> Result<Option<Vec<Outcome>>, CalibrateError> {
        if kind != Kind::TwoAxis || !self.session.begin_to_follow()? {
            return Ok(None);
        }
        (self.tell)("turns for the gyroscopes");
        let turned = self.turn_all();
        let logs = self.session.end_to_follow();
        let rests = turned?;
        let demand = |place: usize| Demand {
            vertical_deg: self.residual_deg[place].hypot(VERTICAL_DEG),
            fewest: FEWEST,
            shown: [true, true, false],
        };
        solve_all(self.session, &logs, &rests, demand, self.tell).map(Some)
    }

    /// All rests, each of all nodes, the motor at 0 at the end.
    fn turn_all(&mut self) -> Result<Vec<Vec<Rest>>, CalibrateError> {
        level(self.session, self.motor, &[Axis::X, Axis::Y])?;
        let mut rests = vec![rest(self.session, false)?];
        for axis in [Axis::X, Axis::Y] {
            self.visit(axis, &STATIONS_DEG, false, &mut rests)?;
        }
        for (tilted, axis) in [(Axis::Y, Axis::X), (Axis::X, Axis::Y)] {
            self.visit(tilted, &[TILT_DEG], false, &mut rests)?;
            let done = self.visit(axis, &TILTED_DEG, false, &mut rests);
            if let Err(CalibrateError::Device(DeviceError::Refused(..))) = done {
                (self.tell)("  the motor does not turn both axes at once: axis z stays as it was");
                level(self.session, self.motor, &[Axis::X, Axis::Y])?;
                break;
            }
            done?;
            self.visit(tilted, &[0.0], false, &mut rests)?;
        }
        for axis in [Axis::X, Axis::Y] {
            self.visit(axis, &CHECKS_DEG, true, &mut rests)?;
        }
        Ok(rests)
    }

    fn visit(
        &mut self,
        axis: Axis,
        stations_deg: &[f64],
        checks: bool,
        rests: &mut Vec<Vec<Rest>>,
    ) -> Result<(), CalibrateError> {
        for deg in stations_deg {
            turn(self.session, self.motor, axis, *deg)?;
            rests.push(rest(self.session, checks)?);
            (self.tell)(&format!(
                "turn {}: slope {} to {deg} deg",
                rests.len() - 1,
                axis.letter()
            ));
        }
        Ok(())
    }
}

/// All nodes at rest, followed meanwhile.
///
/// Errors: a housing that shakes, and those of the nodes.
fn rest(session: &mut Session, checks: bool) -> Result<Vec<Rest>, CalibrateError> {
    session.settle(SETTLE_S)?;
    let read = |session: &mut Session| still(session, 0.0, READINGS, "between two turns");
    Ok(followed(session, checks, read)?.1)
}

/// What all nodes read, and where their gyroscopes stood meanwhile: one rest of each node that is
/// followed.
///
/// Errors: those of the nodes, and of `read`.
pub fn followed(
    session: &mut Session,
    checks: bool,
    read: impl FnOnce(&mut Session) -> Result<Vec<Reading>, CalibrateError>,
) -> Result<(Vec<Reading>, Vec<Rest>), CalibrateError> {
    let gaps = (0..session.followed()).map(|place| session.gaps(place));
    let gaps = gaps.collect::<Result<Vec<u16>, _>>()?;
    let from = session.marks()?;
    let readings = read(session)?;
    let marks = from.into_iter().zip(session.marks()?).zip(gaps);
    let all = readings.iter().zip(marks);
    let rests = all.map(|(reading, ((from, to), gaps))| Rest {
        reading: reading.clone(),
        marks: [from, to],
        gaps,
        checks,
    });
    let rests = rests.collect();
    Ok((readings, rests))
}

/// Fits and writes each node from its log and its place's rests, and tells what has come of it.
///
/// Errors: those of the nodes.
pub fn solve_all(
    session: &mut Session,
    logs: &[Log],
    rests: &[Vec<Rest>],
    demand: impl Fn(usize) -> Demand,
    tell: &dyn Fn(&str),
) -> Result<Vec<Outcome>, CalibrateError> {
    let mut outcomes = Vec::new();
    for (place, log) in logs.iter().enumerate() {
        let rests: Vec<Rest> = rests.iter().map(|rest| rest[place].clone()).collect();
        outcomes.push(fit_and_write(session, place, |calibration, period_s| {
            solve(calibration, period_s, log, &rests, &demand(place))
        })?);
    }
    tell_outcomes(session, &outcomes, tell);
    Ok(outcomes)
}

/// Fits a node by the calibration that it has now, and writes what was found. The angle that it
/// gives then decides; without one it has the calibration of before again.
///
/// Errors: those of the nodes.
fn fit_and_write(
    session: &mut Session,
    place: usize,
    solve: impl FnOnce(&tilt::chain::Calibration, f64) -> Outcome,
) -> Result<Outcome, CalibrateError> {
    let id = session.nodes[place].id;
    let before = session.calibration(place)?;
    let mut calibration = decode(&before).ok_or(CalibrateError::Undecodable(id))?;
    let mut outcome = solve(&calibration, session.nodes[place].period_s);
    let Ok(found) = &outcome.found else {
        return Ok(outcome);
    };
    calibration.rates = Some(found.rates);
    session.write(place, &encode(&calibration))?;
    let mut reason = 0;
    for _ in 0..TRIES {
        session.settle(SETTLE_S)?;
        let readings = session.read(1, 0.0)?;
        match readings[place].angle_deg {
            [Ok(_), Ok(_)] => return Ok(outcome),
            [Err(no_angle), _] | [_, Err(no_angle)] => reason = no_angle,
        }
    }
    session.write(place, &before)?;
    outcome.found = Err(Refused::NoAngle(reason));
    Ok(outcome)
}

/// A line for each turn that cannot be used, and one for each gyroscope.
fn tell_outcomes(session: &Session, outcomes: &[Outcome], tell: &dyn Fn(&str)) {
    for (node, outcome) in session.nodes.iter().zip(outcomes) {
        let letter = node.letter();
        for (number, reason) in &outcome.bad {
            tell(&format!(
                "  channel {letter}, turn {number} is left out: {reason}"
            ));
        }
        tell(&match &outcome.found {
            Ok(found) => format!(
                "gyroscope of channel {letter}: {} turns, {:.3} deg left",
                outcome.used, found.gains.residual_rms_deg
            ),
            Err(refused) => {
                format!("gyroscope of channel {letter} keeps the correction it had: {refused}")
            }
        });
    }
}
