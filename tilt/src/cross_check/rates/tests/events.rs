//! What comes and goes while a fault stands: the healthy channel is never named.
//!
//! Every event at every moment around a fault's beginning, for faults of either sensor of either
//! channel, on a boom that swings with and without a pause.

use super::*;

/// What happens on the way from the sensors to the check.
#[derive(Clone, Copy, Debug)]
enum Event {
    /// So many pairs are lost; what turns meanwhile comes with the next one.
    Lost(u32),
    /// The peer's gyroscope takes no part for so many pairs.
    PeerAbsent(u32),
    /// The own one does not.
    OwnAbsent(u32),
    /// Neither has an acceleration for so many pairs.
    OverRange(u32),
    /// A shock goes through the machine for so many pairs.
    Shaken(u32),
    /// The fault pauses for so many pairs.
    Pauses(u32),
    /// This channel was away, or the peer has been started anew: all begins anew.
    Restart,
    /// The peer has been started anew within so many pairs, and its boot-up was lost.
    Unheard(u32),
}

const EVENTS: [Event; 21] = [
    Event::Lost(1),
    Event::Lost(2),
    Event::Lost(5),
    Event::Lost(13),
    Event::Lost(50),
    Event::PeerAbsent(1),
    Event::PeerAbsent(5),
    Event::PeerAbsent(50),
    Event::OwnAbsent(1),
    Event::OwnAbsent(50),
    Event::OverRange(1),
    Event::OverRange(5),
    Event::OverRange(50),
    Event::Shaken(1),
    Event::Shaken(50),
    Event::Pauses(1),
    Event::Pauses(25),
    Event::Pauses(50),
    Event::Pauses(110),
    Event::Restart,
    Event::Unheard(20),
];

/// A fault of one channel: what its gyroscope reads beyond the truth at so many deg/s, and its
/// accelerometer, mg.
#[derive(Clone, Copy, Debug)]
enum Wrong {
    Rate([f64; 3]),
    Scale(f64),
    Acceleration([f64; 3]),
}

const WRONGS: [Wrong; 10] = [
    Wrong::Rate([1.0, 0.0, 0.0]),
    Wrong::Rate([-1.0, 0.0, 0.0]),
    Wrong::Rate([0.0, 1.0, 0.0]),
    Wrong::Rate([0.0, 0.0, -1.0]),
    Wrong::Scale(0.05),
    Wrong::Scale(-0.05),
    Wrong::Acceleration([10.0, 0.0, 0.0]),
    Wrong::Acceleration([-10.0, 0.0, 0.0]),
    Wrong::Acceleration([0.0, 10.0, 0.0]),
    Wrong::Acceleration([0.0, 0.0, -10.0]),
];

/// Moves of 2, 3, 2.4 and 2 s without a pause, which end where they began.
fn dig(pair: u32) -> f64 {
    const MOVES: [(u32, f64); 4] = [(100, 0.5), (150, -0.8), (120, 0.7), (100, -0.4)];
    let mut left = pair % 470;
    for (length, way) in MOVES {
        if left < length {
            let share = f64::from(left) / f64::from(length);
            let mean = way.to_degrees() / (f64::from(length) * 0.02);
            return mean * (1.0 - (core::f64::consts::TAU * share).cos());
        }
        left -= length;
    }
    0.0
}

/// Pairs before the fault.
const BEFORE: u32 = 1200;

/// One run: the fault, its channel, and the event with the pair at which it begins.
#[derive(Clone, Copy, Debug)]
struct Run {
    wrong: Wrong,
    node: usize,
    event: Event,
    at: u32,
    dps: fn(u32) -> f64,
    /// How the housing stands at first, rad.
    pitch: f64,
    /// What both gyroscopes read too much in any case, deg/s.
    bias: [[f64; 3]; 2],
}

impl Run {
    /// Who is named, until so many pairs after the fault's beginning.
    fn named(&self, until: u32) -> [bool; 2] {
        let mut housing = Housing::new();
        (housing.lever_m, housing.pitch) = (1.0, self.pitch);
        let (mut named, mut elapsed_us) = ([false; 2], 0);
        for pair in 0..BEFORE + until {
            elapsed_us += SYNC_US;
            if let Some(found) = self.pair(&mut housing, pair, elapsed_us) {
                elapsed_us = 0;
                match found.contradicts {
                    Some(Member::Own) => named[0] = true,
                    Some(Member::Peer) => named[1] = true,
                    None => {}
                }
            }
        }
        named
    }

    /// One pair; `None` where it is lost.
    fn pair(&self, housing: &mut Housing, pair: u32, elapsed_us: u32) -> Option<Found> {
        let since = pair.checked_sub(self.at);
        let during = |pairs| since.is_some_and(|since| since < pairs);
        let dps = (self.dps)(pair);
        let stands = pair >= BEFORE && !matches!(self.event, Event::Pauses(n) if during(n));
        let (mut errors, mut mg) = (self.bias, [[0.0; 3]; 2]);
        if stands {
            match self.wrong {
                Wrong::Rate(more) => {
                    for (error, more) in errors[self.node].iter_mut().zip(more) {
                        *error += more;
                    }
                }
                Wrong::Scale(share) => errors[self.node][0] += dps * share,
                Wrong::Acceleration(more) => mg[self.node] = more,
            }
        }
        let mut seen = housing.observe(dps, errors, mg);
        let mut shaken = false;
        match self.event {
            Event::Lost(n) if during(n) => {
                housing.state.skip();
                return None;
            }
            Event::PeerAbsent(n) if during(n) => seen[1].turned = None,
            Event::OwnAbsent(n) if during(n) => seen[0].turned = None,
            Event::OverRange(n) if during(n) => seen.iter_mut().for_each(|one| one.vector = None),
            Event::Shaken(n) => shaken = during(n),
            Event::Restart if since == Some(0) => housing.state.restart(),
            Event::Unheard(n) if during(n) => {
                housing.turned[1] = TurnedState::default();
                return None;
            }
            _ => {}
        }
        let differ = mg[0] != mg[1] && seen.iter().all(|one| one.vector.is_some());
        let [own, peer] = &seen;
        let found = (housing.check).step(
            &mut housing.state,
            [own, peer],
            (differ, shaken),
            elapsed_us,
        );
        Some(found)
    }
}

#[test]
fn no_event_beside_a_fault_names_the_healthy_channel() {
    const MOMENTS: u32 = 12;
    let (mut named, mut runs) = (0, 0);
    for (which, wrong) in WRONGS.into_iter().enumerate() {
        for (number, event) in EVENTS.into_iter().enumerate() {
            for moment in 0..MOMENTS {
                let case = which + number + moment as usize;
                let run = Run {
                    wrong,
                    node: case % 2,
                    event,
                    at: BEFORE - 50 + moment * 50,
                    dps: [dig, swing][case / 2 % 2],
                    pitch: 0.0,
                    bias: [[0.0; 3]; 2],
                };
                let by_node = run.named(1000);
                let [faulty, healthy] = [by_node[run.node], by_node[1 - run.node]];
                assert!(!healthy, "{wrong:?} of {}, {event:?}, {moment}", run.node);
                named += u32::from(faulty);
                runs += 1;
            }
        }
    }
    // Some events come after a channel was named, and some keep it from being named.
    assert!(named * 2 > runs, "{named} of {runs}");
}

/// Stands with its y nearly upright, turns within 2 s until z nearly is, and stands again.
fn turn_once(pair: u32) -> f64 {
    let Some(at @ 0..100) = pair.checked_sub(BEFORE - 60) else {
        return 0.0;
    };
    let share = f64::from(at) * 0.01;
    -30.0 * (1.0 - (core::f64::consts::TAU * share).cos())
}

/// A bias that gravity does not show where the machine stands turns the place where it stands
/// afterwards. Each window of that standstill counted as if it had shown something else.
#[test]
fn a_bias_that_another_place_did_not_show_named_the_healthy_channel() {
    let (mut named, mut runs) = (0, 0);
    let signed = |size: f64| (1..3).flat_map(move |axis| [(axis, size), (axis, -size)]);
    for (node, biased) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        for (axis, dps) in signed(0.5) {
            for (other, small) in signed(0.15) {
                let (mut fault, mut bias) = ([0.0; 3], [[0.0; 3]; 2]);
                fault[axis] = dps;
                bias[biased][other] = small;
                let run = Run {
                    wrong: Wrong::Rate(fault),
                    node,
                    event: Event::Lost(0),
                    at: 0,
                    dps: turn_once,
                    pitch: 1.3,
                    bias,
                };
                let by_node = run.named(2000);
                assert!(!by_node[1 - node], "{run:?}");
                named += u32::from(by_node[node]);
                runs += 1;
            }
        }
    }
    assert!(named * 3 > runs, "{named} of {runs}");
}
