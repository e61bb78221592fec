//! A frame that came, and what an adapter reports of the wires.
//!
//! In: frames and this computer's clock. Out: [`Received`] and [`Trouble`].
//!
//! Left out: how frames come (`kernel`, `slcan`, `socketcand`).

use std::time::{SystemTime, UNIX_EPOCH};

use canopen::Frame;

/// A frame of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// When it came, in nanoseconds since 1970: the adapter's own stamp where it has one that
    /// counts from there, otherwise this computer's clock when it was read.
    pub time_ns: u64,
    /// The frame.
    pub frame: Frame,
}

/// What an adapter has reported of the wires.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Trouble {
    /// Errors that it has seen.
    pub errors: u64,
    /// Frames that could not be sent since nobody acknowledged them, or since it is bus-off.
    pub unsent: bool,
}

/// Nanoseconds since 1970 on this computer's clock.
pub fn now_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |time| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX))
}
