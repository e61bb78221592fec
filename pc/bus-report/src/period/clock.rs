//! Instants of a log in words.
//!
//! In: ns since 1970 (UTC), or since the log began where its times are too small for that. Out:
//! text and days for people. The time zone of the log or of this machine plays no part: all is UTC.

use bus_logs::{is_dated, utc};

/// A second in ns.
const S: u64 = 1_000_000_000;

/// A day in s.
const DAY_S: u64 = 86_400;

/// What the times of a log count from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// 1970, in UTC.
    Utc,
    /// The start of the log, or of the machine that wrote it.
    Relative,
}

impl Clock {
    /// The clock of a log whose first frame has this time.
    pub const fn of(first_ns: u64) -> Self {
        if is_dated(first_ns) {
            Self::Utc
        } else {
            Self::Relative
        }
    }

    /// An instant to the millisecond.
    pub fn text(self, time_ns: u64) -> String {
        let of_day = utc(time_ns).format("%H:%M:%S%.3f");
        match (self, time_ns / S / DAY_S) {
            (Self::Utc, day) => format!("{} {of_day}", date(day)),
            (Self::Relative, 0) => of_day.to_string(),
            (Self::Relative, day) => format!("{day} d {of_day}"),
        }
    }

    /// A day by its number since time 0.
    pub fn day(self, number: u64) -> String {
        match self {
            Self::Utc => date(number),
            Self::Relative => format!("day {}", number + 1),
        }
    }

    /// A day in few characters, for an axis.
    pub fn short_day(self, number: u64) -> String {
        match self {
            Self::Utc => date(number).split_off(5),
            Self::Relative => (number + 1).to_string(),
        }
    }

    /// Hours and minutes, for an axis within a day.
    pub fn minute(time_ns: u64) -> String {
        utc(time_ns).format("%H:%M").to_string()
    }
}

/// Year, month and day of a day since 1970-01-01.
fn date(number: u64) -> String {
    let start_ns = number.saturating_mul(DAY_S * S);
    utc(start_ns).format("%Y-%m-%d").to_string()
}

/// A length of time in words.
pub fn length(ns: u64) -> String {
    let s = ns as f64 * 1e-9;
    let whole = ns / S;
    match whole {
        0..60 => format!("{s:.1} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        3600..172_800 => format!("{} h {:02} min", whole / 3600, whole / 60 % 60),
        _ => format!("{} d {:02} h", whole / DAY_S, whole / 3600 % 24),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_instants_are_written_as_they_are() {
        let leap = 1_709_209_815_250_000_000;
        assert_eq!(Clock::Utc.text(leap), "2024-02-29 12:30:15.250");
        assert_eq!(Clock::Utc.day(leap / S / DAY_S), "2024-02-29");
        assert_eq!(Clock::Utc.short_day(leap / S / DAY_S), "02-29");
        assert_eq!(Clock::Relative.text(90_061 * S), "1 d 01:01:01.000");
        assert_eq!(Clock::Relative.day(1), "day 2");
    }

    #[test]
    fn a_length_has_no_more_digits_than_it_needs() {
        assert_eq!(length(1_250_000_000), "1.2 s");
        assert_eq!(length(61 * S), "1 min 01 s");
        assert_eq!(length(3 * 3600 * S), "3 h 00 min");
        assert_eq!(length(50 * 3600 * S), "2 d 02 h");
    }
}
