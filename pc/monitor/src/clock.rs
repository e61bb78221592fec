//! Time of a source as a person reads it.
//!
//! In: seconds on the source's clock. Out: the time of day in UTC where they count from 1970,
//! else the seconds.
//!
//! Left out: dates and time zones.

use bus_logs::{is_dated, utc};

/// `12:34:56.7`, or `12.3 s` for a log whose time counts from its start.
pub fn clock(time_s: f64) -> String {
    // To the microsecond, which such a number of seconds still has.
    let time_ns = (time_s * 1e6).round() as u64 * 1000;
    if !is_dated(time_ns) {
        return format!("{time_s:.1} s");
    }
    let of_day = utc(time_ns).format("%H:%M:%S");
    format!("{of_day}.{}", time_ns / 100_000_000 % 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dated_time_is_a_time_of_day_and_another_one_is_seconds() {
        assert_eq!(clock(1_700_000_000.16), "22:13:20.1");
        assert_eq!(clock(12.34), "12.3 s");
        assert_eq!(clock(0.0), "0.0 s");
    }
}
