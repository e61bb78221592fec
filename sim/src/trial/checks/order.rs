//! When everything is well, the instrument is in order within [`Limits::recovery_s`].
//!
//! In: NMT states, states of the pair and slopes as they are told, and the instant from which all
//! is well. Out: a violation per channel that isn't in order in time. In order is a channel that
//! is OPERATIONAL, shows an agreeing pair, and sends both angles, marked valid and right, and
//! safety frames where they have been commissioned.

use super::{Limits, Rule, Violation};
use crate::trial::CHANNELS;
use crate::trial::message::OPERATIONAL;

/// What was told longer ago than this doesn't count, s.
const FRESH_S: f64 = 1.0;

/// Something told, and when.
#[derive(Clone, Copy, Debug)]
struct Told<T> {
    at_s: f64,
    what: T,
}

/// What one channel has told last.
#[derive(Clone, Copy, Debug, Default)]
struct Channel {
    nmt: Option<Told<u8>>,
    state: Option<Told<u8>>,
    /// Both angles, valid and right.
    right: Option<Told<bool>>,
    /// A safety frame.
    safety: Option<Told<()>>,
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Demand {
    /// Nothing: something is wrong on purpose.
    Excused,
    /// To be in order by this time, s.
    By(f64),
    /// It has been in order since it was asked to.
    Arrived,
    /// It was too late, which is told.
    Missed,
}

/// What the rule remembers.
#[derive(Clone, Debug)]
pub struct Order {
    recovery_s: f64,
    up_to: u8,
    safety: bool,
    within_deg: f64,
    channels: [Channel; CHANNELS],
    demand: Demand,
}

fn fresh<T: Copy>(told: Option<Told<T>>, now_s: f64) -> Option<T> {
    told.filter(|t| now_s - t.at_s <= FRESH_S).map(|t| t.what)
}

impl Order {
    /// An instrument that starts at 0.
    pub fn starting(limits: &Limits) -> Self {
        Self {
            recovery_s: limits.recovery_s,
            up_to: limits.order_up_to,
            safety: limits.safety,
            within_deg: limits.order_deg,
            channels: Default::default(),
            demand: Demand::By(limits.recovery_s),
        }
    }

    /// A channel's NMT state; 0 when it boots.
    pub fn nmt(&mut self, at_s: f64, channel: usize, state: u8) {
        self.channels[channel].nmt = Some(Told { at_s, what: state });
    }

    /// A channel's state of the pair.
    pub fn state(&mut self, at_s: f64, channel: usize, state: u8) {
        self.channels[channel].state = Some(Told { at_s, what: state });
    }

    /// A channel's slopes and the true ones.
    pub fn slopes(
        &mut self,
        at_s: f64,
        (channel, within_deg): (usize, f64),
        deg: [Option<f64>; 2],
        truth: Option<[f64; 2]>,
    ) {
        let within_deg = self.within_deg.max(within_deg);
        let near =
            |deg: Option<f64>, truth: f64| deg.is_some_and(|deg| (deg - truth).abs() <= within_deg);
        let right = truth.is_some_and(|[x, y]| near(deg[0], x) && near(deg[1], y));
        self.channels[channel].right = Some(Told { at_s, what: right });
    }

    /// A channel sends a safety frame.
    pub fn safety(&mut self, at_s: f64, channel: usize) {
        self.channels[channel].safety = Some(Told { at_s, what: () });
    }

    /// What is missing at one channel; `None` when it is in order.
    fn missing(&self, channel: usize, now_s: f64) -> Option<String> {
        let channel = &self.channels[channel];
        let nmt = fresh(channel.nmt, now_s);
        let state = fresh(channel.state, now_s);
        let right = fresh(channel.right, now_s);
        if nmt != Some(OPERATIONAL) {
            return Some(format!("NMT state {nmt:?}"));
        }
        if !state.is_some_and(|s| (1..=self.up_to).contains(&s)) {
            return Some(format!("state {state:?}"));
        }
        if self.safety && fresh(channel.safety, now_s).is_none() {
            return Some("no safety frames".into());
        }
        match right {
            Some(true) => None,
            Some(false) => Some("an angle that is not valid or not right".into()),
            None => Some("no angles".into()),
        }
    }

    /// True while both channels are in order.
    pub fn is_good(&self, now_s: f64) -> bool {
        (0..CHANNELS).all(|channel| self.missing(channel, now_s).is_none())
    }

    /// Something is wrong on purpose.
    pub fn excuse(&mut self) {
        self.demand = Demand::Excused;
    }

    /// Everything is well from `at_s` on.
    pub fn demand(&mut self, at_s: f64) {
        self.demand = Demand::By(at_s + self.recovery_s);
    }

    /// It was asked to be in order and has been since.
    pub fn arrived(&self) -> bool {
        self.demand == Demand::Arrived
    }

    /// Time passes.
    pub fn pass(&mut self, now_s: f64) -> Vec<Violation> {
        let Demand::By(by_s) = self.demand else {
            return Vec::new();
        };
        if self.is_good(now_s) {
            self.demand = Demand::Arrived;
            return Vec::new();
        }
        if now_s <= by_s {
            return Vec::new();
        }
        self.demand = Demand::Missed;
        let late = |channel: usize| {
            Some(Violation {
                rule: Rule::NotInOrder,
                at_s: now_s,
                channel,
                what: self.missing(channel, now_s)?,
            })
        };
        (0..CHANNELS).filter_map(late).collect()
    }
}
