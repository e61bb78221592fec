//! A part of a log's time, as a person names it.
//!
//! In: `--from` and `--to`. Out: for the time of each frame whether it is in the [`Part`].

use clap::Args;

use crate::LogError;
use crate::date::{is_dated, moment};

/// Which part of the logs is read.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct PartOptions {
    /// Begin at this time: seconds since the first frame, or a date (UTC) as 2026-11-22 or
    /// 2026-11-22T12:30:00
    #[arg(long, value_name = "TIME")]
    pub from: Option<Moment>,
    /// End with the last frame at or before this time; as --from
    #[arg(long, value_name = "TIME")]
    pub to: Option<Moment>,
}

impl PartOptions {
    /// The part.
    ///
    /// Errors: [`LogError::NoTime`].
    pub fn part(&self) -> Result<Part, LogError> {
        let Self { from, to } = *self;
        let is_none = from
            .zip(to)
            .is_some_and(|(from, to)| to.is_after(from) == Some(false));
        if is_none {
            return Err(LogError::NoTime);
        }
        Ok(Part {
            from,
            to,
            ..Part::default()
        })
    }
}

/// A moment of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moment {
    /// Seconds since its first frame.
    AfterStart(f64),
    /// ns since 1970.
    At(u64),
}

impl Moment {
    /// Whether it is behind `other`; `None` where only the log tells, of which one is counted from
    /// its beginning.
    pub fn is_after(self, other: Self) -> Option<bool> {
        match (self, other) {
            (Self::AfterStart(one), Self::AfterStart(other)) => Some(one > other),
            (Self::At(one), Self::At(other)) => Some(one > other),
            _ => None,
        }
    }
}

impl std::str::FromStr for Moment {
    type Err = String;

    /// Seconds since the first frame, seconds since 1970, or a date.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Some(ns) = moment(text) {
            return Ok(Self::At(ns));
        }
        let seconds: f64 = text.parse().unwrap_or(f64::NAN);
        // To the microsecond, which such a number of seconds still has.
        let us = (seconds * 1e6).round();
        if !(0.0..1.8e16).contains(&us) {
            return Err("give seconds since its start, or a date as 2026-11-22T12:30:00".into());
        }
        let ns = us as u64 * 1000;
        Ok(if is_dated(ns) {
            Self::At(ns)
        } else {
            Self::AfterStart(seconds)
        })
    }
}

impl Moment {
    /// In ns of a log whose first frame has this time.
    pub fn ns(self, first_ns: u64) -> u64 {
        match self {
            // The nearest: the double of 1.001 s is below it.
            Self::AfterStart(seconds) => first_ns.saturating_add((seconds * 1e9).round() as u64),
            Self::At(ns) => ns,
        }
    }
}

/// A part of a log's time; both ends belong to it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Part {
    from: Option<Moment>,
    to: Option<Moment>,
    first_ns: Option<u64>,
    outside: u64,
}

impl Part {
    /// Whether a frame of this time is in it. The first one that is asked about begins the log.
    #[inline]
    pub fn has(&mut self, time_ns: u64) -> bool {
        if self.from.is_none() && self.to.is_none() {
            return true;
        }
        let first_ns = self.first_ns.get_or_insert(time_ns);
        if is_dated(time_ns) && !is_dated(*first_ns) {
            // The time of a frame without a date is no start of those with one.
            *first_ns = time_ns;
        }
        let first_ns = *first_ns;
        let before = self.from.is_some_and(|from| time_ns < from.ns(first_ns));
        let behind = self.to.is_some_and(|to| time_ns > to.ns(first_ns));
        self.outside += u64::from(before || behind);
        !before && !behind
    }

    /// Frames that were not in it.
    pub const fn outside(&self) -> u64 {
        self.outside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn part(from: &str, to: &str) -> Result<Part, LogError> {
        let moment = |text: &str| text.parse().ok();
        PartOptions {
            from: moment(from),
            to: moment(to),
        }
        .part()
    }

    #[test]
    fn six_was_after_the_first_frame_for_replay_and_after_1970_for_report() {
        let first_ns = 1_700_000_000 * S;
        let mut six = part("6", "8").unwrap();
        let has = [0, 5, 6, 8, 9].map(|s| six.has(first_ns + s * S));
        assert_eq!(has, [false, false, true, true, false]);
        assert_eq!(six.outside(), 3);
    }

    #[test]
    fn the_frame_at_the_very_end_was_left_out() {
        let first_ns = 1_700_000_000 * S;
        for ms in 1..5_000 {
            let mut until = part("0", &format!("{}.{:03}", ms / 1000, ms % 1000)).unwrap();
            let has = [0, 1_000_000 * ms, 1_000_000 * ms + 1].map(|ns| until.has(first_ns + ns));
            assert_eq!(has, [true, true, false], "{ms} ms");
        }
    }

    #[test]
    fn a_moment_is_seconds_or_a_date() {
        let moment = |text: &str| text.parse::<Moment>();
        assert_eq!(moment("12.5"), Ok(Moment::AfterStart(12.5)));
        for text in ["2024-02-29T12:30:15.250Z", "1709209815.25"] {
            assert_eq!(
                moment(text),
                Ok(Moment::At(1_709_209_815_250_000_000)),
                "{text}"
            );
        }
        for wrong in ["", "2026-13-01", "2026-11-20T25:00", "-5", "nan", "1e300"] {
            assert!(moment(wrong).is_err(), "{wrong}");
        }
    }

    proptest::proptest! {
        #[test]
        fn whatever_is_typed_is_an_instant_or_a_sentence(text in ".{0,30}") {
            let _ = text.parse::<Moment>();
        }
    }

    #[test]
    fn an_end_that_is_not_behind_the_start_is_refused() {
        assert!(part("9", "8").is_err() && part("8", "8").is_err());
        assert!(part("2026-11-20", "9").is_ok());
    }

    #[test]
    fn a_frame_without_a_date_does_not_begin_a_log_that_has_dates() {
        let mut part = part("6", "").unwrap();
        let first_ns = 1_700_000_000 * S;
        let has = [0, first_ns, first_ns + 7 * S].map(|ns| part.has(ns));
        assert_eq!(has, [false, false, true]);
    }
}
