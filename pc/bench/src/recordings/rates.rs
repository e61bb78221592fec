//! The rates of a gyroscope in a recording: read, and their unit checked against the acceleration.
//!
//! In: cells, and stretches of rows without a gap. Out: rad/s, or the [`Problem`] with their unit
//! or sign.
//!
//! In axes that turn back as the rates tell, gravity stands still, whatever shakes the sensor
//! beside it. So the mean acceleration of two seconds is compared with that of the next two, in
//! axes by the unit that the header names, by the other one, and by rates of the other sign. What
//! fits far better than the header is what was recorded. Where the sensor hardly turned, all fit
//! alike, and nothing can be said.
//!
//! Left out: errors of scale, which calibration has to find.

use tilt::calibration::algebra::{cross, dot};

use super::cells::optional;
use super::columns::RateUnit;
use super::error::Problem;
use super::skips::Reason;
use super::windows::norm;

/// Time over which the acceleration is averaged, s.
const MEAN_S: f64 = 2.0;

/// Fewest pairs of means that are compared.
const FEWEST: usize = 5;

/// What fits has to leave less than this share of what the header leaves, mean squares.
const FITS: f64 = 0.25;

/// Shorter means than this are of axes that spin, g.
const SPINS_G: f64 = 0.5;

/// The header fits well enough where it leaves no more than this, g root mean square.
const STILL_G: f64 = 0.05;

/// The rates of a row in rad/s; none where all three cells are empty.
///
/// Errors: a cell that is no number, or is missing beside others.
pub fn rate_radps(cells: [&str; 3], unit: RateUnit) -> Result<Option<[f64; 3]>, Reason> {
    let [x, y, z] = cells.map(optional);
    match (x?, y?, z?) {
        (None, None, None) => Ok(None),
        (Some(x), Some(y), Some(z)) => Ok(Some([x, y, z].map(|rate| rate * unit.radians()))),
        _ => Err(Reason::MissingCell),
    }
}

/// What a row shows of a turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turning {
    /// Acceleration, g.
    pub accel_g: [f64; 3],
    /// Rate of turn, rad/s by the unit of the header.
    pub rate_radps: [f64; 3],
}

/// Checks the unit that the header names.
///
/// Errors: [`Problem::RateUnit`], [`Problem::RateSign`].
pub fn check(
    stretches: impl Iterator<Item = Vec<Turning>>,
    period_us: u64,
    unit: RateUnit,
) -> Result<(), Problem> {
    let other = unit.other().radians() / unit.radians();
    let mut kinds = [1.0, other, -1.0].map(|times| Steadiness {
        times,
        ..Steadiness::default()
    });
    for stretch in stretches {
        for kind in &mut kinds {
            kind.add(&stretch, period_us as f64 / 1e6);
        }
    }
    let [named, other, opposed] = kinds.map(|kind| kind.left_g2());
    let Some(named) = named.filter(|named| *named > STILL_G.powi(2)) else {
        return Ok(());
    };
    let fits = |left: Option<f64>| left.is_some_and(|left| left < FITS * named);
    match (fits(other), fits(opposed)) {
        (true, _) => Err(other_than(unit)),
        (false, true) => Err(Problem::RateSign),
        (false, false) => Ok(()),
    }
}

/// The problem of a header that names this unit instead of the other one.
const fn other_than(unit: RateUnit) -> Problem {
    Problem::RateUnit {
        named: unit.words(),
        fits: unit.other().words(),
        suffix: unit.other().suffix(),
    }
}

/// How still gravity stands in axes that turn back by so many `times` the rates.
#[derive(Default)]
struct Steadiness {
    times: f64,
    pairs: usize,
    squares: f64,
}

impl Steadiness {
    /// Compares the means of a stretch of steady rows, each with the next.
    fn add(&mut self, rows: &[Turning], period_s: f64) {
        let count = ((MEAN_S / period_s) as usize).max(1);
        let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mut before: Option<[f64; 3]> = None;
        for second in rows.chunks_exact(count) {
            let mut sum = [0.0; 3];
            for Turning {
                accel_g,
                rate_radps,
            } in second
            {
                let angle = rate_radps.map(|rate| self.times * rate * period_s);
                axes = axes.map(|axis| turned(axis, angle));
                for (sum, axis) in sum.iter_mut().zip(axes) {
                    *sum += axis.iter().zip(accel_g).map(|(a, g)| a * g).sum::<f64>();
                }
            }
            let mean = sum.map(|sum| sum / count as f64);
            if let Some(before) = before.replace(mean) {
                let change = std::array::from_fn(|i| mean[i] - before[i]);
                // Axes that spin have no gravity in their mean.
                let spins = norm(mean).min(norm(before)) < SPINS_G;
                self.pairs += 1;
                self.squares += if spins { 1.0 } else { norm(change).powi(2) };
            }
        }
    }

    /// Mean square of the changes, g^2; `None` of too few.
    fn left_g2(&self) -> Option<f64> {
        (self.pairs >= FEWEST).then(|| self.squares / self.pairs as f64)
    }
}

/// What stands still, in axes that turn by an angle (Rodrigues).
fn turned(still: [f64; 3], angle: [f64; 3]) -> [f64; 3] {
    let size = norm(angle);
    if size == 0.0 {
        return still;
    }
    let about = angle.map(|part| part / size);
    let (sine, cosine) = (-size).sin_cos();
    let (along, beside) = (dot(about, still), cross(about, still));
    std::array::from_fn(|i| {
        still[i] * cosine + beside[i] * sine + about[i] * along * (1.0 - cosine)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 s at 100 samples/s that swing by 60 deg about y in 4 s, shaken by 0.5 g.
    fn swings(rate_in: f64) -> Vec<Turning> {
        let angle = |t: f64| 1.05 * (1.57 * t).sin();
        let turning = |n: u32| {
            let t = f64::from(n) / 100.0;
            let rate = 1.05 * 1.57 * (1.57 * t).cos();
            Turning {
                accel_g: [
                    -angle(t).sin() + 0.5 * (18.0 * t).sin(),
                    0.0,
                    angle(t).cos(),
                ],
                rate_radps: [0.0, rate * rate_in, 0.0],
            }
        };
        (0..2000).map(turning).collect()
    }

    fn checked(rows: Vec<Turning>, unit: RateUnit) -> Result<(), Problem> {
        check([rows].into_iter(), 10_000, unit)
    }

    #[test]
    fn degrees_that_are_called_radians_and_the_reverse_are_found() {
        use RateUnit::{DegreePerSecond, RadianPerSecond};
        let degrees = 1f64.to_radians().recip();
        for unit in [DegreePerSecond, RadianPerSecond] {
            for scale in [0.8, 1.0, 1.25] {
                assert_eq!(checked(swings(scale), unit), Ok(()));
            }
        }
        for (times, unit) in [(degrees, RadianPerSecond), (1.0 / degrees, DegreePerSecond)] {
            assert_eq!(checked(swings(times), unit), Err(other_than(unit)));
        }
        let opposed = checked(swings(-1.0), RadianPerSecond);
        assert_eq!(opposed, Err(Problem::RateSign));
    }

    #[test]
    fn a_sensor_that_does_not_turn_shows_nothing() {
        let mut rows = swings(1.0);
        for (turning, n) in rows.iter_mut().zip(0..) {
            turning.accel_g = [0.3 * (0.1 * f64::from(n)).sin(), 0.0, 1.0];
            turning.rate_radps = [0.0, 0.002, 0.0];
        }
        assert_eq!(checked(rows, RateUnit::DegreePerSecond), Ok(()));
        assert_eq!(checked(Vec::new(), RateUnit::DegreePerSecond), Ok(()));
    }

    #[test]
    fn a_rate_has_three_numbers_or_none() {
        let read = |cells| rate_radps(cells, RateUnit::DegreePerSecond);
        let [x, ..] = read(["180", "0", "-90"]).unwrap().unwrap();
        assert!((x - std::f64::consts::PI).abs() < 1e-12);
        assert_eq!(read(["", "", ""]), Ok(None));
        assert_eq!(read(["1", "", "2"]), Err(Reason::MissingCell));
        assert_eq!(read(["1", "x", "2"]), Err(Reason::UnparsableCell));
    }
}
