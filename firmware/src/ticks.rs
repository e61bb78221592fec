//! Time in microseconds out of a timer of 16 bits.
//!
//! In: the timer's count, how often it has overflowed, and whether an overflow has not been
//! counted yet. Out: an [`Instant`]. The timer counts at 1 MHz, so it overflows every 65.536 ms.
//!
//! While a page is erased nobody counts overflows: 40 ms at most (data sheet of the
//! STM32F103xC/D/E, 5.3.9). An overflow may be counted up to [`LATEST_US`] late; whoever comes
//! later is a round behind.

use instant::Instant;

/// Microseconds from one overflow to the next.
pub const ROUND_US: u64 = 1 << 16;

/// How late an overflow is counted at most, us: half as much again as the longest erase. The rest
/// of a round is for what lies between the two looks of [`join`].
pub const LATEST_US: u16 = 60_000;

/// Joins a count with the overflows before it.
///
/// `pending` is asked for right after the count, and shows that an overflow has happened that
/// `overflows` does not hold. Up to [`LATEST_US`] the count was taken after that one. A larger one
/// was taken before it: it came between the two looks.
pub const fn join(overflows: u32, pending: bool, count: u16) -> Instant {
    let late = pending && count <= LATEST_US;
    let rounds = overflows as u64 + late as u64;
    Instant(rounds * ROUND_US + count as u64)
}

/// The time of an edge that was captured at this count, less than a round before `now`.
pub const fn captured(count: u16, now: Instant) -> Instant {
    let age = (now.0 as u16).wrapping_sub(count);
    Instant(now.0.saturating_sub(age as u64))
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
        // It came between the look at the count and that at the flag.
        assert_eq!(join(3, true, 0xFFFE), Instant(0x3_FFFE));
    }

    /// At every count of the timer an erase of 20 to 40 ms begins, with an edge at its begin, in
    /// its middle or at its end; then the overflow, if there was one, is not counted yet.
    #[test]
    fn what_came_in_a_long_erase_was_misdated_by_a_round() {
        let round = 7 * ROUND_US;
        for begin in round..round + ROUND_US {
            for length in (20_000..=40_000).step_by(500) {
                let end = begin + length;
                let pending = end / ROUND_US > 7;
                let now = join(7, pending, end as u16);
                assert_eq!(now, Instant(end), "{begin} for {length} us");
                for edge in [begin, begin + length / 2, end] {
                    let at = captured(edge as u16, now);
                    assert_eq!(at, Instant(edge), "{begin} for {length} us");
                }
            }
        }
    }

    #[test]
    fn an_edge_keeps_its_time_on_either_side_of_an_overflow() {
        let now = Instant(0x4_0002);
        assert_eq!(captured(2, now), now);
        assert_eq!(captured(0xFFFE, now), Instant(0x3_FFFE));
        assert_eq!(captured(3, now), Instant(0x3_0003));
        // Before the first overflow there was nothing.
        assert_eq!(captured(9, Instant(8)), Instant(0));
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
