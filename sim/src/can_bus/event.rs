//! What a bus tells its world: who got which frame when, and what went wrong.
//!
//! In: nothing. Out: [`Event`], each with its exact time; a fingerprint of a run is made of them.

use canopen::Frame;
use canopen::frame::Id;

use super::confinement::ErrorState;
use super::controller::Mailbox;
use super::ports::{Port, Ports};

/// Why an attempt to send failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// A sender read another level than it sent.
    Bit,
    /// Nobody acknowledged.
    Acknowledge,
    /// A receiver computed another CRC.
    Crc,
    /// A receiver saw a dominant last-but-one bit in the end of frame.
    EndOfFrame,
    /// A controller at another bit rate took the frame for rubbish, or two senders had two rates.
    BitRate,
    /// The sender went silent in the middle of its frame.
    Cut,
    /// The bus was held dominant.
    Dominant,
}

/// One thing that happened on the bus; times in ns of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// Receivers took a frame: at the end of the last bit but one of the end of frame.
    Delivered {
        /// The frame.
        frame: Frame,
        /// Who sent it; several when they sent the very same bits.
        senders: Ports,
        /// Who got it.
        to: Ports,
        /// Begin of the start-of-frame bit.
        start_ns: u64,
        /// When it counts as received.
        at_ns: u64,
    },
    /// A frame was sent and acknowledged: at the end of its last bit. The mailbox is free.
    Sent {
        /// The sender.
        port: Port,
        /// Its mailbox; `None` for a babbling controller.
        mailbox: Option<Mailbox>,
        /// The frame.
        frame: Frame,
        /// Begin of the start-of-frame bit.
        start_ns: u64,
        /// End of the end-of-frame field; three bits of intermission follow.
        end_ns: u64,
    },
    /// An attempt failed; its senders will repeat it.
    Error {
        /// Why.
        kind: ErrorKind,
        /// Who was sending; nobody when the sender was cut off.
        senders: Ports,
        /// Begin of the start-of-frame bit, or of the disturbance.
        start_ns: u64,
        /// When the first error flag begins.
        at_ns: u64,
    },
    /// A controller's error state is another one than before.
    Changed {
        /// Whose.
        port: Port,
        /// The new state.
        state: ErrorState,
        /// When.
        at_ns: u64,
    },
}

impl Event {
    /// When it happened, ns.
    pub const fn at_ns(&self) -> u64 {
        match self {
            Self::Delivered { at_ns, .. }
            | Self::Error { at_ns, .. }
            | Self::Changed { at_ns, .. } => *at_ns,
            Self::Sent { end_ns, .. } => *end_ns,
        }
    }

    /// Mixes the event into a fingerprint: FNV-1a over words of 64 bits instead of bytes.
    pub(super) fn hash(&self, hash: u64) -> u64 {
        let mix = |hash: u64, words: &[u64]| {
            (words.iter()).fold(hash, |hash, word| {
                let mixed = (hash ^ word).wrapping_mul(0x0000_0100_0000_01b3);
                mixed ^ mixed >> 32
            })
        };
        let set = |ports: Ports| [ports.bits() as u64, (ports.bits() >> 64) as u64];
        match *self {
            Self::Delivered {
                frame,
                senders,
                to,
                start_ns,
                at_ns,
            } => {
                let hash = mix(mix(hash, &[1, start_ns, at_ns]), &words(&frame));
                mix(mix(hash, &set(senders)), &set(to))
            }
            Self::Sent {
                port,
                mailbox,
                frame,
                start_ns,
                end_ns,
            } => {
                let from = mailbox.map_or(MAILBOX_NONE, |mailbox| mailbox.number() as u64);
                let hash = mix(hash, &[2, port.index() as u64, from, start_ns, end_ns]);
                mix(hash, &words(&frame))
            }
            Self::Error {
                kind,
                senders,
                start_ns,
                at_ns,
            } => mix(mix(hash, &[3, kind as u64, start_ns, at_ns]), &set(senders)),
            Self::Changed { port, state, at_ns } => {
                mix(hash, &[4, port.index() as u64, state as u64, at_ns])
            }
        }
    }
}

const MAILBOX_NONE: u64 = 255;

fn words(frame: &Frame) -> [u64; 2] {
    let id = match frame.id() {
        Id::Standard(id) => u64::from(id.as_raw()),
        Id::Extended(id) => u64::from(id.as_raw()) | 1 << 32,
    };
    let form = (frame.length() as u64) << 33 | u64::from(frame.is_remote()) << 40;
    [id | form, u64::from_le_bytes(frame.padded())]
}
