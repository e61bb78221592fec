//! Why a node has not got its node-id: one sentence that says which, and what to do.

use std::fmt;

use super::super::save::SaveError;
use bus_master::fault::Fault;
use bus_master::nodes::NodesError;

/// Why a node has not got its node-id, or the two do not find each other.
#[derive(Debug)]
pub enum NodeIdError {
    /// The bus or a node.
    Fault(Fault),
    /// No node could be chosen.
    Nodes(NodesError),
    /// What was written could not be saved.
    Save(SaveError),
    /// Another node has this node-id.
    Taken(u8),
    /// So many nodes were named as are not needed: needed, named.
    Count(usize, usize),
    /// So many nodes without a node-id were found, and another number is needed.
    Fresh(usize, usize),
    /// The nodes are not channels A and B of a Plumb.
    NoPair,
    /// No node with this identity answers LSS.
    NotSelected(u8),
    /// A node does not answer by its new node-id.
    Gone(u8),
    /// A node does not hold what was written: node, index.
    Differs(u8, u16),
    /// The two do not compare.
    Apart(u8, u8),
}

impl From<Fault> for NodeIdError {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<NodesError> for NodeIdError {
    fn from(error: NodesError) -> Self {
        Self::Nodes(error)
    }
}

impl From<SaveError> for NodeIdError {
    fn from(error: SaveError) -> Self {
        Self::Save(error)
    }
}

impl fmt::Display for NodeIdError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fault(fault) => write!(f, "{fault}"),
            Self::Nodes(error) => write!(f, "{error}"),
            Self::Save(error) => write!(f, "{error}"),
            Self::Taken(id) => write!(
                f,
                "node-id {id} is in use on this bus: choose another one (`plumb scan` lists them)"
            ),
            Self::Count(needed, named) => {
                let nodes = if *named == 1 { "node" } else { "nodes" };
                let needed = match needed {
                    1 => "one node-id is given: name one node, or give both with --pair A,B",
                    _ => "--pair is for two: name the two channels of one instrument",
                };
                write!(f, "--node names {named} {nodes}, and {needed}")
            }
            Self::Fresh(0, _) => write!(
                f,
                "no node without a node-id is there: name those to change with --node"
            ),
            Self::Fresh(1, needed) => write!(
                f,
                "one node without a node-id is there, and {needed} are needed here: connect the \
                 other one as well, or name nodes with --node"
            ),
            Self::Fresh(found, 1) => write!(
                f,
                "{found} nodes without a node-id are there, and one node-id is given: connect just \
                 one of them, name a node with --node, or give both channels theirs with --pair A,B"
            ),
            Self::Fresh(found, needed) => write!(
                f,
                "{found} nodes without a node-id are there, and {needed} are needed here: connect \
                 just these, or name nodes with --node"
            ),
            Self::NoPair => write!(
                f,
                "the two nodes are not channel A and channel B of a Plumb (`plumb scan` shows \
                 what they are)"
            ),
            Self::NotSelected(node) => write!(
                f,
                "node {node} does not answer LSS by its identity: does another one have the same?"
            ),
            Self::Gone(id) => write!(
                f,
                "no node answers by node-id {id} after its reset: look for it with `plumb scan`"
            ),
            Self::Differs(node, index) => write!(
                f,
                "node {node} does not hold in {index:04X}h what was written: its parameters were \
                 not saved"
            ),
            Self::Apart(a, b) => write!(
                f,
                "nodes {a} and {b} have their node-ids but do not compare within 8 s: \
                 `plumb info` shows what is wrong"
            ),
        }
    }
}
