//! How often something comes, and whether it is late.
//!
//! In: the times at which it came. Out: after what age it counts as stopped: a multiple of the
//! interval that it had, within bounds. Supervision begins with the first one (CiA 301, 7.5.2.19).
//!
//! Left out: what follows from it.

/// Times of one sort of message.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pace {
    last_ns: Option<u64>,
    interval_ns: Option<u64>,
    /// Whether it has been found stopped and not come since.
    pub stopped: bool,
}

/// How long a silence may be.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// Intervals.
    pub intervals: u64,
    /// Not less than this, ns.
    pub least_ns: u64,
    /// Nor more than this, ns.
    pub most_ns: u64,
    /// While the interval is not known, ns.
    pub unknown_ns: u64,
}

impl Pace {
    /// One has come. The interval of the one after a stop shows nothing of the pace, unless
    /// nothing else does.
    pub fn take(&mut self, time_ns: u64) {
        if let Some(last) = self.last_ns
            && (!self.stopped || self.interval_ns.is_none())
        {
            self.interval_ns = Some(time_ns.saturating_sub(last));
        }
        self.last_ns = Some(time_ns);
        self.stopped = false;
    }

    /// Time from one to the next, as it was last.
    pub const fn interval_ns(&self) -> Option<u64> {
        self.interval_ns
    }

    /// Forgets the time, not that there was one, for a source whose time has jumped back.
    pub fn restart(&mut self, time_ns: u64) {
        if self.last_ns.is_some() {
            self.last_ns = Some(time_ns);
        }
    }

    /// Since when it is overdue; `None` while it is not, before the first, and once it was told.
    pub fn overdue_ns(&self, now_ns: u64, patience: Patience) -> Option<u64> {
        let last = self.last_ns.filter(|_| !self.stopped)?;
        let age = now_ns.saturating_sub(last);
        (age > patience.limit_ns(self.interval_ns)).then_some(age)
    }
}

impl Patience {
    /// The age at which something with this interval counts as stopped.
    pub fn limit_ns(self, interval_ns: Option<u64>) -> u64 {
        interval_ns.map_or(self.unknown_ns, |ns| {
            let wanted = ns.saturating_mul(self.intervals);
            wanted.clamp(self.least_ns, self.most_ns)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const PATIENCE: Patience = Patience {
        intervals: 3,
        least_ns: 500 * MS,
        most_ns: 10_000 * MS,
        unknown_ns: 5000 * MS,
    };

    #[test]
    fn before_the_first_nothing_is_overdue() {
        let pace = Pace::default();
        assert_eq!(pace.overdue_ns(u64::MAX, PATIENCE), None);
    }

    #[test]
    fn three_intervals_without_one_are_a_stop_that_is_told_once() {
        let mut pace = Pace::default();
        for time in 0..5 {
            pace.take(time * 1000 * MS);
        }
        assert_eq!(pace.overdue_ns(7000 * MS, PATIENCE), None);
        assert_eq!(pace.overdue_ns(7001 * MS, PATIENCE), Some(3001 * MS));
        pace.stopped = true;
        assert_eq!(pace.overdue_ns(9000 * MS, PATIENCE), None);
        pace.take(60_000 * MS);
        assert_eq!(pace.interval_ns(), Some(1000 * MS));
        assert_eq!(pace.overdue_ns(62_000 * MS, PATIENCE), None);
    }

    #[test]
    fn fast_ones_get_the_least_time_and_slow_ones_the_most() {
        assert_eq!(PATIENCE.limit_ns(Some(MS)), 500 * MS);
        assert_eq!(PATIENCE.limit_ns(None), 5_000 * MS);
        assert_eq!(PATIENCE.limit_ns(Some(u64::MAX)), 10_000 * MS);
    }

    #[test]
    fn a_heartbeat_slower_than_the_first_patience_was_lost_for_ever() {
        let mut pace = Pace::default();
        pace.take(0);
        assert!(pace.overdue_ns(6000 * MS, PATIENCE).is_some());
        pace.stopped = true;
        pace.take(8000 * MS);
        assert_eq!(pace.overdue_ns(16_000 * MS, PATIENCE), None);
    }
}
