//! What the logs of a bus come to: the one total that replay, report and their outputs are made of.
//!
//! In: frames with their time, in ns, in the order of the log. Out: for each interface
//! [`Collected`]: a [`Summary`] of each instrument, whose size does not grow with the log, its
//! events and the SYNCs around its faults, and the [`Traffic`] of the bus. Summaries of parts of a
//! period, merged in any order, equal the summary of the whole to the last bit.
//!
//! Slopes are those of TPDO 1 while the channel marks them as valid (2020h), the difference of both
//! channels that of TPDO 3, and of TPDO 1 where TPDO 3 is not sent (`listen::Round`).
//!
//! Left out: what the frames mean (`listen`), and what a person sees of it (`playback`, `period`).

pub mod bins;
pub mod capture;
mod collector;
mod days;
mod endings;
pub mod event;
pub mod events;
pub mod gaps;
pub mod histogram;
mod identity;
mod instrument;
pub mod join;
mod kind;
mod motion;
mod pairs;
mod summary;
mod tally;
mod traffic;

#[cfg(test)]
mod merge_tests;

pub use bins::{Bins, Extremes};
pub use capture::{Capture, Recorder};
pub use collector::{Collected, Collector, Last};
pub use days::Day;
pub use event::{End, Event, What};
pub use gaps::Gaps;
pub use identity::Identity;
pub use instrument::Instrument;
pub use kind::Kind;
pub use motion::MotionSummary;
pub use summary::{ChannelSummary, DifferenceSummary, Summary, Unusable};
pub use tally::Tally;
pub use traffic::Traffic;
