//! Why monitoring could not be done: one sentence that says which file or bus, and what to do.

use std::fmt;
use std::io;
use std::path::PathBuf;

use crate::bus::JoinError;
use crate::report::replay_tables::printable;

/// Why monitoring could not be done.
#[derive(Debug)]
pub enum MonitorError {
    /// The bus can't be joined.
    Join(JoinError),
    /// The bus was lost.
    Lost(io::Error),
    /// This recording exists already.
    Exists(PathBuf),
    /// This recording can't be written.
    Record(PathBuf, io::Error),
    /// The standard output can't be written.
    Print(io::Error),
    /// The reader has panicked.
    Reader,
}

impl std::error::Error for MonitorError {}

impl fmt::Display for MonitorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |path: &PathBuf| printable(&path.display().to_string());
        match self {
            Self::Join(error) => write!(f, "{error}"),
            Self::Lost(error) => write!(f, "{}", printable(&error.to_string())),
            Self::Exists(path) => write!(
                f,
                "{} exists already: name another file, or add --force to write over it",
                name(path)
            ),
            Self::Record(path, error) => write!(
                f,
                "recording to {} has ended: {error}; what was recorded until then is whole",
                name(path)
            ),
            Self::Print(error) => write!(f, "the output cannot be written: {error}"),
            Self::Reader => write!(
                f,
                "reading has ended by a fault of this program: please report what stands above"
            ),
        }
    }
}
