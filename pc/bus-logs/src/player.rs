//! A log as if it happened now: frames of a part of it, when they are due.
//!
//! In: paths, a part of the log's time, and a [`Pace`]. Out: frame after frame with the instant at
//! which it is due; waiting is the caller's business, who may have other things to look after.
//! At the end it begins anew where that is wanted.

use std::path::PathBuf;
use std::time::Instant;

use crate::pace::{Pace, PaceOptions};
use crate::part::{Part, PartOptions};
use crate::source::Source;
use crate::{LogError, Logged};
use output::progress::Progress;

/// What to play and how.
#[derive(Clone, Debug, Default)]
pub struct PlayOptions {
    /// How fast.
    pub pace: PaceOptions,
    /// Which part of the log's time.
    pub part: PartOptions,
    /// Begin anew at the end.
    pub again: bool,
    /// The only interface.
    pub interface: Option<String>,
}

/// Plays logs.
pub struct Player {
    paths: Vec<PathBuf>,
    options: PlayOptions,
    source: Source,
    pace: Pace,
    part: Part,
    given: u64,
}

impl Player {
    /// Opens the logs.
    pub fn open(
        paths: &[PathBuf],
        options: PlayOptions,
        progress: &Progress,
    ) -> Result<Self, LogError> {
        let source = Source::of_interface(paths, options.interface.as_deref(), progress)?;
        Ok(Self {
            paths: paths.to_vec(),
            pace: Pace::new(options.pace),
            part: options.part.part()?,
            options,
            source,
            given: 0,
        })
    }

    /// The next frame and when it is due; `None` at the end.
    pub fn next(&mut self, now: Instant) -> Option<Result<(Logged, Instant), LogError>> {
        loop {
            match self.source.next() {
                Some(Ok(logged)) => {
                    if self.part.has(logged.time_ns) {
                        self.given += 1;
                        let due = self.pace.due(logged.time_ns, now);
                        return Some(Ok((logged, due)));
                    }
                    continue;
                }
                Some(Err(error)) => return Some(Err(error)),
                None => {}
            }
            // A part that holds nothing would begin anew for ever.
            if !self.options.again || self.given == 0 {
                return None;
            }
            if let Err(error) = self.rewind() {
                return Some(Err(error));
            }
        }
    }

    fn rewind(&mut self) -> Result<(), LogError> {
        let interface = self.options.interface.as_deref();
        // The bar has run once.
        self.source = Source::of_interface(&self.paths, interface, &Progress::hidden())?;
        self.part = self.options.part.part()?;
        self.given = 0;
        Ok(())
    }

    /// The logs, with what was skipped.
    pub const fn source(&self) -> &Source {
        &self.source
    }

    /// The pace, to pause it or to change it.
    pub const fn pace(&mut self) -> &mut Pace {
        &mut self.pace
    }
}
