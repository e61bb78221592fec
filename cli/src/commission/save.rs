//! `plumb save`: what was written outlasts a power cut (1010h).
//!
//! In: nodes, and which group of parameters. Out: a line for each node, or JSON. Nodes store
//! nothing while they are OPERATIONAL, since erasing flash stops them for milliseconds; with
//! `--stop` they are taken to PRE-OPERATIONAL for it, and back.
//!
//! Left out: node-ids and bit rates, which LSS stores (`node-id`, `bitrate`).

use std::fmt;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::print;
use bus_master::BusOptions;
use bus_master::fault::Fault;
use bus_master::node::Node;
use bus_master::nodes::{NodeOption, NodesError};
use bus_master::sdo::SdoError;

/// "save", lowest byte first (CiA 301, 7.5.2.13).
const SAVE: [u8; 4] = *b"save";

/// A group of parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Group {
    /// 1000h to 1FFFh
    Communication,
    /// 6000h to 9FFFh: slopes, presets, resolution
    Profile,
    /// 2000h to 5FFFh: the pair, SYNC fallback, range
    Manufacturer,
}

impl Group {
    /// The sub-index of 1010h and 1011h; 1 for all of them.
    pub fn sub(group: Option<Self>) -> u8 {
        match group {
            None => 1,
            Some(Self::Communication) => 2,
            Some(Self::Profile) => 3,
            Some(Self::Manufacturer) => 4,
        }
    }

    /// How a sentence calls what is stored.
    pub fn name(group: Option<Self>) -> &'static str {
        match group {
            None => "all parameters",
            Some(Self::Communication) => "the communication parameters",
            Some(Self::Profile) => "the profile's parameters",
            Some(Self::Manufacturer) => "the manufacturer's parameters",
        }
    }
}

/// What is saved, and where.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Only this group of parameters
    #[arg(long, value_enum)]
    pub only: Option<Group>,
    /// Take a node that is OPERATIONAL to PRE-OPERATIONAL for it, and back
    #[arg(long)]
    pub stop: bool,
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

/// Why something was not saved.
#[derive(Debug)]
pub enum SaveError {
    /// The bus or a node.
    Fault(Fault),
    /// No node could be chosen.
    Nodes(NodesError),
    /// A node works.
    Operational(u8),
    /// A node could not store: its abort code.
    Failed(u8, u32),
}

impl From<Fault> for SaveError {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<NodesError> for SaveError {
    fn from(error: NodesError) -> Self {
        Self::Nodes(error)
    }
}

impl fmt::Display for SaveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fault(fault) => write!(f, "{fault}"),
            Self::Nodes(error) => write!(f, "{error}"),
            Self::Operational(node) => write!(
                f,
                "node {node} is OPERATIONAL, where it stores nothing, since erasing flash would \
                 stop it for milliseconds: use --stop to take it to PRE-OPERATIONAL and back"
            ),
            Self::Failed(node, code) => write!(
                f,
                "node {node} could not store (abort code {:04X} {:04X}h): what was saved before \
                 still counts; look at its faults with `plumb info --node {node}`",
                code >> 16,
                code & 0xFFFF
            ),
        }
    }
}

#[derive(Clone, Debug, Serialize)]
struct Document {
    format: &'static str,
    version: u32,
    bus: String,
    group: Option<Group>,
    saved_nodes: Vec<u8>,
}

/// Saves and prints.
///
/// Errors: see [`SaveError`]; nodes before the failing one are saved and were printed.
pub fn run(arguments: &Arguments) -> Result<ExitCode, SaveError> {
    let mut bus = arguments.bus.join().map_err(Fault::from)?;
    let nodes = arguments.nodes.whole(&mut bus)?;
    let mut saved = Vec::new();
    let ended = nodes.into_iter().try_for_each(|id| {
        let mut node = Node::new(&mut bus, id);
        save(&mut node, Group::sub(arguments.only), arguments.stop)?;
        saved.push(id);
        if !arguments.json {
            let what = Group::name(arguments.only);
            print::text(&format!("node {id}: {what} are saved\n"))?;
        }
        Ok::<(), SaveError>(())
    });
    if arguments.json && (ended.is_ok() || !saved.is_empty()) {
        print::json(&Document {
            format: "plumb-save",
            version: 1,
            bus: bus.name().to_owned(),
            group: arguments.only,
            saved_nodes: saved,
        })?;
    }
    ended.map(|()| ExitCode::SUCCESS)
}

/// Stores one group of one node.
///
/// Errors: see [`SaveError`].
pub fn save(node: &mut Node, sub: u8, may_stop: bool) -> Result<(), SaveError> {
    let id = node.id;
    let saved = node.set_up(may_stop, |node| node.write(0x1010, sub, &SAVE));
    match saved {
        Err(None) => Err(SaveError::Operational(id)),
        Err(Some(Fault::Sdo(SdoError::Refused(.., code)))) => Err(SaveError::Failed(id, code)),
        Err(Some(fault)) => Err(fault.into()),
        Ok(()) => Ok(()),
    }
}
