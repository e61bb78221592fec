//! `plumb replay` of bus logs: what the nodes have said, from files instead of a bus.
//!
//! In: logs that `log` reads, files or whole folders. Out: a summary per interface and instrument,
//! or its JSON; all values as a table; or the frames on a bus, when they are due. Every interface
//! is counted for itself (`totals`), so two buses in one log are two instruments.
//! `docs/logs.md` describes it.
//!
//! Left out: recordings of bare sensors, which `replay` runs through the signal chain.

mod contents;
mod error;
mod export;
mod foreign;
mod json;
mod onto;
mod options;
mod parquet_file;
mod reading;
mod row;
mod rows;
mod summary;
mod table;
mod text;

use std::path::PathBuf;
use std::process::ExitCode;

use bus_logs::Moment;
use listen::Unnamed;
use output::progress::Progress;
use output::stdout;
use output::write::Existing;

pub use error::PlaybackError;
pub use options::Options;
pub use row::{COLUMNS, Row, unit};
pub use table::{Given, Table};

use contents::Contents;
use export::Export;
use reading::Reading;
use summary::Summary;

/// What is asked of the logs beside their own options.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// Where they begin.
    pub from: Option<Moment>,
    /// Print JSON.
    pub json: bool,
    /// What becomes of a file where the table is to be.
    pub existing: Existing,
}

/// Reads the logs and reports what they contain, or plays them; exit status 0, whatever that is.
///
/// Errors: see [`PlaybackError`]. When all is done and told, one that states what of the logs
/// could not be read.
pub fn run(
    paths: &[PathBuf],
    options: &Options,
    Asked {
        from,
        json,
        existing,
    }: Asked,
    progress: &Progress,
) -> Result<ExitCode, PlaybackError> {
    if options.onto.is_some() {
        options.plan.plan(Unnamed::One)?;
        return onto::run(paths, options, from, json);
    }
    let part = options.part(from).part()?;
    let (plan, devices) = options.plan.plan(Unnamed::One)?;
    let mut export = match &options.export {
        Some(path) => Some(Export::create(path, existing, paths, &devices)?),
        None => None,
    };
    let channel = options.channel.as_deref();
    let mut reading = Reading::open(paths, channel, part, Summary::new(plan, devices), progress)?;
    while let Some((logged, news)) = reading.next()? {
        if let Some(export) = &mut export {
            let interfaces = reading.source.interfaces();
            export.take(&logged, interfaces, news, &reading.summary)?;
        }
    }
    let Reading {
        source,
        part,
        summary,
        ..
    } = reading;
    let exported = export.map(Export::finish).transpose()?;
    let contents = Contents::of(summary, &source, part.outside(), exported);
    let text = || text::of(&contents);
    stdout::print_as(json, &json::of(&contents), text).map_err(PlaybackError::Stdout)?;
    match source.incomplete() {
        Some(why) => Err(why.into()),
        None => Ok(ExitCode::SUCCESS),
    }
}
