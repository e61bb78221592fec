//! One event: a fault, a restart, a lost heartbeat.
//!
//! Left out: the list of them (`events`), and what ends one in a later log (`endings`).

use super::kind::Kind;
use codes::words;
use serde::{Deserialize, Serialize};

/// Again within this time is a repetition, ns.
const REPEAT_NS: u64 = 1_000_000_000;

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, PartialOrd, Ord)]
pub enum What {
    /// An EMCY message of this code.
    Emergency(u16),
    /// The heartbeat stayed away.
    HeartbeatLost,
    /// A boot-up message after other frames of the node.
    Restart,
}

impl What {
    /// Its kind.
    pub fn kind(self) -> Kind {
        match self {
            Self::Emergency(code) => Kind::of(code),
            Self::HeartbeatLost => Kind::Heartbeat,
            Self::Restart => Kind::Restart,
        }
    }

    /// True for what has no end of its own.
    fn is_momentary(self) -> bool {
        match self {
            Self::Emergency(0x8120 | 0x8130) => false,
            Self::Emergency(code) => words::fault(code).is_none(),
            Self::HeartbeatLost => false,
            Self::Restart => true,
        }
    }
}

/// How an event ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, PartialOrd, Ord)]
pub enum End {
    /// It has no end of its own.
    Momentary,
    /// Told to be over at this time, ns.
    Over(u64),
    /// The node started anew at this time, ns.
    Restarted(u64),
    /// Not before the log ended.
    Standing,
}

/// One event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// When, ns.
    pub at_ns: u64,
    /// 0 is channel A, 1 is channel B: who told it, or whose heartbeat it is.
    pub side: u8,
    /// What.
    pub what: What,
    /// Channel that is blamed, seen from the teller: 0 none, 1 own, 2 the other, 3 both.
    pub blamed: u8,
    /// Why, as 2025h numbers it; 0 for no reason.
    pub reason: u8,
    /// State of the pair (2021h), where the message tells it.
    pub state: Option<u8>,
    /// How it ended.
    pub end: End,
    /// How often it came again.
    pub repeats: u32,
    /// The number of the plot with the SYNCs around it.
    pub plot: Option<usize>,
    /// When it was reported last, ns.
    #[serde(skip)]
    pub told_ns: u64,
    /// The end of the log at which it stood, ns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stood_ns: Option<u64>,
}

impl Event {
    pub fn new(at_ns: u64, side: u8, what: What) -> Self {
        let end = if what.is_momentary() {
            End::Momentary
        } else {
            End::Standing
        };
        Self {
            at_ns,
            side,
            what,
            blamed: 0,
            reason: 0,
            state: None,
            end,
            repeats: 0,
            plot: None,
            told_ns: at_ns,
            stood_ns: None,
        }
    }

    /// Whether a later log has this event again while it stood, or within a second of its end.
    pub fn is_again_later(&self, later: &Self) -> bool {
        self.stood_ns.is_some_and(|ns| later.at_ns > ns) && self.is_within_a_second(later)
    }

    /// Takes the same event that came again.
    pub fn repeat(&mut self, again: &Self) {
        self.repeats = self.repeats.saturating_add(again.repeats).saturating_add(1);
        self.plot = self.plot.or(again.plot);
        (self.end, self.stood_ns) = (again.end, again.stood_ns);
    }

    /// All of it, the time first; an event without a plot comes after the same one with a plot,
    /// whether it never had one or has lost it.
    pub const fn key(&self) -> (u64, u8, What, [u8; 3], End, u32, usize, Option<u64>) {
        let state = match self.state {
            Some(state) => state,
            None => u8::MAX,
        };
        let plot = match self.plot {
            Some(plot) => plot,
            None => usize::MAX,
        };
        let about = [self.blamed, self.reason, state];
        (
            self.at_ns,
            self.side,
            self.what,
            about,
            self.end,
            self.repeats,
            plot,
            self.stood_ns,
        )
    }

    pub fn is_within_a_second(&self, later: &Self) -> bool {
        let end_ns = match self.end {
            End::Over(at_ns) | End::Restarted(at_ns) => at_ns,
            End::Momentary => self.at_ns,
            // Told again without an end, as after a frame that was lost.
            End::Standing => later.at_ns,
        };
        later.at_ns >= self.at_ns && later.at_ns.saturating_sub(end_ns) <= REPEAT_NS
    }
}
