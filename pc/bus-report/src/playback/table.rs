//! The rows of a table one after the other, for a program instead of a file.
//!
//! In: names of logs and the options of `plumb replay`. Out: the same rows in the same order as
//! `--export` writes them, in memory that does not grow with the logs; and behind the last one
//! what was counted besides.

use std::path::PathBuf;

use super::reading::Reading;
use super::row::Row;
use super::rows::Rows;
use super::summary::Summary;
use super::{Options, PlaybackError};
use bus_logs::{LogError, Moment};
use listen::Unnamed;
use output::progress::Progress;

use crate::period::{LogsReport, logs_report};

/// A table under way.
pub struct Table {
    reading: Reading,
    rows: Rows,
}

/// How many rows were given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Given {
    /// So many, and there may be more.
    Some(usize),
    /// So many, and the logs have ended.
    Last(usize),
}

impl Table {
    /// Opens the logs that a table is made of; `options` may name an interface, instruments, data
    /// sheets and the end.
    ///
    /// Errors: see [`PlaybackError`].
    pub fn open(
        paths: &[PathBuf],
        options: &Options,
        from: Option<Moment>,
    ) -> Result<Self, PlaybackError> {
        let part = options.part(from).part()?;
        let (plan, devices) = options.plan.plan(Unnamed::One)?;
        let rows = Rows::new(&devices);
        let (channel, summary) = (options.channel.as_deref(), Summary::new(plan, devices));
        Ok(Self {
            reading: Reading::open(paths, channel, part, summary, &Progress::hidden())?,
            rows,
        })
    }

    /// The columns behind [`COLUMNS`](super::COLUMNS): signals of other nodes.
    pub fn signals(&self) -> &[String] {
        self.rows.signals()
    }

    /// Gives up to `most` rows to `take`, each with the values of [`Table::signals`], out of up to
    /// `most_frames` frames, which may be of others and give none.
    ///
    /// Errors: a log can't be read. What stood before was given.
    pub fn give(
        &mut self,
        (most, most_frames): (usize, usize),
        mut take: impl FnMut(&Row<'_>, &[Option<f64>]),
    ) -> Result<Given, PlaybackError> {
        let mut count = 0;
        for _ in 0..most_frames {
            if count == most {
                break;
            }
            let Some((logged, news)) = self.reading.next()? else {
                return Ok(Given::Last(count));
            };
            let Reading {
                source, summary, ..
            } = &self.reading;
            if let Some((row, extra)) = self.rows.of(&logged, source.interfaces(), news, summary) {
                take(&row, extra);
                count += 1;
            }
        }
        Ok(Given::Some(count))
    }

    /// What was read and skipped so far.
    pub fn logs(&self) -> LogsReport {
        logs_report(&self.reading.source)
    }

    /// What of the logs could not be read so far; `None` when nothing is missing.
    pub fn incomplete(&self) -> Option<LogError> {
        self.reading.source.incomplete()
    }
}
