//! `plumb replay` of bus logs: what the nodes have said, from files instead of a bus.
//!
//! In: logs that `log` reads, files or whole folders. Out: a summary per interface and instrument,
//! or its JSON; all values as a table; or the frames on a bus, when they are due. Every interface
//! is counted for itself (`totals`), so two buses in one log are two instruments.
//! `docs/logs.md` describes it.
//!
//! Left out: recordings of bare sensors, which `replay` runs through the signal chain.

mod error;
mod export;
mod foreign;
mod json;
mod onto;
mod options;
mod parquet_file;
mod row;
mod summary;
mod text;

use std::path::PathBuf;
use std::process::ExitCode;

use bus_logs::{LogError, Moment, Source};
use listen::Unnamed;
use output::progress::Progress;
use output::stdout;

pub use error::PlaybackError;
pub use options::Options;

use export::Export;
use foreign::Foreign;
use summary::Summary;

/// Reads the logs and tells what they say, or plays them; exit status 0, whatever that is.
///
/// Errors: see [`PlaybackError`]. When all is done and told, one that says what of the logs could
/// not be read.
pub fn run(
    paths: &[PathBuf],
    options: &Options,
    from: Option<Moment>,
    json: bool,
    progress: &Progress,
) -> Result<ExitCode, PlaybackError> {
    let mut part = options.part(from).part()?;
    let (plan, devices) = options.plan.plan(Unnamed::One)?;
    if options.onto.is_some() {
        return onto::run(paths, options, from, json);
    }
    let mut export = match &options.export {
        Some(path) => Some(Export::create(path, paths, &devices)?),
        None => None,
    };
    let mut source = Source::of_interface(paths, options.channel.as_deref(), progress)?;
    let mut summary = Summary::new(plan, Foreign::new(devices));
    while let Some(logged) = source.next() {
        let logged = logged?;
        if !part.has(logged.time_ns) {
            continue;
        }
        let news = summary.take(&logged);
        if let Some(export) = &mut export {
            export.take(&logged, source.interfaces(), news, &summary)?;
        }
    }
    if let Some(wanted) = &options.channel
        && source.frames() == 0
    {
        let there = source.interfaces().to_vec();
        return Err(LogError::NoSuchInterface(wanted.clone(), there).into());
    }
    let exported = export.map(Export::finish).transpose()?;
    let mut report = json::Report::new(summary, &source);
    report.outside = part.outside();
    report.export = exported;
    if json {
        stdout::print_json(&report)
    } else {
        stdout::print(text::of(&report))
    }
    .map_err(PlaybackError::Stdout)?;
    match source.incomplete() {
        Some(why) => Err(why.into()),
        None => Ok(ExitCode::SUCCESS),
    }
}
