//! From standstills to a calibration: by gravity's length, or by the recording's reference.
//!
//! In: [`Segment`]s. Out: [`Fit`], an affine correction in real numbers with the figures that
//! show how good it is. By poses: nine parameters from |a| = 1 g (`tilt::calibration::poses`),
//! which leave the mounting open. By reference: a rotation and three offsets, nothing that would
//! bend the sensor's axes to a reference that may itself be off by degrees.

use tilt::calibration::algebra::{minus, plus};
use tilt::calibration::least_squares::times;
use tilt::calibration::{FitError, poses};
use tilt::sample::Temperature;
use tilt::uncertainty::{Span, TCO, Uncertainty};
use tilt::vector::Vector;

use super::calibration_file::{BudgetSteps, Channel, HarmonicSteps, Method, base_name};
use super::error::CalibrateError;
use super::recording::Recording;
use super::reference::angle_between_deg;
use super::rotation::best_rotation;
use super::segments::{Segment, Standstill};
use super::windows::norm;

/// Turn-on repeatability, mg: 0.3 mg at the calibration and 0.3 mg at the measurement. \[ASSUME\]
pub const REPEATABILITY_MG: f64 = 0.3 * std::f64::consts::SQRT_2;

/// Thermal hysteresis 5 degC away from the standstills, mg; counts where a temperature is recorded.
/// \[ASSUME\]
pub const HYSTERESIS_MG: f64 = 0.5;

/// Zero-g offset of a sensor that is not calibrated, mg: what data sheets of MEMS parts call
/// typical (LIS2DW12: 20 mg).
const NOMINAL_OFFSET_MG: f64 = 20.0;

/// A calibration in real numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// How it was come by.
    pub method: Method,
    /// Housing axis by sensor axis, g per g.
    pub matrix: [[f64; 3]; 3],
    /// Added after the matrix, g.
    pub offset_g: [f64; 3],
    /// Standstills used.
    pub poses: usize,
    /// Root mean square of the length at standstill minus 1 g, in mg. Each standstill counts by
    /// its samples: the mean of two seconds is worth less than that of twenty.
    pub norm_residual_mg: f64,
    /// The same of the one standstill that is furthest off, in mg.
    pub worst_norm_mg: f64,
    /// Root mean square angle to the reference, deg; `None` without a reference.
    pub angle_residual_deg: Option<f64>,
    /// Condition figure; 1 is best, over 1e6 is refused.
    pub condition: f64,
}

impl Fit {
    /// No correction, not yet judged on a recording.
    pub const IDENTITY: Self = Self {
        method: Method::Nominal,
        matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        offset_g: [0.0; 3],
        poses: 0,
        norm_residual_mg: 0.0,
        worst_norm_mg: 0.0,
        angle_residual_deg: None,
        condition: 1.0,
    };

    /// No correction; the segments tell how far gravity is from 1 g by it.
    pub fn nominal(segments: &[Segment]) -> Self {
        Self::IDENTITY.judged_on(segments.iter())
    }

    /// The correction in the chain's integers; `None` when it doesn't fit them.
    pub fn vector(&self) -> Option<Vector> {
        Vector::from_real(self.matrix, self.offset_g)
    }

    /// The corrected acceleration, g.
    pub fn apply(&self, accel_g: [f64; 3]) -> [f64; 3] {
        plus(times(&self.matrix, accel_g), self.offset_g)
    }

    /// The record for a calibration file; `None` when the fit doesn't fit the chain's integers.
    ///
    /// The budget gets what the recording itself tells: the noise of single samples at standstill,
    /// and what the fit left. Repeatability and hysteresis a single recording can't tell; they are
    /// [`REPEATABILITY_MG`] and [`HYSTERESIS_MG`]. It holds at the temperatures of the standstills,
    /// or at 25 degC where none is recorded.
    pub fn channel(&self, recording: &Recording, found: &Standstill) -> Option<Channel> {
        let steps = |mg: f64| (mg / 1000.0 * f64::from(tilt::ONE_G)).round() as u32;
        let mut temperatures = found.segments.iter().filter_map(|s| s.temperature_c);
        let span = match temperatures.next() {
            Some(first) => Span::of(temperatures.chain([first]).map(temperature)),
            None => Span::REFERENCE,
        };
        let left_mg = match self.method {
            Method::Nominal => self.norm_residual_mg.max(NOMINAL_OFFSET_MG),
            _ => self.norm_residual_mg,
        };
        let left_deg = self
            .angle_residual_deg
            .unwrap_or_else(|| (left_mg / 1000.0).to_degrees());
        let about = Channel {
            source: base_name(&recording.file),
            method: self.method,
            poses: u32::try_from(self.poses).unwrap_or(u32::MAX),
            norm_residual_mg: self.norm_residual_mg,
            angle_residual_deg: self.angle_residual_deg,
            rate_hz: recording.rate_hz(),
            numbers_per_g: recording.scale.per_g,
            matrix_q30: [[0; 3]; 3],
            offset_q26: [0; 3],
            matrix: [[0.0; 3]; 3],
            offset_g: [0.0; 3],
            harmonics: [HarmonicSteps::default(); 2],
            temperature: None,
            budget: BudgetSteps {
                noise_q26: steps(1000.0 * found.sample_noise_g()),
                repeatability_q26: steps(REPEATABILITY_MG),
                hysteresis_q26: steps(HYSTERESIS_MG),
                residual_steps: Uncertainty::from_degrees(left_deg).0,
                fitted_at_q8: Some(span.middle().0),
                tco_q26: Some(TCO),
                span_q8: Some([span.low.0, span.high.0]),
                ..BudgetSteps::default()
            },
        };
        Some(Channel::with_vector(about, &self.vector()?))
    }

    /// Fills in the two figures of length.
    fn judged_on<'a>(mut self, segments: impl Iterator<Item = &'a Segment>) -> Self {
        let (mut sum, mut samples) = (0.0, 0.0);
        for segment in segments {
            let left_mg = 1000.0 * (norm(self.apply(segment.mean_g)) - 1.0).abs();
            let count = segment.count as f64;
            sum += count * left_mg * left_mg;
            samples += count;
            self.worst_norm_mg = self.worst_norm_mg.max(left_mg);
        }
        self.norm_residual_mg = (sum / f64::max(samples, 1.0)).sqrt();
        self
    }
}

fn temperature(celsius: f64) -> Temperature {
    Temperature((celsius * 256.0).round() as i32)
}

/// The six directions in which gravity should lie once, in the sensor's axes.
const DIRECTIONS: [(&str, [f64; 3]); 6] = [
    ("+x", [1.0, 0.0, 0.0]),
    ("-x", [-1.0, 0.0, 0.0]),
    ("+y", [0.0, 1.0, 0.0]),
    ("-y", [0.0, -1.0, 0.0]),
    ("+z", [0.0, 0.0, 1.0]),
    ("-z", [0.0, 0.0, -1.0]),
];

/// The directions that no reading comes within 45 deg of.
fn missing(readings: &[[f64; 3]]) -> Vec<&'static str> {
    let far = |direction: [f64; 3]| {
        readings
            .iter()
            .all(|reading| angle_between_deg(*reading, direction) > 45.0)
    };
    DIRECTIONS
        .into_iter()
        .filter(|(_, d)| far(*d))
        .map(|(name, _)| name)
        .collect()
}

/// One reading for each direction: standstills within 1 deg of an earlier one add to its mean,
/// each with the weight of its samples.
fn distinct(segments: &[Segment]) -> Vec<[f64; 3]> {
    let mut groups: Vec<([f64; 3], f64)> = Vec::new();
    for segment in segments {
        let samples = segment.count.max(1) as f64;
        let known = groups
            .iter_mut()
            .find(|(m, _)| angle_between_deg(*m, segment.mean_g) < 1.0);
        match known {
            Some((mean, count)) => {
                *count += samples;
                for (m, new) in mean.iter_mut().zip(segment.mean_g) {
                    *m += (new - *m) * samples / *count;
                }
            }
            None => groups.push((segment.mean_g, samples)),
        }
    }
    groups.into_iter().map(|(mean, _)| mean).collect()
}

/// Nine parameters from standstills by gravity's length alone.
///
/// It takes at least nine poses that differ by more than 1 deg, spread over the sphere.
pub fn calibrate_from_poses(segments: &[Segment]) -> Result<Fit, CalibrateError> {
    let readings = distinct(segments);
    let fitted = poses::fit(&readings).map_err(|error| match error {
        FitError::TooFew { have, need } => CalibrateError::TooFew {
            have,
            need,
            missing: missing(&readings),
        },
        FitError::IllConditioned { condition } => CalibrateError::IllConditioned {
            condition,
            missing: missing(&readings),
        },
        other => CalibrateError::Implausible(other),
    })?;
    let fit = Fit {
        method: Method::Poses,
        matrix: fitted.matrix,
        offset_g: fitted.offset_g,
        poses: segments.len(),
        condition: fitted.condition,
        ..Fit::IDENTITY
    };
    Ok(fit.judged_on(segments.iter()))
}

/// Fewest plateaus for a rotation and three offsets: three directions not on one line.
pub const FEWEST_PLATEAUS: usize = 3;

/// Directions of the reference that lie closer together than this condition are too alike.
const WORST_CONDITION: f64 = 1e3;

/// A rotation and three offsets that bring the sensor onto the recording's reference.
///
/// Least squares over the plateaus, all of the same weight. The scale of the axes stays nominal.
pub fn calibrate_from_reference(plateaus: &[Segment]) -> Result<Fit, CalibrateError> {
    let with = plateaus
        .iter()
        .filter_map(|p| Some((p.mean_g, p.reference?.up)));
    let (readings, ups): (Vec<_>, Vec<_>) = with.unzip();
    if readings.len() < FEWEST_PLATEAUS {
        let (have, need) = (readings.len(), FEWEST_PLATEAUS);
        return Err(CalibrateError::NoReference { have, need });
    }
    let (middle, up_middle) = (mean(&readings), mean(&ups));
    let centred = |v: &[[f64; 3]], m| v.iter().map(|&v| minus(v, m)).collect::<Vec<_>>();
    let found = best_rotation(&centred(&readings, middle), &centred(&ups, up_middle));
    if found.condition.is_nan() || found.condition > WORST_CONDITION {
        let (condition, missing) = (found.condition, missing(&readings));
        return Err(CalibrateError::IllConditioned { condition, missing });
    }
    let mut fit = Fit {
        method: Method::Reference,
        matrix: found.rotation,
        offset_g: minus(up_middle, times(&found.rotation, middle)),
        poses: readings.len(),
        condition: found.condition,
        ..Fit::IDENTITY
    };
    fit = fit.judged_on(plateaus.iter().filter(|p| p.reference.is_some()));
    let pairs = readings.iter().zip(&ups);
    let angles = pairs.map(|(reading, up)| angle_between_deg(fit.apply(*reading), *up));
    fit.angle_residual_deg = Some(rms(angles));
    if fit.vector().is_none() {
        return Err(CalibrateError::Implausible(FitError::Implausible));
    }
    Ok(fit)
}

/// Turns one channel's fit so that its frame becomes the other channel's.
///
/// `pairs` are mean readings of both channels over the same standstills: this one's, then the
/// other's. Gravity's length leaves the mounting open; two channels on one board need this before
/// their angles can be compared. Returns the turned fit with the angle that is left, deg rms.
pub fn align(
    fit: &Fit,
    other: &Fit,
    pairs: &[([f64; 3], [f64; 3])],
) -> Result<Fit, CalibrateError> {
    if pairs.len() < FEWEST_PLATEAUS {
        let (have, need) = (pairs.len(), FEWEST_PLATEAUS);
        let readings: Vec<_> = pairs.iter().map(|(reading, _)| *reading).collect();
        return Err(CalibrateError::TooFew {
            have,
            need,
            missing: missing(&readings),
        });
    }
    let (from, to): (Vec<_>, Vec<_>) = pairs
        .iter()
        .map(|(a, b)| (fit.apply(*a), other.apply(*b)))
        .unzip();
    let found = best_rotation(&from, &to);
    if found.condition.is_nan() || found.condition > WORST_CONDITION {
        let (condition, missing) = (found.condition, missing(&from));
        return Err(CalibrateError::IllConditioned { condition, missing });
    }
    let left = from
        .iter()
        .zip(&to)
        .map(|(a, b)| angle_between_deg(times(&found.rotation, *a), *b));
    Ok(Fit {
        matrix: poses::product(&found.rotation, &fit.matrix),
        offset_g: times(&found.rotation, fit.offset_g),
        angle_residual_deg: Some(rms(left)),
        ..fit.clone()
    })
}

/// Pairs of standstills of two recordings that overlap by more than half of the shorter one.
pub fn overlapping(one: &[Segment], other: &[Segment]) -> Vec<([f64; 3], [f64; 3])> {
    let overlap = |a: &Segment, b: &Segment| {
        let both = a
            .end_us
            .min(b.end_us)
            .saturating_sub(a.start_us.max(b.start_us));
        let shorter = (a.end_us - a.start_us).min(b.end_us - b.start_us);
        2 * both > shorter
    };
    let partner = |a: &Segment| other.iter().find(|b| overlap(a, b)).map(|b| b.mean_g);
    one.iter()
        .filter_map(|a| Some((a.mean_g, partner(a)?)))
        .collect()
}

/// Root mean square; 0 of no values.
pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, n), v| (sum + v * v, n + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

fn mean(vectors: &[[f64; 3]]) -> [f64; 3] {
    let sum = vectors.iter().fold([0.0; 3], |sum, v| plus(sum, *v));
    sum.map(|c| c / vectors.len().max(1) as f64)
}

#[cfg(test)]
#[path = "calibrate_tests.rs"]
mod tests;
