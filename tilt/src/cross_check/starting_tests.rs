//! A channel that follows its gyroscope and looks for its vertical: what is told meanwhile.

use super::product_tests::{Bench, G, along, faulty, level, loud};
use super::*;
use crate::health::Activity;
use crate::turned::Turned;

/// The same channel with a gyroscope that stands still.
fn following(channel: Observation) -> Observation {
    Observation {
        turned: Some(Turned {
            angle: [0; 3],
            activity: Activity::OWN,
            bias: None,
            accel: 0,
            scale_share: 0,
        }),
        ..channel
    }
}

/// The same channel while it looks for its vertical.
fn starting(channel: Observation) -> Observation {
    following(channel).refused(Invalid::Settling)
}

/// Nothing is known of how far it has turned since the pair before.
fn interrupted(channel: Observation) -> Observation {
    Observation {
        turned: None,
        ..channel
    }
}

/// The pair, and the same seen from the other node.
fn both_ways(own: Observation, peer: Observation) -> [[Observation; 2]; 2] {
    [[own, peer], [peer, own]]
}

fn lasts(bench: &mut Bench, [own, peer]: [Observation; 2], seconds: f64) -> Judgement {
    for _ in 0..(seconds / 0.02).round() as u32 {
        bench.step(own, peer);
    }
    bench.last
}

const WAITS: Judgement = Judgement::Waiting(Invalid::Settling);

#[test]
fn a_fault_of_either_is_told_while_either_starts() {
    let loud = loud(160);
    let biased = along([60.0, 0.0, G]);
    for pair in both_ways(starting(loud), following(level())) {
        let mut bench = Bench::new();
        let told = lasts(&mut bench, pair, 0.5);
        let noisy = |node| faulty(node, Invalid::Noise);
        assert!(
            [noisy(Member::Own), noisy(Member::Peer)].contains(&told),
            "{told:?}"
        );
    }
    for pair in both_ways(starting(level()), following(biased)) {
        let mut bench = Bench::new();
        assert_eq!(lasts(&mut bench, pair, 0.6), Judgement::Disagree);
    }
}

#[test]
fn what_has_gone_counts_as_gone_while_either_starts() {
    let sound = following(level());
    for [own, peer] in both_ways(starting(level()), sound) {
        let mut noisy = Bench::that_forgives(1);
        lasts(&mut noisy, [following(loud(160)), sound], 0.5);
        assert_eq!(noisy.last, faulty(Member::Own, Invalid::Noise));
        assert_eq!(lasts(&mut noisy, [own, peer], 2.5), WAITS);
        let mut differ = Bench::that_forgives(1);
        lasts(&mut differ, [following(along([60.0, 0.0, G])), sound], 0.6);
        assert_eq!(differ.last, Judgement::Disagree);
        assert_eq!(lasts(&mut differ, [own, peer], 3.0), WAITS);
        // It shows nothing of the angles: neither may go on alone.
        let CrossCheck::Product(_, state, _) = &differ.check else {
            panic!("the product's check");
        };
        assert!(!state.findings().have_agreed());
    }
}

#[test]
fn one_lost_turn_ended_the_patience_with_a_start() {
    for [own, peer] in both_ways(starting(level()), following(level())) {
        let mut bench = Bench::new();
        for second in 0..29 {
            assert_eq!(lasts(&mut bench, [own, peer], 0.98), WAITS, "{second} s");
            bench.step(interrupted(own), interrupted(peer));
            assert_eq!(bench.last, WAITS, "{second} s");
        }
        let late = lasts(&mut bench, [own, peer], 2.0);
        assert!(matches!(late, Judgement::OneChannel { .. }), "{late:?}");
    }
    // One that does not follow is late after two seconds.
    let mut bench = Bench::new();
    let [own, peer] = [interrupted(starting(level())), following(level())];
    assert_eq!(lasts(&mut bench, [own, peer], 2.0), WAITS);
    let late = lasts(&mut bench, [own, peer], 0.1);
    assert_eq!(late, faulty(Member::Own, Invalid::Settling));
}

/// Two that disagree begin anew again and again, and after 30 s of that a healthy one was accused:
/// in 252 of 1 000 runs with a bias of 10 mg while the machine digs.
#[test]
fn a_long_disagreement_ended_the_patience_with_a_start() {
    let biased = along([60.0, 0.0, G]);
    let both = [starting(level()), starting(biased)];
    for [own, peer] in both_ways(both[0], both[1]) {
        let mut bench = Bench::that_forgives(1);
        for second in 0..90 {
            let told = lasts(&mut bench, [own, peer], 1.0);
            assert_eq!(told, Judgement::Disagree, "{second} s");
        }
        // What comes after it has the time of any start.
        let sound = starting(level());
        assert_eq!(lasts(&mut bench, [sound, sound], 28.0), WAITS);
        let late = lasts(&mut bench, [sound, sound], 5.0);
        assert!(matches!(late, Judgement::NoChannel(_)), "{late:?}");
    }
}

/// A channel that is held faulty begins anew again and again as well. After 30 s of that the time
/// without a vertical was held against it, which made it begin anew: it never came back.
#[test]
fn a_fault_of_half_a_minute_ended_the_patience_with_a_start() {
    let sound = following(level());
    let mut bench = Bench::that_forgives(1);
    lasts(&mut bench, [following(loud(160)), sound], 0.5);
    for second in 0..45 {
        let told = lasts(&mut bench, [starting(loud(160)), sound], 1.0);
        assert_eq!(told, faulty(Member::Own, Invalid::Noise), "{second} s");
    }
    // Its cause is gone, and a start of the estimator counts as sound again.
    lasts(&mut bench, [starting(level()), sound], 0.6);
    let CrossCheck::Product(_, state, _) = &bench.check else {
        panic!("the product's check");
    };
    let sound_us = state.findings().own_sound_us();
    assert!(sound_us.is_some_and(|us| us > 400_000), "{sound_us:?}");
    assert_eq!(lasts(&mut bench, [sound, sound], 1.0), Judgement::Agree);
}
