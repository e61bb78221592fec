//! The orientations of a dwell, and the turns between them, by a motor.
//!
//! In: a session and a motor with two axes. Out: the readings of the four orientations that tell
//! offset from gain, and where gyroscopes are followed the rests between turns that show their
//! scale. Without gyroscopes the motor makes no turn more than the orientations need.
//!
//! A motor that turns one axis at a time never turns the housing about its z. With the other axis
//! tilted it does, on a table that turns so; one that refuses leaves z open.
//!
//! Left out: a person's turns (`run`), and what follows from them (`turns`, `scale`).

use crate::CalibrateError;
use crate::by_motor::{level, still, turn};
use crate::gains::Rest;
use crate::motor::{Axis, Motor};
use crate::reading::Reading;
use crate::scpi::DeviceError;
use crate::session::Session;
use crate::turns;

/// Readings of an orientation.
pub const READINGS: u32 = 20;

/// The angle of a tetrahedron's edge to the plane that halves it, deg.
const EDGE_DEG: f64 = 54.7356;

/// Four orientations of a motor that turns one of its two axes at a time: the corners of a regular
/// tetrahedron, in which each axis of the housing has the same variance of gravity's share, a third
/// of a g^2, and the mean of all is nothing. No four orientations tell offset from gain any better.
const BY_MOTOR: [(Axis, [f64; 2]); 2] = [
    (Axis::X, [180.0 - EDGE_DEG, EDGE_DEG - 180.0]),
    (Axis::Y, [EDGE_DEG, -EDGE_DEG]),
];

/// Where an axis rests while the other one is tilted by [`EDGE_DEG`], deg: both together stay
/// within 90 deg.
const TILTED_DEG: [f64; 3] = [-35.0, 35.0, 0.0];

/// What a dwell has given: readings of all nodes in each orientation, and where they rested while
/// their gyroscopes were followed.
#[derive(Debug, Default)]
pub struct Stood {
    /// By orientation.
    pub readings: Vec<Vec<Reading>>,
    /// By rest; none where gyroscopes are not followed.
    pub rests: Vec<Vec<Rest>>,
}

/// A motor on its way through a dwell.
pub struct Stands<'a> {
    /// The nodes.
    pub session: &'a mut Session,
    /// The motor, which turns two axes.
    pub motor: &'a mut Motor,
    /// Settling behind a movement, s.
    pub settle_s: f64,
    /// Whether gyroscopes are followed.
    pub followed: bool,
    /// Whether the motor turns an axis while the other one is tilted, as far as is known.
    pub tilts: &'a mut bool,
    /// Where a line goes.
    pub tell: &'a dyn Fn(&str),
}

impl Stands<'_> {
    /// All orientations, with the motor at 0 at the end.
    ///
    /// Errors: those of motor and nodes, and a housing that does not stand still.
    pub fn go(&mut self) -> Result<Stood, CalibrateError> {
        let mut stood = Stood::default();
        level(self.session, self.motor, &[Axis::X, Axis::Y])?;
        self.pause(&mut stood, "level")?;
        let [(x, about_x), (y, about_y)] = BY_MOTOR;
        for deg in about_x {
            self.orientation(x, deg, &mut stood)?;
        }
        if self.followed && *self.tilts {
            self.visit(x, -EDGE_DEG, &mut stood)?;
            self.tilted(y, &mut stood)?;
        }
        // Back to its stop: one axis rests while the other is turned.
        self.visit(x, 0.0, &mut stood)?;
        let [first, second] = about_y;
        self.orientation(y, first, &mut stood)?;
        if self.followed && *self.tilts {
            self.tilted(x, &mut stood)?;
        }
        self.orientation(y, second, &mut stood)?;
        self.visit(y, 0.0, &mut stood)?;
        Ok(stood)
    }

    fn turn(&mut self, axis: Axis, deg: f64) -> Result<(), CalibrateError> {
        turn(self.session, self.motor, axis, deg)
    }

    fn orientation(
        &mut self,
        axis: Axis,
        deg: f64,
        stood: &mut Stood,
    ) -> Result<(), CalibrateError> {
        self.turn(axis, deg)?;
        let readings = self.rest(stood, &at(axis, deg))?;
        stood.readings.push(readings);
        Ok(())
    }

    /// Turns, and rests there where gyroscopes are followed.
    fn visit(&mut self, axis: Axis, deg: f64, stood: &mut Stood) -> Result<(), CalibrateError> {
        self.turn(axis, deg)?;
        self.pause(stood, &at(axis, deg))
    }

    fn pause(&mut self, stood: &mut Stood, at: &str) -> Result<(), CalibrateError> {
        match self.followed {
            true => self.rest(stood, at).map(|_| ()),
            false => Ok(()),
        }
    }

    /// Turns an axis to and fro while the other one is tilted. A motor that refuses is level
    /// afterwards.
    fn tilted(&mut self, axis: Axis, stood: &mut Stood) -> Result<(), CalibrateError> {
        for deg in TILTED_DEG {
            match self.visit(axis, deg, stood) {
                Err(CalibrateError::Device(DeviceError::Refused(..))) => {
                    *self.tilts = false;
                    (self.tell)(
                        "  the motor does not turn both axes at once: the scale of the \
                         gyroscopes' axis z stays as it was",
                    );
                    return level(self.session, self.motor, &[Axis::X, Axis::Y]);
                }
                done => done?,
            }
        }
        Ok(())
    }

    /// What all nodes read at rest.
    fn rest(&mut self, stood: &mut Stood, at: &str) -> Result<Vec<Reading>, CalibrateError> {
        if !self.followed {
            return still(self.session, self.settle_s, READINGS, at);
        }
        // What the housing moves by until it stands still belongs to the turn.
        self.session.settle(self.settle_s)?;
        let read = |session: &mut Session| still(session, 0.0, READINGS, at);
        let (readings, rests) = turns::followed(self.session, false, read)?;
        stood.rests.push(rests);
        Ok(readings)
    }
}

fn at(axis: Axis, deg: f64) -> String {
    format!("at slope {} of {deg:.1} deg", axis.letter())
}
