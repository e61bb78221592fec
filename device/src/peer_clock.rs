//! How old what the peer says is: its clock against this one.
//!
//! In: at each exchange, the instant that the peer puts on it (in steps of 2 ms, the low byte)
//! and the instant of this node's own reading for the same SYNC. Out: whether the two belong to
//! one SYNC. The clocks run apart by some parts per million and have nothing else in common, so
//! what is between them is learned from the first exchange and followed, a step at a time.
//!
//! An exchange that has waited in the peer or on the bus past its SYNC shows an instant that is
//! older than it should be. Several in a row that seem to come from the future show that what was
//! learned first was late itself; it is learned anew. A single one belongs to a SYNC that this
//! node has missed.
//!
//! Left out: delays above 384 ms, which show as missing exchanges first.

use tilt::sample::Instant;

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

/// What an exchange's instant says.
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
    early: u8,
}

impl PeerClock {
    /// Nothing known.
    pub const fn new() -> Self {
        Self {
            apart: None,
            late: 0,
            early: 0,
        }
    }

    /// An exchange that says `captured`, where this node's own reading was made at `at`.
    pub fn hear(&mut self, captured: u8, at: Instant) -> Heard {
        let apart = low_steps(at).wrapping_sub(captured);
        let known = *self.apart.get_or_insert(apart);
        let behind = apart.wrapping_sub(known);
        if (LATE + 1..FUTURE).contains(&behind) {
            (self.late, self.early) = (self.late.saturating_add(1), 0);
            let late = self.late >= LATE_IN_A_ROW;
            return if late { Heard::Late } else { Heard::Other };
        }
        self.late = 0;
        if (FUTURE..u8::MAX - LATE).contains(&behind) {
            self.early = self.early.saturating_add(1);
            if self.early < EARLY_IN_A_ROW {
                return Heard::Other;
            }
            self.apart = Some(apart);
        }
        self.early = 0;
        self.apart = self.apart.map(|known| match behind {
            2..=LATE => known.wrapping_add(1),
            253 | 254 => known.wrapping_sub(1),
            _ => known,
        });
        Heard::InTime
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
            let late = (0..100_000).find(|&n| clock.hear(peer(n, ppm), own(n)) != Heard::InTime);
            assert_eq!(late, None, "{ppm}");
        }
    }

    #[test]
    fn one_exchange_of_an_earlier_sync_is_a_busy_bus_and_the_second_is_late() {
        for behind in [1, 3, 10, 18] {
            let mut clock = PeerClock::new();
            assert!((0..100).all(|n| clock.hear(peer(n, 50), own(n)) == Heard::InTime));
            let mut heard = |of, at| clock.hear(peer(of, 50), own(at));
            assert_eq!(heard(100 - behind, 100), Heard::Other);
            assert_eq!(heard(101 - behind, 101), Heard::Late);
            assert_eq!(heard(102 - behind, 102), Heard::Late, "as long as it lasts");
            assert_eq!(heard(103, 103), Heard::InTime);
        }
    }

    #[test]
    fn learning_from_a_late_one_is_put_right_by_the_first_in_time() {
        let mut clock = PeerClock::new();
        let mut heard = |of, at| clock.hear(peer(of, 0), own(at));
        assert_eq!(heard(0, 2), Heard::InTime);
        assert_eq!([heard(3, 3), heard(4, 4)], [Heard::Other; 2]);
        assert_eq!(heard(5, 5), Heard::InTime);
        assert_eq!(heard(5, 6), Heard::Other);
        assert_eq!(heard(6, 7), Heard::Late);
    }

    #[test]
    fn one_sync_missed_here_made_the_peer_late_for_ever() {
        let mut clock = PeerClock::new();
        let mut heard = |of, at| clock.hear(peer(of, 0), own(at));
        assert_eq!(heard(0, 0), Heard::InTime);
        assert_eq!(heard(2, 1), Heard::Other);
        assert_eq!(heard(3, 3), Heard::InTime);
        assert_eq!(heard(4, 4), Heard::InTime);
    }
}
