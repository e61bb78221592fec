//! From stands of a motor to a calibration of a node.
//!
//! In: stands, each with the motor's angle and what the node's sensor felt, and the calibration
//! that the node had. Out: a new one with the same temperature compensation, and its residuals.
//! Twelve parameters and three harmonics for each slope, or six parameters for a turn of 360 deg,
//! as the virtual bench fits them (`sim::bench::calibrate`), by `tilt::calibration::motor`.
//!
//! Left out: the tables of the paper's mode, which the node makes itself.

use tilt::ONE_G;
use tilt::angle::{Angle, Harmonics, slopes, turn};
use tilt::calibration::FitError;
use tilt::calibration::motor::{self, Slope};
use tilt::chain::{Calibration, Correction};
use tilt::filter::Filtered;
use tilt::sample::Temperature;
use tilt::temperature::{Compensated, TemperatureModel};
use tilt::uncertainty::{Budget, Span, Uncertainty};

use super::motor::Axis;
use super::reading::{Reading, wrap};

/// A stand of the motor.
#[derive(Clone, Debug)]
pub struct Stand {
    /// The slope that was turned.
    pub axis: Axis,
    /// The motor's angle, deg.
    pub reference_deg: f64,
    /// What each node said.
    pub readings: Vec<Reading>,
}

impl Stand {
    /// What a node read there less the reference, deg.
    pub fn error_deg(&self, node: usize) -> Result<f64, u8> {
        let place = usize::from(self.axis == Axis::Y);
        let read = self.readings[node].angle_deg[place]?;
        Ok(wrap(read - self.reference_deg))
    }
}

/// A new calibration.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// It.
    pub calibration: Calibration,
    /// Condition figure of the fit.
    pub condition: f64,
    /// What it leaves at each stand, deg; none next to the vertical, where a slope folds.
    pub residuals: Vec<(Axis, f64, f64)>,
}

impl Fitted {
    /// Root mean square of the residuals, deg.
    pub fn residual_deg(&self) -> f64 {
        rms(self.residuals.iter().map(|(.., deg)| *deg))
    }
}

/// Root mean square, in the unit of the values; 0 of none.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let add = |(sum, count), value: f64| (sum + value * value, count + 1.0);
    let (sum, count) = values.into_iter().fold((0.0, 0.0), add);
    (sum / f64::max(count, 1.0)).sqrt()
}

/// A mean reading, in steps of 2^-26 g, compensated by `model` at this temperature.
pub fn compensated(model: &TemperatureModel, accel: [f64; 3], t: Temperature) -> Compensated {
    let filtered = Filtered {
        accel: accel.map(|a| a.round() as i32),
    };
    model.apply(filtered, t)
}

/// The same in g.
pub fn compensated_g(model: &TemperatureModel, accel: [f64; 3], t: Temperature) -> [f64; 3] {
    let compensated = compensated(model, accel, t);
    compensated.accel.map(|a| f64::from(a) / f64::from(ONE_G))
}

/// A temperature in degC as the chain has it.
pub fn temperature(celsius: f64) -> Temperature {
    Temperature((celsius * 256.0).round() as i32)
}

/// The budget of a calibration that was made at these temperatures within one power-on.
///
/// What is known of the part stays: its noise, and with a temperature model, which the calibration
/// leaves in force, what that leaves and where it holds.
pub fn budget(
    before: &Calibration,
    temperatures: impl IntoIterator<Item = Temperature>,
    reference_deg: f64,
    residual_deg: f64,
) -> Budget {
    let [reference, residual] = [reference_deg, residual_deg].map(Uncertainty::from_degrees);
    let Budget {
        noise,
        hysteresis,
        tco,
        span,
        ..
    } = before.budget;
    let mut budget = Budget {
        noise,
        hysteresis,
        tco,
        span,
        ..Budget::calibrated(reference, residual, span)
    };
    budget.take_run(Span::of(temperatures), &before.temperature);
    budget
}

/// A stand as the fits take it: what node number `node` felt there, by this temperature model.
fn stand(model: &TemperatureModel, node: usize, stand: &Stand) -> motor::Stand {
    let reading = &stand.readings[node];
    motor::Stand {
        slope: match stand.axis {
            Axis::X => Slope::X,
            Axis::Y => Slope::Y,
        },
        reference_deg: stand.reference_deg,
        sin_cos: stand.reference_deg.to_radians().sin_cos(),
        felt: compensated(model, reading.accel, temperature(reading.temperature_c)),
    }
}

/// A calibration of node number `node` from the stands; the temperature compensation is that of
/// `before`. `reference_deg` is the motor's standard uncertainty.
///
/// Errors: see [`FitError`].
pub fn by_motor(
    before: &Calibration,
    node: usize,
    stands: &[Stand],
    reference_deg: f64,
) -> Result<Fitted, FitError> {
    let points = stands.iter().map(|s| stand(&before.temperature, node, s));
    let points: Vec<motor::Stand> = points.collect();
    let (correction, condition) = match before.correction {
        Correction::OneAxis { .. } => motor::one_axis(&points)?,
        _ => motor::two_axis(&points)?,
    };
    let residuals = residuals(&correction, stands, &points);
    // What the reference itself scatters is in its own term already.
    let unexpected = rms(residuals.iter().map(|(.., deg)| *deg)).powi(2) - reference_deg.powi(2);
    let residual_deg = unexpected.max(0.0).sqrt();
    let temperatures = stands
        .iter()
        .map(|s| temperature(s.readings[node].temperature_c));
    Ok(Fitted {
        calibration: Calibration {
            temperature: before.temperature,
            correction,
            budget: budget(before, temperatures, reference_deg, residual_deg),
            rates: before.rates,
        },
        condition,
        residuals,
    })
}

/// What the correction finds at the points less the reference.
fn residuals(
    correction: &Correction,
    stands: &[Stand],
    points: &[motor::Stand],
) -> Vec<(Axis, f64, f64)> {
    let corrected = |harmonics: &Harmonics, angle: Angle| {
        angle.degrees() + harmonics.correction(angle).degrees()
    };
    let mut all = Vec::new();
    for (stand, p) in stands.iter().zip(points) {
        let found = match correction {
            Correction::TwoAxis { vector, harmonics } => {
                if p.reference_deg.abs() > motor::FOLD_DEG {
                    continue;
                }
                let found = slopes(vector.apply(p.felt));
                match stand.axis {
                    Axis::X => corrected(&harmonics.x, found.x),
                    Axis::Y => corrected(&harmonics.y, found.y),
                }
            }
            Correction::OneAxis { vector, harmonics } => {
                corrected(harmonics, turn(vector.apply(p.felt)))
            }
            Correction::Tables { .. } => continue,
        };
        all.push((stand.axis, p.reference_deg, wrap(found - p.reference_deg)));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sensor with gain, offset and crossed axes.
    fn reading(up: [f64; 3]) -> Reading {
        let [x, y, z] = up;
        let felt = [
            1.02 * x + 0.01 * y + 0.02,
            0.98 * y - 0.02 * z - 0.03,
            1.01 * z + 0.015 * x + 0.04,
        ];
        Reading {
            accel: felt.map(|g| g * f64::from(ONE_G)),
            scatter_mg: 0.0,
            temperature_c: 25.0,
            angle_deg: [Ok(0.0); 2],
            rate_rad_s: None,
        }
    }

    fn stands(axes: &[Axis], step: usize) -> Vec<Stand> {
        let one = |axis: Axis, deg: f64| {
            let (sin, cos) = deg.to_radians().sin_cos();
            let up = match axis {
                Axis::X => [sin, 0.0, cos],
                Axis::Y => [0.0, sin, cos],
            };
            Stand {
                axis,
                reference_deg: deg,
                readings: vec![reading(up)],
            }
        };
        let angles = || (-90..=90).step_by(step).map(f64::from);
        axes.iter()
            .flat_map(|axis| angles().map(|deg| one(*axis, deg)))
            .collect()
    }

    #[test]
    fn a_sweep_of_both_slopes_leaves_nothing() {
        let stands = stands(&[Axis::X, Axis::Y], 15);
        let before = Calibration {
            rates: Some(crate::sample::rates()),
            ..Calibration::NOMINAL
        };
        let fitted = by_motor(&before, 0, &stands, 0.01).unwrap();
        assert_eq!(fitted.calibration.rates, before.rates);
        assert!(fitted.residual_deg() < 1e-4, "{}", fitted.residual_deg());
        assert!(fitted.calibration.budget.noise > 0);
        assert_eq!(fitted.calibration.budget.residual, Uncertainty(0));
    }

    #[test]
    fn one_slope_alone_is_refused() {
        let fitted = by_motor(&Calibration::NOMINAL, 0, &stands(&[Axis::X], 15), 0.01);
        assert!(matches!(fitted, Err(FitError::IllConditioned { .. })));
    }

    #[test]
    fn the_error_at_a_stand_goes_the_short_way_round() {
        let mut stand = stands(&[Axis::Y], 90).remove(0);
        stand.reference_deg = 179.9;
        stand.readings[0].angle_deg[1] = Ok(-179.9);
        assert!((stand.error_deg(0).unwrap() - 0.2).abs() < 1e-9);
    }
}
