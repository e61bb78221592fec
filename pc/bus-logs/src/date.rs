//! Dates, as ns since 1970 (UTC) and back.
//!
//! In: `2023-11-14 22:13:20.5`, with `T` or a blank in the middle and perhaps a `Z` behind it; or
//! year, month, day and time of day. Out: ns since 1970. A date without a zone is taken as UTC: a
//! log doesn't say where it was made. Before 1970 and after 2500 there is none.

/// Days in a cycle of 400 years.
const DAYS_OF_400_YEARS: i64 = 146_097;

/// Days from 0000-03-01 to 1970-01-01.
const BEFORE_1970: i64 = 719_468;

/// Seconds of a day.
const DAY_S: u64 = 86_400;

/// A day and a time of day.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Civil {
    /// Year, 1970 to 2500.
    pub year: u32,
    /// Month, 1 to 12.
    pub month: u32,
    /// Day of the month, 1 to 31.
    pub day: u32,
    /// Seconds since midnight, below 86 400.
    pub second: u32,
    /// And ns.
    pub ns: u32,
}

impl Civil {
    /// ns since 1970; `None` when a part is out of its range.
    pub fn since_1970_ns(&self) -> Option<u64> {
        let fits = (1970..=2500).contains(&self.year)
            && (1..=12).contains(&self.month)
            && (1..=31).contains(&self.day)
            && u64::from(self.second) < DAY_S;
        let days = fits.then(|| days_since_1970(self.year, self.month, self.day))?;
        let seconds = u64::try_from(days).ok()? * DAY_S + u64::from(self.second);
        seconds
            .checked_mul(1_000_000_000)?
            .checked_add(u64::from(self.ns))
    }

    /// The date of this moment.
    pub fn of(time_ns: u64) -> Self {
        let seconds = time_ns / 1_000_000_000;
        let days = (seconds / DAY_S) as i64 + BEFORE_1970;
        // Years begin in March here, so that the leap day is the last of its year.
        let cycle = days.div_euclid(DAYS_OF_400_YEARS);
        let day = days.rem_euclid(DAYS_OF_400_YEARS);
        let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
        let day = day - (365 * year + year / 4 - year / 100);
        let month = (5 * day + 2) / 153;
        Self {
            year: (cycle * 400 + year + i64::from(month >= 10)) as u32,
            month: (if month < 10 { month + 3 } else { month - 9 }) as u32,
            day: (day - (153 * month + 2) / 5 + 1) as u32,
            second: (seconds % DAY_S) as u32,
            ns: (time_ns % 1_000_000_000) as u32,
        }
    }

    /// Day of the week, 0 for Sunday.
    pub fn weekday(&self) -> usize {
        let days = days_since_1970(self.year, self.month, self.day);
        // 1970 began on a Thursday.
        (days + 4).rem_euclid(7) as usize
    }
}

fn days_since_1970(year: u32, month: u32, day: u32) -> i64 {
    let (month, day) = (i64::from(month), i64::from(day));
    let year = i64::from(year) - i64::from(month <= 2);
    let cycle = year.div_euclid(400);
    let year = year.rem_euclid(400);
    let month = (month + 9) % 12;
    let day = (153 * month + 2) / 5 + day - 1;
    cycle * DAYS_OF_400_YEARS + year * 365 + year / 4 - year / 100 + day - BEFORE_1970
}

/// ns since 1970 of `2023-11-14 22:13:20.123456`, of a date alone, or of either with a `T` or `Z`.
pub fn moment(text: &str) -> Option<u64> {
    let text = text.trim().trim_end_matches(['Z', 'z']);
    let (date, time) = text.split_once([' ', 'T', 't']).unwrap_or((text, "0:0:0"));
    let mut parts = date.split('-').map(|part| part.parse().ok());
    let (year, month, day) = (parts.next()??, parts.next()??, parts.next()??);
    let (second, ns) = time_of_day(time)?;
    let civil = Civil {
        year,
        month,
        day,
        second,
        ns,
    };
    parts.next().is_none().then(|| civil.since_1970_ns())?
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
    let at = Civil::of(time_ns);
    format!(
        "{:04}-{:02}-{:02} {:02}:{:02}:{:02}.{:03} UTC",
        at.year,
        at.month,
        at.day,
        at.second / 3600,
        at.second / 60 % 60,
        at.second % 60,
        at.ns / 1_000_000
    )
}

/// Whether a time is a date: what counts from a start stays below twenty years.
pub const fn is_dated(time_ns: u64) -> bool {
    const TWENTY_YEARS_NS: u64 = 20 * 365 * DAY_S * 1_000_000_000;
    time_ns >= TWENTY_YEARS_NS
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
            assert_eq!(Civil::of(ns).since_1970_ns(), Some(ns), "{text}");
        }
        for text in [
            "",
            "12.5",
            "2023-13-01",
            "2023-11-14 24:00:00",
            "2023-11",
            "1969-12-31",
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
            let ns = day * DAY_S * 1_000_000_000;
            let civil = Civil::of(ns);
            assert_eq!(civil.since_1970_ns(), Some(ns));
            assert_eq!(civil.weekday() as u64, (day + 4) % 7);
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
