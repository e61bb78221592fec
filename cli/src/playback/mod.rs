//! `plumb replay` of bus logs: what the nodes have said, from files instead of a bus.
//!
//! In: logs that `log` reads, files or whole folders. Out: a summary per interface and instrument,
//! or its JSON. Every interface has a [`crate::watch::Watch`] of its own, so two buses in one log
//! are two instruments. `docs/logs.md` describes it.
//!
//! Left out: recordings of bare sensors, which `replay` runs through the signal chain.

mod bus;
mod error;
mod json;
mod options;
mod summary;
mod text;

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use crate::log::{LogError, Source};
use crate::progress::Progress;

pub use error::PlaybackError;
pub use options::Options;
use summary::Summary;

/// Reads the logs and tells what they say; exit status 0, whatever that is.
pub fn run(
    paths: &[PathBuf],
    options: &Options,
    json: bool,
    progress: &Progress,
) -> Result<ExitCode, PlaybackError> {
    let mut source = Source::of_interface(paths, options.interface.as_deref(), progress)?;
    let mut summary = Summary::new(options.plan());
    while let Some(logged) = source.next() {
        summary.take(&logged?);
    }
    if let Some(wanted) = &options.interface
        && source.frames() == 0
    {
        let there = source.interfaces().to_vec();
        return Err(LogError::NoSuchInterface(wanted.clone(), there).into());
    }
    let report = json::Report::new(&summary, &source);
    let text = if json {
        serde_json::to_string(&report).map_err(PlaybackError::Json)? + "\n"
    } else {
        text::of(&report)
    };
    print(&text)
}

fn print(text: &str) -> Result<ExitCode, PlaybackError> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        // Whoever reads has seen enough.
        Err(why) if why.kind() != io::ErrorKind::BrokenPipe => Err(PlaybackError::Stdout(why)),
        _ => Ok(ExitCode::SUCCESS),
    }
}
