//! `plumb report`: a period of an instrument on one page.
//!
//! In: logs of a bus, as many and as long as there are. Out: `report.html` and `report.json` in a
//! folder, and the verdict with the main tables on the terminal. Frames are read by `watch`, counted
//! by an [`instrument::Instrument`] each, and kept in a [`summary::Summary`] whose size does not
//! grow with the log. The JSON is described in `docs/period-report.md`.
//!
//! Left out: a judgement of the machine. The exit status is 0 whatever the log tells.

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
mod heartbeat;
mod histogram;
mod input;
mod instrument;
mod kind;
mod memory;
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

use crate::progress::Progress;
use crate::report::replay_tables::printable;
use crate::report::write::{self, Written};
use crate::stdout;
use crate::text_table::wrap;
use crate::watch::Plan;

use collect::{Collector, Window};
use data::PeriodReport;
pub use error::PeriodError;

/// What is reported on, and where the report goes.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Logs of the bus
    #[arg(value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Leave out what is before: 2026-11-20, 2026-11-20T06:30:00 (UTC), or seconds of the log
    #[arg(long, value_name = "TIME", value_parser = clock::instant)]
    pub from: Option<u64>,
    /// Leave out what is from then on
    #[arg(long, value_name = "TIME", value_parser = clock::instant)]
    pub to: Option<u64>,
    /// Node-ids of channel A and B of an instrument; again for each; by default 1,2, 3,4 and so on
    #[arg(long, value_name = "A,B", value_parser = pair)]
    pub nodes: Vec<[u8; 2]>,
    /// Bit rate of the bus in kbit/s, to tell its load in per cent
    #[arg(long, value_name = "KBIT/S", value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub bit_rate: Option<u16>,
    /// Folder for report.html and report.json
    #[arg(long, default_value = "plumb-period", value_name = "DIR")]
    pub out: PathBuf,
    /// Print the report as JSON
    #[arg(long)]
    pub json: bool,
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
    fn plan(&self) -> Plan {
        let all = || (1..=125).step_by(2).map(|id| [id, id + 1]).collect();
        Plan {
            pairs: if self.nodes.is_empty() {
                all()
            } else {
                self.nodes.clone()
            },
        }
    }
}

/// Makes the report; exit status 0 whatever it tells.
///
/// Errors: see [`PeriodError`].
pub fn run(arguments: &Arguments, _progress: &Progress) -> Result<ExitCode, PeriodError> {
    if arguments.logs.is_empty() {
        return Err(PeriodError::NothingGiven);
    }
    if let (Some(from), Some(to)) = (arguments.from, arguments.to)
        && to <= from
    {
        return Err(PeriodError::NoTime);
    }
    let report = read(arguments)?;
    let html = page::page(&report);
    let written = write::both(&arguments.out, &html, &report).map_err(PeriodError::Write)?;
    let text = if arguments.json {
        serde_json::to_string(&report).map_err(PeriodError::Json)? + "\n"
    } else {
        shown(&report, &written)
    };
    stdout::print(text).map_err(PeriodError::Print)?;
    Ok(ExitCode::SUCCESS)
}

/// Reads all logs.
fn read(arguments: &Arguments) -> Result<PeriodReport, PeriodError> {
    let window = Window {
        from_ns: arguments.from,
        to_ns: arguments.to,
    };
    let mut collector = Collector::new(&arguments.plan(), window);
    let mut logs = Vec::new();
    for path in &arguments.logs {
        logs.push(input::read(path, |time_ns, frame| {
            collector.take(time_ns, frame)
        })?);
    }
    let collected = collector.finish();
    if collected.traffic.span_ns.is_none() {
        return Err(match collected.outside {
            0 => PeriodError::Empty,
            frames => PeriodError::Outside(frames),
        });
    }
    let bit_rate = arguments.bit_rate.map(|kbit_s| f64::from(kbit_s) * 1e3);
    Ok(build::report(&collected, logs, bit_rate))
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
