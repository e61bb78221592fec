//! A wrong angle isn't marked valid for longer than the reaction time.
//!
//! In: the slopes of each TPDO 1 and the truth for the newest SYNCs. Out: a violation when every
//! valid slope of an axis has been wrong for too long. A slope that is right, or not marked valid,
//! ends that; so does a silence, since the receiver's own time-out acts then.

use super::{Rule, Violation};
use crate::trial::CHANNELS;

/// An angle this close to the truth of an earlier SYNC is taken for that SYNC's, deg.
const FITS_DEG: f64 = 0.15;
/// After so long without a TPDO 1 a receiver holds the channel for silent, s.
const SILENT_S: f64 = 0.5;

/// For so long one node alone may be set to show another angle, s: a tool sets one after the other
/// (docs/safety.md), and four bytes have to come twice.
const APART_S: f64 = 2.7;

/// A stretch of wrong angles.
#[derive(Clone, Copy, Debug)]
struct Wrong {
    since_s: f64,
    /// All of them fitted an earlier SYNC.
    old: bool,
    told: bool,
}

/// When a frame was heard.
#[derive(Clone, Copy, Debug)]
pub struct At {
    /// By the world's clock, s.
    pub at_s: f64,
    /// By the clock that the reaction time is counted with, s.
    pub compared_s: f64,
    /// How far its angles may be off, deg.
    pub within_deg: f64,
}

/// What the rule remembers.
#[derive(Clone, Debug)]
pub struct Angles {
    reaction_s: f64,
    /// Until when one channel is set to show other angles than the other one, s.
    pub apart_until_s: f64,
    wrong: [[Option<Wrong>; 2]; CHANNELS],
    heard_s: [f64; CHANNELS],
    /// Angles that were wrong for the newest SYNC and right for an earlier one.
    pub old: u32,
    /// The longest stretch of wrong angles so far, s.
    pub longest_s: f64,
}

impl Angles {
    /// Nothing heard yet; a wrong angle may be valid for `reaction_s`.
    pub fn new(reaction_s: f64) -> Self {
        Self {
            reaction_s,
            apart_until_s: 0.0,
            wrong: [[None; 2]; CHANNELS],
            heard_s: [0.0; CHANNELS],
            old: 0,
            longest_s: 0.0,
        }
    }

    /// What was wrong so far counts no longer.
    pub fn begin_anew(&mut self) {
        self.wrong = [[None; 2]; CHANNELS];
    }

    /// A TPDO 1: its valid slopes, the true ones for the newest SYNC, and those for the SYNCs
    /// before, the newest first.
    pub fn see(
        &mut self,
        At {
            at_s,
            compared_s,
            within_deg,
        }: At,
        channel: usize,
        deg: [Option<f64>; 2],
        newest: Option<[f64; 2]>,
        older: impl Fn() -> Vec<[f64; 2]>,
    ) -> Vec<Violation> {
        if at_s - self.heard_s[channel] > SILENT_S {
            self.wrong[channel] = [None; 2];
        }
        self.heard_s[channel] = at_s;
        let mut found = Vec::new();
        for axis in 0..2 {
            let (Some(deg), Some(newest)) = (deg[axis], newest.map(|n| n[axis])) else {
                self.wrong[channel][axis] = None;
                continue;
            };
            if (deg - newest).abs() <= within_deg {
                self.wrong[channel][axis] = None;
                continue;
            }
            let old = older()
                .iter()
                .any(|truth| (deg - truth[axis]).abs() < FITS_DEG);
            self.old += u32::from(old);
            let allowed_s = if at_s < self.apart_until_s {
                APART_S
            } else {
                self.reaction_s
            };
            if let Some(rule) = self.lasts((compared_s, allowed_s), channel, axis, old) {
                let name = ["X", "Y"][axis];
                let what = format!(
                    "slope {name} reads {deg:.2} deg, the truth is {newest:.2} deg, allowed are \
                     {within_deg:.2} deg"
                );
                found.push(Violation {
                    rule,
                    at_s,
                    channel,
                    what,
                });
            }
        }
        found
    }

    /// The rule that is broken now, once for each stretch.
    fn lasts(
        &mut self,
        (at_s, allowed_s): (f64, f64),
        channel: usize,
        axis: usize,
        old: bool,
    ) -> Option<Rule> {
        let begun = Wrong {
            since_s: at_s,
            old: true,
            told: false,
        };
        let wrong = self.wrong[channel][axis].get_or_insert(begun);
        wrong.old &= old;
        self.longest_s = self.longest_s.max(at_s - wrong.since_s);
        if wrong.told || at_s - wrong.since_s <= allowed_s {
            return None;
        }
        wrong.told = true;
        Some(if wrong.old {
            Rule::OldAngle
        } else {
            Rule::WrongAngle
        })
    }
}
