//! The motor's run over the bus (R5, R15): memorise references, make the paper's two tables.
//!
//! In: commands, and for each stand of the motor the reference angle that the host writes, with
//! what the channel sees at that moment. Out: progress with residuals, and at the end a
//! [`Calibration`] with new tables.
//!
//! The host turns the motor, waits until it stands and the filter has settled, and writes the
//! angle. A point is the newest filtered acceleration of the axis, compensated for temperature
//! (R5, R7); nothing is averaged beyond the low-pass, as in the paper. Points may come in any
//! order, so the motor may turn either way.
//!
//! The residual of a point is what the calibration in force gives there, less the reference. A
//! verification round (R15) is therefore a run that is abandoned: above the tolerance of 0.20 deg
//! of the worst residual, calibrate anew.
//!
//! The budget of the new tables follows from the run: the scatter of their points
//! ([`Table::scatter`]), the reference's uncertainty, and the temperatures at which the points were
//! taken, unless a temperature model was in force, whose span stays. A table that was kept from
//! before brings its own along, and of each the worse counts.
//!
//! The state is 3 kB, nearly all of it the points of both axes; the tables are made at the end, in
//! the calibration in force. While a run is open the caller neither downloads a calibration nor
//! puts another in force, since points hold what the temperature model left.
//!
//! Left out: turning the motor, storing what was found, and the twelve-parameter fit, which needs
//! floating point and runs on a host.

use tilt::angle::{Angle, Axes};
use tilt::chain::{Calibration, Chain, Correction, Invalid, Reading};
use tilt::composition::Composition;
use tilt::filter::Filtered;
use tilt::sample::Temperature;
use tilt::table::{Point, Rule, Table, TableError};
use tilt::uncertainty::{Span, Uncertainty};

use super::{PointError, Points, tables_in};
use crate::exchange::reason_code;

/// One of the two axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Slope X.
    X,
    /// Slope Y.
    Y,
}

impl Axis {
    /// This axis' value of the two.
    const fn of<T: Copy>(self, both: &Axes<T>) -> T {
        match self {
            Self::X => both.x,
            Self::Y => both.y,
        }
    }

    pub(super) const fn of_mut<T>(self, both: &mut Axes<T>) -> &mut T {
        match self {
            Self::X => &mut both.x,
            Self::Y => &mut both.y,
        }
    }

    const fn other(self) -> Self {
        match self {
            Self::X => Self::Y,
            Self::Y => Self::X,
        }
    }
}

/// What the command object can be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Command {
    /// Memorise for axis X from now on; makes the table of Y if points of Y are there.
    StartX = 1,
    /// Memorise for axis Y from now on; makes the table of X if points of X are there.
    StartY = 2,
    /// Make the table of the axis under way, and end the run.
    Finish = 3,
    /// End the run and keep nothing.
    Abandon = 4,
}

impl Command {
    /// By its number; `None` for others than 1 to 4.
    pub const fn from_number(number: u8) -> Option<Self> {
        match number {
            1 => Some(Self::StartX),
            2 => Some(Self::StartY),
            3 => Some(Self::Finish),
            4 => Some(Self::Abandon),
            _ => None,
        }
    }
}

/// What the new tables come with: settings, not found by the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableSettings {
    /// How the tables are read.
    pub rule: Rule,
    /// Standard uncertainty of the reference angles.
    pub reference: Uncertainty,
}

/// Standard uncertainty of the angle that the paper's motor states: harmonics of 0.05 deg peak to
/// peak together, direction error 0.0083 deg, repeatability 0.0042 deg (DGM130R-ASAA \[RECALL\]).
pub const MOTOR: Uncertainty = Uncertainty::from_degrees(0.0134);

/// What the channel sees at one stand of the motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StandReading {
    /// The newest filtered acceleration.
    pub filtered: Option<Filtered>,
    /// The part's temperature, if known.
    pub temperature: Option<Temperature>,
    /// What the channel reads, which tells whether it may be trusted.
    pub reading: Reading,
}

/// What a command led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The run goes on.
    Running,
    /// The run is over and the calibration in force has new tables: store it.
    Finished,
    /// The run is over and nothing was made.
    Abandoned,
}

/// Why a command or a reference was refused. Nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotorError {
    /// No run is open.
    NotRunning,
    /// The channel has no valid reading.
    NoReading(Invalid),
    /// The reference is beyond +-90 deg.
    Reference,
    /// There is a point with this reference already.
    SameAngle,
    /// The axis has as many points as a table holds.
    Full,
    /// The points of this axis make no table.
    Table(Axis, TableError),
    /// There is no table of this axis, neither from this run nor in force.
    Missing(Axis),
}

impl MotorError {
    /// Its number for the object that tells it; 0 is left for "taken".
    ///
    /// 1 to 31: no reading, by [`reason_code`]. 32 no run, 33 reference, 34 same angle, 35 full,
    /// 36 and 37 no table of X or Y. From 40 for X and from 48 for Y: too few points, too many,
    /// not rising, flat.
    pub const fn code(self) -> u8 {
        match self {
            Self::NoReading(reason) => reason_code(reason),
            Self::NotRunning => 32,
            Self::Reference => 33,
            Self::SameAngle => 34,
            Self::Full => 35,
            Self::Missing(Axis::X) => 36,
            Self::Missing(Axis::Y) => 37,
            Self::Table(Axis::X, error) => 40 + table_code(error),
            Self::Table(Axis::Y, error) => 48 + table_code(error),
        }
    }
}

const fn table_code(error: TableError) -> u8 {
    match error {
        TableError::TooFew => 0,
        TableError::TooMany => 1,
        TableError::NotRising => 2,
        TableError::Flat => 3,
    }
}

/// How a run goes, for the objects that tell it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The axis under way; `None` when no run is open.
    pub axis: Option<Axis>,
    /// Points memorised in this run for each axis, 0 to 181.
    pub points: Axes<u8>,
    /// Residual of the newest point, 0.001 deg; `None` before the first, and where the
    /// calibration in force does not measure the axis.
    pub residual: Option<i32>,
    /// The largest residual since the last start of an axis, without its sign, 0.001 deg.
    pub worst: u32,
}

/// State of the run. What is large comes last, as in `Device`.
#[derive(Clone, Debug, Default)]
#[repr(C)]
pub struct Motor {
    axis: Option<Axis>,
    worst: u32,
    residual: Option<i32>,
    /// Temperatures at which the points of each axis were taken.
    spans: Axes<Span>,
    points: Axes<Points>,
}

impl Motor {
    /// No run.
    pub const fn new() -> Self {
        Self {
            axis: None,
            points: Axes {
                x: Points::new(),
                y: Points::new(),
            },
            residual: None,
            spans: Axes {
                x: Span::NOWHERE,
                y: Span::NOWHERE,
            },
            worst: 0,
        }
    }

    /// True while a run is open.
    pub const fn is_running(&self) -> bool {
        self.axis.is_some()
    }

    /// How the run goes. After its end counts and residuals stay readable.
    pub fn progress(&self) -> Progress {
        let Axes { x, y } = &self.points;
        Progress {
            axis: self.axis,
            points: Axes {
                x: x.as_slice().len() as u8,
                y: y.as_slice().len() as u8,
            },
            residual: self.residual,
            worst: self.worst,
        }
    }

    /// Carries a command out.
    ///
    /// `in_force` is the calibration that readings come from; it changes with
    /// [`Outcome::Finished`] only. Starting an axis anew drops its points; a run of one axis
    /// keeps the other's table. Errors: [`MotorError::NotRunning`], [`MotorError::Table`],
    /// [`MotorError::Missing`].
    pub fn command<C: Composition>(
        &mut self,
        command: Command,
        table_settings: &TableSettings,
        in_force: &mut Calibration<C>,
    ) -> Result<Outcome, MotorError> {
        match command {
            Command::StartX => self.start(Axis::X, in_force.budget.span),
            Command::StartY => self.start(Axis::Y, in_force.budget.span),
            Command::Finish => self.finish(table_settings, in_force),
            Command::Abandon => {
                self.axis = None;
                Ok(Outcome::Abandoned)
            }
        }
    }

    /// An axis that is not started keeps the span of what is in force, as its table.
    fn start(&mut self, axis: Axis, in_force: Span) -> Result<Outcome, MotorError> {
        match self.axis {
            None => {
                self.points.x.clear();
                self.points.y.clear();
                self.spans = Axes {
                    x: in_force,
                    y: in_force,
                };
            }
            Some(before) if before != axis && !self.points_of(before).is_empty() => {
                self.check(before)?;
            }
            Some(_) => {}
        }
        self.axis = Some(axis);
        axis.of_mut(&mut self.points).clear();
        *axis.of_mut(&mut self.spans) = Span::NOWHERE;
        self.residual = None;
        self.worst = 0;
        Ok(Outcome::Running)
    }

    fn points_of(&self, axis: Axis) -> &[Point] {
        match axis {
            Axis::X => self.points.x.as_slice(),
            Axis::Y => self.points.y.as_slice(),
        }
    }

    /// Whether the points of `axis` make a table.
    fn check(&self, axis: Axis) -> Result<(), MotorError> {
        Table::check(self.points_of(axis)).map_err(|error| MotorError::Table(axis, error))
    }

    /// Everything is checked first, so that the calibration in force changes altogether.
    fn finish<C: Composition>(
        &mut self,
        table_settings: &TableSettings,
        in_force: &mut Calibration<C>,
    ) -> Result<Outcome, MotorError> {
        let axis = self.axis.ok_or(MotorError::NotRunning)?;
        let has_tables = matches!(in_force.correction, Correction::Tables { .. });
        if self.points_of(axis.other()).is_empty() && !has_tables {
            return Err(MotorError::Missing(axis.other()));
        }
        self.check(axis)?;
        let tables = tables_in(&mut in_force.correction, table_settings.rule);
        let tables = tables.ok_or(MotorError::Missing(axis))?;
        for axis in [Axis::X, Axis::Y] {
            let points = self.points_of(axis);
            if !points.is_empty() {
                let made = axis.of_mut(tables).refill(points);
                made.map_err(|error| MotorError::Table(axis, error))?;
            }
        }
        self.axis = None;
        if !C::UNCERTAINTY {
            return Ok(Outcome::Finished);
        }
        let kept = self.points_of(axis.other()).is_empty();
        let budget = &mut in_force.budget;
        let before = if kept {
            budget.reference
        } else {
            table_settings.reference
        };
        budget.take_tables(tables, table_settings.reference.max(before));
        budget.take_run(self.spans.x.and(self.spans.y), &in_force.temperature);
        Ok(Outcome::Finished)
    }

    /// The motor stands at `reference` (0.001 deg, -90000 to 90000): memorises a point.
    ///
    /// `chain` is the one in force. Errors: [`MotorError::NotRunning`],
    /// [`MotorError::Reference`], [`MotorError::NoReading`], [`MotorError::SameAngle`],
    /// [`MotorError::Full`].
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn memorise<C: Composition>(
        &mut self,
        reference: i32,
        chain: &Chain<C>,
        sight: &StandReading,
    ) -> Result<(), MotorError> {
        let axis = self.axis.ok_or(MotorError::NotRunning)?;
        if reference.unsigned_abs() > 90_000 {
            return Err(MotorError::Reference);
        }
        let angle = from_millidegrees(reference);
        let filtered = trusted(axis, sight).map_err(MotorError::NoReading)?;
        let temperature = sight.temperature.unwrap_or(Temperature::REFERENCE);
        let model = &chain.calibration.temperature;
        let [x, y, _] = model.apply(filtered, temperature).accel;
        let accel = axis.of(&Axes { x, y });
        let points = axis.of_mut(&mut self.points);
        let inserted = points.insert(Point { accel, angle });
        inserted.map_err(|error| match error {
            PointError::Full => MotorError::Full,
            PointError::SameAngle => MotorError::SameAngle,
        })?;
        let found = axis.of(&chain.evaluate(filtered, temperature)).ok();
        self.residual = found.map(|found| to_millidegrees(found.angle.minus(angle)));
        let size = self.residual.map_or(0, i32::unsigned_abs);
        self.worst = self.worst.max(size);
        let span = axis.of_mut(&mut self.spans);
        *span = span.widened(temperature);
        Ok(())
    }
}

/// The filtered acceleration, if the channel stands behind it.
///
/// An axis that the calibration in force does not measure can still be calibrated: then the other
/// one tells whether the channel works, and where neither is measured yet the chain's own reason.
fn trusted(axis: Axis, sight: &StandReading) -> Result<Filtered, Invalid> {
    let own = match axis.of(&sight.reading) {
        Err(Invalid::NotMeasured) => axis.other().of(&sight.reading),
        reading => reading,
    };
    if own != Err(Invalid::NotMeasured) {
        own?;
    }
    sight.filtered.ok_or(Invalid::NoSample)
}

/// An angle from thousandths of a degree, within +-180 deg; to the nearest step.
fn from_millidegrees(value: i32) -> Angle {
    // 2^32 / 360000 steps, with 20 fractional bits.
    const STEPS_Q20: i64 = 12_509_998_965;
    Angle(((i64::from(value) * STEPS_Q20 + (1 << 19)) >> 20) as i32)
}

/// An angle in thousandths of a degree, rounded to the nearest.
fn to_millidegrees(angle: Angle) -> i32 {
    ((i64::from(angle.0) * 360_000 + (1 << 31)) >> 32) as i32
}

#[cfg(test)]
mod tests;
