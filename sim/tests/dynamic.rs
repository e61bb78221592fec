//! The variant with a gyroscope, from the chamber to the boom.

use sim::bench::boom::BoomResult;
use sim::bench::{Bench, Mode, World};
use sim::campaign::{self, Outcome, draw};
use sim::excavator::ExcavatorSetup;
use sim::fault::{RateFault, SensorFault};
use sim::rig::Mount;
use sim::rng::Rng;
use sim::trial::checks::REACTION_S;
use sim::trial::checks::detection::Blame;
use sim::trial::inject::{Injection, What};
use sim::trial::pool::Pool;
use sim::trial::{self, Setup};

/// A unit through chamber, motor and turns, switched off and on; the first of the tables.
fn commissioned() -> Bench {
    let commissioned = Bench::commissioned(Mode::Dynamic, &World::NOMINAL, 1, 0);
    commissioned.expect("a sound unit").0
}

#[test]
fn a_calibrated_unit_follows_swing_and_boom_as_it_arrives() {
    let mut bench = commissioned();
    for mount in [Mount::X, Mount::Y] {
        for lever_arm_m in [0.0, 0.02, 0.05] {
            let found = bench.dynamic_test(mount, lever_arm_m);
            assert_eq!(found.invalid, 0);
            assert_eq!(found.warnings, 0);
            for node in found.as_it_arrives {
                let rms_deg = node.rms();
                assert!(rms_deg <= 0.10, "{mount:?} {lever_arm_m} m: {rms_deg}");
            }
        }
    }
    let mut all = BoomResult::default();
    for machine in [ExcavatorSetup::NOMINAL, ExcavatorSetup::SLEWING] {
        for lever_arm_m in [1.0, 3.0] {
            let machine = ExcavatorSetup {
                lever_arm_m,
                ..machine
            };
            let found = bench.on_the_boom(&machine, 60.0);
            let (working, resting) = (found.working.rms(), found.resting.rms());
            assert!(
                working <= 0.5 && resting <= 0.05,
                "{machine:?}: {working} {resting}"
            );
            all.join(&found);
        }
    }
    // Twice the standard uncertainty is to cover 95 %.
    let covered = all.covered as f64 / all.valid() as f64;
    assert!(covered >= 0.95, "{covered}");
}

/// The worst of 30 units was 0.995 deg off, with 0.07 deg stated: at 70 degC its gyroscope's scale
/// is 0.8 % off without slopes, and a vertical so wrong was taken for a machine that gains speed.
#[test]
fn a_scale_over_temperature_leaves_no_valid_angle_wrong_by_a_degree() {
    let commissioned = Bench::commissioned(Mode::Dynamic, &World::NOMINAL, 1, 15);
    let mut bench = commissioned.expect("a sound unit").0;
    bench.forget_slopes();
    bench.power_cycle();
    let points = bench.thermal_test(Mount::Y, 8);
    let nodes = points.iter().flat_map(|point| &point.nodes);
    let (mut within, mut all) = (0.0, 0.0);
    for node in nodes {
        assert!(node.angle_deg.is_some());
        assert!(node.error_deg.abs() <= 0.20, "{node:?}");
        within += f64::from(node.error_deg.abs() <= 2.0 * node.uncertainty_deg);
        all += 1.0;
    }
    assert!(within >= 0.95 * all, "{within} of {all}");
}

/// Up to 22 deg, for up to 9 s, at both channels in agreement: what a swapped axis or a stuck
/// accelerometer had shown of gyroscope and vertical was kept when the fault was over.
#[test]
fn a_channel_came_back_with_what_its_fault_had_taught_the_estimator() {
    for seed in [18, 150, 272, 296, 1399] {
        let outcome = trial(seed);
        assert!(!outcome.setup.faults.is_empty());
        let wrong_s = outcome.report.longest_wrong_s;
        assert!(wrong_s <= REACTION_S, "{outcome}");
    }
}

/// It looked for its vertical for more than 2 s, as on a machine that moves, and was held faulty.
#[test]
fn a_start_in_motion_was_taken_for_a_fault() {
    all_pass([43, 441]);
}

/// The estimator believed the first velocities after a rest to be errors of the vertical.
#[test]
fn a_rest_made_the_estimator_forget_how_fast_the_machine_moves() {
    all_pass([142, 179, 549, 582]);
}

/// Noise, a bias and a jump of the thermometer counted as gone only once both had angles again.
#[test]
fn a_fault_that_had_gone_was_held_until_the_vertical_was_found() {
    all_pass([231, 404, 467, 1154, 1363]);
}

#[test]
fn a_disagreement_left_both_with_what_a_fault_had_taught_their_estimators() {
    all_pass([407, 1051]);
}

/// The offset was within four of the momentary uncertainties of both.
#[test]
fn an_offset_of_one_node_passed_for_what_motion_leaves_unknown() {
    all_pass([1440, 1737]);
}

/// A channel that began anew in the dispute took its gyroscope for one without bias, and the pair
/// then named the healthy one.
#[test]
fn a_scale_error_while_digging_named_the_healthy_channel() {
    const UNIT: u32 = 3;
    let pool = Pool::of(&[(Mode::Dynamic, UNIT)]).expect("a sound unit");
    for seed in [23, 43, 67, 87, 107] {
        let from_s = Rng::stream(seed, "gyroscope fault").range(20.0, 30.0);
        let fault = SensorFault::Gyroscope(RateFault::Scale { ratio: -0.05 });
        let setup = Setup {
            mode: Mode::Dynamic,
            unit: UNIT,
            power_cycles: (seed % 5) as u32,
            machine: ExcavatorSetup::NOMINAL,
            faults: vec![Injection {
                what: What::Sensor(fault),
                channel: (seed % 2) as usize,
                from_s,
                until_s: from_s + 40.0,
            }],
            ..Setup::healthy(seed)
        };
        let report = trial::run(&setup, &pool, |_| {}).expect("a unit of the pool");
        let blame = report.detections[0].blame();
        assert_ne!(blame, Blame::Wrong, "seed {seed}");
    }
}

fn all_pass<const N: usize>(seeds: [u64; N]) {
    for seed in seeds {
        let outcome = trial(seed);
        assert!(outcome.passed(), "{outcome}");
    }
}

/// The trial of a seed with a gyroscope in the product.
fn trial(seed: u64) -> Outcome {
    let setup = Setup {
        mode: Mode::Dynamic,
        ..draw(seed)
    };
    let pool = campaign::pool_for(&setup).unwrap();
    campaign::run(setup, &pool, |_| {}).unwrap()
}

#[test]
fn the_turns_of_the_motor_show_scale_and_axes_to_a_thousandth() {
    let mut bench = Bench::new(Mode::Dynamic, &World::NOMINAL, 2, 5);
    bench.characterise().expect("a sound unit");
    bench.calibrate().expect("a sound unit");
    // As long as nothing is known of the gyroscope, angles are those of the accelerometer.
    let latency = |bench: &mut Bench| {
        bench.run(1.0);
        let reading = bench.instrument.sync().readings[0].x;
        reading.expect("an angle").latency_us
    };
    assert_eq!(latency(&mut bench), 25_000);
    let reports = bench.calibrate_gyroscopes().expect("turns that fit");
    for report in reports.expect("gyroscopes") {
        let uncertainties = report.gains.uncertainty.as_flattened().iter();
        assert!(uncertainties.copied().fold(0.0, f64::max) < 0.001);
        assert!(report.gains.residual_rms_deg < 0.1);
        assert!(report.bias.residual_rms_deg_s < 0.01);
    }
    assert_eq!(latency(&mut bench), 5_000);
}

#[test]
fn product_and_paper_have_no_gyroscope_to_calibrate() {
    for mode in [Mode::Product, Mode::Paper, Mode::OneAxis] {
        let mut bench = Bench::new(mode, &World::NOMINAL, 1, 0);
        assert_eq!(bench.calibrate_gyroscopes(), Ok(None));
    }
}

/// Its node stores what it has found while PDOs wait: they have gone out when the erase of a page
/// ends, and are too old.
#[test]
fn a_frame_that_went_out_during_a_standstill_was_taken_back_after_it() {
    all_pass([22489]);
}
