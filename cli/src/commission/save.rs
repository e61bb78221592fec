//! `plumb save`: what was written outlasts a power cut (1010h).
//!
//! In: nodes, and which group of parameters. Out: a line for each node, or JSON. Nodes store
//! nothing while they are OPERATIONAL, since erasing flash stops them for milliseconds; with
//! `--stop` they are taken to PRE-OPERATIONAL for it, and back.
//!
//! Left out: node-ids and bit rates, which LSS stores (`node-id`, `bitrate`).

use std::process::ExitCode;

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::common::{CommonOptions, WRONG_STATE, left};
use super::error::CommissionError;
use bus_master::fault::Fault;
use bus_master::node::Node;
use bus_master::sdo::SdoError;
use output::object;

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
    /// Take a node that is OPERATIONAL or STOPPED to PRE-OPERATIONAL for it, and back
    #[arg(long)]
    pub stop: bool,
    /// Which nodes; all channels on the bus when not given
    #[command(flatten)]
    pub common: CommonOptions,
}

/// Saves and prints.
///
/// Errors: see [`CommissionError`]; nodes before the failing one are saved and were printed.
pub fn run(arguments: &Arguments) -> Result<ExitCode, CommissionError> {
    let answer = arguments.common.answer("plumb-save");
    let (sub, what) = (Group::sub(arguments.only), Group::name(arguments.only));
    let mut bus = arguments.common.join()?;
    let nodes = arguments.common.nodes.whole(&mut bus)?;
    let (saved, ended) = answer.each(
        nodes,
        |id| {
            let mut node = Node::new(&mut bus, id);
            save(&mut node, sub, arguments.stop).map(|()| (id, node.is_left))
        },
        |(id, is_left)| format!("node {id}: {what} are saved\n{}", left(*id, *is_left)),
    );
    let those_left = saved.iter().filter(|(_, is_left)| *is_left);
    let content = object! {
        group: arguments.only,
        saved_nodes: saved.iter().map(|(id, _)| *id).collect::<Vec<_>>(),
        // Those whose state before is not known, and that are in PRE-OPERATIONAL now.
        left_nodes: those_left.map(|(id, _)| *id).collect::<Vec<_>>(),
    };
    answer.end(&bus, ended, saved.is_empty(), content)
}

/// Stores one group of one node.
///
/// Errors: see [`CommissionError`].
pub fn save(node: &mut Node, sub: u8, may_stop: bool) -> Result<(), CommissionError> {
    let id = node.id;
    let saved = node.set_up(may_stop, |node| node.write(0x1010, sub, &SAVE));
    match saved {
        Err(None) => Err(CommissionError::StoresNothing(id)),
        // One that sends a heartbeat would be known to be OPERATIONAL.
        Err(Some(Fault::Sdo(SdoError::Refused(.., WRONG_STATE)))) => {
            Err(CommissionError::Unheard(id, "stores"))
        }
        Err(Some(Fault::Sdo(SdoError::Refused(.., code)))) => {
            Err(CommissionError::NotStored(id, code))
        }
        Err(Some(fault)) => Err(fault.into()),
        Ok(()) => Ok(()),
    }
}
