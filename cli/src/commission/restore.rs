//! `plumb restore`: what was saved is forgotten, and the delivered values count again (1011h).
//!
//! In: nodes, and which group of parameters. Out: a line for each node, or JSON. The values count
//! from the next reset on; `--reset` does that too, and waits until the node is back. A node that
//! was OPERATIONAL or STOPPED gets there again.
//!
//! Left out: node-id and bit rate, which stay; calibrations, which `calibrate` exchanges.

use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use device::objects::table::Channel;

use super::common::{CommonOptions, WRONG_STATE, left};
use super::error::CommissionError;
use super::save::Group;
use bus_master::fault::Fault;
use bus_master::nmt::{self, Command, State};
use bus_master::node::Node;
use bus_master::nodes;
use bus_master::sdo::SdoError;
use output::object;

/// "load", lowest byte first (CiA 301, 7.5.2.14).
const LOAD: [u8; 4] = *b"load";

/// How long a node may take from its reset to its boot-up message.
const RESTART: Duration = Duration::from_secs(10);

/// What a restored node does not hold any more.
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
    /// Take a node that is OPERATIONAL or STOPPED to PRE-OPERATIONAL for it, and back
    #[arg(long)]
    pub stop: bool,
    /// Which nodes; needed where there is more than one
    #[command(flatten)]
    pub common: CommonOptions,
}

/// Restores and prints.
///
/// Errors: see [`CommissionError`]; nodes before the failing one are restored and were printed.
pub fn run(arguments: &Arguments) -> Result<ExitCode, CommissionError> {
    let answer = arguments.common.answer("plumb-restore");
    let what = Group::name(arguments.only);
    let counts = match arguments.reset {
        true => "the node was reset, they count",
        false => "they count from its next reset on (--reset does that too)",
    };
    let mut bus = arguments.common.join()?;
    let nodes = arguments.common.nodes.writable(&mut bus)?;
    let mut apart_nodes = Vec::new();
    let (restored, ended) = answer.each(
        nodes,
        |id| {
            let mut node = Node::new(&mut bus, id);
            let delivered = restore(&mut node, arguments)?.map(Channel::node_id);
            if delivered.is_some_and(|delivered| delivered != id) {
                apart_nodes.push(id);
            }
            Ok((id, node.is_left))
        },
        |(id, is_left)| {
            let done = format!("node {id}: {what} are as delivered; {counts}\n");
            done + &left(*id, *is_left)
        },
    );
    if arguments.only == Some(Group::Profile) {
        apart_nodes.clear();
    }
    if !apart_nodes.is_empty() {
        answer.say(APART)?;
    }
    let those_left = restored.iter().filter(|(_, is_left)| *is_left);
    let content = object! {
        group: arguments.only,
        restored_nodes: restored.iter().map(|(id, _)| *id).collect::<Vec<_>>(),
        reset: arguments.reset,
        // Those that look for the other channel by the node-id as delivered, and have another one
        // themselves.
        apart_nodes: apart_nodes,
        // Those whose state before is not known, and that are in PRE-OPERATIONAL now.
        left_nodes: those_left.map(|(id, _)| *id).collect::<Vec<_>>(),
    };
    answer.end(&bus, ended, restored.is_empty(), content)
}

/// Restores one node; which channel it is.
fn restore(node: &mut Node, arguments: &Arguments) -> Result<Option<Channel>, CommissionError> {
    let id = node.id;
    let state = node.state_or_work()?;
    let sub = Group::sub(arguments.only);
    let done = node.set_up(arguments.stop, |node| {
        let channel = nodes::channel(node.bus, id)?;
        node.write(0x1011, sub, &LOAD).map(|()| channel)
    });
    let channel = done.map_err(|fault: Option<Fault>| match fault {
        None => CommissionError::DiscardsNothing(id),
        // One that sends a heartbeat would be known to be OPERATIONAL.
        Some(Fault::Sdo(SdoError::Refused(.., WRONG_STATE))) => {
            CommissionError::Unheard(id, "discards")
        }
        Some(fault) => fault.into(),
    })?;
    if arguments.reset {
        reset(node)?;
        match state {
            Some(Ok(State::Operational)) => node.command(Command::Start)?,
            Some(Ok(State::Stopped)) => node.command(Command::Stop)?,
            _ => {}
        }
    }
    Ok(channel)
}

/// Resets a node and waits until it is back.
fn reset(node: &mut Node) -> Result<(), CommissionError> {
    node.command(Command::ResetNode)?;
    let back =
        nmt::wait_for(node.bus, node.id, State::Initialising, RESTART).map_err(Fault::bus)?;
    back.then_some(()).ok_or(CommissionError::NotBack(node.id))
}
