//! R12 and R13 to the letter: warnings counted within ten minutes, a stop, and Table I.
//!
//! In: both readings of one instant. Out: the paper's judgement. A difference above 0.40 deg is a
//! warning; more than 110 warnings within 600 s ask for 45 s of standstill; a difference under
//! 0.40 deg after that means delayed data, anything else a physical fault that needs the supply
//! checked and a reset (Table I).
//!
//! Left out: everything the paper does not ask for; `product` goes on from there.

use heapless::Deque;

use super::{Judgement, One, Silence, THRESHOLD, Verdict, difference, reason};
use crate::angle::Axes;
use crate::chain::{Invalid, Reading};
use crate::sample::Instant;

/// The paper's check: configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PaperCheck {
    /// Differences above this are warnings; this itself is not.
    pub threshold: u32,
    /// A warning counts for exactly this long.
    pub window_us: u64,
    /// How long the motion has to stand still.
    pub stop_us: u64,
    /// Which axes are compared. The paper's excavator uses one (section VII), and a table that
    /// ignores z makes no sense of the other while the one is far from level (E7).
    pub watch: Axes<bool>,
}

/// More warnings than this within the window ask for a stop: 110 do not, 111 do (R13).
pub const MOST_WARNINGS: usize = 110;

impl PaperCheck {
    /// R12 and R13: 0.40 deg, 600 s, 45 s.
    pub const PAPER: Self = Self {
        threshold: THRESHOLD,
        window_us: 600_000_000,
        stop_us: 45_000_000,
        watch: Axes { x: true, y: true },
    };
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Phase {
    #[default]
    Working,
    Stopped {
        until: Instant,
    },
    Faulted,
}

/// The paper's check: state. A reset is a new state.
#[derive(Clone, Debug)]
pub struct PaperState {
    /// The newest warnings, one more than may stand in the window, each by its time since the one
    /// before, us, at most `u32::MAX`: half the room that their instants would take.
    warnings: Deque<u32, { MOST_WARNINGS + 1 }>,
    /// When the newest of them was.
    newest: Instant,
    /// From the oldest of them to the newest.
    age_us: u64,
    phase: Phase,
    silence: Silence,
    /// The two have agreed, and this channel was not away since.
    agreed: bool,
}

impl Default for PaperState {
    fn default() -> Self {
        Self {
            warnings: Deque::new(),
            newest: Instant(0),
            age_us: 0,
            phase: Phase::Working,
            silence: Silence::default(),
            agreed: false,
        }
    }
}

impl PaperState {
    /// True after a physical fault, until a reset.
    pub fn is_faulted(&self) -> bool {
        self.phase == Phase::Faulted
    }

    /// True when the two have agreed since this channel was last away.
    pub const fn has_agreed(&self) -> bool {
        self.agreed
    }

    /// This channel was away.
    pub const fn forget_agreement(&mut self) {
        self.agreed = false;
    }

    /// Notes a warning; true when the window now holds more than [`MOST_WARNINGS`].
    ///
    /// There is room for 111, so it is over the limit exactly when the room is full and the
    /// oldest of them is still within the window. A window is shorter than 71 minutes.
    fn note(&mut self, now: Instant, window_us: u64) -> bool {
        if self.warnings.is_full() {
            self.warnings.pop_front();
            let oldest = self.warnings.front().copied().unwrap_or(0);
            self.age_us = self.age_us.saturating_sub(oldest.into());
        }
        let pause = now.micros_since(self.newest).max(0);
        let pause = u32::try_from(pause).unwrap_or(u32::MAX);
        if !self.warnings.is_empty() {
            self.age_us = self.age_us.saturating_add(pause.into());
        }
        // It has room now.
        let _ = self.warnings.push_back(pause);
        self.newest = now;
        self.warnings.is_full() && self.age_us < window_us
    }
}

impl PaperCheck {
    /// Judges one pair taken at `now`.
    ///
    /// The paper knows no missing reading. An axis that one channel measures and the other does
    /// not counts as a difference above the threshold, because the two do not agree; only a
    /// channel that starts is waited for, [`PATIENCE_US`](super::PATIENCE_US) long.
    pub fn step(
        &self,
        state: &mut PaperState,
        own: Reading,
        peer: Reading,
        now: Instant,
    ) -> Verdict {
        Verdict {
            own,
            peer,
            judgement: self.judge(state, own, peer, now),
        }
    }

    fn judge(
        &self,
        state: &mut PaperState,
        own: Reading,
        peer: Reading,
        now: Instant,
    ) -> Judgement {
        use Invalid::{NoSample, Settling, Unconfirmed};
        let starting = |reason: &Invalid| matches!(reason, NoSample | Settling | Unconfirmed);
        match [reason(own), reason(peer)]
            .into_iter()
            .flatten()
            .find(starting)
        {
            Some(why) if !state.silence.lasts(now) => return Judgement::Waiting(why),
            Some(_) => {}
            None => state.silence.hear(now),
        }
        let largest = self.largest(own, peer);
        match state.phase {
            Phase::Faulted => Judgement::PhysicalFault,
            Phase::Stopped { until } if now < until => Judgement::StopMotion,
            Phase::Stopped { .. } if largest < self.threshold => {
                *state = PaperState {
                    agreed: true,
                    ..PaperState::default()
                };
                Judgement::DataDelay
            }
            Phase::Stopped { .. } => {
                state.phase = Phase::Faulted;
                Judgement::PhysicalFault
            }
            Phase::Working if largest <= self.threshold => {
                state.agreed = true;
                Judgement::Agree
            }
            Phase::Working => self.warn(state, now),
        }
    }

    fn warn(&self, state: &mut PaperState, now: Instant) -> Judgement {
        if !state.note(now, self.window_us) {
            return Judgement::Warning;
        }
        state.phase = Phase::Stopped {
            until: Instant(now.0.saturating_add(self.stop_us)),
        };
        Judgement::StopMotion
    }

    /// The larger difference of the axes watched, without sign.
    fn largest(&self, own: Reading, peer: Reading) -> u32 {
        let one = |a: One, b: One| match difference(a, b) {
            Ok((delta, _)) => delta.magnitude(),
            Err(Invalid::NotMeasured) => 0,
            Err(_) => u32::MAX,
        };
        let x = if self.watch.x { one(own.x, peer.x) } else { 0 };
        let y = if self.watch.y { one(own.y, peer.y) } else { 0 };
        x.max(y)
    }
}
