//! Dates, as ns since 1970 (UTC) and back.
//!
//! In: `2023-11-14 22:13:20.5`, with `T` or a blank in the middle and perhaps a `Z` behind it; or
//! year, month, day and time of day. Out: ns since 1970. A date without a zone is taken as UTC: a
//! log doesn't state where it was made. Before 1970 and after 2500 there is none.

use chrono::{DateTime, NaiveDate, NaiveTime, Utc};

const S: u64 = 1_000_000_000;

/// ns since 1970 of a day and a time of day; `None` when there is no such moment.
pub fn since_1970_ns(year: i32, month: u32, day: u32, (second, ns): (u32, u32)) -> Option<u64> {
    let date = NaiveDate::from_ymd_opt(year, month, day);
    let date = date.filter(|_| (1970..=2500).contains(&year))?;
    let time = NaiveTime::from_num_seconds_from_midnight_opt(second, ns)?;
    let seconds = u64::try_from(date.and_time(time).and_utc().timestamp()).ok()?;
    seconds.checked_mul(S)?.checked_add(u64::from(ns))
}

/// The date of this moment.
pub fn utc(time_ns: u64) -> DateTime<Utc> {
    // Both fit: 2^64 ns are 584 years.
    DateTime::from_timestamp((time_ns / S) as i64, (time_ns % S) as u32).unwrap_or_default()
}

/// ns since 1970 of `2023-11-14 22:13:20.123456`, of a date alone, or of either with a `T` or `Z`.
pub fn moment(text: &str) -> Option<u64> {
    let text = text.trim().trim_end_matches(['Z', 'z']);
    let (date, time) = text.split_once([' ', 'T', 't']).unwrap_or((text, "0:0:0"));
    let mut parts = date.split('-').map(|part| part.parse::<u32>().ok());
    let (year, month, day) = (parts.next()??, parts.next()??, parts.next()??);
    let ns = since_1970_ns(year.try_into().ok()?, month, day, time_of_day(time)?)?;
    parts.next().is_none().then_some(ns)
}

/// Seconds since midnight and ns of `22:13:20.5` or `22:13`.
pub fn time_of_day(text: &str) -> Option<(u32, u32)> {
    let mut parts = text.trim().split(':');
    let hour: u32 = parts.next()?.parse().ok()?;
    let minute: u32 = parts.next()?.parse().ok()?;
    let (second, fraction) = match parts.next() {
        None => (0, ""),
        Some(second) => {
            let (whole, fraction) = second.split_once('.').unwrap_or((second, ""));
            (whole.parse::<u32>().ok()?, fraction)
        }
    };
    let digits = fraction.len() <= 9 && fraction.bytes().all(|b| b.is_ascii_digit());
    let ns: u32 = digits.then(|| format!("{fraction:0<9}"))?.parse().ok()?;
    let fits = hour < 24 && minute < 60 && second < 60 && parts.next().is_none();
    fits.then_some((hour * 3600 + minute * 60 + second, ns))
}

/// `2023-11-14 22:13:20.123 UTC`; in a log without a date the seconds since it began.
pub fn text_utc(time_ns: u64) -> String {
    if !is_dated(time_ns) {
        let ms = time_ns / 1_000_000;
        return format!("{}.{:03} s", ms / 1000, ms % 1000);
    }
    utc(time_ns).format("%Y-%m-%d %H:%M:%S%.3f UTC").to_string()
}

/// Whether a time is a date: what counts from a start stays below twenty years.
pub const fn is_dated(time_ns: u64) -> bool {
    time_ns >= 20 * 365 * 86_400 * S
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_and_back() {
        let cases = [
            ("1970-01-01 00:00:00", 0),
            ("2000-02-29T12:00:00Z", 951_825_600_000_000_000),
            ("2023-11-14 22:13:20.123456", 1_700_000_000_123_456_000),
            ("2100-03-01", 4_107_542_400_000_000_000),
        ];
        for (text, ns) in cases {
            assert_eq!(moment(text), Some(ns), "{text}");
            let date = utc(ns).format("%Y-%m-%d %H:%M:%S%.f").to_string();
            assert_eq!(moment(&date), Some(ns), "{text}");
        }
        for text in [
            "",
            "12.5",
            "2023-13-01",
            "2023-11-14 24:00:00",
            "2023-11",
            "1969-12-31",
            "2023-02-29",
        ] {
            assert_eq!(moment(text), None, "{text}");
        }
        for text in [
            "2023-11-14 1:2:3.1234567890",
            "2023-11-14 1:2:3.+5",
            "2023-11-14 1:2:3:4",
        ] {
            assert_eq!(moment(text), None, "{text}");
        }
    }

    #[test]
    fn every_day_of_five_centuries_comes_back() {
        for day in 0..193_000_u64 {
            let ns = day * 86_400 * S;
            let text = utc(ns).format("%Y-%m-%d %w").to_string();
            let (date, weekday) = text.split_once(' ').unwrap();
            assert_eq!(moment(date), Some(ns));
            assert_eq!(weekday.parse(), Ok((day + 4) % 7));
        }
    }

    #[test]
    fn what_counts_from_a_start_is_no_date() {
        assert_eq!(text_utc(12_345_678_901), "12.345 s");
        assert_eq!(
            text_utc(1_700_000_000_123_456_000),
            "2023-11-14 22:13:20.123 UTC"
        );
    }

    #[test]
    fn times_after_2038_are_what_they_are() {
        let second = |s: u64| text_utc(s * 1_000_000_000);
        assert_eq!(second(2_147_483_647), "2038-01-19 03:14:07.000 UTC");
        assert_eq!(second(2_147_483_648), "2038-01-19 03:14:08.000 UTC");
        assert_eq!(second(9_000_000_000), "2255-03-14 16:00:00.000 UTC");
    }
}
