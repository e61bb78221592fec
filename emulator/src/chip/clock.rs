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
    /// How often the frequency was set.
    settings: u32,
}

/// A time of the world with its cycle, which is looked at much more often than it changes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known {
    ns: u64,
    cycle: u64,
    /// The setting of the clock that it belongs to; 0 for none.
    setting: u32,
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
            settings: 1,
        }
    }

    /// From `cycle` on there are `hz` cycles in a second.
    pub fn set_hz(&mut self, cycle: u64, hz: u32) {
        self.base = self.at(cycle);
        self.base_cycle = cycle;
        self.period = period(hz, self.rate);
        self.settings += 1;
    }

    fn at(&self, cycle: u64) -> u128 {
        self.base + u128::from(cycle.saturating_sub(self.base_cycle)) * self.period
    }

    /// When a cycle begins, ns, rounded up.
    pub fn ns(&self, cycle: u64) -> u64 {
        self.at(cycle).div_ceil(NS) as u64
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

    /// The same without its division where `known` is of this time, as it then is.
    #[inline]
    pub fn cycle_known(&self, ns: u64, known: &mut Known) -> u64 {
        if (known.ns, known.setting) != (ns, self.settings) {
            *known = Known {
                ns,
                cycle: self.cycle(ns),
                setting: self.settings,
            };
        }
        known.cycle
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
            assert!(clock.ns(first) >= ns && (first == 8 || clock.ns(first - 1) <= ns));
        }
    }

    #[test]
    fn a_known_cycle_is_found_anew_when_time_or_frequency_has_changed() {
        let mut clock = Clock::new(0, 8_000_000, 1.0);
        let mut known = Known::default();
        for ns in [0, 1_000, 1_000, 5_000] {
            assert_eq!(clock.cycle_known(ns, &mut known), clock.cycle(ns));
        }
        clock.set_hz(8, 72_000_000);
        assert_eq!(clock.cycle_known(5_000, &mut known), clock.cycle(5_000));
        assert_eq!(clock.cycle(5_000), 8 + 4 * 72);
    }

    #[test]
    fn a_fast_crystal_counts_more() {
        let clock = Clock::new(0, 72_000_000, 1.0 + 50e-6);
        assert_eq!(clock.cycle(1_000_000_000), 72_003_600);
    }
}
