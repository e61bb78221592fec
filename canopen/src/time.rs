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

/// When something is due, if ever.
///
/// It is kept turned over: all bytes are 0 where nothing is due, so that a service that does not
/// exist needs no picture in the program, and that reads as an instant that nobody lives to see.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Deadline(u64);

impl Deadline {
    /// Never.
    pub const NONE: Self = Self(0);

    /// At that instant.
    pub const fn at(at: Instant) -> Self {
        Self(!at.0)
    }

    /// In so many microseconds; never for 0, as the objects say that hold a period.
    pub const fn in_us(now: Instant, micros: u64) -> Self {
        if micros == 0 {
            return Self::NONE;
        }
        Self::at(now.after(micros))
    }

    /// In so many milliseconds; never for 0.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub const fn in_ms(now: Instant, millis: u32) -> Self {
        Self::in_us(now, millis as u64 * 1000)
    }

    /// The next one of a period, or a whole period from `now` on when that has passed; never for a
    /// period of 0. So late calls don't add up, and what was missed is not made up for.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn in_step(self, period_us: u64, now: Instant) -> Self {
        let next = Self::in_us(self.instant(), period_us);
        if next.is_due(now) {
            return Self::in_us(now, period_us);
        }
        next
    }

    /// True when there is one.
    pub const fn is_set(self) -> bool {
        self.0 != 0
    }

    /// True when it has come.
    pub const fn is_due(self, now: Instant) -> bool {
        !self.0 <= now.0
    }

    /// The instant; the end of the clock for never.
    pub const fn instant(self) -> Instant {
        Instant(!self.0)
    }

    /// The instant, if there is one.
    pub fn get(self) -> Option<Instant> {
        self.is_set().then_some(self.instant())
    }

    /// The earlier of the two from now on.
    #[inline]
    pub fn add(&mut self, other: Self) {
        self.0 = self.0.max(other.0);
    }
}
