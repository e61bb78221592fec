//! The bias of a gyroscope over temperature, from rests.
//!
//! In: the mean rate of each rest, rad/s along the sensor's axes, and the sensor's own
//! [`Temperature`] meanwhile. Out: bias = b0 + b1 d + b2 d^2 of each axis, d = T - 25 degC.
//!
//! Rests that differ by less than [`LEAST_RANGE`] give b0 alone, as their mean: a slope from them
//! would be noise. Wider ones, as of a run in a chamber, give the quadratic.
//!
//! Left out: the turn of the earth, [`EARTH_RATE`]. It is in every mean, and its direction in the
//! sensor's axes is unknown; so it is part of the uncertainty. Sensitivity to acceleration is left
//! out too; rests in several poses let it show in the residual.

use super::super::FitError;
use super::super::least_squares::{Normal, square_root};
use crate::sample::Temperature;
use crate::uncertainty::Span;

/// The turn of the earth: 360 deg in a sidereal day of 86 164 s, in rad/s (0.0042 deg/s).
pub const EARTH_RATE: f64 = 7.292e-5;

/// Rests whose temperatures differ by less do not show slopes; 2^-8 degC (20 degC).
pub const LEAST_RANGE: i32 = 20 * 256;

/// Fewest rests for b0; of two the difference shows their scatter.
pub const FEWEST_RESTS: usize = 2;

/// Fewest rests for the quadratic, one more than it has parameters.
pub const FEWEST_TEMPERATURES: usize = 4;

/// The largest bias, 20 deg/s, in rad/s.
const LARGEST: f64 = 0.349_066;

/// The largest slope, 0.1 (deg/s)/degC, in rad/s per degC.
const LARGEST_SLOPE: f64 = 0.001_745_33;

/// The largest coefficient of the square, 0.001 (deg/s)/degC^2, in rad/s per degC^2.
const LARGEST_SQUARE: f64 = 0.000_017_453_3;

/// With a condition above this the temperatures stand in two or three heaps, and the quadratic
/// between them follows the noise.
const WORST_CONDITION: f64 = 1e4;

/// Radians in degrees.
const DEGREES: f64 = 180.0 / core::f64::consts::PI;

/// Accumulates rests.
#[derive(Clone, Debug)]
pub struct BiasFit {
    mean: Normal<1, 3>,
    quadratic: Normal<3, 3>,
    /// Sum of squares of the rates of each axis.
    squares: [f64; 3],
    temperatures: Span,
}

impl Default for BiasFit {
    fn default() -> Self {
        Self {
            mean: Normal::default(),
            quadratic: Normal::default(),
            squares: [0.0; 3],
            temperatures: Span::NOWHERE,
        }
    }
}

/// A fitted bias of the sensor's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedBias {
    /// b0, at 25 degC, rad/s; without slopes the mean, which holds at `temperatures`.
    pub bias: [f64; 3],
    /// b1, rad/s per degC; 0 where the temperatures were too alike.
    pub bias1: [f64; 3],
    /// b2, rad/s per degC^2; 0 where the temperatures were too alike.
    pub bias2: [f64; 3],
    /// Standard uncertainty (k = 1) of the bias at the temperatures of the rests, in mean over
    /// them, rad/s: what the residual leaves, and of [`EARTH_RATE`] what falls on one axis.
    pub uncertainty: [f64; 3],
    /// Standard deviation of one rest around the fit, rad/s.
    pub scatter: [f64; 3],
    /// Standard uncertainty of b0, b1 and b2 where that of each rest is 1 and they are
    /// independent: 1, 1/degC, 1/degC^2; 0 of one that was not fitted.
    pub shares: [f64; 3],
    /// Root mean square of what the fit leaves, over rests and axes, deg/s.
    pub residual_rms_deg_s: f64,
    /// Condition figure of the rests; 1 without slopes.
    pub condition: f64,
    /// From the lowest to the highest temperature of the rests.
    pub temperatures: Span,
    /// Rests.
    pub rests: usize,
}

impl BiasFit {
    /// Adds a rest: its mean rate (rad/s, sensor's axes) and its temperature.
    pub fn add(&mut self, mean_rate: [f64; 3], temperature: Temperature) {
        let d = tens_of_degrees(temperature);
        self.mean.add([1.0], mean_rate, 1.0);
        self.quadratic.add([1.0, d, d * d], mean_rate, 1.0);
        for (square, rate) in self.squares.iter_mut().zip(mean_rate) {
            *square += rate * rate;
        }
        self.temperatures = self.temperatures.widened(temperature);
    }

    /// The bias, as a quadratic where the temperatures allow it.
    ///
    /// Errors: [`FitError::TooFew`] below [`FEWEST_RESTS`], and with [`LEAST_RANGE`] below
    /// [`FEWEST_TEMPERATURES`]; [`FitError::IllConditioned`] where most of these are alike;
    /// [`FitError::Implausible`] above 20 deg/s, 0.1 (deg/s)/degC or 0.001 (deg/s)/degC^2, which
    /// deg/s taken as rad/s exceeds, and where a rate is not a number.
    pub fn solve(&self) -> Result<FittedBias, FitError> {
        let Span { low, high } = self.temperatures;
        let wide = high.0.saturating_sub(low.0) >= LEAST_RANGE;
        let need = if wide {
            FEWEST_TEMPERATURES
        } else {
            FEWEST_RESTS
        };
        let have = self.mean.rows();
        if have < need {
            return Err(FitError::TooFew { have, need });
        }
        let (axes, left, condition) = if wide {
            let (axes, condition) = self.quadratic.solve_within(WORST_CONDITION)?;
            let left = self.quadratic.left_over(&axes, self.squares);
            (axes, left, condition)
        } else {
            let (means, condition) = self.mean.solve()?;
            let left = self.mean.left_over(&means, self.squares);
            (means.map(|[mean]| [mean, 0.0, 0.0]), left, condition)
        };
        let shares = if wide {
            let [v0, v1, v2] = self.quadratic.variances().map(square_root);
            [v0, v1 / 10.0, v2 / 100.0]
        } else {
            [1.0 / square_root(have as f64), 0.0, 0.0]
        };
        self.fitted(axes, left, condition, shares)
    }

    fn fitted(
        &self,
        axes: [[f64; 3]; 3],
        left: [f64; 3],
        condition: f64,
        shares: [f64; 3],
    ) -> Result<FittedBias, FitError> {
        let bias = axes.map(|[b0, _, _]| b0);
        let bias1 = axes.map(|[_, b1, _]| b1 / 10.0);
        let bias2 = axes.map(|[_, _, b2]| b2 / 100.0);
        let within = |values: &[f64; 3], limit: f64| values.iter().all(|v| v.abs() <= limit);
        let plausible = within(&bias, LARGEST)
            && within(&bias1, LARGEST_SLOPE)
            && within(&bias2, LARGEST_SQUARE);
        if !plausible {
            return Err(FitError::Implausible);
        }
        let rests = self.mean.rows();
        let parameters = shares.iter().filter(|share| **share > 0.0).count();
        let free = rests.saturating_sub(parameters).max(1) as f64;
        // The mean of the fitted values' variances is that of one rest by parameters / rests.
        let share = parameters as f64 / rests as f64;
        let earth = EARTH_RATE * EARTH_RATE / 3.0;
        let mean_square = left.iter().sum::<f64>() / (3.0 * rests as f64);
        Ok(FittedBias {
            bias,
            bias1,
            bias2,
            uncertainty: left.map(|sum| square_root(sum / free * share + earth)),
            scatter: left.map(|sum| square_root(sum / free)),
            shares,
            residual_rms_deg_s: square_root(mean_square) * DEGREES,
            condition,
            temperatures: self.temperatures,
            rests,
        })
    }
}

impl FittedBias {
    /// The bias at `temperature`, rad/s: what to take from a sample before its turn is summed up.
    pub fn at(&self, temperature: Temperature) -> [f64; 3] {
        let d = 10.0 * tens_of_degrees(temperature);
        let mut bias = self.bias;
        for (bias, (b1, b2)) in bias.iter_mut().zip(self.bias1.iter().zip(self.bias2)) {
            *bias += d * (b1 + d * b2);
        }
        bias
    }
}

/// Distance from 25 degC in 10 degC: near 1, so the condition figure means something.
fn tens_of_degrees(temperature: Temperature) -> f64 {
    (f64::from(temperature.0) - f64::from(Temperature::REFERENCE.0)) / 2560.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const RAD: f64 = core::f64::consts::PI / 180.0;

    fn celsius(t: f64) -> Temperature {
        Temperature((t * 256.0) as i32)
    }

    /// 1 deg/s, -2 deg/s and 0.5 deg/s with slopes, and up to 2 mdeg/s of scatter.
    fn rate(t: f64, n: usize) -> [f64; 3] {
        let d = t - 25.0;
        let scatter = [0.001, -0.002, 0.0005, 0.0015][n % 4];
        [
            1.0 + 0.01 * d + 1e-4 * d * d + scatter,
            -2.0 - 0.02 * d + scatter,
            0.5 - 2e-4 * d * d - scatter,
        ]
        .map(|v| v * RAD)
    }

    fn rests(temperatures: impl IntoIterator<Item = f64>) -> BiasFit {
        let mut fit = BiasFit::default();
        for (n, t) in temperatures.into_iter().enumerate() {
            fit.add(rate(t, n), celsius(t));
        }
        fit
    }

    #[test]
    fn a_run_in_the_chamber_gives_the_quadratic() {
        let fitted = rests((0..9).map(|n| -10.0 + 10.0 * f64::from(n)))
            .solve()
            .unwrap();
        for t in [-10.0, 5.0, 25.0, 70.0] {
            for (axis, expected) in rate(t, 3).into_iter().enumerate() {
                let error = (fitted.at(celsius(t))[axis] - expected) / RAD;
                assert!(error.abs() < 0.005, "{t} degC, axis {axis}: {error} deg/s");
            }
        }
        assert!((fitted.bias1[1] / RAD + 0.02).abs() < 1e-4);
        assert!((fitted.bias2[2] / RAD + 2e-4).abs() < 3e-6);
        assert!((0.0003..0.002).contains(&fitted.residual_rms_deg_s));
        let share = EARTH_RATE / 3f64.sqrt();
        assert!(
            fitted
                .uncertainty
                .iter()
                .all(|u| (share..1.2 * share).contains(u))
        );
        assert_eq!(fitted.temperatures, Span::CHAMBER);
        // A slope of points 10 degC apart by hand; the axes scatter by some mdeg/s.
        assert!((fitted.shares[1] - 1.0 / 6000f64.sqrt()).abs() < 0.004);
        assert!(
            fitted
                .scatter
                .iter()
                .all(|s| (0.0005..0.003).contains(&(s / RAD)))
        );
    }

    #[test]
    fn rests_at_one_temperature_give_their_mean_and_no_slopes() {
        let fitted = rests([24.0, 26.0, 24.0, 26.0]).solve().unwrap();
        assert_eq!((fitted.bias1, fitted.bias2), ([0.0; 3], [0.0; 3]));
        assert!((fitted.bias[1] / RAD + 2.0).abs() < 0.002);
        assert_eq!((fitted.rests, fitted.condition), (4, 1.0));
        assert_eq!(fitted.shares, [0.5, 0.0, 0.0]);
        // Far away it goes on as it is.
        assert_eq!(fitted.at(celsius(60.0)), fitted.bias);
    }

    #[test]
    fn too_few_rests_and_heaps_of_temperatures_are_refused() {
        let need = |have, need| Err(FitError::TooFew { have, need });
        assert_eq!(rests([]).solve(), need(0, 2));
        assert_eq!(rests([25.0]).solve(), need(1, 2));
        assert_eq!(rests([25.0, 45.0, 60.0]).solve(), need(3, 4));
        let heaps = rests([25.0, 25.1, 25.2, 55.0, 55.1]).solve();
        assert!(
            matches!(heaps, Err(FitError::IllConditioned { .. })),
            "{heaps:?}"
        );
    }

    #[test]
    fn degrees_taken_as_radians_and_what_is_no_number_are_implausible() {
        for rate in [
            [0.0, 0.5, 0.0],
            [f64::NAN, 0.0, 0.0],
            [0.0, 0.0, f64::INFINITY],
        ] {
            let mut fit = BiasFit::default();
            fit.add(rate, celsius(25.0));
            fit.add(rate, celsius(25.0));
            assert_eq!(fit.solve(), Err(FitError::Implausible));
        }
    }
}
