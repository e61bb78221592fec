//! Why a demo or a replay could not be carried out: one sentence that states what to do.
//!
//! In: the errors of the bench, of files and of the report. Out: one type for both verbs.

use output::write::WriteError;
use sim::bench::BenchError;

use crate::recordings::FileError;

/// A demo or a replay that could not be carried out.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A recording or a calibration file can't be used; nothing has been written.
    #[error(transparent)]
    File(#[from] FileError),
    /// An instrument could not be brought up.
    #[error("an instrument could not be calibrated: {0}")]
    Bench(#[from] BenchError),
    /// The report could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The result could not be printed; the report itself is written.
    #[error("the result can't be printed: {0}; the report is in its folder")]
    Print(std::io::Error),
}
