//! How long something takes, by the time that the processor has given to this thread.
//!
//! In: nothing. Out: s since the start. What else the machine does meanwhile counts little so:
//! other programs take the time of the clock on the wall, but not this one.
//!
//! Source: `/proc/thread-self/schedstat` of Linux, whose first number is the time on a processor in
//! ns. Left out: other systems have no such file, and there the clock on the wall is taken.

use std::fs;
use std::time::{Duration, Instant};

/// A watch that runs.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch {
    processor: Option<Duration>,
    wall: Instant,
}

impl Stopwatch {
    /// Starts.
    pub fn start() -> Self {
        Self {
            processor: processor(),
            wall: Instant::now(),
        }
    }

    /// Time since the start, s, above 0.
    pub fn seconds(&self) -> f64 {
        let passed = match (self.processor, processor()) {
            (Some(then), Some(now)) => now.saturating_sub(then),
            _ => self.wall.elapsed(),
        };
        passed.max(Duration::from_nanos(1)).as_secs_f64()
    }
}

/// What this thread has had of a processor so far.
fn processor() -> Option<Duration> {
    let text = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let ns = text.split_whitespace().next()?.parse().ok()?;
    Some(Duration::from_nanos(ns))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_takes_time_and_no_more_than_the_wall_has_seen() {
        let (watch, wall) = (Stopwatch::start(), Instant::now());
        let mut sum = 0u64;
        // Until it has seen some work: a busy machine may give the time of the wall to others.
        while watch.seconds() < 2e-3 && wall.elapsed() < Duration::from_secs(60) {
            sum = std::hint::black_box(sum + 1);
        }
        let taken = watch.seconds();
        assert!(taken >= 2e-3, "{taken}");
        assert!(taken <= wall.elapsed().as_secs_f64() + 0.01, "{taken}");
    }
}
