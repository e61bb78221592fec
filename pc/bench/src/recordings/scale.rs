//! From the recording's numbers to g, with the check that the header's unit is believable.
//!
//! In: the numbers as recorded, with the unit that the header names. Out: how many of them make
//! one g. The check uses that a standing sensor reads 1 g whatever its attitude: the quietest
//! fifth of the recording is taken as standing, and the median of its lengths must be within
//! [`PLAUSIBLE_G`]. A wrong unit misses it by far (9.8, or thousands). Stretches of one repeated
//! code are left out first: that is how a sensor stands that has died, at any length. Only where
//! the rest tells no unit do they count, since a coarse sensor at rest may repeat itself, too.

use super::columns::AccelUnit;
use super::error::Problem;
use super::windows::{Sums, Window, moving, norm, quantile};

/// Standard gravity, m/s^2.
pub const GRAVITY_MPS2: f64 = 9.806_65;

/// The length at standstill that is believed, in g: offset and scale of poor sensors included.
pub const PLAUSIBLE_G: std::ops::RangeInclusive<f64> = 0.7..=1.4;

/// How far the length at standstill may be from a power of two of counts.
const NEAR: f64 = 0.2;

const HALF_WINDOW_US: u64 = 125_000;
const FEWEST_IN_WINDOW: usize = 5;
const QUIET_SHARE: f64 = 0.2;

/// How the scale was come by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Source {
    /// The header's unit fixes it.
    Unit,
    /// The caller said it.
    Given,
    /// The power of two of counts nearest to the length at standstill.
    Nearest,
}

/// How many of the recording's numbers make one g.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Numbers per g.
    pub per_g: f64,
    /// How that was come by.
    pub source: Source,
    /// Median length at standstill by this scale, g.
    pub standstill_g: f64,
}

/// The [`scale`] by the samples that live, or else by all of them.
pub fn scale_of(
    unit: AccelUnit,
    times_us: &[u64],
    accel: &[[f64; 3]],
    lsb_per_g: Option<f64>,
) -> Result<Scale, Problem> {
    let of = |times: &[u64], accel: &[[f64; 3]]| {
        let norm = standstill_norm(times, accel).unwrap_or(0.0);
        scale(unit, norm, lsb_per_g)
    };
    let (times, alive) = alive(times_us, accel);
    if alive.is_empty() {
        return of(times_us, accel);
    }
    of(&times, &alive).or_else(|why| of(times_us, accel).map_err(|_| why))
}

/// The samples without the stretches, a window long and more, in which none differs from the next.
fn alive(times_us: &[u64], accel: &[[f64; 3]]) -> (Vec<u64>, Vec<[f64; 3]>) {
    let samples: Vec<(u64, [f64; 3])> = times_us
        .iter()
        .copied()
        .zip(accel.iter().copied())
        .collect();
    let is_dead = |run: &[(u64, [f64; 3])]| match run {
        [first, .., last] => {
            run.len() >= FEWEST_IN_WINDOW && last.0 - first.0 >= 2 * HALF_WINDOW_US
        }
        _ => false,
    };
    let runs = samples.chunk_by(|a, b| a.1 == b.1);
    runs.filter(|run| !is_dead(run)).flatten().copied().unzip()
}

/// The median length in the quietest fifth, in the unit of the input; `None` of no samples.
///
/// A sample a hundred times longer than the median is damage, and would drown the sums.
pub fn standstill_norm(times_us: &[u64], accel: &[[f64; 3]]) -> Option<f64> {
    let median = quantile(accel.iter().copied().map(norm).collect(), 0.5)?;
    let sane = times_us
        .iter()
        .zip(accel)
        .filter(|(_, a)| norm(**a) <= 100.0 * median);
    let (times, accel): (Vec<u64>, Vec<[f64; 3]>) = sane.unzip();
    let mut windows = moving(&times, &Sums::new(accel.into_iter()), HALF_WINDOW_US);
    windows.retain(|window| window.count >= FEWEST_IN_WINDOW);
    let Some(limit) = quantile(windows.iter().map(Window::scatter).collect(), QUIET_SHARE) else {
        return Some(median);
    };
    windows.retain(|window| window.scatter() <= limit);
    quantile(
        windows.iter().map(|window| norm(window.mean)).collect(),
        0.5,
    )
}

/// Finds the scale and refuses what is not believable.
///
/// `standstill` is the [`standstill_norm`], `lsb_per_g` what the caller gives for counts.
pub fn scale(unit: AccelUnit, standstill: f64, lsb_per_g: Option<f64>) -> Result<Scale, Problem> {
    let (per_g, source) = match (unit, lsb_per_g) {
        (AccelUnit::G, _) => (1.0, Source::Unit),
        (AccelUnit::MetrePerSecond2, _) => (GRAVITY_MPS2, Source::Unit),
        (AccelUnit::Lsb, Some(given)) => (given, Source::Given),
        (AccelUnit::Lsb, None) => (nearest_counts(standstill)?, Source::Nearest),
    };
    let norm_g = standstill / per_g;
    if !PLAUSIBLE_G.contains(&norm_g) {
        let advice = advice(unit, source, standstill);
        return Err(Problem::WrongUnit { norm_g, advice });
    }
    Ok(Scale {
        per_g,
        source,
        standstill_g: norm_g,
    })
}

/// The power of two from 64 to 32768 within 20 % of the length at standstill.
fn nearest_counts(standstill: f64) -> Result<f64, Problem> {
    let nearest = standstill.max(1.0).log2().round().exp2();
    let near = (standstill / nearest - 1.0).abs() <= NEAR;
    if near && (64.0..=32_768.0).contains(&nearest) {
        Ok(nearest)
    } else {
        Err(Problem::UnknownScale(standstill))
    }
}

fn advice(unit: AccelUnit, source: Source, standstill: f64) -> String {
    let fits = |per_g: f64| PLAUSIBLE_G.contains(&(standstill / per_g));
    if source == Source::Given {
        format!("the recording asks for --lsb-per-g near {standstill:.0}")
    } else if unit != AccelUnit::G && fits(1.0) {
        "it looks like g: name the columns `_g`".to_owned()
    } else if unit != AccelUnit::MetrePerSecond2 && fits(GRAVITY_MPS2) {
        "it looks like m/s^2: name the columns `_mps2`".to_owned()
    } else if fits(1000.0) {
        "it looks like mg (or counts): name the columns `_lsb` and use --lsb-per-g 1000".to_owned()
    } else if nearest_counts(standstill).is_ok() {
        "it looks like counts: name the columns `_lsb`".to_owned()
    } else if fits(0.001) {
        "it is a thousandth of what it should be: multiply the columns by 1000".to_owned()
    } else {
        "no unit fits; check the columns, and that the sensor stood still for some seconds"
            .to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_per_g_by_the_length_at_standstill() {
        let found = |norm| scale(AccelUnit::Lsb, norm, None).map(|s| s.per_g);
        assert_eq!(found(2089.0), Ok(2048.0));
        assert_eq!(found(16_100.0), Ok(16_384.0));
        assert_eq!(found(1400.0), Err(Problem::UnknownScale(1400.0)));
        assert_eq!(found(3.0), Err(Problem::UnknownScale(3.0)));
        assert_eq!(found(0.0), Err(Problem::UnknownScale(0.0)));
        let given = scale(AccelUnit::Lsb, 1400.0, Some(1366.0)).unwrap();
        assert_eq!((given.per_g, given.source), (1366.0, Source::Given));
    }

    #[test]
    fn a_wrong_unit_is_told_with_the_one_that_fits() {
        let cases = [
            (
                AccelUnit::G,
                9.79,
                "looks like m/s^2: name the columns `_mps2`",
            ),
            (
                AccelUnit::MetrePerSecond2,
                1.01,
                "looks like g: name the columns `_g`",
            ),
            (AccelUnit::G, 998.0, "use --lsb-per-g 1000"),
            (
                AccelUnit::G,
                2060.0,
                "looks like counts: name the columns `_lsb`",
            ),
            (AccelUnit::G, 0.001, "multiply the columns by 1000"),
            (AccelUnit::G, 0.3, "no unit fits"),
            (AccelUnit::G, 0.0, "no unit fits"),
            (AccelUnit::MetrePerSecond2, 16_384.0, "looks like counts"),
        ];
        for (unit, standstill, sentence) in cases {
            let text = scale(unit, standstill, None).unwrap_err().to_string();
            assert!(text.contains(sentence), "{standstill}: {text}");
        }
        let text = scale(AccelUnit::Lsb, 2060.0, Some(16_384.0))
            .unwrap_err()
            .to_string();
        assert!(text.contains("--lsb-per-g near 2060"), "{text}");
    }

    #[test]
    fn a_sensor_that_sticks_or_stands_at_full_scale_does_not_decide() {
        let times: Vec<u64> = (0..2000).map(|i| i * 10_000).collect();
        let wobble = |i: usize| 0.001 * ((i * 7 % 5) as f64 - 2.0);
        for dead in [[0.9, 0.9, 1.2], [2.0, 2.0, 2.0]] {
            let sample = |i: usize| {
                if i < 800 {
                    [0.0, 0.6 + wobble(i), 0.8]
                } else {
                    dead
                }
            };
            let accel: Vec<[f64; 3]> = (0..2000).map(sample).collect();
            let found = scale_of(AccelUnit::G, &times, &accel, None).unwrap();
            assert!((found.standstill_g - 1.0).abs() < 0.01, "{found:?}");
        }
        // A coarse sensor at rest repeats itself, and the rest of the recording is a tumble.
        let sample = |i: usize| match i {
            0..1400 => [0.0, 0.6, 0.8],
            _ => [0.0, 0.0, 0.2 + wobble(i)],
        };
        let accel: Vec<[f64; 3]> = (0..2000).map(sample).collect();
        let found = scale_of(AccelUnit::G, &times, &accel, None).unwrap();
        assert!((found.standstill_g - 1.0).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn the_quiet_part_decides() {
        let times: Vec<u64> = (0..1000).map(|i| i * 10_000).collect();
        let shaken = |i: usize| {
            if i < 700 {
                [3.0, (i % 7) as f64, 0.0]
            } else {
                [0.0, 0.6, 0.8]
            }
        };
        let accel: Vec<[f64; 3]> = (0..1000).map(shaken).collect();
        let norm = standstill_norm(&times, &accel).unwrap();
        assert!((norm - 1.0).abs() < 1e-6, "{norm}");
        assert_eq!(standstill_norm(&[], &[]), None);
    }
}
