//! The pair in every state that it can be brought into, and in each of them every event.
//!
//! In: two devices on a bus, products or variants with a gyroscope, a sensor of one of which may be
//! biased, and a list of what a master, a fitter, the bus and a supply can do to either. Out: the
//! search goes on until no event leads to a state that was not there before, and every frame on the
//! way is held against the rules of docs/safety.md:
//! - an angle marked valid is right, or wrong for half a second in which both could be compared;
//! - it was compared since its node was last away;
//! - one channel alone has agreed with the other one before, and did not differ from it since;
//! - a disagreement ends with a reset of its node, or as 2004h sets;
//! - a safety frame has a comparison behind it that is no older than its cycle;
//! - nobody who was told of a channel's fault reads an angle of it, in whatever state of the node;
//! - two that agree have received whole exchanges of each other.
//!
//! A state is what is connected and OPERATIONAL, what was found and is shown, and what the rules
//! have seen; each is tried with every event, which is followed by each of three lengths of time.
//! What is stored of the low-passes and of times is not part of it: `tilt::cross_check::findings`
//! is searched by itself.

mod both;

use std::cell::RefCell;
use std::collections::{HashSet, VecDeque};
use std::fmt::Write as _;

use both::part::Kind;
use both::rules::{INCOMPLETE_ALLOWED, REACTION_US, Rules, Watch};
use both::{Heard, NODES, Policy, World};

/// What can happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    Time,
    Bias(bool),
    Turn(bool),
    PreOperational(usize),
    Start(usize),
    Reset(usize),
    ResetCommunication(usize),
    Wire(usize, bool),
    BusOff(usize),
    Recover(usize),
    Power(usize, bool),
    LoseExchange(usize),
    BrownOut(usize),
    /// From now on this PDO of a node's exchange does not arrive; `None`: all do.
    Omit(usize, Option<usize>),
    Sync(Option<i64>),
}

impl Event {
    /// A node goes, comes, or begins anew.
    fn is_of_a_node(self) -> bool {
        use Event::{Bias, LoseExchange, Omit, Sync, Time, Turn};
        !matches!(
            self,
            Time | Bias(_) | Turn(_) | LoseExchange(_) | Omit(..) | Sync(_)
        )
    }
}

/// What can happen to one node with this part, in kinds.
fn kinds(part: Kind, n: usize) -> Vec<Vec<Event>> {
    let mut kinds = vec![
        vec![Event::PreOperational(n), Event::Start(n)],
        vec![Event::Reset(n)],
        vec![Event::ResetCommunication(n)],
        vec![Event::Wire(n, false), Event::Wire(n, true)],
        vec![Event::BusOff(n), Event::Recover(n)],
        vec![Event::Power(n, false), Event::Power(n, true)],
        vec![Event::LoseExchange(n)],
        vec![Event::BrownOut(n)],
    ];
    let omitted = |pdo| [Some(pdo), None].map(|pdo| Event::Omit(n, pdo)).to_vec();
    kinds.extend((0..part.pdos()).map(omitted));
    kinds
}

/// What can happen when one kind of event happens to node 0 and one to node 1, and these come and
/// go in the biased one.
fn events(part: Kind, faults: &[fn(bool) -> Event], kind: [usize; 2]) -> Vec<Event> {
    let faults = faults.iter().flat_map(|fault| [true, false].map(fault));
    let mut all: Vec<_> = [Event::Time].into_iter().chain(faults).collect();
    for n in NODES {
        all.extend(&kinds(part, n)[kind[n]]);
        if !all.contains(&Event::Start(n)) {
            all.push(Event::Start(n));
        }
    }
    all.extend([None, Some(20_000), Some(200_000)].map(Event::Sync));
    all
}

/// The biased node, and by how much: 2.9 deg, or its gyroscope.
const BIASED: usize = 0;
const BIAS_MG: i16 = 50;
const TURN_DPS: i16 = 2;

/// How long an event is followed by nothing else, us, one after the other: less than what makes a
/// peer silent, then more than what a difference has to last, and then more than what a silence is
/// held against it.
const PAUSES_US: [i64; 3] = [30_000, 320_000, 1_050_000];

/// A search that finds more states does not close.
const MOST_STATES: usize = 60_000;
/// One that finds fewer has not searched.
const FEWEST_STATES: usize = 300;

#[derive(Clone)]
struct State {
    world: World,
    /// The accelerometer is biased, the gyroscope.
    biased: [bool; 2],
    watch: Watch,
}

impl State {
    fn new(part: Kind, policy: Policy) -> Self {
        let mut world = World::new(part, policy);
        world.load();
        NODES.into_iter().for_each(|n| world.boot(n));
        let watch = Watch::new(world.now, part == Kind::Ism330dhcx);
        world.save();
        Self {
            world,
            biased: [false; 2],
            watch,
        }
    }

    /// The event makes a difference now.
    fn applies(&self, event: Event) -> bool {
        let node = |n: usize| &self.world.nodes[n];
        match event {
            Event::Time | Event::LoseExchange(_) => true,
            Event::Bias(on) => self.biased[0] != on,
            Event::Turn(on) => self.biased[1] != on,
            Event::PreOperational(n) => node(n).is_connected() && node(n).is_operational(),
            Event::Start(n) => node(n).is_connected() && !node(n).is_operational(),
            Event::Reset(n) | Event::ResetCommunication(n) => node(n).is_connected(),
            Event::Wire(n, on) => node(n).powered && node(n).wired != on,
            Event::BusOff(n) => node(n).is_connected(),
            Event::Recover(n) => node(n).powered && node(n).off,
            Event::Power(n, on) => node(n).powered != on,
            Event::BrownOut(n) => node(n).powered,
            // One after the other, so that each comes back.
            Event::Omit(n, Some(_)) => self.world.omitted[n].is_none(),
            Event::Omit(n, None) => self.world.omitted[n].is_some(),
            Event::Sync(us) => self.world.sync_us != us,
        }
    }

    /// An event and the time after it, in a world that others share the parts with: the rules that
    /// were broken.
    fn follow(&mut self, event: Event, pause_us: i64, latch_s: u16) -> Vec<String> {
        self.world.load();
        let broken = self.happen(event, pause_us, latch_s);
        self.world.save();
        broken
    }

    fn happen(&mut self, event: Event, pause_us: i64, latch_s: u16) -> Vec<String> {
        let Self {
            world,
            biased,
            watch,
        } = self;
        let watch = RefCell::new(watch);
        let broken = RefCell::new(Vec::new());
        let mut heard = |world: &World, heard: Heard| {
            let mut rules = Rules {
                latch_s,
                watch: &mut watch.borrow_mut(),
                broken: &mut broken.borrow_mut(),
            };
            rules.hear(world, heard);
        };
        let to = |n: usize| n as u8 + 1;
        match event {
            Event::Time => {}
            Event::Bias(on) => {
                biased[0] = on;
                world.part(BIASED).set_offset(if on { BIAS_MG } else { 0 });
            }
            Event::Turn(on) => {
                biased[1] = on;
                world.part(BIASED).set_rate(if on { TURN_DPS } else { 0 });
            }
            Event::PreOperational(n) => world.command(0, &[128, to(n)], &mut heard),
            Event::Start(n) => world.command(0, &[1, to(n)], &mut heard),
            Event::Reset(n) => world.command(0, &[129, to(n)], &mut heard),
            Event::ResetCommunication(n) => world.command(0, &[130, to(n)], &mut heard),
            Event::Wire(n, on) => world.nodes[n].wired = on,
            Event::BusOff(n) => world.bus_off(n),
            Event::Recover(n) => world.recover(n),
            Event::Power(n, false) => world.power_off(n),
            Event::Power(n, true) => world.boot(n),
            Event::LoseExchange(n) => world.lose_exchange(n),
            Event::BrownOut(n) => world.part(n).power_down(),
            Event::Omit(n, pdo) => world.omitted[n] = pdo,
            Event::Sync(us) => world.set_sync(us),
        }
        let restarted = match event {
            Event::Reset(n) | Event::Power(n, _) => Some(n),
            _ => None,
        };
        (watch.borrow_mut()).begin_anew(world, event.is_of_a_node(), restarted);
        world.run(pause_us, &mut heard);
        broken.into_inner()
    }

    /// What a state is: everything that the next events may depend on, times in classes.
    fn key(&self) -> String {
        let world = &self.world;
        let mut key = format!("{:?} {:?} {:?}", world.sync_us, self.biased, world.omitted);
        let shown = |n: usize| {
            let node = &self.world.nodes[n];
            (
                node.powered,
                node.wired,
                node.off,
                node.device.bus().state(),
            )
        };
        for n in NODES {
            let device = &self.world.nodes[n].device;
            let check = device.pair().check();
            let found = (
                check.found(),
                check.disagree(),
                check.have_agreed(),
                check.is_latched(),
            );
            let told = device.shown(self.world.now);
            let past = &self.watch.past[n];
            // A string takes whatever is written to it.
            let _ = write!(
                key,
                " | {:?} {found:?} {} {:?} {:?} {} {} {} {} {}",
                shown(n),
                told.state(),
                told.usable(),
                device.channel().reason(),
                past.exposed_us > REACTION_US,
                past.compared_us >= REACTION_US,
                past.compared.min(1),
                past.disagreed,
                past.incomplete > INCOMPLETE_ALLOWED,
            );
        }
        key
    }
}

/// Searches all states that one kind of events at each node leads to, until there are no more.
fn explore(policy: Policy, kind: [usize; 2]) {
    search(Kind::Lis2dw12, &[Event::Bias], policy, kind);
}

/// The same of these parts and faults.
fn search(part: Kind, faults: &[fn(bool) -> Event], policy: Policy, kind: [usize; 2]) {
    let events = events(part, faults, kind);
    let start = State::new(part, policy);
    let mut known = HashSet::from([start.key()]);
    let mut open = VecDeque::from([(start, Vec::new())]);
    let mut depth = 0;
    while let Some((state, path)) = open.pop_front() {
        depth = path.len();
        for &event in events.iter().filter(|event| state.applies(**event)) {
            let (mut next, mut path) = (state.clone(), path.clone());
            for (event, pause_us) in [event, Event::Time, Event::Time].into_iter().zip(PAUSES_US) {
                path.push((event, pause_us));
                let broken = next.follow(event, pause_us, policy.latch_s);
                let first = broken.first();
                assert_eq!(first, None, "{policy:?} {path:?}\n{}", next.key());
                if known.insert(next.key()) {
                    open.push_back((next.clone(), path.clone()));
                }
            }
        }
        assert!(
            known.len() < MOST_STATES,
            "{kind:?}: the states do not close"
        );
    }
    // Every event has been tried in every state, and none of them leads to a new one.
    println!(
        "{part:?} {policy:?} {kind:?}: {} states, {depth} events deep",
        known.len()
    );
    assert!(known.len() > FEWEST_STATES, "{kind:?}: {}", known.len());
}

const AS_DELIVERED: Policy = Policy {
    latch_s: 0,
    degraded: 1,
};

/// Follows one sequence; no rule is broken on the way.
fn follow(policy: Policy, path: &[(Event, i64)]) -> State {
    follow_with(Kind::Lis2dw12, policy, path)
}

/// The same with this part.
fn follow_with(part: Kind, policy: Policy, path: &[(Event, i64)]) -> State {
    let mut state = State::new(part, policy);
    state.world.load();
    for (step, &(event, pause_us)) in path.iter().enumerate() {
        let broken = state.happen(event, pause_us, policy.latch_s);
        assert_eq!(broken.first(), None, "{policy:?}, step {step} of {path:?}");
    }
    state
}

/// Both work and agree for two seconds, then one comes back biased, until they disagree: a bias
/// that begins while they are compared would name its channel.
const DISAGREEING: [(Event, i64); 6] = [
    (Event::Start(0), 30_000),
    (Event::Start(1), 2_000_000),
    (Event::PreOperational(BIASED), 300_000),
    (Event::Bias(true), 300_000),
    (Event::Start(BIASED), 1_000_000),
    (Event::Time, 1_000_000),
];

/// Ways in which a node goes and comes back, with 0.3 s between.
fn absences(n: usize) -> [(Event, Event); 5] {
    [
        (Event::PreOperational(n), Event::Start(n)),
        (Event::Wire(n, false), Event::Wire(n, true)),
        (Event::BusOff(n), Event::Recover(n)),
        (Event::Sync(None), Event::Sync(Some(20_000))),
        (Event::Sync(Some(200_000)), Event::Sync(Some(20_000))),
    ]
}

#[test]
fn a_latched_disagreement_was_forgotten_when_the_healthy_node_came_back() {
    for n in NODES {
        for (goes, comes) in absences(n) {
            for latch_s in [0, 5] {
                for again_us in [500_000, 3_000_000] {
                    let mut path = DISAGREEING.to_vec();
                    path.extend([(goes, 300_000), (comes, again_us)]);
                    path.extend([(goes, 3_000_000), (comes, 2_000_000)]);
                    let policy = Policy {
                        latch_s,
                        ..AS_DELIVERED
                    };
                    let state = follow(policy, &path);
                    let told = NODES.map(|n| state.world.nodes[n].device.shown(state.world.now));
                    assert_eq!(told.map(|told| told.validity() & 3), [0; 2], "{path:?}");
                }
            }
        }
    }
}

#[test]
fn a_bias_that_begins_while_they_are_compared_names_its_channel_on_both_nodes() {
    let mut path = DISAGREEING[..2].to_vec();
    path.extend([(Event::Bias(true), 1_000_000), (Event::Time, 1_000_000)]);
    let state = follow(AS_DELIVERED, &path);
    let told = NODES.map(|n| state.world.nodes[n].device.shown(state.world.now));
    let valid = NODES.map(|n| if n == BIASED { 0 } else { 3 });
    assert_eq!(told.map(|told| told.validity() & 3), valid);
}

#[test]
fn differences_were_ignored_in_the_second_after_a_return() {
    for (goes, comes) in absences(1) {
        let mut path = DISAGREEING[..2].to_vec();
        path.extend([(goes, 300_000), (Event::Bias(true), 300_000)]);
        path.extend([(comes, 600_000), (Event::Time, 2_000_000)]);
        let state = follow(AS_DELIVERED, &path);
        let told = state.world.nodes[BIASED].device.shown(state.world.now);
        assert_eq!(told.validity() & 3, 0, "{path:?}");
    }
}

#[test]
fn the_first_angle_after_a_start_was_valid_without_a_comparison() {
    for n in NODES {
        // While they disagree, and while the other one is away.
        let mut path = DISAGREEING.to_vec();
        path.extend([
            (Event::PreOperational(n), 300_000),
            (Event::Start(n), 20_000),
        ]);
        path.extend([(Event::PreOperational(n), 5_000), (Event::Start(n), 20_000)]);
        follow(AS_DELIVERED, &path);
        let mut path = DISAGREEING[..2].to_vec();
        path.extend([(Event::PreOperational(1 - n), 300_000)]);
        path.extend([
            (Event::PreOperational(n), 300_000),
            (Event::Start(n), 20_000),
        ]);
        path.extend([(Event::Time, 3_000_000)]);
        follow(AS_DELIVERED, &path);
    }
}

#[test]
fn safety_frames_went_on_for_seconds_after_sync_had_stopped() {
    for (before, us) in [(Some(20_000), 2_000_000), (Some(200_000), 3_000_000)] {
        let mut path = DISAGREEING[..2].to_vec();
        path.extend([(Event::Sync(before), us), (Event::Sync(None), 100_000)]);
        path.extend([(Event::Bias(true), 1_000_000)]);
        follow(AS_DELIVERED, &path);
    }
}

/// Policies: as delivered, with a latch time, and with both or none.
const POLICIES: [Policy; 3] = [
    AS_DELIVERED,
    Policy {
        latch_s: 1,
        ..AS_DELIVERED
    },
    Policy {
        degraded: 0,
        ..AS_DELIVERED
    },
];

#[test]
fn no_sequence_of_nmt_commands_and_bus_off_makes_a_wrong_angle_valid() {
    explore(AS_DELIVERED, [0, 4]);
}

#[test]
fn no_sequence_of_wires_and_power_makes_a_wrong_angle_valid() {
    explore(AS_DELIVERED, [3, 5]);
}

#[test]
fn no_sequence_of_resets_and_losses_makes_a_wrong_angle_valid() {
    explore(AS_DELIVERED, [1, 6]);
    explore(AS_DELIVERED, [2, 7]);
}

#[test]
fn no_sequence_of_omitted_pdos_makes_a_wrong_angle_valid() {
    explore(AS_DELIVERED, [9, 6]);
    search(Kind::Ism330dhcx, &[Event::Turn], AS_DELIVERED, [10, 6]);
}

#[test]
fn no_policy_makes_a_wrong_angle_valid() {
    for policy in POLICIES {
        explore(policy, [0, 1]);
    }
}

#[test]
fn no_sequence_with_a_gyroscope_makes_a_wrong_angle_valid() {
    for kind in [[0, 1], [1, 6], [2, 7]] {
        search(Kind::Ism330dhcx, &[Event::Turn], AS_DELIVERED, kind);
    }
}

/// Nobody had compared the gyroscope while it was wrong. The angle was 3 deg off then and stated as
/// certain to 0.4 deg, beside a channel that had just started.
#[test]
fn a_gyroscope_that_had_been_wrong_unseen_left_a_wrong_angle_valid() {
    let mut path = vec![(Event::Start(0), 30_000), (Event::Start(1), 1_400_000)];
    path.extend([
        (Event::Turn(true), 30_000),
        (Event::Wire(BIASED, false), 1_400_000),
    ]);
    path.extend([
        (Event::Wire(BIASED, true), 30_000),
        (Event::Power(1, false), 30_000),
    ]);
    path.extend([(Event::Power(1, true), 30_000), (Event::Start(1), 30_000)]);
    path.push((Event::Turn(false), 1_700_000));
    let state = follow_with(Kind::Ism330dhcx, AS_DELIVERED, &path);
    for node in &state.world.nodes {
        let shown = node.device.shown(state.world.now);
        let error = shown.own(0).map(|x| x.angle.degrees().abs());
        assert!(error.is_ok_and(|deg| deg < 0.3), "{error:?}");
    }
}

/// Every kind of event at one node with every kind at the other.
fn pairs(part: Kind) -> impl Iterator<Item = [usize; 2]> {
    let count = kinds(part, 0).len();
    (0..count * count).map(move |both| [both / count, both % count])
}

#[test]
#[ignore = "every kind of event at one node with every kind at the other: hours"]
fn no_sequence_of_events_makes_a_wrong_angle_valid() {
    for policy in POLICIES {
        for kind in pairs(Kind::Lis2dw12) {
            explore(policy, kind);
        }
        for kind in pairs(Kind::Ism330dhcx) {
            let both: [fn(bool) -> Event; 2] = [Event::Bias, Event::Turn];
            search(Kind::Ism330dhcx, &both, policy, kind);
        }
    }
}
