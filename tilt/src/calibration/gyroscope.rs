//! Calibration of a gyroscope beside a calibrated accelerometer: no reference but gravity.
//!
//! In: rests, for the bias ([`BiasFit`]), and turns between rests, for scale, axis directions and
//! mounting ([`TurnSum`], [`GainFit`]). Rates in rad/s along the sensor's axes, verticals of
//! length 1 in the housing's axes. Out: the numbers of true = M (measured - bias), M housing axis
//! by sensor axis, with their standard uncertainties, and by [`correction`] what the chip applies.
//!
//! A motor may turn the housing about one axis at a time, or a hand along any path. What the turns
//! leave open stays near the nominal value with the uncertainty that a new part has
//! ([`SCALE_PRIOR`], [`ALIGNMENT_PRIOR`]): a motor in two mounts never turns about the third axis.
//!
//! # Accuracy of the arithmetic
//! Each turn begins with the gains found so far ([`GainFit::present`]). With scales off by 3 % and
//! axes by 2 deg one pass over 27 turns of a motor then leaves less than 0.001 % (rad for the
//! directions), over 24 turns by hand less than 0.05 %. A second pass over the same samples, which
//! begins with the gains of the first, leaves less than 0.001 % of both; the tests have the limits.
//!
//! Left out: sensitivity to acceleration, and the turn of the earth, which is in
//! [`Accuracy::bias`].

pub mod bias;
mod equations;
pub mod scale;
#[cfg(test)]
mod tests;
pub mod turn;

pub use bias::{BiasFit, EARTH_RATE, FEWEST_RESTS, FEWEST_TEMPERATURES, FittedBias, LEAST_RANGE};
pub use scale::{FEWEST_SCALE_TURNS, FittedScale, SLOPE_PRIOR, ScaleFit, with_slopes};
pub use turn::{Rotation, Turn, TurnSum};

use super::FitError;
use crate::rate::{RateCorrection, RealRateCorrection};
use equations::Equations;
use turn::minus_identity;

/// Standard deviation of the scale of a part as it comes: 2 %.
///
/// Data sheets of MEMS gyroscopes state a sensitivity tolerance of 1 to 3 % \[ASSUME\].
pub const SCALE_PRIOR: f64 = 0.02;

/// Standard deviation of an axis direction with its mounting: 2 deg, in rad \[ASSUME\].
pub const ALIGNMENT_PRIOR: f64 = 0.035;

/// Fewest turns: two equations each for nine parameters.
pub const FEWEST_TURNS: usize = 5;

/// The largest error of scale, 10 %.
const LARGEST_SCALE: f64 = 0.1;

/// The largest error of an axis direction, 10 deg, in rad.
const LARGEST_ALIGNMENT: f64 = 0.174_533;

/// The largest residual of turns that belong together, deg.
const LARGEST_RESIDUAL_DEG: f64 = 2.0;

/// Only the arithmetic fails above this; the prior bounds every parameter.
const WORST_CONDITION: f64 = 1e12;

/// Radians in degrees.
const DEGREES: f64 = 180.0 / core::f64::consts::PI;

/// Standard deviations (k = 1) of what the turns are made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    /// Of a vertical by the accelerometer in one direction, rad; above 0.
    pub vertical: f64,
    /// Noise density of the gyroscope, one-sided as in data sheets, (rad/s)/sqrt(Hz).
    pub noise: f64,
    /// Of the bias that was removed, rad/s; not below [`EARTH_RATE`] where the earth turns.
    pub bias: f64,
}

impl Accuracy {
    /// Variance of one direction of a turn: two verticals, the noise, and the bias as it adds up
    /// where the axis stands still; rad^2.
    fn variance(&self, duration_s: f64) -> f64 {
        let drift = self.bias * duration_s;
        let walk = self.noise * self.noise * duration_s / 2.0;
        2.0 * self.vertical * self.vertical + walk + drift * drift
    }

    /// Weight of each equation of a turn: 1 / variance, 1/rad^2.
    fn weight(&self, turn: &Turn) -> f64 {
        1.0 / (self.variance(turn.duration_s) + turn.missed * turn.missed)
    }
}

/// Accumulates turns.
#[derive(Clone, Debug)]
pub struct GainFit {
    accuracy: Accuracy,
    /// For M - 1, row by row.
    equations: Equations<9>,
    /// What the turns leave open stays near these.
    prior: [[f64; 3]; 3],
}

/// Fitted scale, axis directions and mounting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedGains {
    /// M: housing axis by sensor axis.
    pub gains: [[f64; 3]; 3],
    /// Standard uncertainty (k = 1) of each entry; that of the prior where the turns leave it
    /// open. It grows with the residual where that is above what [`Accuracy`] lets expect.
    pub uncertainty: [[f64; 3]; 3],
    /// Weighted root mean square of what the fit leaves in one direction of a turn's end, deg.
    pub residual_rms_deg: f64,
    /// Condition figure of the turns with the prior.
    pub condition: f64,
    /// Turns.
    pub turns: usize,
}

impl GainFit {
    /// Without a turn.
    pub fn new(accuracy: Accuracy) -> Self {
        Self {
            accuracy,
            equations: Equations::default(),
            prior: turn::IDENTITY,
        }
    }

    /// Without a turn, near `gains` instead of the nominal ones: those that a part was found with.
    pub fn near(gains: [[f64; 3]; 3], accuracy: Accuracy) -> Self {
        Self {
            prior: gains,
            ..Self::new(accuracy)
        }
    }

    /// Adds a turn.
    pub fn add(&mut self, turn: &Turn) {
        let lines = turn.rows.into_iter().zip(turn.values);
        self.equations.add(lines, self.accuracy.weight(turn));
    }

    /// The gains as far as the turns show them; look at the uncertainty of each.
    ///
    /// Errors: [`FitError::TooFew`] below [`FEWEST_TURNS`]; [`FitError::Implausible`] when a scale
    /// is off by more than 10 %, an axis by more than 10 deg, or the turns contradict each other
    /// by more than 2 deg (rms): a wrong unit, sign or axis, or an accelerometer that is not
    /// calibrated. [`FitError::IllConditioned`] for numbers that no arithmetic copes with.
    pub fn solve(&self) -> Result<FittedGains, FitError> {
        let turns = self.equations.at_least(FEWEST_TURNS)?;
        let solved = self.equations.solve(known_gains(&self.prior))?;
        let gains = plus_identity(solved.numbers);
        if !(plausible(&gains) && solved.residual_rms_deg <= LARGEST_RESIDUAL_DEG) {
            return Err(FitError::Implausible);
        }
        Ok(FittedGains {
            gains,
            uncertainty: rows(solved.uncertainty),
            residual_rms_deg: solved.residual_rms_deg,
            condition: solved.condition,
            turns,
        })
    }

    /// The best known M so far, to begin the next turn with; that which it begins near before the
    /// first one, and where the turns contradict each other.
    pub fn present(&self) -> [[f64; 3]; 3] {
        let found = self.equations.solve(known_gains(&self.prior));
        let gains = found.map(|solved| plus_identity(solved.numbers));
        gains.ok().filter(plausible).unwrap_or(self.prior)
    }

    /// All of the gains, each with a standard uncertainty of at most `largest` (0.001 is 0.1 % of
    /// scale, 0.06 deg of direction).
    ///
    /// Errors: as [`GainFit::solve`], and [`FitError::IllConditioned`] when one is less certain:
    /// turns about an axis or from a pose are missing.
    pub fn solve_all(&self, largest: f64) -> Result<FittedGains, FitError> {
        let fitted = self.solve()?;
        let certain = |u: &f64| *u <= largest;
        if fitted.uncertainty.iter().flatten().all(certain) {
            Ok(fitted)
        } else {
            let condition = fitted.condition;
            Err(FitError::IllConditioned { condition })
        }
    }
}

/// Standard deviations of a part as it comes.
const fn priors() -> [[f64; 3]; 3] {
    const S: f64 = SCALE_PRIOR;
    const A: f64 = ALIGNMENT_PRIOR;
    [[S, A, A], [A, S, A], [A, A, S]]
}

/// What each entry of M - 1 is near where M is near `gains`, with the standard deviation of a part
/// as it comes; row by row.
fn known_gains(gains: &[[f64; 3]; 3]) -> [(f64, f64); 9] {
    let mut known = [(0.0, 0.0); 9];
    let near = minus_identity(gains).into_iter().flatten();
    let both = near.zip(priors().into_iter().flatten());
    for (known, both) in known.iter_mut().zip(both) {
        *known = both;
    }
    known
}

/// From M - 1, row by row, to M.
fn plus_identity(errors: [f64; 9]) -> [[f64; 3]; 3] {
    let [[a, b, c], [d, e, f], [g, h, i]] = rows(errors);
    [[1.0 + a, b, c], [d, 1.0 + e, f], [g, h, 1.0 + i]]
}

const fn rows([a, b, c, d, e, f, g, h, i]: [f64; 9]) -> [[f64; 3]; 3] {
    [[a, b, c], [d, e, f], [g, h, i]]
}

fn plausible(gains: &[[f64; 3]; 3]) -> bool {
    let [[a, b, c], [d, e, f], [g, h, i]] = minus_identity(gains);
    [a, e, i].iter().all(|s| s.abs() <= LARGEST_SCALE)
        && [b, c, d, f, g, h]
            .iter()
            .all(|v| v.abs() <= LARGEST_ALIGNMENT)
}

/// What the chip applies; the slope of the scale ([`ScaleFit`], [`with_slopes`]) is left at 0.
///
/// Errors: [`FitError::Implausible`] when a number does not fit the format.
pub fn correction(bias: &FittedBias, gains: &FittedGains) -> Result<RateCorrection, FitError> {
    RateCorrection::from_real(&RealRateCorrection {
        matrix: gains.gains,
        scale1: [0.0; 3],
        bias: bias.bias,
        bias1: bias.bias1,
        bias2: bias.bias2,
    })
    .ok_or(FitError::Implausible)
}
