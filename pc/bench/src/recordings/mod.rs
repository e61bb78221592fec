//! `plumb replay`: real recordings through the instrument's own chain.
//!
//! In: one CSV file per channel (plain or gzip), one or two. Out: the tables on the terminal,
//! `report.html` and `report.json` in a folder, and a calibration file if one is asked for.
//! A `recording::Recording` of checked samples with every skipped row counted gives the
//! `segments::Segment`s in which the sensor stood still, these a `calibrate::Fit`, that the
//! chain of `tilt`, and that the readings which are judged and reported. Everything is computed
//! before the first byte is written. The formats are described in `docs/recordings.md`.
//!
//! Left out: logs of a bus (`bus_report::playback`).

mod alignment;
mod arguments;
mod calibrate;
mod calibration_file;
mod cells;
mod columns;
mod error;
mod figures;
mod gather;
mod motion;
mod play;
mod prepare;
mod rates;
mod recording;
mod reference;
mod rotation;
mod scale;
mod segments;
mod skips;
mod steady;
mod tuning;
mod verdicts;
mod windows;

#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod injected;
#[cfg(test)]
mod real;
#[cfg(test)]
mod real_chain;
#[cfg(test)]
mod real_motion;
#[cfg(test)]
mod repeatability;

use std::process::ExitCode;

use crate::Error;
use crate::report::replay_data::ReplayReport;
use crate::report::{replay_page, terminal};
use output::printable;
use output::progress::Progress;
use output::stdout;
use output::write::{self, Written};

use arguments::Mode;

pub use arguments::{Arguments, CalibrateFrom, Options};
pub use calibration_file::load_calibrations;
pub use error::FileError;

/// Replays; exit status 0 whatever the verdicts are, since finding a fault is what it is for.
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, Error> {
    let mode = arguments.options.mode.unwrap_or(Mode::Product);
    let (channels, notes) = prepare::prepare(arguments, progress)?;
    let report = gather::report(&channels, notes, mode, progress);
    let records: Vec<_> = channels.into_iter().map(|channel| channel.record).collect();
    // Complete beside its place before the report is written, put in its place after.
    let kept = match &arguments.options.save_calibration {
        Some(path) => Some((
            path,
            calibration_file::stage(path, &records, arguments.existing)?,
        )),
        None => None,
    };
    let written = write::both(arguments.folder(), &replay_page::replay(&report), &report)?;
    if let Some((path, kept)) = kept {
        calibration_file::put_in_place(path, kept)?;
    }
    let text = || shown(arguments, &report, &written);
    stdout::print_as(arguments.json, &report, text).map_err(Error::Print)?;
    Ok(ExitCode::SUCCESS)
}

fn shown(arguments: &Arguments, report: &ReplayReport, written: &Written) -> String {
    let mut text = terminal::print_replay(report);
    text.push('\n');
    text.push_str(&written.line());
    if let Some(path) = &arguments.options.save_calibration {
        text.push_str(&format!(
            "Calibration: {}\n",
            printable(&path.display().to_string())
        ));
    }
    text
}
