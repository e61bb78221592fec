//! `plumb demo`: build virtual instruments, calibrate them, test them, and dig for a week.
//!
//! In: a seed and how much of it. Out: the paper's tables compared with ours on the terminal, and
//! `report.html` and `report.json` in a folder. The worlds run side by side on all cores; each is
//! a thread of its own inside of which time is virtual, so the figures depend on the seed alone.

mod gather;
mod jobs;
mod medians;
mod options;
mod specification;

pub use options::Arguments;

use std::process::ExitCode;

use crate::Error;
use crate::report::{data::DemoReport, page, terminal};
use output::progress::Progress;
use output::stdout;
use output::write;

/// Runs the demo; exit status 0 when product mode is within its specification, else 1.
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, Error> {
    // A folder that cannot be written is better found before the work than after it.
    write::try_folder(&arguments.out)?;
    let results = jobs::run(arguments, progress)?;
    let report: DemoReport = gather::report(arguments, &results);
    let written = write::both(&arguments.out, &page::demo(&report), &report)?;
    let text = || terminal::print_demo(&report, arguments.details) + &written.line();
    stdout::print_as(arguments.json, &report, text).map_err(Error::Print)?;
    Ok(ExitCode::from(u8::from(!report.within_specification)))
}
