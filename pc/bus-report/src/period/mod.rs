//! `plumb report`: a period of an instrument on one page.
//!
//! In: logs of a bus, as many and as long as there are, and what nodes remember of their faults,
//! out of files or asked over the bus. Out: `report.html` and `report.json` in a folder, and the
//! verdict with the main tables on the terminal. `totals` counts what the logs come to, in a size
//! that does not grow with them. The JSON is described in `docs/period-report.md`.
//!
//! Left out: a judgement of the machine. The exit status is 0 whatever the log tells, and 2 where a
//! part of it could not be read.

mod build;
mod charts;
mod clock;
mod data;
mod error;
mod input;
mod kept;
mod page;
mod tables;
mod verdict;

#[cfg(test)]
mod bench;
#[cfg(test)]
mod forged_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod unit_tests;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::blackbox::{self, data::MemoryReport};
use bus_logs::{LogError, Part, PartOptions, Source};
use bus_master::BusOptions;
use bus_master::nodes::{NodeOption, Nodes};
use listen::PlanOptions;
use output::printable;
use output::progress::Progress;
use output::stdout;
use output::table::wrap;
use output::write::{self, Written};

use data::PeriodReport;
pub use data::{LogsReport, Skipped};
pub use error::PeriodError;
pub use input::logs_report;
pub use kept::{Kept, KeptError};

/// What is reported on, and where the report goes.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Logs of the bus
    #[arg(value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Which part of the logs.
    #[command(flatten)]
    pub part: PartOptions,
    /// Which instruments; 1,2, 3,4 and so on by default.
    #[command(flatten)]
    pub plan: PlanOptions,
    /// Files of a fault log or black box, as `plumb faults --boxes` saves them
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub black_box: Vec<PathBuf>,
    /// Folder for report.html and report.json
    #[arg(long, default_value = "plumb-period", value_name = "DIR")]
    pub out: PathBuf,
    /// Print the report as JSON
    #[arg(long)]
    pub json: bool,
    /// The bus whose nodes are read for their faults; its bit rate, to state the load in per cent
    #[command(flatten)]
    pub bus: BusOptions,
}

impl Arguments {
    /// True when a bus is named, whose nodes are to be asked for what they remember. The variables
    /// of python-can alone are no wish to ask anybody.
    fn asks(&self) -> bool {
        let BusOptions {
            bus,
            interface,
            channel,
            ..
        } = &self.bus;
        [bus, interface, channel].into_iter().any(Option::is_some)
    }

    /// The nodes that are asked: those of the instruments, or all that are there.
    fn asked(&self) -> NodeOption {
        let nodes = &self.plan.nodes;
        NodeOption {
            node: (!nodes.is_empty()).then(|| Nodes::These(nodes.clone())),
        }
    }
}

/// Makes the report; exit status 0 whatever it tells, and an error behind it where a part of the
/// logs could not be read.
///
/// Errors: see [`PeriodError`].
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, PeriodError> {
    if arguments.logs.is_empty() && arguments.black_box.is_empty() && !arguments.asks() {
        return Err(PeriodError::NothingGiven);
    }
    let part = arguments.part.part()?;
    // First what can fail soon.
    let files = arguments.black_box.iter();
    let files: Result<Vec<_>, _> = files.map(|path| blackbox::from_file(path)).collect();
    let mut memories = files.map_err(PeriodError::Memory)?;
    let silent = ask(arguments, &mut memories)?;
    let (mut report, incomplete) = match &arguments.logs[..] {
        [] => (build::empty(), None),
        _ => read(arguments, part, progress)?,
    };
    report.memories = memories;
    report.notes = silent;
    build::conclude(&mut report);
    let html = page::page(&report);
    let written = write::both(&arguments.out, &html, &report).map_err(PeriodError::Write)?;
    let text = || shown(&report, &written);
    stdout::print_as(arguments.json, &report, text).map_err(PeriodError::Print)?;
    match incomplete {
        Some(why) => Err(PeriodError::Log(why)),
        None => Ok(ExitCode::SUCCESS),
    }
}

/// Asks the nodes; a sentence for each that does not answer, where there is anything else to tell.
fn ask(
    arguments: &Arguments,
    memories: &mut Vec<MemoryReport>,
) -> Result<Vec<String>, PeriodError> {
    if !arguments.asks() {
        return Ok(Vec::new());
    }
    let asked = blackbox::from_bus(&arguments.bus, &arguments.asked());
    let (told, silent) = asked.map_err(PeriodError::Memory)?;
    memories.extend(told);
    if let (true, true, Some(why)) = (
        memories.is_empty(),
        arguments.logs.is_empty(),
        silent.first(),
    ) {
        return Err(PeriodError::Nobody(why.clone()));
    }
    let note = |why: String| format!("Not in this report: {why}.");
    Ok(silent.into_iter().map(note).collect())
}

/// Reads all logs, each interface for itself; also what of them could not be read.
fn read(
    arguments: &Arguments,
    part: Part,
    progress: &Progress,
) -> Result<(PeriodReport, Option<LogError>), PeriodError> {
    let source = Source::open(&arguments.logs, progress)?;
    let (collected, logs) = input::collect(source, &arguments.plan, part)?;
    let kbit_s = arguments.bus.address().map_err(PeriodError::Bus)?.kbit_s;
    let bit_rate = kbit_s.map(|kbit_s| f64::from(kbit_s) * 1e3);
    let report = build::report(&collected, Some(logs.report), bit_rate);
    Ok((report, logs.incomplete))
}

/// What the terminal shows.
fn shown(report: &PeriodReport, written: &Written) -> String {
    let mut text = wrap(&report.verdict, 96);
    for instrument in &report.instruments {
        text.push_str(&format!("\nInstrument {}\n", instrument.number));
        let all = [
            tables::days(instrument),
            tables::events(report, instrument, true),
            tables::angles(instrument),
            tables::rates(instrument),
            tables::difference(instrument),
        ];
        for table in all.iter().filter(|table| !table.rows.is_empty()) {
            text.push('\n');
            text.push_str(&table.to_text());
        }
    }
    for memory in report
        .memories
        .iter()
        .filter(|memory| !memory.entries.is_empty())
    {
        let title = format!("Fault log of {}", printable(&memory.source));
        text.push('\n');
        text.push_str(&blackbox::data::table(memory, &title).to_text());
    }
    for note in &report.notes {
        text.push('\n');
        text.push_str(&wrap(note, 96));
    }
    text + "\n" + &written.line()
}
