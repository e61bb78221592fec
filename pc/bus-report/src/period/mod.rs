//! `plumb report`: a period of an instrument on one page.
//!
//! In: logs of a bus, as many and as long as there are, and what nodes remember of their faults,
//! out of files or asked over the bus. Out: `report.html` and `report.json` in a folder, and the
//! verdict with the main tables on the terminal. Frames are read by `watch`, counted by an
//! [`instrument::Instrument`] each, and kept in a [`summary::Summary`] whose size does not
//! grow with the log. The JSON is described in `docs/period-report.md`.
//!
//! Left out: a judgement of the machine. The exit status is 0 whatever the log tells, and 2 where a
//! part of it could not be read.

mod bins;
mod build;
mod capture;
mod charts;
mod clock;
mod collect;
mod data;
mod error;
mod events;
mod gaps;
mod histogram;
mod input;
mod instrument;
mod kind;
mod page;
mod row;
mod summary;
mod tables;
mod tally;
mod traffic;
mod verdict;

#[cfg(test)]
mod bench;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::blackbox::{self, data::MemoryReport};
use bus_logs::LogError;
use bus_master::BusOptions;
use bus_master::nodes::{NodeOption, Nodes};
use listen::Plan;
use listen::eds;
use output::printable;
use output::progress::Progress;
use output::stdout;
use output::table::wrap;
use output::write::{self, Written};

use collect::{Collector, Window};
use data::PeriodReport;
pub use error::PeriodError;

/// What is reported on, and where the report goes.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Logs of the bus
    #[arg(value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Leave out everything before: 2026-11-20, 2026-11-20T06:30:00 (UTC), or seconds of the log
    #[arg(long, value_name = "TIME", value_parser = clock::instant)]
    pub from: Option<u64>,
    /// Leave out everything from then on
    #[arg(long, value_name = "TIME", value_parser = clock::instant)]
    pub to: Option<u64>,
    /// Node-ids of channel A and B of an instrument; again for each; by default 1,2, 3,4 and so on
    #[arg(long, value_name = "A,B", value_parser = pair)]
    pub nodes: Vec<[u8; 2]>,
    /// EDS or DCF of a node that is not as delivered, FILE or FILE@NODE; again for each
    #[arg(long, value_name = "FILE[@NODE]")]
    pub eds: Vec<eds::Request>,
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

fn pair(text: &str) -> Result<[u8; 2], String> {
    let id = |text: &str| text.trim().parse().ok().filter(|id| (1..=127).contains(id));
    let ids = text
        .split_once(',')
        .and_then(|(a, b)| Some([id(a)?, id(b)?]));
    let ids = ids.filter(|[a, b]| a != b);
    ids.ok_or_else(|| {
        "write two node-ids from 1 to 127 with a comma between, such as 1,2".to_owned()
    })
}

impl Arguments {
    /// The instruments that are looked for.
    ///
    /// Errors: a data sheet can't be read.
    fn plan(&self) -> Result<Plan, PeriodError> {
        let pairs = match &self.nodes[..] {
            [] => (1..=125).step_by(2).map(|id| [id, id + 1]).collect(),
            pairs => pairs.to_vec(),
        };
        let mut plan = Plan::of(pairs);
        for request in &self.eds {
            let device = request.read().map_err(PeriodError::Eds)?;
            plan.nodes.push(device.plan().clone());
        }
        Ok(plan)
    }

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
        let nodes = self.nodes.as_flattened();
        NodeOption {
            node: (!nodes.is_empty()).then(|| Nodes::These(nodes.to_vec())),
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
    if let (Some(from), Some(to)) = (arguments.from, arguments.to)
        && to <= from
    {
        return Err(PeriodError::NoTime);
    }
    // First what can fail soon.
    let files = arguments.black_box.iter();
    let files: Result<Vec<_>, _> = files.map(|path| blackbox::from_file(path)).collect();
    let mut memories = files.map_err(PeriodError::Memory)?;
    let silent = ask(arguments, &mut memories)?;
    let (mut report, incomplete) = match &arguments.logs[..] {
        [] => (build::empty(), None),
        _ => read(arguments, progress)?,
    };
    report.memories = memories;
    report.notes = silent;
    build::conclude(&mut report);
    let html = page::page(&report);
    let written = write::both(&arguments.out, &html, &report).map_err(PeriodError::Write)?;
    let text = if arguments.json {
        serde_json::to_string(&report).map_err(PeriodError::Json)? + "\n"
    } else {
        shown(&report, &written)
    };
    stdout::print(text).map_err(PeriodError::Print)?;
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
    progress: &Progress,
) -> Result<(PeriodReport, Option<LogError>), PeriodError> {
    let window = Window {
        from_ns: arguments.from,
        to_ns: arguments.to,
    };
    let plan = arguments.plan()?;
    let mut collectors: Vec<Collector> = Vec::new();
    let logs = input::read(&arguments.logs, progress, |interface, time_ns, frame| {
        while collectors.len() <= interface {
            collectors.push(Collector::new(&plan, window));
        }
        if let Some(collector) = collectors.get_mut(interface) {
            collector.take(time_ns, frame);
        }
    })?;
    let collected: Vec<_> = collectors.into_iter().map(Collector::finish).collect();
    if collected.iter().all(|one| one.traffic.span_ns.is_none()) {
        return Err(match collected.iter().map(|one| one.outside).sum() {
            0 => PeriodError::Empty,
            frames => PeriodError::Outside(frames),
        });
    }
    let names = logs.interfaces.into_iter();
    let collected: Vec<_> = names.zip(collected).collect();
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
    text.push_str(&format!(
        "\nReport: {} and {}\n",
        printable(&written.html.display().to_string()),
        printable(&written.json.display().to_string())
    ));
    text
}
