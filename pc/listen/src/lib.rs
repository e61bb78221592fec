//! What the frames of a bus report of the instruments on it: the one reading of them that
//! monitor, replay and report share.
//!
//! In: a [`Plan`] of which nodes make a pair and what their PDOs carry, then frames with their
//! time. Out: with each frame its [`Meaning`], and in [`Watch`] the last of everything. Angles are
//! in 0.001 deg whatever resolution the bus has. The difference of a pair is formed anew here, of
//! the two angles of one SYNC, beside what the nodes report of themselves.
//!
//! Left out: where frames come from (`bus-master`, `bus-logs`), and what is done with what they
//! report.

mod checks;
mod decode;
pub mod eds;
mod exchange;
mod messages;
mod options;
mod pair;
mod plan;
mod round;
mod side;
mod supervision;
#[cfg(test)]
mod tests;
mod unit;
#[cfg(test)]
mod unit_tests;

pub use checks::{Check, Checks};
pub use exchange::{Activity, Measured};
pub use messages::{Emergency, Part};
pub use options::{PlanError, PlanOptions, Unnamed};
pub use pair::{Delta, Pair};
pub use plan::{NodePlan, PdoPlan, Plan, What};
pub use round::Round;
pub use side::{Beat, Detail, Now, SAME_START_NS, Side, Slopes};
pub use supervision::Heartbeat;

use canopen::Frame;
use serde::{Deserialize, Serialize};
use side::Kind;

/// Which channel a piece of news is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The instrument, by its place in the plan.
    pub pair: u16,
    /// 0 is channel A, 1 is channel B.
    pub side: u8,
}

/// What a frame has told. The values are in the [`Watch`] by then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Meaning {
    /// TPDO 1: slopes, validity and state. With `Some`, the pair is complete for this SYNC.
    Slopes(Place, Option<Delta>),
    /// TPDO 2: uncertainty, latency, difference, temperature.
    Detail(Place),
    /// TPDO 3 or 4: what the channels tell each other, with the part of it that has come.
    Exchange(Place, Part),
    /// TPDO 5: slopes of the SYNC itself, of an instrument with a gyroscope.
    Angle(Place),
    /// TPDO 6: rates of turn, of an instrument with a gyroscope.
    Rates(Place),
    /// TPDO 7: how far it has turned, for the other channel of an instrument with a gyroscope.
    Turned(Place),
    /// A fault has come or gone.
    Emergency(Place, Emergency),
    /// A heartbeat or boot-up message.
    Heartbeat(Place, Beat),
    /// SYNC.
    Sync,
    /// A frame of the instrument that does not have the form which the plan has.
    Malformed(Place),
    /// Any other frame: of other nodes, SDO, LSS, NMT, 29-bit, remote.
    Other,
}

/// How many frames of what were seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// All frames.
    pub frames: u64,
    /// SYNCs.
    pub syncs: u64,
    /// Frames of the instruments with a length that the plan does not have.
    pub malformed: u64,
    /// Frames of nodes that are not in the plan, and of no node: all that follow together.
    pub others: u64,
    /// Of them NMT commands.
    pub nmt: u64,
    /// SDO, of any node.
    pub sdo: u64,
    /// LSS, TIME, SRDO and GFC.
    pub services: u64,
    /// Of nodes of the plan, and not in their plan.
    pub unplanned: u64,
    /// Of nodes that are not in the plan.
    pub strangers: u64,
    /// With 29-bit identifiers.
    pub extended: u64,
    /// Remote frames.
    pub remote: u64,
    /// Frames that are older than one before them.
    pub backwards: u64,
}

/// What an identifier stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    /// Nothing of the plan.
    Other,
    /// A SYNC that at least one pair obeys.
    Sync,
    /// A PDO: place and number in the node's plan.
    Pdo(Place, u8),
    /// An EMCY.
    Emergency(Place),
    /// A heartbeat.
    Heartbeat(Place),
}

/// No frame for longer than this is a gap, ns. Of the whole bus it is a hole in the log rather than
/// lost heartbeats.
pub const GAP_NS: u64 = 2_000_000_000;

/// Nobody supervises anything.
const NEVER: u64 = u64::MAX;

/// All that is known of the instruments.
#[derive(Clone, Debug)]
pub struct Watch {
    pairs: Vec<Pair>,
    counts: Counts,
    targets: Box<[Target; 2048]>,
    /// Node-ids of the plan, and those besides that have sent a PDO, EMCY or heartbeat, as sets.
    known: u128,
    strangers: u128,
    last_ns: u64,
    /// How far time had come when it went back, until it is there again.
    ahead_ns: u64,
    /// The first heartbeat that may be lost by now; not later than the true one.
    deadline_ns: u64,
}

impl Watch {
    /// Nothing seen yet.
    pub fn new(plan: &Plan) -> Self {
        let mut watch = Self {
            pairs: Vec::with_capacity(plan.pairs.len()),
            counts: Counts::default(),
            targets: Box::new([Target::Other; 2048]),
            known: 0,
            strangers: 0,
            last_ns: 0,
            ahead_ns: NEVER,
            deadline_ns: NEVER,
        };
        for (pair, ids) in (0..).zip(&plan.pairs) {
            let nodes = ids.map(|id| plan.node(id));
            for (side, node) in (0..).zip(&nodes) {
                watch.expect(node, Place { pair, side });
            }
            watch.pairs.push(Pair::new(nodes.map(Side::new)));
        }
        watch
    }

    /// Enters the identifiers of a node.
    fn expect(&mut self, node: &NodePlan, place: Place) {
        let id = u16::from(node.node_id);
        self.known |= 1 << (id & 0x7F);
        let mut enter = |cob_id: u16, target| {
            if let Some(entry) = self.targets.get_mut(usize::from(cob_id)) {
                *entry = target;
            }
        };
        enter(node.sync, Target::Sync);
        enter(node.emcy, Target::Emergency(place));
        enter(0x700 + id, Target::Heartbeat(place));
        for (number, pdo) in (0..8).zip(&node.pdos) {
            enter(pdo.cob_id, Target::Pdo(place, number));
        }
    }

    /// The instruments, in the order of the plan.
    pub fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    /// What was counted.
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Node-ids that are not in the plan and have sent a PDO, an EMCY or a heartbeat.
    pub fn strangers(&self) -> impl Iterator<Item = u8> {
        let set = self.strangers;
        (1..128).filter(move |id| set & (1 << id) != 0)
    }

    /// Takes a frame that was seen at this time, in ns since whatever the source counts from.
    #[inline]
    pub fn take(&mut self, time_ns: u64, frame: &Frame) -> Meaning {
        self.counts.frames += 1;
        self.keep_time(time_ns);
        let news = self.read(time_ns, frame);
        match news {
            Meaning::Sync => self.counts.syncs += 1,
            Meaning::Malformed(_) => self.counts.malformed += 1,
            Meaning::Other => self.counts.others += 1,
            _ => {}
        }
        news
    }

    #[inline]
    fn keep_time(&mut self, time_ns: u64) {
        let since_ns = time_ns.wrapping_sub(self.last_ns);
        let is_jump = since_ns > GAP_NS && self.last_ns > 0;
        if is_jump || time_ns >= self.ahead_ns {
            self.jump(time_ns);
        }
        self.last_ns = time_ns;
        self.pass(time_ns);
    }

    /// Time has gone on without a frame, as seen by who listens to a bus while it lives.
    #[inline]
    pub fn pass(&mut self, now_ns: u64) {
        if now_ns > self.deadline_ns {
            self.sweep(now_ns);
        }
    }

    /// Time has gone on without a frame, or has gone back, or has caught up after that.
    #[cold]
    fn jump(&mut self, time_ns: u64) {
        if time_ns < self.last_ns {
            self.counts.backwards += 1;
            if self.ahead_ns == NEVER {
                self.ahead_ns = self.last_ns;
            }
        }
        if time_ns >= self.ahead_ns {
            self.ahead_ns = NEVER;
        }
        self.pairs.iter_mut().for_each(|pair| pair.excuse(time_ns));
        self.deadline_ns = 0;
    }

    /// Finds lost heartbeats, and when the next one may be lost.
    #[cold]
    fn sweep(&mut self, now_ns: u64) {
        self.deadline_ns = NEVER;
        for side in self.pairs.iter_mut().flat_map(|pair| &mut pair.sides) {
            match side.heartbeat.deadline_ns() {
                Some(deadline_ns) if now_ns > deadline_ns => side.heartbeat.lose(),
                Some(deadline_ns) => self.deadline_ns = self.deadline_ns.min(deadline_ns),
                None => {}
            }
        }
    }

    #[inline]
    fn read(&mut self, time_ns: u64, frame: &Frame) -> Meaning {
        let Some(cob_id) = frame.cob_id() else {
            self.counts.extended += 1;
            return Meaning::Other;
        };
        if frame.is_remote() {
            self.counts.remote += 1;
            return Meaning::Other;
        }
        match self.targets.get(usize::from(cob_id)) {
            Some(Target::Sync) => {
                let obeys = |pair: &&mut Pair| pair.sides.iter().any(|s| s.plan.sync == cob_id);
                let pairs = self.pairs.iter_mut().filter(obeys);
                pairs.for_each(|pair| pair.sync(time_ns));
                Meaning::Sync
            }
            Some(Target::Pdo(place, number)) => self.pdo(time_ns, *place, *number, frame),
            Some(Target::Emergency(place)) => self.emergency(time_ns, *place, frame),
            Some(Target::Heartbeat(place)) => self.heartbeat(time_ns, *place, frame),
            Some(Target::Other) | None => self.other(cob_id),
        }
    }

    #[inline]
    fn pdo(&mut self, time_ns: u64, at: Place, number: u8, frame: &Frame) -> Meaning {
        let Some(pair) = self.pairs.get_mut(usize::from(at.pair)) else {
            return Meaning::Other;
        };
        let Some(side) = pair.sides.get_mut(usize::from(at.side)) else {
            return Meaning::Other;
        };
        side.seen_ns = Some(time_ns);
        let Some(plan) = side.plan.pdos.get(usize::from(number)) else {
            return Meaning::Other;
        };
        if frame.length() != usize::from(plan.length) {
            side.checks.add(Check::Length, time_ns);
            return Meaning::Malformed(at);
        }
        let values = decode::decode(plan, frame.padded(), side.plan.resolution_mdeg);
        side.arrived(number, plan.every, time_ns);
        match side.take(time_ns, usize::from(number), &values) {
            Kind::Slopes => Meaning::Slopes(at, pair.slopes(usize::from(at.side), time_ns)),
            Kind::Detail => {
                pair.detail(usize::from(at.side), time_ns);
                Meaning::Detail(at)
            }
            Kind::Exchange(part) => {
                if part.has_angles() {
                    pair.exchange(usize::from(at.side), time_ns);
                }
                Meaning::Exchange(at, part)
            }
            Kind::Angle => Meaning::Angle(at),
            Kind::Rates => Meaning::Rates(at),
            Kind::Turned => Meaning::Turned(at),
            Kind::Other => {
                self.counts.unplanned += 1;
                Meaning::Other
            }
        }
    }

    fn side(&mut self, at: Place) -> Option<&mut Side> {
        let pair = self.pairs.get_mut(usize::from(at.pair))?;
        pair.sides.get_mut(usize::from(at.side))
    }

    fn emergency(&mut self, time_ns: u64, at: Place, frame: &Frame) -> Meaning {
        let Some(side) = self.side(at) else {
            return Meaning::Other;
        };
        side.seen_ns = Some(time_ns);
        match side.emergency(time_ns, frame.bytes()) {
            Some(emergency) => Meaning::Emergency(at, emergency),
            None => {
                side.checks.add(Check::Length, time_ns);
                Meaning::Malformed(at)
            }
        }
    }

    fn heartbeat(&mut self, time_ns: u64, at: Place, frame: &Frame) -> Meaning {
        let Some(side) = self.side(at) else {
            return Meaning::Other;
        };
        side.seen_ns = Some(time_ns);
        let beat = side.heartbeat(time_ns, frame.bytes());
        if beat.is_none() && frame.length() != 1 {
            side.checks.add(Check::Length, time_ns);
        }
        let deadline_ns = side.heartbeat.deadline_ns();
        self.deadline_ns = self.deadline_ns.min(deadline_ns.unwrap_or(NEVER));
        beat.map_or(Meaning::Malformed(at), |beat| Meaning::Heartbeat(at, beat))
    }

    /// A frame that the plan does not have.
    #[cold]
    fn other(&mut self, cob_id: u16) -> Meaning {
        let node = 1_u128 << (cob_id & 0x7F);
        let counts = &mut self.counts;
        match cob_id {
            0x000 => counts.nmt += 1,
            0x001..=0x07F | 0x100..=0x180 | 0x7E4 | 0x7E5 => counts.services += 1,
            0x581..=0x5FF | 0x601..=0x67F => counts.sdo += 1,
            0x081..=0x0FF | 0x181..=0x57F | 0x701..=0x77F => {
                if self.known & node != 0 {
                    counts.unplanned += 1;
                } else {
                    counts.strangers += 1;
                    self.strangers |= node;
                }
            }
            _ => counts.strangers += 1,
        }
        Meaning::Other
    }
}
