//! `plumb demo`: build virtual instruments, calibrate them, test them, and dig for a week.
//!
//! In: a seed and how much of it. Out: the paper's tables compared with ours on the terminal, and
//! `report.html` and `report.json` in a folder. The worlds run side by side on all cores; each is
//! a thread of its own inside of which time is virtual, so the figures depend on the seed alone.

mod gather;
mod jobs;
mod specification;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::Error;
use crate::report::{data::DemoReport, page, terminal};
use output::progress::Progress;
use output::stdout;
use output::write;

/// What to build and test.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Seed of every random draw; the same seed gives the same report
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Instruments to build in each mode; figures are medians over them
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub units: u32,
    /// Days on the excavator, three hours each; the supply fails on day 5; 0 for none
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u32).range(0..=3650))]
    pub days: u32,
    /// Folder for report.html and report.json
    #[arg(long, default_value = "plumb-report", value_name = "DIR")]
    pub out: PathBuf,
    /// Add the paper to the letter: a column in addition to the reading that reproduces it
    #[arg(long)]
    pub as_printed: bool,
    /// Print every table, not only the summary
    #[arg(long, conflicts_with = "json")]
    pub details: bool,
    /// Print report.json on stdout instead of the tables
    #[arg(long)]
    pub json: bool,
}

/// Runs the demo; exit status 0 when product mode is within its specification, else 1.
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, Error> {
    // A folder that cannot be written is better found before the work than after it.
    write::try_folder(&arguments.out)?;
    let results = jobs::run(arguments, progress)?;
    let report: DemoReport = gather::report(arguments, &results);
    let written = write::both(&arguments.out, &page::demo(&report), &report)?;
    let printed = if arguments.json {
        stdout::print_json(&report)
    } else {
        stdout::print(terminal::print_demo(&report, arguments.details) + &written.line())
    };
    printed.map_err(Error::Print)?;
    Ok(ExitCode::from(u8::from(!report.within_specification)))
}
