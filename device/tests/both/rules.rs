//! The rules of docs/safety.md that every frame is held against, and what they have to remember.
//!
//! In: every frame of both nodes, with the world as it is then. Out: the rules that were broken.

use device::exchange::NO_VECTOR;
use device::fault::Fault;
use instant::Instant;
use tilt::angle::Axes;

use super::{Heard, Node, TICK_US, World};

/// How long a wrong angle may be marked valid while both can be compared, us.
pub const REACTION_US: i64 = 500_000;

/// Cycle of the safety frames as delivered, and what a comparison takes after its SYNC, us.
const SCT_US: i64 = 25_000;

/// The state of two that agree (2021h).
const AGREE: u8 = 1;

/// The slowest SYNC for which the reaction time is promised, us.
const PROMISED_SYNC_US: i64 = 50_000;

/// The most that one pair counts for towards going on alone, us.
const MOST_CREDIT_US: i64 = 250_000;

/// Faults that the sensor's own node finds, beside which there is no angle.
const OF_THE_SENSOR: [Fault; 5] = [
    Fault::SensorSupply,
    Fault::SensorBus,
    Fault::SensorSilent,
    Fault::SensorStuck,
    Fault::Thermometer,
];

/// The place of the PDO that tells how far a channel has turned.
const TURN: usize = 2;

/// SYNCs in a row without a whole exchange, with that at which the slopes are made before they are
/// compared, that may leave a pair that agrees.
pub const INCOMPLETE_ALLOWED: u32 = 6;

/// Both are level. An angle that is farther off is wrong, deg.
const WRONG_DEG: f64 = 1.0;

/// It is off by so many of its stated standard uncertainties as well: two angles that are closer
/// than that do not differ (`tilt::cross_check::WindowCheck`).
const COVERAGE: f64 = 5.0;

/// What was true of one node so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Past {
    /// For how long its angle has been wrong while both could be compared, us.
    pub exposed_us: i64,
    /// For how long both could be compared since it was last away, us, and in how many SYNCs.
    pub compared_us: i64,
    pub compared: u32,
    /// It has shown a disagreement that only a reset ends.
    pub disagreed: bool,
    /// When the last SYNC was at which both could be compared.
    pub last: Option<Instant>,
    /// SYNCs in a row at which a PDO that it needs of the other one's exchange did not arrive.
    pub incomplete: u32,
}

/// What was true so far.
#[derive(Clone, Debug)]
pub struct Watch {
    pub past: [Past; 2],
    last_sync: Instant,
    /// What was compared before an interruption counts for nothing towards the time in which a
    /// wrong angle has to be found: a difference of two verticals alone takes most of it.
    anew: bool,
    /// Time between the SYNCs before, us. A PDO is made before its own SYNC is counted.
    periods_us: [i64; 3],
}

impl Watch {
    /// Nothing was true before `now`; see [`Watch::anew`].
    pub fn new(now: Instant, anew: bool) -> Self {
        Self {
            past: [Past::default(); 2],
            last_sync: now,
            anew,
            periods_us: [0; 3],
        }
    }

    /// A node that was reset, or left OPERATIONAL, begins anew. `of_a_node` after every event in
    /// which a node goes or comes: what it has not received so far is not held against it.
    pub fn begin_anew(&mut self, world: &World, of_a_node: bool, restarted: Option<usize>) {
        for (n, past) in self.past.iter_mut().enumerate() {
            if of_a_node {
                past.incomplete = 0;
            }
            if restarted == Some(n) {
                *past = Past::default();
            }
            if !world.nodes[n].is_operational() {
                (past.compared, past.compared_us) = (0, 0);
            }
        }
    }

    fn sync(&mut self, world: &World, at: Instant) {
        let period_us = at.micros_since(self.last_sync);
        let [newest, before, _] = self.periods_us;
        self.periods_us = [period_us, newest, before];
        let passed_us = period_us.min(MOST_CREDIT_US);
        let promised_us = passed_us.min(PROMISED_SYNC_US);
        self.last_sync = at;
        for (n, past) in self.past.iter_mut().enumerate() {
            let can_compare = can_compare(world, n);
            match is_off(world, n) {
                false => past.exposed_us = 0,
                true if can_compare => past.exposed_us += promised_us,
                true => {}
            }
            past.incomplete = match is_incomplete(world, n) {
                true => past.incomplete + 1,
                false => 0,
            };
            if self.anew && (past.incomplete > 0 || !measures(world, n)) {
                past.exposed_us = 0;
            }
            if !measures(world, n) {
                continue;
            }
            // What was compared before counts up to here, however many SYNCs there were between.
            let since_us = past.last.map_or(passed_us, |last| at.micros_since(last));
            past.compared_us += since_us.min(MOST_CREDIT_US);
            past.compared += 1;
            past.last = Some(at);
        }
    }
}

/// A node has measured an angle that is wrong, whether it may be used or not: by more than it
/// states as well.
fn is_off(world: &World, n: usize) -> bool {
    let Axes { x, y } = &world.nodes[n].device.values().process.measured;
    [x, y].into_iter().flatten().any(|measured| {
        let stated_deg = COVERAGE * measured.uncertainty.degrees();
        measured.angle.degrees().abs() > stated_deg.max(WRONG_DEG)
    })
}

/// The rules, and what was true so far.
pub struct Rules<'a> {
    pub latch_s: u16,
    pub watch: &'a mut Watch,
    pub broken: &'a mut Vec<String>,
}

impl Rules<'_> {
    /// One frame, held against the rules.
    pub fn hear(&mut self, world: &World, heard: Heard) {
        let Some(id) = heard.frame.cob_id() else {
            return;
        };
        self.attribute(world);
        match heard.by {
            _ if id == 0x80 => self.watch.sync(world, heard.at),
            Some(n) if id == 0x101 + 2 * n as u16 => self.safety_frame(world, n, &heard),
            Some(n) if id == 0x181 + n as u16 => self.slopes(world, n, &heard),
            Some(n) if id == 0x081 + n as u16 => self.fault_told(world, n, &heard),
            _ => {}
        }
    }

    fn rule(&mut self, holds: bool, heard: &Heard, what: &str) {
        if !holds {
            let (id, bytes) = (heard.frame.cob_id(), heard.frame.bytes());
            self.broken
                .push(format!("{what}: {:?} {id:X?} {bytes:X?}", heard.at));
        }
    }

    fn is_wrong(&self, world: &World, n: usize) -> bool {
        is_off(world, n) && self.watch.past[n].exposed_us > REACTION_US
    }

    fn safety_frame(&mut self, world: &World, n: usize, heard: &Heard) {
        let past = self.watch.past[n];
        self.rule(!self.is_wrong(world, n), heard, "a wrong safety frame");
        self.whole(past.incomplete, heard);
        let age_us = past.last.map(|last| heard.at.micros_since(last));
        let checked = age_us.is_some_and(|us| us <= SCT_US + TICK_US);
        self.rule(checked, heard, "a safety frame that was not checked");
        self.rule(
            !past.disagreed,
            heard,
            "a safety frame of two that disagree",
        );
    }

    /// Two that agree have whole exchanges.
    fn whole(&mut self, incomplete: u32, heard: &Heard) {
        let whole = incomplete <= INCOMPLETE_ALLOWED;
        self.rule(whole, heard, "agreement without a whole exchange");
    }

    /// Whoever is told of a fault of the sensor and then reads 6010h finds no angle there, whatever
    /// the state of the node.
    fn fault_told(&mut self, world: &World, n: usize, heard: &Heard) {
        let shown = world.nodes[n].device.shown(world.now);
        let told = |fault: &&Fault| {
            heard
                .frame
                .bytes()
                .starts_with(&fault.report().0.to_le_bytes())
        };
        let absent = [0, 1].iter().all(|axis| shown.own(*axis).is_err());
        let sound = OF_THE_SENSOR.iter().find(told).is_none();
        self.rule(sound || absent, heard, "a fault told of a valid angle");
    }

    /// The difference is attributed to the other channel: stuck, noise, spikes, thermometer, bias,
    /// calibration.
    fn attribute(&mut self, world: &World) {
        for (n, past) in self.watch.past.iter_mut().enumerate() {
            let (blamed, why) = world.nodes[n].device.shown(world.now).blame();
            past.disagreed &= !(blamed == 2 && (9..=14).contains(&why));
        }
    }

    fn slopes(&mut self, world: &World, n: usize, heard: &Heard) {
        let [.., validity, state] = heard.frame.bytes() else {
            return;
        };
        let past = &mut self.watch.past[n];
        past.disagreed |= *state == 6 && self.latch_s == 0;
        if validity & 1 == 0 {
            return;
        }
        let past = *past;
        self.rule(!self.is_wrong(world, n), heard, "a wrong angle");
        if *state == AGREE {
            self.whole(past.incomplete, heard);
        }
        self.rule(!past.disagreed, heard, "a disagreement was forgotten");
        // The SYNC of this very frame has not been compared yet.
        let before = past.compared > u32::from(measures(world, n));
        self.rule(before, heard, "valid without a comparison");
        // The newest pair counts for a while (`device::pair`).
        let [newest, before, first] = self.watch.periods_us;
        let period_us = newest.min(before).max(before.min(first));
        let counts_us = (period_us * 9 / 2).max(400_000) + TICK_US;
        let age_us = past.last.map(|last| heard.at.micros_since(last));
        let proven = age_us.is_some_and(|us| us <= counts_us) || past.compared_us >= 400_000;
        self.rule(proven, heard, "alone without having agreed");
    }
}

/// Both measure, and this one hears the angles of the other one.
fn measures(world: &World, n: usize) -> bool {
    let sound = |node: &Node| {
        let Axes { x, y } = &node.device.values().process.measured;
        node.device.channel().reason().is_none() && x.is_ok() && y.is_ok()
    };
    let mut nodes = world.nodes.iter();
    let measure = nodes.all(|node| node.is_connected() && node.is_operational() && sound(node));
    measure && world.omitted[1 - n] != Some(0)
}

/// They do, neither holds itself faulty, and all that this one needs of the other one arrives.
fn can_compare(world: &World, n: usize) -> bool {
    let mut nodes = world.nodes.iter();
    let faultless = nodes.all(|node| node.device.pair().own_fault().is_none());
    faultless && !is_incomplete(world, n) && measures(world, n)
}

/// A PDO of the other one's exchange does not arrive that this one needs: how far the other one
/// has turned only if it has turned itself.
fn is_incomplete(world: &World, n: usize) -> bool {
    let turned = &world.nodes[n].device.values().process.sent.turned;
    match world.omitted[1 - n] {
        None => false,
        Some(TURN) => turned.angle != NO_VECTOR,
        Some(_) => true,
    }
}
