//! One gyroscope of two goes wrong while the machine digs, and while it stands.
//!
//! The pair of the image compares angles, which part as fast as the fault turns them. It has no
//! room yet for the comparison of rates (`rates`). So a fault is told, and its channel is named
//! only where it shows by itself.

mod watched;

use device::channel::Settings;
use sim::excavator::Scene;
use sim::fault::{RateFault, SensorFault};
use tilt::chain::Invalid;
use tilt::cross_check::{CrossCheck, Judgement, Member, ProductCheck, ProductState};
use watched::{Watch, calibrated};

/// How long after its beginning the fault was told, s, and how; `None` where it was not.
fn told(
    settings: &[Settings; 2],
    scene: Scene,
    fault: RateFault,
    seed: u64,
) -> Option<(f64, Judgement)> {
    let watch = Watch {
        check: CrossCheck::Product(ProductCheck::PRODUCT, ProductState::default(), None),
        sync_ticks: 10,
        patience_s: 20.0,
    };
    let fault = (SensorFault::Gyroscope(fault), seed);
    watch.until(settings, scene, fault, |after_s, judgement| {
        (judgement != Judgement::Agree).then_some((after_s, judgement))
    })
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
