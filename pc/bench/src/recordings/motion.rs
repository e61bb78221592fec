//! The vertical by gyroscope and accelerometer, against the reference.
//!
//! In: a [`Prepared`] recording with rates. Out: how far the vertical of `tilt::motion` is from the
//! reference, row by row as they come, and how often the error is within the uncertainty that was
//! stated with it.
//!
//! What a recording shows as a whole is not used, since an instrument would not have it: the
//! accelerations are calibrated where a calibration file was given, and nominal otherwise.
//!
//! Left out: the cross-check of two channels.

use tilt::calibration::algebra::{cross, dot};
use tilt::motion::{Expected, Motion, MotionState, RATE_STEPS, Rate, Vertical};
use tilt::vector::Corrected;

use super::figures::Sums;
use super::prepare::Prepared;
use super::recording::Row;
use super::reference::angle_between_deg;
use super::windows::norm;
use crate::report::replay_data::{CalibrationKind, MovingVertical};

/// The estimator at the recording's pace; `None` at one that it is not for.
fn estimator(channel: &Prepared) -> Option<Motion> {
    Motion::new(&Expected {
        period_s: channel.period_us() as f64 / 1e6,
        delay_s: channel.rate_delay_s,
        ..Expected::INDUSTRIAL
    })
}

/// Whether the estimator can follow at the recording's pace.
pub fn takes(channel: &Prepared) -> bool {
    estimator(channel).is_some()
}

/// Follows a recording; `None` without a gyroscope, or at a pace that the estimator is not for.
pub fn follow(channel: &Prepared) -> Option<MovingVertical> {
    let motion = estimator(channel).filter(|_| channel.recording.has_rate())?;
    let mut state = MotionState::default();
    let mut figures = Figures::default();
    for row in channel.fed() {
        let vertical = step(channel, &motion, &mut state, row);
        let reference = row.reference.and_then(|reference| reference.up());
        if let Some(truth) = reference.filter(|_| row.counts) {
            figures.see(vertical, truth);
        }
    }
    Some(figures.report())
}

/// The vertical at a row; `None` where there is none, which is so behind a gap.
fn step(
    channel: &Prepared,
    motion: &Motion,
    state: &mut MotionState,
    row: &Row,
) -> Option<Vertical> {
    if row.starts_anew {
        state.restart();
    }
    let Some(rate_radps) = row.rate_radps else {
        state.restart();
        return None;
    };
    let accel_g = match channel.how.kind {
        CalibrationKind::File => channel.record.apply(row.accel_g),
        CalibrationKind::Poses | CalibrationKind::Reference | CalibrationKind::Nominal => {
            row.accel_g
        }
    };
    // A float to integer cast stops at the ends of the range.
    let rate = rate_radps.map(|rate| (rate * RATE_STEPS).round() as i32);
    let accel = accel_g.map(|a| (a * f64::from(tilt::ONE_G)).round() as i32);
    motion.step(state, Rate { rate }, Corrected { accel }).ok()
}

/// What is counted.
#[derive(Default)]
struct Figures {
    error: Sums,
    missing: u64,
    stated_deg: Sums,
    directions: u64,
    within: [u64; 2],
}

impl Figures {
    fn see(&mut self, vertical: Option<Vertical>, truth: [f64; 3]) {
        let Some(vertical) = vertical else {
            self.missing += 1;
            return;
        };
        let up = vertical.up.map(f64::from);
        let error_deg = angle_between_deg(up, truth);
        self.error.push(error_deg);
        let stated_deg = vertical.uncertainty.degrees();
        self.stated_deg.push(stated_deg);
        for part in across(up, truth) {
            self.directions += 1;
            for (within, k) in self.within.iter_mut().zip([2.0, 3.0]) {
                *within += u64::from((part * error_deg).abs() <= k * stated_deg);
            }
        }
    }

    fn report(&self) -> MovingVertical {
        let percent = |count: u64| {
            (self.directions > 0).then(|| 100.0 * count as f64 / self.directions as f64)
        };
        let [within_2u_percent, within_3u_percent] = self.within.map(percent);
        MovingVertical {
            compared: self.error.count,
            without: self.missing,
            rms_deg: self.error.rms(),
            max_deg: self.error.largest(),
            uncertainty_deg: self.stated_deg.rms(),
            within_2u_percent,
            within_3u_percent,
        }
    }
}

/// The shares of the error in two directions across the vertical, as parts of its size.
fn across(up: [f64; 3], truth: [f64; 3]) -> [f64; 2] {
    let [ux, uy, uz] = truth;
    let scale = norm(up);
    let error: [f64; 3] = std::array::from_fn(|i| up[i] / scale - truth[i]);
    // One direction is level and across the sensor's axis that is the most level.
    let first = match ux.abs() < uy.abs() {
        true => [0.0, uz, -uy],
        false => [-uz, 0.0, ux],
    };
    let parts = [first, cross(truth, first)].map(|axis| dot(error, axis) / norm(axis));
    let size = parts[0].hypot(parts[1]);
    parts.map(|part| if size > 0.0 { part / size } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_divided_between_two_directions() {
        for truth in [
            [0.0, 0.0, 1.0],
            [0.6, 0.0, 0.8],
            [1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
        ] {
            let parts = across([0.3, 0.5, 0.9], truth);
            assert!((parts[0].hypot(parts[1]) - 1.0).abs() < 1e-12, "{truth:?}");
        }
        let [first, second] = across([0.0, 0.01, 1.0], [0.0, 0.0, 1.0]);
        assert!(first.abs() < 1e-9 && (second.abs() - 1.0).abs() < 1e-9);
    }
}
