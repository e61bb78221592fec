//! Rows on a steady clock, for recordings whose time stamps jitter.
//!
//! In: a [`Recording`]. Out: [`Steady`] rows, or `None` where the stamps are steady already and the
//! rows go into the chain as they are. A sensor samples by its own clock, and the chain counts on
//! that: it takes an interval of one and a half periods for a lost sample, and reads between the
//! last two. Loggers on a host stamp rows when they arrive, half a period to several periods
//! apart. Such rows are put on a clock of their mean period, on the line between the row before
//! and the row after. Holes of up to a tenth of a second are bridged; after longer ones the chain
//! starts anew.

use super::recording::{GAP_PERIODS, Recording, Row};

/// Rows at equal distances within each stretch.
#[derive(Clone, Debug, PartialEq)]
pub struct Steady {
    /// The rows; `starts_anew` marks the first of each stretch.
    pub rows: Vec<Row>,
    /// Time between them, microseconds.
    pub period_us: u64,
    /// Holes after which a new stretch begins.
    pub gaps: u64,
}

/// Steps further from the median step than this share of it jitter.
const STEADY_WITHIN: f64 = 0.25;

/// With a larger share of jittering steps the rows are put on a steady clock.
const MOST_JITTERING: f64 = 0.1;

/// Holes up to this are bridged, microseconds.
const BRIDGED_US: u64 = 100_000;

/// The rows of a jittering recording on a steady clock.
pub fn steady(recording: &Recording) -> Option<Steady> {
    let rows = &recording.rows;
    let median = recording.period_us as f64;
    let off = |step: u64| (step as f64 - median).abs() > STEADY_WITHIN * median;
    let jittering = steps(rows).filter(|&step| off(step)).count();
    if (jittering as f64) <= MOST_JITTERING * rows.len() as f64 {
        return None;
    }
    let longest = BRIDGED_US.max(GAP_PERIODS * recording.period_us);
    let (count, sum) = steps(rows)
        .filter(|&step| step <= longest)
        .fold((0u64, 0u64), |(count, sum), step| (count + 1, sum + step));
    let period_us = sum.checked_div(count)?.max(1);
    let mut steady = Steady {
        rows: Vec::with_capacity(rows.len()),
        period_us,
        gaps: 0,
    };
    for stretch in rows.chunk_by(|a, b| b.time_us - a.time_us <= longest) {
        steady.lay(stretch);
    }
    steady.gaps = steady.gaps.saturating_sub(1);
    Some(steady)
}

fn steps(rows: &[Row]) -> impl Iterator<Item = u64> {
    rows.windows(2).filter_map(|pair| match pair {
        [a, b] => b.time_us.checked_sub(a.time_us),
        _ => None,
    })
}

impl Steady {
    /// Lays one stretch onto the clock, which starts with its first row.
    fn lay(&mut self, stretch: &[Row]) {
        self.gaps += 1;
        let mut next_us = stretch.first().map_or(0, |row| row.time_us);
        let first_us = next_us;
        for pair in stretch.windows(2) {
            let [before, after] = pair else { continue };
            while next_us < after.time_us {
                self.rows.push(Row {
                    time_us: next_us,
                    accel_g: between(before, after, next_us, |row| row.accel_g),
                    rate_radps: before.rate_radps.zip(after.rate_radps).map(|_| {
                        between(before, after, next_us, |row| {
                            row.rate_radps.unwrap_or_default()
                        })
                    }),
                    starts_anew: next_us == first_us,
                    ..*before
                });
                next_us += self.period_us;
            }
        }
    }
}

/// Three numbers of a row at an instant on the line between two rows.
fn between(before: &Row, after: &Row, at_us: u64, of: impl Fn(&Row) -> [f64; 3]) -> [f64; 3] {
    let span = (after.time_us - before.time_us) as f64;
    let way = at_us.saturating_sub(before.time_us) as f64 / span;
    let (from, to) = (of(before), of(after));
    std::array::from_fn(|i| from[i] + way * (to[i] - from[i]))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::super::recording::Options;
    use super::*;

    /// x climbs by 1 g/s; each time is off by what `jitter` returns.
    fn recording(jitter: impl Fn(u64) -> i64) -> Recording {
        let mut text = "time_us,ax_g,ay_g,az_g\n".to_owned();
        for i in 0..400u64 {
            let at = (i * 10_000).saturating_add_signed(jitter(i));
            text.push_str(&format!("{at},{},0,1\n", at as f64 / 1e7));
        }
        Recording::read("test.csv", Cursor::new(text), Options::default()).unwrap()
    }

    #[test]
    fn steady_stamps_are_left_alone() {
        assert_eq!(steady(&recording(|_| 0)), None);
        // A lost row here and there is the chain's business.
        assert_eq!(steady(&recording(|i| 10_000 * (i / 100) as i64)), None);
    }

    #[test]
    fn jittering_rows_lie_on_their_line_at_equal_distances() {
        let found = steady(&recording(|i| [0, 4000, -3000][(i % 3) as usize])).unwrap();
        assert!(
            (9_900..=10_100).contains(&found.period_us),
            "{}",
            found.period_us
        );
        assert_eq!(found.gaps, 0);
        assert!(found.rows.len() > 390);
        for pair in found.rows.windows(2) {
            assert_eq!(pair[1].time_us - pair[0].time_us, found.period_us);
            assert!((pair[1].accel_g[0] - pair[1].time_us as f64 / 1e7).abs() < 1e-9);
        }
    }

    #[test]
    fn a_long_hole_starts_anew_and_a_short_one_is_bridged() {
        let holes = |i: u64| {
            let jitter = [0, 4000, -3000][(i % 3) as usize];
            let late = if i >= 300 { 280_000 } else { 0 } + if i >= 100 { 60_000 } else { 0 };
            jitter + late
        };
        let found = steady(&recording(holes)).unwrap();
        let starts: Vec<u64> = found
            .rows
            .iter()
            .filter(|row| row.starts_anew)
            .map(|row| row.time_us)
            .collect();
        assert_eq!((found.gaps, starts.len()), (1, 2));
        assert_eq!(starts[1], 3_340_000);
    }
}
