//! A node-id by LSS, given and stored, or taken back.
//!
//! In: a node by its identity. Out: its new node-id, stored; it counts from the reset that follows,
//! at once where the node had none. What ends it before that reset has the old node-id, or none,
//! stored again, so that the node is as it was found.
//!
//! Left out: the reset, and what refers to a node-id (`known`).

use canopen::node::UNCONFIGURED;
use serde::Serialize;

use super::super::error::CommissionError;
use bus_master::fault::Fault;
use bus_master::lss::{Identity, LssError, Master};
use bus_master::nmt::{self, Command};
use bus_master::{Bus, BusEnd};

/// A node on its way to its new node-id.
#[derive(Clone, Debug, Serialize)]
pub struct Member {
    /// By its product code; none of another device.
    pub channel: Option<char>,
    /// Until now; none where it had none.
    pub old_node: Option<u8>,
    /// From now on.
    pub node: u8,
    /// 1018h sub 4.
    pub serial_number: u32,
    /// The other channel.
    pub peer: Option<u8>,
    /// By which LSS selects it.
    #[serde(skip)]
    pub identity: Identity,
}

/// The node-id that a node had before, as LSS counts it.
fn before(member: &Member) -> u8 {
    member.old_node.unwrap_or(UNCONFIGURED)
}

/// What a node was given, for a sentence.
fn given(member: &Member) -> String {
    match member.old_node {
        Some(old) => format!("{} for node {old}", member.node),
        None => format!("{} for a node without a node-id", member.node),
    }
}

/// Gives a node its node-id and has it stored.
///
/// Errors: see [`CommissionError`]; the node is as it was, but for
/// [`CommissionError::StillGiven`].
pub fn give(bus: &mut Bus, member: &Member) -> Result<(), CommissionError> {
    let mut master = Master::begin(bus).map_err(Fault::from)?;
    let done = match master.select(&member.identity) {
        Ok(true) => configure(&mut master, member),
        Ok(false) => {
            let id = member.old_node.unwrap_or(member.node);
            Err(CommissionError::NotSelected(id))
        }
        Err(lost) => Err(Fault::from(lost).into()),
    };
    // Nobody is left behind in the configuration state, whatever became of it.
    let back = master.switch_all(false);
    done?;
    Ok(back.map_err(Fault::from)?)
}

/// Configures and stores in the node that is selected; the old node-id where that ends early. It
/// does so in the configuration state: one without a node-id takes the new one where it leaves it.
fn configure(master: &mut Master, member: &Member) -> Result<(), CommissionError> {
    let done = master.configure_node_id(member.node);
    let Err(why) = done.and_then(|()| master.store()) else {
        return Ok(());
    };
    let undone = master.store_node_id_instead(before(member));
    Err(ended(why.into(), undone.is_ok(), &[member]))
}

/// Takes back what these nodes were given before another one could not be, and why that was; what
/// the user is told.
pub fn take_back(bus: &mut Bus, members: &[&Member], why: CommissionError) -> CommissionError {
    let mut left = Vec::new();
    for member in members {
        if !matches!(taken_back(bus, member), Ok(true)) {
            left.push(*member);
        }
    }
    match (why, left.is_empty()) {
        (CommissionError::Fault(why), _) => ended(why, left.is_empty(), &left),
        (CommissionError::StillGiven(why, more), false) => {
            let all = [named(&left), more].join(", ");
            CommissionError::StillGiven(why, all)
        }
        (why, _) => why,
    }
}

/// Has one node store its old node-id again; false where it does not answer.
fn taken_back(bus: &mut Bus, member: &Member) -> Result<bool, LssError> {
    let mut master = Master::begin(bus)?;
    let is_there = master.select(&member.identity)?;
    let done = match is_there {
        true => master.store_node_id_instead(before(member)).map(drop),
        false => Ok(()),
    };
    master.switch_all(false)?;
    done?;
    if member.old_node.is_none() {
        // It has taken its node-id at once, and gives it away at a reset.
        let reset = nmt::command(bus, Command::ResetCommunication, member.node);
        reset.map_err(BusEnd::from)?;
    }
    Ok(is_there)
}

fn named(members: &[&Member]) -> String {
    let names: Vec<_> = members.iter().map(|member| given(member)).collect();
    names.join(", ")
}

/// What ended it, with the nodes that may have kept what they were given.
fn ended(why: Fault, is_undone: bool, members: &[&Member]) -> CommissionError {
    match is_undone {
        true => why.into(),
        false => CommissionError::StillGiven(why, named(members)),
    }
}
