//! One gyroscope of two goes wrong while the machine digs, and while it stands: when it is told,
//! and who is named.
//!
//! The pair compares how far either gyroscope has turned, as the image does. `docs/safety.md` has
//! these times. The example `gyroscope_faults` prints many runs of the same over the bus.

mod watched;

use device::channel::Settings;
use sim::excavator::Scene;
use sim::fault::{RateFault, SensorFault};
use tilt::cross_check::{Judgement, Member};
use watched::{Watch, calibrated};

/// What was told of a fault: when, s after its beginning, and when a channel was named, and which.
#[derive(Debug, Default)]
struct Told {
    after_s: Option<f64>,
    named: Option<(f64, Member)>,
}

/// Runs a fault of node 1 until a channel is named.
fn told(settings: &[Settings; 2], scene: Scene, fault: SensorFault, seed: u64) -> Told {
    let watch = Watch {
        sync_ticks: 20,
        patience_s: 40.0,
    };
    let mut after_s = None;
    let named = watch.until(settings, scene, (fault, seed), |at_s, judgement| {
        if judgement != Judgement::Agree {
            after_s.get_or_insert(at_s);
        }
        match judgement {
            Judgement::OneChannel { faulty, .. } => Some((at_s, faulty)),
            _ => None,
        }
    });
    Told { after_s, named }
}

#[test]
fn a_gyroscope_that_is_wrong_is_told_at_once_and_named() {
    let settings = calibrated();
    let bias = |axis, dps| RateFault::Bias { axis, dps };
    // Scale and axes show while it turns.
    for (fault, told_s) in [
        (RateFault::Stuck, 0.1),
        (RateFault::Noise { factor: 10.0 }, 0.1),
        (bias(0, 0.5), 1.0),
        (bias(1, -0.5), 1.0),
        (bias(2, 0.5), 1.0),
        (bias(0, 2.0), 0.2),
        (bias(2, -2.0), 0.2),
        (RateFault::Scale { ratio: 0.05 }, 5.0),
        (RateFault::SwappedAxes, 2.0),
    ] {
        for seed in 0..3 {
            let found = told(
                &settings,
                Scene::Digging,
                SensorFault::Gyroscope(fault),
                seed,
            );
            let case = format!("{fault:?}, seed {seed}: {found:?}");
            assert!(found.after_s.is_some_and(|s| s <= told_s), "{case}");
            assert_ne!(
                found.named.map(|(_, who)| who),
                Some(Member::Peer),
                "{case}"
            );
            let scale = matches!(fault, RateFault::Scale { .. });
            assert!(scale || found.named.is_some(), "{case}");
        }
    }
}

#[test]
fn what_is_wrong_at_a_standstill_is_told_and_named() {
    let settings = calibrated();
    for (fault, told_s) in [
        (RateFault::Stuck, 0.1),
        (RateFault::Noise { factor: 10.0 }, 0.1),
        (RateFault::SwappedAxes, 1.2),
    ] {
        for seed in 0..3 {
            let fault = SensorFault::Gyroscope(fault);
            let found = told(&settings, Scene::Standstill, fault, seed);
            let case = format!("{fault:?}, seed {seed}: {found:?}");
            assert!(found.after_s.is_some_and(|s| s <= told_s), "{case}");
            let named = found.named.map(|(_, who)| who);
            assert_eq!(named, Some(Member::Own), "{case}");
        }
    }
    for axis in 0..3 {
        for (dps, told_s) in [(0.5, 1.0), (2.0, 0.2)] {
            let fault = SensorFault::Gyroscope(RateFault::Bias { axis, dps });
            let found = told(&settings, Scene::Standstill, fault, 1);
            assert!(
                found.after_s.is_some_and(|s| s <= told_s),
                "{axis} {dps}: {found:?}"
            );
            let named = found.named.map(|(_, who)| who);
            assert_eq!(named, Some(Member::Own), "{axis} {dps}: {found:?}");
        }
    }
}

#[test]
fn five_per_cent_of_scale_are_not_told_while_nothing_turns() {
    let fault = SensorFault::Gyroscope(RateFault::Scale { ratio: 0.05 });
    let found = told(&calibrated(), Scene::Standstill, fault, 1);
    assert_eq!(found.after_s, None);
}

#[test]
fn a_step_of_an_accelerometer_is_told_while_it_digs_and_nobody_is_named_wrongly() {
    let settings = calibrated();
    for seed in 0..4 {
        let axis = seed as usize % 3;
        let fault = SensorFault::Bias { axis, mg: 10.0 };
        let found = told(&settings, Scene::Digging, fault, seed);
        assert!(found.after_s.is_some_and(|s| s <= 1.0), "{seed}: {found:?}");
        assert_ne!(
            found.named.map(|(_, who)| who),
            Some(Member::Peer),
            "{seed}: {found:?}"
        );
    }
}
