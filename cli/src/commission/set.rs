//! `plumb set`: writes one object of one or several nodes, reads it back, and prints when it
//! counts and whether it is kept.
//!
//! In: a name or an address, a value with its unit, nodes. Out: a line for each node, or JSON.
//! What the object cannot hold is refused before anything goes out. What a node has taken is not
//! written twice; what it refuses while its angle becomes valid is tried again.
//!
//! Left out: contents of files, and commands with verbs of their own (`zero`, `save`, `restore`).

use std::process::ExitCode;
use std::time::{Duration, Instant};

use canopen::object::Access;
use clap::Args;
use device::objects::row::Row;
use serde::Serialize;

use super::common::{CommonOptions, WRONG_STATE, left};
use super::error::{CommissionError, ends_by_itself};
use bus_master::fault::Fault;
use bus_master::nmt::State;
use bus_master::node::Node;
use bus_master::sdo::SdoError;
use codes::name::{self, Named};
use codes::value;
use output::object;

/// For how long a write is tried again that is refused for a reason that ends by itself: a node
/// whose other channel does not take part has no angle while it leaves OPERATIONAL.
const SETTLING: Duration = Duration::from_secs(2);

/// Objects that count from the next reset on only; all others count at once.
const FROM_RESET: [(u16, u8); 3] = [(0x1F80, 0), (0x2003, 0), (0x2053, 2)];

/// The time between two heartbeats.
const HEARTBEAT: u16 = 0x1017;

/// How many nodes a Plumb supervises at most: the sub-indices of 1016h.
const SUPERVISED: u8 = 4;

/// What is written.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Object: slope-long.preset, heartbeat, 2003h, 1016h:1 (`plumb get --list` prints all names)
    #[arg(value_name = "NAME")]
    pub name: String,
    /// Value with its unit: 0deg, 500ms; a number or a name where the object has no unit; 2:500ms
    /// for a node and a time; 0x1F4 is the number as stored in the object
    #[arg(value_name = "VALUE", allow_hyphen_values = true)]
    pub value: String,
    /// VALUE is the number as stored in the object
    #[arg(long)]
    pub raw: bool,
    /// Take a node that is OPERATIONAL or STOPPED to PRE-OPERATIONAL for the write, and back
    #[arg(long)]
    pub stop: bool,
    /// Which nodes; needed where there is more than one
    #[command(flatten)]
    pub common: CommonOptions,
}

/// What was done to one node.
#[derive(Clone, Debug, Serialize)]
struct Written {
    node: u8,
    before: Option<f64>,
    value: Option<f64>,
    unit: Option<String>,
    raw: Option<i64>,
    text: String,
    /// "at once" or "reset".
    counts_from: &'static str,
    /// It is lost with the supply until it is saved.
    to_be_saved: bool,
    /// Its state before is not known, and it is in PRE-OPERATIONAL now.
    is_left: bool,
    /// What the other channel makes of it.
    note: Option<String>,
}

/// Writes and prints.
///
/// Errors: see [`CommissionError`]; nodes before the failing one are written and were printed.
pub fn run(arguments: &Arguments) -> Result<ExitCode, CommissionError> {
    let named = name::one(&arguments.name)?;
    let row = named
        .row
        .ok_or_else(|| CommissionError::Unknown(named.name.clone()))?;
    if !row.access.has(Access::WRITE) {
        return Err(CommissionError::ReadOnly(named.name.clone()));
    }
    // What depends on no node is refused before the bus is joined.
    if value::depends_on(row).is_none() {
        value::parse(&named, row, &arguments.value, arguments.raw, None)?;
    }
    let mut bus = arguments.common.join()?;
    let nodes = arguments.common.nodes.writable(&mut bus)?;
    let mut numbers = Vec::new();
    for id in &nodes {
        let mut node = Node::new(&mut bus, *id);
        let resolution = resolution(&mut node, &named, arguments.stop)?;
        let number = value::parse(&named, row, &arguments.value, arguments.raw, resolution)?;
        numbers.push((*id, number));
    }
    let answer = arguments.common.answer("plumb-set");
    let (written, ended) = answer.each(
        numbers,
        |(id, number)| {
            let mut node = Node::new(&mut bus, id);
            write(&mut node, &named, row, number, arguments.stop)
        },
        |done| line(&named, done),
    );
    let content = object! {
        name: &named.name,
        index: format!("{:04X}", named.index),
        sub: named.sub,
        nodes: &written,
    };
    answer.end(&bus, ended, written.is_empty(), content)
}

/// What a row's unit depends on, of a node that may be in STOPPED.
fn resolution(
    node: &mut Node,
    named: &Named,
    may_stop: bool,
) -> Result<Option<u32>, CommissionError> {
    let depends = named.row.and_then(value::depends_on).is_some();
    if !may_stop || !depends || node.state()? != Some(Ok(State::Stopped)) {
        return Ok(node.resolution(named)?);
    }
    Ok(node.set_up_stopped(|node| node.resolution(named))?)
}

fn write(
    node: &mut Node,
    named: &Named,
    row: &Row,
    number: i64,
    may_stop: bool,
) -> Result<Written, CommissionError> {
    let write = |node: &mut Node| write_here(node, named, row, number);
    let written = match may_stop {
        true => node.set_up_stopped(write),
        false => write(node),
    };
    let is_left = node.is_left;
    written.map(|written| Written { is_left, ..written })
}

/// Writes in the state in which the node is.
fn write_here(
    node: &mut Node,
    named: &Named,
    row: &Row,
    number: i64,
) -> Result<Written, CommissionError> {
    let before = match row.access.has(Access::READ) {
        true => node.shown(named)?.ok().and_then(|(_, shown)| shown.value),
        false => None,
    };
    let bytes = value::bytes(row.data_type, number);
    let until = Instant::now() + SETTLING;
    loop {
        match node.write(named.index, named.sub, &bytes) {
            Err(Fault::Sdo(SdoError::Refused(.., WRONG_STATE))) => match why_not(node, named) {
                CommissionError::NoAngle(.., reason)
                    if ends_by_itself(reason) && Instant::now() < until => {}
                why => return Err(why),
            },
            done => break done?,
        }
    }
    read_back(node, named, row, number, before).map_err(|error| match error {
        CommissionError::Fault(fault) => {
            CommissionError::NotReadBack(fault, node.id, named.name.clone())
        }
        error => error,
    })
}

/// Why a node does not take this in its present state.
fn why_not(node: &mut Node, named: &Named) -> CommissionError {
    let (id, name) = (node.id, named.name.clone());
    let sub = match named.index {
        0x6112 => Some(1),
        0x6122 => Some(2),
        _ => None,
    };
    let asked = sub.map(|sub| node.number(0x2025, sub)).transpose();
    match (asked, node.state_or_work()) {
        (Err(fault), _) | (_, Err(fault)) => fault.into(),
        (Ok(Some(Some(reason))), _) if reason != 0 => {
            let reason = u8::try_from(reason).unwrap_or(u8::MAX);
            CommissionError::NoAngle(id, name, reason)
        }
        (_, Ok(Some(Ok(State::Operational)))) => CommissionError::State(id, name),
        (_, Ok(None)) => CommissionError::UnheardState(id, name),
        _ => CommissionError::WrongState(id, name),
    }
}

fn read_back(
    node: &mut Node,
    named: &Named,
    row: &Row,
    number: i64,
    before: Option<f64>,
) -> Result<Written, CommissionError> {
    let resolution = node.resolution(named)?;
    let meant = value::show(named, &value::bytes(row.data_type, number), resolution);
    let to_be_saved = row.access.has(Access::STORED);
    let from_reset = FROM_RESET.contains(&(named.index, named.sub));
    let counts_from = if from_reset { "reset" } else { "at once" };
    let shown = match row.access.has(Access::READ) {
        true => node.shown(named)?,
        false => Ok((Vec::new(), meant.clone())),
    };
    let shown = match shown {
        Ok((_, shown)) => shown,
        Err(_) => meant.clone(),
    };
    // Where the unit itself was written, as with 6000h, the text is the new one.
    if shown.raw != meant.raw && !is_command(named.index) {
        return Err(CommissionError::Differs(
            node.id,
            named.name.clone(),
            meant.text,
            shown.text,
        ));
    }
    Ok(Written {
        node: node.id,
        before,
        value: shown.value,
        unit: Some(shown.unit).filter(|unit| !unit.is_empty()),
        raw: shown.raw,
        text: shown.text,
        counts_from,
        to_be_saved,
        is_left: false,
        note: supervised(node, named, number)?,
    })
}

/// A new time between heartbeats that the other channel takes for lost ones (1016h).
fn supervised(node: &mut Node, named: &Named, number: i64) -> Result<Option<String>, Fault> {
    if named.index != HEARTBEAT {
        return Ok(None);
    }
    let Some(peer) = node.peer()? else {
        return Ok(None);
    };
    for sub in 1..=SUPERVISED {
        // One that does not answer has other faults than this.
        let Some(entry) = Node::new(node.bus, peer).number_once(0x1016, sub)? else {
            break;
        };
        let (id, time) = (entry >> 16 & 0x7F, i64::from(entry & 0xFFFF));
        if id == u32::from(node.id) && time > 0 && !(1..time).contains(&number) {
            return Ok(Some(too_seldom(node.id, number, (peer, sub, time))));
        }
    }
    Ok(None)
}

/// The sentence on a heartbeat that comes each `number` ms, or never, to a `peer` that waits for it
/// no longer than `time` ms.
fn too_seldom(id: u8, number: i64, (peer, sub, time): (u8, u8, i64)) -> String {
    let (often, remedy) = match number {
        0 => ("", "0".to_owned()),
        // As delivered: 500 ms for a heartbeat of 200 ms.
        _ => (
            " again and again",
            format!("{id}:{}ms", (number * 5 / 2).min(0xFFFF)),
        ),
    };
    format!(
        "node {peer}, the other channel, waits for this heartbeat for {time} ms (1016h sub {sub}), \
         and reports it lost (8130h){often}: plumb set 1016h:{sub} {remedy} --node {peer}"
    )
}

/// Objects that do not read what was written to them: commands, and counts that are cleared.
const fn is_command(index: u16) -> bool {
    matches!(
        index,
        0x1003 | 0x1010 | 0x1011 | 0x1F51 | 0x2060 | 0x2072 | 0x2080
    )
}

fn line(named: &Named, done: &Written) -> String {
    let counts = match done.counts_from {
        "reset" => "counts from the next reset on",
        _ => "counts at once",
    };
    let saved = match done.to_be_saved {
        true => format!("; not saved yet: plumb save --node {}", done.node),
        false => String::new(),
    };
    let (node, name, text) = (done.node, &named.name, &done.text);
    let note = done.note.iter().map(|note| format!("note: {note}\n"));
    let lines = format!("node {node}: {name} is {text}, {counts}{saved}\n");
    lines + &note.collect::<String>() + &left(node, done.is_left)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_counts_from_a_reset_is_what_the_rows_state() {
        for (index, sub) in FROM_RESET {
            let named = name::one(&name::address(index, sub)).unwrap();
            assert!(
                named.row.is_some_and(|row| row.access.has(Access::WRITE)),
                "{index:X}"
            );
        }
        let said: Vec<_> = name::all()
            .into_iter()
            .filter(|one| {
                one.row
                    .is_some_and(|row| row.doc.contains("from the next reset"))
            })
            .filter(|one| one.row.is_some_and(|row| row.access.has(Access::WRITE)))
            .filter(|one| !is_command(one.index))
            .map(|one| (one.index, one.sub))
            .collect();
        assert!(said.iter().all(|at| FROM_RESET.contains(at)), "{said:X?}");
    }
}
