//! Logs of CAN buses: what other tools have written down, frame by frame.
//!
//! In: files and folders, plain or gzip, in the formats of `candump` and of Vector's ASC, or
//! standard input. Out: a [`Source`] that gives their frames in the order of time, in the same
//! memory whatever their length, and in [`Skipped`] how many lines were none and where the first
//! of each kind stands; a [`Player`] that gives them when they are due; and a [`Writer`].
//! `docs/logs.md` says what is read and what is refused.
//!
//! Left out: what the frames mean (`watch`), and where else they come from (`bus`).

mod asc;
mod candump;
mod cursor;
mod date;
mod error;
mod folder;
mod input;
mod lines;
mod pace;
mod part;
mod player;
mod reader;
mod skipped;
mod sniff;
mod source;
mod writer;

#[cfg(test)]
mod fuzz;

use canopen::Frame;

pub use candump::line as candump_line;
pub use date::{is_dated, text_utc, utc};
pub use error::LogError;
pub use pace::{PaceOptions, speed};
pub use part::{Moment, Part, PartOptions};
pub use player::{PlayOptions, Player};
pub use skipped::{Skip, Skipped, Tally};
pub use sniff::{foreign, kind_of};
pub use source::Source;
pub use writer::{Format, Writer};

/// A frame of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Logged {
    /// When it was seen, in ns since 1970 (UTC), or since the log began where that has no date;
    /// 0 in all frames of a log without times.
    pub time_ns: u64,
    /// The interface it was seen on, by its place in [`Source::interfaces`].
    pub interface: u8,
    /// What was seen.
    pub frame: Frame,
}
