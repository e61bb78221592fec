//! The scale of a gyroscope over temperature, from the turns between the rests of a chamber run.
//!
//! In: the turns of each dwell, the calibration with the temperature model of the same run, and
//! the correction that the node held. Out: the slope of each axis of the sensor with its
//! uncertainty, or why it stays. Before and after each turn the reference is gravity by the
//! accelerometer, whose temperature model takes out what it changes by itself; the bias of a turn
//! is that of the rests around it.
//!
//! The fit has the gains as well and does not give them back: those of the node stay as they are
//! at the temperature at which they were found (`tilt::calibration::gyroscope::with_slopes`).
//!
//! A node whose gyroscope was never calibrated gets no slopes, as it gets no bias (`bias`). An axis
//! about which the housing was hardly turned keeps its slope, and it does so in both channels
//! ([`Outcome::keep`]): a channel with slopes expects the other one to have them when it compares
//! the two rates.
//!
//! Left out: following (`turns`), and a scale that bends with temperature.

use tilt::calibration::FitError;
use tilt::calibration::gyroscope::{FEWEST_SCALE_TURNS, FittedScale, ScaleFit};
use tilt::chain::Calibration;
use tilt::rate::RateCorrection;

use super::measured::Measured;
use super::turns::Followed;
use crate::fit::temperature;
use crate::gains::accuracy;

/// Largest standard uncertainty of a slope that the turns show, 1 per degC: 0.003 %/degC, which is
/// less than half of the 0.007 %/degC that parts typically have.
const LARGEST: f64 = 3e-5;

/// Why the scale of a gyroscope keeps the slopes that it had.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoScale {
    /// Its gains are not known.
    #[error("it was never calibrated: let plumb calibrate turn it first, then run this again")]
    Uncalibrated,
    /// Too few turns: how many there are, and what was wrong with most of the others.
    #[error("{0} of its turns can be used and {FEWEST_SCALE_TURNS} are needed{a}", a = most(.1))]
    TooFew(usize, Option<String>),
    /// The fit came to nothing.
    #[error("its turns contradict each other or the gains that it has: {0}")]
    Fit(FitError),
    /// No axis was turned enough: the least uncertainty of a slope, 1 per degC.
    #[error("its turns show no axis: a slope is known to {:.4} %/degC at best (k = 1)", 100.0 * .0)]
    Open(f64),
    /// Each axis that it shows is one that the other gyroscope does not show.
    #[error("no axis is shown by both gyroscopes, and they are compared with each other")]
    Alone,
}

fn most(reason: &Option<String>) -> String {
    let reason = reason.as_ref();
    reason.map_or(String::new(), |why| format!("; of most others: {why}"))
}

/// The slopes of a gyroscope's scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// s of each axis of the sensor, 1 per degC; that of before where the axis is open.
    pub slopes: [f64; 3],
    /// Standard uncertainty (k = 1) of each as the turns show it, 1 per degC.
    pub uncertainty: [f64; 3],
    /// Axes that the turns do not show, of this gyroscope or of the other one.
    pub open: [bool; 3],
    /// Root mean square of what the fit leaves in one direction of a turn's end, deg.
    pub residual_deg: f64,
}

/// What has come of the turns of a channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Turns that could be used.
    pub used: usize,
    /// Why the others could not, each reason with how many.
    pub left_out: Vec<(String, usize)>,
    /// The slopes, or why they stay.
    pub found: Result<Found, NoScale>,
}

/// The slopes of channel `place` from the turns of the run; `None` where none was followed.
///
/// `calibration` is the node's with the temperature model of this run, and `vertical_deg` the
/// standard uncertainty of its vertical in one direction.
pub fn scale(
    measured: &Measured,
    place: usize,
    calibration: &Calibration,
    before: Option<&RateCorrection>,
    vertical_deg: f64,
) -> Option<Outcome> {
    let turns = measured.dwells.iter().flat_map(|dwelt| &dwelt.turns);
    let turns: Vec<&Followed> = turns.filter_map(|turn| turn.get(place)).collect();
    if turns.is_empty() {
        return None;
    }
    let mut outcome = Outcome {
        used: 0,
        left_out: Vec::new(),
        found: Err(NoScale::Uncalibrated),
    };
    if let Some(before) = before {
        let real = before.real();
        let mut fit = ScaleFit::near(real.matrix, real.scale1, accuracy(vertical_deg));
        for turn in turns {
            outcome.add(turn, &mut fit, calibration, before);
        }
        outcome.found = outcome.found(&fit, real.scale1);
    }
    Some(outcome)
}

impl Outcome {
    /// Puts a turn into the fit, or among those that are left out.
    fn add(
        &mut self,
        turn: &Followed,
        fit: &mut ScaleFit,
        calibration: &Calibration,
        before: &RateCorrection,
    ) {
        let taken = match turn {
            Followed::LeftOut { left_out } => Err(left_out.clone()),
            Followed::Turned(turned) => {
                let turn = turned.turn(calibration, before);
                let turn = turn.map_err(|bad| bad.to_string());
                turn.map(|turn| fit.add(&turn, temperature(turned.turn_degc)))
            }
        };
        let Err(why) = taken else {
            self.used += 1;
            return;
        };
        match self.left_out.iter_mut().find(|(reason, _)| *reason == why) {
            Some((_, count)) => *count += 1,
            None => self.left_out.push((why, 1)),
        }
    }

    /// Axes that the turns do not show.
    pub fn open(&self) -> [bool; 3] {
        self.found.as_ref().map_or([true; 3], |found| found.open)
    }

    /// Keeps the slopes of `before`, 1 per degC, on these axes as well.
    pub fn keep(&mut self, open: [bool; 3], before: [f64; 3]) {
        let Ok(found) = &mut self.found else {
            return;
        };
        for (axis, _) in open.iter().enumerate().filter(|(_, open)| **open) {
            found.open[axis] = true;
            found.slopes[axis] = before[axis];
        }
        if found.open == [true; 3] {
            self.found = Err(NoScale::Alone);
        }
    }

    fn found(&self, fit: &ScaleFit, before: [f64; 3]) -> Result<Found, NoScale> {
        let fitted = fit.solve().map_err(|error| match error {
            FitError::TooFew { .. } => {
                let most = self.left_out.iter().max_by_key(|(_, count)| *count);
                NoScale::TooFew(self.used, most.map(|(why, _)| why.clone()))
            }
            other => NoScale::Fit(other),
        })?;
        let FittedScale {
            slopes,
            uncertainty,
            residual_rms_deg,
            ..
        } = fitted;
        let open = uncertainty.map(|u| u > LARGEST);
        if open == [true; 3] {
            return Err(NoScale::Open(uncertainty.into_iter().fold(1.0, f64::min)));
        }
        let slope = |axis: usize| match open[axis] {
            true => before[axis],
            false => slopes[axis],
        };
        Ok(Found {
            slopes: [0, 1, 2].map(slope),
            uncertainty,
            open,
            residual_deg: residual_rms_deg,
        })
    }
}

#[cfg(test)]
#[path = "scale_tests.rs"]
mod tests;
