//! When the next frame of a log is due.
//!
//! In: the time of each frame in the log, and how fast it is to go by. Out: the instant at which
//! the frame is due, counted from the start and never from the frame before: what one frame is
//! late the next one is not. Time that goes backwards stands still.

use std::time::{Duration, Instant};

/// How fast, as a person writes it: `10`, `0.5x`, or `max`.
///
/// Errors: a sentence that states how to write it.
pub fn speed(text: &str) -> Result<f64, String> {
    if text == "max" {
        return Ok(f64::INFINITY);
    }
    let number = text.trim_end_matches('x').parse::<f64>().ok();
    let number = number.filter(|times| (0.001..=1e6).contains(times));
    number.ok_or_else(|| "0.001 to 1000000 times, or max".to_owned())
}

/// The value of `--skip-gaps` without one, as [`gap`] reads it, s.
pub const LONGEST_GAP_S: &str = "2";

/// The length, in s, to which longer gaps are shortened: `0.5`.
///
/// Errors: a sentence that states how to write it.
pub fn gap(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok();
    let length = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    length.ok_or_else(|| "give a number of seconds, such as 0.5".to_owned())
}

/// How fast a log goes by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaceOptions {
    /// Times as fast as it was; infinite for as fast as can be.
    pub speed: f64,
    /// The longest gap between two frames, in the log's time; longer ones are shortened to it.
    pub longest_gap: Option<Duration>,
}

impl Default for PaceOptions {
    fn default() -> Self {
        Self {
            speed: 1.0,
            longest_gap: None,
        }
    }
}

/// Absolute deadlines.
#[derive(Clone, Debug)]
pub struct Pace {
    options: PaceOptions,
    /// When the first frame was given, in the host's time and in the log's.
    start: Option<Instant>,
    last_ns: u64,
    /// How far the log has come since its first frame, gaps shortened.
    passed_ns: u64,
}

impl Pace {
    /// Begins with the first frame.
    pub const fn new(options: PaceOptions) -> Self {
        Self {
            options,
            start: None,
            last_ns: 0,
            passed_ns: 0,
        }
    }

    /// When a frame of this time is due; `now` counts for the first one only.
    pub fn due(&mut self, time_ns: u64, now: Instant) -> Instant {
        let Some(start) = self.start else {
            self.start = Some(now);
            self.last_ns = time_ns;
            return now;
        };
        let gap_ns = time_ns.saturating_sub(self.last_ns);
        let longest_ns = self.options.longest_gap.map_or(u64::MAX, as_ns);
        self.passed_ns = self.passed_ns.saturating_add(gap_ns.min(longest_ns));
        // Where time goes backwards, the log goes on from there: its gap is none.
        self.last_ns = time_ns;
        let passed_s = self.passed_ns as f64 / 1e9 / self.options.speed;
        let passed = Duration::try_from_secs_f64(passed_s).unwrap_or(Duration::MAX);
        start.checked_add(passed).unwrap_or(start)
    }

    /// The log stands still for this long, as when somebody pauses it.
    pub fn pause(&mut self, held: Duration) {
        self.start = self.start.and_then(|start| start.checked_add(held));
    }
}

fn as_ns(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_speed_is_a_number_or_max() {
        assert_eq!(speed("10"), Ok(10.0));
        assert_eq!(speed("0.5x"), Ok(0.5));
        assert_eq!(speed("max"), Ok(f64::INFINITY));
        for wrong in ["0", "-1", "fast", "NaN", "inf", ""] {
            assert!(speed(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_gap_is_a_number_of_seconds() {
        assert_eq!(gap("0.5"), Ok(Duration::from_millis(500)));
        assert_eq!(gap(LONGEST_GAP_S), Ok(Duration::from_secs(2)));
        for wrong in ["-1", "NaN", "inf", "", "2s"] {
            assert!(gap(wrong).is_err(), "{wrong}");
        }
    }

    fn dues(options: PaceOptions, times_ms: &[u64]) -> Vec<u64> {
        let start = Instant::now();
        let mut pace = Pace::new(options);
        let due = times_ms.iter().map(|ms| pace.due(ms * 1_000_000, start));
        due.map(|due| due.duration_since(start).as_millis() as u64)
            .collect()
    }

    #[test]
    fn a_frame_is_due_by_the_time_since_the_first_one() {
        let plain = PaceOptions::default();
        assert_eq!(dues(plain, &[500, 510, 530, 1500]), [0, 10, 30, 1000]);
        let fast = PaceOptions {
            speed: 10.0,
            ..plain
        };
        assert_eq!(dues(fast, &[500, 600, 1500]), [0, 10, 100]);
        let slow = PaceOptions {
            speed: 0.5,
            ..plain
        };
        assert_eq!(dues(slow, &[500, 600]), [0, 200]);
        let at_once = PaceOptions {
            speed: f64::INFINITY,
            ..plain
        };
        assert_eq!(dues(at_once, &[500, 600, 90_000]), [0, 0, 0]);
    }

    #[test]
    fn gaps_are_shortened_and_time_never_goes_back() {
        let options = PaceOptions {
            longest_gap: Some(Duration::from_millis(100)),
            ..PaceOptions::default()
        };
        assert_eq!(dues(options, &[0, 50, 90_000, 90_010]), [0, 50, 150, 160]);
        let plain = PaceOptions::default();
        assert_eq!(dues(plain, &[1000, 1010, 200, 220]), [0, 10, 10, 30]);
    }

    #[test]
    fn a_pause_moves_all_that_follows() {
        let start = Instant::now();
        let mut pace = Pace::new(PaceOptions::default());
        pace.due(0, start);
        pace.pause(Duration::from_millis(40));
        let due = pace.due(10_000_000, start);
        assert_eq!(due.duration_since(start).as_millis(), 50);
    }
}
