//! Where frames come from, and what they come to.
//!
//! In: logs that are open. Out: of each interface what `totals` makes of its frames in the
//! order of time, and what was counted besides (`bus-logs`).

use canopen::Frame;

use super::data::{LogsReport, Skipped};
use super::error::PeriodError;
use crate::totals::{Collected, Collector};
use bus_logs::{LogError, Part, Source};
use listen::{PlanOptions, Unnamed};

/// What was read.
#[derive(Debug, Default)]
pub struct Logs {
    /// The files and what was skipped in them.
    pub report: LogsReport,
    /// The names of the interfaces.
    pub interfaces: Vec<String>,
    /// What of the logs could not be read.
    pub incomplete: Option<LogError>,
}

/// What each interface came to, by its name, and the logs that were read.
///
/// Errors: a log can't be read, or there is no frame in the part.
pub fn collect(
    source: Source,
    plan: &PlanOptions,
    mut part: Part,
) -> Result<(Vec<(String, Collected)>, Logs), PeriodError> {
    let (plan, _) = plan.plan(Unnamed::All)?;
    let mut collectors: Vec<Collector> = Vec::new();
    let logs = read(source, |interface, time_ns, frame| {
        while collectors.len() <= interface {
            collectors.push(Collector::new(&plan));
        }
        let Some(collector) = collectors.get_mut(interface) else {
            return;
        };
        if part.has(time_ns) {
            collector.take(time_ns, frame);
        } else {
            collector.pass_over();
        }
    })?;
    let collected: Vec<_> = collectors.into_iter().map(Collector::finish).collect();
    if collected.iter().all(|one| one.traffic.span_ns().is_none()) {
        return Err(match collected.iter().map(|one| one.outside).sum() {
            0 => PeriodError::Empty,
            frames => PeriodError::Outside(frames),
        });
    }
    let names = logs.interfaces.iter().cloned();
    let collected: Vec<_> = names.zip(collected).collect();
    Ok((collected, logs))
}

/// Reads logs; `take` gets the place of each frame's interface, its time in ns, and the frame.
///
/// Errors: a log can't be read.
pub fn read(
    mut source: Source,
    mut take: impl FnMut(usize, u64, &Frame),
) -> Result<Logs, PeriodError> {
    while let Some(logged) = source.next().transpose().map_err(PeriodError::Log)? {
        take(logged.interface.into(), logged.time_ns, &logged.frame);
    }
    Ok(Logs {
        report: logs_report(&source),
        interfaces: source.interfaces().to_vec(),
        incomplete: source.incomplete(),
    })
}

/// What of the logs was read so far, and what was skipped in them.
pub fn logs_report(source: &Source) -> LogsReport {
    let skipped = source.skipped();
    let kinds = skipped.kinds().map(|(kind, tally)| Skipped {
        reason: kind.words().to_owned(),
        count: tally.count,
        file: source.name(tally.file),
        first_line: tally.line,
    });
    let damaged = skipped.damaged.iter();
    let damaged = damaged.map(|(place, how)| format!("{}: {}", source.name(*place), how.words()));
    LogsReport {
        files: source.files().to_vec(),
        frames: source.frames(),
        skipped: kinds.collect(),
        damaged: damaged.collect(),
        not_logs: skipped.not_logs.clone(),
        overlapping: skipped.overlapping,
        undated: skipped
            .undated
            .iter()
            .map(|place| source.name(*place))
            .collect(),
    }
}
