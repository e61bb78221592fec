//! Runs of the motor as a host leads them.

extern crate std;

use std::f64::consts::PI;
use std::vec::Vec;

use instant::Instant;
use proptest::prelude::*;
use tilt::ONE_G;
use tilt::angle::Harmonics;
use tilt::chain::{Measurement, PART_DELAY_Q16, Timing};
use tilt::filter::LowPass;
use tilt::sample::FullScale;
use tilt::table::MAX_POINTS;
use tilt::temperature::TemperatureModel;
use tilt::uncertainty::{Budget, Span, Uncertainty};
use tilt::vector::Vector;

use super::*;

const TERMS: TableSettings = TableSettings {
    rule: Rule::Linear,
    reference: Uncertainty(200_000),
};

/// A chain that has only the formula, as from the factory.
fn factory() -> Chain {
    let harmonics = Axes::<Harmonics>::default();
    Chain {
        filter: LowPass::PAPER,
        full_scale: FullScale::G2,
        period_us: 20_000,
        part_delay_q16: PART_DELAY_Q16,
        timing: Timing::AsItArrives,
        calibration: Calibration {
            temperature: TemperatureModel::None,
            correction: Correction::TwoAxis {
                vector: Vector::IDENTITY,
                harmonics,
            },
            budget: Budget::DATA_SHEET,
            rates: None,
        },
        fusion: None,
    }
}

/// What a part sees that reads 10 mg too much on every axis.
fn sight(axis: Axis, degrees: f64) -> StandReading {
    let (sin, cos) = (degrees * PI / 180.0).sin_cos();
    let [along, across] = [sin, cos].map(|v| ((v + 0.01) * f64::from(ONE_G)) as i32);
    let offset = ONE_G / 100;
    let accel = match axis {
        Axis::X => [along, offset, across],
        Axis::Y => [offset, along, across],
    };
    let measured = Measurement {
        angle: Angle(0),
        uncertainty: Uncertainty(0),
        unshared: Uncertainty(0),
        at: Instant(0),
        latency_us: 0,
    };
    StandReading {
        filtered: Some(Filtered { accel }),
        temperature: None,
        reading: Axes {
            x: Ok(measured),
            y: Ok(measured),
        },
    }
}

fn sweep(motor: &mut Motor, chain: &Chain, axis: Axis, references: impl Iterator<Item = i32>) {
    for reference in references {
        let seen = sight(axis, f64::from(reference) / 1000.0);
        motor.memorise(reference, chain, &seen).unwrap();
    }
}

fn degrees_found(chain: &Chain, axis: Axis, degrees: f64) -> f64 {
    let filtered = sight(axis, degrees).filtered.unwrap();
    let found = chain.evaluate(filtered, Temperature::REFERENCE);
    axis.of(&found).unwrap().angle.degrees()
}

#[test]
fn two_sweeps_make_two_tables_and_a_third_verifies_them() {
    let (mut motor, mut chain) = (Motor::new(), factory());
    let tell = |motor: &mut Motor, command, chain: &mut Chain| {
        motor.command(command, &TERMS, &mut chain.calibration)
    };
    let begun = tell(&mut motor, Command::StartX, &mut chain);
    assert_eq!(begun, Ok(Outcome::Running));
    sweep(&mut motor, &chain, Axis::X, (-90..=90).map(|d| d * 1000));
    assert_eq!(motor.progress().points, Axes { x: 181, y: 0 });
    // 10 mg are 0.57 deg where the axis is level, and more towards the vertical.
    assert!(motor.progress().worst > 570);
    tell(&mut motor, Command::StartY, &mut chain).unwrap();
    assert_eq!(motor.progress().points, Axes { x: 181, y: 0 });
    sweep(
        &mut motor,
        &chain,
        Axis::Y,
        (-90..=90).rev().map(|d| d * 1000),
    );
    let ended = tell(&mut motor, Command::Finish, &mut chain);
    assert_eq!(ended, Ok(Outcome::Finished));
    assert_eq!(motor.progress().points, Axes { x: 181, y: 181 });
    let budget = &chain.calibration.budget;
    assert_eq!(budget.reference, TERMS.reference);
    assert_eq!(budget.span, Span::REFERENCE, "no temperature is known");
    // Points without noise: what the fourth power of a degree leaves.
    let bare = Budget::calibrated(TERMS.reference, Uncertainty(0), Span::REFERENCE);
    assert!(
        budget.repeatability.abs_diff(bare.repeatability) < 20,
        "{budget:?}"
    );
    for axis in [Axis::X, Axis::Y] {
        assert!((degrees_found(&chain, axis, 30.5) - 30.5).abs() < 0.01);
    }
    tell(&mut motor, Command::StartX, &mut chain).unwrap();
    sweep(
        &mut motor,
        &chain,
        Axis::X,
        (-80..=80).map(|d| d * 1000 + 500),
    );
    assert!(motor.progress().worst < 200, "{:?}", motor.progress());
    let left = tell(&mut motor, Command::Abandon, &mut chain);
    assert_eq!((left, motor.is_running()), (Ok(Outcome::Abandoned), false));
}

/// A run of both axes in steps of `step` deg at `celsius`, with `noise_mg` on every other point.
fn calibrated(chain: &mut Chain, celsius: [i16; 2], step: usize, noise_mg: f64) {
    let mut motor = Motor::new();
    for (axis, command, celsius) in [
        (Axis::X, Command::StartX, celsius[0]),
        (Axis::Y, Command::StartY, celsius[1]),
    ] {
        let begun = motor.command(command, &TERMS, &mut chain.calibration);
        assert_eq!(begun, Ok(Outcome::Running));
        for (count, degrees) in (-90..=90).step_by(step).enumerate() {
            let mut seen = sight(axis, f64::from(degrees));
            seen.temperature = Some(Temperature::from_celsius(celsius + (count % 2) as i16));
            let sign = [-1.0, 1.0][count % 2];
            for accel in &mut seen.filtered.as_mut().unwrap().accel {
                *accel += (sign * noise_mg / 1000.0 * f64::from(ONE_G)) as i32;
            }
            motor.memorise(degrees * 1000, chain, &seen).unwrap();
        }
    }
    let ended = motor.command(Command::Finish, &TERMS, &mut chain.calibration);
    assert_eq!(ended, Ok(Outcome::Finished));
}

#[test]
fn the_uncertainty_was_0_after_a_calibration_by_2060h() {
    let mut chain = factory();
    calibrated(&mut chain, [22, 22], 10, 0.3);
    let at = |degrees: f64, celsius: i16| {
        let filtered = sight(Axis::X, degrees).filtered.unwrap();
        let found = chain.evaluate(filtered, Temperature::from_celsius(celsius));
        let found = found.x.unwrap();
        let error = found.angle.degrees() - degrees;
        (error, found.unshared.degrees())
    };
    for degrees in [-85.0, -60.0, -33.3, 0.0, 12.0, 45.0, 77.0, 89.0] {
        let (error, u) = at(degrees, 22);
        assert!(u > 0.02 && error.abs() < 1.96 * u, "{degrees}: {error} {u}");
    }
    assert!(at(15.0, 22).1 < 0.12, "a line between points 10 deg apart");
    // The turn-on offset twice, and points that are off by 0.3 mg, their neighbours by as much.
    let budget = &chain.calibration.budget;
    let bare = Budget::calibrated(TERMS.reference, Uncertainty(0), Span::REFERENCE);
    assert!(
        budget.repeatability > bare.repeatability + 10_000,
        "{budget:?}"
    );
    let at_22_to_23 = Span {
        low: Temperature::from_celsius(22),
        high: Temperature::from_celsius(23),
    };
    assert_eq!((budget.span, budget.tco), (at_22_to_23, bare.tco));
    assert!(at(0.0, 62).1 > 0.45, "40 degC away");
}

#[test]
fn axes_calibrated_at_two_temperatures_count_by_the_farther_one() {
    let mut chain = factory();
    calibrated(&mut chain, [10, 30], 10, 0.0);
    let span = chain.calibration.budget.span;
    let beyond = [10, 20, 31].map(|c| span.beyond(Temperature::from_celsius(c)) / 256);
    assert_eq!(beyond, [20, 10, 20]);
}

#[test]
fn a_table_that_is_kept_brings_its_span_and_its_reference_along() {
    let mut chain = factory();
    calibrated(&mut chain, [20, 20], 10, 0.0);
    chain.calibration.budget.reference = Uncertainty(9_000_000);
    let mut motor = Motor::new();
    let calibration = &mut chain.calibration;
    motor.command(Command::StartX, &TERMS, calibration).unwrap();
    for degrees in [-60, 0, 60] {
        let mut seen = sight(Axis::X, f64::from(degrees));
        seen.temperature = Some(Temperature::from_celsius(40));
        motor.memorise(degrees * 1000, &chain, &seen).unwrap();
    }
    let calibration = &mut chain.calibration;
    motor.command(Command::Finish, &TERMS, calibration).unwrap();
    let budget = &chain.calibration.budget;
    assert_eq!(budget.reference, Uncertainty(9_000_000));
    let beyond = [20, 40].map(|c| budget.span.beyond(Temperature::from_celsius(c)) / 256);
    assert_eq!(beyond, [20, 19]);
}

#[test]
fn a_temperature_model_in_force_keeps_its_span() {
    let mut chain = factory();
    let model = tilt::temperature::Quadratic::default();
    chain.calibration.temperature = TemperatureModel::Quadratic(model);
    chain.calibration.budget.span = Span::CHAMBER;
    chain.calibration.budget.tco = 7;
    calibrated(&mut chain, [20, 20], 10, 0.0);
    let budget = &chain.calibration.budget;
    assert_eq!((budget.span, budget.tco), (Span::CHAMBER, 7));
}

#[test]
fn a_run_without_tables_in_force_needs_both_axes() {
    let (mut motor, mut chain) = (Motor::new(), factory());
    motor
        .command(Command::StartY, &TERMS, &mut chain.calibration)
        .unwrap();
    sweep(
        &mut motor,
        &chain,
        Axis::Y,
        [-50_000, 0, 50_000].into_iter(),
    );
    let refused = motor.command(Command::Finish, &TERMS, &mut chain.calibration);
    assert_eq!(refused, Err(MotorError::Missing(Axis::X)));
    assert_eq!(motor.progress().points.y, 3);
    motor
        .command(Command::StartX, &TERMS, &mut chain.calibration)
        .unwrap();
    sweep(&mut motor, &chain, Axis::X, [-50_000, 0].into_iter());
    let ended = motor.command(Command::Finish, &TERMS, &mut chain.calibration);
    assert_eq!(ended, Ok(Outcome::Finished));
}

#[test]
fn with_tables_in_force_one_axis_can_be_made_anew() {
    let (mut motor, mut chain) = (Motor::new(), factory());
    let table = |span: i32| {
        let points = [-1, 1].map(|side| Point {
            accel: side * span,
            angle: Angle(side << 28),
        });
        Table::new(&points).unwrap()
    };
    let tables = Axes {
        x: table(ONE_G / 3),
        y: table(ONE_G / 2),
    };
    let kept = tables.y.clone();
    chain.calibration.correction = Correction::Tables {
        tables,
        rule: Rule::Nearest,
    };
    motor
        .command(Command::StartX, &TERMS, &mut chain.calibration)
        .unwrap();
    sweep(
        &mut motor,
        &chain,
        Axis::X,
        [-60_000, 10, 60_000].into_iter(),
    );
    motor
        .command(Command::Finish, &TERMS, &mut chain.calibration)
        .unwrap();
    let Correction::Tables { tables: made, rule } = &chain.calibration.correction else {
        panic!("{chain:?}");
    };
    assert_eq!((&made.y, *rule), (&kept, Rule::Linear));
    assert_eq!(made.x.points().len(), 3);
}

#[test]
fn points_that_make_no_table_leave_the_run_as_it_was() {
    let (mut motor, mut chain) = (Motor::new(), factory());
    let before = chain.calibration.clone();
    motor
        .command(Command::StartX, &TERMS, &mut chain.calibration)
        .unwrap();
    sweep(&mut motor, &chain, Axis::X, [5_000].into_iter());
    let refused = motor.command(Command::StartY, &TERMS, &mut chain.calibration);
    assert_eq!(refused, Err(MotorError::Table(Axis::X, TableError::TooFew)));
    assert_eq!(motor.progress().axis, Some(Axis::X));
    assert_eq!(motor.progress().points.x, 1);
    assert_eq!(before, chain.calibration);
}

#[test]
fn a_reference_is_refused_when_it_cannot_be_a_point() {
    let (mut motor, mut chain) = (Motor::new(), factory());
    let seen = sight(Axis::X, 0.0);
    let idle = motor.memorise(0, &chain, &seen);
    assert_eq!(idle, Err(MotorError::NotRunning));
    motor
        .command(Command::StartX, &TERMS, &mut chain.calibration)
        .unwrap();
    for beyond in [90_001, -90_001, i32::MAX, i32::MIN] {
        let refused = motor.memorise(beyond, &chain, &seen);
        assert_eq!(refused, Err(MotorError::Reference));
    }
    motor.memorise(0, &chain, &seen).unwrap();
    let again = motor.memorise(0, &chain, &seen);
    assert_eq!(again, Err(MotorError::SameAngle));
    for reference in 1..MAX_POINTS as i32 {
        motor.memorise(reference, &chain, &seen).unwrap();
    }
    let one_more = motor.memorise(1000, &chain, &seen);
    assert_eq!(one_more, Err(MotorError::Full));
    assert_eq!(motor.progress().points.x, 181);
}

#[test]
fn nothing_is_memorised_of_a_channel_that_is_not_valid() {
    let (mut motor, mut chain) = (Motor::new(), factory());
    motor
        .command(Command::StartY, &TERMS, &mut chain.calibration)
        .unwrap();
    let mut seen = sight(Axis::Y, 0.0);
    for reason in [Invalid::Settling, Invalid::Stale, Invalid::Bus] {
        seen.reading.y = Err(reason);
        let refused = motor.memorise(0, &chain, &seen);
        assert_eq!(refused, Err(MotorError::NoReading(reason)));
    }
    // An axis that is not measured yet is what a calibration is for.
    seen.reading.y = Err(Invalid::NotMeasured);
    seen.reading.x = Err(Invalid::Settling);
    let refused = motor.memorise(0, &chain, &seen);
    assert_eq!(refused, Err(MotorError::NoReading(Invalid::Settling)));
    seen.reading.x = sight(Axis::X, 0.0).reading.x;
    assert_eq!(motor.memorise(0, &chain, &seen), Ok(()));
    seen.filtered = None;
    let refused = motor.memorise(1, &chain, &seen);
    assert_eq!(refused, Err(MotorError::NoReading(Invalid::NoSample)));
    assert_eq!(motor.progress().points.y, 1);
}

#[test]
fn finished_points_are_kept_until_the_next_run() {
    let (mut motor, mut chain) = (Motor::new(), factory());
    let calibration = &mut chain.calibration;
    motor.command(Command::StartX, &TERMS, calibration).unwrap();
    sweep(&mut motor, &chain, Axis::X, [-50_000, 50_000].into_iter());
    let calibration = &mut chain.calibration;
    motor.command(Command::StartY, &TERMS, calibration).unwrap();
    let refused = motor.command(Command::Finish, &TERMS, calibration);
    assert_eq!(refused, Err(MotorError::Table(Axis::Y, TableError::TooFew)));
    assert_eq!(motor.progress().points, Axes { x: 2, y: 0 });
    motor
        .command(Command::Abandon, &TERMS, calibration)
        .unwrap();
    motor.command(Command::StartY, &TERMS, calibration).unwrap();
    assert_eq!(motor.progress().points, Axes { x: 0, y: 0 });
}

#[test]
fn every_refusal_has_a_number_of_its_own() {
    let tables = [
        TableError::TooFew,
        TableError::TooMany,
        TableError::NotRising,
        TableError::Flat,
    ];
    let mut errors = std::vec![
        MotorError::NotRunning,
        MotorError::Reference,
        MotorError::SameAngle,
        MotorError::Full,
    ];
    for axis in [Axis::X, Axis::Y] {
        errors.push(MotorError::Missing(axis));
        errors.extend(tables.map(|error| MotorError::Table(axis, error)));
    }
    errors.extend(
        (1..32)
            .filter_map(crate::exchange::reason)
            .map(MotorError::NoReading),
    );
    let mut codes: Vec<_> = errors.iter().map(|error| error.code()).collect();
    codes.sort_unstable();
    codes.dedup();
    assert_eq!((codes.len(), codes.first()), (errors.len(), Some(&1)));
}

#[test]
fn commands_have_the_numbers_one_to_four() {
    let known = (0..=u8::MAX).filter_map(Command::from_number);
    let numbers: Vec<_> = known.map(|command| command as u8).collect();
    assert_eq!(numbers, [1, 2, 3, 4]);
}

proptest! {
    #[test]
    fn thousandths_of_a_degree_come_back(value in -90_000..=90_000_i32) {
        let angle = from_millidegrees(value);
        let exact = Angle::from_degrees(f64::from(value) / 1000.0);
        prop_assert!(angle.minus(exact).magnitude() <= 1);
        prop_assert_eq!(to_millidegrees(angle), value);
    }

    #[test]
    fn points_in_any_order_end_up_rising(
        references in prop::collection::vec(-90_000..=90_000_i32, 0..190)
    ) {
        let mut points = Points::new();
        for &reference in &references {
            let point = Point { accel: reference, angle: from_millidegrees(reference) };
            let _ = points.insert(point);
        }
        let taken = points.as_slice();
        prop_assert!(taken.windows(2).all(|pair| pair[0].angle < pair[1].angle));
        prop_assert!(taken.iter().all(|p| p.angle == from_millidegrees(p.accel)));
        let different: std::collections::BTreeSet<_> = references.iter().collect();
        prop_assert_eq!(taken.len(), different.len().min(MAX_POINTS));
    }
}
