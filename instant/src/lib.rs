//! The device's own clock: the one type for time, an argument wherever it is used.
//!
//! In: microseconds since the reset. Out: later and earlier instants, and the time between two.
//! Left out: reading a clock, which the caller does; deadlines, which are the stack's
//! (`canopen::time`).

#![no_std]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

/// A reading of the device's own clock, in microseconds since its reset.
///
/// It does not wrap within the life of a machine (584 000 years).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Instant(pub u64);

impl Instant {
    /// The instant `micros` later, stopping at the end of the clock.
    // A call is a third of the code on a 32-bit part, and there are dozens.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub const fn after(self, micros: u64) -> Self {
        Self(self.0.saturating_add(micros))
    }

    /// The instant `millis` later, stopping at the end of the clock.
    pub const fn after_ms(self, millis: u32) -> Self {
        self.after(millis as u64 * 1000)
    }

    /// The instant `micros` later (earlier when negative), stopping at the ends of the clock.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub const fn offset(self, micros: i64) -> Self {
        Self(self.0.saturating_add_signed(micros))
    }

    /// Microseconds from `earlier` to `self`, 0 when `self` is the earlier one.
    pub const fn since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }

    /// Microseconds from `earlier` to `self`; negative when `self` is the earlier one.
    pub const fn micros_since(self, earlier: Self) -> i64 {
        self.0.wrapping_sub(earlier.0) as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_stop_at_the_ends_of_the_clock() {
        let last = Instant(u64::MAX);
        assert_eq!(last.after(1), last);
        assert_eq!(last.after_ms(u32::MAX), last);
        assert_eq!(last.offset(i64::MAX), last);
        assert_eq!(Instant(3).offset(-5), Instant(0));
        assert_eq!(Instant(3).offset(-2), Instant(1));
        assert_eq!(Instant(3).after_ms(2), Instant(2003));
    }

    #[test]
    fn the_time_between_two_has_a_sign_where_it_is_asked_for() {
        let (early, late) = (Instant(10), Instant(25));
        assert_eq!((late.since(early), early.since(late)), (15, 0));
        let both = (late.micros_since(early), early.micros_since(late));
        assert_eq!(both, (15, -15));
        assert_eq!(Instant(0).micros_since(Instant(u64::MAX)), 1);
    }
}
