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

/// The earlier of two deadlines, where either may be missing.
// As with `Instant::after`.
#[cfg_attr(target_pointer_width = "32", inline(never))]
pub fn sooner(a: Option<Instant>, b: Option<Instant>) -> Option<Instant> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}
