//! Time in microseconds out of a timer of 16 bits.
//!
//! In: the timer's count, how often it has overflowed, and whether an overflow has not been
//! counted yet. Out: an [`Instant`]. The timer counts at 1 MHz, so it overflows every 65.536 ms;
//! whoever asks has to be less than half of that late.

use tilt::sample::Instant;

/// Microseconds from one overflow to the next.
pub const ROUND_US: u64 = 1 << 16;

/// Joins a count with the overflows before it.
///
/// `pending` says that an overflow has happened that `overflows` does not hold. A small count was
/// then taken after it, a large one before.
pub const fn join(overflows: u32, pending: bool, count: u16) -> Instant {
    let late = pending && count < 0x8000;
    let rounds = overflows as u64 + late as u64;
    Instant(rounds * ROUND_US + count as u64)
}

/// What to compare the count with so that it matches at `at`: `None` while that is more than
/// a round ahead or already past at `now`.
pub fn compare(at: Instant, now: Instant) -> Option<u16> {
    let ahead = at.0.checked_sub(now.0).filter(|ahead| *ahead < ROUND_US)?;
    (ahead > 0).then_some(at.0 as u16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_on_either_side_of_an_overflow_gets_its_own_round() {
        assert_eq!(join(0, false, 7), Instant(7));
        assert_eq!(join(3, false, 0xFFFF), Instant(0x3_FFFF));
        // The overflow has come and nobody has counted it.
        assert_eq!(join(3, true, 2), Instant(0x4_0002));
        // The edge came before the overflow, the code after it.
        assert_eq!(join(3, true, 0xFFFE), Instant(0x3_FFFE));
    }

    #[test]
    fn what_is_past_or_a_round_away_is_not_compared_with() {
        let now = Instant(0x1_FFF0);
        assert_eq!(compare(Instant(0x1_FFF0), now), None);
        assert_eq!(compare(Instant(0x1_FFEF), now), None);
        assert_eq!(compare(Instant(0x2_0001), now), Some(1));
        assert_eq!(compare(Instant(0x2_FFEF), now), Some(0xFFEF));
        assert_eq!(compare(Instant(0x2_FFF0), now), None);
    }
}
