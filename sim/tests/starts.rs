//! The variant with a gyroscope switched on in a machine that moves.
//!
//! In: machines whose cab stands or slews, that dig or stop and go, shaken or smooth, each from
//! many moments of their work. Out: each angle now is right within three of its stated standard
//! uncertainties, or 0.6 deg.
//!
//! Left out: faults, which `cargo sim fixed --gyroscope` draws.

use sim::bench::{Bench, Mode, World};
use sim::excavator::{Excavator, ExcavatorSetup, Scene};
use sim::motion::Mover;
use sim::rng::Rng;
use sim::trial::checks::{COVERAGE, LIMIT_DEG};

/// How long each start is watched, s.
const WATCHED_S: f64 = 12.0;

/// Up to this long the machine has worked before the instrument is switched on, s: one cycle.
const BEFORE_S: f64 = 20.0;

/// Readings are taken every 20 ms.
const SYNC_TICKS: u32 = 20;

/// One machine in the middle of its work.
fn machine(setup: &ExcavatorSetup, seed: u64) -> (Excavator, f64) {
    let mut rng = Rng::stream(seed, "starts");
    let setup = ExcavatorSetup {
        lever_arm_m: rng.range(0.0, 1.5),
        sway_deg: rng.range(0.0, 5.0),
        ..*setup
    };
    let mut machine = Excavator::new(&setup, &mut rng);
    let begins_s = rng.range(0.0, BEFORE_S);
    for tick in 0..(begins_s / sim::TICK_S) as u32 {
        machine.step(f64::from(tick) * sim::TICK_S);
    }
    (machine, begins_s)
}

/// Switches the instrument on and watches it; an angle that is wrong, if any, and how many were
/// right.
fn start(bench: &mut Bench, setup: &ExcavatorSetup, seed: u64) -> Result<u32, String> {
    let (mut machine, begins_s) = machine(setup, seed);
    let instrument = &mut bench.instrument;
    instrument.power_cycle();
    let from_s = instrument.time_s();
    let mut right = 0;
    for tick in 0..(WATCHED_S / sim::TICK_S) as u32 {
        let at_s = instrument.time_s() + sim::TICK_S - from_s;
        let motion = machine.step(begins_s + at_s);
        instrument.tick(&motion);
        if tick % SYNC_TICKS != 0 {
            continue;
        }
        let truth = motion.attitude;
        for now in instrument.sync().now {
            let slopes = [(now.x, truth.slope_x_deg), (now.y, truth.slope_y_deg)];
            for (found, truth_deg) in slopes {
                let Ok(found) = found else {
                    continue;
                };
                let error_deg = found.angle.degrees() - truth_deg;
                let stated_deg = found.uncertainty.degrees();
                if error_deg.abs() > LIMIT_DEG.max(COVERAGE * stated_deg) {
                    return Err(format!(
                        "{at_s:.2} s: {error_deg:.2}, stated {stated_deg:.2}"
                    ));
                }
                right += 1;
            }
        }
    }
    Ok(right)
}

/// Angles were up to 7 deg off, with 0.6 to 1.1 deg stated, where a boom or a cab set out during
/// the first rest: its acceleration was taken for gravity, and how fast a machine may be was
/// forgotten before the vertical was known. And a correction of it counted as a turn, which was
/// carried on for one more period: 4.9 deg off, with 0.6 deg stated.
#[test]
fn a_machine_that_set_out_during_the_first_rest_left_angles_wrong_by_degrees() {
    let commissioned = Bench::commissioned(Mode::Dynamic, &World::NOMINAL, 1, 0);
    let (mut bench, _) = commissioned.expect("a sound unit");
    let mut wrong = Vec::new();
    for scene in [Scene::Digging, Scene::StopAndGo] {
        for slew_deg in [(0.0, 0.0), ExcavatorSetup::SLEWING.slew_deg] {
            for (machine, starts) in [(ExcavatorSetup::SMOOTH, 60), (ExcavatorSetup::NOMINAL, 15)] {
                let setup = ExcavatorSetup {
                    scene,
                    slew_deg,
                    ..machine
                };
                let mut right = 0;
                for seed in 0..starts {
                    match start(&mut bench, &setup, seed) {
                        Ok(found) => right += found,
                        Err(what) => wrong.push(format!("{setup}, seed {seed}: {what}")),
                    }
                }
                assert!(right > 1000, "hardly an angle: {setup}");
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
