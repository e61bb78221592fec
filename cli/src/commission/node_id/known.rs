//! What goes with a node-id and does not follow it: identifiers that were saved, and the numbers by
//! which the two channels find each other.
//!
//! In: a node in PRE-OPERATIONAL, its old node-id, the other channel's. Out: objects written and
//! saved, or read back.
//!
//! Left out: identifiers of safety frames.

use canopen::object::Access;
use device::objects::row::Default;
use device::objects::table::{self, Models};

use super::super::error::CommissionError;
use super::super::save;
use bus_master::fault::Fault;
use bus_master::node::Node;
use codes::name;

/// Bit 31 of a COB-ID: the PDO is off.
const OFF: u32 = 1 << 31;

/// What an RPDO takes that only the exchange of a gyroscope has: how far the other channel turned.
const TURNED: u32 = 0x202C;

/// Where a node holds the identifiers of the other channel's exchange, and what they are for
/// node-id 0. RPDO 3 is one of them with a gyroscope, and a master's own without.
///
/// Errors: see [`Fault`].
fn exchange(node: &mut Node) -> Result<Vec<(u16, u32)>, Fault> {
    let mut held: Vec<_> = table::exchange(Models::WHOLE).collect();
    for (index, base) in table::exchange(Models::DYNAMIC) {
        let is_known = held.iter().any(|(known, _)| *known == index);
        // The mapping stands 200h above the communication parameter (CiA 301, 7.5.2.36).
        if !is_known && node.number(index + 0x200, 1)?.map(|mapped| mapped >> 16) == Some(TURNED) {
            held.push((index, base));
        }
    }
    Ok(held)
}

/// Writes the identifiers that are as delivered for the old node-id, and saves them; their
/// addresses.
///
/// Errors: see [`CommissionError`].
pub fn renumber(node: &mut Node, old: u8) -> Result<Vec<String>, CommissionError> {
    let mut changed = Vec::new();
    for row in table::rows() {
        let (Default::NodeId(base), true) = (row.default, row.access.has(Access::STORED)) else {
            continue;
        };
        let held = node.number(row.index, row.sub)?;
        let delivered = |id: u8| (base + i64::from(id)) as u32;
        // What was switched on or off since is still that.
        let Some(held) = held.filter(|held| held & !OFF == delivered(old) & !OFF) else {
            continue;
        };
        let new = held & OFF | delivered(node.id) & !OFF;
        write_identifier(node, row.index, row.sub, held, new)?;
        changed.push(name::address(row.index, row.sub));
    }
    if !changed.is_empty() {
        save::save(
            node,
            save::Group::sub(Some(save::Group::Communication)),
            false,
        )?;
    }
    Ok(changed)
}

/// Writes a COB-ID: while it is on, nothing but bit 31 may change.
fn write_identifier(node: &mut Node, index: u16, sub: u8, old: u32, new: u32) -> Result<(), Fault> {
    if old == new {
        return Ok(());
    }
    if old & OFF == 0 {
        node.write(index, sub, &(old | OFF).to_le_bytes())?;
    }
    node.write(index, sub, &new.to_le_bytes())
}

/// Writes what a channel has to hold of the other one, and saves it; the addresses of the objects.
///
/// Errors: see [`CommissionError`].
pub fn tell(node: &mut Node, peer: u8) -> Result<Vec<String>, CommissionError> {
    node.write(0x2001, 0, &[peer])?;
    let supervised = node.number(0x1016, 1)?.unwrap_or(500);
    let time = match supervised & 0xFFFF {
        0 => 500,
        time => time,
    };
    let supervised = u32::from(peer) << 16 | time;
    node.write(0x1016, 1, &supervised.to_le_bytes())?;
    let mut told = vec![name::address(0x2001, 0), name::address(0x1016, 1)];
    for (index, base) in exchange(node)? {
        told.push(name::address(index, 1));
        let old = node.number(index, 1)?.unwrap_or(0);
        write_identifier(node, index, 1, old, base + u32::from(peer))?;
    }
    for group in [save::Group::Communication, save::Group::Manufacturer] {
        save::save(node, save::Group::sub(Some(group)), false)?;
    }
    Ok(told)
}

/// Whether a channel that was reset holds what it has to hold of the other one.
///
/// Errors: [`CommissionError::NotHeld`] where it does not, and those of the bus.
pub fn check(node: &mut Node, peer: u8) -> Result<(), CommissionError> {
    let id = node.id;
    let differs = |index| CommissionError::NotHeld(id, index);
    let peer = u32::from(peer);
    if node.number(0x2001, 0)? != Some(peer) {
        return Err(differs(0x2001));
    }
    if node.number(0x1016, 1)?.map(|number| number >> 16) != Some(peer) {
        return Err(differs(0x1016));
    }
    for (index, base) in exchange(node)? {
        if node.number(index, 1)? != Some(base + peer) {
            return Err(differs(index));
        }
    }
    Ok(())
}
