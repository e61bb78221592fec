//! One gyroscope of two goes wrong while the machine digs, and while it stands.
//!
//! The pair of the image compares angles, which part as fast as the fault turns them. It has no
//! room yet for the comparison of rates (`rates`). So a fault is told, and its channel is named
//! only where it shows by itself.

use device::channel::Settings;
use sim::TICK_S;
use sim::bench::{Bench, Mode, World};
use sim::excavator::{Excavator, ExcavatorSetup, Scene};
use sim::fault::{RateFault, SensorFault};
use sim::motion::Mover;
use sim::rng::Rng;
use tilt::chain::Invalid;
use tilt::cross_check::{CrossCheck, Judgement, Member, ProductCheck, ProductState};

/// Pairs are judged every 10 ms.
const SYNC_TICKS: u64 = 10;
/// A fault is waited for at most so long, s.
const PATIENCE_S: f64 = 20.0;

/// What both nodes of a unit run with, calibrated.
fn calibrated() -> [Settings; 2] {
    let commissioned = Bench::commissioned(Mode::Dynamic, &World::NOMINAL, 1, 0);
    let (bench, _) = commissioned.expect("a sound unit");
    bench.instrument.sides.map(|side| side.settings)
}

/// How long after its beginning the fault was told, s, and how; `None` where it was not.
fn told(
    settings: &[Settings; 2],
    scene: Scene,
    fault: RateFault,
    seed: u64,
) -> Option<(f64, Judgement)> {
    let mut bench = Bench::new(Mode::Dynamic, &World::NOMINAL, 1, 0);
    for (side, settings) in bench.instrument.sides.iter_mut().zip(settings) {
        side.settings = settings.clone();
    }
    let [first, _] = &mut bench.instrument.sides;
    let without_rates = CrossCheck::Product(ProductCheck::PRODUCT, ProductState::default(), None);
    first.node.set_check(without_rates);
    bench.instrument.power_cycle();
    let mut rng = Rng::stream(seed, "gyroscope faults");
    let setup = ExcavatorSetup {
        scene,
        ..ExcavatorSetup::NOMINAL
    };
    let mut machine = Excavator::new(&setup, &mut rng);
    let start_s = bench.instrument.time_s();
    let from_tick = (rng.range(20.0, 30.0) / TICK_S) as u64;
    for tick in 0..from_tick + (PATIENCE_S / TICK_S) as u64 {
        if tick == from_tick {
            let fault = SensorFault::Gyroscope(fault);
            let electronics = &mut bench.instrument.sides[0].electronics;
            electronics.inject(fault, rng.fork());
        }
        let motion = machine.step(bench.instrument.time_s() + TICK_S - start_s);
        bench.instrument.tick(&motion);
        if tick % SYNC_TICKS != 0 || (tick as f64) < 5.0 / TICK_S {
            continue;
        }
        let judgement = bench.instrument.sync().verdict.judgement();
        let healthy = judgement == Judgement::Agree;
        assert!(healthy || tick >= from_tick, "false alarm: {judgement:?}");
        if !healthy {
            return Some(((tick - from_tick) as f64 * TICK_S, judgement));
        }
    }
    None
}

#[test]
fn a_gyroscope_that_is_wrong_by_much_is_told_and_a_stuck_one_is_named() {
    let settings = calibrated();
    let named = Judgement::OneChannel {
        faulty: Member::Own,
        reason: Invalid::Stuck,
    };
    // The latest that ten seeds each have shown, and a third more.
    let bias = |dps| RateFault::Bias { axis: 0, dps };
    for (scene, fault, within_s, judged) in [
        (Scene::Digging, RateFault::Stuck, 0.1, named),
        (Scene::Standstill, RateFault::Stuck, 0.1, named),
        (Scene::Digging, bias(0.5), 8.0, Judgement::Disagree),
        (Scene::Standstill, bias(0.5), 2.0, Judgement::Disagree),
        (Scene::Digging, bias(2.0), 2.0, Judgement::Disagree),
        (Scene::Standstill, bias(2.0), 0.6, Judgement::Disagree),
        (
            Scene::Digging,
            RateFault::Scale { ratio: 0.05 },
            12.0,
            Judgement::Disagree,
        ),
        (
            Scene::Digging,
            RateFault::SwappedAxes,
            2.5,
            Judgement::Disagree,
        ),
        (
            Scene::Standstill,
            RateFault::SwappedAxes,
            1.2,
            Judgement::Disagree,
        ),
    ] {
        for seed in 0..3 {
            let found = told(&settings, scene, fault, seed);
            assert!(
                found.is_some_and(|(s, judgement)| s <= within_s && judgement == judged),
                "{scene:?}, {fault:?}, seed {seed}: {found:?}"
            );
        }
    }
}

#[test]
fn five_per_cent_of_scale_are_not_told_while_nothing_turns() {
    let fault = RateFault::Scale { ratio: 0.05 };
    let found = told(&calibrated(), Scene::Standstill, fault, 1);
    assert_eq!(found, None);
}

#[test]
fn ten_times_the_noise_of_a_gyroscope_does_no_harm() {
    let settings = calibrated();
    for scene in [Scene::Digging, Scene::Standstill] {
        let fault = RateFault::Noise { factor: 10.0 };
        assert_eq!(told(&settings, scene, fault, 1), None, "{scene:?}");
    }
}
