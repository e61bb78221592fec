//! The scale of a gyroscope over temperature, from turns at several temperatures.
//!
//! In: turns between rests ([`Turn`]), each with the sensor's own [`Temperature`]. Out: s of each
//! axis of the sensor in true = M diag(1 + s d) (measured - bias), d = T - 25 degC, with its
//! standard uncertainty.
//!
//! # How
//! A turn shows the gains at its temperature, M diag(1 + s d). That is linear in M and in s but
//! for their product, which is taken at the values that the fit begins near. Where these gains are
//! off by 3 % and 2 deg that costs less than 8 % of s; the test has the figure. M is fitted with s
//! and not given back: it has the standard deviations of a part as it comes around what the fit
//! begins near, so it does not matter whether that was calibrated. Errors that are the same at
//! each temperature go into M and into the residual.
//!
//! A slope that the turns leave open stays near the one that the fit begins near, with the
//! uncertainty [`SLOPE_PRIOR`].
//!
//! Left out: a scale that bends with temperature, and axes whose directions move.

use super::super::FitError;
use super::equations::Equations;
use super::turn::Turn;
use super::{Accuracy, known_gains, plausible, plus_identity};
use crate::rate::{RateCorrection, RealRateCorrection};
use crate::sample::Temperature;

/// Standard deviation of the slope of a part's scale, 1 per degC: 0.01 %/degC. Data sheets of MEMS
/// gyroscopes state 0.007 %/degC as typical (ISM330DHCX) \[ASSUME\].
pub const SLOPE_PRIOR: f64 = 1e-4;

/// Fewest turns: two equations each for twelve parameters, and two turns more.
pub const FEWEST_SCALE_TURNS: usize = 8;

/// The largest slope, 0.05 %/degC.
const LARGEST_SLOPE: f64 = 5e-4;

/// The largest residual of turns that belong together, deg. Turns beside a calibrated
/// accelerometer leave a tenth of it.
const LARGEST_RESIDUAL_DEG: f64 = 1.0;

/// Accumulates turns at several temperatures.
#[derive(Clone, Debug)]
pub struct ScaleFit {
    accuracy: Accuracy,
    /// For M - 1, row by row, then s of each axis.
    equations: Equations<12>,
    /// M0 and s0: what the fit begins near, and what it stays near where the turns leave it open.
    gains: [[f64; 3]; 3],
    slopes: [f64; 3],
}

/// Fitted slopes of the scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedScale {
    /// s of each axis of the sensor, 1 per degC.
    pub slopes: [f64; 3],
    /// Standard uncertainty (k = 1) of each; [`SLOPE_PRIOR`] where the turns leave it open. It
    /// grows with the residual where that is above what [`Accuracy`] lets expect.
    pub uncertainty: [f64; 3],
    /// Weighted root mean square of what the fit leaves in one direction of a turn's end, deg.
    pub residual_rms_deg: f64,
    /// Condition figure of the turns with the prior.
    pub condition: f64,
    /// Turns.
    pub turns: usize,
}

impl ScaleFit {
    /// Without a turn, near the gains at 25 degC (M, housing axis by sensor axis) and the slopes
    /// (1 per degC) that a part was found with.
    pub fn near(gains: [[f64; 3]; 3], slopes: [f64; 3], accuracy: Accuracy) -> Self {
        Self {
            accuracy,
            equations: Equations::default(),
            gains,
            slopes,
        }
    }

    /// Adds a turn, with the mean temperature of the rests before and after it.
    pub fn add(&mut self, turn: &Turn, temperature: Temperature) {
        let d = (f64::from(temperature.0) - f64::from(Temperature::REFERENCE.0)) / 256.0;
        let ([a, b, c], [x, y, z]) = (turn.rows, turn.values);
        let lines = [(a, x), (b, y), (c, z)].map(|(row, value)| self.equation(row, value, d));
        self.equations.add(lines, self.accuracy.weight(turn));
    }

    /// The slopes as far as the turns show them; look at the uncertainty of each.
    ///
    /// Errors: [`FitError::TooFew`] below [`FEWEST_SCALE_TURNS`]; [`FitError::Implausible`] when a
    /// slope is above 0.05 %/degC, a scale is off by more than 10 % or an axis by more than
    /// 10 deg, or the turns contradict each other by more than 1 deg (rms).
    /// [`FitError::IllConditioned`] for numbers that no arithmetic copes with.
    pub fn solve(&self) -> Result<FittedScale, FitError> {
        let turns = self.equations.at_least(FEWEST_SCALE_TURNS)?;
        let solved = self.equations.solve(self.known())?;
        let [a, b, c, d, e, f, g, h, i, slopes @ ..] = solved.numbers;
        let gains = plus_identity([a, b, c, d, e, f, g, h, i]);
        let flat = slopes.iter().all(|s: &f64| s.abs() <= LARGEST_SLOPE);
        if !(flat && plausible(&gains) && solved.residual_rms_deg <= LARGEST_RESIDUAL_DEG) {
            return Err(FitError::Implausible);
        }
        let [.., x, y, z] = solved.uncertainty;
        Ok(FittedScale {
            slopes,
            uncertainty: [x, y, z],
            residual_rms_deg: solved.residual_rms_deg,
            condition: solved.condition,
            turns,
        })
    }

    /// A line of a turn's equations for the gains at a distance of `d` from 25 degC, as one for
    /// M - 1 and s.
    fn equation(&self, row: [f64; 9], value: f64, d: f64) -> ([f64; 12], f64) {
        let [sx, sy, sz] = self.slopes.map(|s| 1.0 + s * d);
        let [xx, xy, xz, yx, yy, yz, zx, zy, zz] = row;
        let [[mxx, mxy, mxz], [myx, myy, myz], [mzx, mzy, mzz]] = self.gains;
        let by_slope = [
            d * (xx * mxx + yx * myx + zx * mzx),
            d * (xy * mxy + yy * myy + zy * mzy),
            d * (xz * mxz + yz * myz + zz * mzz),
        ];
        // What M0 diag(s0 d) makes of the turn is on the left already, and the identity's share.
        let begun = self.slopes.iter().zip(by_slope.iter().zip([xx, yy, zz]));
        let begun: f64 = begun.map(|(s, (by, own))| s * (by - d * own)).sum();
        let [x, y, z] = by_slope;
        #[rustfmt::skip]
        let row = [
            xx * sx, xy * sy, xz * sz,
            yx * sx, yy * sy, yz * sz,
            zx * sx, zy * sy, zz * sz,
            x, y, z,
        ];
        (row, value + begun)
    }

    /// What each number is near, with its standard deviation.
    fn known(&self) -> [(f64, f64); 12] {
        let [a, b, c, d, e, f, g, h, i] = known_gains(&self.gains);
        let [x, y, z] = self.slopes.map(|slope| (slope, SLOPE_PRIOR));
        [a, b, c, d, e, f, g, h, i, x, y, z]
    }
}

/// A correction with these slopes of the scale, 1 per degC. At the temperature `at`, at which its
/// gains were found, it gives the rates that it gave before. `None` when it does not fit the
/// chip's numbers.
pub fn with_slopes(
    rates: &RateCorrection,
    slopes: [f64; 3],
    at: Temperature,
) -> Option<RateCorrection> {
    let before = rates.real();
    let d = (f64::from(at.0) - f64::from(Temperature::REFERENCE.0)) / 256.0;
    let share = [0, 1, 2].map(|axis| (1.0 + before.scale1[axis] * d) / (1.0 + slopes[axis] * d));
    RateCorrection::from_real(&RealRateCorrection {
        matrix: before
            .matrix
            .map(|row| [0, 1, 2].map(|axis| row[axis] * share[axis])),
        scale1: slopes,
        ..before
    })
}
