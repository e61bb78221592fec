//! How soon a fault is told, and who is blamed.
//!
//! In: the faults with their channel, and the state (2021h) that each channel shows. Out: for each
//! fault and channel the time to the first accusation and to the naming of a channel; a violation
//! when the healthy one is named.

use super::{Affected, Rule, Violation};
use crate::trial::CHANNELS;

/// 2021h: the channels disagree.
const DISAGREE: u8 = 6;
/// 2021h: this channel is faulty.
const OWN: u8 = 7;
/// 2021h: the other channel is faulty.
const PEER: u8 = 8;
/// 2021h: neither measures.
const NONE: u8 = 9;
/// What is told so long after a fault has ended still belongs to it, s.
const AFTERWARDS_S: f64 = 0.5;

/// Whom a channel names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blame {
    /// The channel that is faulty.
    Right,
    /// The healthy one.
    Wrong,
    /// Nobody.
    Unknown,
}

/// What one channel has told of one fault.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Found {
    /// From the fault's beginning to the first word of it, s.
    pub told_s: Option<f64>,
    /// From the fault's beginning to the naming of a channel, s, and which.
    pub named: Option<(f64, Blame)>,
    /// It has named the healthy one, first or later.
    pub wrong: bool,
}

/// What was told of one fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// The fault.
    pub of: Affected,
    /// When it ended, s.
    pub until_s: Option<f64>,
    /// By channel A and B.
    pub by: [Found; CHANNELS],
}

impl Detection {
    /// From the fault's beginning to the first word of either channel, s.
    pub fn told_s(&self) -> Option<f64> {
        let told = self.by.iter().filter_map(|found| found.told_s);
        told.reduce(f64::min)
    }

    /// Whom the pair names: right or wrong when either does, wrong before right.
    pub fn blame(&self) -> Blame {
        if self.by.iter().any(|found| found.wrong) {
            return Blame::Wrong;
        }
        let named = self.by.iter().any(|found| found.named.is_some());
        if named { Blame::Right } else { Blame::Unknown }
    }
}

/// Every fault of a run.
#[derive(Clone, Debug, Default)]
pub struct Detections {
    /// In the order of their beginnings.
    pub all: Vec<Detection>,
}

impl Detections {
    /// A fault begins.
    pub fn begin(&mut self, of: Affected) {
        self.all.push(Detection {
            of,
            until_s: None,
            by: Default::default(),
        });
    }

    /// Every fault has ended.
    pub fn end(&mut self, at_s: f64) {
        for detection in &mut self.all {
            detection.until_s.get_or_insert(at_s);
        }
    }

    /// A channel shows a state.
    pub fn state(&mut self, at_s: f64, channel: usize, state: u8) -> Option<Violation> {
        let last = self.all.last_mut()?;
        let over = last
            .until_s
            .is_some_and(|until| at_s > until + AFTERWARDS_S);
        if over || !(DISAGREE..=NONE).contains(&state) {
            return None;
        }
        let after_s = at_s - last.of.from_s;
        let found = &mut last.by[channel];
        found.told_s.get_or_insert(after_s);
        let names_itself = match state {
            OWN => true,
            PEER => false,
            _ => return None,
        };
        let right = names_itself == (channel == last.of.channel);
        let blame = if right { Blame::Right } else { Blame::Wrong };
        found.named.get_or_insert((after_s, blame));
        if right || std::mem::replace(&mut found.wrong, true) {
            return None;
        }
        last.of.blame_counts.then(|| Violation {
            rule: Rule::WrongBlame,
            at_s,
            channel,
            what: format!("state {state} {after_s:.3} s after the fault"),
        })
    }
}
