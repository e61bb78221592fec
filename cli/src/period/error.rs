//! Why no report could be made: one sentence that names the file and what to do.

use std::fmt;
use std::io;

use crate::blackbox::FaultsError;
use crate::bus::JoinError;
use crate::eds::EdsError;
use crate::log::LogError;
use crate::report::write::WriteError;

/// A report that could not be made. Nothing has been written when one is returned, but for
/// [`LogError::Incomplete`]: what could be read is in the report then.
#[derive(Debug)]
pub enum PeriodError {
    /// A log that can't be read.
    Log(LogError),
    /// A data sheet that can't be read.
    Eds(EdsError),
    /// The bit rate is none.
    Bus(JoinError),
    /// What nodes remember can't be read.
    Memory(FaultsError),
    /// No node could be asked: why the first one could not.
    Nobody(String),
    /// Neither a log, nor a black box, nor a bus was given.
    NothingGiven,
    /// There is no frame in all the logs.
    Empty,
    /// There are frames, this many, but none in the time that was asked for.
    Outside(u64),
    /// The end lies before the start.
    NoTime,
    /// The report could not be written.
    Write(WriteError),
    /// The report could not be turned into JSON.
    Json(serde_json::Error),
    /// It could not be printed.
    Print(io::Error),
}

impl fmt::Display for PeriodError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Log(why) => write!(f, "{why}"),
            Self::Eds(why) => write!(f, "{why}"),
            Self::Bus(why) => write!(f, "{why}"),
            Self::Memory(why) => write!(f, "{why}"),
            Self::Nobody(why) => write!(f, "{why}"),
            Self::NothingGiven => write!(
                f,
                "nothing to report on: name a log, a folder of logs, a --black-box or a --bus"
            ),
            Self::Empty => write!(
                f,
                "there is no frame in the logs: check that they are candump or ASC files"
            ),
            Self::Outside(frames) => write!(
                f,
                "all {frames} frames are outside the time asked for: look at --from and --to"
            ),
            Self::NoTime => write!(f, "--to is not after --from: swap them"),
            Self::Write(why) => write!(f, "{why}"),
            Self::Json(why) => write!(
                f,
                "cannot put the report into JSON: {why}; please report this as a defect"
            ),
            Self::Print(why) => write!(f, "cannot print the report: {why}"),
        }
    }
}

impl std::error::Error for PeriodError {}
