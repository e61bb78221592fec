//! What happened, one by one: faults, restarts, lost heartbeats.
//!
//! In: EMCY messages, boot-ups and losses in the order of the log. Out: a list of [`Event`]s with
//! their ends, of which the first [`MOST_FAULTS`] faults and the first [`MOST_OTHERS`] others are
//! kept; the rest is counted. The same event of the same node again within a second of its end is
//! a repetition, as in the device's own fault log.
//!
//! An end is known by the set of faults in EMCY bytes 3 to 5, by the error register for what
//! belongs to the bus, or by a restart of the node (docs/canopen.md, EMCY). What stood at the end
//! of its log may end in a later one, which is found when the list is read ([`Endings`]).

use super::endings::Endings;
use super::event::{End, Event, What};
use codes::words;
use listen::{Emergency, SAME_START_NS};
use serde::{Deserialize, Serialize};

/// Faults that are kept one by one.
pub const MOST_FAULTS: usize = 200;

/// Other events that are kept one by one.
pub const MOST_OTHERS: usize = 100;

/// Error register, bit 4: communication; and bit 0, which any error sets.
const COMMUNICATION: u8 = 0x10;
const GENERIC: u8 = 0x01;

/// The list.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Events {
    kept: Vec<Event>,
    #[serde(skip)]
    faults: usize,
    /// Faults and others that were not kept.
    left_out: [u64; 2],
    /// What the log ends of those that stood before it.
    #[serde(default)]
    endings: Endings,
}

impl Events {
    /// What was kept, in the order of the log; after a merge in the order of time, with the ends
    /// that later logs have.
    pub fn concluded(&self) -> Vec<Event> {
        self.endings.applied(&self.kept)
    }

    /// A node sent a heartbeat.
    pub fn beat(&mut self, at_ns: u64, side: u8) {
        self.endings.beat(at_ns, side);
    }

    /// The log has ended at this time.
    pub fn finish(&mut self, now_ns: u64) {
        let open = self.kept.iter_mut();
        for event in open.filter(|event| event.end == End::Standing) {
            event.stood_ns = Some(now_ns);
        }
    }

    /// How many faults and how many others found no room.
    pub const fn left_out(&self) -> [u64; 2] {
        self.left_out
    }

    /// Takes an EMCY message; its place in the list when it is one to be kept, and whether it is
    /// a new one.
    pub fn emergency(&mut self, at_ns: u64, side: u8, told: &Emergency) -> Option<(usize, bool)> {
        self.close_gone(at_ns, side, told);
        if told.code == 0 {
            return None;
        }
        let [_, _, _, verdict, state] = told.bytes;
        let of_pair = words::fault(told.code).is_some();
        self.add(Event {
            blamed: if of_pair { verdict >> 6 } else { 0 },
            reason: if of_pair { verdict & 0x3F } else { 0 },
            state: of_pair.then_some(state),
            ..Event::new(at_ns, side, What::Emergency(told.code))
        })
    }

    /// Takes an event that is no EMCY message.
    pub fn other(&mut self, at_ns: u64, side: u8, what: What, end: End) {
        let event = Event::new(at_ns, side, what);
        self.add(Event { end, ..event });
    }

    fn add(&mut self, event: Event) -> Option<(usize, bool)> {
        let again = |kept: &Event| kept.side == event.side && kept.what == event.what;
        let last = self.kept.iter().rposition(again);
        if let Some((place, kept)) = last.and_then(|at| Some((at, self.kept.get_mut(at)?)))
            && kept.is_within_a_second(&event)
        {
            kept.repeats = kept.repeats.saturating_add(1);
            kept.end = event.end;
            kept.told_ns = event.at_ns;
            return Some((place, false));
        }
        let is_fault = event.what.kind().is_fault();
        let others = self.kept.len() - self.faults;
        let (count, most, out) = match is_fault {
            true => (self.faults, MOST_FAULTS, 0),
            false => (others, MOST_OTHERS, 1),
        };
        if count >= most {
            self.left_out[out] += 1;
            return None;
        }
        self.faults += usize::from(is_fault);
        self.kept.push(event);
        Some((self.kept.len() - 1, true))
    }

    /// Ends what this message no longer has in its set.
    fn close_gone(&mut self, at_ns: u64, side: u8, told: &Emergency) {
        let [f0, f1, f2, ..] = told.bytes;
        let set = u32::from_le_bytes([f0, f1, f2, 0]);
        let of_bus = matches!(told.code, 0x8000..=0x8FFF);
        // The 0000h of a bus error has an empty set although faults of the instrument may stand.
        let no_set = told.bytes == [0; 5] && told.register & !(COMMUNICATION | GENERIC) != 0;
        let has_set = !of_bus && !no_set;
        let no_bus_error = told.code == 0 && told.register & COMMUNICATION == 0;
        if has_set {
            self.endings.set(at_ns, side, set);
        }
        if no_bus_error {
            self.endings.bus(at_ns, side);
        }
        let open = self.kept.iter_mut();
        for event in open.filter(|event| event.side == side && event.end == End::Standing) {
            let What::Emergency(code) = event.what else {
                continue;
            };
            let over = match words::fault(code) {
                Some(fault) => has_set && set >> fault as u8 & 1 == 0,
                None => no_bus_error,
            };
            if over {
                event.end = End::Over(at_ns);
            }
        }
    }

    /// Ends what a restart takes back, which is all that this node has told.
    pub fn restarted(&mut self, at_ns: u64, side: u8) {
        self.endings.restart(at_ns, side);
        let open = self.kept.iter_mut();
        for event in open.filter(|event| event.side == side && event.end == End::Standing) {
            let is_of_this_start = at_ns.saturating_sub(event.told_ns) < SAME_START_NS;
            if matches!(event.what, What::Emergency(_)) && !is_of_this_start {
                event.end = End::Restarted(at_ns);
            }
        }
    }

    /// Takes the events of another log: the earliest faults and others of both are kept, in the
    /// order of time. `places` are those of the captures behind a merge, by their former places.
    pub fn merge(&mut self, other: &Self, places: &[Vec<Option<usize>>; 2]) {
        self.endings.merge(&other.endings);
        let [own, others] = places;
        let both = self.kept.iter().map(|event| (event, own));
        let both = both.chain(other.kept.iter().map(|event| (event, others)));
        let mut all: Vec<Event> = both
            .map(|(event, places)| Event {
                plot: event.plot.and_then(|plot| *places.get(plot)?),
                ..*event
            })
            .collect();
        all.sort_unstable_by_key(Event::key);
        let (mut faults, mut rest): (Vec<Event>, Vec<Event>) = all
            .into_iter()
            .partition(|event| event.what.kind().is_fault());
        let lost = [
            faults.len().saturating_sub(MOST_FAULTS),
            rest.len().saturating_sub(MOST_OTHERS),
        ];
        for (place, (other, lost)) in self
            .left_out
            .iter_mut()
            .zip(other.left_out.iter().zip(lost))
        {
            *place = place.saturating_add(*other).saturating_add(lost as u64);
        }
        faults.truncate(MOST_FAULTS);
        rest.truncate(MOST_OTHERS);
        self.faults = faults.len();
        faults.append(&mut rest);
        faults.sort_unstable_by_key(Event::key);
        self.kept = faults;
    }

    /// Notes which plot shows an event.
    pub fn in_plot(&mut self, place: usize, plot: usize) {
        if let Some(event) = self.kept.get_mut(place) {
            event.plot.get_or_insert(plot);
        }
    }
}

#[cfg(test)]
mod tests {
    use device::fault::Fault;

    use super::*;

    const S: u64 = 1_000_000_000;

    fn told(code: u16, register: u8, faults: u32) -> Emergency {
        let [f0, f1, f2, _] = faults.to_le_bytes();
        Emergency {
            code,
            register,
            bytes: [f0, f1, f2, 0x80 | 15, 8],
        }
    }

    #[test]
    fn a_fault_ends_when_it_is_no_longer_in_the_set() {
        let mut events = Events::default();
        let (silent, peer) = (
            1 << Fault::SensorSilent as u32,
            1 << Fault::PeerChannel as u32,
        );
        events.emergency(S, 0, &told(0xFF15, 0x81, peer));
        events.emergency(2 * S, 0, &told(0xFF02, 0x81, peer | silent));
        events.emergency(3 * S, 1, &told(0, 0, 0));
        events.emergency(4 * S, 0, &told(0, 0x81, silent));
        let ends: Vec<_> = events.kept.iter().map(|event| event.end).collect();
        assert_eq!(ends, [End::Over(4 * S), End::Standing]);
        assert_eq!(events.kept[0].reason, 15);
        assert_eq!(events.kept[0].blamed, 2);
        events.restarted(5 * S, 0);
        assert_eq!(events.kept[1].end, End::Restarted(5 * S));
    }

    #[test]
    fn the_end_of_a_bus_error_does_not_end_a_fault_of_the_instrument() {
        let mut events = Events::default();
        events.emergency(S, 0, &told(0xFF13, 0x81, 1 << Fault::Disagree as u32));
        events.emergency(2 * S, 0, &told(0x8130, 0x91, 2));
        let end = Emergency {
            code: 0,
            register: 0x81,
            bytes: [0; 5],
        };
        events.emergency(3 * S, 0, &end);
        let ends: Vec<_> = events.kept.iter().map(|event| event.end).collect();
        assert_eq!(ends, [End::Standing, End::Over(3 * S)]);
    }

    #[test]
    fn a_fault_told_just_before_the_boot_up_message_was_taken_back_by_it() {
        let mut events = Events::default();
        let uncalibrated = 1 << Fault::NotCalibrated as u32;
        events.emergency(S, 0, &told(0xFF20, 0x81, uncalibrated));
        events.restarted(S + 185_000, 0);
        assert_eq!(events.kept[0].end, End::Standing);
        events.restarted(2 * S, 0);
        assert_eq!(events.kept[0].end, End::Restarted(2 * S));
    }

    #[test]
    fn a_fault_that_stood_and_is_reported_again_at_a_start_ended_with_that_start() {
        let mut events = Events::default();
        let uncalibrated = told(0xFF20, 0x81, 1 << Fault::NotCalibrated as u32);
        events.emergency(S, 0, &uncalibrated);
        events.emergency(9 * S, 0, &uncalibrated);
        events.restarted(9 * S + 185_000, 0);
        assert_eq!(events.kept[0].end, End::Standing);
    }

    #[test]
    fn a_loose_contact_is_one_event_that_came_again() {
        let mut events = Events::default();
        let set = 1 << Fault::SensorBus as u32;
        for n in 0..50 {
            events.emergency(n * S, 1, &told(0xFF01, 0x81, set));
            events.emergency(n * S + S / 2, 1, &told(0, 0, 0));
        }
        assert_eq!(events.kept.len(), 1);
        assert_eq!(events.kept[0].repeats, 49);
    }

    #[test]
    fn what_finds_no_room_is_counted_and_faults_keep_theirs() {
        let mut events = Events::default();
        for n in 0..1000 {
            let range = told(0x5010, 0x21, 1);
            events.emergency(10 * n * S, 0, &range);
            events.emergency((10 * n + 1) * S, 0, &told(0, 0, 0));
        }
        events.emergency(
            20_000 * S,
            0,
            &told(0xFF13, 0x81, 1 << Fault::Disagree as u32),
        );
        assert_eq!(events.left_out(), [0, 900]);
        assert_eq!(events.kept.len(), 101);
    }
}
