//! The bus side as it would stand on the part, to be linked and measured, never run.
//!
//! In: nothing. Out: binaries for the part in which every entry point of a node is reached through
//! a table of functions ([`Entries`]). Arguments come from nowhere, so the compiler can take
//! nothing for granted and leaves nothing out. `cargo xtask size` links them with
//! `footprint.ld`, which refuses a binary from which a panic can be reached, and reads off code,
//! tables, state and stack frames.
//!
//! Left out: reset code, drivers, the sensor, and everything that runs without a bus.
#![no_std]

pub mod panic;
pub mod stand_in;

use canopen::Frame;
use canopen::node::{Application, BusState, Event, Node};
use instant::Instant;

/// Every entry point of a node whose device is `A`.
pub struct Entries<A> {
    /// Making one.
    pub new: fn() -> Node,
    /// Power-on.
    pub start: fn(&mut Node, &mut A, u8, Instant),
    /// A frame from the bus.
    pub receive: fn(&mut Node, &mut A, &Frame, Instant) -> bool,
    /// The time.
    pub poll: fn(&mut Node, &mut A, Instant) -> Option<Instant>,
    /// A frame to the bus.
    pub transmit: fn(&mut Node, &mut A, Instant) -> Option<Frame>,
    /// What would come next.
    pub next_cob_id: fn(&Node, Instant) -> Option<u16>,
    /// A frame has gone out.
    pub sent: fn(&mut Node, &mut A, &Frame, Instant) -> bool,
    /// Until when a frame may go out.
    pub expires: fn(&Node, u16) -> Option<Instant>,
    /// A frame was taken back.
    pub withdrawn: fn(&mut Node, u16),
    /// The controller's error state.
    pub bus_state: fn(&mut Node, &mut A, BusState, Instant),
    /// A fault of the device.
    pub report: fn(&mut Node, &mut A, u16, u8, [u8; 5], Instant),
    /// It has gone.
    pub cleared: fn(&mut Node, u8, [u8; 5]),
    /// New data of the device.
    pub data_changed: fn(&mut Node, &mut A, Instant),
    /// Frames were lost.
    pub overrun: fn(&mut Node, u16),
    /// How many.
    pub overruns: fn(&Node) -> u16,
    /// SYNC by this node.
    pub stand_in_for_sync: fn(&mut Node, Option<u32>, Instant),
    /// SRDOs may be sent.
    pub consent_to_safety: fn(&mut Node, Option<Instant>) -> bool,
}

impl<A: Application> Entries<A> {
    /// The entry points as they are.
    pub const fn all() -> Self {
        Self {
            new: Node::new,
            start: Node::start::<A>,
            receive: Node::receive::<A>,
            poll: Node::poll::<A>,
            transmit: Node::transmit::<A>,
            next_cob_id: Node::next_cob_id::<A>,
            sent: Node::sent::<A>,
            expires: Node::expires::<A>,
            withdrawn: Node::withdrawn,
            bus_state: Node::bus_state::<A>,
            report: Node::report::<A>,
            cleared: Node::cleared,
            data_changed: Node::data_changed::<A>,
            overrun: Node::overrun,
            overruns: Node::overruns,
            stand_in_for_sync: Node::stand_in_for_sync,
            consent_to_safety: Node::consent_to_safety,
        }
    }
}

/// What a device is told, through a function that nobody sees into.
pub type Told = fn(Event, Instant);
