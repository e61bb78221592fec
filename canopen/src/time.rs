//! The device's clock as the stack sees it: an argument, never a call.
//!
//! Left out: reading a clock. The caller hands in the time with every frame and every poll.

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

    /// Microseconds from `earlier` to `self`, 0 when `self` is the earlier one.
    pub const fn since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }
}

/// The earliest of deadlines that may be missing.
///
/// It holds an instant that nobody lives to see instead of none: most deadlines are missing, and
/// those are then passed over at once.
#[derive(Clone, Copy, Debug)]
pub struct Earliest(Instant);

impl Earliest {
    /// No deadline so far.
    pub const NONE: Self = Self(Instant(u64::MAX));

    /// Takes a deadline into account.
    #[inline]
    pub fn add(&mut self, at: Option<Instant>) {
        if let Some(at) = at
            && at < self.0
        {
            self.0 = at;
        }
    }

    /// The earliest, if there was any.
    #[inline]
    pub fn get(self) -> Option<Instant> {
        (self.0 < Self::NONE.0).then_some(self.0)
    }
}
