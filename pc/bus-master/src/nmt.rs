//! Network management as a master sees it: states, commands, heartbeats (CiA 301, 7.2.8).
//!
//! In: a bus and node-ids. Out: what their heartbeats tell, and commands to them.
//!
//! Left out: node guarding.

use std::collections::BTreeSet;
use std::io;
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

pub use canopen::nmt::{Command, State};

use super::{Bus, Received};

/// What an error control message tells: a state, or a number that stands for none.
pub type Told = Result<State, u8>;

/// Identifiers that a PDO may have: those between SYNC, EMCY and TIME, and SDO.
const PDOS: RangeInclusive<u16> = 0x101..=0x57F;

/// Sends a command.
///
/// Errors: the bus is lost.
pub fn command(bus: &mut Bus, command: Command, node: u8) -> io::Result<()> {
    bus.send(&command.frame(node))
}

/// Node and state of an error control message; `None` for another frame.
pub fn heartbeat(received: &Received) -> Option<(u8, Told)> {
    let id = received.frame.cob_id()?;
    let node = u8::try_from(id.checked_sub(0x700)?).ok()?;
    match (node, received.frame.bytes()) {
        (1..=127, [state]) => Some((node, State::of(*state))),
        _ => None,
    }
}

/// The state that a node's next heartbeat tells; `None` when none has come in time.
///
/// Errors: the bus is lost, or the user has ended it.
pub fn state(bus: &mut Bus, node: u8, patience: Duration) -> io::Result<Option<Told>> {
    Ok(state_or_pdos(bus, node, patience)?.ok())
}

/// The state that a node's next heartbeat tells; where none has come in time, the identifiers of
/// the PDOs that were heard meanwhile.
///
/// Errors: as [`state`].
pub fn state_or_pdos(
    bus: &mut Bus,
    node: u8,
    patience: Duration,
) -> io::Result<Result<Told, BTreeSet<u16>>> {
    let until = Instant::now() + patience;
    let mut pdos = BTreeSet::new();
    while let Some(received) = bus.receive(until)? {
        match heartbeat(&received) {
            Some((from, state)) if from == node => return Ok(Ok(state)),
            _ if received.frame.is_remote() => {}
            _ => pdos.extend(received.frame.cob_id().filter(|id| PDOS.contains(id))),
        }
    }
    Ok(Err(pdos))
}

/// Waits for a node's heartbeat in this state; false when it has not come in time.
///
/// Errors: as [`state`].
pub fn wait_for(bus: &mut Bus, node: u8, wanted: State, patience: Duration) -> io::Result<bool> {
    let until = Instant::now() + patience;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        match state(bus, node, left)? {
            Some(found) if found == Ok(wanted) => return Ok(true),
            Some(_) => {}
            None => return Ok(false),
        }
    }
}

#[cfg(test)]
mod tests {
    use canopen::Frame;

    use super::*;

    #[test]
    fn an_error_control_message_tells_node_and_state() {
        let received = |id, bytes: &[u8]| Received {
            time_ns: 0,
            frame: Frame::data_frame(id, bytes),
        };
        let told = |id, bytes: &[u8]| heartbeat(&received(id, bytes));
        assert_eq!(told(0x701, &[5]), Some((1, Ok(State::Operational))));
        // The toggle bit of node guarding is none of the state.
        assert_eq!(told(0x77F, &[0xFF]), Some((127, Ok(State::PreOperational))));
        assert_eq!(told(0x702, &[9]), Some((2, Err(9))));
        assert_eq!(told(0x700, &[5]), None);
        assert_eq!(told(0x701, &[]), None);
        assert_eq!(told(0x181, &[5]), None);
    }
}
