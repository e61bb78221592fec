//! Gravity at a standstill: which channel it names, when it stays silent, and that it is never
//! wrong. All through the product's check, as an instrument has it.

use proptest::prelude::*;

use super::movement::{Finding, Movement, MovementState};
use super::product_tests::{Bench, G, along, faulty, pose, turned};
use super::*;
use crate::vector::Corrected;

/// Own and peer in one pose for so long that each other's baselines are known.
fn acquainted(gravity: [f64; 3]) -> Bench {
    let mut bench = Bench::new();
    assert_eq!(bench.holds(gravity, gravity, 8.0), [Judgement::Agree]);
    bench
}

fn with_bias(gravity: [f64; 3], axis: usize, mg: f64) -> [f64; 3] {
    let mut biased = gravity;
    biased[axis] += mg;
    biased
}

/// What stands 4 s after a step of one channel's offset while the machine stands.
fn after_step(gravity: [f64; 3], node: Member, axis: usize, mg: f64) -> Judgement {
    let mut bench = acquainted(gravity);
    let biased = with_bias(gravity, axis, mg);
    let (own, peer) = match node {
        Member::Own => (biased, gravity),
        Member::Peer => (gravity, biased),
    };
    bench.stands(own, peer, 4.0)
}

#[test]
fn an_offset_along_gravity_is_named_both_ways_on_both_channels() {
    for node in [Member::Own, Member::Peer] {
        for mg in [-50.0, -10.0, -5.0, 5.0, 10.0, 50.0] {
            let judgement = after_step(pose(0.0, 0.0), node, 2, mg);
            assert_eq!(judgement, faulty(node, Invalid::Biased), "{mg} mg");
        }
    }
}

#[test]
fn at_level_gravity_does_not_tell_of_x_and_y() {
    for node in [Member::Own, Member::Peer] {
        for axis in [0, 1] {
            for mg in [-20.0, -5.0, 5.0, 20.0] {
                let judgement = after_step(pose(0.0, 0.0), node, axis, mg);
                assert_eq!(judgement, Judgement::Disagree, "axis {axis}, {mg} mg");
            }
        }
    }
}

#[test]
fn tilted_it_tells_of_the_axis_that_points_down_or_up() {
    for (x_deg, y_deg, axis) in [(45.0, 0.0, 0), (-45.0, 0.0, 0), (0.0, 60.0, 1)] {
        let gravity = pose(x_deg, y_deg);
        for node in [Member::Own, Member::Peer] {
            for mg in [-10.0, 10.0] {
                let judgement = after_step(gravity, node, axis, mg);
                assert_eq!(
                    judgement,
                    faulty(node, Invalid::Biased),
                    "{x_deg} {y_deg} {mg}"
                );
            }
        }
    }
    // Upright, what lies across is blind as well.
    assert_eq!(
        after_step(pose(90.0, 0.0), Member::Own, 2, 10.0),
        Judgement::Disagree
    );
}

#[test]
fn a_swapped_axis_is_not_blamed_on_the_healthy_channel() {
    let [x, y, z] = pose(25.0, 5.0);
    let mut bench = acquainted(pose(0.0, 0.0));
    let judgement = bench.stands([x, y, z], [y, x, z], 4.0);
    assert_eq!(judgement, Judgement::Disagree, "both vectors are 1 g long");
}

#[test]
fn the_second_has_to_be_whole() {
    let gravity = pose(0.0, 0.0);
    let biased = with_bias(gravity, 2, 20.0);
    let mut bench = acquainted(gravity);
    // 0.9 s of standstill and a move, again and again: nobody is named.
    for n in 0..20 {
        let still = bench.holds(gravity, biased, 0.9);
        assert!(
            !still.contains(&faulty(Member::Peer, Invalid::Biased)),
            "{n}"
        );
        let (own, peer) = (turned(gravity, 1.0), turned(biased, 1.0));
        bench.holds(own, peer, 0.1);
    }
    assert_eq!(bench.last, Judgement::Disagree);
    let named = bench.until(gravity, biased, 3.0, |j| {
        j == faulty(Member::Peer, Invalid::Biased)
    });
    let named = named.expect("named at a standstill");
    assert!((0.98..2.1).contains(&named), "{named} s");
}

#[test]
fn a_slow_turn_is_no_standstill() {
    let mut bench = acquainted(pose(0.0, 0.0));
    for n in 0..1000 {
        let gravity = pose(n as f64 * 0.02, 0.0);
        let biased = with_bias(gravity, 2, 20.0);
        let judgement = bench.step(along(gravity), along(biased));
        assert!(
            !matches!(judgement, Judgement::OneChannel { .. }),
            "1 deg/s, {n}"
        );
    }
    assert_eq!(bench.last, Judgement::Disagree);
}

#[test]
fn a_machine_that_shakes_is_no_standstill() {
    let gravity = pose(0.0, 0.0);
    for (mg, names) in [(4.0, false), (2.0, true)] {
        let mut bench = acquainted(gravity);
        for n in 0..200 {
            let shake = if n % 2 == 0 { mg } else { -mg };
            let own = with_bias(gravity, 2, shake);
            let peer = with_bias(gravity, 2, shake - 20.0);
            bench.step(along(own), along(peer));
        }
        let named = bench.last == faulty(Member::Peer, Invalid::Biased);
        assert_eq!(named, names, "{mg} mg to either side: {:?}", bench.last);
    }
}

#[test]
fn local_gravity_is_learned_and_blamed_on_nobody() {
    // 9.78 m/s2 at the equator and 9.83 at the poles.
    for local in [-2.7, 2.7] {
        let scale = |v: [f64; 3]| v.map(|c| c * (1.0 + local / G));
        let gravity = scale(pose(0.0, 0.0));
        let mut bench = Bench::new();
        assert_eq!(bench.holds(gravity, gravity, 40.0), [Judgement::Agree]);
        // Of -2.3 and 2.7 mg beyond standard gravity neither could be blamed.
        let shorter = with_bias(gravity, 2, -2.0 * local.signum() * 2.5);
        let judgement = bench.stands(gravity, shorter, 4.0);
        assert_eq!(
            judgement,
            faulty(Member::Peer, Invalid::Biased),
            "{local} mg"
        );
    }
}

#[test]
fn local_gravity_alone_never_names_anybody() {
    for local in [-2.7, 2.7] {
        let gravity = pose(0.0, 0.0).map(|c| c * (1.0 + local / G));
        let mut bench = Bench::new();
        // A disagreement across gravity, from the very start and after an hour.
        for _ in 0..2 {
            let judgement = bench.stands(gravity, with_bias(gravity, 0, 8.0), 10.0);
            assert_eq!(judgement, Judgement::Disagree, "{local} mg");
            bench.check.reset();
            assert_eq!(bench.holds(gravity, gravity, 60.0), [Judgement::Agree]);
        }
    }
}

#[test]
fn what_is_learned_has_a_limit() {
    let gravity = pose(0.0, 0.0);
    // Both channels grow together, as with a common fault; then the own one is right again.
    let mut bench = acquainted(gravity);
    let long = with_bias(gravity, 2, 20.0);
    let grown = (0..4000).map(|n| with_bias(gravity, 2, f64::from(n) * 0.005));
    for both in grown {
        assert_eq!(bench.step(along(both), along(both)), Judgement::Agree);
    }
    assert_eq!(bench.holds(long, long, 60.0), [Judgement::Agree]);
    // The peer is 20 mg wrong, of which 4 mg count as the baseline.
    let judgement = bench.stands(gravity, long, 4.0);
    assert_eq!(judgement, faulty(Member::Peer, Invalid::Biased));
}

#[test]
fn a_slow_drift_is_found_and_named_while_it_goes_on() {
    let gravity = pose(0.0, 0.0);
    let mut bench = acquainted(gravity);
    let mut found = None;
    let named = (0..5000).position(|n| {
        let mg = f64::from(n) * 0.2 * 0.02;
        let judgement = bench.step(along(gravity), along(with_bias(gravity, 2, mg)));
        if judgement == Judgement::Disagree {
            found.get_or_insert(mg);
        }
        assert_ne!(judgement, faulty(Member::Own, Invalid::Biased));
        judgement == faulty(Member::Peer, Invalid::Biased)
    });
    assert!(named.is_some(), "found at {found:?} mg and never named");
    assert!(named.is_some_and(|n| n < 3000), "{named:?} pairs");
}

#[test]
fn a_channel_that_is_named_stays_named_when_the_machine_moves_on() {
    let gravity = pose(0.0, 0.0);
    let mut bench = acquainted(gravity);
    let biased = with_bias(gravity, 2, 20.0);
    let named = faulty(Member::Own, Invalid::Biased);
    assert_eq!(bench.stands(biased, gravity, 4.0), named);
    for n in 0..2000 {
        let angle = 30.0 * (f64::from(n) * 0.02).sin();
        let gravity = pose(angle, 0.0);
        assert_eq!(
            bench.step(along(with_bias(gravity, 2, 20.0)), along(gravity)),
            named
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None,
        ..ProptestConfig::default() })]

    /// Whatever the pose and the offset: the right one or nobody, and the right one where gravity
    /// shows enough of it.
    #[test]
    fn the_healthy_channel_is_never_named(
        x_deg in -80.0..80.0_f64, y_deg in -80.0..80.0_f64, axis in 0..3_usize,
        size in 5.0..100.0_f64, negative: bool, own: bool, local in -2.7..2.7_f64,
    ) {
        let gravity = pose(x_deg, y_deg).map(|c| c * (1.0 + local / G));
        let mg = if negative { -size } else { size };
        let node = if own { Member::Own } else { Member::Peer };
        let mut bench = Bench::new();
        prop_assert_eq!(bench.holds(gravity, gravity, 20.0), [Judgement::Agree]);
        let biased = with_bias(gravity, axis, mg);
        let (own, peer) = if own { (biased, gravity) } else { (gravity, biased) };
        let judgement = bench.stands(own, peer, 4.0);
        let right = faulty(node, Invalid::Biased);
        let length = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
        let shown = (length(biased) - length(gravity)).abs();
        if shown > 4.5 {
            prop_assert_eq!(judgement, right, "{} mg of it show", shown);
        } else {
            prop_assert!(judgement == right || judgement == Judgement::Disagree);
        }
        // Lengths are right to some millionths: of 2 mg that is less than 0.01 mg. 1.9976 mg, of an
        // offset of 43.5 mg across gravity, were named once, and rightly.
        if shown < 1.99 {
            prop_assert_eq!(judgement, Judgement::Disagree, "{} mg of it show", shown);
        }
    }
}

#[test]
fn two_pairs_a_second_apart_are_no_standstill() {
    let mut state = MovementState::default();
    let level = Corrected {
        accel: [0, 0, crate::ONE_G],
    };
    let mut weighed = || {
        let found = Movement::PRODUCT.step(&mut state, [&level; 2], false, 1_000_000);
        matches!(found, Some(Finding::Stood(_)))
    };
    let count = (0..48).filter(|_| weighed()).count();
    assert_eq!(count, 3, "twelve pairs each, after as many for the places");
}
