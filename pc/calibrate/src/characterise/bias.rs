//! The bias of a gyroscope over temperature, from the rests of a chamber run.
//!
//! In: what each orientation of each dwell has given, and the correction that the node held. Out:
//! the same correction with another bias and its uncertainty, or why it stays.
//!
//! The fit takes the mean of each dwell. Acceleration changes the bias from orientation to
//! orientation, alike at each dwell, and the thermometer and the hysteresis change it alike for
//! all orientations of a dwell; so the orientations are no independent observations. A dwell
//! without the rate of one of them is left out, since its mean would be of other orientations. In
//! the mean of a motor's four, a tetrahedron, what is linear in the acceleration cancels.
//!
//! # Uncertainty (k = 1)
//! - b0, b1, b2 by what the dwells leave (type A), or by what the orientations of a dwell differ
//!   by, as a mean of them, where that is more: few dwells may fit by luck.
//! - b0 also by the mean of the orientations, alike at each dwell, and by the turn of the earth.
//!
//! A node whose gyroscope was never calibrated gets none: its gains are not known, and with a
//! correction it would take part in the angle. Its gains come first (`plumb calibrate`), which
//! keeps slopes of the bias that a later chamber run gives.
//!
//! Left out: scale over temperature (`scale`); what acceleration does to the bias where the profile
//! has one orientation (`piecewise`).

use tilt::calibration::FitError;
use tilt::calibration::gyroscope::{BiasFit, EARTH_RATE, FittedBias};
use tilt::rate::{RateCorrection, RealRateCorrection};

use super::measured::{Dwelt, Measured};
use super::thermal::{MeanReading, between_runs, hysteresis, rms};
use crate::fit::temperature;

/// Why a gyroscope keeps the bias that it had.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoBias {
    /// Its gains are not known.
    #[error(
        "it was never calibrated: let plumb calibrate turn it first, then run this again for the \
         bias over temperature"
    )]
    Uncalibrated,
    /// A temperature of the profile, degC, at which it was not followed.
    #[error(
        "at {0} degC it was not followed at each rest: its samples stay away, or the bus is slow"
    )]
    Unfollowed(f64),
    /// The dwells do not show it.
    #[error("the dwells give no bias over temperature: {0}")]
    Fit(FitError),
}

/// The bias of a gyroscope over the temperatures of a run.
#[derive(Clone, Debug)]
pub struct Found {
    /// The correction with it.
    pub rates: RateCorrection,
    /// Standard uncertainty (k = 1) of b0, b1 and b2 of each axis of the sensor: rad/s, rad/s per
    /// degC, rad/s per degC^2.
    pub uncertainty: [[f64; 3]; 3],
    /// Rests that it comes from.
    pub rests: usize,
    /// Rests of the run that it does not come from.
    pub left_out: usize,
    /// Root mean square of what it leaves at a rest, deg/s.
    pub residual_deg_s: f64,
    /// Half the difference of both branches of each axis, at most, deg/s; none where no temperature
    /// was met on both.
    pub hysteresis_deg_s: Option<[f64; 3]>,
    /// Root mean square of the difference between runs, deg/s; none of a single one.
    pub between_runs_deg_s: Option<f64>,
}

/// The rests of one dwell.
struct Rests {
    mean_readings: Vec<MeanReading>,
    rates: Vec<[f64; 3]>,
    mean: [f64; 3],
    temperature_c: f64,
}

/// The bias of channel `place` over the temperatures of the run; `None` where the run has no
/// gyroscope.
pub fn bias(
    measured: &Measured,
    place: usize,
    before: Option<&RateCorrection>,
) -> Option<Result<Found, NoBias>> {
    let felt = measured.dwells.iter().flat_map(|dwelt| &dwelt.orientations);
    let mut felt = felt.filter_map(|felt| felt.get(place));
    let any = felt.any(|felt| felt.rate_rad_s.is_some());
    // An instrument without a gyroscope takes no correction of one.
    (any || before.is_some()).then(|| {
        let before = before.ok_or(NoBias::Uncalibrated)?;
        found(measured, place, before)
    })
}

fn found(measured: &Measured, place: usize, before: &RateCorrection) -> Result<Found, NoBias> {
    let mean_readings = measured.mean_readings(place);
    let whole = |dwelt: &Dwelt| rests(dwelt, place, &mean_readings);
    let dwells: Vec<Rests> = measured.dwells.iter().filter_map(whole).collect();
    everywhere(measured, &dwells)?;
    let mut fit = BiasFit::default();
    for dwell in &dwells {
        fit.add(dwell.mean, temperature(dwell.temperature_c));
    }
    let fitted = fit.solve().map_err(NoBias::Fit)?;
    let rates = RateCorrection::from_real(&RealRateCorrection {
        bias: fitted.bias,
        bias1: fitted.bias1,
        bias2: fitted.bias2,
        ..before.real()
    });
    let left = left_deg_s(&dwells, &fitted);
    let used: Vec<MeanReading> = dwells
        .iter()
        .flat_map(|d| d.mean_readings.clone())
        .collect();
    Ok(Found {
        rates: rates.ok_or(NoBias::Fit(FitError::Implausible))?,
        uncertainty: uncertainty(&dwells, &fitted),
        rests: used.len(),
        left_out: mean_readings.len() - used.len(),
        residual_deg_s: rms(&left),
        hysteresis_deg_s: hysteresis(&measured.begun.profile, &used, &left),
        between_runs_deg_s: between_runs(&used, &left),
    })
}

/// The rests of a dwell; `None` where the gyroscope was not followed at each.
fn rests(dwelt: &Dwelt, place: usize, mean_readings: &[MeanReading]) -> Option<Rests> {
    let here = |mean_reading: &&MeanReading| {
        (mean_reading.run, mean_reading.step) == (dwelt.run, dwelt.step)
    };
    let mean_readings: Vec<MeanReading> = mean_readings.iter().filter(here).copied().collect();
    let felt = dwelt.orientations.iter();
    let rates = felt.map(|felt| felt.get(place)?.rate_rad_s);
    let rates = rates.collect::<Option<Vec<_>>>()?;
    let count = rates.len() as f64;
    let temperatures: f64 = mean_readings
        .iter()
        .map(|mean_reading| mean_reading.temperature_c)
        .sum();
    (!rates.is_empty()).then(|| Rests {
        mean: [0, 1, 2].map(|axis| rates.iter().map(|rate| rate[axis]).sum::<f64>() / count),
        temperature_c: temperatures / count,
        mean_readings,
        rates,
    })
}

/// Each temperature of the profile has a dwell: a parabola far from its points is none.
fn everywhere(measured: &Measured, dwells: &[Rests]) -> Result<(), NoBias> {
    let steps = &measured.begun.profile.steps;
    let degc = |step: usize| steps.get(step).map(|step| step.temperature_degc);
    let is_there = |at: f64| {
        let mut mean_readings = dwells.iter().flat_map(|dwell| &dwell.mean_readings);
        mean_readings.any(|mean_reading| degc(mean_reading.step) == Some(at))
    };
    let mut all = steps.iter().map(|step| step.temperature_degc);
    all.find(|at| !is_there(*at))
        .map_or(Ok(()), |at| Err(NoBias::Unfollowed(at)))
}

/// What the bias leaves at each rest, deg/s.
fn left_deg_s(dwells: &[Rests], fitted: &FittedBias) -> Vec<[f64; 3]> {
    let of = |dwell: &Rests| -> Vec<[f64; 3]> {
        let at = fitted.at(temperature(dwell.temperature_c));
        let left = |rate: &[f64; 3]| [0, 1, 2].map(|axis| (rate[axis] - at[axis]).to_degrees());
        dwell.rates.iter().map(left).collect()
    };
    dwells.iter().flat_map(of).collect()
}

/// Standard uncertainty of b0, b1 and b2 of each axis.
fn uncertainty(dwells: &[Rests], fitted: &FittedBias) -> [[f64; 3]; 3] {
    let earth = EARTH_RATE * EARTH_RATE / 3.0;
    [0, 1, 2].map(|axis| {
        let orientations = of_orientations(dwells, axis);
        let dwell = fitted.scatter[axis].max(orientations);
        let [b0, b1, b2] = fitted.shares.map(|share| share * dwell);
        [
            (b0 * b0 + orientations * orientations + earth).sqrt(),
            b1,
            b2,
        ]
    })
}

/// Standard deviation of the mean of a dwell's orientations by their differences, pooled, rad/s; 0
/// of one orientation.
fn of_orientations(dwells: &[Rests], axis: usize) -> f64 {
    let squares = |dwell: &Rests| -> f64 {
        let off = dwell.rates.iter().map(|rate| rate[axis] - dwell.mean[axis]);
        off.map(|off| off * off).sum()
    };
    let sum: f64 = dwells.iter().map(squares).sum();
    let rests: usize = dwells.iter().map(|dwell| dwell.rates.len()).sum();
    let free = rests.saturating_sub(dwells.len()).max(1) as f64;
    let each = rests as f64 / dwells.len().max(1) as f64;
    (sum / free / each.max(1.0)).sqrt()
}

#[cfg(test)]
#[path = "bias_tests.rs"]
mod tests;
