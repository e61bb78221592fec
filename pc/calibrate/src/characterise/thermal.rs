//! From what a sensor felt at each dwell to its temperature model.
//!
//! In: mean readings in g with the sensor's own temperature, in one orientation (the paper) or four
//! (the product). Out: a [`TemperatureModel`] for temperatures from the lowest to the highest that
//! was met, what it leaves at each reading, and the calibration that the node had with the model in
//! it, which gives the same angles as before at the temperature at which it was made.
//!
//! Gravity's share of an axis in an orientation is taken from the readings themselves, so nothing
//! has to be known of how the sensor lies in its housing: an offset of 20 mg and a gain off by 1 %
//! bend a coefficient of gain by 2 % of itself. The fits are those of `tilt::calibration::thermal`.
//!
//! Left out: the report (`report`).

use tilt::ONE_G;
use tilt::angle::Axes;
use tilt::calibration::FitError;
use tilt::calibration::thermal::{Dwell, ORIENTATIONS, QuadraticFit, piecewise};
use tilt::chain::{Calibration, Correction};
use tilt::filter::Filtered;
use tilt::sample::Temperature;
use tilt::table::{Point, Table};
use tilt::temperature::{KNOTS, TemperatureModel};
use tilt::vector::Vector;

use super::model::Model;
use super::profile::{Branch, Profile};
use crate::fit::{compensated_g, temperature};

/// Variance of gravity's share of an axis over the orientations below which offset and gain can
/// not be told apart, g^2: the tetrahedron has 0.33, four sides of a housing have 0.19.
const APART_G2: f64 = 0.05;

/// One mean reading of one node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanReading {
    /// Run, from 1.
    pub run: u32,
    /// The profile's dwell.
    pub step: usize,
    /// Orientation, from 0.
    pub orientation: usize,
    /// Temperature that the sensor told, degC.
    pub temperature_c: f64,
    /// Mean acceleration in the sensor's axes, g.
    pub accel_g: [f64; 3],
}

impl MeanReading {
    fn dwell(&self) -> Dwell {
        Dwell {
            temperature: temperature(self.temperature_c),
            accel: self.accel_g.map(|g| g * f64::from(ONE_G)),
        }
    }
}

/// A model with what is known of it.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// It.
    pub model: TemperatureModel,
    /// The lowest and the highest temperature that the sensor told, degC.
    pub span_c: [f64; 2],
    /// What it leaves at each reading, mg, in their order.
    pub residuals_mg: Vec<[f64; 3]>,
    /// Root mean square of what would be left without it, mg.
    pub without_mg: f64,
}

/// Fits `model` to the readings of one node.
///
/// Errors: see [`FitError`].
pub fn fit(
    model: Model,
    profile: &Profile,
    mean_readings: &[MeanReading],
) -> Result<Fitted, FitError> {
    let fitted = match model {
        Model::Quadratic => quadratic(mean_readings)?,
        Model::Piecewise => stairs(profile, mean_readings)?,
    };
    let temperatures = || {
        mean_readings
            .iter()
            .map(|mean_reading| mean_reading.temperature_c)
    };
    let low = temperatures().fold(f64::MAX, f64::min);
    let high = temperatures().fold(f64::MIN, f64::max);
    let residuals_mg = left(&fitted, mean_readings);
    let without = left(&TemperatureModel::None, mean_readings);
    Ok(Fitted {
        model: fitted,
        span_c: [low, high],
        residuals_mg,
        without_mg: rms(&without),
    })
}

/// Root mean square over all axes.
pub fn rms(all: &[[f64; 3]]) -> f64 {
    crate::fit::rms(all.as_flattened().iter().copied())
}

/// Means of each orientation's readings, and how many there are.
fn means(of: impl Iterator<Item = (usize, [f64; 3])>) -> [[f64; 3]; ORIENTATIONS] {
    let mut sums = [([0.0; 3], 0.0); ORIENTATIONS];
    for (orientation, value) in of {
        if let Some((sum, count)) = sums.get_mut(orientation) {
            *sum = std::array::from_fn(|axis| sum[axis] + value[axis]);
            *count += 1.0;
        }
    }
    sums.map(|(sum, count)| sum.map(|s| s / f64::max(count, 1.0)))
}

/// Gravity's share of each axis in each orientation, g.
fn shares(mean_readings: &[MeanReading]) -> [[f64; 3]; ORIENTATIONS] {
    let of = means(mean_readings.iter().map(|s| (s.orientation, s.accel_g)));
    of.map(|mean| {
        let length = mean.iter().map(|g| g * g).sum::<f64>().sqrt();
        mean.map(|g| g / length.max(1e-3))
    })
}

/// Whether offset and gain of each axis can be told apart by these orientations; the axis of which
/// they can't.
pub fn alike(mean_readings: &[MeanReading]) -> Option<char> {
    let shares = shares(mean_readings);
    let count = ORIENTATIONS as f64;
    let variance = |axis: usize| {
        let of = |power: i32| shares.iter().map(|s| s[axis].powi(power)).sum::<f64>() / count;
        of(2) - of(1).powi(2)
    };
    let names = ['x', 'y', 'z'].into_iter().enumerate();
    let mut alike = names.filter(|(axis, _)| variance(*axis) < APART_G2);
    alike.next().map(|(_, name)| name)
}

fn quadratic(mean_readings: &[MeanReading]) -> Result<TemperatureModel, FitError> {
    let shares = shares(mean_readings);
    let mut fit = QuadraticFit::default();
    for mean_reading in mean_readings {
        let share = shares
            .get(mean_reading.orientation)
            .copied()
            .unwrap_or_default();
        fit.add(mean_reading.orientation, share, mean_reading.dwell());
    }
    fit.solve().map(TemperatureModel::Quadratic)
}

/// Eq 6 over the rising stairs, each the mean of its runs.
fn stairs(profile: &Profile, mean_readings: &[MeanReading]) -> Result<TemperatureModel, FitError> {
    let stair = |step: usize| {
        let here: Vec<&MeanReading> = mean_readings
            .iter()
            .filter(|mean_reading| mean_reading.step == step)
            .collect();
        let count = here.len().max(1) as f64;
        let accel = |axis: usize| here.iter().map(|s| s.accel_g[axis]).sum::<f64>() / count;
        MeanReading {
            run: 1,
            step,
            orientation: 0,
            temperature_c: here.iter().map(|s| s.temperature_c).sum::<f64>() / count,
            accel_g: [accel(0), accel(1), accel(2)],
        }
    };
    let mut knots: Vec<Dwell> = profile.stair().map(|step| stair(step).dwell()).collect();
    while (2..KNOTS).contains(&knots.len()) {
        split(&mut knots);
    }
    let have = knots.len();
    let knots = knots.try_into();
    let knots: [Dwell; KNOTS] = knots.map_err(|_| FitError::TooFew { have, need: KNOTS })?;
    piecewise(&knots).map(TemperatureModel::Piecewise)
}

/// Puts a point in the middle of the widest interval, which leaves its slope as it is.
fn split(knots: &mut Vec<Dwell>) {
    let wide = |pair: &[Dwell]| pair[1].temperature.0 - pair[0].temperature.0;
    let pairs = knots.windows(2).enumerate();
    let widest = pairs.max_by_key(|(_, pair)| wide(pair));
    let Some((place, [low, high])) = widest else {
        return;
    };
    // Half of a step of 1/256 degC: the acceleration is that of this very temperature.
    let temperature = Temperature(low.temperature.0.midpoint(high.temperature.0));
    let way = f64::from(temperature.0 - low.temperature.0) / f64::from(wide(&[*low, *high]).max(1));
    let accel = std::array::from_fn(|i| low.accel[i] + way * (high.accel[i] - low.accel[i]));
    knots.insert(place + 1, Dwell { temperature, accel });
}

/// What a model leaves at each reading: less the mean of its orientation, mg.
fn left(model: &TemperatureModel, mean_readings: &[MeanReading]) -> Vec<[f64; 3]> {
    let mended: Vec<_> = mean_readings
        .iter()
        .map(|mean_reading| {
            let dwell = mean_reading.dwell();
            let felt_g = compensated_g(model, dwell.accel, dwell.temperature);
            (mean_reading.orientation, felt_g)
        })
        .collect();
    let mean = means(mended.iter().copied());
    let less = |(orientation, g): &(usize, [f64; 3])| {
        let mean = mean.get(*orientation).copied().unwrap_or_default();
        std::array::from_fn(|axis| (g[axis] - mean[axis]) * 1000.0)
    };
    mended.iter().map(less).collect()
}

/// Half the difference of both branches at the temperature at which it is largest, of each axis,
/// in the unit of the residuals; `None` where no temperature was met on both.
pub fn hysteresis(
    profile: &Profile,
    mean_readings: &[MeanReading],
    residuals: &[[f64; 3]],
) -> Option<[f64; 3]> {
    let mut most: Option<[f64; 3]> = None;
    for step in &profile.steps {
        let on = |branch: Branch| {
            let here = |(mean_reading, _): &(&MeanReading, &[f64; 3])| {
                let set = profile
                    .steps
                    .get(mean_reading.step)
                    .map(|s| s.temperature_degc);
                set == Some(step.temperature_degc)
                    && profile.branch(mean_reading.run, mean_reading.step) == branch
            };
            mean(
                mean_readings
                    .iter()
                    .zip(residuals)
                    .filter(here)
                    .map(|(_, left)| *left),
            )
        };
        if let (Some(up), Some(down)) = (on(Branch::Up), on(Branch::Down)) {
            let half: [f64; 3] = std::array::from_fn(|axis| (up[axis] - down[axis]).abs() / 2.0);
            let before = most.unwrap_or_default();
            most = Some(std::array::from_fn(|axis| half[axis].max(before[axis])));
        }
    }
    most
}

fn mean(all: impl Iterator<Item = [f64; 3]>) -> Option<[f64; 3]> {
    let all: Vec<_> = all.collect();
    let count = all.len() as f64;
    let of = |axis: usize| all.iter().map(|mg| mg[axis]).sum::<f64>() / count;
    (!all.is_empty()).then(|| std::array::from_fn(of))
}

/// Root mean square of the difference between the first run and each later one at the same dwell
/// and orientation, in the unit of the residuals; `None` of a single run.
pub fn between_runs(mean_readings: &[MeanReading], residuals: &[[f64; 3]]) -> Option<f64> {
    let both = || mean_readings.iter().zip(residuals);
    let mut differences = Vec::new();
    for (later, mg) in both().filter(|(mean_reading, _)| mean_reading.run > 1) {
        let same = |(first, _): &(&MeanReading, &[f64; 3])| {
            first.run == 1 && first.step == later.step && first.orientation == later.orientation
        };
        if let Some((_, first)) = both().find(same) {
            differences.push(std::array::from_fn(|axis| mg[axis] - first[axis]));
        }
    }
    (!differences.is_empty()).then(|| rms(&differences))
}

/// `before` with this model in it. What it corrects at temperature `at`, without a model, it
/// corrects there in the same way with the model; one that had a model already is left as it is,
/// since every model is nothing at 25 degC. `None` when it does not fit the chain's numbers.
pub fn with_model(
    before: &Calibration,
    model: TemperatureModel,
    at: Temperature,
) -> Option<Calibration> {
    let mut made = before.clone();
    made.temperature = model;
    if before.temperature != TemperatureModel::None {
        return Some(made);
    }
    match &mut made.correction {
        Correction::Tables { tables, .. } => {
            let Axes { x, y } = &*tables;
            *tables = Axes {
                x: moved(x, 0, &model, at)?,
                y: moved(y, 1, &model, at)?,
            };
        }
        Correction::TwoAxis { vector, .. } | Correction::OneAxis { vector, .. } => {
            *vector = behind(vector, &model, at)?;
        }
    }
    Some(made)
}

/// A table of what is left of its accelerations behind the model.
fn moved(table: &Table, axis: usize, model: &TemperatureModel, at: Temperature) -> Option<Table> {
    let move_one = |point: &Point| {
        let accel = model
            .apply(
                Filtered {
                    accel: [point.accel; 3],
                },
                at,
            )
            .accel;
        Point {
            accel: accel[axis],
            angle: point.angle,
        }
    };
    let points: Vec<Point> = table.points().iter().map(move_one).collect();
    Table::new(&points).ok()
}

/// The vector that undoes the model at this temperature before it does its own work: the model is
/// c = c0 + s x of each axis there, so M x + o is (M / s) c + o - (M / s) c0.
fn behind(vector: &Vector, model: &TemperatureModel, at: Temperature) -> Option<Vector> {
    const FAR: i32 = 8 * ONE_G;
    let felt = |x: i32| {
        model
            .apply(Filtered { accel: [x; 3] }, at)
            .accel
            .map(f64::from)
    };
    let (low, high) = (felt(-FAR), felt(FAR));
    let slope = |axis: usize| (high[axis] - low[axis]) / f64::from(2 * FAR);
    let zero = |axis: usize| (high[axis] + low[axis]) / 2.0 / f64::from(ONE_G);
    let matrix = vector.matrix.map(|row| {
        let entry = |axis: usize| f64::from(row[axis]) / 2f64.powi(30) / slope(axis);
        std::array::from_fn(entry)
    });
    let rows = matrix.iter().zip(vector.offset);
    let mut offset_g = rows.map(|(row, offset): (&[f64; 3], i32)| {
        let undone: f64 = (0..3).map(|axis| row[axis] * zero(axis)).sum();
        f64::from(offset) / f64::from(ONE_G) - undone
    });
    let offset_g = [offset_g.next()?, offset_g.next()?, offset_g.next()?];
    Vector::from_real(matrix, offset_g)
}

#[cfg(test)]
mod tests {
    use super::super::profile::Step;
    use super::*;
    use tilt::angle::{Angle, slopes};
    use tilt::table::Rule;
    use tilt::temperature::{DataSheet, Quadratic};

    const POSES: [[f64; 3]; 4] = [
        [0.816, 0.0, -0.577],
        [-0.816, 0.0, -0.577],
        [0.0, 0.816, 0.577],
        [0.0, -0.816, 0.577],
    ];

    fn profile(temperatures: &[f64], runs: u32) -> Profile {
        let step = |degc: &f64| Step {
            temperature_degc: *degc,
            dwell_min: 1.0,
        };
        let steps = temperatures.iter().map(step).collect();
        Profile { runs, steps }
    }

    /// A part of 0.3 mg/degC, 0.8 ug/degC^2 and 0.012 %/degC, with a thermometer 4 degC off and
    /// this hysteresis, mg.
    fn mean_readings(
        profile: &Profile,
        poses: &[[f64; 3]],
        hysteresis_mg: f64,
    ) -> Vec<MeanReading> {
        let mut all = Vec::new();
        for (run, step) in profile.places() {
            let t = profile.steps[step].temperature_degc;
            let side = match profile.branch(run, step) {
                Branch::Up => hysteresis_mg,
                Branch::Down => -hysteresis_mg,
                Branch::Start => 0.0,
            };
            for (orientation, pose) in poses.iter().enumerate() {
                let d = t - 25.0;
                let accel_g = pose.map(|a| {
                    a * (1.01 + 1.2e-4 * d) + 0.02 + (0.3 * d - 0.0008 * d * d + side) / 1000.0
                });
                all.push(MeanReading {
                    run,
                    step,
                    orientation,
                    temperature_c: t + 4.0,
                    accel_g,
                });
            }
        }
        all
    }

    #[test]
    fn four_orientations_of_a_motor_with_two_axes_tell_offset_from_gain() {
        let profile = profile(&[-10.0, 10.0, 30.0, 50.0, 70.0, 50.0, 30.0, 10.0, -10.0], 2);
        let all = mean_readings(&profile, &POSES, 0.0);
        assert_eq!(alike(&all), None);
        let fitted = fit(Model::Quadratic, &profile, &all).unwrap();
        assert_eq!(fitted.span_c, [-6.0, 74.0]);
        assert!(
            rms(&fitted.residuals_mg) < 0.05,
            "{}",
            rms(&fitted.residuals_mg)
        );
        assert!(fitted.without_mg > 5.0);
        let hysteresis = hysteresis(&profile, &all, &fitted.residuals_mg).unwrap();
        assert!(hysteresis.iter().all(|mg| *mg < 0.02), "{hysteresis:?}");
        assert_eq!(between_runs(&all, &fitted.residuals_mg), Some(0.0));
    }

    #[test]
    fn hysteresis_is_seen_and_the_fit_comes_out_between_the_branches() {
        let profile = profile(&[-10.0, 10.0, 30.0, 50.0, 70.0, 50.0, 30.0, 10.0, -10.0], 1);
        let all = mean_readings(&profile, &POSES, 0.5);
        let fitted = fit(Model::Quadratic, &profile, &all).unwrap();
        let hysteresis = hysteresis(&profile, &all, &fitted.residuals_mg).unwrap();
        assert!(
            hysteresis.iter().all(|mg| (mg - 0.5).abs() < 0.05),
            "{hysteresis:?}"
        );
        assert_eq!(between_runs(&all, &fitted.residuals_mg), None);
    }

    #[test]
    fn orientations_that_are_too_alike_are_named_by_their_axis() {
        let profile = profile(&[0.0, 30.0, 60.0], 1);
        let flat = [
            [0.0, 0.0, 1.0],
            [0.1, 0.0, 1.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
        ];
        assert_eq!(alike(&mean_readings(&profile, &flat, 0.0)), Some('x'));
        let sides = [
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
        ];
        let all = mean_readings(&profile, &sides, 0.0);
        assert_eq!(alike(&all), None);
        assert!(fit(Model::Quadratic, &profile, &all).is_ok());
    }

    #[test]
    fn eq_6_goes_through_its_stairs_however_many_there_are() {
        for temperatures in [
            &[
                25.0, 0.0, -10.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0,
            ][..],
            &[-10.0, 30.0, 70.0],
            &[0.0, 40.0],
        ] {
            let profile = profile(temperatures, 2);
            profile.check(Model::Piecewise).unwrap();
            let all = mean_readings(&profile, &[[0.0, 0.0, 1.0]], 0.0);
            let fitted = fit(Model::Piecewise, &profile, &all).unwrap();
            let worst = rms(&fitted.residuals_mg);
            // At 25 degC the parabola lies off its secant.
            assert!(worst < 0.02, "{temperatures:?}: {worst}");
        }
    }

    /// A model of several mg at the temperature of a calibration.
    fn model() -> TemperatureModel {
        TemperatureModel::Quadratic(Quadratic {
            offset1_q8: [5_000_000, -3_000_000, 4_000_000],
            offset2_q16: [1_000_000, 2_000_000, -500_000],
            gain1_q38: [30_000_000, -20_000_000, 10_000_000],
            gain2_q46: [1_000_000, 0, -1_000_000],
        })
    }

    #[test]
    fn a_correction_made_without_a_model_gives_the_same_angle_with_it() {
        let vector = Vector::from_real(
            [
                [1.01, 0.02, -0.01],
                [0.015, 0.98, 0.03],
                [-0.02, 0.01, 1.005],
            ],
            [0.02, -0.031, 0.005],
        );
        let before = Calibration {
            correction: Correction::TwoAxis {
                vector: vector.unwrap(),
                harmonics: Axes::default(),
            },
            ..Calibration::NOMINAL
        };
        let angles = |calibration: &Calibration, accel: [i32; 3], at: Temperature| {
            let Correction::TwoAxis { vector, .. } = &calibration.correction else {
                panic!("another correction")
            };
            let felt = calibration.temperature.apply(Filtered { accel }, at);
            let found = slopes(vector.apply(felt));
            [found.x.degrees(), found.y.degrees()]
        };
        for celsius in [-5.0, 25.0, 31.5, 70.0] {
            let at = temperature(celsius);
            let made = with_model(&before, model(), at).unwrap();
            for up in [[0.0, 0.0, 1.0], [0.5, -0.3, 0.8], [-0.9, 0.1, 0.3]] {
                let accel = up.map(|g| (g * f64::from(ONE_G)) as i32);
                let (old, new) = (angles(&before, accel, at), angles(&made, accel, at));
                for (old, new) in old.iter().zip(new) {
                    assert!((old - new).abs() < 1e-5, "{celsius}: {old} {new}");
                }
            }
        }
    }

    #[test]
    fn a_table_made_without_a_model_gives_the_same_angle_with_it() {
        let point = |deg: i32| Point {
            accel: (f64::from(deg).to_radians().sin() * f64::from(ONE_G)) as i32,
            angle: Angle::from_degrees(f64::from(deg)),
        };
        let points: Vec<Point> = (-90..=90).step_by(5).map(point).collect();
        let table = Table::new(&points).unwrap();
        let before = Calibration {
            correction: Correction::Tables {
                tables: Axes {
                    x: table.clone(),
                    y: table.clone(),
                },
                rule: Rule::Linear,
            },
            ..Calibration::NOMINAL
        };
        let at = temperature(33.0);
        let eq5 = TemperatureModel::DataSheet(DataSheet {
            tco_q8: [3_000_000; 3],
        });
        for model in [model(), eq5] {
            let made = with_model(&before, model, at).unwrap();
            let Correction::Tables { tables, .. } = &made.correction else {
                panic!("another correction")
            };
            for accel in [-50_000_000, -1_000_000, 0, 12_345_678, 60_000_000] {
                let felt = made.temperature.apply(Filtered { accel: [accel; 3] }, at);
                let old = table.look_up(accel, Rule::Linear).degrees();
                let new = tables.y.look_up(felt.accel[1], Rule::Linear).degrees();
                assert!((old - new).abs() < 1e-4, "{accel}: {old} {new}");
            }
        }
    }

    #[test]
    fn a_model_that_is_replaced_leaves_the_correction_alone() {
        let before = Calibration {
            temperature: TemperatureModel::DataSheet(DataSheet { tco_q8: [1; 3] }),
            ..Calibration::NOMINAL
        };
        let made = with_model(&before, model(), temperature(40.0)).unwrap();
        assert_eq!(made.correction, before.correction);
        assert_eq!(made.temperature, model());
    }
}
