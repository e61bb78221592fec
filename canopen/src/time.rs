//! The device's clock as the stack sees it: an argument, never a call.
//!
//! Left out: reading a clock. The caller hands in the time with every frame and every poll.

use instant::Instant;

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

    /// In so many microseconds; never for 0, as defined for the objects that hold a period.
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
