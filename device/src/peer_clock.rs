//! How old what the peer sends is: its clock against this one.
//!
//! In: at each exchange, the instant that the peer puts on it (in steps of 2 ms, the low byte),
//! the instant of this node's own reading for the same SYNC, and whether the peer calls itself
//! sound. Out: whether the two belong to one SYNC. The clocks run apart by some parts per million
//! and have nothing else in common, so what is between them is learned from the first exchange and
//! followed, a step at a time.
//!
//! An exchange that has waited in the peer or on the bus past its SYNC shows an instant that is
//! older than it should be. What was learned may itself be wrong, and is learned anew:
//!
//! - Several in a row that seem to come from the future, all from as far, show that the first was
//!   late. A single one belongs to a SYNC that this node has missed.
//! - Many in a row that are all as late, of a peer that finds nothing wrong with its own sending,
//!   show that what was learned on a flooded bus was wrong: after 384 ms the low byte has come
//!   round, and the past looks like the future.
//!
//! Left out: delays above 384 ms, which show as missing exchanges first.

use instant::Instant;

/// One step of an exchange's instant, us.
pub const STEP_US: u64 = 2000;

/// An exchange that is older than its SYNC by more steps than this is late. Rounding takes one
/// step and what is learned may be one step off.
const LATE: u8 = 2;

/// From here on the low byte stands for the future: 64 steps of it, beside 192 of the past.
const FUTURE: u8 = 192;

/// Late exchanges in a row that make the peer late: one may have met a busy bus.
const LATE_IN_A_ROW: u8 = 2;

/// Exchanges in a row from the future that prove what was learned wrong.
const EARLY_IN_A_ROW: u8 = 3;

/// Exchanges in a row that are late by the same and prove the same. A peer that sends late finds
/// it within four SYNCs, and reports it.
const SAME_IN_A_ROW: u8 = 64;

/// What an exchange's instant shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heard {
    /// It belongs to the SYNC that it came for.
    InTime,
    /// It belongs to another one, which may be the bus's fault.
    Other,
    /// Once more: the peer is late.
    Late,
}

/// What is known of the peer's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PeerClock {
    /// This clock minus the peer's in steps, the low byte.
    apart: Option<u8>,
    late: u8,
    /// What the last exchanges show instead, and how many of them in a row.
    instead: u8,
    same: u8,
}

impl PeerClock {
    /// Nothing known.
    pub const fn new() -> Self {
        Self {
            apart: None,
            late: 0,
            instead: 0,
            same: 0,
        }
    }

    /// An exchange that carries `captured`, where this node's own reading was made at `at`; `sound`
    /// when the peer reports nothing against itself.
    pub fn hear(&mut self, captured: u8, at: Instant, sound: bool) -> Heard {
        let apart = low_steps(at).wrapping_sub(captured);
        let known = *self.apart.get_or_insert(apart);
        let behind = apart.wrapping_sub(known);
        if (LATE + 1..u8::MAX - LATE).contains(&behind) {
            return self.differ(apart, behind >= FUTURE, sound);
        }
        (self.late, self.same) = (0, 0);
        self.apart = Some(match behind {
            2..=LATE => known.wrapping_add(1),
            253 | 254 => known.wrapping_sub(1),
            _ => known,
        });
        Heard::InTime
    }

    /// An exchange that belongs to another SYNC by what is known.
    fn differ(&mut self, apart: u8, early: bool, sound: bool) -> Heard {
        let is_same = apart.wrapping_sub(self.instead).wrapping_add(1) <= 2;
        self.same = if !sound {
            0
        } else if is_same {
            self.same.saturating_add(1)
        } else {
            1
        };
        self.instead = apart;
        self.late = if early {
            0
        } else {
            self.late.saturating_add(1)
        };
        let proof = if early { EARLY_IN_A_ROW } else { SAME_IN_A_ROW };
        if self.same >= proof {
            (self.late, self.same) = (0, 0);
            self.apart = Some(apart);
            return Heard::InTime;
        }
        if self.late >= LATE_IN_A_ROW {
            Heard::Late
        } else {
            Heard::Other
        }
    }
}

/// The instant in steps, the low byte: what goes into an exchange.
pub const fn low_steps(at: Instant) -> u8 {
    (at.0 / STEP_US) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1000;

    /// SYNCs 20 ms apart on this clock; the peer's runs 30 ms ahead and `ppm` faster.
    fn peer(n: u64, ppm: u64) -> u8 {
        low_steps(Instant(30 * MS + n * 20 * (1_000_000 + ppm) / 1000))
    }

    fn own(n: u64) -> Instant {
        Instant(n * 20 * MS)
    }

    #[test]
    fn a_peer_in_time_is_never_late_whatever_its_crystal() {
        for ppm in [0, 100, 400] {
            let mut clock = PeerClock::new();
            let late =
                (0..100_000).find(|&n| clock.hear(peer(n, ppm), own(n), true) != Heard::InTime);
            assert_eq!(late, None, "{ppm}");
        }
    }

    #[test]
    fn one_exchange_of_an_earlier_sync_is_a_busy_bus_and_the_second_is_late() {
        for behind in [1, 3, 10, 18] {
            let mut clock = PeerClock::new();
            assert!((0..100).all(|n| clock.hear(peer(n, 50), own(n), true) == Heard::InTime));
            let mut heard = |of, at| clock.hear(peer(of, 50), own(at), true);
            assert_eq!(heard(100 - behind, 100), Heard::Other);
            assert_eq!(heard(101 - behind, 101), Heard::Late);
            assert_eq!(heard(102 - behind, 102), Heard::Late, "as long as it lasts");
            assert_eq!(heard(103, 103), Heard::InTime);
        }
    }

    #[test]
    fn learning_from_a_late_one_is_put_right_by_the_first_in_time() {
        let mut clock = PeerClock::new();
        let mut heard = |of, at| clock.hear(peer(of, 0), own(at), true);
        assert_eq!(heard(0, 2), Heard::InTime);
        assert_eq!([heard(3, 3), heard(4, 4)], [Heard::Other; 2]);
        assert_eq!(heard(5, 5), Heard::InTime);
        assert_eq!(heard(5, 6), Heard::Other);
        assert_eq!(heard(6, 7), Heard::Late);
    }

    #[test]
    fn one_sync_missed_here_made_the_peer_late_for_ever() {
        let mut clock = PeerClock::new();
        let mut heard = |of, at| clock.hear(peer(of, 0), own(at), true);
        assert_eq!(heard(0, 0), Heard::InTime);
        assert_eq!(heard(2, 1), Heard::Other);
        assert_eq!(heard(3, 3), Heard::InTime);
        assert_eq!(heard(4, 4), Heard::InTime);
    }

    #[test]
    fn what_was_learned_on_a_flooded_bus_made_the_peer_late_for_ever() {
        let mut clock = PeerClock::new();
        let mut heard = |of, at| clock.hear(peer(of, 0), own(at), true);
        assert_eq!(heard(0, 0), Heard::InTime);
        // Three that are 420 ms old seem to be 92 ms ahead.
        assert_eq!([heard(9, 30), heard(10, 31)], [Heard::Other; 2]);
        assert_eq!(heard(11, 32), Heard::InTime, "which is wrong");
        assert_eq!([heard(33, 33), heard(34, 34)], [Heard::Other, Heard::Late]);
        let again = (35..200).find(|&n| heard(n, n) == Heard::InTime);
        assert_eq!(again, Some(33 + u64::from(SAME_IN_A_ROW) - 1));
    }

    #[test]
    fn a_peer_that_calls_itself_late_is_late_as_long_as_it_reports_it() {
        let mut clock = PeerClock::new();
        assert_eq!(clock.hear(peer(0, 0), own(0), true), Heard::InTime);
        let mut late = (4..1000).map(|n| clock.hear(peer(n - 3, 0), own(n), false));
        assert_eq!(late.next(), Some(Heard::Other));
        assert!(late.all(|heard| heard == Heard::Late));
    }
}
