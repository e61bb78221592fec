//! `plumb set`: writes one object of one or several nodes, reads it back, and says when it
//! counts and whether it is kept.
//!
//! In: a name or an address, a value with its unit, nodes. Out: a line for each node, or JSON.
//! What the object cannot hold is refused before anything goes out. Nothing is written twice.
//!
//! Left out: contents of files, and commands with verbs of their own (`zero`, `save`, `restore`).

use std::fmt;
use std::process::ExitCode;

use canopen::object::Access;
use clap::Args;
use device::objects::row::Row;
use serde::Serialize;

use super::print;
use super::zero::remedy;
use bus_master::BusOptions;
use bus_master::fault::Fault;
use bus_master::nmt::State;
use bus_master::node::Node;
use bus_master::nodes::{NodeOption, NodesError};
use bus_master::sdo::SdoError;
use codes::name::{self, NameError, Named};
use codes::value::{self, ValueError};
use codes::words::because;

/// The abort code of what can't be done in a node's present state.
const WRONG_STATE: u32 = 0x0800_0022;

/// Objects that count from the next reset on only; all others count at once.
const FROM_RESET: [(u16, u8); 3] = [(0x1F80, 0), (0x2003, 0), (0x2053, 2)];

/// What is written.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Object: slope-long.preset, heartbeat, 2003h, 1016h:1 (`plumb get --list` prints all names)
    #[arg(value_name = "NAME")]
    pub name: String,
    /// Value with its unit: 0deg, 500ms; a number or a name where the object has no unit
    #[arg(value_name = "VALUE", allow_hyphen_values = true)]
    pub value: String,
    /// VALUE is the number as stored in the object
    #[arg(long)]
    pub raw: bool,
    /// Take a node that is OPERATIONAL to PRE-OPERATIONAL for the write, and back
    #[arg(long)]
    pub stop: bool,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
    /// Which nodes; needed where there is more than one
    #[command(flatten)]
    pub nodes: NodeOption,
    /// The bus
    #[command(flatten)]
    pub bus: BusOptions,
}

/// Why a value was not written, or not as it was meant.
#[derive(Debug)]
pub enum SetError {
    /// The bus or a node.
    Fault(Fault),
    /// No node could be chosen.
    Nodes(NodesError),
    /// A name means nothing.
    Name(NameError),
    /// The object can't hold this.
    Value(ValueError),
    /// The object can only be read.
    ReadOnly(String),
    /// Our dictionary does not have the object.
    Unknown(String),
    /// The node does not take it while it is OPERATIONAL.
    State(u8, String),
    /// The node does not take it in its present state, whatever that is.
    Refused(u8, String),
    /// The slope of this preset is not valid: node, name, reason of 2025h.
    NoAngle(u8, String, u8),
    /// The node holds another number than was written: node, name, written, read.
    Differs(u8, String, String, String),
}

impl From<Fault> for SetError {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<NodesError> for SetError {
    fn from(error: NodesError) -> Self {
        Self::Nodes(error)
    }
}

impl From<NameError> for SetError {
    fn from(error: NameError) -> Self {
        Self::Name(error)
    }
}

impl From<ValueError> for SetError {
    fn from(error: ValueError) -> Self {
        Self::Value(error)
    }
}

impl fmt::Display for SetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fault(fault) => write!(f, "{fault}"),
            Self::Nodes(error) => write!(f, "{error}"),
            Self::Name(error) => write!(f, "{error}"),
            Self::Value(error) => write!(f, "{error}; nothing was written"),
            Self::ReadOnly(name) => write!(f, "{name} can only be read; nothing was written"),
            Self::Unknown(name) => write!(
                f,
                "{name} is no object of a Plumb, so its type is not known; nothing was written"
            ),
            Self::State(node, name) => write!(
                f,
                "node {node} does not take {name} while it is OPERATIONAL (abort code 0800 \
                 0022h): use --stop to take it to PRE-OPERATIONAL for the write, and back"
            ),
            Self::Refused(node, name) => write!(
                f,
                "node {node} does not take {name} in its present state (abort code 0800 0022h); \
                 `plumb info --node {node}` shows its state"
            ),
            Self::NoAngle(node, name, reason) => write!(
                f,
                "node {node} does not take {name} without a valid angle, and there is none ({}): \
                 {}",
                because(*reason),
                remedy(*reason)
            ),
            Self::Differs(node, name, written, read) => write!(
                f,
                "node {node} was sent {written} for {name} and contains {read}"
            ),
        }
    }
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
}

#[derive(Clone, Debug, Serialize)]
struct Document<'a> {
    format: &'static str,
    version: u32,
    bus: String,
    name: &'a str,
    index: String,
    sub: u8,
    nodes: Vec<Written>,
}

/// Writes and prints.
///
/// Errors: see [`SetError`]; nodes before the failing one are written and were printed.
pub fn run(arguments: &Arguments) -> Result<ExitCode, SetError> {
    let named = name::one(&arguments.name)?;
    let row = named
        .row
        .ok_or_else(|| SetError::Unknown(named.name.clone()))?;
    if !row.access.has(Access::WRITE) {
        return Err(SetError::ReadOnly(named.name.clone()));
    }
    // What depends on no node is refused before the bus is joined.
    if value::depends_on(row).is_none() {
        value::parse(&named, row, &arguments.value, arguments.raw, None)?;
    }
    let mut bus = arguments.bus.join().map_err(Fault::from)?;
    let nodes = arguments.nodes.writable(&mut bus)?;
    let mut numbers = Vec::new();
    for id in &nodes {
        let mut node = Node::new(&mut bus, *id);
        let resolution = node.resolution(&named)?;
        let number = value::parse(&named, row, &arguments.value, arguments.raw, resolution)?;
        numbers.push((*id, number));
    }
    let mut written = Vec::new();
    let ended = numbers.into_iter().try_for_each(|(id, number)| {
        let mut node = Node::new(&mut bus, id);
        let done = write(&mut node, &named, row, number, arguments.stop)?;
        if !arguments.json {
            print::text(&line(&named, &done))?;
        }
        written.push(done);
        Ok::<(), SetError>(())
    });
    if arguments.json && (ended.is_ok() || !written.is_empty()) {
        print::json(&Document {
            format: "plumb-set",
            version: 1,
            bus: bus.name().to_owned(),
            name: &named.name,
            index: format!("{:04X}", named.index),
            sub: named.sub,
            nodes: written,
        })?;
    }
    ended.map(|()| ExitCode::SUCCESS)
}

fn write(
    node: &mut Node,
    named: &Named,
    row: &Row,
    number: i64,
    may_stop: bool,
) -> Result<Written, SetError> {
    let before = match row.access.has(Access::READ) {
        true => node.shown(named)?.ok().and_then(|(_, shown)| shown.value),
        false => None,
    };
    let bytes = value::bytes(row.data_type, number);
    let write = |node: &mut Node| node.write(named.index, named.sub, &bytes);
    let done = match may_stop {
        true => node
            .set_up(true, write)
            .map_err(|fault| fault.unwrap_or(Fault::Interrupted)),
        false => write(node),
    };
    match done {
        Err(Fault::Sdo(SdoError::Refused(.., WRONG_STATE))) => {
            return Err(why_not(node, named));
        }
        done => done?,
    }
    read_back(node, named, row, number, before)
}

/// Why a node does not take this in its present state.
fn why_not(node: &mut Node, named: &Named) -> SetError {
    let (id, name) = (node.id, named.name.clone());
    let sub = match named.index {
        0x6112 => Some(1),
        0x6122 => Some(2),
        _ => None,
    };
    let asked = sub.map(|sub| node.number(0x2025, sub)).transpose();
    match (asked, node.state()) {
        (Err(fault), _) | (_, Err(fault)) => fault.into(),
        (Ok(Some(Some(reason))), _) if reason != 0 => {
            let reason = u8::try_from(reason).unwrap_or(u8::MAX);
            SetError::NoAngle(id, name, reason)
        }
        (_, Ok(Some(State::Operational))) => SetError::State(id, name),
        _ => SetError::Refused(id, name),
    }
}

fn read_back(
    node: &mut Node,
    named: &Named,
    row: &Row,
    number: i64,
    before: Option<f64>,
) -> Result<Written, SetError> {
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
        return Err(SetError::Differs(
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
    })
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
    format!("node {node}: {name} is {text}, {counts}{saved}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_counts_from_a_reset_is_what_the_rows_say() {
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
