//! What logs came to, kept as bytes that can be merged.
//!
//! In: logs, or the bytes of summaries. Out: a [`Kept`], and its bytes: one JSON object, of which
//! version 2 is read. Every figure is a whole number, so summaries merged in any order and in any
//! groups have the same bytes. The size does not grow with a log, but for a row per day and the
//! name of each log. The report of a summary is that of its logs, except that time between two
//! logs that were summarised apart is in no gap.
//!
//! Left out: where the bytes are stored, and whether a log was counted before.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::data::{LogsReport, PeriodReport, Skipped};
use super::error::PeriodError;
use super::input::collect;
use super::{build, page};
use crate::totals::Collected;
use bus_logs::{LogError, PartOptions, Source, is_dated};
use listen::PlanOptions;
use output::progress::Progress;
use output::write::{self, Written};

/// Name of the form.
const FORMAT: &str = "plumb-summary";

/// Version of the form. It rises when a field changes its meaning or goes away.
const VERSION: u32 = 2;

/// Why bytes are no summary that can be used.
#[derive(Debug, thiserror::Error)]
pub enum KeptError {
    /// They are something else, or damaged.
    #[error("these bytes are no summary of logs: {0}")]
    NotASummary(serde_json::Error),
    /// They have another form.
    #[error("these bytes are no summary of logs: their format is not {FORMAT}")]
    Format,
    /// They are of another version.
    #[error(
        "this summary is of version {0}, and version {VERSION} is read: summarise its log anew"
    )]
    Version(u32),
    /// There is none.
    #[error("there is no summary to merge: give at least one")]
    Nothing,
}

/// What bytes begin with.
#[derive(Deserialize)]
struct Head {
    format: String,
    version: u32,
}

/// A summary of logs.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Kept {
    format: String,
    version: u32,
    logs: LogsReport,
    /// By the name of the interface.
    buses: BTreeMap<String, Collected>,
}

impl Kept {
    /// Summarises logs, of the instruments that are named or of all pairs of nodes; also what of
    /// the logs could not be read.
    ///
    /// Errors: see [`PeriodError`].
    pub fn of(
        paths: &[PathBuf],
        plan: &PlanOptions,
    ) -> Result<(Self, Option<LogError>), PeriodError> {
        Self::of_source(Source::open(paths, &Progress::hidden())?, plan)
    }

    /// The same of one file, whose bytes go through what `through` makes of it.
    ///
    /// Errors: see [`PeriodError`].
    pub fn of_file<R: Read + Send + 'static>(
        path: &Path,
        plan: &PlanOptions,
        through: impl FnOnce(File) -> R,
    ) -> Result<(Self, Option<LogError>), PeriodError> {
        Self::of_source(Source::of_file(path, through)?, plan)
    }

    fn of_source(
        source: Source,
        plan: &PlanOptions,
    ) -> Result<(Self, Option<LogError>), PeriodError> {
        let part = PartOptions::default().part()?;
        let (collected, logs) = collect(source, plan, part)?;
        let mut kept = Self::of_nothing();
        merge_logs(&mut kept.logs, &without_folders(&logs.report));
        for (interface, mut bus) in collected {
            bus.drop_empty();
            kept.merge_bus(&interface, &bus);
        }
        Ok((kept, logs.incomplete))
    }

    fn of_nothing() -> Self {
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            logs: LogsReport::default(),
            buses: BTreeMap::new(),
        }
    }

    /// The summary of a bus without its logs.
    #[cfg(test)]
    pub(super) fn of_bus(interface: &str, bus: Collected) -> Self {
        let mut kept = Self::of_nothing();
        kept.merge_bus(interface, &bus);
        kept
    }

    /// Reads the bytes of a summary.
    ///
    /// Errors: see [`KeptError`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, KeptError> {
        let head: Head = serde_json::from_slice(bytes).map_err(KeptError::NotASummary)?;
        match (head.format.as_str(), head.version) {
            (FORMAT, VERSION) => serde_json::from_slice(bytes).map_err(KeptError::NotASummary),
            (FORMAT, version) => Err(KeptError::Version(version)),
            _ => Err(KeptError::Format),
        }
    }

    /// The bytes of it.
    ///
    /// Errors: it could not be turned into JSON.
    pub fn to_bytes(&self) -> Result<Vec<u8>, PeriodError> {
        serde_json::to_vec(self).map_err(PeriodError::Json)
    }

    /// Merges summaries, however many there are.
    ///
    /// Errors: [`KeptError::Nothing`].
    pub fn merged(all: impl IntoIterator<Item = Self>) -> Result<Self, KeptError> {
        let both = |mut one: Self, other: Self| {
            one.merge(&other);
            one
        };
        all.into_iter().reduce(both).ok_or(KeptError::Nothing)
    }

    /// Frames that were read.
    pub const fn frames(&self) -> u64 {
        self.logs.frames
    }

    /// First and last frame, ns since 1970; none where their times are no dates.
    pub fn dated_ns(&self) -> Option<(u64, u64)> {
        let spans = self.buses.values();
        let spans = spans.filter_map(|bus| bus.traffic.span_ns());
        let dated = spans.filter(|(first_ns, _)| is_dated(*first_ns));
        dated.reduce(|one, other| (one.0.min(other.0), one.1.max(other.1)))
    }

    /// The same of a log that has another name now: the summary of one log is found by what is in
    /// the log, not by its name.
    pub fn renamed(mut self, name: &str) -> Self {
        let logs = &mut self.logs;
        for damaged in &mut logs.damaged {
            let files = logs.files.iter();
            let how = files
                .filter_map(|file| damaged.strip_prefix(file.as_str()))
                .max_by_key(|how| how.len());
            *damaged = format!("{name}{}", how.unwrap_or_default());
        }
        for kind in &mut logs.skipped {
            name.clone_into(&mut kind.file);
        }
        for one in logs.files.iter_mut().chain(&mut logs.undated) {
            name.clone_into(one);
        }
        self
    }

    fn merge(&mut self, other: &Self) {
        merge_logs(&mut self.logs, &other.logs);
        for (interface, bus) in &other.buses {
            self.merge_bus(interface, bus);
        }
    }

    fn merge_bus(&mut self, interface: &str, bus: &Collected) {
        match self.buses.get_mut(interface) {
            Some(own) => own.merge(bus),
            None => {
                self.buses.insert(interface.to_owned(), bus.clone());
            }
        }
    }

    /// The report of it, as the JSON of `plumb report`.
    ///
    /// Errors: [`PeriodError::Json`].
    pub fn figures(self, bit_rate: Option<f64>) -> Result<Vec<u8>, PeriodError> {
        serde_json::to_vec(&self.concluded(bit_rate)).map_err(PeriodError::Json)
    }

    pub(super) fn concluded(self, bit_rate: Option<f64>) -> PeriodReport {
        let buses: Vec<_> = self.buses.into_iter().collect();
        let mut report = build::report(&buses, Some(self.logs), bit_rate);
        build::conclude(&mut report);
        report
    }

    /// Writes the report of it, as `plumb report` makes it, into a folder; `bit_rate` in bit/s
    /// where it is known.
    ///
    /// Errors: [`PeriodError::Write`].
    pub fn report(self, folder: &Path, bit_rate: Option<f64>) -> Result<Written, PeriodError> {
        let report = self.concluded(bit_rate);
        write::both(folder, &page::page(&report), &report).map_err(PeriodError::Write)
    }
}

/// The same with the names of files alone: a log that was moved is the same log.
fn without_folders(logs: &LogsReport) -> LogsReport {
    let name = |path: &String| {
        let name = Path::new(path).file_name();
        name.map_or_else(|| path.clone(), |name| name.to_string_lossy().into_owned())
    };
    let names = |paths: &[String]| paths.iter().map(name).collect();
    let skipped = logs.skipped.iter().map(|kind| Skipped {
        file: name(&kind.file),
        ..kind.clone()
    });
    LogsReport {
        files: names(&logs.files),
        skipped: skipped.collect(),
        damaged: names(&logs.damaged),
        not_logs: names(&logs.not_logs),
        undated: names(&logs.undated),
        ..*logs
    }
}

/// Takes what was read and skipped in other logs; every list is in the order of its texts.
fn merge_logs(own: &mut LogsReport, other: &LogsReport) {
    // Counters of a forged summary may have any size. Saturating addition of numbers without a
    // sign is the same in every order and grouping, as merging has to be.
    own.frames = own.frames.saturating_add(other.frames);
    own.overlapping = own.overlapping.saturating_add(other.overlapping);
    for (own, other) in [
        (&mut own.files, &other.files),
        (&mut own.damaged, &other.damaged),
        (&mut own.not_logs, &other.not_logs),
        (&mut own.undated, &other.undated),
    ] {
        own.extend_from_slice(other);
        own.sort_unstable();
    }
    for kind in &other.skipped {
        match own.skipped.iter_mut().find(|one| one.reason == kind.reason) {
            Some(one) => {
                let first = (&kind.file, kind.first_line) < (&one.file, one.first_line);
                let count = one.count.saturating_add(kind.count);
                if first {
                    *one = kind.clone();
                }
                one.count = count;
            }
            None => own.skipped.push(kind.clone()),
        }
    }
    own.skipped.sort_unstable();
}
