//! Which nodes are meant.
//!
//! In: `--node 1`, `--node 1,2`, `--node all`, or nothing. Out: node-ids. Nothing said means
//! every channel of a Plumb that answers where reading is all that is done, and otherwise the one
//! that is there: with two, the user has to say which. A channel names the other one of its
//! instrument (2001h): one that does not answer is looked for, and told. Writes for all channels
//! are refused then, since half an instrument would be set up; reads are printed, and end with
//! exit status 2.
//!
//! Left out: nodes of other devices, unless they are named.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use device::objects::communication::{PRODUCT_CODE_A, PRODUCT_CODE_B};
use device::objects::table::Channel;

use super::fault::Fault;
use super::nmt::{State, Told};
use super::node::Node;
use crate::Bus;
use crate::survey::{self, Survey};

/// How long is waited for answers; heartbeats need not come for this.
const ASKING: Duration = Duration::from_millis(400);

/// How often everybody is asked where frames come and nobody answers.
const SURVEYS: usize = 3;

/// The lower half of the device type: CiA 410, inclinometers.
const INCLINOMETER: u32 = 410;

/// Nodes by their ids, or all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Nodes {
    /// Every channel of a Plumb that is there.
    All,
    /// These.
    These(Vec<u8>),
}

impl FromStr for Nodes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(Self::All);
        }
        let id = |text: &str| text.trim().parse().ok().filter(|id| (1..=127).contains(id));
        let ids: Option<Vec<u8>> = text.split(',').map(id).collect();
        let ids = ids.ok_or("write node-ids from 1 to 127 with commas between, or all")?;
        match (1..ids.len()).any(|n| ids[..n].contains(&ids[n])) {
            true => Err("each node may be named once".to_owned()),
            false => Ok(Self::These(ids)),
        }
    }
}

/// The nodes.
#[derive(Clone, Debug, Default, Args)]
pub struct NodeOption {
    /// The nodes, or all channels on the bus
    #[arg(short, long, value_name = "ID,ID,...|all")]
    pub node: Option<Nodes>,
}

/// Why no node could be chosen.
#[derive(Debug, thiserror::Error)]
pub enum NodesError {
    /// The bus.
    #[error(transparent)]
    Fault(#[from] Fault),
    /// Nodes answer, but none is a channel of a Plumb.
    #[error(
        "no channel of a Plumb answers; other nodes do: name them with --node {a}",
        a = listed(.0)
    )]
    Strangers(Vec<u8>),
    /// More than one is there; the verb that needs one.
    #[error(
        "nodes {a} are there: choose one with --node {b}, or --node all",
        a = listed(.0),
        b = .0.first().unwrap_or(&1)
    )]
    Which(Vec<u8>),
    /// The other channel of an instrument does not answer, so nothing is written.
    #[error(
        "{0}, so nothing was written: {b}, or use --node {a} to change that one alone",
        a = .0.node,
        b = .0.remedy()
    )]
    Half(Missing),
    /// The other channel of an instrument does not answer; what was read is of this one only.
    #[error(
        "{0}, so it was not read: {b}, or use --node {a} to read that one alone",
        a = .0.node,
        b = .0.remedy()
    )]
    Unread(Missing),
}

fn listed(nodes: &[u8]) -> String {
    let names: Vec<_> = nodes.iter().map(u8::to_string).collect();
    names.join(",")
}

/// A channel whose peer does not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The channel that answers.
    pub node: u8,
    /// The other one, by its 2001h.
    pub peer: u8,
    /// What the heartbeat of the other one tells, where it is heard.
    pub heard: Option<Told>,
}

/// The state in which no node answers SDO.
const STOPPED: Option<Told> = Some(Ok(State::Stopped));

impl Missing {
    /// What brings the other one back.
    const fn remedy(&self) -> &'static str {
        match self.heard {
            STOPPED => {
                "send it the NMT command Enter PRE-OPERATIONAL, or name both with --node and use \
                 --stop where the verb has it"
            }
            _ => "reconnect it",
        }
    }
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { node, peer, heard } = *self;
        let why = match heard {
            STOPPED => "it is in STOPPED, where no node answers SDO",
            Some(_) => "its heartbeat is received: frames are lost, or it is at work for long",
            None => "no frame of it is received: it has no power, or its wires are open",
        };
        write!(
            f,
            "node {peer}, the other channel of node {node}, does not answer ({why})"
        )
    }
}

/// The nodes that are meant, and who of their peers does not answer.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Meant {
    /// Those that are there, ascending, or as they were named.
    pub nodes: Vec<u8>,
    /// The channels without their peer; nobody is looked for where nodes were named.
    pub missing: Vec<Missing>,
}

impl Meant {
    /// Called when everything was read and printed.
    ///
    /// Errors: [`NodesError::Unread`] where a peer does not answer.
    pub fn complete(&self) -> Result<(), NodesError> {
        let first = self.missing.first();
        first.map_or(Ok(()), |one| Err(NodesError::Unread(*one)))
    }
}

/// The channels of Plumbs that answer, ascending, and whose peer does not.
///
/// Errors: see [`NodesError`]; nobody there is looked into.
pub fn channels(bus: &mut Bus) -> Result<Meant, NodesError> {
    let mut survey = survey::survey(bus, ASKING).map_err(Fault::bus)?;
    for _ in 1..SURVEYS {
        if !survey.answers.is_empty() || survey.frames == 0 {
            break;
        }
        survey = survey::survey(bus, ASKING).map_err(Fault::bus)?;
    }
    let found = plumbs(bus, &mut survey)?;
    match (found.is_empty(), survey.answers.is_empty()) {
        (false, _) => with_peers(bus, &survey, found),
        (true, true) => Err(Fault::nobody(bus).into()),
        (true, false) => Err(NodesError::Strangers(survey.answers.into_keys().collect())),
    }
}

/// The channels on the bus whose peer does not answer, where a survey was made before.
///
/// Errors: see [`NodesError`].
pub fn missing(bus: &mut Bus, survey: &Survey) -> Result<Vec<Missing>, NodesError> {
    let mut survey = survey.clone();
    let found = plumbs(bus, &mut survey)?;
    Ok(with_peers(bus, &survey, found)?.missing)
}

/// The channels of Plumbs that answer; those that were only heard are asked once more.
fn plumbs(bus: &mut Bus, survey: &mut Survey) -> Result<Vec<u8>, Fault> {
    let heard: Vec<u8> = survey.heartbeats.keys().copied().collect();
    for node in heard {
        if !survey.answers.contains_key(&node)
            && let Some(kind) = Node::new(bus, node).number_once(0x1000, 0)?
        {
            survey.answers.insert(node, Some(kind));
        }
    }
    let mut found = Vec::new();
    for (node, device_type) in &survey.answers {
        let is_inclinometer = device_type.is_some_and(|kind| kind & 0xFFFF == INCLINOMETER);
        if is_inclinometer && channel(bus, *node)?.is_some() {
            found.push(*node);
        }
    }
    Ok(found)
}

/// Looks for the peers of those found that have not answered to the one question to everybody.
fn with_peers(bus: &mut Bus, survey: &Survey, found: Vec<u8>) -> Result<Meant, NodesError> {
    let (mut nodes, mut missing) = (found.clone(), Vec::new());
    for node in found {
        let Some(peer) = Node::new(bus, node).peer()? else {
            continue;
        };
        if nodes.contains(&peer) || survey.answers.contains_key(&peer) {
            continue;
        }
        match Node::new(bus, peer).number_once(0x1000, 0)? {
            Some(_) if channel(bus, peer)?.is_some() => nodes.push(peer),
            Some(_) => {}
            None => {
                let heard = survey.heartbeats.get(&peer).copied();
                missing.push(Missing { node, peer, heard });
            }
        }
    }
    nodes.sort_unstable();
    Ok(Meant { nodes, missing })
}

/// Which channel of a Plumb a node is, by its product code; `None` for another device.
///
/// Errors: see [`Fault`].
pub fn channel(bus: &mut Bus, node: u8) -> Result<Option<Channel>, Fault> {
    let product_code = Node::new(bus, node).number(0x1018, 2)?;
    Ok(product_code.and_then(channel_of))
}

/// The channel of a Plumb that has this product code (1018h sub 2); `None` for another device.
pub const fn channel_of(product_code: u32) -> Option<Channel> {
    match product_code {
        PRODUCT_CODE_A => Some(Channel::A),
        PRODUCT_CODE_B => Some(Channel::B),
        _ => None,
    }
}

impl NodeOption {
    /// The nodes that are read: all channels when nothing was said. What was read is printed, and
    /// then [`Meant::complete`] tells who has not answered.
    ///
    /// Errors: see [`NodesError`].
    pub fn readable(&self, bus: &mut Bus) -> Result<Meant, NodesError> {
        match &self.node {
            Some(Nodes::These(ids)) => Ok(Meant {
                nodes: ids.clone(),
                missing: Vec::new(),
            }),
            Some(Nodes::All) | None => channels(bus),
        }
    }

    /// The nodes that are written together: all channels when nothing was said, and whole
    /// instruments only.
    ///
    /// Errors: see [`NodesError`].
    pub fn whole(&self, bus: &mut Bus) -> Result<Vec<u8>, NodesError> {
        let meant = self.readable(bus)?;
        match meant.missing.first() {
            Some(missing) => Err(NodesError::Half(*missing)),
            None => Ok(meant.nodes),
        }
    }

    /// The nodes that are written: when nothing was said there has to be one only.
    ///
    /// Errors: see [`NodesError`].
    pub fn writable(&self, bus: &mut Bus) -> Result<Vec<u8>, NodesError> {
        let nodes = self.whole(bus)?;
        match (&self.node, nodes.len()) {
            (None, 2..) => Err(NodesError::Which(nodes)),
            _ => Ok(nodes),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_named_once_and_are_1_to_127() {
        assert_eq!("all".parse(), Ok(Nodes::All));
        assert_eq!("2, 1".parse(), Ok(Nodes::These(vec![2, 1])));
        for wrong in ["", "0", "128", "1,1", "a", "1;2", "-1"] {
            assert!(wrong.parse::<Nodes>().is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn a_peer_that_does_not_answer_is_named_and_what_to_do() {
        let one = Missing {
            node: 1,
            peer: 2,
            heard: None,
        };
        let half = NodesError::Half(one).to_string();
        assert!(
            half.contains("node 2, the other channel of node 1"),
            "{half}"
        );
        assert!(half.contains("nothing was written"), "{half}");
        assert!(half.contains("--node 1 "), "{half}");
        let meant = Meant {
            nodes: vec![1],
            missing: vec![Missing {
                heard: Some(Ok(State::Operational)),
                ..one
            }],
        };
        let unread = meant.complete().unwrap_err().to_string();
        assert!(unread.contains("its heartbeat is received"), "{unread}");
        let stopped = NodesError::Half(Missing {
            heard: STOPPED,
            ..one
        });
        let stopped = stopped.to_string();
        assert!(
            stopped.contains("it is in STOPPED") && stopped.contains("--stop"),
            "{stopped}"
        );
        assert!(Meant::default().complete().is_ok());
    }

    #[test]
    fn with_two_channels_the_user_says_which() {
        let said = NodesError::Which(vec![1, 2]).to_string();
        assert_eq!(
            said,
            "nodes 1,2 are there: choose one with --node 1, or --node all"
        );
    }
}
