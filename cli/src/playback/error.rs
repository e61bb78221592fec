//! Why logs could not be played back: one sentence each.

use std::{fmt, io};

use crate::log::LogError;

/// Logs that could not be played back.
#[derive(Debug)]
pub enum PlaybackError {
    /// A log that can't be read.
    Log(LogError),
    /// The summary could not be turned into JSON.
    Json(serde_json::Error),
    /// Standard output could not be written.
    Stdout(io::Error),
}

impl std::error::Error for PlaybackError {}

impl fmt::Display for PlaybackError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Log(error) => write!(f, "{error}"),
            Self::Json(error) => write!(f, "the summary can't be written as JSON: {error}"),
            Self::Stdout(error) => write!(f, "standard output can't be written: {error}"),
        }
    }
}

impl From<LogError> for PlaybackError {
    fn from(error: LogError) -> Self {
        Self::Log(error)
    }
}
