//! Logs under way: each frame of the part that was asked for, taken by the summary.
//!
//! In: names of logs, the part, an empty [`Summary`]. Out: each frame with what it means, and at
//! the end what the logs came to.

use std::path::PathBuf;

use super::PlaybackError;
use super::summary::Summary;
use bus_logs::{LogError, Logged, Part, Source};
use listen::Meaning;
use output::progress::Progress;

/// Logs under way.
pub struct Reading {
    /// The logs.
    pub source: Source,
    /// The part of them that is read.
    pub part: Part,
    /// What they have come to so far.
    pub summary: Summary,
    /// The interface that alone was asked for.
    wanted: Option<String>,
}

impl Reading {
    /// Opens the logs, of one interface only where that is named.
    ///
    /// Errors: none of them is a log, or one can't be read.
    pub fn open(
        paths: &[PathBuf],
        wanted: Option<&str>,
        part: Part,
        summary: Summary,
        progress: &Progress,
    ) -> Result<Self, PlaybackError> {
        Ok(Self {
            source: Source::of_interface(paths, wanted, progress)?,
            part,
            summary,
            wanted: wanted.map(str::to_owned),
        })
    }

    /// The next frame of the part, and what it means; `None` at the end.
    ///
    /// Errors: a log can't be read, or at the end the interface that was named has no frame.
    #[inline]
    pub fn next(&mut self) -> Result<Option<(Logged, Meaning)>, PlaybackError> {
        for logged in self.source.by_ref() {
            let logged = logged?;
            if self.part.has(logged.time_ns) {
                let news = self.summary.take(&logged);
                return Ok(Some((logged, news)));
            }
        }
        match self.wanted.take() {
            Some(wanted) if self.source.frames() == 0 => {
                let there = self.source.interfaces().to_vec();
                Err(LogError::NoSuchInterface(wanted, there).into())
            }
            _ => Ok(None),
        }
    }
}
