//! `plumb restore`: what was saved is forgotten, and the delivered values count again (1011h).
//!
//! In: nodes, and which group of parameters. Out: a line for each node, or JSON. The values count
//! from the next reset on; `--reset` does that too, and waits until the node is back. A node that
//! was OPERATIONAL gets there again.
//!
//! Left out: node-id and bit rate, which stay; calibrations, which `calibrate` exchanges.

use std::fmt;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use device::objects::table::Channel;
use serde::Serialize;

use super::print;
use super::save::Group;
use bus_master::BusOptions;
use bus_master::fault::Fault;
use bus_master::nmt::{self, Command, State};
use bus_master::node::Node;
use bus_master::nodes::{self, NodeOption, NodesError};

/// "load", lowest byte first (CiA 301, 7.5.2.14).
const LOAD: [u8; 4] = *b"load";

/// How long a node may take from its reset to its boot-up message.
const RESTART: Duration = Duration::from_secs(10);

/// What a restored node does not know any more.
const APART: &str = "note: the channels refer to each other by node-ids 1 and 2 again, as \
 delivered, but have others: `plumb node-id --pair A,B --node A,B` corrects this\n";

/// What is restored, and where.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Only this group of parameters
    #[arg(long, value_enum)]
    pub only: Option<Group>,
    /// Reset the nodes afterwards, so that the delivered values take effect at once
    #[arg(long)]
    pub reset: bool,
    /// Take a node that is OPERATIONAL to PRE-OPERATIONAL for it, and back
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

/// Why something was not restored.
#[derive(Debug)]
pub enum RestoreError {
    /// The bus or a node.
    Fault(Fault),
    /// No node could be chosen.
    Nodes(NodesError),
    /// A node works.
    Operational(u8),
    /// A node has not come back after its reset.
    Gone(u8),
}

impl From<Fault> for RestoreError {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<NodesError> for RestoreError {
    fn from(error: NodesError) -> Self {
        Self::Nodes(error)
    }
}

impl fmt::Display for RestoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fault(fault) => write!(f, "{fault}"),
            Self::Nodes(error) => write!(f, "{error}"),
            Self::Operational(node) => write!(
                f,
                "node {node} is OPERATIONAL, where it discards nothing: use --stop to take it to \
                 PRE-OPERATIONAL and back"
            ),
            Self::Gone(node) => write!(
                f,
                "node {node} has not come back after its reset: look for it with `plumb scan`"
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
    restored_nodes: Vec<u8>,
    reset: bool,
    /// Nodes that look for the other channel by the node-id as delivered, and have another one
    /// themselves.
    apart_nodes: Vec<u8>,
}

/// Restores and prints.
///
/// Errors: see [`RestoreError`]; nodes before the failing one are restored and were printed.
pub fn run(arguments: &Arguments) -> Result<ExitCode, RestoreError> {
    let mut bus = arguments.bus.join().map_err(Fault::from)?;
    let nodes = arguments.nodes.writable(&mut bus)?;
    let (mut apart, mut restored) = (Vec::new(), Vec::new());
    let ended = nodes.into_iter().try_for_each(|id| {
        let delivered = nodes::channel(&mut bus, id)?.map(Channel::node_id);
        let mut node = Node::new(&mut bus, id);
        restore(&mut node, arguments)?;
        restored.push(id);
        if delivered.is_some_and(|delivered| delivered != id) {
            apart.push(id);
        }
        if !arguments.json {
            let what = Group::name(arguments.only);
            let counts = match arguments.reset {
                true => "the node was reset, they count",
                false => "they count from its next reset on (--reset does that too)",
            };
            print::text(&format!("node {id}: {what} are as delivered; {counts}\n"))?;
        }
        Ok::<(), RestoreError>(())
    });
    if arguments.only == Some(Group::Profile) {
        apart.clear();
    }
    if !arguments.json && !apart.is_empty() {
        print::text(APART)?;
    }
    if arguments.json && (ended.is_ok() || !restored.is_empty()) {
        print::json(&Document {
            format: "plumb-restore",
            version: 1,
            bus: bus.name().to_owned(),
            group: arguments.only,
            restored_nodes: restored,
            reset: arguments.reset,
            apart_nodes: apart,
        })?;
    }
    ended.map(|()| ExitCode::SUCCESS)
}

fn restore(node: &mut Node, arguments: &Arguments) -> Result<(), RestoreError> {
    let id = node.id;
    let worked = node.state()? == Some(State::Operational);
    let sub = Group::sub(arguments.only);
    let done = node.set_up(arguments.stop, |node| node.write(0x1011, sub, &LOAD));
    done.map_err(|fault: Option<Fault>| {
        fault.map_or(RestoreError::Operational(id), RestoreError::Fault)
    })?;
    if !arguments.reset {
        return Ok(());
    }
    reset(node)?;
    match worked {
        true => Ok(node.command(Command::Start)?),
        false => Ok(()),
    }
}

/// Resets a node and waits until it is back.
fn reset(node: &mut Node) -> Result<(), RestoreError> {
    node.command(Command::ResetNode)?;
    let back = nmt::wait_for(node.bus, node.id, State::BootUp, RESTART).map_err(Fault::bus)?;
    back.then_some(()).ok_or(RestoreError::Gone(node.id))
}
