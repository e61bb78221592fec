//! Why a verb that commissions an instrument ended early: one sentence that names the node, what,
//! and what to do.
//!
//! In: errors of the bus, of the choice of nodes, of names and values, and what one verb refuses.
//! Out: a [`CommissionError`].
//!
//! Left out: what silence means, which is looked into where it is met (`bus_master`).

use std::io;
use std::path::PathBuf;

use bus_master::fault::Fault;
use bus_master::nodes::{Missing, NodesError};
use bus_master::sdo::{coded, meaning};
use codes::name::NameError;
use codes::value::ValueError;
use codes::words::because;
use output::write::not_written;

/// Why a verb ended early.
#[derive(Debug, thiserror::Error)]
pub enum CommissionError {
    /// The bus or a node.
    #[error(transparent)]
    Fault(#[from] Fault),
    /// No node could be chosen.
    #[error(transparent)]
    Nodes(#[from] NodesError),
    /// A name means nothing.
    #[error(transparent)]
    Name(#[from] NameError),
    /// The object can't hold this.
    #[error("{0}; nothing was written")]
    Value(#[from] ValueError),
    /// The answer can't be printed.
    #[error("the answer cannot be printed: {0}")]
    Print(io::Error),
    /// An object can only be written.
    #[error("{0} can only be written")]
    WriteOnly(String),
    /// A node refuses the one object: node, name, abort code.
    #[error("node {0} refuses {1}: {a} (abort code {b})", a = meaning(*.2), b = coded(*.2))]
    Refused(u8, String, u32),
    /// Nodes refuse some of several objects, which were printed.
    #[error("{a}: {reason}; the others were read", a = refusals(*.count, *.node, .name))]
    Refusals {
        /// How many.
        count: usize,
        /// Who refuses the first.
        node: u8,
        /// What it is called.
        name: String,
        /// Why.
        reason: String,
    },
    /// A file holds one object of one node.
    #[error("a file holds one object of one node: name one object, and the node with --node")]
    OneOnly,
    /// The file can't be written.
    #[error("{a}", a = not_written(.0, .1, "another file with --output"))]
    Write(PathBuf, io::Error),
    /// The object can only be read.
    #[error("{0} can only be read; nothing was written")]
    ReadOnly(String),
    /// Our dictionary does not have the object.
    #[error("{0} is no object of a Plumb, so its type is not known; nothing was written")]
    Unknown(String),
    /// The node does not take it while it is OPERATIONAL.
    #[error(
        "node {0} does not take {1} while it is OPERATIONAL (abort code 0800 0022h): use --stop to \
         take it to PRE-OPERATIONAL for the write, and back"
    )]
    State(u8, String),
    /// The node does not take it in its present state, whatever that is.
    #[error(
        "node {0} does not take {1} in its present state (abort code 0800 0022h); `plumb info \
         --node {0}` shows its state"
    )]
    WrongState(u8, String),
    /// The node does not take it in its present state, which no heartbeat tells.
    #[error(
        "node {0} does not take {1} in its present state (abort code 0800 0022h), and sends no \
         heartbeat (1017h) that tells it: it is OPERATIONAL most likely, so use --stop to take it \
         to PRE-OPERATIONAL for the write"
    )]
    UnheardState(u8, String),
    /// The slope of this preset is not valid: node, name, reason of 2025h.
    #[error(
        "node {0} does not take {1} without a valid angle, and there is none ({a}): {b}",
        a = because(*.2),
        b = remedy(*.2)
    )]
    NoAngle(u8, String, u8),
    /// It ended when a node had taken a write, which was not read back: why, node, name.
    #[error("{0}; node {1} has taken what was written to {2}, which was not read back")]
    NotReadBack(Fault, u8, String),
    /// The node holds another number than was written: node, name, written, read.
    #[error("node {0} was sent {2} for {1} and contains {3}")]
    Differs(u8, String, String, String),
    /// More than one instrument is there.
    #[error(
        "{a} channels are there: name the two of one instrument with --node {b},{c}",
        a = .0.len(),
        b = .0.first().unwrap_or(&1),
        c = .0.get(1).unwrap_or(&2)
    )]
    Instruments(Vec<u8>),
    /// A slope is not valid: node, slope, reason of 2025h.
    #[error(
        "node {0} has no valid {1} ({a}), so nothing was zeroed: {b}",
        a = because(*.2),
        b = remedy(*.2)
    )]
    Invalid(u8, &'static str, u8),
    /// Scaling is off: node, slope, index.
    #[error(
        "scaling of {1} is off in node {0} (bit 1 of {2:04X}h): a preset would be stored and not \
         shown, so nothing was written; use --enable-scaling"
    )]
    Scaling(u8, &'static str, u16),
    /// A node has no slopes of CiA 410.
    #[error("node {0} has no slopes that can be zeroed")]
    NoSlopes(u8),
    /// A node works, where it stores nothing.
    #[error(
        "node {0} is OPERATIONAL, where it stores nothing, since erasing flash would stop it for \
         milliseconds: use --stop to take it to PRE-OPERATIONAL and back"
    )]
    StoresNothing(u8),
    /// A node does nothing like this in its present state, and sends no heartbeat that tells it:
    /// node, what it does not do.
    #[error(
        "node {0} {1} nothing in its present state (abort code 0800 0022h), and sends no heartbeat \
         (1017h) that tells it: it is OPERATIONAL most likely, so use --stop to take it to \
         PRE-OPERATIONAL"
    )]
    Unheard(u8, &'static str),
    /// A node could not store: its abort code.
    #[error(
        "node {0} could not store (abort code {a}): what was saved before still counts; look at \
         its faults with `plumb info --node {0}`",
        a = coded(*.1)
    )]
    NotStored(u8, u32),
    /// A node works, where it discards nothing.
    #[error(
        "node {0} is OPERATIONAL, where it discards nothing: use --stop to take it to \
         PRE-OPERATIONAL and back"
    )]
    DiscardsNothing(u8),
    /// A node has not come back after its reset.
    #[error("node {0} has not come back after its reset: look for it with `plumb scan`")]
    NotBack(u8),
    /// A change of the bit rate is for all nodes.
    #[error("a bus has one bit rate: omit --node, all nodes are changed at once")]
    AllOnly,
    /// These nodes are OPERATIONAL, where they do not answer LSS.
    #[error(
        "nodes that are OPERATIONAL do not answer LSS: {a}; nothing was changed; use --stop to \
         take them to PRE-OPERATIONAL for it, and back",
        a = listed(.0)
    )]
    Operational(Vec<u8>),
    /// These nodes are STOPPED, where their identity cannot be read for LSS.
    #[error(
        "nodes that are STOPPED do not tell the identity by which LSS finds them: {a}; nothing was \
         changed; use --stop to take them to PRE-OPERATIONAL for it, and back",
        a = listed(.0)
    )]
    Halted(Vec<u8>),
    /// These nodes do not answer LSS and would not follow.
    #[error(
        "these nodes do not answer LSS and would not follow: {a}; the bus would stop, so nothing \
         was changed; take them off the bus, or use --force",
        a = listed(.0)
    )]
    Behind(Vec<u8>),
    /// These nodes do not answer at the new rate; the rate.
    #[error(
        "these nodes have stored {1} kbit/s and do not answer here: {a}; {b}",
        a = listed(.0),
        b = follow(*.1)
    )]
    NotFollowed(Vec<u8>, u16),
    /// It ended when the nodes had changed to the new rate: why, the nodes, the rate.
    #[error(
        "{0}; these nodes have changed to {2} kbit/s and stored it: {a}; {b}",
        a = listed(.1),
        b = follow(*.2)
    )]
    Changed(Fault, Vec<u8>, u16),
    /// It ended before the nodes changed, and the old rate could not be stored again: why, the
    /// nodes, the new rate.
    #[error(
        "{0}; these nodes may have stored {2} kbit/s, and use it from their next reset on: {a}; \
         store the rate that is to be used with `plumb bitrate KBIT/S`",
        a = listed(.1)
    )]
    StillStored(Fault, Vec<u8>, u16),
    /// It ended before the nodes were reset, and the old node-ids could not be stored again: why,
    /// and what the nodes were given, as [`given`] names it.
    #[error(
        "{0}; new node-ids may be stored and count from the next reset on: {1}; give the ones that \
         are to be used with `plumb node-id`"
    )]
    StillGiven(Fault, String),
    /// It ended when the nodes had their new node-ids: why, and the node-ids.
    #[error(
        "{0}; these nodes have their new node-ids: {a}; the two channels of an instrument are set \
         to each other by `plumb node-id --pair A,B --node A,B`",
        a = listed(.1)
    )]
    Given(Fault, Vec<u8>),
    /// The other channel of an instrument does not answer and would not follow.
    #[error(
        "{0}, so nothing was written: reconnect it, or use --force to change the nodes that are \
         there alone"
    )]
    Half(Missing),
    /// The other channel of an instrument does not answer and would look for the old node-id.
    #[error(
        "{0}, so nothing was written: it would look for node {a} for ever; reconnect it, or use \
         --force to change node {a} alone",
        a = .0.node
    )]
    Alone(Missing),
    /// Another node has this node-id.
    #[error("node-id {0} is in use on this bus: choose another one (`plumb scan` lists them)")]
    Taken(u8),
    /// So many nodes were named as are not needed: needed, named.
    #[error("{a}", a = wrong_count(*.0, *.1))]
    Count(usize, usize),
    /// So many nodes without a node-id were found, and another number is needed.
    #[error("{a}", a = wrong_fresh(*.0, *.1))]
    Fresh(usize, usize),
    /// The nodes are not channels A and B of a Plumb.
    #[error(
        "the two nodes are not channel A and channel B of a Plumb (`plumb scan` shows what they \
         are)"
    )]
    NoPair,
    /// No node with this identity answers LSS.
    #[error(
        "node {0} does not answer LSS by its identity: is it OPERATIONAL (use --stop), or does \
         another one have the same?"
    )]
    NotSelected(u8),
    /// A node does not answer by its new node-id.
    #[error("no node answers by node-id {0} after its reset: look for it with `plumb scan`")]
    Gone(u8),
    /// A node does not hold what was written: node, index.
    #[error("node {0} does not hold in {1:04X}h what was written: its parameters were not saved")]
    NotHeld(u8, u16),
    /// The two do not compare.
    #[error(
        "nodes {0} and {1} have their node-ids but do not compare within 8 s: `plumb info` shows \
         what is wrong"
    )]
    Apart(u8, u8),
}

/// Node-ids with commas between.
pub fn listed(nodes: &[u8]) -> String {
    let names: Vec<_> = nodes.iter().map(u8::to_string).collect();
    names.join(", ")
}

/// How the adapter follows nodes that have changed to this rate.
fn follow(rate: u16) -> String {
    format!(
        "set the adapter to {rate} kbit/s as well (for SocketCAN: `ip link set can0 down`, then \
         `ip link set can0 up type can bitrate {rate}000`; for `plumb serve`: `plumb twin \
         bit-rate {rate}`), then look with `plumb bitrate`"
    )
}

/// Whether a reason of 2025h ends without anybody's doing: the sensor starts, the filter settles.
pub const fn ends_by_itself(reason: u8) -> bool {
    matches!(reason, 1 | 2)
}

/// What helps against a reason of 2025h.
const fn remedy(reason: u8) -> &'static str {
    match reason {
        _ if ends_by_itself(reason) => "wait a second and try again",
        17 => "the channels disagree; mend that first, or take the nodes to PRE-OPERATIONAL",
        18 => "start the other channel as well, or take the node to PRE-OPERATIONAL",
        _ => "`plumb info` shows what is wrong",
    }
}

fn refusals(count: usize, node: u8, name: &str) -> String {
    match count {
        1 => format!("node {node} refuses {name}"),
        _ => format!("{count} objects are refused, the first one, {name}, by node {node}"),
    }
}

fn wrong_count(needed: usize, named: usize) -> String {
    let nodes = if named == 1 { "node" } else { "nodes" };
    let needed = match needed {
        1 => "one node-id is given: name one node, or give both with --pair A,B",
        _ => "--pair is for two: name the two channels of one instrument",
    };
    format!("--node names {named} {nodes}, and {needed}")
}

fn wrong_fresh(found: usize, needed: usize) -> String {
    match (found, needed) {
        (0, _) => "no node without a node-id is there: name those to change with --node".to_owned(),
        (1, _) => format!(
            "one node without a node-id is there, and {needed} are needed here: connect the other \
             one as well, or name nodes with --node"
        ),
        (_, 1) => format!(
            "{found} nodes without a node-id are there, and one node-id is given: connect just one \
             of them, name a node with --node, or give both channels theirs with --pair A,B"
        ),
        _ => format!(
            "{found} nodes without a node-id are there, and {needed} are needed here: connect just \
             these, or name nodes with --node"
        ),
    }
}
