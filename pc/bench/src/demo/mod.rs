//! `plumb demo`: build virtual instruments, calibrate them, test them, and dig for a week.
//!
//! In: a seed and how much of it. Out: the paper's tables compared with ours on the terminal, and
//! `report.html` and `report.json` in a folder. The worlds run side by side on all cores; each is
//! a thread of its own inside of which time is virtual, so the figures depend on the seed alone.

mod gather;
mod jobs;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::report::{data::DemoReport, page, terminal};
use output::progress::Progress;
use output::stdout;
use output::write::{self, WriteError};

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

/// Why the demo could not be carried out.
#[derive(Debug)]
pub enum DemoError {
    /// An instrument could not be brought up.
    Bench(sim::bench::BenchError),
    /// The report could not be written.
    Write(WriteError),
    /// The result could not be printed; the report itself is written.
    Print(std::io::Error),
    /// The report could not be turned into JSON.
    Json(serde_json::Error),
}

impl std::fmt::Display for DemoError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bench(e) => write!(f, "an instrument could not be calibrated: {e}"),
            Self::Write(e) => write!(f, "{e}"),
            Self::Print(e) => {
                write!(
                    f,
                    "the result cannot be printed: {e}; the report is in its folder"
                )
            }
            Self::Json(e) => write!(f, "the report cannot be written as JSON: {e}"),
        }
    }
}

/// Runs the demo; exit status 0 when product mode is within its specification, else 1.
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, DemoError> {
    // A folder that cannot be written is better found before the work than after it.
    write::try_folder(&arguments.out).map_err(DemoError::Write)?;
    let results = jobs::run(arguments, progress).map_err(DemoError::Bench)?;
    let report: DemoReport = gather::report(arguments, &results);
    let written =
        write::both(&arguments.out, &page::demo(&report), &report).map_err(DemoError::Write)?;
    let text = if arguments.json {
        serde_json::to_string(&report).map_err(DemoError::Json)? + "\n"
    } else {
        let (html, json) = (written.html.display(), written.json.display());
        format!(
            "{}Report: {html} and {json}\n",
            terminal::print_demo(&report, arguments.details)
        )
    };
    stdout::print(&text).map_err(DemoError::Print)?;
    Ok(if report.within_specification {
        ExitCode::SUCCESS
    } else {
        ExitCode::from(1)
    })
}
