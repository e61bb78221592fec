//! Both channels of an instrument calibrated over the bus, by a motor or by hand, with a report.
//!
//! In: a bus with one instrument in reach, and a motor or a person. Out: a calibration in each
//! node, read back and compared; report.html, report.json and dcc.xml; the hash of the last one in
//! the nodes. Whatever goes wrong before, Ctrl-C included, the nodes get back the calibration that
//! they had, and the NMT state. [`characterise`] takes both channels through temperatures, for
//! their temperature compensation; [`verify`] compares a certificate with the nodes; `scpi` is how
//! motor and chamber are spoken to.
//!
//! Left out: recordings of sensors without a bus (`bench`).

pub mod by_hand;
pub mod by_motor;
pub mod characterise;
pub mod compose;
pub mod console;
pub mod data;
mod dcc;
mod error;
pub mod finish;
pub mod fit;
pub mod folder;
mod gains;
mod gyroscope;
pub mod hand;
#[cfg(test)]
mod held;
pub mod kept;
pub mod motor;
mod over_temperature;
mod page;
mod presented;
mod quantity;
mod reading;
#[cfg(test)]
pub mod sample;
pub mod scpi;
pub mod session;
mod turned;
mod turns;
pub mod verify;
mod xml;

#[cfg(test)]
pub use sample::report as sample_report;

/// A certificate made up, for tests.
#[cfg(test)]
pub fn sample_dcc() -> String {
    dcc::document(&sample_report(), "IT")
}

/// The fits, for studies of what they are worth.
pub mod fits {
    pub use crate::motor::Axis;
    pub use crate::{Reading, fit, hand};
}

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use tilt::chain::Calibration;

use by_motor::Kind;
use compose::Frame;
use console::{Console, tell};
pub use error::CalibrateError;
pub use finish::Common;
use finish::Done;
use folder::Folder;
use hand::{FEWEST, POSES};
use motor::Motor;
pub use reading::{Reading, mean_near, wrap};
pub use session::Session;

use data::{Report, now};

/// What to calibrate, how, and where the report goes.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Let this motor turn the housing: tcp://HOST:PORT or serial:///dev/ttyUSB0?baud=115200
    #[arg(long, value_name = "URL")]
    pub motor: Option<String>,
    /// Put the housing down by hand, without a motor
    #[arg(long)]
    pub by_hand: bool,
    /// Poses by hand, 13 to 18
    #[arg(long, default_value_t = FEWEST, value_name = "N",
          value_parser = clap::value_parser!(u8).range(i64::from(FEWEST)..=POSES.len() as i64))]
    pub poses: u8,
    /// By hand, without questions; a pose is taken when the housing was moved and stands still
    #[arg(long)]
    pub yes: bool,
    /// Degrees from stand to stand of the motor; 5, or 1 for the tables of the paper's mode
    #[arg(long, value_name = "DEG", value_parser = clap::value_parser!(u32).range(1..=30))]
    pub step: Option<u32>,
    /// Largest error as left, its expanded uncertainty included, deg; 0.2, and for tables what they
    /// err between two points, 0.01 with steps of 1 deg and straight lines between them. Steps of
    /// more than 4 deg need it there
    #[arg(long, value_name = "DEG", value_parser = tolerance)]
    pub tolerance: Option<f64>,
    /// Standard uncertainty (k = 1) of the motor's angles in deg, where it states none or another
    #[arg(long, value_name = "DEG")]
    pub motor_uncertainty: Option<f64>,
    /// Folder of the report
    #[arg(long, default_value = "calibration-report", value_name = "DIR")]
    pub out: PathBuf,
    /// What every calibration over a bus has.
    #[command(flatten)]
    pub common: Common,
}

/// Largest error as left when nothing is said, deg (R15).
const TOLERANCE_DEG: f64 = 0.2;

/// Degrees of a tolerance.
pub fn tolerance(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let number = number.filter(|deg: &f64| (1e-3..=90.0).contains(deg));
    number.ok_or_else(|| "write degrees from 0.001 to 90".to_owned())
}

/// Calibrates, or keeps and restores calibrations. Exit status 1: the instrument is not within its
/// tolerance, and has the calibration that it had.
///
/// Errors: see [`CalibrateError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, CalibrateError> {
    let common = &arguments.common;
    let ids = common.ids()?;
    if let Some(kept) = common.keep_or_restore(&ids)? {
        return Ok(kept);
    }
    CalibrateError::unless_one(
        [arguments.motor.is_some(), arguments.by_hand],
        "state how to calibrate: --motor URL, --by-hand, or --keep or --restore FILE",
        "either a motor turns the housing or a person does: give --motor URL or --by-hand, not \
         both",
    )?;
    let folder = Folder::claim(&arguments.out, common.force)?;
    let motor = arguments.motor.as_deref().map(Motor::connect);
    let motor = motor.transpose()?;
    common.with_nodes(&ids, figures, |session| {
        arguments.fine_enough(session)?;
        folder.keep(&kept::as_found(session))?;
        let done = work(arguments, &folder, session, motor);
        finish::settle(&folder, session, done)
    })
}

impl Arguments {
    /// Errors: [`CalibrateError::Coarse`] where tables of these nodes would be no use between their
    /// points, and nobody has said that they may err so much.
    fn fine_enough(&self, session: &Session) -> Result<(), CalibrateError> {
        let (Some(step), None, Some(_)) = (self.step, self.tolerance, &self.motor) else {
            return Ok(());
        };
        let found = session.nodes.iter().map(|node| &node.calibration);
        let table_deg = between_points_deg(found, step);
        if step > Kind::Tables.step() && table_deg > TOLERANCE_DEG {
            return Err(CalibrateError::Coarse(step, table_deg));
        }
        Ok(())
    }
}

/// The calibration itself, its report on disk, and its hash in the nodes.
fn work(
    arguments: &Arguments,
    folder: &Folder,
    session: &mut Session,
    motor: Option<Motor>,
) -> Done {
    let begun = now();
    let report = match motor {
        Some(mut motor) => with_motor(arguments, session, &mut motor, begun)?,
        None => with_hands(arguments, session, begun)?,
    };
    finish::publish(folder, session, report, &arguments.common.country)
}

fn with_motor(
    arguments: &Arguments,
    session: &mut Session,
    motor: &mut Motor,
    begun: u64,
) -> Result<Report, CalibrateError> {
    let name = motor.identity()?;
    let stated = motor.uncertainty_deg()?;
    let reference_deg = arguments.motor_uncertainty.or(stated);
    let reference_deg = reference_deg.ok_or(CalibrateError::Request(
        "the motor states no uncertainty of its angles: give --motor-uncertainty",
    ))?;
    let kind = Kind::of(session)?;
    let axes = motor.axes()?;
    if !kind.axes().iter().all(|axis| axes.contains(axis)) {
        return Err(CalibrateError::Request(
            "the motor turns one axis only, and two slopes need both: see docs/motor.md",
        ));
    }
    let mut bench = by_motor::Bench {
        session,
        motor,
        tell: &tell,
        reference_deg,
    };
    let step = arguments.step.unwrap_or(kind.step());
    let swept = bench.calibrate(kind, step)?;
    let residual_deg: Vec<f64> = swept.fits.iter().map(fit::Fitted::residual_deg).collect();
    let mut turns = turns::Turns {
        session,
        motor,
        tell: &tell,
        residual_deg: &residual_deg,
    };
    let gyroscopes = turns.calibrate(kind)?;
    let made = finish::made(session)?;
    let decoded: Vec<_> = made
        .iter()
        .filter_map(|bytes| session::decode(bytes))
        .collect();
    let table_deg = between_points_deg(&decoded, step);
    let frame = Frame {
        common: &arguments.common,
        session,
        begun,
        made,
        tolerance_deg: arguments.tolerance.unwrap_or_else(|| {
            let exact = TOLERANCE_DEG + table_deg;
            (exact * 1000.0).round() / 1000.0
        }),
    };
    let mut report = frame.by_motor(&swept, &name, reference_deg);
    gyroscope::put(&mut report, &gyroscopes.unwrap_or_default());
    Ok(report)
}

/// What the tables of these calibrations may err between two of their points, deg.
fn between_points_deg<'a>(
    calibrations: impl IntoIterator<Item = &'a Calibration>,
    step: u32,
) -> f64 {
    let corrections = calibrations.into_iter().map(|made| &made.correction);
    corrections
        .map(|correction| by_motor::between_points_deg(correction, f64::from(step)))
        .fold(0.0, f64::max)
}

fn with_hands(
    arguments: &Arguments,
    session: &mut Session,
    begun: u64,
) -> Result<Report, CalibrateError> {
    if Kind::of(session)? != Kind::TwoAxis {
        return Err(CalibrateError::Request(
            "by hand goes for two slopes by vector only: calibrate one that reads tables, or \
             measures one angle of 360 deg, by a motor",
        ));
    }
    let console = Console::new(arguments.yes);
    let mut bench = by_hand::Bench {
        session,
        console: &console,
        tell: &tell,
        rests: Vec::new(),
    };
    let handled = bench.calibrate(usize::from(arguments.poses))?;
    let made = finish::made(session)?;
    let frame = Frame {
        common: &arguments.common,
        session,
        begun,
        made,
        tolerance_deg: arguments.tolerance.unwrap_or(TOLERANCE_DEG),
    };
    let mut report = frame.by_hand(&handled);
    gyroscope::put(&mut report, &handled.gyroscopes);
    Ok(report)
}

fn largest(errors: impl Iterator<Item = Option<f64>>) -> String {
    let largest = errors.flatten().map(f64::abs).reduce(f64::max);
    largest.map_or("none".to_owned(), |deg| format!("{deg:.3} deg"))
}

/// What was found and left, a line a channel.
fn figures(report: &Report) -> String {
    let mut text = String::new();
    for channel in &report.channels {
        let found = largest(channel.as_found.iter().map(|p| p.error_deg));
        let left = largest(channel.as_left.iter().map(|p| p.error_deg));
        text += &format!(
            "channel {} (node {}): largest error as found {found}, as left {left}, U = {:.3} deg \
             (k = 2)\n",
            channel.channel, channel.node, channel.expanded_uncertainty_deg
        );
    }
    text += &gyroscope::figures(report);
    let between = largest(report.difference_as_left.iter().map(|d| d.difference_deg));
    if report.channels.len() == 2 {
        text += &format!("channel A less channel B as left: {between} at most\n");
    }
    text
}
