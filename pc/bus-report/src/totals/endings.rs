//! What ends in a log that stood at the end of an earlier one, where both were counted apart.
//!
//! In: the first boot-up message, the first heartbeat and the first EMCY messages of each channel
//! that have a fault no longer in their set. Out: their times, the same in every order and grouping
//! of the logs, and with them the [`Event`]s as one evaluation of all logs has them. There are a
//! few for each log, whatever its length.
//!
//! Left out: what ends within its own log (`events`).

use std::collections::BTreeSet;

use codes::words;
use device::fault::Fault;
use serde::{Deserialize, Serialize};

use super::event::{End, Event, What};

/// What ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
enum Ending {
    /// All that the node has reported: it restarted.
    Restart,
    /// A lost heartbeat.
    Beat,
    /// An error of the bus.
    Bus,
    /// Each fault whose bit is not in this set.
    Set(u32),
}

/// The endings of some logs.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Endings {
    /// Time in ns, channel, and what ends.
    first: BTreeSet<(u64, u8, Ending)>,
    /// The faults that no set of channel A and B had by now.
    #[serde(skip)]
    absent: [u32; 2],
}

impl Endings {
    /// The node restarted.
    pub fn restart(&mut self, at_ns: u64, side: u8) {
        self.add(at_ns, side, Ending::Restart);
    }

    /// The node sent a heartbeat.
    pub fn beat(&mut self, at_ns: u64, side: u8) {
        self.add(at_ns, side, Ending::Beat);
    }

    /// No error of the bus stands.
    pub fn bus(&mut self, at_ns: u64, side: u8) {
        self.add(at_ns, side, Ending::Bus);
    }

    /// The faults that stand by an EMCY message.
    pub fn set(&mut self, at_ns: u64, side: u8, set: u32) {
        let Some(absent) = self.absent.get_mut(usize::from(side)) else {
            return;
        };
        if !set & !*absent & FAULTS != 0 {
            *absent |= !set & FAULTS;
            self.first.insert((at_ns, side, Ending::Set(set)));
        }
    }

    /// Enters what comes first in its log.
    fn add(&mut self, at_ns: u64, side: u8, ending: Ending) {
        let is_it = |(_, its, other): &(u64, u8, Ending)| (*its, *other) == (side, ending);
        if !self.first.iter().any(is_it) {
            self.first.insert((at_ns, side, ending));
        }
    }

    /// Takes those of another log.
    pub fn merge(&mut self, other: &Self) {
        self.first.extend(&other.first);
    }

    /// Events in the order of time, with the ends that a later log has.
    pub fn applied(&self, kept: &[Event]) -> Vec<Event> {
        let mut all: Vec<Event> = Vec::with_capacity(kept.len());
        for event in kept {
            let again = |one: &&mut Event| (one.side, one.what) == (event.side, event.what);
            match all.iter_mut().rfind(again) {
                // It stood when its log ended, so this is the same one.
                Some(former) if former.is_again_later(event) => former.repeat(event),
                _ => all.push(*event),
            }
            if let Some(last) = all.iter_mut().rfind(again) {
                last.end = self.end(last);
            }
        }
        all
    }

    /// How an event ended.
    fn end(&self, event: &Event) -> End {
        let (End::Standing, Some(stood_ns)) = (event.end, event.stood_ns) else {
            return event.end;
        };
        let after = (stood_ns, u8::MAX, Ending::Set(u32::MAX));
        let mut later = self.first.range(after..);
        let first = later.find(|(_, side, ending)| *side == event.side && ending.ends(event.what));
        match first {
            Some((at_ns, _, Ending::Restart)) => End::Restarted(*at_ns),
            Some((at_ns, ..)) => End::Over(*at_ns),
            None => End::Standing,
        }
    }
}

/// The bits that sets have.
const FAULTS: u32 = 0x00FF_FFFF;

impl Ending {
    fn ends(self, what: What) -> bool {
        match (self, what) {
            (Self::Beat, What::HeartbeatLost) | (Self::Restart, What::Emergency(_)) => true,
            (Self::Bus, What::Emergency(code)) => words::fault(code).is_none(),
            (Self::Set(set), What::Emergency(code)) => {
                words::fault(code).is_some_and(|fault: Fault| set >> fault as u8 & 1 == 0)
            }
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use listen::Emergency;

    use super::super::events::Events;
    use super::*;

    const S: u64 = 1_000_000_000;

    fn told(code: u16, faults: u8) -> Emergency {
        Emergency {
            code,
            register: 0x81,
            bytes: [faults, 0, 0, 0x80 | 15, 8],
        }
    }

    fn merged(parts: &[&Events]) -> Vec<End> {
        let mut all = Events::default();
        let none = [const { Vec::new() }; 2];
        parts.iter().for_each(|part| all.merge(part, &none));
        all.concluded().iter().map(|event| event.end).collect()
    }

    /// A log with a fault of sensor and pair that stand at its end.
    fn morning() -> Events {
        let mut events = Events::default();
        events.emergency(S, 0, &told(0xFF01, 2));
        events.finish(5 * S);
        events
    }

    #[test]
    fn a_fault_of_a_morning_stood_although_the_node_restarted_at_noon() {
        let mut noon = Events::default();
        noon.restarted(10 * S, 0);
        noon.finish(20 * S);
        assert_eq!(merged(&[&noon, &morning()]), [End::Restarted(10 * S)]);
        let mut other = Events::default();
        other.restarted(10 * S, 1);
        assert_eq!(merged(&[&morning(), &other]), [End::Standing]);
    }

    #[test]
    fn a_fault_that_a_later_log_no_longer_has_in_its_set_is_over() {
        let mut later = Events::default();
        later.emergency(10 * S, 0, &told(0xFF15, 0xFF));
        later.finish(11 * S);
        assert_eq!(merged(&[&morning(), &later])[0], End::Standing);
        let mut last = Events::default();
        last.emergency(12 * S, 0, &told(0, 0));
        last.finish(13 * S);
        assert_eq!(merged(&[&last, &morning(), &later])[0], End::Over(12 * S));
    }

    #[test]
    fn a_fault_that_stands_in_two_logs_is_one() {
        let mut later = Events::default();
        later.emergency(10 * S, 0, &told(0xFF01, 2));
        later.emergency(12 * S, 0, &told(0, 0));
        later.finish(13 * S);
        let mut all = morning();
        all.merge(&later, &[const { Vec::new() }; 2]);
        let [event] = all.concluded()[..] else {
            panic!("{:?}", all.concluded());
        };
        assert_eq!((event.end, event.repeats), (End::Over(12 * S), 1));
    }

    #[test]
    fn a_heartbeat_that_was_lost_is_back_in_a_later_log() {
        let mut morning = Events::default();
        morning.other(S, 1, What::HeartbeatLost, End::Standing);
        morning.finish(5 * S);
        let mut noon = Events::default();
        noon.beat(10 * S, 1);
        assert_eq!(merged(&[&morning, &noon]), [End::Over(10 * S)]);
    }
}
