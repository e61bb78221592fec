//! Why logs could not be played back: one sentence each.

use std::io;
use std::path::PathBuf;

use bus_logs::LogError;
use bus_master::JoinError;
use listen::PlanError;
use output::write::not_written;
use output::{plural, printable};

/// Logs that could not be played back.
#[derive(Debug, thiserror::Error)]
pub enum PlaybackError {
    /// A log that can't be read.
    #[error("{0}")]
    Log(#[from] LogError),
    /// Instruments that can't be looked for.
    #[error("{0}")]
    Plan(#[from] PlanError),
    /// A table with a name that tells no format.
    #[error(
        "{a} names no format; end the name in .csv or .parquet for a table, .log or .asc for a log",
        a = printable(.0)
    )]
    ExportName(String),
    /// The table could not be written.
    #[error("{a}", a = not_written(.0, .1, "another file with --export"))]
    Export(PathBuf, io::Error),
    /// The table would overwrite a file that is read.
    #[error("{a} is read by this replay; give --export another name", a = printable(.0))]
    ExportOverInput(String),
    /// The bus could not be joined.
    #[error("{0}")]
    Join(JoinError),
    /// The bus was lost, behind so many frames.
    #[error("{1}, after {a} of the log", a = plural(*.0, "frame", "frames"))]
    Lost(u64, io::Error),
    /// The end was asked for, behind so many frames.
    #[error("interrupted after {a} of the log", a = plural(*.0, "frame", "frames"))]
    Interrupted(u64),
    /// Frames of several interfaces can't go onto one bus.
    #[error(
        "the log has frames of {a} and of {b}: choose one with --channel",
        a = printable(.0),
        b = printable(.1)
    )]
    TwoInterfaces(String, String),
    /// Standard input can't give both the log and the steps.
    #[error("--step reads Enter from the standard input, as the log does; give a log file")]
    StepFromStdin,
    /// Standard output could not be written.
    #[error("standard output can't be written: {0}")]
    Stdout(io::Error),
}
