//! What logs have come to, of which text and JSON are made.
//!
//! In: a [`Summary`] and the [`Source`] it came from. Out: [`Contents`], with what both call alike.

use super::export::Exported;
use super::foreign::Seen;
use super::summary::Summary;
use crate::totals::{ChannelSummary, Collected, Last};
use bus_logs::{Source, Tally as Lines};
use codes::words;
use device::fault::Fault;

/// What logs have come to.
pub struct Contents<'a> {
    /// The logs, and what of them gave no frame.
    pub source: &'a Source,
    /// Frames before --from and behind --to.
    pub outside: u64,
    /// The interfaces that frames came from, by name.
    pub buses: Vec<(String, Collected)>,
    /// Nodes with a data sheet.
    pub devices: Vec<Seen>,
    /// The table that was written.
    pub export: Option<Exported>,
}

impl<'a> Contents<'a> {
    /// Of all that was read; `outside` is how many frames were not in the part asked for.
    pub fn of(
        summary: Summary,
        source: &'a Source,
        outside: u64,
        export: Option<Exported>,
    ) -> Self {
        let (foreign, buses) = summary.finish();
        let name = |place: usize| source.interfaces().get(place).cloned().unwrap_or_default();
        let buses = buses.into_iter().map(|(place, bus)| (name(place), bus));
        Self {
            source,
            outside,
            buses: buses.collect(),
            devices: foreign.into_seen(),
            export,
        }
    }

    /// In words, and how many there are of them: frames that are used all the same.
    pub fn backwards(&self) -> Option<(&'static str, Lines)> {
        let lines = self.source.skipped().backwards;
        (lines.count > 0).then_some(("frames older than the one before", lines))
    }
}

/// Each state of the pair (2021h) that a channel has told: it, in words, and how often. What does
/// not exist is counted as the last.
pub fn states(channel: &ChannelSummary) -> impl Iterator<Item = (u8, String, u64)> {
    let words = |state: u8| match state {
        ..=9 => words::state(state, words::CHANNELS).into_owned(),
        _ => "states that do not exist".to_owned(),
    };
    let all = (0..).zip(channel.states).filter(|(_, count)| *count > 0);
    all.map(move |(state, count)| (state, words(state), count))
}

/// Each fault that an EMCY of a channel has told of, and whether it stands at the end.
pub fn faults(last: &Last, channel: &ChannelSummary) -> impl Iterator<Item = (Fault, bool)> {
    let standing = last.faults;
    words::faults(channel.faults).map(move |fault| (fault, standing & (1 << fault as u32) != 0))
}

/// ns as s.
pub fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}
