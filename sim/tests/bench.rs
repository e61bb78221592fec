//! The bench as a laboratory: what chamber and motor take out of a part, and what is left.
//!
//! In: parts with known errors on a perfect or nominal rig. Out: the chamber removes an injected
//! drift (R4), the verification round holds or is repeated (R5, R15), and the static test of a
//! perfect world shows nothing but rounding (R16); then one error term at a time.

use std::thread;

use sim::bench::calibrate::{CalibrationReport, TOLERANCE_DEG};
use sim::bench::characterise::mean_of_both;
use sim::bench::interpretation::Interpretation;
use sim::bench::static_test::{errors, knots};
use sim::bench::statistics::Tally;
use sim::bench::{Bench, Mode, World};
use sim::error_model::{ErrorModel, Term};
use sim::motor::MotorModel;
use sim::rig::{Fixture, Mount, RigSetup};
use sim::rng::Rng;
use sim::supply::Supply;
use tilt::ONE_G;
use tilt::filter::Filtered;

const PERFECT: World = World {
    parts: ErrorModel::PERFECT,
    rig: RigSetup::PERFECT,
    paper: Interpretation::REPRODUCED,
};

const AS_PRINTED: World = World {
    paper: Interpretation::AS_PRINTED,
    ..World::NOMINAL
};

const MG: f64 = ONE_G as f64 / 1000.0;

/// Level acceleration of each node at `celsius`, raw and compensated, mg.
fn level_mg(bench: &mut Bench, celsius: f64) -> [[[f64; 3]; 2]; 2] {
    bench.bring_to(celsius);
    let level = &mut Fixture::level();
    let means = mean_of_both(&mut bench.instrument, level, 1.0, 4.0, "level").unwrap();
    [0, 1].map(|node| {
        let model = &bench.instrument.sides[node]
            .settings
            .chain
            .calibration
            .temperature;
        let accel = means[node].accel.map(|a| a.round() as i32);
        let compensated = model.apply(Filtered { accel }, means[node].temperature);
        [accel, compensated.accel].map(|a| a.map(|a| f64::from(a) / MG))
    })
}

/// Drift from 20 to 60 degC, mg/degC: the largest raw one and the largest that is left.
fn drift(mode: Mode, seed: u64) -> (f64, f64) {
    let world = one_term(Term::Tco);
    let mut bench = Bench::new(mode, &world, seed, 1);
    bench.characterise().unwrap();
    let (cold, hot) = (level_mg(&mut bench, 20.0), level_mg(&mut bench, 60.0));
    let largest = |which: usize| {
        let drifts = (0..2).flat_map(|node| (0..3).map(move |axis| (node, axis)));
        drifts
            .map(|(n, a)| ((hot[n][which][a] - cold[n][which][a]) / 40.0).abs())
            .fold(0.0, f64::max)
    };
    (largest(0), largest(1))
}

#[test]
fn r4_the_chamber_takes_an_injected_drift_out_in_both_modes() {
    for mode in [Mode::Paper, Mode::Product] {
        for seed in 1..=5 {
            let (raw, left) = drift(mode, seed);
            println!("{mode:?}: of {raw:.3} mg/degC {left:.4} are left");
            assert!(raw > 0.1, "there is something to take out: {raw}");
            assert!(left < 0.005, "{mode:?}: {left}");
        }
    }
}

#[test]
fn r5_the_paper_s_tables_read_their_own_knots_back() {
    let (mut bench, _) = Bench::commissioned(Mode::Paper, &PERFECT, 5, 1).unwrap();
    for mount in [Mount::X, Mount::Y] {
        bench.mount(mount, 0.0, 0.0);
        let points = bench.static_test(mount, &knots());
        for node in 0..2 {
            // At +-90 neighbouring knots share an acceleration (E6).
            let within: Vec<_> = points[1..18].to_vec();
            let errors = errors(&within, node);
            assert_eq!(errors.count(), 17);
            assert!(errors.largest() < 1e-6, "{mount:?}: {}", errors.largest());
        }
    }
}

#[test]
fn r15_the_product_is_within_tolerance_at_the_first_round() {
    for mode in [Mode::Product, Mode::OneAxis] {
        for unit in 1..=4 {
            let (_, reports) = Bench::commissioned(mode, &World::NOMINAL, 15, unit).unwrap();
            for report in reports {
                assert!(
                    report.passed() && report.rounds == 1,
                    "{mode:?}: {report:?}"
                );
            }
        }
    }
}

#[test]
fn r15_paper_mode_is_within_tolerance_up_to_80_deg_and_as_printed_is_not() {
    for unit in 1..=4 {
        let (_, reports) = Bench::commissioned(Mode::Paper, &World::NOMINAL, 15, unit).unwrap();
        for report in reports {
            assert!(report.passed() && report.rounds == 1, "{report:?}");
            // E6: towards 90 deg one axis cannot.
            assert!(report.beyond.largest() > TOLERANCE_DEG, "{report:?}");
        }
        let (_, reports) = Bench::commissioned(Mode::Paper, &AS_PRINTED, 15, unit).unwrap();
        assert!(reports.iter().all(|r| !r.passed() && r.rounds == 3));
    }
}

#[test]
fn r17_as_printed_the_nearest_point_and_two_instants_miss_table_iii() {
    let (mut bench, _) = Bench::commissioned(Mode::Paper, &AS_PRINTED, 17, 1).unwrap();
    let result = bench.dynamic_test(Mount::X, 0.0);
    // E4 and E11: 0.289 deg of the table alone, and nodes up to 20 ms apart.
    assert!(result.aligned.iter().all(|node| node.rms() > 0.25));
    assert!(result.warnings > 100, "{}", result.warnings);
}

/// Calibrates with node 2's supply bad between these times, s from the start of the calibration;
/// gives the reports and how long it took, s.
fn calibrated_with_bad_supply(bad_s: (f64, f64)) -> ([CalibrationReport; 2], f64) {
    let mut bench = Bench::new(Mode::Product, &World::NOMINAL, 15, 1);
    bench.characterise().unwrap();
    let start_s = bench.instrument.time_s();
    let mut supply = Supply::unstable(start_s + bad_s.0, &mut Rng::stream(0, "supply"));
    supply.repair(start_s + bad_s.1);
    bench.instrument.sides[1].electronics.supply = supply;
    let reports = bench.calibrate().unwrap();
    (reports, bench.instrument.time_s() - start_s)
}

#[test]
fn r15_a_spoiled_round_is_calibrated_anew() {
    let (clean, length_s) = calibrated_with_bad_supply((0.0, 0.0));
    assert_eq!(clean.map(|report| report.rounds), [1, 1]);
    // The verification comes last; the supply sags for a minute of it.
    let spoiled_s = (0.9 * length_s, 0.9 * length_s + 60.0);
    let ([one, two], _) = calibrated_with_bad_supply(spoiled_s);
    assert_eq!((one.rounds, two.rounds), (2, 2), "both go round again");
    assert!(one.passed() && two.passed(), "{one:?} {two:?}");
    let counts = [one, two].map(|report| report.verification.count());
    assert_eq!(
        counts,
        clean.map(|report| report.verification.count()),
        "of the last round only"
    );
}

#[test]
fn r15_three_rounds_are_the_most_and_the_failure_is_reported() {
    let motor = MotorModel {
        repeatability_deg: 0.6,
        ..MotorModel::NOMINAL
    };
    let rig = RigSetup {
        motor,
        ..RigSetup::NOMINAL
    };
    let world = World {
        rig,
        ..World::NOMINAL
    };
    let mut bench = Bench::new(Mode::Product, &world, 15, 1);
    let reports = bench.calibrate().unwrap();
    for report in reports {
        assert_eq!(report.rounds, 3);
        assert!(!report.passed() && report.verification.largest() > TOLERANCE_DEG);
    }
}

/// Static errors at 40 random angles on each axis, both nodes.
fn static_errors(world: &World, seed: u64) -> Tally {
    let (mut bench, _) = Bench::commissioned(Mode::Product, world, seed, 1).unwrap();
    let mut all = Tally::default();
    for mount in [Mount::X, Mount::Y] {
        bench.mount(mount, 0.0, 0.0);
        let angles_deg = bench.random_angles(40, 90.0);
        let points = bench.static_test(mount, &angles_deg);
        (0..2).for_each(|node| all.join(&errors(&points, node)));
    }
    all
}

fn one_term(term: Term) -> World {
    World {
        parts: ErrorModel::NOMINAL.only(term),
        rig: RigSetup::PERFECT,
        paper: Interpretation::REPRODUCED,
    }
}

#[test]
fn r16_a_perfect_world_shows_nothing_but_rounding() {
    let errors = static_errors(&PERFECT, 16);
    assert_eq!(errors.count(), 160);
    assert!(errors.largest() < 0.002, "{}", errors.largest());
}

const TERMS: &[Term] = &Term::ALL;

/// Most that each term may leave behind a calibration, deg rms. Noise and turn-on can't be
/// calibrated; what the others leave is at the register's rounding, 0.001 deg.
fn most_rms_deg(term: Term) -> f64 {
    match term {
        Term::TurnOn => 0.05,
        Term::WhiteNoise => 0.02,
        Term::Flicker => 0.005,
        Term::Quantisation => 0.006,
        _ => 0.002,
    }
}

#[test]
fn r16_each_error_term_alone_leaves_no_more_than_it_may() {
    // Two worlds at a time, as the machine that runs the tests has two cores at least.
    let results: Vec<(Term, Tally)> = thread::scope(|scope| {
        let figures = |half: &'static [Term]| {
            move || {
                half.iter()
                    .map(|&t| (t, static_errors(&one_term(t), 16)))
                    .collect::<Vec<_>>()
            }
        };
        let (first, second) = TERMS.split_at(TERMS.len() / 2);
        let halves = [first, second].map(|half| scope.spawn(figures(half)));
        halves
            .into_iter()
            .flat_map(|half| half.join().unwrap())
            .collect()
    });
    assert_eq!(results.len(), Term::ALL.len());
    for (term, errors) in results {
        let name = format!("{term:?}");
        println!(
            "{name:20} rms {:.5} deg, largest {:.5}",
            errors.rms(),
            errors.largest()
        );
        assert!(
            errors.rms() < most_rms_deg(term),
            "{name}: {}",
            errors.rms()
        );
    }
}

#[test]
fn r16_on_its_knots_a_nominal_product_stays_within_0_20_deg_without_a_warning() {
    let (mut bench, _) = Bench::commissioned(Mode::Product, &World::NOMINAL, 16, 2).unwrap();
    for mount in [Mount::X, Mount::Y] {
        bench.mount(mount, 0.0, 0.0);
        let points = bench.static_test(mount, &knots());
        assert_eq!(points.len(), 19);
        for node in 0..2 {
            let errors = errors(&points, node);
            assert!(
                errors.largest() <= TOLERANCE_DEG,
                "{mount:?}: {}",
                errors.largest()
            );
        }
        assert!(points.iter().all(|p| !p.warning));
    }
}

#[test]
fn r17_the_swing_is_right_once_aligned_by_the_declared_latency() {
    for (mode, latency_ms) in [(Mode::Product, 25.0), (Mode::Paper, 40.0)] {
        let (mut bench, _) = Bench::commissioned(mode, &World::NOMINAL, 17, 1).unwrap();
        let result = bench.dynamic_test(Mount::X, 0.0);
        assert_eq!(result.invalid, 0);
        assert!(result.points.len() > 1000, "{}", result.points.len());
        for node in 0..2 {
            let (arrives, aligned) = (result.as_it_arrives[node], result.aligned[node]);
            let declared_ms = result.latency_ms[node].mean();
            println!(
                "{mode:?}: {declared_ms:.2} ms, {:.3} and {:.3} deg rms",
                arrives.rms(),
                aligned.rms()
            );
            assert!(declared_ms > latency_ms - 0.01, "{declared_ms}");
            // E2: what arrives is late by 80 deg/s times the latency.
            assert!(
                arrives.largest() > 0.9 * 0.080 * latency_ms,
                "{}",
                arrives.largest()
            );
            // Table III publishes 0.085 to 0.100 deg.
            let most = if mode == Mode::Paper { 0.11 } else { 0.06 };
            assert!(aligned.rms() < most, "{}", aligned.rms());
        }
        assert_eq!(result.warnings, 0);
        if mode == Mode::Product {
            // E15: 0.11 deg a centimetre while it turns, and more while it speeds up.
            let arm = bench.dynamic_test(Mount::X, 0.05).aligned[0].rms();
            println!("{arm:.3} deg rms at 5 cm");
            assert!(arm > 0.57, "{arm}");
        }
    }
}
