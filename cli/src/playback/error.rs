//! Why logs could not be played back: one sentence each.

use std::{fmt, io};

use crate::bus::JoinError;
use crate::eds::EdsError;
use crate::log::LogError;
use crate::report::replay_tables::printable;

/// Logs that could not be played back.
#[derive(Debug)]
pub enum PlaybackError {
    /// A log that can't be read.
    Log(LogError),
    /// A data sheet that can't be used.
    Eds(EdsError),
    /// The end that is asked for is not behind the beginning.
    NoTime,
    /// Node-ids that are no pairs.
    Nodes,
    /// A table with a name that tells no format.
    ExportName(String),
    /// The table could not be written.
    Export(String, io::Error),
    /// The table would overwrite a file that is read.
    ExportOverInput(String),
    /// The bus could not be joined.
    Join(JoinError),
    /// The bus was lost, behind so many frames.
    Lost(u64, io::Error),
    /// The end was asked for, behind so many frames.
    Interrupted(u64),
    /// Frames of several interfaces can't go onto one bus.
    TwoInterfaces(String, String),
    /// Standard input can't give both the log and the steps.
    StepFromStdin,
    /// Standard output could not be written.
    Stdout(io::Error),
}

impl std::error::Error for PlaybackError {}

impl fmt::Display for PlaybackError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Log(error) => write!(f, "{error}"),
            Self::Eds(error) => write!(f, "{error}"),
            Self::NoTime => write!(f, "--to is not after --from: swap them"),
            Self::Nodes => write!(
                f,
                "--nodes takes two different node-ids for each instrument, channel A first, and \
                 each one once"
            ),
            Self::ExportName(file) => write!(
                f,
                "{} names no format; end the name in .csv or .parquet for a table, .log or .asc \
                 for a log",
                printable(file)
            ),
            Self::Export(file, why) => write!(f, "{} can't be written: {why}", printable(file)),
            Self::ExportOverInput(file) => write!(
                f,
                "{} is read by this replay; give --export another name",
                printable(file)
            ),
            Self::Join(error) => write!(f, "{error}"),
            Self::Lost(sent, error) => write!(f, "{error}, after {sent} frames of the log"),
            Self::Interrupted(sent) => write!(f, "interrupted after {sent} frames of the log"),
            Self::TwoInterfaces(one, other) => write!(
                f,
                "the log has frames of {} and of {}: choose one with --interface",
                printable(one),
                printable(other)
            ),
            Self::StepFromStdin => write!(
                f,
                "--step reads Enter from the standard input, as the log does; give a log file"
            ),
            Self::Stdout(error) => write!(f, "standard output can't be written: {error}"),
        }
    }
}

impl From<LogError> for PlaybackError {
    fn from(error: LogError) -> Self {
        Self::Log(error)
    }
}

impl From<EdsError> for PlaybackError {
    fn from(error: EdsError) -> Self {
        Self::Eds(error)
    }
}
