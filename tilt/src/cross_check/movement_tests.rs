//! Who moved: what is named, what is not, and that the healthy channel never is. All through the
//! product's check with channels that have noise, on a machine with its engine idling.

use std::vec::Vec;

use super::movement::{self, Finding, Movement};
use super::product_tests::{Bench, faulty, pose};
use super::random_tests::Dice;
use super::*;
use crate::health::Activity;
use crate::vector::Corrected;

/// Each channel within what its calibration leaves, mg.
const LEFT: [[f64; 3]; 2] = [[0.4, -0.3, 0.2], [-0.2, 0.3, -0.3]];

/// An offset of one axis, mg.
pub(super) fn on(axis: usize, mg: f64) -> [f64; 3] {
    let mut offset = [0.0; 3];
    offset[axis] = mg;
    offset
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] + b[i])
}

/// Two channels on one machine.
pub(super) struct Machine {
    pub(super) bench: Bench,
    dice: Dice,
    time_s: f64,
    /// Rumble of an idling engine on each axis, mg.
    rumble: f64,
}

impl Machine {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            bench: Bench::new(),
            dice: Dice(0x9E37_79B9_7F4A_7C15 ^ (seed << 17 | seed)),
            time_s: 0.0,
            rumble: 2.0,
        }
    }

    /// What both channels report next of this force with these offsets, mg.
    pub(super) fn pair(
        &mut self,
        force: [f64; 3],
        own: [f64; 3],
        peer: [f64; 3],
    ) -> [Observation; 2] {
        self.time_s += self.bench.period_us as f64 * 1e-6;
        let tone = |hz: f64, lag: f64| (core::f64::consts::TAU * hz * self.time_s + lag).sin();
        let rumble = [0.0, 2.0, 4.0].map(|lag| {
            let sum = tone(4.3, lag) + tone(7.1, 2.0 * lag) + tone(11.9, 3.0 * lag);
            self.rumble * sum * (2.0 / 3.0_f64).sqrt()
        });
        let felt = plus(force, rumble);
        let [left_own, left_peer] = LEFT;
        let own = self.dice.feels(felt, plus(left_own, own));
        [own, self.dice.feels(felt, plus(left_peer, peer))]
    }

    /// The next pair, with an offset on one channel.
    fn step(&mut self, force: [f64; 3], node: Member, offset: [f64; 3]) -> Judgement {
        let (own, peer) = match node {
            Member::Own => (offset, [0.0; 3]),
            Member::Peer => ([0.0; 3], offset),
        };
        let [own, peer] = self.pair(force, own, peer);
        self.bench.step(own, peer)
    }

    /// For so long; the judgements that there were. `at` gives force and offset by the time, s.
    pub(super) fn lasts(
        &mut self,
        seconds: f64,
        node: Member,
        at: impl Fn(f64) -> ([f64; 3], [f64; 3]),
    ) -> Vec<Judgement> {
        let from_s = self.time_s;
        let mut all = Vec::new();
        while self.time_s < from_s + seconds - 1e-9 {
            let (force, offset) = at(self.time_s - from_s);
            all.push(self.step(force, node, offset));
        }
        all.dedup();
        all
    }

    /// Healthy for eight seconds.
    pub(super) fn works(mut self, at: impl Fn(f64) -> [f64; 3]) -> Self {
        let all = self.lasts(8.0, Member::Own, |t| (at(t), [0.0; 3]));
        assert_eq!(all, [Judgement::Agree]);
        self
    }

    /// The next pairs as `made` of what the channels feel.
    pub(super) fn made(
        &mut self,
        seconds: f64,
        mut made: impl FnMut(&mut Self) -> [Observation; 2],
    ) {
        let from_s = self.time_s;
        while self.time_s < from_s + seconds - 1e-9 {
            let [own, peer] = made(self);
            self.bench.step(own, peer);
        }
    }
}

pub(super) const NODES: [Member; 2] = [Member::Own, Member::Peer];

pub(super) const fn other(node: Member) -> Member {
    match node {
        Member::Own => Member::Peer,
        Member::Peer => Member::Own,
    }
}

fn names(all: &[Judgement], node: Member) -> bool {
    all.contains(&faulty(node, Invalid::Biased))
}

#[test]
fn a_step_at_level_names_the_channel_that_moved_on_any_axis() {
    for (seed, node) in (1..).zip(NODES) {
        for (axis, mg) in [
            (0, 5.0),
            (1, -5.0),
            (2, 5.0),
            (0, -10.0),
            (1, 50.0),
            (0, 400.0),
        ] {
            for rumble in [0.0, 2.0] {
                let level = pose(0.0, 0.0);
                let mut machine = Machine::new(seed);
                machine.rumble = rumble;
                let mut machine = machine.works(|_| level);
                let all = machine.lasts(2.0, node, |_| (level, on(axis, mg)));
                let name = std::format!("{node:?}, axis {axis}, {mg} mg, {rumble} mg: {all:?}");
                assert!(
                    all.contains(&faulty(node, Invalid::Biased)) || mg > 50.0,
                    "{name}"
                );
                assert!(!names(&all, other(node)), "{name}");
            }
        }
    }
}

#[test]
fn a_drift_at_level_names_the_channel_that_drifts() {
    for (seed, node) in (3..).zip(NODES) {
        for (axis, mg_per_s, within_s) in [(0, 2.0, 4.0), (1, -2.0, 4.0), (0, -0.2, 45.0)] {
            let level = pose(0.0, 0.0);
            let mut machine = Machine::new(seed).works(|_| level);
            let all = machine.lasts(within_s, node, |t| (level, on(axis, mg_per_s * t)));
            let expected = [
                Judgement::Agree,
                Judgement::Disagree,
                faulty(node, Invalid::Biased),
            ];
            assert_eq!(all, expected, "{node:?}, axis {axis}, {mg_per_s} mg/s");
        }
    }
}

#[test]
fn nobody_is_named_of_what_is_not_told() {
    // 2.5 mg stay within what healthy channels differ by, though one channel alone has moved.
    let level = pose(0.0, 0.0);
    for node in NODES {
        let mut machine = Machine::new(5).works(|_| level);
        let all = machine.lasts(20.0, node, |_| (level, on(0, 2.5)));
        assert_eq!(all, [Judgement::Agree]);
    }
}

/// Ways in which a channel stands still while the machine moves: what it reports, of what it
/// would have reported.
type Frozen = fn(n: u32, held: &mut [i32; 3], now: &mut [i32; 3]);

/// All axes, at once.
fn all_axes(_: u32, held: &mut [i32; 3], now: &mut [i32; 3]) {
    *now = *held;
}

/// One axis.
fn one_axis(_: u32, [held, ..]: &mut [i32; 3], [now, ..]: &mut [i32; 3]) {
    *now = *held;
}

/// One axis that follows more and more slowly.
fn slowly(n: u32, [held, ..]: &mut [i32; 3], [now, ..]: &mut [i32; 3]) {
    *held += (*now - *held) / (1 + n as i32);
    *now = *held;
}

/// All axes come anew every 16 pairs only.
fn held(n: u32, held: &mut [i32; 3], now: &mut [i32; 3]) {
    if n.is_multiple_of(16) {
        *held = *now;
    }
    *now = *held;
}

/// All axes no longer feel the machine, and still have their noise.
fn numb(_: u32, held: &mut [i32; 3], now: &mut [i32; 3]) {
    for (held, now) in held.iter().zip(now) {
        // What the digits below 0.9 mg were is noise enough.
        *now = *held + *now % 60_000;
    }
}

#[test]
fn a_frozen_channel_never_names_the_one_that_moves_with_the_machine() {
    let ways: [(&str, Frozen); 5] = [
        ("all", all_axes),
        ("one", one_axis),
        ("slowly", slowly),
        ("held", held),
        ("numb", numb),
    ];
    for (name, freeze) in ways {
        for (node, deg_s) in [
            (Member::Own, 0.3),
            (Member::Peer, 0.3),
            (Member::Own, 1.0),
            (Member::Own, 5.0),
        ] {
            // It stands, moves by three degrees and stands again.
            let path = |t: f64| pose((deg_s * (t - 2.0)).clamp(0.0, 3.0), 0.0);
            let mut machine = Machine::new(7).works(|_| path(0.0));
            let (mut n, mut place) = (0, None);
            let from_s = machine.time_s;
            machine.made(20.0, |machine| {
                let force = path(machine.time_s - from_s);
                let mut pair = machine.pair(force, [0.0; 3], [0.0; 3]);
                let frozen = match node {
                    Member::Own => &mut pair[0],
                    Member::Peer => &mut pair[1],
                };
                if let Some(vector) = &mut frozen.vector {
                    freeze(n, place.get_or_insert(vector.accel), &mut vector.accel);
                }
                n += 1;
                assert_ne!(
                    machine.bench.last,
                    faulty(other(node), Invalid::Biased),
                    "{name} {deg_s}"
                );
                pair
            });
            // What lags by a third of a second differs by too little in a slow move.
            let told = machine.bench.last.is_fault();
            assert!(
                told || name == "held" && deg_s < 1.0,
                "{name}, {deg_s} deg/s"
            );
        }
    }
}

#[test]
fn a_channel_that_recovers_neither_names_the_healthy_one_nor_clears_anything() {
    let level = pose(0.0, 0.0);
    let turning = |t: f64| pose(20.0 * t.sin(), 0.0);
    for (seed, node) in (11..).zip(NODES) {
        for mg in [5.0, -10.0, 50.0] {
            // It begins while the machine moves and is over while the machine stands.
            let mut machine = Machine::new(seed).works(turning);
            let all = machine.lasts(3.0, node, |t| (turning(t), on(0, mg)));
            assert_eq!(all.last(), Some(&Judgement::Disagree), "{node:?}, {mg} mg");
            let all = machine.lasts(4.0, node, |_| (level, on(0, mg)));
            assert_eq!(all, [Judgement::Disagree], "{node:?}, {mg} mg");
            let all = machine.lasts(20.0, node, |_| (level, [0.0; 3]));
            assert!(!names(&all, other(node)), "{node:?}, {mg} mg: {all:?}");
            assert!(all.iter().all(|j| j.is_fault()), "{all:?}");
        }
    }
}

#[test]
fn a_channel_that_was_away_and_comes_back_elsewhere_is_not_compared_with_its_past() {
    let level = pose(0.0, 0.0);
    let away: [fn(&mut Machine, Member); 3] = [
        |machine, node| gone(machine, node, Invalid::Silent, 0.1),
        |machine, node| gone(machine, node, Invalid::OverRange, 0.2),
        // On a slow bus a channel starts anew between two SYNCs.
        |machine, _| machine.bench.check.peer_restarted(),
    ];
    for (number, away) in away.into_iter().enumerate() {
        for node in NODES {
            if number == 2 && node == Member::Own {
                continue;
            }
            let mut machine = Machine::new(13).works(|_| level);
            away(&mut machine, node);
            // Longer than the report of a silence stays.
            let all = machine.lasts(12.0, node, |_| (level, on(0, 8.0)));
            assert_eq!(
                all.last(),
                Some(&Judgement::Disagree),
                "{number}, {node:?}: {all:?}"
            );
            assert!(
                !names(&all, Member::Own) && !names(&all, Member::Peer),
                "{all:?}"
            );
        }
    }
}

fn gone(machine: &mut Machine, node: Member, why: Invalid, seconds: f64) {
    machine.made(seconds, |machine| {
        let [own, peer] = machine.pair(pose(0.0, 0.0), [0.0; 3], [0.0; 3]);
        match node {
            Member::Own => [own.refused(why), peer],
            Member::Peer => [own, peer.refused(why)],
        }
    });
}

#[test]
fn a_jump_of_temperature_never_names_the_channel_that_it_moves_less() {
    // 30 K within a minute and back, without a temperature model: 0.05 and 0.35 mg/K, and the way
    // back is not the way there.
    let level = pose(0.0, 0.0);
    for (seed, node) in (17..).zip(NODES) {
        for axis in [0, 2] {
            let mut machine = Machine::new(seed).works(|_| level);
            let from_s = machine.time_s;
            let mut all = Vec::new();
            machine.made(180.0, |machine| {
                let t = machine.time_s - from_s;
                let kelvin = 30.0 * (t / 60.0).min((180.0 - t) / 60.0).min(1.0);
                let lag = if t > 120.0 { 0.5 } else { 0.0 };
                let (more, less) = (on(axis, 0.35 * kelvin + lag), on(axis, 0.05 * kelvin));
                all.push(machine.bench.last);
                match node {
                    Member::Own => machine.pair(level, more, less),
                    Member::Peer => machine.pair(level, less, more),
                }
            });
            assert!(!names(&all, other(node)), "{node:?}, axis {axis}");
        }
    }
}

#[test]
fn a_thermometer_that_jumps_names_its_channel_or_nobody() {
    // The temperature model takes off what is not there: 5 K of 0.9 mg/K on two axes at once.
    let level = pose(0.0, 0.0);
    for (seed, node) in (19..).zip(NODES) {
        let mut machine = Machine::new(seed).works(|_| level);
        let all = machine.lasts(10.0, node, |_| (level, [-4.5, 4.5, 0.0]));
        assert_eq!(all.last(), Some(&faulty(node, Invalid::Biased)), "{all:?}");
    }
}

#[test]
fn shocks_name_nobody_also_where_one_part_clips() {
    let level = pose(0.0, 10.0);
    for node in NODES {
        let mut machine = Machine::new(23).works(|_| level);
        for n in 0..40 {
            // What the low-pass leaves of a burst, and the part of it that has clipped is away.
            let from_s = machine.time_s;
            machine.made(0.3, |machine| {
                let t = machine.time_s - from_s;
                let swing = 400.0 * (-t / 0.04).exp() * (60.0 * t).cos();
                let mut pair = machine.pair(
                    plus(level, [swing, -swing, 2.0 * swing]),
                    [0.0; 3],
                    [0.0; 3],
                );
                for one in &mut pair {
                    one.activity = Activity(130);
                }
                let clips = &mut pair[usize::from(node == Member::Peer)];
                if n % 2 == 0 && t < 0.16 {
                    *clips = Observation {
                        vector: None,
                        ..clips.refused(Invalid::OverRange)
                    };
                }
                pair
            });
            let all = machine.lasts(1.0, node, |_| (level, [0.0; 3]));
            assert!(!all.iter().any(|j| j.is_fault()), "shock {n}: {all:?}");
        }
    }
}

#[test]
fn a_shock_in_a_disagreement_names_nobody_wrongly() {
    let level = pose(0.0, 0.0);
    let turning = |t: f64| pose(20.0 * t.sin(), 0.0);
    for (seed, node) in (29..).zip(NODES) {
        let mut machine = Machine::new(seed).works(turning);
        machine.lasts(3.0, node, |t| (turning(t), on(0, 20.0)));
        for _ in 0..20 {
            let swing = |t: f64| 800.0 * (-t / 0.04).exp() * (60.0 * t).cos();
            let all = machine.lasts(0.9, node, |t| (plus(level, on(0, swing(t))), on(0, 20.0)));
            assert!(!names(&all, other(node)), "{node:?}: {all:?}");
        }
    }
}

#[test]
fn a_slow_movement_of_the_machine_is_blamed_on_nobody() {
    for deg_s in [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0] {
        let path = |t: f64| pose(deg_s * t, 5.0);
        let mut machine = Machine::new(31).works(path);
        let all = machine.lasts(20.0, Member::Own, |t| (path(8.0 + t), [0.0; 3]));
        assert_eq!(all, [Judgement::Agree], "{deg_s} deg/s");
    }
}

#[test]
fn a_step_in_a_slow_movement_that_hides_it_never_names_the_healthy_channel() {
    // At some rate and size the movement undoes the step for a while, and the sound channel alone
    // seems to move.
    let ways = [(true, 2.0), (false, 2.0), (true, 0.2), (false, 0.2)];
    for (seed, (creeps, rumble)) in (37..).zip(ways.into_iter().cycle().take(648)) {
        let deg_s = 0.02 * 1.39_f64.powi((seed / 4 % 18) as i32);
        let mg = 3.2 * 1.37_f64.powi((seed / 72) as i32);
        let node = if seed % 8 < 4 {
            Member::Own
        } else {
            Member::Peer
        };
        // It creeps all the time, or begins to move with the step.
        let path = |t: f64| pose(-deg_s * if creeps { t } else { t.max(8.0) - 8.0 }, 5.0);
        let mut machine = Machine::new(seed);
        machine.rumble = rumble;
        let before_s = 8.0 + 0.01 * (seed % 24) as f64;
        machine.lasts(before_s, Member::Own, |t| (path(t), [0.0; 3]));
        let all = machine.lasts(6.0, node, |t| (path(before_s + t), on(0, mg)));
        let name = std::format!("{node:?} {deg_s} deg/s {mg} mg");
        assert!(!names(&all, other(node)), "{name}: {all:?}");
    }
}

#[test]
fn a_fault_that_begins_while_the_machine_moves_is_left_to_gravity() {
    let turning = |t: f64| pose(15.0 * (0.8 * t).sin(), 5.0);
    let level = pose(0.0, 0.0);
    for (seed, node) in (41..).zip(NODES) {
        for mg in [5.0, 10.0, 50.0] {
            let mut machine = Machine::new(seed).works(turning);
            machine.lasts(3.0, node, |t| (turning(t), on(0, mg)));
            let all = machine.lasts(10.0, node, |_| (level, on(0, mg)));
            assert_eq!(
                all,
                [Judgement::Disagree],
                "{node:?}, {mg} mg, across gravity"
            );
            let all = machine.lasts(3.0, node, |_| (pose(70.0, 0.0), on(0, mg)));
            assert_eq!(
                all.last(),
                Some(&faulty(node, Invalid::Biased)),
                "{node:?}, {mg} mg"
            );
        }
    }
}

#[test]
fn a_gain_that_shows_as_the_machine_moves_never_names_the_healthy_channel() {
    for (seed, node) in (43..).zip(NODES) {
        for ratio in [-0.02, 0.02, 0.05] {
            // From rest to rest, slowly and fast, two degrees or thirty.
            for (deg, move_s) in [(2.0, 6.0), (2.0, 0.5), (30.0, 3.0), (-30.0, 10.0)] {
                let path = |t: f64| pose(deg * (t / move_s).clamp(0.0, 1.0), 0.0);
                let mut machine = Machine::new(seed).works(|_| path(0.0));
                let all = machine.lasts(move_s + 6.0, node, |t| {
                    let [x, _, _] = path(t);
                    (path(t), on(0, ratio * x))
                });
                assert!(
                    !names(&all, other(node)),
                    "{node:?} {ratio} {deg} deg in {move_s} s"
                );
            }
        }
    }
}

#[test]
fn what_moves_both_names_nobody() {
    let level = pose(0.0, 0.0);
    for (own, peer) in [(1.0, 1.0), (1.0, -1.0), (2.0, 1.0), (-1.0, -1.5)] {
        let mut machine = Machine::new(47).works(|_| level);
        let from_s = machine.time_s;
        machine.made(15.0, |machine| {
            let t = machine.time_s - from_s;
            assert!(
                !matches!(machine.bench.last, Judgement::OneChannel { .. }),
                "{own} {peer}"
            );
            machine.pair(level, on(0, own * t), on(0, peer * t))
        });
    }
}

#[test]
fn swapped_axes_at_standstill_name_their_channel() {
    let place = pose(10.0, -5.0);
    let [x, y, _] = place;
    for (seed, node) in (53..).zip(NODES) {
        let mut machine = Machine::new(seed).works(|_| place);
        let all = machine.lasts(3.0, node, |_| (place, [y - x, x - y, 0.0]));
        assert_eq!(
            all.last(),
            Some(&faulty(node, Invalid::Biased)),
            "{node:?}: {all:?}"
        );
    }
}

#[test]
fn a_change_of_the_sync_period_and_lost_pairs_name_nobody_wrongly() {
    let level = pose(0.0, 0.0);
    for (seed, node) in (59..).zip(NODES) {
        for (before_us, after_us, within_s) in [
            (10_000, 200_000, 18.0),
            (200_000, 10_000, 4.5),
            (20_000, 50_000, 5.0),
        ] {
            let mut machine = Machine::new(seed);
            machine.bench.period_us = before_us;
            let mut machine = machine.works(|_| level);
            machine.bench.period_us = after_us;
            let all = machine.lasts(within_s, node, |_| (level, on(0, 10.0)));
            let name = std::format!("{node:?}, {before_us} to {after_us} us: {all:?}");
            assert_eq!(all.last(), Some(&faulty(node, Invalid::Biased)), "{name}");
            assert!(!names(&all, other(node)), "{name}");
        }
        // Every third pair is lost on the way.
        let mut machine = Machine::new(seed).works(|_| level);
        let mut all = Vec::new();
        for n in 0..200 {
            if n % 3 == 0 {
                machine.bench.check.pair_lost();
                machine.bench.period_us = 40_000;
            } else {
                all.push(machine.step(level, node, on(1, 10.0)));
                machine.bench.period_us = 20_000;
            }
        }
        assert_eq!(all.last(), Some(&faulty(node, Invalid::Biased)));
        assert!(!names(&all, other(node)));
    }
}

#[test]
fn on_a_slow_bus_blocks_are_of_twelve_pairs() {
    let level = pose(0.0, 0.0);
    for (seed, node) in (61..).zip(NODES) {
        for period_us in [200_000, 500_000, 1_000_000] {
            let mut machine = Machine::new(seed);
            machine.bench.period_us = period_us;
            let pairs = |count: u32| f64::from(count) * period_us as f64 * 1e-6;
            let healthy = machine.lasts(pairs(60), node, |_| (level, [0.0; 3]));
            assert_eq!(healthy, [Judgement::Agree]);
            let all = machine.lasts(pairs(7 * 12 + 1), node, |_| (level, on(0, 10.0)));
            assert_eq!(
                all.last(),
                Some(&faulty(node, Invalid::Biased)),
                "{period_us}: {all:?}"
            );
        }
    }
}

#[test]
fn a_pause_of_more_than_two_seconds_forgets_where_the_channels_were() {
    let level = pose(0.0, 0.0);
    for (pause_us, named) in [(1_900_000, true), (2_100_000, false)] {
        let mut machine = Machine::new(67).works(|_| level);
        machine.bench.period_us = pause_us;
        machine.step(level, Member::Own, on(0, 10.0));
        machine.bench.period_us = 20_000;
        let all = machine.lasts(5.0, Member::Own, |_| (level, on(0, 10.0)));
        assert_eq!(names(&all, Member::Own), named, "{pause_us}: {all:?}");
    }
}

/// As the exchange rounds it, 2^-13 g.
fn coarse(vector: Corrected) -> Corrected {
    Corrected {
        accel: vector.accel.map(|c| (c + (1 << 12)) >> 13 << 13),
    }
}

#[test]
fn both_nodes_come_to_the_same_answer() {
    let mirrored = |found: Option<Finding>| match found {
        Some(Finding::Moved(node)) => Some(Finding::Moved(other(node))),
        Some(Finding::Stood([own, peer])) => Some(Finding::Stood([peer, own])),
        None => None,
    };
    let mut machine = Machine::new(71);
    let mut states = [movement::MovementState::default(); 2];
    let mut moved = [0; 2];
    for n in 0..40_000 {
        // A step of one channel and then of the other one, a move of the machine in between.
        let t = f64::from(n) * 0.02;
        let force = pose(
            if n % 1000 < 200 {
                0.05 * f64::from(n % 1000)
            } else {
                10.0
            },
            0.0,
        );
        let own = on(0, if n % 1000 > 500 { 6.0 } else { 0.0 });
        let peer = on(1, if n % 2000 > 1700 { -9.0 } else { 0.0 });
        let [own, peer] = machine
            .pair(force, own, peer)
            .map(|one| one.vector.unwrap_or_default());
        let [one, two] = &mut states;
        let check = Movement::PRODUCT;
        let of_own = check.step(one, [&own, &coarse(peer)], true, 20_000);
        let of_peer = check.step(two, [&peer, &coarse(own)], true, 20_000);
        assert_eq!(of_own, mirrored(of_peer), "{t} s");
        if let Some(Finding::Moved(node)) = of_own {
            moved[usize::from(node == Member::Peer)] += 1;
        }
    }
    assert!(moved.iter().all(|count| *count > 20), "{moved:?}");
}

#[test]
fn its_memory_is_small() {
    assert!(
        size_of::<movement::MovementState>() <= 120,
        "{}",
        size_of::<movement::MovementState>()
    );
}

#[test]
fn extremes_do_not_overflow() {
    let [low, high] = [i32::MIN, i32::MAX].map(|v| Corrected { accel: [v; 3] });
    for elapsed_us in [0, 1, 20_000, u32::MAX] {
        for (pairs, block_us) in [(0, 0), (u16::MAX, 0), (0, u32::MAX), (12, u32::MAX)] {
            let check = Movement {
                pairs,
                block_us,
                rest_us: u32::MAX,
                ..Movement::PRODUCT
            };
            let mut state = movement::MovementState::default();
            for n in 0..5_000 {
                let pair = if n % 7 < 3 { [low, high] } else { [high, low] };
                check.step(&mut state, pair.each_ref(), n % 2 == 0, elapsed_us);
            }
        }
    }
}
