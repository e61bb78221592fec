//! Instants of a log in words.
//!
//! In: ns since 1970 (UTC), or since the log began where its times are too small for that. Out:
//! text and days for people, and instants from what they type. Nothing knows the time zone of the
//! machine, neither that of the log nor this one's: all is UTC.

use bus_logs::{is_dated, moment, text_utc};

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
        let (seconds, ms) = (time_ns / S, time_ns % S / 1_000_000);
        let (day, of_day) = (seconds / DAY_S, seconds % DAY_S);
        let (h, m, s) = (of_day / 3600, of_day / 60 % 60, of_day % 60);
        match self {
            Self::Utc => format!("{} {h:02}:{m:02}:{s:02}.{ms:03}", date(day)),
            Self::Relative if day == 0 => format!("{h:02}:{m:02}:{s:02}.{ms:03}"),
            Self::Relative => format!("{day} d {h:02}:{m:02}:{s:02}.{ms:03}"),
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
        let of_day = time_ns / S % DAY_S;
        format!("{:02}:{:02}", of_day / 3600, of_day / 60 % 60)
    }
}

/// Year, month and day of a day since 1970-01-01.
fn date(number: u64) -> String {
    let text = text_utc(number.saturating_mul(DAY_S * S));
    text.split(' ').next().unwrap_or_default().to_owned()
}

/// An instant as a person types it: `2026-11-20`, `2026-11-20T06:30`, `2026-11-20 06:30:15.5`, with
/// or without a `Z`, or seconds since the log's time 0; in ns.
///
/// Errors: a sentence that says how to write it.
pub fn instant(text: &str) -> Result<u64, String> {
    let wrong =
        || "write it as 2026-11-20, 2026-11-20T06:30:00 (UTC), or in seconds of the log".to_owned();
    if let Some(seconds) = text.parse::<f64>().ok().filter(|s| *s >= 0.0 && *s < 1e10) {
        return Ok((seconds * 1e9).round() as u64);
    }
    moment(text).ok_or_else(wrong)
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
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn known_instants_read_as_they_are_written() {
        let leap = instant("2024-02-29T12:30:15.250Z").unwrap();
        assert_eq!(leap, 1_709_209_815_250_000_000);
        assert_eq!(Clock::Utc.text(leap), "2024-02-29 12:30:15.250");
        assert_eq!(Clock::Utc.day(leap / S / DAY_S), "2024-02-29");
        assert_eq!(Clock::Utc.short_day(leap / S / DAY_S), "02-29");
        assert_eq!(instant("12.5"), Ok(12_500_000_000));
        assert_eq!(Clock::Relative.text(90_061 * S), "1 d 01:01:01.000");
        assert_eq!(Clock::Relative.day(1), "day 2");
        for wrong in ["", "2026-13-01", "2026-11-20T25:00", "-5", "nan", "1e300"] {
            assert!(instant(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_length_has_no_more_digits_than_it_needs() {
        assert_eq!(length(1_250_000_000), "1.2 s");
        assert_eq!(length(61 * S), "1 min 01 s");
        assert_eq!(length(3 * 3600 * S), "3 h 00 min");
        assert_eq!(length(50 * 3600 * S), "2 d 02 h");
    }

    proptest! {
        #[test]
        fn whatever_is_typed_is_an_instant_or_a_sentence(text in ".{0,30}") {
            let _ = instant(&text);
        }
    }
}
