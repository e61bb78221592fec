//! Whole trials.

use super::checks::Rule;
use super::checks::detection::Blame;
use super::inject::Injection;
use super::*;
use crate::fault::{NodeFault, SensorFault};

fn pool() -> Pool {
    Pool::of(&[(Mode::Product, 0)]).unwrap()
}

/// A machine that stands, and channel B with this fault from 6 to 9 s.
fn with(what: What) -> Report {
    let mut setup = Setup::healthy(1);
    setup.machine.scene = crate::excavator::Scene::Standstill;
    setup.faults = vec![Injection {
        what,
        channel: 1,
        from_s: 6.0,
        until_s: 9.0,
    }];
    run(&setup, &pool(), |_| {}).unwrap()
}

fn broke(report: &Report, rule: Rule) -> bool {
    report.violations.iter().any(|v| v.rule == rule)
}

#[test]
fn a_healthy_product_passes() {
    let report = run(&Setup::healthy(1), &pool(), |_| {}).unwrap();
    assert_eq!(report.violations, []);
    assert_eq!(report.detections, []);
}

#[test]
fn a_bias_step_is_detected_within_a_second() {
    let bias = SensorFault::Bias { axis: 0, mg: 50.0 };
    let report = with(What::Sensor(bias));
    let told_s = report.detections[0].told_s();
    assert!(told_s.is_some_and(|s| s < 1.0), "{told_s:?}");
    assert_ne!(report.detections[0].blame(), Blame::Wrong);
}

#[test]
fn a_channel_that_was_silent_is_started_again_and_in_order() {
    let report = with(What::Node(NodeFault::Silent));
    assert_eq!(report.detections[0].blame(), Blame::Right);
    assert!(!broke(&report, Rule::NotInOrder), "{:?}", report.violations);
}

#[test]
fn the_look_comes_after_the_end_of_a_fault_and_the_end_after_the_look() {
    let mut setup = Setup::healthy(1);
    setup.faults = vec![Injection {
        what: What::Node(NodeFault::Silent),
        channel: 0,
        from_s: 6.0,
        until_s: 20.0,
    }];
    let end_s = 20.0 + LOOK_AFTER_S + setup.limits().recovery_s + AFTERWARDS_S;
    let [.., (look_ns, look), (heal_ns, _), _] = agenda(&setup)[..] else {
        panic!("three deeds and the end")
    };
    assert_eq!(look, Deed::Look);
    assert!(look_ns > heal_ns);
    assert_eq!(agenda(&setup)[0], (nanoseconds(end_s), Deed::End));
}

#[test]
fn a_trial_needs_its_instrument() {
    let mut setup = Setup::healthy(1);
    setup.unit = 7;
    assert!(run(&setup, &Pool::default(), |_| {}).is_err());
}

#[test]
fn frames_that_stay_late_were_marked_valid_again_and_again() {
    for (sync_us, ms) in [(20_000, 50), (50_000, 50), (25_000, 200), (50_000, 200)] {
        let mut setup = Setup::healthy(371);
        setup.sync_us = sync_us;
        setup.faults = vec![Injection {
            what: What::Node(NodeFault::LateFrames { ms }),
            channel: 0,
            from_s: 6.0,
            until_s: 14.0,
        }];
        let report = run(&setup, &pool(), |_| {}).unwrap();
        assert_eq!(report.violations, [], "SYNC {sync_us} us, {ms} ms late");
    }
}

#[test]
fn a_node_back_from_bus_off_blamed_the_other_for_the_silence() {
    let report = with(What::Node(NodeFault::BusOff));
    assert_eq!(report.detections[0].blame(), Blame::Right);
}

#[test]
fn an_angle_that_stated_6_deg_was_valid_after_a_start_in_motion() {
    let mut setup = Setup::healthy(1);
    setup.mode = Mode::Dynamic;
    setup.machine.scene = crate::excavator::Scene::Digging;
    let pool = Pool::of(&[(Mode::Dynamic, 0)]).unwrap();
    // Of each channel: states of a pair in order without and with an angle, in their order.
    let mut in_order = [[0; 2]; CHANNELS];
    let report = run(&setup, &pool, |seen| {
        if let Some((channel, Message::Slopes(slopes))) = seen.message
            && slopes.state == Some(1)
        {
            let valid = slopes.deg.iter().all(Option::is_some);
            let [without, with] = &mut in_order[channel];
            assert!(valid || *with == 0, "an angle was valid and is no more");
            *(if valid { with } else { without }) += 1;
        }
    });
    assert_eq!(report.unwrap().violations, []);
    // 2 s to 8 s of SYNCs every 20 ms.
    for [without, with] in in_order {
        assert!((100..400).contains(&without) && with > 100, "{in_order:?}");
    }
}
