//! Which nodes are meant.
//!
//! In: `--node 1`, `--node 1,2`, `--node all`, or nothing. Out: node-ids. Nothing said means
//! every channel of a Plumb that answers where reading is all that is done, and otherwise the one
//! that is there: with two, the user has to say which.
//!
//! Left out: nodes of other devices, unless they are named.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;
use device::objects::communication::{PRODUCT_CODE_A, PRODUCT_CODE_B};
use device::objects::table::Channel;

use super::fault::Fault;
use crate::bus::Bus;
use crate::bus::sdo::{Client, SdoError};
use crate::bus::survey::survey;

/// How long is waited for answers; heartbeats need not come for this.
const ASKING: Duration = Duration::from_millis(400);

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
    /// The nodes, or all channels that are there
    #[arg(short, long, value_name = "ID,ID,...|all")]
    pub node: Option<Nodes>,
}

/// Why no node could be chosen.
#[derive(Debug)]
pub enum NodesError {
    /// The bus.
    Fault(Fault),
    /// Nodes answer, but none is a channel of a Plumb.
    Strangers(Vec<u8>),
    /// More than one is there; the verb that needs one.
    Which(Vec<u8>),
}

impl From<Fault> for NodesError {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl fmt::Display for NodesError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let listed = |nodes: &[u8]| {
            let names: Vec<_> = nodes.iter().map(u8::to_string).collect();
            names.join(",")
        };
        match self {
            Self::Fault(fault) => write!(f, "{fault}"),
            Self::Strangers(nodes) => write!(
                f,
                "no channel of a Plumb answers; other nodes do: name them with --node {}",
                listed(nodes)
            ),
            Self::Which(nodes) => write!(
                f,
                "nodes {} are there: say which one with --node {}, or --node all",
                listed(nodes),
                nodes.first().unwrap_or(&1)
            ),
        }
    }
}

/// The channels of Plumbs that answer, ascending.
///
/// Errors: see [`NodesError`]; nobody there is looked into.
pub fn channels(bus: &mut Bus) -> Result<Vec<u8>, NodesError> {
    let survey = survey(bus, ASKING).map_err(Fault::bus)?;
    let mut found = Vec::new();
    for (node, device_type) in &survey.answers {
        let is_inclinometer = device_type.is_some_and(|kind| kind & 0xFFFF == INCLINOMETER);
        if is_inclinometer && channel(bus, *node)?.is_some() {
            found.push(*node);
        }
    }
    match (found.is_empty(), survey.answers.is_empty()) {
        (false, _) => Ok(found),
        (true, true) => Err(Fault::nobody(bus).into()),
        (true, false) => Err(NodesError::Strangers(survey.answers.into_keys().collect())),
    }
}

/// Which channel of a Plumb a node is, by its product code; `None` for another device.
///
/// Errors: see [`Fault`].
pub fn channel(bus: &mut Bus, node: u8) -> Result<Option<Channel>, Fault> {
    let asked = Client::new(bus, node).read_u32(0x1018, 2);
    match asked {
        Ok(PRODUCT_CODE_A) => Ok(Some(Channel::A)),
        Ok(PRODUCT_CODE_B) => Ok(Some(Channel::B)),
        Ok(_) | Err(SdoError::Refused(..)) => Ok(None),
        Err(error) => Err(Fault::sdo(bus, node, error)),
    }
}

impl NodeOption {
    /// The nodes that are read: all channels when nothing was said.
    ///
    /// Errors: see [`NodesError`].
    pub fn readable(&self, bus: &mut Bus) -> Result<Vec<u8>, NodesError> {
        match &self.node {
            Some(Nodes::These(ids)) => Ok(ids.clone()),
            Some(Nodes::All) | None => channels(bus),
        }
    }

    /// The nodes that are written: when nothing was said there has to be one only.
    ///
    /// Errors: see [`NodesError`].
    pub fn writable(&self, bus: &mut Bus) -> Result<Vec<u8>, NodesError> {
        let nodes = self.readable(bus)?;
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
    fn with_two_channels_the_user_says_which() {
        let said = NodesError::Which(vec![1, 2]).to_string();
        assert_eq!(
            said,
            "nodes 1,2 are there: say which one with --node 1, or --node all"
        );
    }
}
