//! Network management: the slave's states and what a master commands (CiA 301, 7.2.8 and 7.3.2),
//! error behaviour (1029h) and start-up (1F80h).
//!
//! In: frames and error events. Out: the command they hold, the state that follows, and what each
//! state allows. A command acts when its frame is taken, so a second one right behind it cannot
//! overwrite the first.
//!
//! Left out: the NMT master.

use crate::frame::Frame;
use crate::object::{Abort, Address, Place, Value};

/// States of a slave; the number is the one in its heartbeat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// From a reset to the boot-up message.
    #[default]
    Initialising = 0,
    /// Only NMT and error control.
    Stopped = 4,
    /// Everything.
    Operational = 5,
    /// Everything but PDOs.
    PreOperational = 127,
}

impl State {
    /// The state that the byte of an error control message tells, whatever its toggle bit is.
    ///
    /// Errors: a number that stands for no state.
    pub const fn of(byte: u8) -> Result<Self, u8> {
        match byte & 0x7F {
            0 => Ok(Self::Initialising),
            4 => Ok(Self::Stopped),
            5 => Ok(Self::Operational),
            127 => Ok(Self::PreOperational),
            other => Err(other),
        }
    }

    /// PDOs and SRDOs.
    pub const fn allows_pdo(self) -> bool {
        matches!(self, Self::Operational)
    }

    /// SDOs.
    pub const fn allows_sdo(self) -> bool {
        matches!(self, Self::Operational | Self::PreOperational)
    }

    /// SYNC, produced and consumed.
    pub const fn allows_sync(self) -> bool {
        self.allows_sdo()
    }

    /// EMCY; what happens in STOPPED waits until the node may speak again.
    pub const fn allows_emergency(self) -> bool {
        self.allows_sdo()
    }

    /// LSS, which CiA 305 keeps out of a machine that works.
    pub const fn allows_lss(self) -> bool {
        !matches!(self, Self::Operational)
    }
}

/// What a master commands; the number is the command specifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Command {
    /// Enter OPERATIONAL.
    Start = 1,
    /// Enter STOPPED.
    Stop = 2,
    /// Enter PRE-OPERATIONAL.
    EnterPreOperational = 128,
    /// Reset the whole device.
    ResetNode = 129,
    /// Reset communication.
    ResetCommunication = 130,
}

impl Command {
    /// The frame that gives it to one node, or to all with node-id 0.
    pub fn frame(self, node_id: u8) -> Frame {
        Frame::data_frame(0, &[self as u8, node_id])
    }
}

/// The command in a frame, when it is one for this node (or for all, node-id 0).
///
/// Unknown specifiers and frames of another length than 2 are not commands.
pub fn command(frame: &Frame, node_id: u8) -> Option<Command> {
    if frame.cob_id() != Some(0) || frame.is_remote() {
        return None;
    }
    let &[specifier, node] = frame.bytes() else {
        return None;
    };
    if node != 0 && node != node_id {
        return None;
    }
    Some(match specifier {
        1 => Command::Start,
        2 => Command::Stop,
        128 => Command::EnterPreOperational,
        129 => Command::ResetNode,
        130 => Command::ResetCommunication,
        _ => return None,
    })
}

/// Whether a node with this 1F80h enters OPERATIONAL by itself after boot-up.
///
/// Makers of slaves read the object alike for 8 (bit 3 set, bit 2 clear: starts itself) and
/// differ in the rest, so only that pattern counts (CiA 302-2).
pub const fn self_starting(startup: u32) -> bool {
    startup & 0b1100 == 0b1000
}

/// EMCY code of a device whose own software finds something wrong (CiA 301, table 26).
pub const SOFTWARE: u16 = 0x6100;

/// What an error does to the NMT state, 1029h (CiA 301, 7.5.2.26).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ErrorBehaviour {
    classes: [u8; 2],
}

impl ErrorBehaviour {
    /// Every class leaves OPERATIONAL for PRE-OPERATIONAL.
    pub const fn new() -> Self {
        Self { classes: [0; 2] }
    }

    /// The state to enter for an error of a class: 1 communication, 2 the device itself.
    /// `None`: stay.
    pub fn after(&self, class: u8, state: State) -> Option<State> {
        let place = usize::from(class).wrapping_sub(1);
        match self.classes.get(place)? {
            0 if state == State::Operational => Some(State::PreOperational),
            2 => Some(State::Stopped),
            _ => None,
        }
    }

    /// 1029h.
    pub fn place(&mut self, at: Address) -> Option<Place<'_>> {
        let class = self.classes.get_mut(usize::from(at.sub).wrapping_sub(1));
        class.map(Place::U8)
    }

    /// 1029h: 0 pre-operational, 1 no change, 2 stopped.
    pub fn write(&mut self, at: Address, value: Value) -> Option<Result<(), Abort>> {
        if value.unsigned() > 2 {
            return Some(Err(Abort::InvalidValue));
        }
        let place = self.place(at).map(|mut place| place.set(value));
        Some(place.ok_or(Abort::ReadOnly))
    }
}

impl Default for ErrorBehaviour {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::at;

    fn frame(bytes: &[u8]) -> Frame {
        Frame::data_frame(0, bytes)
    }

    #[test]
    fn a_command_is_for_one_node_or_for_all() {
        assert_eq!(command(&frame(&[1, 0]), 5), Some(Command::Start));
        assert_eq!(command(&frame(&[2, 5]), 5), Some(Command::Stop));
        assert_eq!(command(&frame(&[2, 6]), 5), None);
    }

    #[test]
    fn what_is_no_command_is_ignored() {
        for bytes in [&[][..], &[1], &[1, 0, 0], &[3, 0], &[0, 0]] {
            assert_eq!(command(&frame(bytes), 5), None, "{bytes:?}");
        }
        let remote = Frame::remote(crate::frame::standard(0), 2).unwrap();
        assert_eq!(command(&remote, 5), None);
        assert_eq!(command(&Frame::data_frame(1, &[1, 0]), 5), None);
    }

    #[test]
    fn error_behaviour_follows_1029() {
        let mut behaviour = ErrorBehaviour::new();
        let working = State::Operational;
        assert_eq!(behaviour.after(1, working), Some(State::PreOperational));
        assert_eq!(behaviour.after(1, State::Stopped), None);
        assert_eq!(behaviour.write(at(0x1029, 1), Value::u8(2)), Some(Ok(())));
        assert_eq!(behaviour.after(1, working), Some(State::Stopped));
        assert_eq!(behaviour.write(at(0x1029, 2), Value::u8(1)), Some(Ok(())));
        assert_eq!(behaviour.after(2, working), None);
        let refused = behaviour.write(at(0x1029, 1), Value::u8(3));
        assert_eq!(refused, Some(Err(Abort::InvalidValue)));
        assert_eq!(behaviour.after(1, working), Some(State::Stopped));
    }

    #[test]
    fn only_8_starts_itself() {
        assert!(self_starting(8));
        assert!(!self_starting(0) && !self_starting(4) && !self_starting(12));
    }
}
