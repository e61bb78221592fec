//! What somebody on the bus makes of the two channels: accusations, warnings, and a plain
//! comparison of the angles.
//!
//! In: events of the bus with their times. Out: [`Outcome`]. Everything is read from frames that
//! were delivered; nobody looks into a device. The paper's rule is run here, by the product's own
//! code, on the angles that the nodes exchange: the paper's excavator watches the pitch alone
//! (section VII), because a table that ignores z makes no sense of the other axis (E7).
//!
//! Left out: EMCY beyond the state of the pair that it carries.

use device::exchange::{self, Exchange};
use instant::Instant;
use sim::can_bus::Event;
use sim::trial::CHANNELS;
use sim::trial::message::Message;
use tilt::angle::Axes;
use tilt::chain::{Invalid, Reading};
use tilt::cross_check::{Judgement, PaperCheck, PaperState};

/// A plain comparison warns above this, in 2^-24 of a circle: 0.40 deg.
const PLAIN_LIMIT: i32 = (0.40 / 360.0 * (1 << 24) as f64) as i32;
/// Identifiers of the exchange's angles (TPDO 3), channel A and B.
const ANGLES: [u16; CHANNELS] = [0x381, 0x382];
/// Quality bytes from this on stand for an angle.
const FIRST_ANGLE: u8 = 32;
/// The bus is dead to a receiver when neither channel has said anything for this long, ns.
const DEAD_NS: u64 = 100_000_000;
/// How long SYNCs are counted before and after the fault's beginning, ns.
const COUNTED_NS: u64 = 5_000_000_000;
/// A plain excess ends when there was none for this long, ns.
const EXCESS_OVER_NS: u64 = 1_000_000_000;

/// 2021h: the channels disagree.
const DISAGREE: u8 = 6;
/// 2021h: this channel is faulty.
const OWN: u8 = 7;
/// 2021h: the other channel is faulty.
const PEER: u8 = 8;
/// 2021h: neither measures.
const NONE: u8 = 9;

/// What a plain look at every SYNC came to: more than 0.40 deg, or an angle that is missing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pairs {
    /// SYNCs.
    pub syncs: u32,
    /// Those with a reason to warn.
    pub warned: u32,
}

/// What came of one run. Times are from the fault's beginning, s.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// The first accusation: states 6 to 9, or a bus on which neither channel sends anything.
    pub told_s: Option<f64>,
    /// A channel was named first.
    pub named_s: Option<f64>,
    /// The healthy channel was named, first or later, by either channel.
    pub wrong: bool,
    /// The first difference of two angles of one SYNC above 0.40 deg.
    pub plain_s: Option<f64>,
    /// SYNCs in the time before the fault, and of those how many the paper's rule warns at.
    pub healthy: Pairs,
    /// The same after the fault's beginning.
    pub faulty: Pairs,
    /// Paper mode: the motion has to stop.
    pub stop_s: Option<f64>,
    /// Somebody was accused before the fault.
    pub before: bool,
    /// Paper mode: it had asked for a stop before the fault.
    pub stopped_before: bool,
    /// Times that the pair was accused anew.
    pub alarms: u32,
    /// Times that the plain difference was exceeded anew.
    pub excesses: u32,
    /// Paper mode: readings with a warning.
    pub warnings: u32,
    /// Paper mode: stops that were asked for.
    pub stops: u32,
    /// Paper mode: physical faults.
    pub physical: u32,
    /// Virtual time, s.
    pub duration_s: f64,
    /// Of the bus.
    pub fingerprint: u64,
}

/// The paper's rule: the pitch alone.
const RULE: PaperCheck = PaperCheck {
    watch: Axes { x: false, y: true },
    ..PaperCheck::PAPER
};

/// What a TPDO 3 tells of slope X and Y.
#[derive(Clone, Copy, Debug)]
struct Told {
    /// 2^-24 of a circle.
    angle: [i32; 2],
    quality: [u8; 2],
}

/// Somebody who listens.
#[derive(Clone, Debug)]
pub struct Observer {
    /// When the fault begins; beyond the end for a run without.
    from_ns: u64,
    /// Which channel will be faulty.
    faulty: usize,
    /// The last state that each channel has shown.
    states: [u8; CHANNELS],
    /// Both channels have agreed once.
    started: bool,
    /// The pair stands accused.
    accused: bool,
    /// The angles of this SYNC, where they have come.
    angles: [Option<Told>; CHANNELS],
    /// The paper's rule, where it is to be followed, and what it said last.
    rule: Option<Box<PaperState>>,
    judgement: Option<Judgement>,
    excess_ns: Option<u64>,
    heard_ns: u64,
    /// What came of it so far.
    pub outcome: Outcome,
}

impl Observer {
    /// Listens from time 0; channel `faulty` is so from `from_ns` on; `paper`: follows the rule.
    pub fn new(from_ns: u64, faulty: usize, paper: bool) -> Self {
        Self {
            from_ns,
            faulty,
            states: [0; CHANNELS],
            started: false,
            accused: false,
            angles: [None; CHANNELS],
            rule: paper.then(Box::default),
            judgement: None,
            excess_ns: None,
            heard_ns: 0,
            outcome: Outcome::default(),
        }
    }

    /// True while paper mode asks for standstill.
    pub fn asks_to_stop(&self) -> bool {
        self.judgement == Some(Judgement::StopMotion)
    }

    /// One event.
    pub fn hear(&mut self, event: &Event, told: Option<(usize, Message)>) {
        let Event::Delivered { frame, at_ns, .. } = event else {
            return;
        };
        if let Some((_, Message::Sync)) = told {
            self.close(*at_ns);
            return;
        }
        let id = frame.cob_id();
        if let Some(channel) = ANGLES.iter().position(|angles| Some(*angles) == id) {
            self.heard_ns = *at_ns;
            self.angles[channel] = told_by(frame.bytes());
            self.compare(*at_ns);
        }
        let Some((channel, message)) = told else {
            return;
        };
        self.heard_ns = *at_ns;
        if let Some(state) = message.state() {
            self.judged(channel, state, *at_ns);
        }
    }

    /// Time passes.
    pub fn pass(&mut self, now_ns: u64) {
        if now_ns >= self.from_ns && now_ns >= self.heard_ns + DEAD_NS {
            let since = self.since(now_ns);
            self.outcome.told_s = self.outcome.told_s.or(since);
        }
    }

    /// Time since the fault's beginning, s; `None` before.
    fn since(&self, at_ns: u64) -> Option<f64> {
        let since_ns = at_ns.checked_sub(self.from_ns)?;
        Some(since_ns as f64 * 1e-9)
    }

    fn judged(&mut self, channel: usize, state: u8, at_ns: u64) {
        self.states[channel] = state;
        self.started |= self.states == [1; CHANNELS];
        let since = self.since(at_ns);
        let outcome = &mut self.outcome;
        let accuses = |state: &u8| (DISAGREE..=NONE).contains(state);
        let accused = self.started && self.states.iter().any(accuses);
        if accused && !self.accused {
            outcome.alarms += 1;
            outcome.before |= since.is_none();
        }
        self.accused = accused;
        let Some(since) = since else {
            return;
        };
        if accuses(&state) {
            outcome.told_s.get_or_insert(since);
        }
        if matches!(state, OWN | PEER) {
            outcome.named_s.get_or_insert(since);
            outcome.wrong |= (state == OWN) != (channel == self.faulty);
        }
    }

    /// The paper's rule on the angles of one SYNC.
    fn follow_rule(&mut self, told: [Option<Told>; CHANNELS], at_ns: u64) {
        let since = self.since(at_ns);
        let Some(rule) = &mut self.rule else {
            return;
        };
        let at = Instant(at_ns / 1000);
        // What has never been heard may still be starting; the rule begins with the first pair.
        if self.judgement.is_none() && told.iter().any(Option::is_none) {
            return;
        }
        let [a, b] = told.map(|told| reading(told, at));
        let now = RULE.step(rule, a, b, at).judgement();
        let before = self.judgement.replace(now);
        let outcome = &mut self.outcome;
        let entered = |judgement| u32::from(now == judgement && before != Some(judgement));
        outcome.stops += entered(Judgement::StopMotion);
        outcome.physical += entered(Judgement::PhysicalFault);
        outcome.warnings += u32::from(now == Judgement::Warning);
        let stops = matches!(now, Judgement::StopMotion | Judgement::PhysicalFault);
        match since {
            None => outcome.stopped_before |= stops,
            Some(since) if stops => outcome.stop_s = outcome.stop_s.or(Some(since)),
            Some(_) => {}
        }
    }

    /// A SYNC ends the time in which the angles of the one before can come.
    fn close(&mut self, at_ns: u64) {
        let told = std::mem::take(&mut self.angles);
        self.follow_rule(told, at_ns);
        let warned = match told {
            [Some(a), Some(b)] => a.exceeds(b, 1).unwrap_or(true),
            _ => true,
        };
        if at_ns.abs_diff(self.from_ns) > COUNTED_NS {
            return;
        }
        let pairs = if at_ns < self.from_ns {
            &mut self.outcome.healthy
        } else {
            &mut self.outcome.faulty
        };
        pairs.syncs += 1;
        pairs.warned += u32::from(warned);
    }

    /// A plain comparison, once both have told their angles of one SYNC.
    fn compare(&mut self, at_ns: u64) {
        let [Some(a), Some(b)] = self.angles else {
            return;
        };
        let exceeds = |axis| a.exceeds(b, axis) == Some(true);
        if !self.started || !(0..2).any(exceeds) {
            return;
        }
        let since = self.since(at_ns);
        self.outcome.plain_s = self.outcome.plain_s.or(since);
        let last_ns = self.excess_ns.replace(at_ns);
        if last_ns.is_none_or(|last| at_ns > last + EXCESS_OVER_NS) {
            self.outcome.excesses += 1;
        }
    }
}

impl Told {
    /// Whether the angles of an axis, 0 or 1, differ by too much; `None` when one is missing.
    fn exceeds(self, other: Self, axis: usize) -> Option<bool> {
        let there = |told: Self| told.quality[axis] >= FIRST_ANGLE;
        // Of 24 bits: the difference wraps as angles do.
        let difference = self.angle[axis].wrapping_sub(other.angle[axis]) << 8 >> 8;
        (there(self) && there(other)).then_some(difference.abs() > PLAIN_LIMIT)
    }
}

/// What a TPDO 3 tells.
fn told_by(bytes: &[u8]) -> Option<Told> {
    let [x0, x1, x2, y0, y1, y2, quality_x, quality_y] = *bytes else {
        return None;
    };
    Some(Told {
        angle: [[0, x0, x1, x2], [0, y0, y1, y2]].map(|bytes| i32::from_le_bytes(bytes) >> 8),
        quality: [quality_x, quality_y],
    })
}

/// A channel's reading as the paper's rule takes it.
fn reading(told: Option<Told>, at: Instant) -> Reading {
    let Some(Told { angle, quality }) = told else {
        return Axes {
            x: Err(Invalid::Silent),
            y: Err(Invalid::Silent),
        };
    };
    let told = Exchange {
        angle,
        quality,
        ..Exchange::NOTHING
    };
    exchange::decode_reading(&told, at, 0)
}
