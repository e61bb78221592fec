//! Virtual time against the machine's own.
//!
//! In: the machine's time. Out: the virtual time that it stands for, and how long to wait for
//! another one. Both are counted from one anchor, so that nothing adds up; a machine that can't
//! keep up gets a new anchor instead of ever more to do.
//!
//! Left out: waiting itself.

use std::str::FromStr;
use std::time::{Duration, Instant};

/// How much of virtual time is run in one go, ns.
const SLICE_NS: u64 = 5_000_000;

/// A lag that is given up instead of made good, of the machine's time.
const LAG: Duration = Duration::from_millis(250);

/// How fast virtual time goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// So many times as fast as the machine's.
    Times(f64),
    /// As fast as the machine can.
    Max,
}

impl FromStr for Speed {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "real" => return Ok(Self::Times(1.0)),
            "max" => return Ok(Self::Max),
            _ => {}
        }
        let factor = text.parse().ok();
        let factor = factor.filter(|f: &f64| (0.001..=1000.0).contains(f));
        factor
            .map(Self::Times)
            .ok_or_else(|| "take real, max, or a factor from 0.001 to 1000".to_owned())
    }
}

/// The pace of one run.
#[derive(Debug)]
pub struct Pace {
    /// How fast virtual time goes.
    pub speed: Speed,
    anchor: Instant,
    anchor_ns: u64,
}

impl Pace {
    /// Virtual time is `now_ns` at `now`.
    pub fn new(speed: Speed, now: Instant, now_ns: u64) -> Self {
        Self {
            speed,
            anchor: now,
            anchor_ns: now_ns,
        }
    }

    /// Up to where to run from virtual `at_ns`, at `now`: one slice at most. True when the
    /// machine is so late that the lag has just been given up.
    pub fn target(&mut self, now: Instant, at_ns: u64) -> (u64, bool) {
        let Speed::Times(factor) = self.speed else {
            return (at_ns + SLICE_NS, false);
        };
        let passed = now.saturating_duration_since(self.anchor);
        let ideal_ns = self.anchor_ns + (passed.as_nanos() as f64 * factor) as u64;
        let lag_ns = ideal_ns.saturating_sub(at_ns);
        let late = lag_ns as f64 / factor > LAG.as_nanos() as f64;
        if late {
            self.anchor = now;
            self.anchor_ns = at_ns;
            return (at_ns, true);
        }
        (ideal_ns.min(at_ns + SLICE_NS).max(at_ns), false)
    }

    /// How long the machine has to wait at `now` for virtual `at_ns`.
    pub fn wait(&self, now: Instant, at_ns: u64) -> Duration {
        let Speed::Times(factor) = self.speed else {
            return Duration::ZERO;
        };
        let ahead_ns = at_ns.saturating_sub(self.anchor_ns) as f64 / factor;
        let due = self.anchor + Duration::from_nanos(ahead_ns as u64);
        due.saturating_duration_since(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn virtual_time_follows_the_factor_from_one_anchor() {
        let start = Instant::now();
        let mut pace = Pace::new(Speed::Times(2.0), start, 1000);
        assert_eq!(pace.target(start + MS, 1000), (2_001_000, false));
        assert_eq!(pace.wait(start, 2_001_000), MS);
        assert_eq!(pace.wait(start + 3 * MS, 2_001_000), Duration::ZERO);
    }

    #[test]
    fn a_small_lag_is_made_good_slice_by_slice() {
        let start = Instant::now();
        let mut pace = Pace::new(Speed::Times(1.0), start, 0);
        let now = start + 12 * MS;
        assert_eq!(pace.target(now, 0), (5_000_000, false));
        assert_eq!(pace.target(now, 5_000_000), (10_000_000, false));
        assert_eq!(pace.target(now, 10_000_000), (12_000_000, false));
    }

    #[test]
    fn a_great_lag_is_given_up_once() {
        let start = Instant::now();
        let mut pace = Pace::new(Speed::Times(1.0), start, 0);
        let now = start + 300 * MS;
        assert_eq!(pace.target(now, 0), (0, true));
        assert_eq!(pace.target(now + MS, 0), (1_000_000, false));
    }

    #[test]
    fn as_fast_as_possible_never_waits() {
        let start = Instant::now();
        let mut pace = Pace::new(Speed::Max, start, 0);
        assert_eq!(pace.target(start, 7), (SLICE_NS + 7, false));
        assert_eq!(pace.wait(start, u64::MAX), Duration::ZERO);
    }

    #[test]
    fn speeds_are_read_and_others_refused() {
        assert_eq!("real".parse(), Ok(Speed::Times(1.0)));
        assert_eq!("max".parse(), Ok(Speed::Max));
        assert_eq!("0.5".parse(), Ok(Speed::Times(0.5)));
        for text in ["0", "-1", "nan", "fast", "1e9"] {
            assert!(text.parse::<Speed>().is_err(), "{text}");
        }
    }
}
