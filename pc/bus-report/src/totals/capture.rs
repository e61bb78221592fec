//! The SYNCs around an event, from the log itself.
//!
//! In: every [`Round`] in the order of the log, and the time of an event. Out: up to
//! [`MOST`] captures of [`BEFORE`] rows up to the event and [`AFTER`] behind it, as the device's
//! black box has them. What happens while a capture is being filled is in that one already.

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

use listen::Round;

/// Rounds up to an event.
pub const BEFORE: usize = 32;

/// Rounds after it.
pub const AFTER: usize = 16;

/// Captures that are kept.
pub const MOST: usize = 24;

/// Rounds that are further apart than this do not belong together, ns.
const BREAK_NS: u64 = 5_000_000_000;

/// One capture.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, PartialOrd, Ord)]
pub struct Capture {
    /// When its first event was, ns.
    pub at_ns: u64,
    /// Rounds up to the event.
    pub before: usize,
    /// All rows, oldest first.
    pub rows: Vec<Round>,
}

/// The recorder.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Recorder {
    #[serde(skip)]
    ring: VecDeque<Round>,
    captures: Vec<Capture>,
    /// Rounds that the latest capture still lacks.
    #[serde(skip)]
    wanted: usize,
    left_out: u64,
}

impl Recorder {
    /// Takes a row.
    pub fn record(&mut self, row: &Round) {
        let last = self.ring.back().map_or(row.time_ns, |last| last.time_ns);
        if row.time_ns.abs_diff(last) > BREAK_NS {
            self.ring.clear();
            self.wanted = 0;
        }
        if self.ring.len() >= BEFORE {
            self.ring.pop_front();
        }
        self.ring.push_back(*row);
        if let (Some(capture), 1..) = (self.captures.last_mut(), self.wanted) {
            capture.rows.push(*row);
            self.wanted -= 1;
        }
    }

    /// Something has happened; the number of the capture that shows it, `None` when there is no
    /// room for one more or nothing to show.
    pub fn trigger(&mut self, at_ns: u64) -> Option<usize> {
        if self.wanted > 0 {
            return self.captures.len().checked_sub(1);
        }
        let last = self.ring.back()?;
        if last.time_ns.abs_diff(at_ns) > BREAK_NS {
            return None;
        }
        if self.captures.len() >= MOST {
            self.left_out += 1;
            return None;
        }
        self.wanted = AFTER;
        self.captures.push(Capture {
            at_ns,
            before: self.ring.len(),
            rows: self.ring.iter().copied().collect(),
        });
        Some(self.captures.len() - 1)
    }

    /// Takes the captures of another log: the earliest of both are kept. Where they are then, by
    /// their former places: of the own ones, and of the others; `None` for those without room.
    pub fn merge(&mut self, other: &Self) -> [Vec<Option<usize>>; 2] {
        let mut all = [self.captures.clone(), other.captures.clone()].concat();
        all.sort_unstable();
        let place = |capture: &Capture| all.iter().position(|one| one == capture);
        let kept = |capture: &Capture| place(capture).filter(|place| *place < MOST);
        let places = [&self.captures, &other.captures].map(|own| own.iter().map(kept).collect());
        let lost = all.len().saturating_sub(MOST) as u64;
        let left_out = self.left_out.saturating_add(other.left_out);
        self.left_out = left_out.saturating_add(lost);
        all.truncate(MOST);
        self.captures = all;
        places
    }

    /// What was captured.
    pub fn captures(&self) -> &[Capture] {
        &self.captures
    }

    /// Events for which there was no room.
    pub const fn left_out(&self) -> u64 {
        self.left_out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn as_many_rows_before_and_after_as_the_black_box_has() {
        use device::black_box;
        assert_eq!((BEFORE, AFTER), (black_box::BEFORE, black_box::AFTER));
        let mut recorder = Recorder::default();
        for n in 0..100 {
            recorder.record(&Round::at(n * 10 * MS));
            if n == 50 {
                assert_eq!(recorder.trigger(n * 10 * MS), Some(0));
            }
            if n == 60 {
                assert_eq!(recorder.trigger(n * 10 * MS), Some(0));
            }
        }
        let [capture] = recorder.captures() else {
            panic!("one capture");
        };
        assert_eq!((capture.before, capture.rows.len()), (32, 48));
        assert_eq!(capture.rows[31].time_ns, 500 * MS);
        assert_eq!(capture.rows[47].time_ns, 660 * MS);
    }

    #[test]
    fn rows_from_before_a_long_silence_are_not_shown() {
        let mut recorder = Recorder::default();
        recorder.record(&Round::at(0));
        recorder.record(&Round::at(9000 * MS));
        recorder.trigger(9001 * MS);
        recorder.record(&Round::at(20_000 * MS));
        assert_eq!(recorder.captures()[0].rows.len(), 1);
        assert_eq!(recorder.trigger(60_000 * MS), None);
    }

    #[test]
    fn more_than_there_is_room_for_is_counted() {
        let mut recorder = Recorder::default();
        for n in 0..1000 {
            recorder.record(&Round::at(n * 10 * MS));
            if n % 20 == 0 {
                recorder.trigger(n * 10 * MS);
            }
        }
        assert_eq!(recorder.captures().len(), MOST);
        assert_eq!(recorder.left_out(), 50 - MOST as u64);
    }
}
