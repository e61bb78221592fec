//! Cycles of the core and time of the world.
//!
//! In: the frequency of HCLK, which changes, and the crystal's error. Out: ns of the world at a
//! cycle, and back. Left out: jitter.

/// A ns in the units of this module.
const NS: u128 = 1 << 32;

/// The map between the two.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    /// What the crystal and the internal oscillator make of a second, 1 for exact.
    rate: f64,
    base_cycle: u64,
    base: u128,
    period: u128,
}

impl Clock {
    /// Cycle 0 at `start_ns`, `hz` cycles in a second of an oscillator that is `rate` times as
    /// fast as it should be.
    pub fn new(start_ns: u64, hz: u32, rate: f64) -> Self {
        Self {
            rate,
            base_cycle: 0,
            base: u128::from(start_ns) * NS,
            period: period(hz, rate),
        }
    }

    /// From `cycle` on there are `hz` cycles in a second.
    pub fn set_hz(&mut self, cycle: u64, hz: u32) {
        self.base = self.at(cycle);
        self.base_cycle = cycle;
        self.period = period(hz, self.rate);
    }

    fn at(&self, cycle: u64) -> u128 {
        self.base + u128::from(cycle.saturating_sub(self.base_cycle)) * self.period
    }

    /// When a cycle begins, ns, rounded up.
    pub fn ns(&self, cycle: u64) -> u64 {
        self.at(cycle).div_ceil(NS) as u64
    }

    /// Whether `ns` has come at `cycle`, as [`Clock::cycle`] has it, but without its division.
    pub fn has_come(&self, ns: u64, cycle: u64) -> bool {
        cycle >= self.base_cycle && u128::from(ns) * NS <= self.at(cycle)
    }

    /// The first cycle that begins at `ns` or later.
    pub fn cycle(&self, ns: u64) -> u64 {
        let Some(after) = (u128::from(ns) * NS).checked_sub(self.base) else {
            return self.base_cycle;
        };
        let cycles = after.div_ceil(self.period);
        self.base_cycle
            .saturating_add(u64::try_from(cycles).unwrap_or(u64::MAX))
    }
}

fn period(hz: u32, rate: f64) -> u128 {
    ((NS as f64) * 1e9 / (f64::from(hz.max(1)) * rate)).round() as u128
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cycle_is_found_again_at_its_own_time() {
        let mut clock = Clock::new(1_000, 8_000_000, 1.0);
        assert_eq!(clock.ns(8), 2_000);
        clock.set_hz(8, 72_000_000);
        assert!(clock.ns(8 + 72_000_000).abs_diff(1_000_002_000) <= 1);
        for cycle in [8, 9, 1_000_003, 72_000_000] {
            // A time is whole ns, so it may lie behind the cycle's begin.
            let found = clock.cycle(clock.ns(cycle));
            assert!((cycle..=cycle + 1).contains(&found), "{cycle} {found}");
        }
        assert_eq!(clock.cycle(0), 8);
        for ns in [0, 1_999, 2_000, 2_013, 2_014, 2_015, 1_000_000_000] {
            let first = clock.cycle(ns);
            assert!(clock.has_come(ns, first) && !clock.has_come(ns, first - 1));
        }
    }

    #[test]
    fn a_fast_crystal_counts_more() {
        let clock = Clock::new(0, 72_000_000, 1.0 + 50e-6);
        assert_eq!(clock.cycle(1_000_000_000), 72_003_600);
    }
}
