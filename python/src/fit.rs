//! The fits of a calibration: from poses without a reference, and from a motor's stands.
//!
//! In: mean accelerations in g as the part felt them, in its own axes; of a motor also what was
//! turned, and how far. Out: a [`Fitted`] correction with its figures, and a calibration that a
//! chain takes, with the data sheet's uncertainty budget.
//!
//! Left out: finding the standstills (`bench::recordings`), and temperature.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use tilt::ONE_G;
use tilt::calibration::FitError;
use tilt::calibration::motor::{self, FOLD_DEG, Slope, Stand};
use tilt::calibration::poses;
use tilt::chain::{Calibration, Correction};
use tilt::temperature::Compensated;
use tilt::vector::Vector;

use crate::calibration;
use crate::chain::mode;
use crate::error::said;

/// A fitted correction.
#[pyclass(frozen, get_all)]
pub struct Fitted {
    /// The calibration as a node stores it.
    calibration: Vec<u8>,
    /// Housing axis by part axis, g per g.
    matrix: [[f64; 3]; 3],
    /// Added after the matrix, g.
    offset_g: [f64; 3],
    /// Root mean square of length minus 1 g over the poses, g; `None` of a motor.
    residual_g: Option<f64>,
    /// Condition figure of the fit.
    condition: f64,
}

/// Fits matrix and offset by gravity's length over nine poses or more.
///
/// Errors: `plumb.Error` for too few poses, or poses that do not surround the sphere.
#[pyfunction]
pub fn fit_poses(py: Python<'_>, felt_g: PyReadonlyArray2<'_, f64>) -> PyResult<Fitted> {
    let poses_g = triples(felt_g.as_slice()?);
    let fitted = py.detach(|| poses::fit(poses_g)).map_err(said)?;
    let Correction::TwoAxis { harmonics, .. } = Correction::NOMINAL else {
        return Err(said("the nominal correction has two axes"));
    };
    let vector = fitted.vector;
    Ok(Fitted {
        residual_g: Some(fitted.mean_square_g2.sqrt()),
        ..of(Correction::TwoAxis { vector, harmonics }, fitted.condition)
    })
}

/// Fits matrix, offset and harmonics to a motor's stands: what was turned (0 slope X, 1 slope Y),
/// the motor's angle in deg, and what the part felt in g.
///
/// Errors: `plumb.Error` for stands that leave a parameter open, or a mode without this fit.
#[pyfunction]
pub fn fit_motor(
    py: Python<'_>,
    name: &str,
    slopes: PyReadonlyArray1<'_, u8>,
    reference_deg: PyReadonlyArray1<'_, f64>,
    felt_g: PyReadonlyArray2<'_, f64>,
) -> PyResult<Fitted> {
    let (slopes, references) = (slopes.as_slice()?, reference_deg.as_slice()?);
    let felt = triples(felt_g.as_slice()?);
    if slopes.len() != references.len() || felt.len() != references.len() {
        return Err(said(
            "give one slope, one angle and one acceleration for each stand",
        ));
    }
    let mode = mode(name)?;
    let is_two_axis = !matches!(mode, sim::bench::Mode::OneAxis);
    let fit = match mode {
        sim::bench::Mode::OneAxis => motor::one_axis,
        sim::bench::Mode::Paper => {
            return Err(said(
                "paper mode has tables: no correction is fitted to a motor's stands",
            ));
        }
        _ => motor::two_axis,
    };
    let stands = slopes.iter().zip(references).zip(felt);
    let stands: Vec<Stand> = stands
        .map(|((slope, reference), felt)| stand(*slope, *reference, *felt))
        .collect();
    let fitted = py.detach(|| fit(&stands));
    let (correction, condition) = fitted.map_err(|why| match is_two_axis {
        true => said(with_left_out(why, &stands)),
        false => said(why),
    })?;
    Ok(of(correction, condition))
}

/// Why two slopes were not fitted, with the stands that their harmonics do not take.
fn with_left_out(why: FitError, stands: &[Stand]) -> String {
    let beyond = |stand: &&Stand| stand.reference_deg.abs() > FOLD_DEG;
    let left_out = stands.iter().filter(beyond).count();
    match (why, left_out) {
        (FitError::TooFew { .. }, 1..) => format!(
            "{why} between -{FOLD_DEG} and {FOLD_DEG} deg for each slope; {left_out} of {} stands \
             are outside and were left out",
            stands.len()
        ),
        _ => why.to_string(),
    }
}

fn triples(flat: &[f64]) -> &[[f64; 3]] {
    flat.as_chunks().0
}

fn stand(slope: u8, reference_deg: f64, felt_g: [f64; 3]) -> Stand {
    Stand {
        slope: if slope == 0 { Slope::X } else { Slope::Y },
        reference_deg,
        sin_cos: reference_deg.to_radians().sin_cos(),
        felt: Compensated {
            accel: felt_g.map(|g| (g * f64::from(ONE_G)).round() as i32),
        },
    }
}

fn of(correction: Correction, condition: f64) -> Fitted {
    let vector = match &correction {
        Correction::TwoAxis { vector, .. } | Correction::OneAxis { vector, .. } => *vector,
        Correction::Tables { .. } => Vector::IDENTITY,
    };
    let calibration = Calibration {
        correction,
        ..Calibration::NOMINAL
    };
    Fitted {
        calibration: calibration::bytes_of(&calibration),
        matrix: vector
            .matrix
            .map(|row| row.map(|entry| f64::from(entry) / f64::from(1 << 30))),
        offset_g: vector
            .offset
            .map(|offset| f64::from(offset) / f64::from(ONE_G)),
        residual_g: None,
        condition,
    }
}
