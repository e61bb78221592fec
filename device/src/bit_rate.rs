//! Finding the bit rate of a bus by listening (CiA 305, table 0, index 9; object 2053h sub 2).
//!
//! In: the time. Out: the rate to listen at next. The board puts its controller into listen-only
//! mode, so that nobody's frames are disturbed, sets the rate, and calls the first frame that
//! arrives whole the proof. A silent bus is searched for ever: without traffic there is nothing
//! to find.
//!
//! Left out: the controller, and rates that CiA 301 doesn't have.

use instant::Instant;

/// Rates tried, kbit/s, the usual ones first.
pub const CANDIDATES: [u16; 8] = [250, 500, 125, 1000, 800, 50, 20, 10];

/// Time spent on one candidate: two heartbeats of a slow producer.
pub const DWELL_US: i64 = 500_000;

/// A search under way.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    candidate: usize,
    until: Instant,
}

impl Search {
    /// Begins with the first candidate.
    pub const fn new(now: Instant) -> Self {
        Self {
            candidate: 0,
            until: now.offset(DWELL_US),
        }
    }

    /// The rate to listen at now, kbit/s.
    pub fn kbit_s(&self) -> u16 {
        CANDIDATES.get(self.candidate).copied().unwrap_or(250)
    }

    /// When the next candidate's turn comes.
    pub const fn until(&self) -> Instant {
        self.until
    }

    /// Goes on to the next candidate if it is time; true when the rate has changed.
    pub fn poll(&mut self, now: Instant) -> bool {
        if now < self.until {
            return false;
        }
        self.candidate += 1;
        if self.candidate == CANDIDATES.len() {
            self.candidate = 0;
        }
        self.until = now.offset(DWELL_US);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rate_gets_its_turn_and_then_again() {
        let mut search = Search::new(Instant(0));
        for rate in CANDIDATES.into_iter().chain(CANDIDATES) {
            assert_eq!(search.kbit_s(), rate);
            assert!(!search.poll(search.until().offset(-1)));
            assert!(search.poll(search.until()));
        }
    }
}
