//! What may go wrong in every verb: the bus, the node.
//!
//! In: errors of `bus`. Out: a [`Fault`] whose sentence states why, where that can be found out: a
//! node that does not answer is looked for before it is complained of.
//!
//! Left out: what one verb alone refuses.

use std::io;

use crate::diagnosis::{self, Silence};
use crate::lss::LssError;
use crate::nmt::Command;
use crate::sdo::SdoError;
use crate::{Bus, BusEnd, JoinError};

/// Why a verb on the bus ended early.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// The bus could not be joined.
    #[error("{0}")]
    Join(#[from] JoinError),
    /// The bus can be used no longer.
    #[error(transparent)]
    Bus(#[from] BusEnd),
    /// Nobody answers, and why.
    #[error("{0}")]
    Silent(Silence),
    /// A write was not answered, and why.
    #[error("{0}; {1}")]
    Unanswered(SdoError, Silence),
    /// A node was taken to PRE-OPERATIONAL and could not be returned: why it ended, the node, the
    /// command that returns it.
    #[error(
        "{0}; node {1} is left in PRE-OPERATIONAL: return it to {a} by NMT (frame 000h {b:02X} \
         {1:02X}, as `cansend can0 000#{b:02X}{1:02X}`)",
        a = where_to(*.2),
        b = *.2 as u8
    )]
    Left(String, u8, Command),
    /// A node was taken to PRE-OPERATIONAL and its state before is not known: why it ended, the
    /// node.
    #[error("{0}; {a}", a = unknown(*.1))]
    Unknown(String, u8),
    /// A node has refused, or the transfer failed.
    #[error("{0}")]
    Sdo(SdoError),
    /// An LSS service failed.
    #[error("{0}")]
    Lss(LssError),
}

impl Fault {
    /// What an error of the bus means.
    pub fn bus(error: io::Error) -> Self {
        Self::Bus(error.into())
    }

    /// What an error of a transfer with this node means; silence is looked into.
    pub fn sdo(bus: &mut Bus, node: u8, error: SdoError) -> Self {
        match error {
            SdoError::Bus(end) => Self::Bus(end),
            error if error.is_silence() => match diagnosis::silence(bus, Some(node)) {
                Ok(why) if matches!(error, SdoError::Unanswered(..)) => {
                    Self::Unanswered(error, why)
                }
                Ok(why) => Self::Silent(why),
                Err(lost) => Self::bus(lost),
            },
            error => Self::Sdo(error),
        }
    }

    /// Nobody at all answers.
    pub fn nobody(bus: &mut Bus) -> Self {
        diagnosis::silence(bus, None).map_or_else(Self::bus, Self::Silent)
    }
}

/// What becomes of a node that was taken to PRE-OPERATIONAL out of a state that nothing tells.
pub fn unknown(node: u8) -> String {
    format!(
        "node {node} sends no heartbeat (1017h), so its state before is not known and it is left \
         in PRE-OPERATIONAL: where it has to work, start it by NMT (frame 000h 01 {node:02X}, as \
         `cansend can0 000#01{node:02X}`)"
    )
}

/// The state to which a command takes a node.
const fn where_to(command: Command) -> &'static str {
    match command {
        Command::Stop => "STOPPED",
        _ => "OPERATIONAL",
    }
}

impl From<LssError> for Fault {
    fn from(error: LssError) -> Self {
        match error {
            LssError::Bus(end) => Self::Bus(end),
            error => Self::Lss(error),
        }
    }
}
