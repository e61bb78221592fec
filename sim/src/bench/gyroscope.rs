//! The calibration of the gyroscopes: bias and scale over temperature by the chamber, scale and
//! axes by turns of the motor.
//!
//! In: an instrument whose accelerometers are calibrated, and what the chamber has shown: the bias
//! over temperature, and turns where it is coldest and hottest. Out: each node's
//! [`RateCorrection`], set in its calibration, and a [`GyroscopeReport`]. The reference is gravity
//! as the node's own accelerometer shows it before and after each turn.
//!
//! The motor turns the housing about each of its axes, from rest to rest by 90 and by 180 deg. The
//! gains are those of these turns, at the temperature at which they were made; those of the
//! chamber give the slopes of the scale, as those of `plumb characterise` do.
//!
//! Left out: what the scale does under acceleration.

use tilt::calibration::FitError;
use tilt::calibration::gyroscope::{
    Accuracy, EARTH_RATE, FittedBias, FittedGains, FittedScale, GainFit, ScaleFit, correction,
    with_slopes,
};
use tilt::chain::Chain;
use tilt::rate::RateCorrection;
use tilt::sample::Temperature;

use super::turns::Turned;
use super::{Bench, BenchError, Mode};

/// Where the motor rests in each mount, deg: turns of 90 and 180 deg, to and fro, and nowhere back
/// to where one began.
const STATIONS_DEG: [f64; 8] = [-90.0, 0.0, 90.0, -90.0, 45.0, -45.0, 90.0, 0.0];

/// What the turns are known to: the vertical to 0.02 deg, noise of 5 mdps per root of Hz, and the
/// bias of the rests around the turn, to which the earth adds.
const ACCURACY: Accuracy = Accuracy {
    vertical: 0.02 * DEGREE,
    noise: 0.005 * DEGREE,
    bias: 2.0 * EARTH_RATE,
};

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// The largest standard uncertainty of a gain.
const LARGEST: f64 = 0.001;

/// The largest standard uncertainty of a slope of the scale, 1 per degC: that of
/// `plumb characterise`.
const LARGEST_SLOPE: f64 = 3e-5;

const STEP: &str = "gyroscope calibration";

/// How the calibration of a gyroscope went, for one node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroscopeReport {
    /// Bias over temperature, with its uncertainty.
    pub bias: FittedBias,
    /// Scale and axes, with their uncertainties.
    pub gains: FittedGains,
    /// Slopes of the scale over temperature, with their uncertainties.
    pub scale: FittedScale,
}

impl Bench {
    /// Calibrates both gyroscopes by turns of the motor; nothing where the mode has none.
    ///
    /// Errors: a fit that is refused, a silent node.
    pub fn calibrate_gyroscopes(&mut self) -> Result<Option<[GyroscopeReport; 2]>, BenchError> {
        let (Mode::Dynamic, Some(biases)) = (self.mode, self.biases) else {
            return Ok(None);
        };
        let turns = self.turn_in_all_mounts(&STATIONS_DEG, STEP)?;
        let mut reports = Vec::new();
        for (node, turns) in turns.iter().enumerate() {
            let chain = &mut self.instrument.sides[node].settings.chain;
            let fitted = fit(chain, biases[node], turns, &self.warm_turns[node]);
            let (report, rates) = fitted.map_err(|error| BenchError::Fit {
                step: STEP,
                node: node + 1,
                error,
            })?;
            chain.calibration.rates = Some(rates);
            reports.push(report);
        }
        Ok(reports.try_into().ok())
    }

    /// Takes the slopes of the scale out of both nodes' settings, as if no gyroscope had been
    /// turned in a chamber; at the temperature of now nothing changes. It counts from the next
    /// start on.
    pub fn forget_slopes(&mut self) {
        for side in &mut self.instrument.sides {
            let rates = &mut side.settings.chain.calibration.rates;
            let now = side.node.channel.temperature();
            let now = now.unwrap_or(Temperature::REFERENCE);
            *rates = rates.and_then(|rates| with_slopes(&rates, [0.0; 3], now));
        }
    }
}

/// One node's gyroscope: its bias by the chamber, turns of the motor, and those of the chamber.
fn fit(
    chain: &Chain,
    mut bias: FittedBias,
    turns: &[Turned],
    warm_turns: &[Turned],
) -> Result<(GyroscopeReport, RateCorrection), FitError> {
    let gains = fit_gains(chain, turns)?;
    let scale = fit_scale(chain, &gains, warm_turns)?;
    let above = mean_above(&bias, turns);
    for (bias, above) in bias.bias.iter_mut().zip(above) {
        *bias += above;
    }
    let rates = correction(&bias, &gains)?;
    let rates = with_slopes(&rates, scale.slopes, mean_temperature(turns));
    let report = GyroscopeReport { bias, gains, scale };
    Ok((report, rates.ok_or(FitError::Implausible)?))
}

fn fit_gains(chain: &Chain, turns: &[Turned]) -> Result<FittedGains, FitError> {
    let mut fit = GainFit::new(ACCURACY);
    for turned in turns {
        fit.add(&turned.turn(chain, fit.present())?);
    }
    fit.solve_all(LARGEST)
}

/// The slopes of the scale, all of them.
fn fit_scale(
    chain: &Chain,
    gains: &FittedGains,
    warm_turns: &[Turned],
) -> Result<FittedScale, FitError> {
    let mut fit = ScaleFit::near(gains.gains, [0.0; 3], ACCURACY);
    for turned in warm_turns {
        fit.add(&turned.turn(chain, gains.gains)?, turned.temperature());
    }
    let fitted = fit.solve()?;
    let condition = fitted.condition;
    match fitted.uncertainty.iter().all(|u| *u <= LARGEST_SLOPE) {
        true => Ok(fitted),
        false => Err(FitError::IllConditioned { condition }),
    }
}

/// Mean over the rests of what was read above the bias of the chamber, rad/s.
fn mean_above(bias: &FittedBias, turns: &[Turned]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for turned in turns {
        let chamber = bias.at(turned.before.temperature);
        let above = turned.before.rate.iter().zip(chamber);
        for (sum, (rate, chamber)) in sum.iter_mut().zip(above) {
            *sum += rate - chamber;
        }
    }
    sum.map(|sum| sum / turns.len().max(1) as f64)
}

/// At which the gains were found.
fn mean_temperature(turns: &[Turned]) -> Temperature {
    let sum: i64 = turns.iter().map(|t| i64::from(t.temperature().0)).sum();
    Temperature((sum / turns.len().max(1) as i64) as i32)
}
