//! An angle marked valid is no older than the reaction time, not even in a single frame.
//!
//! In: the valid slopes of each TPDO 1 and of each safety frame, the truth, and which channel is
//! faulty by itself. Out: a violation when a frame comes out of a silence with a slope that is that
//! of no instant within the reaction time before. A frame that was kept back while the bus was busy
//! and goes out when that ends stands alone, so no rule about the length of a stretch of wrong
//! angles finds it.
//!
//! Where an angle is right within what its channel states, and that is not known yet, the frame
//! waits for it.
//!
//! Left out: frames that follow others closely, since none of them can be so old, and the peak of a
//! shock may be off for one; and a channel that is faulty itself, whose angle may be wrong for the
//! reaction time without being old.

use super::safety::ages_s;
use super::{LIMIT_DEG, Rule, Violation};
use crate::trial::CHANNELS;

/// Time between two looks at the truth, s; what moves passes through all that is between.
const STEP_S: f64 = 0.0125;
/// So long after a silence frames may still be those of before, s.
const AFTER_SILENCE_S: f64 = 0.05;
/// With a longer reaction time nothing is old.
const LONGEST_S: f64 = 0.9;

/// What the rule remembers.
#[derive(Clone, Debug)]
pub struct Stale {
    reaction_s: f64,
    latency_s: f64,
    faulty: [bool; CHANNELS],
    told: [bool; CHANNELS],
    /// What was found before the channel stated how certain its angle is, and how far that is from
    /// the truth, deg.
    waiting: [Option<(Violation, f64)>; CHANNELS],
    /// By channel and kind of frame.
    heard: [[Heard; 2]; CHANNELS],
}

/// Frames of one kind.
#[derive(Clone, Copy, Debug, Default)]
struct Heard {
    last_s: f64,
    /// When the last silence ended.
    since_s: f64,
}

/// A frame that carries angles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// TPDO 1.
    Slopes,
    /// A safety frame.
    Safety,
}

impl Stale {
    /// Nothing heard yet; an angle may be as old as `reaction_s`.
    pub fn new(reaction_s: f64, latency_s: f64) -> Self {
        Self {
            reaction_s,
            latency_s,
            faulty: [false; CHANNELS],
            told: [false; CHANNELS],
            waiting: Default::default(),
            heard: Default::default(),
        }
    }

    /// From now on this channel is faulty itself.
    pub fn excuse(&mut self, channel: usize) {
        self.faulty[channel] = true;
    }

    /// From now on both are well.
    pub fn well(&mut self) {
        self.faulty = [false; CHANNELS];
    }

    /// A frame with its valid slopes; `ideal` gives the true ones, deg, for an instant. They may be
    /// off by `within_deg`, which is `None` until the channel states it.
    pub fn see(
        &mut self,
        at_s: f64,
        (channel, kind, within_deg): (usize, Kind, Option<f64>),
        deg: [Option<f64>; 2],
        ideal: impl Fn(f64) -> Option<[f64; 2]>,
    ) -> Option<Violation> {
        let wakes = self.wakes(at_s, channel, kind);
        let excused = self.faulty[channel] || self.reaction_s > LONGEST_S || !wakes;
        let strays = |axis: usize| {
            let angle = (deg[axis]?, within_deg.unwrap_or(LIMIT_DEG));
            let range = self.range(at_s, angle, |time_s| Some(ideal(time_s)?[axis]))?;
            Some((axis, deg[axis]?, range))
        };
        let found = (0..2).filter(|_| !excused).find_map(strays);
        let told = std::mem::replace(&mut self.told[channel], found.is_some());
        let (axis, deg, (low, high)) = found.filter(|_| !told)?;
        let name = ["X", "Y"][axis];
        let violation = Violation {
            rule: Rule::StaleAngle,
            at_s,
            channel,
            what: format!(
                "slope {name} reads {deg:.2} deg, the truth was {low:.2} to {high:.2} deg in the \
                 last {} s",
                self.reaction_s
            ),
        };
        if within_deg.is_none() {
            self.waiting[channel] = Some((violation, (low - deg).max(deg - high)));
            return None;
        }
        Some(violation)
    }

    /// The channel states within what its angle is right, `None` for nothing: what waited for that.
    pub fn state(&mut self, channel: usize, within_deg: Option<f64>) -> Option<Violation> {
        let (violation, off_deg) = self.waiting[channel].take()?;
        let right = within_deg.is_some_and(|within_deg| off_deg <= within_deg);
        (!right).then_some(violation)
    }

    /// True for a frame that comes out of a silence, or right behind such a one.
    fn wakes(&mut self, at_s: f64, channel: usize, kind: Kind) -> bool {
        let slopes = self.heard[channel][Kind::Slopes as usize];
        let heard = &mut self.heard[channel][kind as usize];
        // What keeps back a safety frame keeps back a TPDO; alone it is silent for want of consent.
        if at_s - heard.last_s.max(slopes.last_s) > self.reaction_s {
            heard.since_s = at_s;
        }
        heard.last_s = at_s;
        at_s - heard.since_s <= AFTER_SILENCE_S
    }

    /// Between what the truth was within the reaction time, if `deg` is none of it.
    fn range(
        &self,
        at_s: f64,
        (deg, within_deg): (f64, f64),
        ideal: impl Fn(f64) -> Option<f64>,
    ) -> Option<(f64, f64)> {
        let (youngest_s, _) = ages_s(self.latency_s);
        let newest_s = at_s - youngest_s;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for step in 0..=(self.reaction_s / STEP_S).round() as u32 {
            let truth = ideal(newest_s - f64::from(step) * STEP_S)?;
            (low, high) = (low.min(truth), high.max(truth));
            if (low - within_deg..=high + within_deg).contains(&deg) {
                return None;
            }
        }
        Some((low, high))
    }
}
