//! A second fault beside a first one that named nobody: the first one's wrong angle never becomes
//! valid by it. All through the product's check, on a machine with its engine idling.

use super::movement_tests::{Machine, NODES, on, other};
use super::product_tests::{faulty, pose};
use super::*;

/// The first fault, mg on X. It begins while the machine moves: a movement tells nothing of it, and
/// gravity nothing while X lies across it.
const FIRST_MG: f64 = 50.0;

fn turning(t: f64) -> [f64; 3] {
    pose(15.0 * (0.8 * t).sin(), 5.0)
}

fn level(_: f64) -> [f64; 3] {
    pose(0.0, 0.0)
}

/// A machine with the first fault on one channel, and both have disagreed for so long.
fn disagreeing(seed: u64, node: Member, seconds: f64, at: fn(f64) -> [f64; 3]) -> Machine {
    let mut machine = Machine::new(seed).works(turning);
    machine.lasts(3.0, node, |t| (turning(t), on(0, FIRST_MG)));
    assert_eq!(machine.bench.last, Judgement::Disagree, "{node:?}");
    let all = machine.lasts(seconds, node, |t| (at(t), on(0, FIRST_MG)));
    assert_eq!(all, [Judgement::Disagree], "{node:?}");
    machine
}

/// The other channel has a fault, too, for so long; whether the disagreement was over at any time,
/// so that a channel might go on alone, and whether the other channel was named.
fn beside(
    machine: &mut Machine,
    node: Member,
    second: [f64; 3],
    at: fn(f64) -> [f64; 3],
) -> (bool, bool) {
    let (mut over, mut named, mut time_s) = (false, false, 0.0);
    machine.made(4.0, |machine| {
        over |= !machine.bench.check.disagree();
        named |= machine.bench.last == faulty(other(node), Invalid::Biased);
        time_s += machine.bench.period_us as f64 * 1e-6;
        let first = on(0, FIRST_MG);
        match node {
            Member::Own => machine.pair(at(time_s), first, second),
            Member::Peer => machine.pair(at(time_s), second, first),
        }
    });
    (over, named)
}

#[test]
fn a_second_fault_in_a_disagreement_made_the_first_one_valid() {
    let steep: fn(f64) -> [f64; 3] = |_| pose(0.0, 60.0);
    let mut named = [0; 4];
    for (seed, node) in (61..).zip(NODES) {
        for waits in [level, turning] {
            for (axis, mg) in [(0, 50.0), (0, -50.0), (1, -20.0), (2, 100.0)] {
                // It begins where the machine waits, and shows there, after a movement, and where
                // gravity lies along another axis.
                let mut machine = disagreeing(seed, node, 62.0, waits);
                for (n, at) in [waits, turning, level, steep].into_iter().enumerate() {
                    let (over, by_name) = beside(&mut machine, node, on(axis, mg), at);
                    let name = std::format!("{node:?}, axis {axis}, {mg} mg, part {n}");
                    assert!(!over, "{name}: the disagreement is over");
                    named[n] += u32::from(by_name);
                }
            }
        }
    }
    // The second fault is found, and named, in each way.
    assert!(named.iter().all(|&times| times > 0), "{named:?}");
}

/// A first fault that gravity names within the minute explains the disagreement, as it did, and the
/// healthy channel may go on alone; later it does not.
#[test]
fn gravity_explains_a_disagreement_of_less_than_a_minute() {
    for (seed, node) in (71..).zip(NODES) {
        for (waits_s, explains) in [(2.0, true), (50.0, true), (62.0, false)] {
            let mut machine = disagreeing(seed, node, waits_s, level);
            let all = machine.lasts(4.0, node, |_| (pose(70.0, 0.0), on(0, FIRST_MG)));
            let name = std::format!("{node:?}, {waits_s} s: {all:?}");
            assert_eq!(all.last(), Some(&faulty(node, Invalid::Biased)), "{name}");
            assert_eq!(!machine.bench.check.disagree(), explains, "{name}");
        }
    }
}

/// The age of a disagreement stood still while no SYNC came, so that a fault of the night explained
/// what was found the evening before.
#[test]
fn a_pause_without_sync_leaves_a_disagreement_unexplained() {
    for (seed, node) in (81..).zip(NODES) {
        for (pause_s, explains) in [(1, true), (12, false), (3600, false)] {
            let mut machine = disagreeing(seed, node, 2.0, level);
            let period_us = std::mem::replace(&mut machine.bench.period_us, pause_s * 1_000_000);
            machine.lasts(pause_s as f64 / 2.0, node, |_| {
                (level(0.0), on(0, FIRST_MG))
            });
            machine.bench.period_us = period_us;
            let all = machine.lasts(4.0, node, |_| (pose(70.0, 0.0), on(0, FIRST_MG)));
            let name = std::format!("{node:?}, {pause_s} s: {all:?}");
            assert_eq!(all.last(), Some(&faulty(node, Invalid::Biased)), "{name}");
            assert_eq!(!machine.bench.check.disagree(), explains, "{name}");
        }
    }
}
