//! A log as if it happened now: frames of a part of it, when they are due.
//!
//! In: paths, a part of the log's time, and a [`Pace`]. Out: frame after frame with the instant at
//! which it is due; waiting is the caller's business, who may have other things to look after.
//! At the end it begins anew where that is wanted.

use std::path::PathBuf;
use std::time::Instant;

use crate::date::{is_dated, moment};
use crate::pace::{Pace, PaceOptions};
use crate::source::Source;
use crate::{LogError, Logged};
use output::progress::Progress;

/// A moment of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moment {
    /// Seconds since its first frame.
    AfterStart(f64),
    /// ns since 1970.
    At(u64),
}

impl Moment {
    /// Whether it is behind `other`; `None` where only the log tells, of which one is counted from
    /// its beginning.
    pub fn is_after(self, other: Self) -> Option<bool> {
        match (self, other) {
            (Self::AfterStart(one), Self::AfterStart(other)) => Some(one > other),
            (Self::At(one), Self::At(other)) => Some(one > other),
            _ => None,
        }
    }
}

impl std::str::FromStr for Moment {
    type Err = String;

    /// Seconds since the first frame, seconds since 1970, or a date.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Some(ns) = moment(text) {
            return Ok(Self::At(ns));
        }
        let seconds: f64 = text.parse().unwrap_or(f64::NAN);
        let ns = seconds * 1e9;
        if !(0.0..1.8e19).contains(&ns) {
            return Err("give seconds since its start, or a date as 2026-11-22T12:30:00".into());
        }
        Ok(if is_dated(ns as u64) {
            Self::At(ns as u64)
        } else {
            Self::AfterStart(seconds)
        })
    }
}

impl Moment {
    /// In ns of a log whose first frame has this time.
    pub fn ns(self, first_ns: u64) -> u64 {
        match self {
            Self::AfterStart(seconds) => first_ns.saturating_add((seconds * 1e9) as u64),
            Self::At(ns) => ns,
        }
    }
}

/// A part of a log's time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Part {
    from: Option<Moment>,
    to: Option<Moment>,
    first_ns: Option<u64>,
    outside: u64,
}

impl Part {
    /// From one moment to another; both belong to it.
    pub const fn new(from: Option<Moment>, to: Option<Moment>) -> Self {
        Self {
            from,
            to,
            first_ns: None,
            outside: 0,
        }
    }

    /// Whether a frame of this time is in it. The first one that is asked about begins the log.
    #[inline]
    pub fn has(&mut self, time_ns: u64) -> bool {
        if self.from.is_none() && self.to.is_none() {
            return true;
        }
        let first_ns = *self.first_ns.get_or_insert(time_ns);
        let before = self.from.is_some_and(|from| time_ns < from.ns(first_ns));
        let behind = self.to.is_some_and(|to| time_ns > to.ns(first_ns));
        self.outside += u64::from(before || behind);
        !before && !behind
    }

    /// Frames that were not in it.
    pub const fn outside(&self) -> u64 {
        self.outside
    }
}

/// What to play and how.
#[derive(Clone, Debug, Default)]
pub struct PlayOptions {
    /// How fast.
    pub pace: PaceOptions,
    /// Frames before are passed over.
    pub from: Option<Moment>,
    /// It ends before the first frame that is later.
    pub to: Option<Moment>,
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
            part: Part::new(options.from, options.to),
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
        self.part = Part::new(self.options.from, self.options.to);
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
