//! `plumb info`: what a node is, how it is set up, and how it does.
//!
//! In: nodes. Out: a column for each node, or JSON: identity, program, calibration, the pair, what
//! is measured and how well, faults in words, the bus. What a node does not have is left empty.
//! Nothing is changed.
//!
//! Left out: the fault log and the black box, which `plumb get fault-log --output FILE` and
//! `plumb get black-box.1 --output FILE` fetch.

use std::process::ExitCode;

use canopen::object::Abort;
use clap::Args;
use serde::Serialize;

use super::common::CommonOptions;
use super::error::CommissionError;
use crate::update::version;
use bus_master::fault::Fault;
use bus_master::node::Node;
use bus_master::nodes::Meant;
use codes::meaning;
use codes::name::{self, Named};
use codes::words::{self, because};
use output::table::{Cell, Column, Table};
use output::{hex, object, printable};

/// Which nodes.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Node-id; all channels on the bus when not given
    #[arg(
        value_parser = clap::value_parser!(u8).range(1..=127),
        conflicts_with = "node",
        value_name = "NODE"
    )]
    pub id: Option<u8>,
    /// Several nodes
    #[command(flatten)]
    pub common: CommonOptions,
}

#[derive(Clone, Debug, Serialize)]
struct Fact {
    /// What it is, as the table has it.
    #[serde(skip)]
    label: &'static str,
    name: String,
    value: Option<f64>,
    unit: Option<String>,
    text: Option<String>,
    reason: Option<String>,
}

/// What one node tells.
#[derive(Clone, Debug, Serialize)]
struct Info {
    node: u8,
    state: Option<String>,
    facts: Vec<Fact>,
    /// The error register in words.
    errors: Vec<&'static str>,
    /// The errors told before, newest first.
    error_history: Vec<String>,
}

/// What is asked, in the order in which it is told: a label and an object.
const ASKED: [(&str, &str); 36] = [
    ("device", "device-name"),
    ("hardware", "hardware-version"),
    ("software", "software-version"),
    ("product code", "product-code"),
    ("revision", "revision-number"),
    ("serial number", "serial-number"),
    ("channel", "channel"),
    ("program", "program.version"),
    ("its slot", "program.slot"),
    ("its standing", "program.standing"),
    ("its check sum", "1F56h:1"),
    ("mode", "mode-of-measurement"),
    ("slope long", "slope-long"),
    ("slope lateral", "slope-lateral"),
    ("no angle, X", "reason.x"),
    ("no angle, Y", "reason.y"),
    ("uncertainty X (k = 1)", "uncertainty.x"),
    ("uncertainty Y (k = 1)", "uncertainty.y"),
    ("latency", "2023h:1"),
    ("temperature", "temperature"),
    ("the other channel", "peer"),
    ("cross-check", "2003h"),
    ("state of the pair", "state-of-the-pair"),
    ("blamed", "2027h:1"),
    ("because", "2027h:2"),
    ("difference X", "2024h:1"),
    ("difference Y", "2024h:2"),
    ("SYNC from", "2026h:3"),
    ("exchanges missed", "2026h:2"),
    ("bus state", "2052h:1"),
    ("bus load", "2052h:4"),
    ("frames lost", "2052h:5"),
    ("bus-offs", "2052h:6"),
    ("bit rate", "2053h:1"),
    ("heartbeat", "heartbeat"),
    ("degraded operation", "2005h"),
];

/// How the table calls the hash of the calibration's report.
const REPORT: &str = "calibration report";

/// The abort code of an object without content.
const NO_DATA: u32 = Abort::NoData.code();

/// Asks and prints.
///
/// Errors: see [`CommissionError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, CommissionError> {
    let mut bus = arguments.common.join()?;
    let meant = match arguments.id {
        Some(id) => Meant {
            nodes: vec![id],
            missing: Vec::new(),
        },
        None => arguments.common.nodes.readable(&mut bus)?,
    };
    let mut told = Vec::new();
    for id in meant.nodes.clone() {
        told.push(ask(&mut Node::new(&mut bus, id))?);
    }
    let answer = arguments.common.answer("plumb-info");
    answer.show(&bus, object! { nodes: &told }, || text(&told))?;
    meant.complete()?;
    Ok(ExitCode::SUCCESS)
}

fn ask(node: &mut Node) -> Result<Info, Fault> {
    let mut facts = Vec::new();
    for (label, name) in ASKED {
        // A name that our own table does not have would be a mistake here; a test looks for it.
        for named in name::find(name).unwrap_or_default() {
            facts.push(fact(node, label, &named)?);
        }
    }
    for named in name::find("2062").unwrap_or_default() {
        facts.push(fact(node, "calibration", &named)?);
    }
    facts.push(report(node)?);
    let register = node.number(0x1001, 0)?.unwrap_or(0);
    let errors = words::error_register(register as u8).collect();
    let count = node.number(0x1003, 0)?.unwrap_or(0).min(8);
    let mut error_history = Vec::new();
    for sub in 1..=count {
        if let Some(error) = node.number(0x1003, sub as u8)? {
            error_history.push(error_text(error as u16));
        }
    }
    let state = node.state()?;
    Ok(Info {
        node: node.id,
        state: state.map(|told| words::told(told).into_owned()),
        facts,
        errors,
        error_history,
    })
}

/// The first digits of a hash.
fn beginning(hash: &[u8]) -> String {
    let first = hash.get(..4).unwrap_or(hash);
    format!("SHA-256 {}...", hex::digits(first))
}

/// Whether the node keeps the hash of its calibration's report, and how that begins.
fn report(node: &mut Node) -> Result<Fact, Fault> {
    let (mut text, mut reason) = (None, None);
    match node.try_read(0x2063, 0)? {
        Ok(hash) => text = Some(beginning(&hash)),
        Err(NO_DATA) => reason = Some("it stores no report of this calibration".to_owned()),
        Err(code) => reason = Some(bus_master::sdo::meaning(code).to_owned()),
    }
    Ok(Fact {
        label: REPORT,
        name: "calibration-report-hash".to_owned(),
        value: None,
        unit: None,
        text,
        reason,
    })
}

fn fact(node: &mut Node, label: &'static str, named: &Named) -> Result<Fact, Fault> {
    let mut fact = Fact {
        label,
        name: named.name.clone(),
        value: None,
        unit: None,
        text: None,
        reason: None,
    };
    match node.shown(named)? {
        Ok((_, shown)) => {
            fact.value = shown.value;
            fact.unit = Some(shown.unit).filter(|unit| !unit.is_empty());
            fact.text = Some(in_words(named, shown.raw).unwrap_or(shown.text));
            fact.reason = shown.reason;
        }
        Err(code) => fact.reason = Some(bus_master::sdo::meaning(code).to_owned()),
    }
    Ok(fact)
}

/// Numbers whose words stand elsewhere than in their row.
fn in_words(named: &Named, raw: Option<i64>) -> Option<String> {
    let raw = raw?;
    let one_of = |names: &[&str]| {
        let name = usize::try_from(raw).ok().and_then(|raw| names.get(raw));
        name.map(|name| (*name).to_owned())
    };
    match (named.index, named.sub) {
        (0x2002, 0) => one_of(&["A", "B"]),
        (0x2003 | 0x2005, 0) => meaning::name(named.row?, raw).map(str::to_owned),
        (0x2080, 2) => u32::try_from(raw).ok().map(version),
        (0x2080, 3) => one_of(&["A", "B"]),
        (0x2080, 4) => one_of(&[
            "confirmed",
            "on trial",
            "confirmed, a newer one was given up",
        ]),
        (0x2025, _) | (0x2027, 2) if raw == 0 => Some("-".to_owned()),
        (0x2025, _) | (0x2027, 2) => u8::try_from(raw)
            .ok()
            .map(|code| because(code).into_owned()),
        (0x1017, 0) if raw == 0 => Some("none".to_owned()),
        _ => None,
    }
}

/// An entry of the error history.
fn error_text(code: u16) -> String {
    format!("{code:04X}h {}", words::code(code))
}

fn text(told: &[Info]) -> String {
    let mut columns = vec![Column::text("")];
    columns.extend(
        told.iter()
            .map(|info| Column::text(&format!("node {}", info.node))),
    );
    let mut table = Table::new("", columns);
    let state = told
        .iter()
        .map(|info| info.state.as_deref().unwrap_or("no heartbeat"));
    table.rows.push(row("state", state));
    let facts = told.first().map(|info| info.facts.len()).unwrap_or(0);
    for place in 0..facts {
        let of_nodes = || told.iter().filter_map(|info| info.facts.get(place));
        let Some(first) = of_nodes().next() else {
            continue;
        };
        let own_label = match first.label {
            "calibration" => first.name.replace("calibration-identity.", "calibration: "),
            label => label.to_owned(),
        };
        let none = if first.label == REPORT { "none" } else { "-" };
        let texts = of_nodes().map(|fact| fact.text.as_deref().unwrap_or(none));
        table.rows.push(row(&own_label, texts));
    }
    let errors = told.iter().map(|info| match info.errors.as_slice() {
        [] => "none".to_owned(),
        errors => errors.join(", "),
    });
    table.rows.push(row("errors now", errors));
    let mut text = table.to_text();
    for info in told {
        for (error, times) in counted(&info.error_history) {
            let times = match times {
                1 => String::new(),
                times => format!(" ({times} times)"),
            };
            text.push_str(&format!(
                "node {} has reported: {error}{times}\n",
                info.node
            ));
        }
    }
    text
}

/// Equal entries once with their number, each where its newest one stands.
fn counted(history: &[String]) -> Vec<(&str, usize)> {
    let mut counted: Vec<(&str, usize)> = Vec::new();
    for error in history {
        match counted.iter_mut().find(|(known, _)| known == error) {
            Some((_, times)) => *times += 1,
            None => counted.push((error, 1)),
        }
    }
    counted
}

fn row<T: AsRef<str>>(label: &str, texts: impl Iterator<Item = T>) -> Vec<Cell> {
    let cells = texts.map(|text| Cell::text(printable(text.as_ref())));
    [Cell::text(label)].into_iter().chain(cells).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use device::fault::Fault as DeviceFault;

    #[test]
    fn everything_that_is_asked_is_in_the_dictionary() {
        for (label, name) in ASKED {
            let found = name::find(name).unwrap();
            assert!(found.iter().all(|one| one.row.is_some()), "{label}: {name}");
            assert_eq!(found.len(), 1, "{label}: {name}");
        }
        assert!(name::find("2062").unwrap().len() > 1);
    }

    #[test]
    fn an_error_that_came_three_times_is_one_line() {
        let history = ["new", "old", "new", "new"].map(str::to_owned);
        assert_eq!(counted(&history), [("new", 3), ("old", 1)]);
    }

    #[test]
    fn a_hash_is_told_by_its_first_eight_digits() {
        let hash: Vec<u8> = (0xA0..0xC0).collect();
        assert_eq!(beginning(&hash), "SHA-256 a0a1a2a3...");
    }

    #[test]
    fn every_code_of_a_fault_has_words() {
        for fault in DeviceFault::ALL {
            let text = error_text(fault.report().0);
            assert!(text.contains(fault.text()), "{text}");
        }
        assert_eq!(
            error_text(0x8130),
            "8130h the heartbeat of a supervised node was lost"
        );
        assert_eq!(error_text(0x1234), "1234h unknown code");
    }
}
