//! `plumb get`: what objects hold, by name or address, of one node or of both side by side.
//!
//! In: names or addresses; nodes. Out: a line for each object with a column for each node, JSON,
//! or the bytes of one object as a file.
//!
//! Left out: what the bytes of a DOMAIN mean.

use std::fmt;
use std::fs;
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;

use canopen::object::Access;
use clap::Args;
use serde::Serialize;

use super::print;
use bus_master::fault::Fault;
use bus_master::node::Node;
use bus_master::nodes::{NodeOption, NodesError};
use bus_master::sdo::meaning;
use bus_master::{Bus, BusOptions};
use codes::name::{self, NameError, Named};
use output::table::{Cell, Column, Table};

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
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
    /// Which nodes; all channels on the bus when not given
    #[command(flatten)]
    pub nodes: NodeOption,
    /// The bus
    #[command(flatten)]
    pub bus: BusOptions,
}

/// Why nothing was read.
#[derive(Debug)]
pub enum GetError {
    /// The bus or a node.
    Fault(Fault),
    /// No node could be chosen.
    Nodes(NodesError),
    /// A name means nothing.
    Name(NameError),
    /// An object can only be written.
    WriteOnly(String),
    /// A node refuses the one object: node, name, abort code.
    Refused(u8, String, u32),
    /// Nodes refuse some of several objects, which were printed: how many, the first one's node,
    /// name and reason.
    Refusals(usize, u8, String, String),
    /// A file holds one object of one node.
    OneOnly,
    /// The file can't be written.
    Write(PathBuf, io::Error),
}

impl From<Fault> for GetError {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<NodesError> for GetError {
    fn from(error: NodesError) -> Self {
        Self::Nodes(error)
    }
}

impl From<NameError> for GetError {
    fn from(error: NameError) -> Self {
        Self::Name(error)
    }
}

impl fmt::Display for GetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fault(fault) => write!(f, "{fault}"),
            Self::Nodes(error) => write!(f, "{error}"),
            Self::Name(error) => write!(f, "{error}"),
            Self::WriteOnly(name) => write!(f, "{name} can only be written"),
            Self::Refused(node, name, code) => write!(
                f,
                "node {node} refuses {name}: {} (abort code {:04X} {:04X}h)",
                meaning(*code),
                code >> 16,
                code & 0xFFFF
            ),
            Self::Refusals(1, node, name, reason) => {
                write!(
                    f,
                    "node {node} refuses {name}: {reason}; the others were read"
                )
            }
            Self::Refusals(count, node, name, reason) => write!(
                f,
                "{count} objects are refused, the first one, {name}, by node {node}: {reason}; the \
                 others were read"
            ),
            Self::OneOnly => write!(
                f,
                "a file holds one object of one node: name one object, and the node with --node"
            ),
            Self::Write(path, why) => write!(
                f,
                "cannot write {}: {why}; choose another file with --output",
                path.display()
            ),
        }
    }
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

#[derive(Clone, Debug, Serialize)]
struct Document {
    format: &'static str,
    version: u32,
    bus: String,
    objects: Vec<Reading>,
}

/// Reads and prints. What a node refuses of several objects is printed in its place.
///
/// Errors: see [`GetError`]; those that were read are printed all the same.
pub fn run(arguments: &Arguments) -> Result<ExitCode, GetError> {
    if arguments.list {
        print::text(&list())?;
        return Ok(ExitCode::SUCCESS);
    }
    let objects = objects(&arguments.names)?;
    let mut bus = arguments.bus.join().map_err(Fault::from)?;
    let meant = arguments.nodes.readable(&mut bus)?;
    let nodes = &meant.nodes;
    if let Some(path) = &arguments.output {
        let ([object], [node]) = (objects.as_slice(), nodes.as_slice()) else {
            return Err(GetError::OneOnly);
        };
        save(&mut bus, *node, object, path)?;
        meant.complete()?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut readings = Vec::new();
    for id in nodes {
        let mut node = Node::new(&mut bus, *id);
        for object in &objects {
            readings.push(reading(&mut node, object)?);
        }
    }
    if let [
        Reading {
            node,
            name,
            text: None,
            ..
        },
    ] = readings.as_slice()
    {
        let code = Node::new(&mut bus, *node).try_read(objects[0].index, objects[0].sub)?;
        return Err(GetError::Refused(
            *node,
            name.clone(),
            code.err().unwrap_or(0),
        ));
    }
    let mut refused = readings.iter().filter(|reading| reading.text.is_none());
    let count = refused.clone().count();
    let refused = refused.next().map(|reading| {
        let reason = reading.reason.clone().unwrap_or_default();
        GetError::Refusals(count, reading.node, reading.name.clone(), reason)
    });
    match arguments.json {
        true => print::json(&Document {
            format: "plumb-get",
            version: 1,
            bus: bus.name().to_owned(),
            objects: readings,
        })?,
        false => print::text(&table(nodes, &objects, &readings))?,
    }
    meant.complete()?;
    if let Some(refused) = refused {
        return Err(refused);
    }
    Ok(ExitCode::SUCCESS)
}

/// Every name with its address.
fn list() -> String {
    let mut text = String::new();
    for named in name::all() {
        text.push_str(&format!("{:<8} {}\n", named.address(), named.name));
    }
    for (short, index, sub) in name::SHORT {
        text.push_str(&format!("{:<8} {short}\n", name::address(index, sub)));
    }
    text
}

/// What the names mean; what can only be written is named at once.
fn objects(names: &[String]) -> Result<Vec<Named>, GetError> {
    let mut objects = Vec::new();
    for name in names {
        let found = name::find(name)?;
        let readable = |one: &Named| one.row.is_none_or(|row| row.access.has(Access::READ));
        if !found.iter().any(readable) {
            return Err(GetError::WriteOnly(name.clone()));
        }
        objects.extend(found.into_iter().filter(readable));
    }
    Ok(objects)
}

fn reading(node: &mut Node, object: &Named) -> Result<Reading, Fault> {
    let shown = node.shown(object)?;
    let mut reading = Reading {
        node: node.id,
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
            let hex = || bytes.iter().map(|byte| format!("{byte:02X}")).collect();
            reading.bytes = (!is_number).then(hex);
        }
        Err(code) => reading.reason = Some(meaning(code).to_owned()),
    }
    Ok(reading)
}

fn save(bus: &mut Bus, node: u8, object: &Named, path: &PathBuf) -> Result<(), GetError> {
    let bytes = match Node::new(bus, node).try_read(object.index, object.sub)? {
        Ok(bytes) => bytes,
        Err(code) => return Err(GetError::Refused(node, object.name.clone(), code)),
    };
    fs::write(path, &bytes).map_err(|why| GetError::Write(path.clone(), why))?;
    let name = &object.name;
    print::text(&format!("{} bytes of {name} of node {node}\n", bytes.len()))?;
    Ok(())
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
