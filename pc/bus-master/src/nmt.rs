//! Network management as a master sees it: states, commands, heartbeats (CiA 301, 7.2.8).
//!
//! In: a bus and node-ids. Out: what their heartbeats tell, and commands to them.
//!
//! Left out: node guarding.

use std::fmt;
use std::io;
use std::time::{Duration, Instant};

use canopen::Frame;
use codes::words;

use super::{Bus, Received};

/// A node's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// It has just started.
    BootUp,
    /// It obeys nothing but NMT.
    Stopped,
    /// It works.
    Operational,
    /// It can be set up.
    PreOperational,
    /// A number that stands for no state.
    Unknown(u8),
}

impl State {
    /// The state of an error control message's byte.
    pub const fn of(byte: u8) -> Self {
        match byte & 0x7F {
            0 => Self::BootUp,
            4 => Self::Stopped,
            5 => Self::Operational,
            127 => Self::PreOperational,
            other => Self::Unknown(other),
        }
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&words::nmt(match self {
            Self::BootUp => 0,
            Self::Stopped => 4,
            Self::Operational => 5,
            Self::PreOperational => 127,
            Self::Unknown(number) => *number,
        }))
    }
}

/// A command to one node, or to all with node-id 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// To OPERATIONAL.
    Start,
    /// To PRE-OPERATIONAL.
    EnterPreOperational,
    /// As after power.
    ResetNode,
    /// Communication begins anew; a pending node-id counts.
    ResetCommunication,
}

impl Command {
    const fn code(self) -> u8 {
        match self {
            Self::Start => 1,
            Self::EnterPreOperational => 128,
            Self::ResetNode => 129,
            Self::ResetCommunication => 130,
        }
    }
}

/// Sends a command.
///
/// Errors: the bus is lost.
pub fn command(bus: &mut Bus, command: Command, node: u8) -> io::Result<()> {
    bus.send(&Frame::data_frame(0, &[command.code(), node]))
}

/// Node and state of an error control message; `None` for another frame.
pub fn heartbeat(received: &Received) -> Option<(u8, State)> {
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
pub fn state(bus: &mut Bus, node: u8, patience: Duration) -> io::Result<Option<State>> {
    let until = Instant::now() + patience;
    while let Some(received) = bus.receive(until)? {
        if let Some((from, state)) = heartbeat(&received)
            && from == node
        {
            return Ok(Some(state));
        }
    }
    Ok(None)
}

/// Waits for a node's heartbeat in this state; false when it has not come in time.
///
/// Errors: as [`state`].
pub fn wait_for(bus: &mut Bus, node: u8, wanted: State, patience: Duration) -> io::Result<bool> {
    let until = Instant::now() + patience;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        match state(bus, node, left)? {
            Some(found) if found == wanted => return Ok(true),
            Some(_) => {}
            None => return Ok(false),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_control_message_tells_node_and_state() {
        let received = |id, bytes: &[u8]| Received {
            time_ns: 0,
            frame: Frame::data_frame(id, bytes),
        };
        let told = |id, bytes: &[u8]| heartbeat(&received(id, bytes));
        assert_eq!(told(0x701, &[5]), Some((1, State::Operational)));
        // The toggle bit of node guarding is none of the state.
        assert_eq!(told(0x77F, &[0xFF]), Some((127, State::PreOperational)));
        assert_eq!(told(0x702, &[9]), Some((2, State::Unknown(9))));
        assert_eq!(told(0x700, &[5]), None);
        assert_eq!(told(0x701, &[]), None);
        assert_eq!(told(0x181, &[5]), None);
    }
}
