//! Instants of a log in words.
//!
//! In: ns since 1970 (UTC), or since the log began where its times are too small for that. Out:
//! text and days for people, and instants from what they type. Nothing knows the time zone of the
//! machine, neither that of the log nor this one's: all is UTC.

/// Days from 0000-03-01 to 1970-01-01.
const TO_1970: i64 = 719_468;

/// Days in 400 years.
const ERA: i64 = 146_097;

/// Times from here on are a date: 1980-01-01 in ns.
const FIRST_DATE_NS: u64 = 315_532_800_000_000_000;

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
        if first_ns >= FIRST_DATE_NS {
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
    let days = number as i64 + TO_1970;
    let (era, of_era) = (days.div_euclid(ERA), days.rem_euclid(ERA));
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / (ERA - 1)) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    // Months are counted from March on, so that the leap day is the last one of the year.
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = (from_march + 2) % 12 + 1;
    let year = era * 400 + year + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

/// The day since 1970-01-01 of a date; `None` for one that does not exist.
fn day_of(text: &str) -> Option<u64> {
    let mut parts = text.splitn(3, '-');
    let mut number = |digits: usize| {
        let part = parts.next().filter(|part| part.len() == digits)?;
        let plain = part.bytes().all(|byte| byte.is_ascii_digit());
        part.parse::<i64>().ok().filter(|_| plain)
    };
    let (year, month, day) = (number(4)?, number(2)?, number(2)?);
    let of_march = if month <= 2 { year - 1 } else { year };
    let (era, of_era) = (of_march.div_euclid(400), of_march.rem_euclid(400));
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    let days = era * ERA + of_era * 365 + of_era / 4 - of_era / 100 + of_year - TO_1970;
    let found = u64::try_from(days).ok()?;
    (date(found) == text).then_some(found)
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
    let plain = text.strip_suffix(['Z', 'z']).unwrap_or(text);
    let (day, time) = plain
        .split_once(['T', 't', ' '])
        .unwrap_or((plain, "00:00"));
    let day = day_of(day).ok_or_else(wrong)?;
    let of_day_ns = time_of_day(time).ok_or_else(wrong)?;
    // The last day that can be written lies beyond what ns can count.
    let day_ns = day.checked_mul(DAY_S * S).ok_or_else(wrong)?;
    day_ns.checked_add(of_day_ns).ok_or_else(wrong)
}

fn time_of_day(text: &str) -> Option<u64> {
    let mut parts = text.splitn(3, ':');
    let mut whole = |most: u64| {
        let part = parts.next().filter(|part| part.len() == 2)?;
        part.parse::<u64>().ok().filter(|value| *value < most)
    };
    let (h, m) = (whole(24)?, whole(60)?);
    let s = match parts.next() {
        Some(part) if !part.contains(['e', 'E', '+', '-', 'n', 'N']) => part.parse::<f64>().ok()?,
        Some(_) => return None,
        None => 0.0,
    };
    let s = Some(s).filter(|s| (0.0..60.0).contains(s))?;
    Some((h * 3600 + m * 60) * S + (s * 1e9).round() as u64)
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
        assert_eq!(instant("1970-01-02"), Ok(DAY_S * S));
        assert_eq!(instant("12.5"), Ok(12_500_000_000));
        assert_eq!(Clock::Relative.text(90_061 * S), "1 d 01:01:01.000");
        for wrong in [
            "",
            "2023-02-29",
            "2026-13-01",
            "26-1-1",
            "2026-11-20T25:00",
            "-5",
            "nan",
        ] {
            assert!(instant(wrong).is_err(), "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn a_day_is_read_back_from_its_text(day in 0..40_000_u64) {
            prop_assert_eq!(day_of(&date(day)), Some(day));
        }

        #[test]
        fn whatever_is_typed_is_an_instant_or_a_sentence(text in ".{0,30}") {
            let _ = instant(&text);
        }
    }
}
