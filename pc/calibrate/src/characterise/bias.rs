//! The bias of a gyroscope over temperature, from the rests of a chamber run.
//!
//! In: what each orientation of each dwell has given, and the correction that the node held. Out:
//! the same correction with another bias, or why it stays.
//!
//! A node whose gyroscope was never calibrated gets none: its gains are not known, and with a
//! correction it would take part in the angle. Its gains come first (`plumb calibrate`), which
//! keeps slopes of the bias that a later chamber run gives.
//!
//! Left out: scale over temperature, for which the housing would have to be turned in the chamber.

use tilt::calibration::FitError;
use tilt::calibration::gyroscope::{BiasFit, FittedBias};
use tilt::rate::{RateCorrection, RealRateCorrection};

use super::measured::Measured;
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
    /// The rests do not show it.
    #[error("the rests give no bias over temperature: {0}")]
    Fit(FitError),
}

/// The bias of channel `place` over the temperatures of the run, and the correction with it; `None`
/// where the run has followed no gyroscope.
pub fn bias(
    measured: &Measured,
    place: usize,
    before: Option<&RateCorrection>,
) -> Option<Result<(FittedBias, RateCorrection), NoBias>> {
    let mut fit = BiasFit::default();
    let mut rests = 0;
    let all = measured.dwells.iter().flat_map(|dwelt| &dwelt.orientations);
    for felt in all.filter_map(|felt| felt.get(place)) {
        if let Some(rate) = felt.rate_rad_s {
            fit.add(rate, temperature(felt.sensor_degc));
            rests += 1;
        }
    }
    (rests > 0).then(|| {
        let before = before.ok_or(NoBias::Uncalibrated)?;
        let fitted = fit.solve().map_err(NoBias::Fit)?;
        let rates = RateCorrection::from_real(&RealRateCorrection {
            bias: fitted.bias,
            bias1: fitted.bias1,
            bias2: fitted.bias2,
            ..before.real()
        });
        let rates = rates.ok_or(NoBias::Fit(FitError::Implausible))?;
        Ok((fitted, rates))
    })
}
