//! Time of a source as a person reads it.
//!
//! In: seconds on the source's clock. Out: the time of day in UTC where they count from 1970,
//! else the seconds.
//!
//! Left out: dates and time zones.

/// A source whose time is younger than this counts from 1970: 1 January 1980, s.
const DATED_FROM_S: f64 = 315_532_800.0;

/// `12:34:56.7`, or `12.3 s` for a log whose time counts from its start.
pub fn clock(time_s: f64) -> String {
    if time_s < DATED_FROM_S {
        return format!("{time_s:.1} s");
    }
    let tenths = (time_s * 10.0).floor() as u64;
    let day_s = tenths / 10 % 86_400;
    let (hour, minute, second) = (day_s / 3600, day_s / 60 % 60, day_s % 60);
    format!("{hour:02}:{minute:02}:{second:02}.{}", tenths % 10)
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
