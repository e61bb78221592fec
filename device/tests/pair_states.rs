//! The pair in every state that it can be brought into, and in each of them every event.
//!
//! In: two devices on a bus, one of which may be biased, and a list of what a master, a fitter, the
//! bus and a supply can do to either. Out: the search goes on until no event leads to a state that
//! was not there before, and every frame on the way is held against the rules of docs/safety.md:
//! - an angle marked valid is right, or wrong for half a second in which both could be compared;
//! - it was compared since its node was last away;
//! - one channel alone has agreed with the other one before, and did not differ from it since;
//! - a disagreement ends with a reset of its node, or as 2004h says;
//! - a safety frame has a comparison behind it that is no older than its cycle.
//!
//! What is stored of the low-passes is not part of a state: they hold what the last second was.

mod both;

use std::collections::{HashSet, VecDeque};
use std::fmt::Write as _;

use both::{Heard, NODES, Policy, TICK_US, World};
use tilt::sample::Instant;

/// How long a wrong angle may be marked valid while both can be compared, us.
const REACTION_US: i64 = 500_000;

/// Cycle of the safety frames as delivered, and what a comparison takes after its SYNC, us.
const SCT_US: i64 = 25_000;

/// The slowest SYNC for which the reaction time is promised, us.
const PROMISED_SYNC_US: i64 = 50_000;

/// The most that one pair counts for towards going on alone, us.
const MOST_CREDIT_US: i64 = 250_000;

/// What can happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    Time,
    Bias(bool),
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
    Sync(Option<i64>),
}

fn events() -> Vec<Event> {
    let mut all = vec![Event::Time, Event::Bias(true), Event::Bias(false)];
    for n in NODES {
        all.extend([
            Event::PreOperational(n),
            Event::Start(n),
            Event::Reset(n),
            Event::ResetCommunication(n),
            Event::Wire(n, false),
            Event::Wire(n, true),
            Event::BusOff(n),
            Event::Recover(n),
            Event::Power(n, false),
            Event::Power(n, true),
            Event::LoseExchange(n),
            Event::BrownOut(n),
        ]);
    }
    all.extend([None, Some(20_000), Some(200_000)].map(Event::Sync));
    all
}

/// The biased node, and by how much: 2.9 deg.
const BIASED: usize = 0;
const BIAS_MG: i16 = 50;

/// How long an event is followed by nothing else, us: less than what makes a peer silent, less and
/// more than what a difference has to last, and more than what a silence is held against it.
const PAUSES_US: [i64; 3] = [30_000, 350_000, 1_400_000];

/// What was true of one node so far.
#[derive(Clone, Copy, Debug, Default)]
struct Past {
    /// For how long it has been biased while both could be compared, us.
    exposed_us: i64,
    /// For how long both could be compared since it was last away, us, and in how many SYNCs.
    compared_us: i64,
    compared: u32,
    /// It has shown a disagreement that only a reset ends.
    disagreed: bool,
    /// When the last SYNC was at which both could be compared.
    last: Option<Instant>,
}

#[derive(Clone)]
struct State {
    world: World,
    biased: bool,
    past: [Past; 2],
    last_sync: Instant,
}

impl State {
    fn new(policy: Policy) -> Self {
        let mut world = World::new(policy);
        world.load();
        NODES.into_iter().for_each(|n| world.boot(n));
        let last_sync = world.now;
        world.save();
        Self {
            world,
            biased: false,
            past: [Past::default(); 2],
            last_sync,
        }
    }

    fn can_compare(world: &World) -> bool {
        world.nodes.iter().all(|node| {
            let channel = node.device.channel().reason();
            let sound = channel.or(node.device.pair().own_fault()).is_none();
            node.is_connected() && node.is_operational() && sound
        })
    }

    /// The event makes a difference now.
    fn applies(&self, event: Event) -> bool {
        let node = |n: usize| &self.world.nodes[n];
        match event {
            Event::Time | Event::LoseExchange(_) => true,
            Event::Bias(on) => self.biased != on,
            Event::PreOperational(n) => node(n).is_connected() && node(n).is_operational(),
            Event::Start(n) => node(n).is_connected() && !node(n).is_operational(),
            Event::Reset(n) | Event::ResetCommunication(n) => node(n).is_connected(),
            Event::Wire(n, on) => node(n).powered && node(n).wired != on,
            Event::BusOff(n) => node(n).is_connected(),
            Event::Recover(n) => node(n).powered && node(n).off,
            Event::Power(n, on) => node(n).powered != on,
            Event::BrownOut(n) => node(n).powered,
            Event::Sync(us) => self.world.sync_us != us,
        }
    }

    fn after(&self, event: Event, pause_us: i64, latch_s: u16) -> (Self, Vec<String>) {
        let mut next = self.clone();
        next.world.load();
        let mut broken = Vec::new();
        let State {
            world,
            biased,
            past,
            last_sync,
        } = &mut next;
        let truth = std::cell::RefCell::new((past, last_sync, &mut broken));
        let is_biased = std::cell::Cell::new(*biased);
        let mut heard = |world: &World, heard: Heard| {
            let (past, last_sync, broken) = &mut *truth.borrow_mut();
            hear(world, heard, is_biased.get(), past, last_sync, latch_s, broken);
        };
        let to = |n: usize| n as u8 + 1;
        match event {
            Event::Time => {}
            Event::Bias(on) => {
                is_biased.set(on);
                world.part(BIASED).set_offset(if on { BIAS_MG } else { 0 });
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
            Event::Sync(us) => world.set_sync(us),
        }
        away(world, &mut truth.borrow_mut().0, event);
        world.run(pause_us, &mut heard);
        *biased = is_biased.get();
        drop(truth);
        next.world.save();
        (next, broken)
    }

    /// What a state is: everything that the next events may depend on, times in classes.
    fn key(&self) -> String {
        let mut key = format!("{:?} {}", self.world.sync_us, self.biased);
        let shown = |n: usize| {
            let node = &self.world.nodes[n];
            (node.powered, node.wired, node.off, node.device.bus().state())
        };
        for n in NODES {
            let device = &self.world.nodes[n].device;
            let findings = device.pair().check().findings().map(|found| found.coarse());
            let told = device.shown(self.world.now);
            let past = &self.past[n];
            // A string takes whatever is written to it.
            let _ = write!(
                key,
                " | {:?} {findings:?} {} {:?} {:?} {} {} {} {}",
                shown(n),
                told.state(),
                told.standing(),
                device.channel().reason(),
                past.exposed_us > REACTION_US,
                past.compared_us >= REACTION_US,
                past.compared.min(1),
                past.disagreed,
            );
        }
        key
    }
}

/// A node that was reset, or left OPERATIONAL, begins anew.
fn away(world: &World, past: &mut [Past; 2], event: Event) {
    for n in NODES {
        let reset = matches!(event, Event::Reset(m) | Event::Power(m, _) if m == n);
        if reset {
            past[n] = Past::default();
        }
        if !world.nodes[n].is_operational() {
            (past[n].compared, past[n].compared_us) = (0, 0);
        }
    }
    if matches!(event, Event::Bias(false)) {
        past[BIASED].exposed_us = 0;
    }
}

/// One frame, held against the rules.
fn hear(
    world: &World,
    heard: Heard,
    biased: bool,
    past: &mut [Past; 2],
    last_sync: &mut Instant,
    latch_s: u16,
    broken: &mut Vec<String>,
) {
    let Some(id) = heard.frame.cob_id() else {
        return;
    };
    if id == 0x80 {
        // What is counted in SYNCs takes longer where they come more slowly than every 50 ms.
        let passed_us = heard.at.micros_since(*last_sync).min(MOST_CREDIT_US);
        let promised_us = passed_us.min(PROMISED_SYNC_US);
        *last_sync = heard.at;
        if State::can_compare(world) {
            for (n, past) in past.iter_mut().enumerate() {
                past.exposed_us += if biased && n == BIASED { promised_us } else { 0 };
                past.compared_us += passed_us;
                past.compared += 1;
                past.last = Some(heard.at);
            }
        }
        return;
    }
    let Some(n) = heard.by else { return };
    let wrong = biased && n == BIASED && past[n].exposed_us > REACTION_US;
    let mut rule = |holds: bool, what: &str| {
        if !holds {
            broken.push(format!("{what}: {:?} {:X?} of {id:X}h", heard.at, heard.frame.bytes()));
        }
    };
    if id == 0x101 + 2 * n as u16 {
        rule(!wrong, "a wrong safety frame");
        let age_us = past[n].last.map(|last| heard.at.micros_since(last));
        rule(
            age_us.is_some_and(|us| us <= SCT_US + TICK_US),
            "a safety frame without a comparison within its cycle",
        );
        rule(!past[n].disagreed, "a safety frame of a pair that disagrees");
    }
    if id == 0x181 + n as u16 {
        let [.., validity, state] = heard.frame.bytes() else {
            return;
        };
        let valid = validity & 1 != 0;
        if *state == 6 && latch_s == 0 {
            past[n].disagreed = true;
        }
        // The difference is attributed to the other channel: stuck, noise, spikes, thermometer,
        // bias, calibration.
        let (blamed, why) = world.nodes[n].device.shown(world.now).blame();
        past[n].disagreed &= !(blamed == 2 && (9..=14).contains(&why));
        if !valid {
            return;
        }
        rule(!wrong, "a wrong angle");
        rule(!past[n].disagreed, "a disagreement was forgotten");
        // The SYNC of this very frame has not been compared yet.
        let before = past[n].compared > u32::from(State::can_compare(world));
        rule(before, "valid without a comparison");
        // The newest pair counts for a while (`device::pair`).
        let period_us = world.sync_us.unwrap_or(0);
        let counts_us = (period_us * 9 / 2).max(400_000) + period_us + TICK_US;
        let alone = past[n]
            .last
            .is_none_or(|last| heard.at.micros_since(last) > counts_us);
        rule(
            !alone || past[n].compared_us >= 400_000,
            "alone without having agreed",
        );
    }
}

/// Searches all states; how many there are, and how many events lead to the last of them.
fn explore(policy: Policy, most: usize) -> (usize, usize, bool) {
    let events = events();
    let start = State::new(policy);
    let mut known = HashSet::from([start.key()]);
    let mut open = VecDeque::from([(start, Vec::new())]);
    let mut depth = 0;
    while let Some((state, path)) = open.pop_front() {
        depth = path.len();
        for &event in events.iter().filter(|event| state.applies(**event)) {
            for pause_us in PAUSES_US {
                let mut path = path.clone();
                path.push((event, pause_us));
                let (next, broken) = state.after(event, pause_us, policy.latch_s);
                let first = broken.first();
                assert_eq!(first, None, "{policy:?} {path:?}\n{}", next.key());
                if known.len() < most && known.insert(next.key()) {
                    open.push_back((next, path));
                }
            }
        }
    }
    (known.len(), depth, known.len() < most)
}

#[test]
fn no_sequence_of_events_makes_a_wrong_angle_valid() {
    for (latch_s, degraded) in [(0, 1), (0, 0), (1, 1)] {
        let policy = Policy { latch_s, degraded };
        let began = std::time::Instant::now();
        let (states, depth, closed) = explore(policy, 20_000);
        println!("{policy:?}: {states} states, depth {depth}, closed {closed}, {:?}", began.elapsed());
    }
}
