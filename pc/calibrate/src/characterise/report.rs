//! From what a run has measured to new calibrations and to the report of it.
//!
//! In: the readings of every dwell, and the nodes as they were found. Out: for each node the
//! calibration with the model in it, and a [`Report`] in the form of `plumb calibrate`'s, judged
//! by what the model leaves at the dwells.
//!
//! Left out: the fit itself (`thermal`), and the report's forms (`crate`).

use tilt::ONE_G;
use tilt::calibration::FitError;
use tilt::calibration::gyroscope::with_slopes;
use tilt::chain::Calibration;
use tilt::sample::Temperature;
use tilt::temperature::{KNOTS, Piecewise, Quadratic, TemperatureModel};
use tilt::uncertainty::{Budget, Span, TCO};

use super::bias::{Found, NoBias, bias};
use super::measured::{Dwelt, Measured};
use super::model::Model;
use super::profile::Branch;
use super::scale::{self, scale};
use super::stands::READINGS;
use super::thermal::{Fitted, MeanReading, between_runs, fit, hysteresis, rms, with_model};
use crate::CalibrateError;
use crate::compose::{Frame, judge};
use crate::data::{
    Channel, Coefficient, Contribution, GyroscopeBias, GyroscopeScale, Method, Reference, Report,
    Thermal, ThermalDwell, TurnsLeftOut,
};
use crate::fit::temperature;
use crate::gyroscope;
use crate::over_temperature::AXES;
use crate::session::Node;
use crate::turns::VERTICAL_DEG;

/// What a temperature that is told to a degree is off by, degC (k = 1): uniform.
const THERMOMETER_C: f64 = 0.289;

/// A model never counts as better than this, mg: the 1/f floor of the sensor. `[ASSUME]`
const FLOOR_MG: f64 = 0.04;

/// What a node is to get.
#[derive(Clone, Debug)]
pub struct Made {
    /// Its calibration with the model.
    pub calibration: Calibration,
    /// The model.
    fitted: Fitted,
    /// The readings that it was fitted to.
    mean_readings: Vec<MeanReading>,
    /// Where its angles are those of before, degC.
    unchanged_c: Option<f64>,
    /// The bias of its gyroscope, or why it stays; none where there is no gyroscope.
    bias: Option<Result<Found, NoBias>>,
    /// What has come of the turns for its scale; none where no turn was followed.
    scale: Option<scale::Outcome>,
}

#[cfg(test)]
impl Made {
    /// The slopes of its gyroscope's scale.
    pub fn scale_found(&self) -> Option<scale::Found> {
        self.scale.as_ref()?.found.clone().ok()
    }
}

/// The calibration of each node with its model in it.
///
/// Errors: a fit that is refused, and [`CalibrateError::Beyond`].
pub fn make(measured: &Measured, nodes: &[Node]) -> Result<Vec<Made>, CalibrateError> {
    let made = |(place, node): (usize, &Node)| {
        let mean_readings = measured.mean_readings(place);
        let fitted = fit(
            measured.begun.model,
            &measured.begun.profile,
            &mean_readings,
        );
        let fitted = fitted.map_err(|error| CalibrateError::Fit(node.id, error))?;
        let before = &node.calibration;
        let at = middle(before.budget.span);
        let bare = before.temperature == TemperatureModel::None;
        let new = with_model(before, fitted.model, at);
        let mut calibration = new.ok_or(CalibrateError::Beyond(node.id))?;
        let left_mg = left_mg(measured, &mean_readings, &fitted);
        calibration.budget = budget(&before.budget, &fitted, left_mg);
        let bias = bias(measured, place, before.rates.as_ref());
        if let Some(Ok(found)) = &bias {
            calibration.rates = Some(found.rates);
        }
        let scale = scale_of(&calibration, before, measured, place);
        Ok::<_, CalibrateError>(Made {
            calibration,
            fitted,
            mean_readings,
            unchanged_c: bare.then(|| f64::from(at.0) / 256.0),
            bias,
            scale,
        })
    };
    let made = nodes.iter().enumerate().map(made);
    let mut made = made.collect::<Result<Vec<_>, _>>()?;
    put_scales(&mut made, nodes);
    Ok(made)
}

/// What has come of the turns for the scale of the gyroscope, by a calibration that has the model
/// of this run.
fn scale_of(
    calibration: &Calibration,
    before: &Calibration,
    measured: &Measured,
    place: usize,
) -> Option<scale::Outcome> {
    let left_mg = f64::from(calibration.budget.hysteresis) / f64::from(ONE_G) * 1000.0;
    let vertical_deg = angle_deg(left_mg).hypot(VERTICAL_DEG);
    let rates = before.rates.as_ref();
    scale(measured, place, calibration, rates, vertical_deg)
}

/// Puts the slopes of the gyroscopes' scale into the calibrations: those of axes that both show.
fn put_scales(made: &mut [Made], nodes: &[Node]) {
    let outcomes = made.iter().filter_map(|made| made.scale.as_ref());
    let open = outcomes.fold([false; 3], |open, outcome| {
        let here = outcome.open();
        [0, 1, 2].map(|axis| open[axis] || here[axis])
    });
    for (made, node) in made.iter_mut().zip(nodes) {
        let (Some(outcome), Some(rates)) = (&mut made.scale, made.calibration.rates) else {
            continue;
        };
        outcome.keep(open, rates.real().scale1);
        if let Ok(found) = &outcome.found {
            // The gains were found where the accelerometer's correction was.
            match with_slopes(&rates, found.slopes, node.calibration.budget.fitted_at) {
                Some(rates) => made.calibration.rates = Some(rates),
                None => outcome.found = Err(scale::NoScale::Fit(FitError::Implausible)),
            }
        }
    }
}

/// The middle of the temperatures at which a calibration was made.
fn middle(span: Span) -> Temperature {
    Temperature(span.low.0.midpoint(span.high.0))
}

/// What the model leaves over the run, rms, mg; `None` where one branch only was met. Points that
/// each have a reading of their own, as those of eq 6, leave nothing by construction, and that
/// shows nothing of the hysteresis.
fn left_mg(measured: &Measured, mean_readings: &[MeanReading], fitted: &Fitted) -> Option<f64> {
    let residuals_mg = &fitted.residuals_mg;
    let both = hysteresis(&measured.begun.profile, mean_readings, residuals_mg);
    both.map(|_| rms(residuals_mg))
}

/// The budget of before, for the temperatures of the run. What the model leaves over them, where
/// both branches were met, takes the place of the hysteresis that was assumed: neither is known in
/// use.
fn budget(before: &Budget, fitted: &Fitted, left_mg: Option<f64>) -> Budget {
    let [low, high] = fitted.span_c.map(temperature);
    let left = |mg: f64| (mg.max(FLOOR_MG) / 1000.0 * f64::from(ONE_G)).round() as u32;
    Budget {
        hysteresis: left_mg.map_or(before.hysteresis, left),
        tco: TCO,
        span: Span { low, high },
        ..*before
    }
}

/// The report of a run.
pub fn report(frame: &Frame, measured: &Measured, made: &[Made]) -> Report {
    let method = match measured.begun.model {
        Model::Quadratic => Method::ChamberQuadratic,
        Model::Piecewise => Method::ChamberPiecewise,
    };
    let temperatures: Vec<f64> = made
        .iter()
        .flat_map(|made| {
            made.mean_readings
                .iter()
                .map(|mean_reading| mean_reading.temperature_c)
        })
        .collect();
    let reference = reference(measured);
    let mut report = frame.report(method, reference, &temperatures, |place, channel| {
        figures(channel, measured, &made[place]);
    });
    report.environment.statement = "Temperature as measured by the sensors, to a degree, over all \
     dwells. Humidity and vibration were not measured."
        .to_owned();
    let tolerance = frame.tolerance_deg;
    report.decision.rule = format!(
        "Accepted when the largest that the model leaves of an axis at a dwell, as an angle, and \
         its expanded uncertainty (k = 2) together are within {tolerance} deg (guarded \
         acceptance, JCGM 106, 8.3.2)."
    );
    judge(&mut report, largest_deg);
    report.decision.largest_error_deg = report
        .channels
        .iter()
        .filter_map(largest_deg)
        .reduce(f64::max);
    report
}

fn reference(measured: &Measured) -> Reference {
    let turned = match &measured.begun.turned_by {
        Some(name) => format!(" The housing was turned by: {name}."),
        None => String::new(),
    };
    Reference {
        name: measured.begun.chamber.clone(),
        standard_uncertainty_deg: None,
        statement: format!(
            "The temperatures of the model are those of the sensors' own thermometers, which the \
             nodes read in use as well; the chamber's own statement is shown next to them. \
             Gravity's share of each axis is taken from the readings. Scale, axes and zero of the \
             angles are those of the calibration before.{turned}"
        ),
    }
}

/// A small acceleration across gravity as the angle that it makes, deg.
fn angle_deg(mg: f64) -> f64 {
    (mg / 1000.0).to_degrees()
}

fn figures(channel: &mut Channel, measured: &Measured, made: &Made) {
    let Made {
        fitted,
        mean_readings,
        ..
    } = made;
    let left_mg = left_mg(measured, mean_readings, fitted);
    let assumed = f64::from(made.calibration.budget.hysteresis) / f64::from(ONE_G);
    let scatter = measured.dwells.iter().flat_map(|dwelt| &dwelt.orientations);
    let scatter: Vec<f64> = scatter.flatten().map(|felt| felt.scatter_mg).collect();
    let squares: f64 = scatter.iter().map(|mg| mg * mg).sum();
    // One axis of three, and the readings as independent.
    let noise_mg = (squares / scatter.len().max(1) as f64 / 3.0 / f64::from(READINGS)).sqrt();
    let profile = &measured.begun.profile;
    channel.residual_mg = left_mg;
    let (called, evaluation, mg, source) = match left_mg {
        Some(mg) => ("Left by the model", "A", mg, "both branches, all runs"),
        None => {
            let source = "assumed: one branch was met";
            ("Thermal hysteresis", "B", assumed * 1000.0, source)
        }
    };
    let steepest_mg = THERMOMETER_C * steepest_mg_per_c(fitted);
    let resolution = "resolution of one degree, times the steepest coefficient";
    channel.uncertainty = vec![
        Contribution::new(called, evaluation, angle_deg(mg), source),
        Contribution::new(
            "Noise of a mean",
            "A",
            angle_deg(noise_mg),
            "scatter of the readings",
        ),
        Contribution::new("Thermometer", "B", angle_deg(steepest_mg), resolution),
    ];
    if let (Some(Ok(bias)), Some(all)) = (&made.bias, &mut channel.gyroscope) {
        gyroscope::put_bias_uncertainty(all, &bias.uncertainty);
    }
    let slopes = made
        .scale
        .as_ref()
        .and_then(|scale| scale.found.as_ref().ok());
    if let (Some(found), Some(all)) = (slopes, &mut channel.gyroscope) {
        gyroscope::put_slope_uncertainty(all, found.uncertainty);
    }
    let [low, high] = fitted.span_c;
    channel.thermal = Some(Thermal {
        model: measured.begun.model.name().to_owned(),
        sensor_min_degc: low,
        sensor_max_degc: high,
        unchanged_at_degc: made.unchanged_c,
        coefficients: coefficients(&fitted.model),
        without_model_mg: fitted.without_mg,
        hysteresis_mg: hysteresis(profile, mean_readings, &fitted.residuals_mg),
        between_runs_mg: between_runs(mean_readings, &fitted.residuals_mg),
        dwells: measured
            .dwells
            .iter()
            .map(|dwelt| dwell(dwelt, measured, made))
            .collect(),
        gyroscope_bias: made.bias.as_ref().map(gyroscope_bias),
        gyroscope_scale: made.scale.as_ref().map(gyroscope_scale),
    });
}

fn gyroscope_bias(bias: &Result<Found, NoBias>) -> GyroscopeBias {
    let found = bias.as_ref().ok();
    GyroscopeBias {
        rests: found.map_or(0, |found| found.rests as u32),
        rests_left_out: found.map_or(0, |found| found.left_out as u32),
        bias_residual_deg_s: found.map(|found| found.residual_deg_s),
        bias_hysteresis_deg_s: found.and_then(|found| found.hysteresis_deg_s),
        bias_between_runs_deg_s: found.and_then(|found| found.between_runs_deg_s),
        refused: bias.as_ref().err().map(ToString::to_string),
    }
}

fn gyroscope_scale(outcome: &scale::Outcome) -> GyroscopeScale {
    let found = outcome.found.as_ref();
    let open = found.map_or([false; 3], |found| found.open);
    let open_axes = AXES.iter().zip(open).filter(|(_, open)| *open);
    let left_out = outcome.left_out.iter().map(|(why, turns)| TurnsLeftOut {
        why: why.clone(),
        turns: *turns as u32,
    });
    GyroscopeScale {
        used: outcome.used as u32,
        left_out: left_out.collect(),
        scale_residual_deg: found.ok().map(|found| found.residual_deg),
        open_axes: open_axes.map(|(axis, _)| (*axis).to_owned()).collect(),
        refused: found.err().map(ToString::to_string),
    }
}

/// One dwell of a channel: the readings of its run and number.
fn dwell(dwelt: &Dwelt, measured: &Measured, made: &Made) -> ThermalDwell {
    let profile = &measured.begun.profile;
    let readings = made.mean_readings.iter().zip(&made.fitted.residuals_mg);
    let here = |(mean_reading, _): &(&MeanReading, &[f64; 3])| {
        (mean_reading.run, mean_reading.step) == (dwelt.run, dwelt.step)
    };
    let here: Vec<_> = readings.filter(here).collect();
    let count = here.len().max(1) as f64;
    let sensors: f64 = here
        .iter()
        .map(|(mean_reading, _)| mean_reading.temperature_c)
        .sum();
    let sum = |axis: usize| here.iter().map(|(_, mg)| mg[axis]).sum::<f64>();
    let all = here.iter().flat_map(|(_, mg)| mg.iter());
    let branch = match profile.branch(dwelt.run, dwelt.step) {
        Branch::Start => "start",
        Branch::Up => "up",
        Branch::Down => "down",
    };
    ThermalDwell {
        run: dwelt.run,
        branch: branch.to_owned(),
        set_degc: profile.steps[dwelt.step].temperature_degc,
        air_degc: dwelt.air_degc,
        sensor_degc: sensors / count,
        residuals_mg: std::array::from_fn(|axis| sum(axis) / count),
        largest_mg: all.map(|mg| mg.abs()).fold(0.0, f64::max),
        repeated: dwelt.repeated,
    }
}

/// Steps of 2^-26 g with so many fractional bits as mg.
fn mg(value: i32, bits: u32) -> f64 {
    f64::from(value) / 2f64.powi(bits as i32) / f64::from(ONE_G) * 1000.0
}

fn coefficients(model: &TemperatureModel) -> Vec<Coefficient> {
    match model {
        TemperatureModel::Quadratic(quadratic) => of_quadratic(quadratic),
        TemperatureModel::Piecewise(piecewise) => of_piecewise(piecewise),
        TemperatureModel::None | TemperatureModel::DataSheet(_) => Vec::new(),
    }
}

fn of_quadratic(quadratic: &Quadratic) -> Vec<Coefficient> {
    let all = AXES.iter().enumerate().flat_map(|(axis, name)| {
        let gain = |value: i32, bits: i32| f64::from(value) / 2f64.powi(bits);
        [
            ("Offset", mg(quadratic.offset1_q8[axis], 8), "mg/degC"),
            (
                "Offset, quadratic",
                mg(quadratic.offset2_q16[axis], 16) * 1e3,
                "ug/degC^2",
            ),
            (
                "Gain",
                gain(quadratic.gain1_q38[axis], 38) * 1e6,
                "ppm/degC",
            ),
            (
                "Gain, quadratic",
                gain(quadratic.gain2_q46[axis], 46) * 1e9,
                "ppb/degC^2",
            ),
        ]
        .map(|(called, value, unit)| Coefficient {
            name: called.to_owned(),
            axis: (*name).to_owned(),
            value,
            unit: unit.to_owned(),
            expanded: None,
        })
    });
    all.collect()
}

fn of_piecewise(piecewise: &Piecewise) -> Vec<Coefficient> {
    let mut all = Vec::new();
    for (interval, slopes) in piecewise.slopes_q8.iter().enumerate() {
        let knot = |n: usize| f64::from(piecewise.knots[n.min(KNOTS - 1)].0) / 256.0;
        let (low, high) = (knot(interval), knot(interval + 1));
        for (name, slope) in AXES.iter().zip(slopes) {
            all.push(Coefficient {
                name: format!("Offset from {low:.1} to {high:.1} degC"),
                axis: (*name).to_owned(),
                value: mg(*slope, 8),
                unit: "mg/degC".to_owned(),
                expanded: None,
            });
        }
    }
    all
}

/// The steepest change of a reading of 1 g over the span, mg/degC.
fn steepest_mg_per_c(fitted: &Fitted) -> f64 {
    let far = fitted
        .span_c
        .map(|c| (c - 25.0).abs())
        .into_iter()
        .fold(0.0, f64::max);
    let all = match &fitted.model {
        TemperatureModel::Quadratic(q) => (0..3)
            .map(|axis| {
                let offset =
                    mg(q.offset1_q8[axis], 8).abs() + 2.0 * far * mg(q.offset2_q16[axis], 16).abs();
                let gain = f64::from(q.gain1_q38[axis]).abs() / 2f64.powi(38)
                    + 2.0 * far * f64::from(q.gain2_q46[axis]).abs() / 2f64.powi(46);
                offset + 1000.0 * gain
            })
            .collect(),
        TemperatureModel::Piecewise(p) => p
            .slopes_q8
            .as_flattened()
            .iter()
            .map(|slope| mg(*slope, 8).abs())
            .collect(),
        TemperatureModel::None | TemperatureModel::DataSheet(_) => Vec::new(),
    };
    all.into_iter().fold(0.0, f64::max)
}

/// The largest that the model leaves at a dwell, as an angle.
fn largest_deg(channel: &Channel) -> Option<f64> {
    let dwells = channel.thermal.iter().flat_map(|thermal| &thermal.dwells);
    let angles = dwells.map(|dwell| angle_deg(dwell.largest_mg));
    angles.reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted(mg: f64) -> Fitted {
        Fitted {
            model: TemperatureModel::Quadratic(Quadratic::default()),
            span_c: [-7.0, 73.0],
            residuals_mg: vec![[mg; 3]; 4],
            without_mg: 5.0,
        }
    }

    #[test]
    fn the_budget_holds_for_the_run_s_temperatures_with_what_the_model_leaves() {
        let before = Calibration::NOMINAL.budget;
        let left = budget(&before, &fitted(0.5), Some(0.5));
        assert_eq!(
            left.span,
            Span {
                low: temperature(-7.0),
                high: temperature(73.0)
            }
        );
        assert_eq!((left.tco, left.noise), (TCO, before.noise));
        assert!((f64::from(left.hysteresis) / f64::from(ONE_G) * 1000.0 - 0.5).abs() < 1e-4);
        // A fit that leaves nothing is luck.
        assert!(budget(&before, &fitted(0.0), Some(0.0)).hysteresis > 2000);
    }

    #[test]
    fn points_that_leave_nothing_by_construction_took_the_hysteresis_away() {
        let before = Calibration::NOMINAL.budget;
        let left = budget(&before, &fitted(0.0), None);
        assert_eq!(left.hysteresis, before.hysteresis);
    }

    #[test]
    fn coefficients_are_told_in_the_units_of_the_data_sheet() {
        let quadratic = Quadratic {
            offset1_q8: [3_435_974, 0, 0],
            gain1_q38: [0, 27_487_791, 0],
            ..Quadratic::default()
        };
        let all = of_quadratic(&quadratic);
        assert_eq!(all.len(), 12);
        assert!((all[0].value - 0.2).abs() < 1e-6 && all[0].unit == "mg/degC");
        let gain = all
            .iter()
            .find(|c| c.name == "Gain" && c.axis == "y")
            .unwrap();
        assert!((gain.value - 100.0).abs() < 1e-3, "{gain:?}");
        let mut steep = fitted(0.1);
        steep.model = TemperatureModel::Quadratic(quadratic);
        assert!((steepest_mg_per_c(&steep) - 0.2).abs() < 1e-3);
    }
}
