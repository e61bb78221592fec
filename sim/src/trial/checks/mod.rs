//! The rules that a trial holds the instrument to, applied to what is said on the bus.
//!
//! In: messages with their time, the truth, and what the world does (a fault begins, all is well
//! again). Out: a [`Violation`] for each rule that was broken, once for each time it was.
//!
//! - [`angle`]: an angle marked valid is right, or is wrong for no longer than [`REACTION_S`].
//! - A valid angle states no larger uncertainty than 2007h allows.
//! - [`stale`]: no frame, not even a single one, carries an angle older than that.
//! - [`detection`]: how soon each channel tells of a fault, and whom it blames: never the wrong
//!   one.
//! - [`safety`]: a safety frame carries a right angle, and none is sent of a pair that isn't in
//!   order.
//! - [`alarm`]: without a fault nobody is accused.
//! - [`emergency`]: what is told by EMCY is taken back once, when it has gone.
//! - [`exposure`]: while one node is maintained, the time of [`angle`] is that in which both could
//!   be compared.
//! - [`order`]: when everything is well again, the instrument is in order within
//!   [`Limits::recovery_s`].
//!
//! Left out: everything that isn't on the bus.

pub mod alarm;
pub mod angle;
pub mod detection;
pub mod emergency;
pub mod exposure;
pub mod order;
pub mod safety;
pub mod stale;

use std::collections::VecDeque;
use std::fmt;

use device::factory::PRODUCT_LATENCY_US;

use crate::trial::CHANNELS;
use crate::trial::message::Message;
use stale::Kind;

/// The declared reaction time: a wrong angle may be marked valid for so long, s.
pub const REACTION_S: f64 = 0.5;
/// An angle is right within this, deg.
pub const LIMIT_DEG: f64 = 0.6;
/// Where the stated uncertainty counts, an angle is right within so many of it.
pub const COVERAGE: f64 = 3.0;
/// Within this time after everything is well the product is in order, s.
const RECOVERY_S: f64 = 5.0;
/// SYNCs that are remembered, to recognise the angle of an earlier one.
const SYNCS_KEPT: usize = 32;

/// A rule that can be broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Rule {
    /// A wrong angle was marked valid for longer than the reaction time.
    WrongAngle,
    /// The angle of an earlier SYNC was marked valid for a later one, for as long.
    OldAngle,
    /// An angle older than the reaction time was marked valid, be it once.
    StaleAngle,
    /// A valid angle was less certain than 2007h demands.
    UncertainAngle,
    /// The healthy channel was blamed.
    WrongBlame,
    /// A safety frame of a pair that doesn't agree.
    SafetyFrame,
    /// Somebody was accused without a fault.
    FalseAlarm,
    /// An EMCY without its counterpart.
    UnpairedEmergency,
    /// Everything was well again, and the instrument not in order.
    NotInOrder,
}

impl Rule {
    /// A short name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::WrongAngle => "wrong angle marked valid",
            Self::OldAngle => "old angle marked valid",
            Self::StaleAngle => "stale angle marked valid",
            Self::UncertainAngle => "uncertain angle marked valid",
            Self::WrongBlame => "wrong channel blamed",
            Self::SafetyFrame => "safety frame without consent",
            Self::FalseAlarm => "false alarm",
            Self::UnpairedEmergency => "EMCY without its counterpart",
            Self::NotInOrder => "not in order again",
        }
    }
}

/// One breach of a rule.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// Which rule.
    pub rule: Rule,
    /// When it was broken, s.
    pub at_s: f64,
    /// By which channel, 0 or 1.
    pub channel: usize,
    /// What was seen.
    pub what: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            rule,
            at_s,
            channel,
            what,
        } = self;
        let name = ["A", "B"].get(*channel).unwrap_or(&"?");
        write!(f, "{at_s:.3} s, channel {name}: {}: {what}", rule.name())
    }
}

/// What the instrument is held to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// How long a wrong angle may be marked valid, s.
    pub reaction_s: f64,
    /// Whether only [`Rule::WrongAngle`], [`Rule::OldAngle`], [`Rule::StaleAngle`] and
    /// [`Rule::UncertainAngle`] count: beyond the promise.
    pub angles_only: bool,
    /// Whether one node alone is maintained meanwhile: a wrong angle may be marked valid for
    /// `reaction_s` in which both channels could be compared ([`exposure`]), and whoever is named
    /// or alarmed of what was done on purpose does not count.
    pub maintained: bool,
    /// Whether the bus itself is healthy, so that every EMCY gets through.
    pub sound_bus: bool,
    /// Whether safety frames have been commissioned.
    pub safety: bool,
    /// How soon the instrument is in order after everything is well, s.
    pub recovery_s: f64,
    /// The largest state (2021h) of a pair in order, counted from 1.
    pub order_up_to: u8,
    /// How far a valid angle of a pair in order may be off, deg.
    pub order_deg: f64,
    /// Where the stated uncertainty counts, that of a valid angle at most, deg; an angle may be off
    /// by [`COVERAGE`] of the stated one where that is more.
    pub uncertainty_deg: Option<f64>,
    /// An angle belongs to the instant so long before its SYNC, s.
    pub latency_s: f64,
}

impl Limits {
    /// The product within its promise on a sound bus.
    pub const PRODUCT: Self = Self {
        reaction_s: REACTION_S,
        angles_only: false,
        maintained: false,
        sound_bus: true,
        safety: false,
        recovery_s: RECOVERY_S,
        order_up_to: 1,
        order_deg: LIMIT_DEG,
        uncertainty_deg: None,
        latency_s: 1e-6 * PRODUCT_LATENCY_US as f64,
    };

    /// How far an angle may be off, deg, by the standard uncertainty that its channel states;
    /// `None` where that counts and none is stated.
    fn within_deg(&self, stated_deg: Option<f64>) -> Option<f64> {
        match self.uncertainty_deg {
            Some(_) => stated_deg.map(|u| LIMIT_DEG.max(COVERAGE * u)),
            None => Some(LIMIT_DEG),
        }
    }

    /// What is wrong with the uncertainty that a channel states of a valid angle.
    fn uncertain(&self, at_s: f64, channel: usize, stated_deg: Option<f64>) -> Option<Violation> {
        let (most_deg, stated_deg) = (self.uncertainty_deg?, stated_deg?);
        (stated_deg > most_deg).then(|| Violation {
            rule: Rule::UncertainAngle,
            at_s,
            channel,
            what: format!("{stated_deg:.3} deg are stated, allowed are {most_deg:.3} deg"),
        })
    }
}

/// A fault as the rules see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affected {
    /// The channel that is faulty.
    pub channel: usize,
    /// Since when, s.
    pub from_s: f64,
    /// Whether a channel that blames the other one is wrong; a fault of the bus leaves that open.
    pub blame_counts: bool,
}

/// All rules with what they have seen.
#[derive(Clone, Debug)]
pub struct Checks {
    limits: Limits,
    syncs: VecDeque<f64>,
    /// How far an angle of each channel may be off, deg; `None` until it states that.
    within_deg: [Option<f64>; CHANNELS],
    angles: angle::Angles,
    exposure: exposure::Exposure,
    stale: stale::Stale,
    /// How soon each fault was told, in the order of the faults.
    pub detections: detection::Detections,
    safety: safety::Safety,
    alarms: alarm::Alarms,
    emergencies: emergency::Emergencies,
    order: order::Order,
    /// What was broken, in the order in which that was certain.
    pub violations: Vec<Violation>,
}

impl Checks {
    /// The clock starts at 0 with the instrument starting.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            syncs: VecDeque::new(),
            within_deg: [limits.within_deg(None); CHANNELS],
            angles: angle::Angles::new(limits.reaction_s),
            exposure: exposure::Exposure::default(),
            stale: stale::Stale::new(limits.reaction_s, limits.latency_s),
            detections: detection::Detections::default(),
            safety: safety::Safety::new(limits.reaction_s, limits.latency_s),
            alarms: alarm::Alarms::default(),
            emergencies: emergency::Emergencies::new(limits.sound_bus),
            order: order::Order::starting(&limits),
            violations: Vec::new(),
        }
    }

    /// A fault begins.
    pub fn fault(&mut self, affected: Affected) {
        if affected.blame_counts {
            self.stale.excuse(affected.channel);
        }
        self.detections.begin(affected);
        self.alarms.expect();
        self.order.excuse();
    }

    /// Something is done to one node alone, or to SYNC.
    pub fn maintain(&mut self) {
        (0..super::CHANNELS).for_each(|channel| self.stale.excuse(channel));
        self.alarms.expect();
        self.order.excuse();
    }

    /// A channel is set to show other angles than before: what it shows is judged anew.
    pub fn shown_anew(&mut self) {
        self.angles.begin_anew();
    }

    /// One channel is set to show other angles than the other one, if `apart`; what it has sent by
    /// then has gone out at `until_s`.
    pub fn shown_apart(&mut self, apart: bool, until_s: f64) {
        if apart {
            self.angles.apart_until_s = until_s;
        }
    }

    /// The last fault has ended; what is told of it still counts.
    pub fn healed(&mut self, at_s: f64) {
        self.detections.end(at_s);
    }

    /// Everything is well: from `at_s` on the instrument has [`Limits::recovery_s`] to be in order.
    pub fn well(&mut self, at_s: f64) {
        self.stale.well();
        self.order.demand(at_s);
    }

    /// True while both channels are in order.
    pub fn in_order(&self, at_s: f64) -> bool {
        self.order.is_good(at_s)
    }

    /// The longest time for which a wrong angle was marked valid, in TPDO 1 or safety frames, s.
    pub fn longest_wrong_s(&self) -> f64 {
        self.angles.longest_s.max(self.safety.longest_s())
    }

    /// Angles of earlier SYNCs that were marked valid for a later one so far.
    pub fn old_angles(&self) -> u32 {
        self.angles.old
    }

    /// One message at `at_s`; `ideal` gives the true slopes, deg, for an instant.
    pub fn see(
        &mut self,
        at_s: f64,
        channel: usize,
        message: &Message,
        ideal: impl Fn(f64) -> Option<[f64; 2]>,
    ) {
        let before = self.violations.len();
        let stated_within_deg = self.within_deg[channel];
        let within_deg = stated_within_deg.unwrap_or(LIMIT_DEG);
        match message {
            Message::Sync => self.sync(at_s),
            Message::Slopes(slopes) => {
                let latency_s = self.limits.latency_s;
                let truth = |sync: &f64| ideal(sync - latency_s);
                let newest = self.syncs.front().and_then(truth);
                let older = || self.syncs.iter().skip(1).map_while(truth).collect();
                self.exposure.slopes(at_s, channel);
                let compared_s = if self.limits.maintained {
                    self.exposure.compared_s()
                } else {
                    at_s
                };
                let at = angle::At {
                    at_s,
                    compared_s,
                    within_deg,
                };
                let found = (self.angles).see(at, channel, slopes.deg, newest, older);
                self.violations.extend(found);
                let frame = (channel, Kind::Slopes, stated_within_deg);
                let found = self.stale.see(at_s, frame, slopes.deg, &ideal);
                self.violations.extend(found);
                (self.order).slopes(at_s, (channel, within_deg), slopes.deg, newest);
            }
            Message::Safety(deg) => {
                let found = (self.safety).see(at_s, (channel, within_deg), *deg, &ideal);
                self.violations.extend(found);
                let frame = (channel, Kind::Safety, stated_within_deg);
                let found = self.stale.see(at_s, frame, deg.map(Some), &ideal);
                self.violations.extend(found);
                self.order.safety(at_s, channel);
            }
            Message::Emergency(emergency) => {
                let found = self.emergencies.see(at_s, channel, emergency);
                self.violations.extend(found);
                let found = self.alarms.emergency(at_s, channel, emergency);
                self.violations.extend(found);
            }
            Message::BootUp => {
                self.emergencies.forget(channel);
                self.order.nmt(at_s, channel, 0);
            }
            Message::Heartbeat(state) => self.order.nmt(at_s, channel, *state),
            Message::State(state) => {
                let within_deg = self.limits.within_deg(state.uncertainty_deg);
                self.within_deg[channel] = within_deg;
                self.violations
                    .extend(self.stale.state(channel, within_deg));
                let found = self.limits.uncertain(at_s, channel, state.uncertainty_deg);
                self.violations.extend(found);
            }
            Message::Answer => {}
        }
        if let Some(state) = message.state() {
            self.judge(at_s, channel, state);
        }
        self.pass(at_s);
        self.keep_what_counts(before);
    }

    fn sync(&mut self, at_s: f64) {
        self.exposure.sync(at_s);
        self.syncs.push_front(at_s);
        self.syncs.truncate(SYNCS_KEPT);
    }

    fn judge(&mut self, at_s: f64, channel: usize, state: u8) {
        let found = self.detections.state(at_s, channel, state);
        self.violations.extend(found);
        let found = self.alarms.state(at_s, channel, state);
        self.violations.extend(found);
        self.order.state(at_s, channel, state);
        self.safety.state(at_s, channel, state);
    }

    /// Time passes: deadlines.
    pub fn pass(&mut self, at_s: f64) {
        let before = self.violations.len();
        let found = self.order.pass(at_s);
        self.violations.extend(found);
        if self.order.arrived() {
            self.alarms.forbid();
        }
        self.keep_what_counts(before);
    }

    /// The run is over.
    pub fn end(&mut self, at_s: f64) {
        let before = self.violations.len();
        self.pass(at_s);
        let found = self.emergencies.end(at_s);
        self.violations.extend(found);
        let found = (0..CHANNELS).filter_map(|channel| self.stale.state(channel, None));
        self.violations.extend(found);
        self.keep_what_counts(before);
    }

    fn keep_what_counts(&mut self, from: usize) {
        use Rule::{NotInOrder, OldAngle, SafetyFrame, StaleAngle, UncertainAngle, WrongAngle};
        let Limits {
            angles_only,
            maintained,
            ..
        } = self.limits;
        let counts = |rule| match rule {
            WrongAngle | OldAngle | StaleAngle | UncertainAngle => true,
            NotInOrder | SafetyFrame => !angles_only,
            _ => !angles_only && !maintained,
        };
        let mut index = 0;
        self.violations.retain(|v| {
            index += 1;
            index <= from || counts(v.rule)
        });
    }
}

#[cfg(test)]
mod tests;
