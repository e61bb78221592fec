//! Why no report could be made: one sentence that names the file and what to do.

use std::io;

use crate::blackbox::FaultsError;
use bus_logs::LogError;
use bus_master::JoinError;
use listen::PlanError;
use output::write::WriteError;

/// A report that could not be made. Nothing has been written when one is returned, but for
/// [`LogError::Incomplete`]: what could be read is in the report then.
#[derive(Debug, thiserror::Error)]
pub enum PeriodError {
    /// A log that can't be read.
    #[error("{0}")]
    Log(#[from] LogError),
    /// Instruments that can't be looked for.
    #[error("{0}")]
    Plan(#[from] PlanError),
    /// The bit rate is none.
    #[error("{0}")]
    Bus(JoinError),
    /// What nodes remember can't be read.
    #[error("{0}")]
    Memory(FaultsError),
    /// No node could be asked: why the first one could not.
    #[error("{0}")]
    Nobody(String),
    /// Neither a log, nor a black box, nor a bus was given.
    #[error("nothing to report on: name a log, a folder of logs, a --black-box or a --bus")]
    NothingGiven,
    /// There is no frame in all the logs.
    #[error("there is no frame in the logs: check that they are candump or ASC files")]
    Empty,
    /// There are frames, this many, but none in the time that was asked for.
    #[error("all {0} frames are outside the time asked for: look at --from and --to")]
    Outside(u64),
    /// The report could not be written.
    #[error("{0}")]
    Write(WriteError),
    /// The report could not be turned into JSON.
    #[error("cannot put the report into JSON: {0}; please report this as a defect")]
    Json(serde_json::Error),
    /// It could not be printed.
    #[error("cannot print the report: {0}")]
    Print(io::Error),
}
