//! `plumb get`: what objects hold, by name or address, of one node or of both side by side.
//!
//! In: names or addresses; nodes. Out: a line for each object with a column for each node, JSON,
//! or the bytes of one object as a file.
//!
//! Left out: what the bytes of a DOMAIN mean.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use canopen::object::Access;
use clap::Args;
use serde::Serialize;

use super::common::CommonOptions;
use super::error::CommissionError;
use bus_master::Bus;
use bus_master::node::Node;
use bus_master::sdo::meaning;
use codes::name::{self, Named};
use codes::value::Shown;
use output::table::{Cell, Column, Table};
use output::write::{self, Existing, NoPlace, check_place};
use output::{hex, object};

/// What is read.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Objects: slope-long.preset, heartbeat, uncertainty (all members), 6012h, 1018h:4
    #[arg(required_unless_present = "list", value_name = "NAME")]
    pub names: Vec<String>,
    /// Print the names of all objects instead
    #[arg(long, conflicts_with = "names")]
    pub list: bool,
    /// Write the bytes of the one object to this file
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Replace the file of --output if it is there already
    #[arg(long, requires = "output")]
    pub force: bool,
    /// Which nodes; all channels on the bus when not given
    #[command(flatten)]
    pub common: CommonOptions,
}

/// One object of one node.
#[derive(Clone, Debug, Serialize)]
struct Reading {
    node: u8,
    name: String,
    index: String,
    sub: u8,
    value: Option<f64>,
    unit: Option<String>,
    raw: Option<i64>,
    text: Option<String>,
    bytes: Option<String>,
    reason: Option<String>,
}

/// One object of one node that went to a file.
#[derive(Clone, Debug, Serialize)]
struct Saved {
    node: u8,
    name: String,
    index: String,
    sub: u8,
    file: String,
    length_bytes: usize,
}

/// Reads and prints. What a node refuses of several objects is printed in its place.
///
/// Errors: see [`CommissionError`]; those that were read are printed all the same.
pub fn run(arguments: &Arguments) -> Result<ExitCode, CommissionError> {
    let answer = arguments.common.answer("plumb-get");
    if arguments.list {
        answer.show_without_bus(names(), list)?;
        return Ok(ExitCode::SUCCESS);
    }
    let objects = objects(&arguments.names)?;
    let existing = Existing::of(arguments.force);
    if let Some(path) = &arguments.output {
        may_save(path, existing)?;
    }
    let mut bus = arguments.common.join()?;
    let meant = arguments.common.nodes.readable(&mut bus)?;
    let nodes = &meant.nodes;
    let refused = match &arguments.output {
        Some(path) => {
            let ([object], [node]) = (objects.as_slice(), nodes.as_slice()) else {
                return Err(CommissionError::OneOnly);
            };
            let saved = save(&mut bus, *node, object, (path, existing))?;
            answer.show(&bus, object! { files: [&saved] }, || {
                let Saved {
                    name, length_bytes, ..
                } = &saved;
                format!("{length_bytes} bytes of {name} of node {node}\n")
            })?;
            None
        }
        None => {
            let readings = read(&mut bus, nodes, &objects)?;
            let content = object! { objects: &readings };
            answer.show(&bus, content, || table(nodes, &objects, &readings))?;
            refusals(&readings)
        }
    };
    meant.complete()?;
    refused.map_or(Ok(ExitCode::SUCCESS), Err)
}

/// All objects of all nodes. One object of one node that is refused is an error.
fn read(bus: &mut Bus, nodes: &[u8], objects: &[Named]) -> Result<Vec<Reading>, CommissionError> {
    let mut readings = Vec::new();
    let is_only = nodes.len() * objects.len() == 1;
    for id in nodes {
        let mut node = Node::new(bus, *id);
        for object in objects {
            match node.shown(object)? {
                Err(code) if is_only => {
                    return Err(CommissionError::Refused(*id, object.name.clone(), code));
                }
                shown => readings.push(reading(*id, object, shown)),
            }
        }
    }
    Ok(readings)
}

/// What nodes have refused of several objects.
fn refusals(readings: &[Reading]) -> Option<CommissionError> {
    let mut refused = readings.iter().filter(|reading| reading.text.is_none());
    let count = refused.clone().count();
    refused.next().map(|first| CommissionError::Refusals {
        count,
        node: first.node,
        name: first.name.clone(),
        reason: first.reason.clone().unwrap_or_default(),
    })
}

/// Every name with its address, the short ones behind the others.
fn all() -> impl Iterator<Item = (String, u16, u8)> {
    let long = name::all().into_iter();
    let long = long.map(|named| (named.name, named.index, named.sub));
    let short = name::SHORT.into_iter();
    long.chain(short.map(|(name, index, sub)| (name.to_owned(), index, sub)))
}

fn list() -> String {
    all()
        .map(|(name, index, sub)| format!("{:<8} {name}\n", name::address(index, sub)))
        .collect()
}

/// The same as JSON.
fn names() -> impl Serialize {
    let names = all().map(|(name, index, sub)| {
        object! { name: name, index: format!("{index:04X}"), sub: sub }
    });
    object! { names: names.collect::<Vec<_>>() }
}

/// What the names mean; what can only be written is named at once.
fn objects(names: &[String]) -> Result<Vec<Named>, CommissionError> {
    let mut objects = Vec::new();
    for name in names {
        let found = name::find(name)?;
        let readable = |one: &Named| one.row.is_none_or(|row| row.access.has(Access::READ));
        if !found.iter().any(readable) {
            return Err(CommissionError::WriteOnly(name.clone()));
        }
        objects.extend(found.into_iter().filter(readable));
    }
    Ok(objects)
}

fn reading(node: u8, object: &Named, shown: Result<(Vec<u8>, Shown), u32>) -> Reading {
    let mut reading = Reading {
        node,
        name: object.name.clone(),
        index: format!("{:04X}", object.index),
        sub: object.sub,
        value: None,
        unit: None,
        raw: None,
        text: None,
        bytes: None,
        reason: None,
    };
    match shown {
        Ok((bytes, shown)) => {
            let is_number = shown.raw.is_some();
            reading.value = shown.value;
            reading.unit = Some(shown.unit).filter(|unit| !unit.is_empty());
            reading.raw = shown.raw;
            reading.text = Some(shown.text);
            reading.reason = shown.reason;
            let digits = || hex::digits(&bytes).to_ascii_uppercase();
            reading.bytes = (!is_number).then(digits);
        }
        Err(code) => reading.reason = Some(meaning(code).to_owned()),
    }
    reading
}

/// Refuses a file that stays, before a node is asked.
fn may_save(path: &Path, existing: Existing) -> Result<(), CommissionError> {
    match check_place(path, existing) {
        Err(why @ NoPlace::Taken) => Err(CommissionError::Write(path.to_owned(), why.into())),
        _ => Ok(()),
    }
}

fn save(
    bus: &mut Bus,
    node: u8,
    object: &Named,
    (path, existing): (&Path, Existing),
) -> Result<Saved, CommissionError> {
    let bytes = match Node::new(bus, node).try_read(object.index, object.sub)? {
        Ok(bytes) => bytes,
        Err(code) => return Err(CommissionError::Refused(node, object.name.clone(), code)),
    };
    write::save(path, &bytes, existing)
        .map_err(|why| CommissionError::Write(path.to_owned(), why))?;
    Ok(Saved {
        node,
        name: object.name.clone(),
        index: format!("{:04X}", object.index),
        sub: object.sub,
        file: path.display().to_string(),
        length_bytes: bytes.len(),
    })
}

/// Lines by object, columns by node.
fn table(nodes: &[u8], objects: &[Named], readings: &[Reading]) -> String {
    let mut columns = vec![Column::text("object"), Column::text("address")];
    columns.extend(
        nodes
            .iter()
            .map(|node| Column::text(&format!("node {node}"))),
    );
    let mut table = Table::new("", columns);
    for (place, object) in objects.iter().enumerate() {
        let mut row = vec![Cell::text(&object.name), Cell::text(object.address())];
        let of_object = readings.iter().skip(place).step_by(objects.len().max(1));
        row.extend(of_object.map(|reading| {
            let refused = || format!("refused: {}", reading.reason.as_deref().unwrap_or(""));
            Cell::text(reading.text.clone().unwrap_or_else(refused))
        }));
        table.rows.push(row);
    }
    table.to_text()
}
