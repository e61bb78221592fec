//! R12 and R13: warnings counted within ten minutes, a stop, and Table I.
//!
//! In: both readings of one instant. Out: the paper's judgement. A difference above 0.40 deg is a
//! warning; more than 110 warnings within 600 s ask for 45 s of standstill; differences under
//! 0.40 deg then mean delayed data, anything else a physical fault that needs the supply checked
//! and a reset (Table I).
//!
//! The paper does not state which comparisons decide. One pair when the 45 s are over would take a
//! channel that fails now and then for a late one, and 45 s after the request a machine may still
//! move. So the 45 s are of standstill, which begins anew while every channel that measures moves.
//! The arm rings out and late data arrive in the first 15 s of it; after these the differences
//! above 0.40 deg must be rarer than those that ask for a stop: 110 in 600 s are 5 in 30 s.
//!
//! Two things are no difference. Data that are told to be late, once the machine has stood for
//! these 15 s: Table I, first row. And the silence of a peer that announced it: its boot-up or its
//! heartbeat tells that it is not OPERATIONAL, as in an update.
//!
//! Left out: everything the paper does not ask for; `product` goes on from there.

use heapless::Deque;

use super::{Judgement, One, Silence, THRESHOLD, Verdict, apart, reason};
use crate::angle::{Angle, Axes};
use crate::chain::{Invalid, Reading};
use instant::Instant;

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
    Stopped,
    Faulted,
}

/// What the angles show of the machine's standstill: since when it stands, or since when its stop
/// is asked for, and what was compared in a stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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

    /// Counts a pair that was compared in a stop.
    fn count(&mut self, is_sound: bool) {
        let count = match is_sound {
            true => &mut self.sound,
            false => &mut self.differed,
        };
        *count = count.saturating_add(1);
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
    standstill: Standstill,
    silence: Silence,
    /// The peer has announced that it is not OPERATIONAL, and was not heard since.
    peer_away: bool,
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
            standstill: Standstill::default(),
            silence: Silence::default(),
            peer_away: false,
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

    /// The peer has announced by its boot-up or its heartbeat that it is not OPERATIONAL: its
    /// silence is no difference until it is heard again, and then it starts.
    pub fn peer_away(&mut self) {
        self.peer_away = true;
        self.silence = Silence::default();
    }

    /// Why there is nothing to compare at `now`, where that accuses nobody.
    fn waiting(&mut self, reasons: [Option<Invalid>; 2], now: Instant) -> Option<Invalid> {
        use Invalid::{NoSample, Settling, Silent, Unconfirmed};
        let absent = reasons[1].filter(|why| matches!(why, Silent | Unconfirmed));
        self.peer_away &= absent.is_some();
        if self.peer_away {
            return absent;
        }
        let starting = |reason: &Invalid| matches!(reason, NoSample | Settling | Unconfirmed);
        let Some(why) = reasons.into_iter().flatten().find(starting) else {
            self.silence.hear(now);
            return None;
        };
        (!self.silence.lasts(now)).then_some(why)
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
    /// The paper has no missing reading. An axis that one channel measures and the other does
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
        let reasons = [&own, &peer].map(reason);
        let waiting = state.waiting(reasons, now);
        // At work a standstill is seen from where a channel first measures.
        let first = state.phase == Phase::Working;
        let moved = self.moved(&state.standstill, [own, peer]);
        if moved.unwrap_or(first) {
            state.standstill = Standstill::new(own, peer, now);
        }
        let stands = state.standstill.lasted_us(now) > self.settle_us;
        let late = reasons.contains(&Some(Invalid::Late));
        let largest = self.largest(own, peer);
        match (state.phase, waiting) {
            (Phase::Faulted, _) => Judgement::PhysicalFault,
            (Phase::Stopped, Some(_)) => Judgement::StopMotion,
            (Phase::Working, Some(why)) => Judgement::Waiting(why),
            (Phase::Stopped, None) => {
                if stands {
                    state.standstill.count(late || largest < self.threshold);
                }
                self.conclude(state, now)
            }
            (Phase::Working, None) if largest <= self.threshold => {
                state.agreed = true;
                Judgement::Agree
            }
            (Phase::Working, None) if late && stands => Judgement::Waiting(Invalid::Late),
            (Phase::Working, None) => {
                if !state.note(now, self.window_us) {
                    return Judgement::Warning;
                }
                state.phase = Phase::Stopped;
                state.standstill = Standstill::new(own, peer, now);
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
    fn conclude(&self, state: &mut PaperState, now: Instant) -> Judgement {
        let standstill = state.standstill;
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
        // The window of warnings begins anew; where the machine stands is what it was.
        state.warnings.clear();
        state.age_us = 0;
        state.phase = Phase::Working;
        state.agreed = true;
        Judgement::DataDelay
    }

    /// Whether the machine has moved since the standstill began: every channel that measures shows
    /// it. Of two that measure, one alone moves when its data are late or its part is at fault.
    /// `None` where no channel measured both then and now.
    fn moved(&self, standstill: &Standstill, readings: [Reading; 2]) -> Option<bool> {
        let mut all = None;
        for (then, now) in standstill.stood.iter().zip(readings.map(place)) {
            let mut one = None;
            for (watched, then, now) in
                [(self.watch.x, then.x, now.x), (self.watch.y, then.y, now.y)]
            {
                if let (true, Some(then), Some(now)) = (watched, then, now) {
                    let far = now.minus(then).magnitude() > self.still;
                    one = Some(far || one == Some(true));
                }
            }
            if let Some(moved) = one {
                all = Some(moved && all != Some(false));
            }
        }
        all
    }

    /// The larger difference of the axes watched, without sign.
    fn largest(&self, own: Reading, peer: Reading) -> u32 {
        let one = |a: One, b: One| match apart(&a, &b) {
            Ok(delta) => delta.magnitude(),
            Err(Invalid::NotMeasured) => 0,
            Err(_) => u32::MAX,
        };
        let x = if self.watch.x { one(own.x, peer.x) } else { 0 };
        let y = if self.watch.y { one(own.y, peer.y) } else { 0 };
        x.max(y)
    }
}
