//! The fault log: the last 16 events of this device, for whoever asks after the machine stopped.
//!
//! In: an [`Entry`] for each fault that appears and for each set of faults that has gone. Out:
//! bytes, newest event first, any part of them on demand.
//!
//! An event that comes again within [`REPEAT_MS`] of its last time is counted in the entry that
//! it has, so that a loose contact fills two entries and not the log. The entry keeps the time of
//! the first. [`FaultLog::open`] takes a copy for the reader, and what happens meanwhile is in the
//! next one.
//!
//! # Format, version 1
//! Numbers are little-endian and without sign.
//!
//! | byte | content |
//! |---|---|
//! | 0 | version, 1 |
//! | 1 | length of an entry in bytes, 20 |
//! | 2 | entries that follow, 0 to 16 |
//! | 3 | entries made since the start or the last erasure, 255 for more; the rest is lost |
//!
//! Then each entry, newest first:
//!
//! | byte | content |
//! |---|---|
//! | 0 to 3 | time since the start, ms; wraps after 49.7 days |
//! | 4 to 7 | SYNCs obeyed until then |
//! | 8, 9 | EMCY error code; 0: faults have gone |
//! | 10 to 13 | the faults that stand after the event, bit n for fault n (`fault`) |
//! | 14 | state of the pair, as 2021h shows it |
//! | 15 | channel that is blamed: 0 none, 1 own, 2 peer |
//! | 16 | why it is blamed; 0 for no reason |
//! | 17 | number of the box that holds the samples (`black_box`), 0 for none |
//! | 18, 19 | how often the same event came again, 65535 for more |
//!
//! A box may have been taken for a later event since: it is this entry's while the head of the box
//! has this entry's time and SYNC count.
//!
//! Each entry goes into the memory soon after it was made and comes back after a reset or a loss of
//! power, without the repetitions that were counted since ([`FaultLog::next_unsaved`],
//! [`FaultLog::restore`]).
//!
//! Left out: what is an event, and the memory (`device`).

/// The version written.
const VERSION: u8 = 1;

/// Events kept; each has a bit of a `u16` in [`FaultLog`].
pub const ENTRIES: usize = 16;

/// Bytes of an encoded entry.
pub const ENTRY: usize = 20;

/// Bytes before the first entry.
const HEAD: usize = 4;

/// The same event again within this time of its last is a repetition, ms.
pub const REPEAT_MS: u32 = 1000;

/// One event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Entry {
    /// Time since the start, ms.
    pub at_ms: u32,
    /// SYNCs obeyed until then.
    pub sync: u32,
    /// EMCY error code; 0: faults have gone.
    pub code: u16,
    /// The faults that stand after the event, as [`Faults::bits`](crate::fault::Faults::bits).
    pub faults: u32,
    /// State of the pair, as 2021h shows it.
    pub state: u8,
    /// Channel that is blamed: 0 none, 1 own, 2 peer.
    pub blamed: u8,
    /// Why it is blamed; 0 for no reason.
    pub reason: u8,
    /// The box that holds the samples, from 1; 0 for none.
    pub box_number: u8,
    /// How often the same event came again; 0 in what is handed to [`FaultLog::add`].
    pub repeats: u16,
}

impl Entry {
    /// What stands where there is no entry.
    pub(crate) const NONE: Self = Self {
        at_ms: 0,
        sync: 0,
        code: 0,
        faults: 0,
        state: 0,
        blamed: 0,
        reason: 0,
        box_number: 0,
        repeats: 0,
    };

    /// True when both tell the same, whenever they happened.
    fn is_same(&self, other: &Self) -> bool {
        self.code == other.code
            && self.faults == other.faults
            && self.state == other.state
            && self.blamed == other.blamed
            && self.reason == other.reason
    }

    /// An entry from the format above.
    pub const fn decode(bytes: &[u8; ENTRY]) -> Self {
        let [t0, t1, t2, t3, s0, s1, s2, s3, c0, c1, rest @ ..] = *bytes;
        let [f0, f1, f2, f3, state, blamed, reason, number, r0, r1] = rest;
        Self {
            at_ms: u32::from_le_bytes([t0, t1, t2, t3]),
            sync: u32::from_le_bytes([s0, s1, s2, s3]),
            code: u16::from_le_bytes([c0, c1]),
            faults: u32::from_le_bytes([f0, f1, f2, f3]),
            state,
            blamed,
            reason,
            box_number: number,
            repeats: u16::from_le_bytes([r0, r1]),
        }
    }

    /// The entry in the format above.
    pub(crate) const fn encode(&self) -> [u8; ENTRY] {
        let [t0, t1, t2, t3] = self.at_ms.to_le_bytes();
        let [s0, s1, s2, s3] = self.sync.to_le_bytes();
        let [c0, c1] = self.code.to_le_bytes();
        let [f0, f1, f2, f3] = self.faults.to_le_bytes();
        let (state, blamed, reason, number) =
            (self.state, self.blamed, self.reason, self.box_number);
        let [r0, r1] = self.repeats.to_le_bytes();
        [
            t0, t1, t2, t3, s0, s1, s2, s3, c0, c1, f0, f1, f2, f3, state, blamed, reason, number,
            r0, r1,
        ]
    }
}

/// Copies from byte `offset` of head and body in a row; how many bytes, fewer only at the end.
pub(crate) fn copy(head: &[u8], body: &[u8], offset: u32, into: &mut [u8]) -> usize {
    let mut count = 0;
    for to in into {
        let at = (offset as usize).wrapping_add(count);
        let behind = at.wrapping_sub(head.len());
        let Some(byte) = head.get(at).or_else(|| body.get(behind)) else {
            break;
        };
        *to = *byte;
        count += 1;
    }
    count
}

/// An entry and the last time it came.
#[derive(Clone, Copy, Debug)]
struct Kept {
    entry: Entry,
    last_ms: u32,
}

/// The log: its state. What is large comes last, as in `Device`.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct FaultLog {
    /// Where the next entry goes.
    next: u8,
    /// Entries that there are.
    count: u8,
    /// Entries that have been made, 255 for more.
    total: u8,
    /// How many of the newest ones are not in the memory yet.
    unsaved: u8,
    /// Bit n: the entry at place n was made before the last reset, when times were others.
    before_reset: u16,
    /// The copy under read.
    head: [u8; HEAD],
    kept: [Kept; ENTRIES],
    body: [[u8; ENTRY]; ENTRIES],
}

impl FaultLog {
    /// An empty log.
    #[inline(never)]
    pub const fn new() -> Self {
        // As constants both are cleared where they stand, and not made on the stack first.
        const NOTHING: [Kept; ENTRIES] = [Kept {
            entry: Entry::NONE,
            last_ms: 0,
        }; ENTRIES];
        const NO_COPY: [[u8; ENTRY]; ENTRIES] = [[0; ENTRY]; ENTRIES];
        Self {
            kept: NOTHING,
            next: 0,
            count: 0,
            total: 0,
            unsaved: 0,
            before_reset: 0,
            head: [VERSION, ENTRY as u8, 0, 0],
            body: NO_COPY,
        }
    }

    /// Takes an event, over the oldest one where the log is full.
    ///
    /// True when it has got an entry, false when it was counted as a repetition.
    pub fn add(&mut self, entry: Entry) -> bool {
        let (next, count) = (usize::from(self.next), usize::from(self.count));
        for (place, kept) in self.kept.iter_mut().enumerate() {
            // As many places back from the next one count as there are entries.
            if (next + ENTRIES - 1 - place) % ENTRIES >= count {
                continue;
            }
            let since = entry.at_ms.wrapping_sub(kept.last_ms);
            let before_reset = self.before_reset >> place & 1 != 0;
            if !before_reset && since <= REPEAT_MS && kept.entry.is_same(&entry) {
                kept.last_ms = entry.at_ms;
                kept.entry.repeats = kept.entry.repeats.saturating_add(1);
                return false;
            }
        }
        if let Some(kept) = self.kept.get_mut(usize::from(self.next)) {
            *kept = Kept {
                entry,
                last_ms: entry.at_ms,
            };
            self.before_reset &= !(1 << (self.next % ENTRIES as u8));
        }
        self.next = (self.next + 1) % ENTRIES as u8;
        self.count = (self.count + 1).min(ENTRIES as u8);
        self.total = self.total.saturating_add(1);
        self.unsaved = (self.unsaved + 1).min(ENTRIES as u8);
        true
    }

    /// Notes at the newest entry which box holds its samples.
    pub fn in_box(&mut self, number: u8) {
        let newest = usize::from(self.next.wrapping_sub(1)) % ENTRIES;
        if let Some(kept) = self.kept.get_mut(newest) {
            kept.entry.box_number = number;
        }
    }

    /// The entries, newest first.
    pub fn iter(&self) -> impl Iterator<Item = &Entry> {
        (0..usize::from(self.count)).filter_map(|back| self.newest(back))
    }

    /// The entry that was made so many before the newest one.
    fn newest(&self, back: usize) -> Option<&Entry> {
        let place = (usize::from(self.next) + 2 * ENTRIES - 1 - back) % ENTRIES;
        self.kept.get(place).map(|kept| &kept.entry)
    }

    /// Length in bytes of what [`FaultLog::open`] would copy, 4 to 324.
    pub const fn length(&self) -> u32 {
        (HEAD + ENTRY * self.count as usize) as u32
    }

    /// Copies the log for [`FaultLog::read_at`]; its length in bytes.
    pub fn open(&mut self) -> u32 {
        for place in 0..usize::from(self.count) {
            let entry = self.newest(place).map(Entry::encode);
            if let (Some(to), Some(entry)) = (self.body.get_mut(place), entry) {
                *to = entry;
            }
        }
        self.head = [VERSION, ENTRY as u8, self.count, self.total];
        self.length()
    }

    /// Reads the copy from byte `offset` on; how many bytes, fewer only at the end.
    pub fn read_at(&self, offset: u32, into: &mut [u8]) -> usize {
        let [_, _, count, _] = self.head;
        let entries = self.body.get(..usize::from(count)).unwrap_or(&[]);
        copy(&self.head, entries.as_flattened(), offset, into)
    }

    /// The oldest entry that is not in the memory yet.
    pub fn next_unsaved(&self) -> Option<Entry> {
        let place = self.unsaved.checked_sub(1)?;
        let entry = self.newest(usize::from(place)).copied();
        entry.filter(|_| place < self.count)
    }

    /// That entry is in the memory now, or never will be.
    pub const fn saved(&mut self) {
        self.unsaved = self.unsaved.saturating_sub(1);
    }

    /// Puts an event from before the start behind the oldest one of a log to which nothing was
    /// added. What comes after the start is no repetition of it, since times were others then.
    pub fn restore(&mut self, entry: Entry) {
        let place = ENTRIES.checked_sub(usize::from(self.count) + 1);
        if let Some(place) = place
            && let Some(kept) = self.kept.get_mut(place)
        {
            *kept = Kept {
                entry,
                last_ms: entry.at_ms,
            };
            self.before_reset |= 1 << (place % ENTRIES);
            self.count += 1;
        }
        self.total = self.total.saturating_add(1);
    }

    /// Forgets every event. A copy under read stays whole.
    pub const fn clear(&mut self) {
        self.next = 0;
        self.count = 0;
        self.total = 0;
        self.unsaved = 0;
    }
}

impl Default for FaultLog {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use proptest::prelude::*;
    use std::vec::Vec;

    use super::*;

    fn event(at_ms: u32, code: u16) -> Entry {
        Entry {
            at_ms,
            code,
            ..Entry::default()
        }
    }

    fn upload(log: &mut FaultLog, piece: usize) -> Vec<u8> {
        let length = log.open();
        let mut bytes = Vec::new();
        let mut into = std::vec![0; piece];
        loop {
            let count = log.read_at(bytes.len() as u32, &mut into);
            bytes.extend_from_slice(&into[..count]);
            if count < piece {
                assert_eq!(bytes.len() as u32, length);
                return bytes;
            }
        }
    }

    #[test]
    fn each_field_stands_where_the_table_has_it() {
        let mut log = FaultLog::new();
        log.add(Entry {
            at_ms: 0x0403_0201,
            sync: 0x0807_0605,
            code: 0xFF15,
            faults: 0x0C0B_0A09,
            state: 13,
            blamed: 2,
            reason: 3,
            box_number: 0,
            repeats: 0,
        });
        log.in_box(1);
        let expected = [
            1, 20, 1, 1, 1, 2, 3, 4, 5, 6, 7, 8, 0x15, 0xFF, 9, 10, 11, 12, 13, 2, 3, 1, 0, 0,
        ];
        assert_eq!(upload(&mut log, 7), expected);
    }

    #[test]
    fn an_empty_log_is_its_head() {
        let mut log = FaultLog::new();
        let unopened = &mut [0; 9];
        assert_eq!(log.read_at(0, unopened), HEAD);
        assert_eq!(upload(&mut log, 3), [1, 20, 0, 0]);
        assert_eq!(log.iter().count(), 0);
    }

    #[test]
    fn the_newest_come_first_and_the_oldest_go() {
        let mut log = FaultLog::new();
        for n in 1..=300 {
            assert!(log.add(event(u32::from(n) * 10, n)));
            let codes: Vec<u16> = log.iter().map(|entry| entry.code).collect();
            let expected: Vec<u16> = (1..=n).rev().take(ENTRIES).collect();
            assert_eq!(codes, expected);
        }
        assert_eq!(upload(&mut log, 50)[..4], [1, 20, 16, 255]);
        assert_eq!(log.length(), 324);
    }

    #[test]
    fn a_loose_contact_fills_two_entries_and_not_the_log() {
        let mut log = FaultLog::new();
        log.add(event(5, 0x4200));
        for n in 0..200 {
            let fresh = log.add(event(1000 + n * 900, 0xFF02));
            assert_eq!(fresh, n == 0);
            log.add(event(1400 + n * 900, 0));
        }
        let seen: Vec<_> = log.iter().map(|e| (e.code, e.at_ms, e.repeats)).collect();
        assert_eq!(seen, [(0, 1400, 199), (0xFF02, 1000, 199), (0x4200, 5, 0)]);
    }

    #[test]
    fn a_repetition_ends_after_a_second_and_counts_only_the_same() {
        let mut log = FaultLog::new();
        assert!(log.add(event(100, 7)));
        assert!(!log.add(event(1100, 7)));
        assert!(log.add(event(2101, 7)));
        let others = [
            Entry {
                faults: 1,
                ..event(2101, 7)
            },
            Entry {
                state: 1,
                ..event(2101, 7)
            },
            Entry {
                blamed: 1,
                ..event(2101, 7)
            },
            Entry {
                reason: 1,
                ..event(2101, 7)
            },
            event(2101, 8),
        ];
        for other in others {
            assert!(log.add(other), "{other:?}");
        }
        assert!(!log.add(Entry {
            sync: 9,
            box_number: 2,
            ..event(2200, 7)
        }));
    }

    #[test]
    fn the_first_second_does_not_repeat_an_entry_that_never_was() {
        let mut log = FaultLog::new();
        assert!(log.add(event(0, 0)));
        log.clear();
        assert!(log.add(event(0, 0)));
    }

    #[test]
    fn the_clock_of_milliseconds_may_wrap() {
        let mut log = FaultLog::new();
        assert!(log.add(event(u32::MAX - 10, 7)));
        assert!(!log.add(event(20, 7)));
    }

    /// Time begins anew with a reset, so the same event looked like a repetition of the old one.
    #[test]
    fn the_same_event_after_a_reset_is_a_new_one() {
        let mut log = FaultLog::new();
        log.restore(event(500, 0xFF13));
        assert!(log.add(event(600, 0xFF13)));
        assert!(!log.add(event(700, 0xFF13)));
        assert_eq!(log.iter().count(), 2);
    }

    #[test]
    fn what_was_saved_comes_back_in_its_order_and_older_ones_are_counted() {
        let mut log = FaultLog::new();
        let mut memory = Vec::new();
        for n in 1..=20 {
            log.add(Entry {
                sync: 0x0102_0304,
                faults: 0x0A0B_0C0D,
                state: 13,
                blamed: 2,
                reason: 9,
                box_number: 1,
                ..event(u32::from(n) * 5000, n)
            });
            let entry = log.next_unsaved().unwrap();
            memory.push(Entry::decode(&entry.encode()));
            log.saved();
            assert_eq!(log.next_unsaved(), None);
        }
        let mut restored = FaultLog::new();
        for entry in memory.iter().rev() {
            restored.restore(*entry);
        }
        assert_eq!(upload(&mut restored, 50), upload(&mut log, 50));
        // Ones from before are known already; a new one is the newest.
        assert_eq!(restored.next_unsaved(), None);
        assert!(restored.add(event(1, 99)));
        let codes: Vec<u16> = restored.iter().map(|entry| entry.code).collect();
        let expected: Vec<u16> = [99].into_iter().chain((6..=20).rev()).collect();
        assert_eq!(codes, expected);
        assert_eq!(restored.next_unsaved(), Some(event(1, 99)));
    }

    /// The places that a short log left free held an event without faults.
    #[test]
    fn faults_that_had_gone_after_a_start_were_a_repetition_of_nothing() {
        let mut log = FaultLog::new();
        for n in 0..8 {
            log.restore(event(4000 - n, 7));
        }
        for n in 0..8 {
            assert!(
                log.add(event(400 + u32::from(n), n % 2 * 9 + n / 2 * 20)),
                "{n}"
            );
        }
        assert_eq!(log.iter().count(), 16);
        let times: Vec<u32> = log.iter().map(|entry| entry.at_ms).collect();
        let new = (400..408).rev();
        assert_eq!(times, new.chain((3993..=4000).rev()).collect::<Vec<_>>());
    }

    #[test]
    fn events_are_saved_in_the_order_in_which_they_came() {
        let mut log = FaultLog::new();
        for n in 0..20 {
            log.add(event(0, n));
        }
        // Four of them were never saved, and are gone.
        for n in 4..20 {
            assert_eq!(log.next_unsaved().map(|entry| entry.code), Some(n));
            log.saved();
        }
        assert_eq!(log.next_unsaved(), None);
    }

    #[test]
    fn repetitions_stop_at_their_highest() {
        let mut log = FaultLog::new();
        for n in 0..70_000 {
            log.add(event(n, 7));
        }
        assert_eq!(log.iter().next().map(|e| e.repeats), Some(u16::MAX));
    }

    #[test]
    fn what_happens_during_a_read_is_in_the_next_one() {
        let mut log = FaultLog::new();
        for n in 0..20 {
            log.add(event(0, n));
        }
        let before = upload(&mut log, 64);
        for n in 50..90 {
            log.add(event(0, n));
        }
        log.clear();
        let mut again = [0; 400];
        assert_eq!(log.read_at(0, &mut again), before.len());
        assert_eq!(again[..before.len()], before);
        assert_eq!(upload(&mut log, 64), [1, 20, 0, 0]);
    }

    proptest! {
        #[test]
        fn whatever_comes_is_logged_or_counted(
            events in proptest::collection::vec((0..3000_u32, 0..3_u16, any::<u8>()), 0..100),
            offset: u32, length in 0..400_usize,
        ) {
            let (mut log, mut now, mut fresh) = (FaultLog::new(), 0_u32, 0_u32);
            let mut last = [None; 3];
            for (step, code, number) in events {
                now += step;
                let known = last[usize::from(code)].is_some_and(|at| now - at <= REPEAT_MS);
                // Only what the log still holds can be repeated: three codes never push it out.
                let added = log.add(event(now, code));
                prop_assert_eq!(added, !known);
                last[usize::from(code)] = Some(now);
                fresh += u32::from(added);
                log.in_box(number);
                prop_assert_eq!(log.iter().next().map(|e| e.box_number), Some(number));
            }
            prop_assert_eq!(log.length(), 4 + 20 * fresh.min(16));
            let end = log.open();
            let count = log.read_at(offset, &mut std::vec![0; length]);
            prop_assert_eq!(count, (end.saturating_sub(offset) as usize).min(length));
        }
    }
}
