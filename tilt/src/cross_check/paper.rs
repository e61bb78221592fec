//! R12 and R13: warnings counted within ten minutes, a stop, and Table I.
//!
//! In: both readings of one instant. Out: the paper's judgement. A difference above 0.40 deg is a
//! warning; more than 110 warnings within 600 s ask for 45 s of standstill; differences under
//! 0.40 deg then mean delayed data, anything else a physical fault that needs the supply checked
//! and a reset (Table I).
//!
//! The paper does not say which comparisons decide. One pair when the 45 s are over would take a
//! channel that fails now and then for a late one, and 45 s after the request a machine may still
//! move. So the 45 s are of standstill, which begins anew while both channels move. The arm rings
//! out and late data arrive in the first 15 s of it; after these the differences above 0.40 deg
//! must be rarer than those that ask for a stop: 110 in 600 s are 5 in 30 s.
//!
//! Left out: everything the paper does not ask for; `product` goes on from there.

use heapless::Deque;

use super::{Judgement, One, Silence, THRESHOLD, Verdict, difference, reason};
use crate::angle::{Angle, Axes};
use crate::chain::{Invalid, Reading};
use crate::sample::Instant;

/// The paper's check: configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PaperCheck {
    /// Differences above this are warnings; this itself is not.
    pub threshold: u32,
    /// A warning counts for exactly this long.
    pub window_us: u64,
    /// How long the machine has to stand still.
    pub stop_us: u64,
    /// The first part of that, in which the comparisons do not count yet.
    pub settle_us: u64,
    /// A machine whose angles stay within this of where they were stands still. So slow a motion
    /// cannot part the channels by the threshold when one is seconds late; a machine that idles
    /// shakes its angles by less.
    pub still: u32,
    /// Which axes are compared. The paper's excavator uses one (section VII), and a table that
    /// ignores z makes no sense of the other while the one is far from level (E7).
    pub watch: Axes<bool>,
}

/// More warnings than this within the window ask for a stop: 110 do not, 111 do (R13).
pub const MOST_WARNINGS: usize = 110;

impl PaperCheck {
    /// R12 and R13: 0.40 deg, 600 s, 45 s; 15 s to settle and 2 deg of motion \[ASSUME\].
    pub const PAPER: Self = Self {
        threshold: THRESHOLD,
        window_us: 600_000_000,
        stop_us: 45_000_000,
        settle_us: 15_000_000,
        still: 5 * THRESHOLD,
        watch: Axes { x: true, y: true },
    };
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Phase {
    #[default]
    Working,
    Stopped(Standstill),
    Faulted,
}

/// A standstill that was asked for: since when, and what was compared in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Standstill {
    since: Instant,
    /// Where own and peer's channel stood when it began, as far as they measured.
    stood: [Place; 2],
    /// Pairs that counted and showed no physical fault: they agree, or the data of one channel are
    /// late, which at a standstill is no difference (Table I). At most `u8::MAX`, as the next.
    sound: u8,
    /// Pairs that counted and differed.
    differed: u8,
}

/// The angles of one channel, on the axes that it measured.
type Place = Axes<Option<Angle>>;

fn place(reading: Reading) -> Place {
    let angle = |one: One| one.ok().map(|measurement| measurement.angle);
    Axes {
        x: angle(reading.x),
        y: angle(reading.y),
    }
}

impl Standstill {
    fn new(own: Reading, peer: Reading, now: Instant) -> Self {
        Self {
            since: now,
            stood: [own, peer].map(place),
            sound: 0,
            differed: 0,
        }
    }

    /// How long it has lasted, us.
    fn lasted_us(&self, now: Instant) -> u64 {
        now.micros_since(self.since).max(0).unsigned_abs()
    }
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
            Phase::Stopped(mut standstill) => {
                if self.both_moved(&standstill, [own, peer]) {
                    standstill = Standstill::new(own, peer, now);
                } else if standstill.lasted_us(now) > self.settle_us {
                    let late = [own, peer].map(reason).contains(&Some(Invalid::Late));
                    let count = match late || largest < self.threshold {
                        true => &mut standstill.sound,
                        false => &mut standstill.differed,
                    };
                    *count = count.saturating_add(1);
                }
                state.phase = Phase::Stopped(standstill);
                self.conclude(state, &standstill, now)
            }
            Phase::Working if largest <= self.threshold => {
                state.agreed = true;
                Judgement::Agree
            }
            Phase::Working => {
                if !state.note(now, self.window_us) {
                    return Judgement::Warning;
                }
                state.phase = Phase::Stopped(Standstill::new(own, peer, now));
                Judgement::StopMotion
            }
        }
    }

    /// As many pairs of a standstill may differ as R13 takes in that time for no reason to stop.
    fn most_differed(&self) -> u64 {
        let counted_us = self.stop_us.saturating_sub(self.settle_us);
        MOST_WARNINGS as u64 * counted_us / self.window_us.max(1)
    }

    /// Table I: what the standstill has shown, once it has lasted. Work goes on only after more
    /// pairs than had to differ for the stop.
    fn conclude(&self, state: &mut PaperState, standstill: &Standstill, now: Instant) -> Judgement {
        if standstill.lasted_us(now) < self.stop_us {
            return Judgement::StopMotion;
        }
        if u64::from(standstill.differed) > self.most_differed() {
            state.phase = Phase::Faulted;
            return Judgement::PhysicalFault;
        }
        if usize::from(standstill.sound) <= MOST_WARNINGS {
            return Judgement::StopMotion;
        }
        *state = PaperState {
            agreed: true,
            ..PaperState::default()
        };
        Judgement::DataDelay
    }

    /// Whether both channels show that the machine has moved since the standstill began. One alone
    /// moves when its data are late or its part is at fault.
    fn both_moved(&self, standstill: &Standstill, readings: [Reading; 2]) -> bool {
        let far = |then: Option<Angle>, now: Option<Angle>| match (then, now) {
            (Some(then), Some(now)) => now.minus(then).magnitude() > self.still,
            _ => false,
        };
        let mut both = standstill.stood.iter().zip(readings.map(place));
        both.all(|(then, now)| {
            self.watch.x && far(then.x, now.x) || self.watch.y && far(then.y, now.y)
        })
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
