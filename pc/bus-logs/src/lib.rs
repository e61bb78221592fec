//! Logs of CAN buses: what other tools have written down, frame by frame.
//!
//! In: files and folders, plain or gzip, in the formats of `candump` and of Vector's ASC, or
//! standard input. Out: a [`Source`] that gives their frames in the order of time, in the same
//! memory whatever their length, and in [`Skipped`] how many lines were none and where the first
//! of each kind stands; a [`Player`] that gives them when they are due; and a [`Writer`].
//! `docs/logs.md` describes what is read and what is refused.
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
mod logged;
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

pub use candump::line as candump_line;
pub use date::{is_dated, text_utc, utc};
pub use error::LogError;
pub use input::Input;
pub use lines::{LONGEST as LONGEST_LINE, Line};
pub use logged::Logged;
pub use pace::{LONGEST_GAP_S, PaceOptions, gap, speed};
pub use part::{Moment, Part, PartOptions};
pub use player::{PlayOptions, Player};
pub use skipped::{Damage, Skip, Skipped, Tally};
pub use sniff::{kind_of, refusal};
pub use source::Source;
pub use writer::{Format, Writer};
