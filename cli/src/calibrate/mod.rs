//! `plumb calibrate`: both channels over the bus, by a motor or by hand, with a report.
//!
//! In: a bus with one instrument in reach, and a motor or a person. Out: a calibration in each
//! node, read back and compared; report.html, report.json and dcc.xml; the hash of the last one in
//! the nodes. Whatever goes wrong before, Ctrl-C included, the nodes get back the calibration that
//! they had, and the NMT state.
//!
//! Left out: the climatic chamber: each node keeps the temperature compensation that it has.

mod by_hand;
mod by_motor;
mod compose;
mod console;
pub mod data;
mod dcc;
mod error;
pub mod fit;
mod folder;
pub mod hand;
mod kept;
pub mod motor;
mod page;
#[cfg(test)]
mod sample;
mod session;
mod xml;

#[cfg(test)]
pub use sample::report as sample_report;

/// A certificate made up, for tests.
#[cfg(test)]
pub fn sample_dcc() -> String {
    dcc::document(&sample_report(), "IT")
}

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;

use by_motor::Kind;
use compose::{Frame, now};
use console::Console;
pub use error::CalibrateError;
use folder::Folder;
use hand::{FEWEST, POSES};
pub use kept::hex;
use motor::{Motor, ScpiMotor};
pub use session::{Reading, Session};

use crate::bus::BusOptions;
use crate::stdout;
use data::Report;

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
    /// By hand: ask nobody; a pose is taken when the housing was moved and stands still
    #[arg(long)]
    pub yes: bool,
    /// The nodes of the instrument, or one of them
    #[arg(long, value_delimiter = ',', default_value = "1,2", value_name = "ID,ID",
          value_parser = clap::value_parser!(u8).range(1..=127))]
    pub nodes: Vec<u8>,
    /// Degrees from stand to stand of the motor; 5, or 1 for the tables of the paper's mode
    #[arg(long, value_name = "DEG", value_parser = clap::value_parser!(u32).range(1..=30))]
    pub step: Option<u32>,
    /// Largest error as left, its expanded uncertainty included, deg; 0.2, and half a step more
    /// for tables, which read the nearest of their points
    #[arg(long, value_name = "DEG", value_parser = tolerance)]
    pub tolerance: Option<f64>,
    /// Standard uncertainty (k = 1) of the motor's angles in deg, where it states none or another
    #[arg(long, value_name = "DEG")]
    pub motor_uncertainty: Option<f64>,
    /// Folder of the report
    #[arg(long, default_value = "calibration-report", value_name = "DIR")]
    pub out: PathBuf,
    /// Replace an earlier report in that folder, or the file of --keep; what is not accepted
    /// replaces nothing and goes into a folder of its own in there
    #[arg(long)]
    pub force: bool,
    /// Who calibrates, for the report
    #[arg(long, value_name = "NAME")]
    pub laboratory: Option<String>,
    /// Who stands at the bench, for the report
    #[arg(long, value_name = "NAME")]
    pub operator: Option<String>,
    /// For whom, for the report
    #[arg(long, value_name = "NAME")]
    pub customer: Option<String>,
    /// Country of the laboratory, two letters of ISO 3166, for dcc.xml; ZZ is not stated
    #[arg(long, default_value = "ZZ", value_parser = country, value_name = "CODE")]
    pub country: String,
    /// Only write the calibrations that the nodes have to this file
    #[arg(long, value_name = "FILE", conflicts_with_all = ["motor", "by_hand", "restore"])]
    pub keep: Option<PathBuf>,
    /// Only give the nodes the calibrations in this file, by their serial numbers
    #[arg(long, value_name = "FILE", conflicts_with_all = ["motor", "by_hand"])]
    pub restore: Option<PathBuf>,
    /// Print the report as one JSON object
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub bus: BusOptions,
}

fn country(text: &str) -> Result<String, String> {
    let fits = text.len() == 2 && text.bytes().all(|b| b.is_ascii_uppercase());
    fits.then(|| text.to_owned())
        .ok_or_else(|| "write two capital letters, as IT".to_owned())
}

/// Largest error as left when nothing is said, deg (R15).
const TOLERANCE_DEG: f64 = 0.2;

fn tolerance(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let number = number.filter(|deg: &f64| (1e-3..=90.0).contains(deg));
    number.ok_or_else(|| "write degrees from 0.001 to 90".to_owned())
}

/// Calibrates, or keeps and restores calibrations. Exit status 1: the instrument is not within its
/// tolerance, and has the calibration that it had.
///
/// Errors: see [`CalibrateError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, CalibrateError> {
    let ids = nodes(&arguments.nodes)?;
    match (&arguments.keep, &arguments.restore) {
        (Some(path), _) => return keep(arguments, &ids, path),
        (None, Some(path)) => return restore(arguments, &ids, path),
        (None, None) => {}
    }
    match (&arguments.motor, arguments.by_hand) {
        (None, false) => return Err(CalibrateError::Method),
        (Some(_), true) => return Err(CalibrateError::Both),
        _ => {}
    }
    let folder = Folder::claim(&arguments.out, arguments.force)?;
    let motor = arguments.motor.as_deref().map(ScpiMotor::connect);
    let motor = motor.transpose()?;
    let mut session = open(arguments, &ids)?;
    if let Err(error) = folder.keep(&kept::as_found(&session)) {
        session.leave();
        return Err(error);
    }
    let done = work(arguments, &folder, &mut session, motor);
    let done = settle(&folder, &mut session, done);
    session.leave();
    let (report, place) = done?;
    say(arguments, &report, &place)?;
    Ok(match report.decision.accepted {
        true => ExitCode::SUCCESS,
        false => ExitCode::from(1),
    })
}

/// One node, or two that differ.
fn nodes(ids: &[u8]) -> Result<Vec<u8>, CalibrateError> {
    match ids {
        [one, other] if one == other => Err(CalibrateError::Twice(*one)),
        [_] | [_, _] => Ok(ids.to_vec()),
        _ => Err(CalibrateError::Nodes),
    }
}

fn open(arguments: &Arguments, ids: &[u8]) -> Result<Session, CalibrateError> {
    let bus = arguments.bus.join().map_err(CalibrateError::Join)?;
    Session::open(bus, ids)
}

/// A report, and the folder that it is in.
type Done = Result<(Report, PathBuf), CalibrateError>;

/// Gives back what the nodes had unless all went well.
fn settle(folder: &Folder, session: &mut Session, done: Done) -> Done {
    if done
        .as_ref()
        .is_ok_and(|(report, _)| report.decision.accepted)
    {
        return done;
    }
    let left = session.roll_back();
    let error = match (done, left.is_empty()) {
        (Ok(done), true) => return Ok(done),
        (Err(error), true) => {
            // The nodes have it again.
            folder.forget();
            return Err(error);
        }
        (Err(error), false) => error,
        (Ok(_), false) => CalibrateError::Rejected,
    };
    tell(&format!(
        "what the nodes had is in {}",
        folder.found().display()
    ));
    Err(CalibrateError::Left(Box::new(error), left))
}

fn tell(line: &str) {
    eprintln!("{line}");
}

/// The calibration itself, its report on disk, and its hash in the nodes.
fn work(
    arguments: &Arguments,
    folder: &Folder,
    session: &mut Session,
    motor: Option<ScpiMotor>,
) -> Done {
    let begun = now();
    let mut report = match motor {
        Some(mut motor) => with_motor(arguments, session, &mut motor, begun)?,
        None => with_hands(arguments, session, begun)?,
    };
    let certificate = dcc::document(&report, &arguments.country);
    if report.decision.accepted {
        let hash = hmac_sha256::Hash::hash(certificate.as_bytes());
        for place in 0..session.nodes.len() {
            session.write_hash(place, &hash)?;
        }
        report.dcc_sha256 = Some(hex(&hash));
    }
    let json = serde_json::to_string_pretty(&report);
    let json = json.map_err(|e| CalibrateError::Print(e.into()))? + "\n";
    let files = [
        ("dcc.xml", certificate.as_str()),
        ("report.json", &json),
        ("report.html", &page::page(&report)),
    ];
    let place = folder.write(&files, report.decision.accepted)?;
    if place != arguments.out {
        let (place, out) = (place.display(), arguments.out.display());
        tell(&format!(
            "not accepted: its report is in {place}, the one in {out} stays"
        ));
    }
    Ok((report, place))
}

fn with_motor(
    arguments: &Arguments,
    session: &mut Session,
    motor: &mut dyn Motor,
    begun: u64,
) -> Result<Report, CalibrateError> {
    let name = crate::report::replay_tables::printable(&motor.identity()?);
    let stated = motor.uncertainty_deg()?;
    let reference_deg = arguments.motor_uncertainty.or(stated);
    let reference_deg = reference_deg.ok_or(CalibrateError::Kind(
        "the motor states no uncertainty of its angles: give --motor-uncertainty",
    ))?;
    let kind = Kind::of(session)?;
    let axes = motor.axes()?;
    if !kind.axes().iter().all(|axis| axes.contains(axis)) {
        return Err(CalibrateError::Kind(
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
    let made = made(session)?;
    let table_deg = match kind {
        Kind::Tables => f64::from(step) / 2.0,
        Kind::TwoAxis | Kind::OneAxis => 0.0,
    };
    let frame = Frame {
        arguments,
        session,
        begun,
        made,
        tolerance_deg: arguments.tolerance.unwrap_or(TOLERANCE_DEG + table_deg),
    };
    Ok(frame.by_motor(&swept, &name, reference_deg))
}

fn with_hands(
    arguments: &Arguments,
    session: &mut Session,
    begun: u64,
) -> Result<Report, CalibrateError> {
    if Kind::of(session)? != Kind::TwoAxis {
        return Err(CalibrateError::Kind(
            "by hand goes for instruments of two slopes by vector only (2062h sub 2 is 1): \
             calibrate this one by a motor",
        ));
    }
    let console = Console::new(arguments.yes);
    let mut bench = by_hand::Bench {
        session,
        console: &console,
        tell: &tell,
    };
    let handled = bench.calibrate(usize::from(arguments.poses))?;
    let made = made(session)?;
    let frame = Frame {
        arguments,
        session,
        begun,
        made,
        tolerance_deg: arguments.tolerance.unwrap_or(TOLERANCE_DEG),
    };
    Ok(frame.by_hand(&handled))
}

/// 2061h of each node as it is now.
fn made(session: &mut Session) -> Result<Vec<Vec<u8>>, CalibrateError> {
    (0..session.nodes.len())
        .map(|place| session.calibration(place))
        .collect()
}

fn keep(arguments: &Arguments, ids: &[u8], path: &Path) -> Result<ExitCode, CalibrateError> {
    if path.symlink_metadata().is_ok() && !arguments.force {
        return Err(CalibrateError::Earlier(path.to_owned(), "file with --keep"));
    }
    let mut session = open(arguments, ids)?;
    let kept = kept::as_found(&session);
    session.leave();
    kept::save(path, &kept)?;
    print_kept(arguments, &kept, "kept")
}

fn restore(arguments: &Arguments, ids: &[u8], path: &Path) -> Result<ExitCode, CalibrateError> {
    let kept = kept::load(path)?;
    let mut session = open(arguments, ids)?;
    let done = kept::restore(&mut session, path, &kept);
    let left = match done {
        Ok(()) => Vec::new(),
        Err(_) => session.roll_back(),
    };
    session.leave();
    match (done, left.is_empty()) {
        (Ok(()), _) => print_kept(arguments, &kept, "restored"),
        (Err(error), true) => Err(error),
        (Err(error), false) => Err(CalibrateError::Left(Box::new(error), left)),
    }
}

fn print_kept(
    arguments: &Arguments,
    kept: &kept::Kept,
    word: &str,
) -> Result<ExitCode, CalibrateError> {
    let printed = if arguments.json {
        stdout::print_json(kept)
    } else {
        let line = |node: &kept::KeptNode| {
            let (serial, crc) = (node.serial_number, &node.crc32);
            format!("serial number {serial}: calibration {crc} {word}\n")
        };
        stdout::print(kept.nodes.iter().map(line).collect::<String>())
    };
    printed.map_err(CalibrateError::Print)?;
    Ok(ExitCode::SUCCESS)
}

fn say(arguments: &Arguments, report: &Report, place: &Path) -> Result<(), CalibrateError> {
    let printed = match arguments.json {
        true => stdout::print_json(report),
        false => stdout::print(summary(report, place)),
    };
    printed.map_err(CalibrateError::Print)
}

fn largest(errors: impl Iterator<Item = Option<f64>>) -> String {
    let largest = errors.flatten().map(f64::abs).reduce(f64::max);
    largest.map_or("none".to_owned(), |deg| format!("{deg:.3} deg"))
}

fn summary(report: &Report, place: &Path) -> String {
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
    let between = largest(report.difference_as_left.iter().map(|d| d.difference_deg));
    if report.channels.len() == 2 {
        text += &format!("channel A less channel B as left: {between} at most\n");
    }
    let tolerance = report.decision.tolerance_deg;
    text += &match report.decision.accepted {
        true => format!("accepted: within {tolerance} deg; stored, read back, the same\n"),
        false => format!(
            "NOT accepted: not within {tolerance} deg; the nodes have the calibration that they \
             had\n"
        ),
    };
    let folder = place.display();
    text += &format!("report: {folder}/report.html, report.json, dcc.xml\n");
    if let Some(hash) = &report.dcc_sha256 {
        text += &format!("the nodes keep the SHA-256 of dcc.xml: {hash}\n");
    }
    text
}
