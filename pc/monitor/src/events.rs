//! What has happened, in a list that does not grow.
//!
//! In: events as they come. Out: the last thousand, each with a number that goes on counting. The
//! same event again within a second is counted in the entry that it has, so that a loose contact
//! fills two entries and not the list.
//!
//! Left out: the fault log inside the nodes (2070h), which is read by SDO.

use std::collections::VecDeque;

use serde::Serialize;

use super::level::Level;

/// Entries that are kept.
const KEPT: usize = 1000;

/// Within this time the same event counts as the same entry.
const SAME_NS: u64 = 1_000_000_000;

/// What sort of event it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A node told by EMCY of a fault that came or went.
    Emergency,
    /// The state of the pair is another one.
    Verdict,
    /// A node has started, or is in another NMT state.
    Nmt,
    /// A heartbeat has stopped, or is there again.
    Heartbeat,
    /// SYNC has stopped, or is there again.
    Sync,
    /// The bus, or the log, is silent, or is heard again.
    Silence,
    /// Something in what a channel sends does not fit together.
    Check,
    /// A frame that should not be: malformed, of an unknown node.
    Stranger,
    /// Time of the source has gone back.
    Time,
    /// The connection, the log or the recording.
    Source,
}

/// One entry.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Event {
    /// Counts all entries, from 1 on.
    pub number: u64,
    /// When it came first, s on the source's clock.
    pub time_s: f64,
    /// The instrument, from 1 on; absent for what is of no instrument.
    pub instrument: Option<usize>,
    /// `A` or `B`; absent for what is of neither.
    pub channel: Option<&'static str>,
    /// Sort of event.
    pub kind: Kind,
    /// How bad it is.
    pub level: Level,
    /// What has happened, in words.
    pub text: String,
    /// How often it came, 1 for once.
    pub times: u64,
    #[serde(skip)]
    last_ns: u64,
}

/// Whom an event is about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Whom {
    /// The instrument, from 0 on.
    pub instrument: Option<usize>,
    /// The channel, 0 or 1.
    pub side: Option<usize>,
}

/// The list.
#[derive(Clone, Debug, Default)]
pub struct Events {
    list: VecDeque<Event>,
    count: u64,
}

/// The names of the two channels.
pub const NAMES: [&str; 2] = ["A", "B"];

/// A channel and the other one, as texts call them.
pub const fn seen_from(side: usize) -> [&'static str; 2] {
    match side {
        0 => ["channel A", "channel B"],
        _ => ["channel B", "channel A"],
    }
}

impl Events {
    /// Adds an entry, or counts it where it stands already.
    pub fn add(&mut self, time_ns: u64, whom: Whom, kind: Kind, level: Level, text: String) {
        let instrument = whom.instrument.map(|number| number + 1);
        let channel = whom.side.and_then(|side| NAMES.get(side)).copied();
        let same = self.list.iter_mut().rev().take(32).find(|event| {
            event.kind == kind
                && event.instrument == instrument
                && event.channel == channel
                && event.text == text
        });
        if let Some(event) = same
            && time_ns.abs_diff(event.last_ns) < SAME_NS
        {
            event.times += 1;
            event.last_ns = time_ns;
            return;
        }
        if self.list.len() == KEPT {
            self.list.pop_front();
        }
        self.count += 1;
        self.list.push_back(Event {
            number: self.count,
            time_s: seconds(time_ns),
            instrument,
            channel,
            kind,
            level,
            text,
            times: 1,
            last_ns: time_ns,
        });
    }

    /// Entries behind this number, oldest first.
    pub fn since(&self, number: u64) -> impl DoubleEndedIterator<Item = &Event> {
        let from = self.list.partition_point(|event| event.number <= number);
        self.list.range(from..)
    }

    /// How many entries were made.
    pub const fn count(&self) -> u64 {
        self.count
    }
}

/// Nanoseconds as seconds, whole microseconds.
pub fn seconds(time_ns: u64) -> f64 {
    (time_ns / 1000) as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn add(events: &mut Events, time_ns: u64, text: &str) {
        let whom = Whom {
            instrument: Some(0),
            side: Some(1),
        };
        let (kind, level) = (Kind::Emergency, Level::Fault);
        events.add(time_ns, whom, kind, level, text.to_owned());
    }

    #[test]
    fn a_loose_contact_fills_two_entries() {
        let mut events = Events::default();
        for ms in 0..5000 {
            add(
                &mut events,
                ms * 10_000_000,
                ["come", "gone"][ms as usize % 2],
            );
        }
        let times: Vec<_> = events.since(0).map(|event| event.times).collect();
        assert_eq!(times, [2500, 2500]);
        add(&mut events, 100 * S, "come");
        assert_eq!(events.since(2).count(), 1);
    }

    #[test]
    fn the_list_does_not_grow_and_its_numbers_go_on() {
        let mut events = Events::default();
        for number in 0..3000 {
            add(&mut events, number * S, &number.to_string());
        }
        assert_eq!((events.since(0).count(), events.count()), (KEPT, 3000));
        let newest: Vec<_> = events.since(2998).map(|event| event.number).collect();
        assert_eq!(newest, [2999, 3000]);
        assert_eq!(events.since(9999).count(), 0);
    }
}
