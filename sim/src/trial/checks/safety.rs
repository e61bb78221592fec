//! A safety frame carries a right angle, and none is sent of a pair that isn't in order.
//!
//! In: SRDO 1 of each channel, the truth, and the states that the channels show. Out: a violation
//! when the angles of safety frames are wrong for longer than the reaction time, and when a
//! channel goes on sending while it accuses somebody.
//!
//! A safety frame has no SYNC: its angle is of any instant within its [`ages_s`] before it.
//!
//! Left out: the inverted twins and the cycle time, which are the receiver's to check.

use super::angle::{Angles, At};
use super::{Rule, Violation};
use crate::trial::CHANNELS;

/// A safety frame may be younger than an angle that answers a SYNC by this, s.
const YOUNGER_S: f64 = 0.001;
/// From one refresh of a safety frame to the next, and on the way, s.
const REFRESH_S: f64 = 0.035;
/// Steps in which the truth is looked up.
const STEPS: u32 = 6;
/// States (2021h) that accuse somebody.
const ACCUSING: std::ops::RangeInclusive<u8> = 6..=9;
/// What had been handed to the controller before may still go out, s.
const UNDER_WAY_S: f64 = 0.05;

/// Age of the angle in a safety frame, least and most, s, of an instrument with this latency.
pub fn ages_s(latency_s: f64) -> (f64, f64) {
    (latency_s - YOUNGER_S, latency_s + REFRESH_S)
}

/// What the rule remembers.
#[derive(Clone, Debug)]
pub struct Safety {
    latency_s: f64,
    angles: Angles,
    /// Since when a channel accuses somebody, s.
    accuses: [Option<f64>; CHANNELS],
    told: [bool; CHANNELS],
}

impl Safety {
    /// Nothing heard yet; a wrong angle may be sent for `reaction_s`.
    pub fn new(reaction_s: f64, latency_s: f64) -> Self {
        Self {
            latency_s,
            angles: Angles::new(reaction_s),
            accuses: [None; CHANNELS],
            told: [false; CHANNELS],
        }
    }

    /// The longest stretch of wrong angles so far, s.
    pub fn longest_s(&self) -> f64 {
        self.angles.longest_s
    }

    /// A channel shows a state.
    pub fn state(&mut self, at_s: f64, channel: usize, state: u8) {
        if ACCUSING.contains(&state) {
            self.accuses[channel].get_or_insert(at_s);
        } else {
            self.accuses[channel] = None;
            self.told[channel] = false;
        }
    }

    /// A channel sends a safety frame; `ideal` gives the true slopes, deg, for an instant.
    pub fn see(
        &mut self,
        at_s: f64,
        (channel, within_deg): (usize, f64),
        deg: [f64; 2],
        ideal: impl Fn(f64) -> Option<[f64; 2]>,
    ) -> Vec<Violation> {
        let ages_s = ages_s(self.latency_s);
        let nearest = nearest(at_s, ages_s, deg, ideal);
        let valid = deg.map(Some);
        let at = At {
            at_s,
            compared_s: at_s,
            within_deg,
        };
        let mut found = (self.angles).see(at, channel, valid, nearest, Vec::new);
        let late = self.accuses[channel].is_some_and(|since| at_s - since > UNDER_WAY_S);
        if late && !std::mem::replace(&mut self.told[channel], true) {
            found.push(Violation {
                rule: Rule::SafetyFrame,
                at_s,
                channel,
                what: "sent while the channel accuses somebody".into(),
            });
        }
        found
    }
}

/// Of all true slopes that a frame may mean, those next to what it carries.
fn nearest(
    at_s: f64,
    (youngest, oldest): (f64, f64),
    deg: [f64; 2],
    ideal: impl Fn(f64) -> Option<[f64; 2]>,
) -> Option<[f64; 2]> {
    let step_s = (oldest - youngest) / f64::from(STEPS);
    let mut range: Option<[(f64, f64); 2]> = None;
    for step in 0..=STEPS {
        let truth = ideal(at_s - youngest - f64::from(step) * step_s)?;
        let so_far = range.get_or_insert(truth.map(|t| (t, t)));
        for ((low, high), t) in so_far.iter_mut().zip(truth) {
            (*low, *high) = (low.min(t), high.max(t));
        }
    }
    range.map(|range| [0, 1].map(|axis| deg[axis].clamp(range[axis].0, range[axis].1)))
}
