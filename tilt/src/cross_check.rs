//! Two channels, one judgement: the only place where a [`Verdict`] is made.
//!
//! In: the readings of both channels for one instant. Out: a [`Verdict`] that carries both
//! readings, their difference and what follows from it. Two checks, chosen by configuration:
//!
//! - [`PaperCheck`] is R12 and R13 to the letter: a difference above 0.40 deg is a warning; more
//!   than 110 warnings within 600 s ask for 45 s of standstill; a difference under 0.40 deg after
//!   that means delayed data, anything else a physical fault that needs the supply checked and a
//!   reset (Table I).
//! - [`WindowCheck`] is the product's: the threshold follows the uncertainty, an excess must last
//!   before it is a fault, and a channel that knows itself to be ill is named at once.
//!
//! # What a comparison of two angles can and cannot see
//! - E9: the node errors of the paper's Table II are correlated at about 0.98, since both nodes
//!   share reference and method. Errors common to both channels do not show in the difference.
//! - E10: a single-channel error can hide behind the threshold up to 0.6 deg, when the other
//!   errs by 0.2 deg the same way.
//! - E8: the paper's mean difference of 0.2 deg (Table III, X) exceeds the sum of the two RMSE,
//!   0.191; it is not a figure to chase.
//! - E11: the paper's rule fires on noise alone above 78.6 deg and on 5 ms of skew at 80 deg/s.
//! - E16: the paper's reaction takes up to 10 min 45 s.
//!
//! Left out: naming the faulty channel when both look healthy (issue of the detectors to come),
//! and averaging, which is never done: two values that disagree have no mean worth reporting.

use crate::angle::{Angle, Axes};
use crate::chain::{Invalid, Measurement, Reading};
use crate::sample::Instant;

/// The two channels of an instrument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Node {
    /// Node 1, the one that runs the check.
    Own,
    /// Node 2.
    Peer,
}

/// What follows from one comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Judgement {
    /// Both measure and agree.
    Agree,
    /// They differ by more than the threshold, but not yet often or long enough to act.
    Warning,
    /// Paper: too many warnings; the motion has to stop and stand still.
    StopMotion,
    /// Paper: after the stop they agree, so the data had been late; work resumes.
    DataDelay,
    /// Paper: after the stop they still differ; check the supply and reset.
    PhysicalFault,
    /// Product: they have differed for too long. Which of them is wrong is not known.
    Disagree,
    /// Product: one channel is ill and says why; the other still measures.
    OneChannel {
        /// The channel that is ill.
        ill: Node,
        /// Its reason.
        reason: Invalid,
    },
    /// Product: neither channel measures.
    NoChannel(Invalid),
    /// No comparison now, for a reason that passes and accuses nobody (settling, over range).
    Waiting(Invalid),
}

impl Judgement {
    /// True when the user is told that the pair cannot be trusted as it is.
    pub const fn is_warning(self) -> bool {
        !matches!(self, Self::Agree | Self::DataDelay | Self::Waiting(_))
    }

    /// True when the machine must stop and somebody must act.
    pub const fn is_fault(self) -> bool {
        matches!(
            self,
            Self::PhysicalFault | Self::Disagree | Self::OneChannel { .. } | Self::NoChannel(_)
        )
    }
}

/// Both readings of one instant with their judgement. Only this module makes one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    own: Reading,
    peer: Reading,
    judgement: Judgement,
}

impl Verdict {
    /// Node 1's reading.
    pub const fn own(&self) -> Reading {
        self.own
    }

    /// Node 2's reading.
    pub const fn peer(&self) -> Reading {
        self.peer
    }

    /// What follows.
    pub const fn judgement(&self) -> Judgement {
        self.judgement
    }

    /// Node 1 minus node 2 on each axis that both measure.
    pub fn delta(&self) -> Axes<Option<Angle>> {
        Axes {
            x: difference(self.own.x, self.peer.x).ok().map(|p| p.0),
            y: difference(self.own.y, self.peer.y).ok().map(|p| p.0),
        }
    }
}

type One = Result<Measurement, Invalid>;

/// The difference and the combined uncertainty of what the channels do not share, or the first
/// reason why there is none.
fn difference(own: One, peer: One) -> Result<(Angle, u32), Invalid> {
    let (own, peer) = (own?, peer?);
    let combined = own.unshared.combined_with(peer.unshared);
    Ok((own.angle.minus(peer.angle), combined.0))
}

/// How long a channel may go without an angle for a reason that passes: the filter settles within
/// 0.7 s of a start, and a shock is out of it within 0.2 s.
pub const PATIENCE_US: i64 = 2_000_000;

/// A silence is over when both channels have had angles for this long, so that a part that clips
/// again and again does not start its time anew each time.
const HEARD_US: i64 = 500_000;

/// How long at least one channel has gone without an angle.
#[derive(Clone, Copy, Debug, Default)]
struct Silence {
    since: Option<Instant>,
    heard_since: Option<Instant>,
}

impl Silence {
    /// A pair without both angles at `now`; true when that has lasted too long.
    fn lasts(&mut self, now: Instant) -> bool {
        self.heard_since = None;
        now.micros_since(*self.since.get_or_insert(now)) > PATIENCE_US
    }

    /// A pair with both angles at `now`.
    fn hear(&mut self, now: Instant) {
        if now.micros_since(*self.heard_since.get_or_insert(now)) >= HEARD_US {
            self.since = None;
        }
    }
}

/// 0.40 deg, the paper's threshold: twice the tolerance of 0.20 deg (R12).
pub const THRESHOLD: u32 = Angle::from_degrees(0.40).magnitude();

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
    /// The newest warnings, one more than may stand in the window, as a ring.
    warnings: [Option<Instant>; MOST_WARNINGS + 1],
    next: usize,
    phase: Phase,
    silence: Silence,
}

impl Default for PaperState {
    fn default() -> Self {
        Self {
            warnings: [None; MOST_WARNINGS + 1],
            next: 0,
            phase: Phase::Working,
            silence: Silence::default(),
        }
    }
}

impl PaperState {
    /// Notes a warning; true when the window now holds more than [`MOST_WARNINGS`].
    ///
    /// The ring holds 111, so it is over the limit exactly when the slot about to be overwritten
    /// next, the oldest of the newest 111, is still within the window.
    fn note(&mut self, now: Instant, window_us: u64) -> bool {
        if let Some(slot) = self.warnings.get_mut(self.next) {
            *slot = Some(now);
        }
        self.next = (self.next + 1) % (MOST_WARNINGS + 1);
        let oldest = self.warnings.get(self.next).copied().flatten();
        oldest.is_some_and(|t| now.micros_since(t) < window_us as i64)
    }
}

impl PaperCheck {
    /// Judges one pair taken at `now`.
    ///
    /// The paper knows no missing reading. An axis that one channel measures and the other does
    /// not counts as a difference above the threshold, because the two do not agree; only a
    /// channel that starts is waited for, [`PATIENCE_US`] long.
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
        let starting = |reason: &Invalid| matches!(reason, Invalid::NoSample | Invalid::Settling);
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
                *state = PaperState::default();
                Judgement::DataDelay
            }
            Phase::Stopped { .. } => {
                state.phase = Phase::Faulted;
                Judgement::PhysicalFault
            }
            Phase::Working if largest <= self.threshold => Judgement::Agree,
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

/// The product's check: configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WindowCheck {
    /// The threshold where the uncertainty is small.
    pub threshold: u32,
    /// The threshold is at least this many combined standard uncertainties of the pair; motion is
    /// left out of them, because both channels feel the same.
    pub coverage: u32,
    /// An excess that lasts longer than this is a fault.
    pub persistence_us: u64,
    /// Whether a disagreement stays until a reset, as on a machine, or ends with its cause, as
    /// suits a recording, which nobody can reset.
    pub latched: bool,
}

impl WindowCheck {
    /// 0.40 deg or five standard uncertainties, for longer than 0.2 s; latched.
    pub const PRODUCT: Self = Self {
        threshold: THRESHOLD,
        coverage: 5,
        persistence_us: 200_000,
        latched: true,
    };
}

/// The product's check: state. A reset is a new state.
#[derive(Clone, Copy, Debug, Default)]
pub struct WindowState {
    excess_since: Option<Instant>,
    disagreed: bool,
    silence: Silence,
}

impl WindowCheck {
    /// Judges one pair taken at `now`.
    pub fn step(
        &self,
        state: &mut WindowState,
        own: Reading,
        peer: Reading,
        now: Instant,
    ) -> Verdict {
        let judgement = match ill(own, peer) {
            Some(Judgement::Waiting(_)) if state.silence.lasts(now) => lasting(own, peer),
            Some(judgement) => judgement,
            None => {
                state.silence.hear(now);
                self.compare(state, own, peer, now)
            }
        };
        Verdict {
            own,
            peer,
            judgement,
        }
    }

    fn compare(
        &self,
        state: &mut WindowState,
        own: Reading,
        peer: Reading,
        now: Instant,
    ) -> Judgement {
        if state.disagreed && self.latched {
            return Judgement::Disagree;
        }
        if !self.exceeds(own.x, peer.x) && !self.exceeds(own.y, peer.y) {
            state.excess_since = None;
            return Judgement::Agree;
        }
        let since = *state.excess_since.get_or_insert(now);
        if now.micros_since(since) > self.persistence_us as i64 {
            state.disagreed = true;
            return Judgement::Disagree;
        }
        // Not lasting yet, so the user is not told; both readings remain what they are.
        Judgement::Agree
    }

    fn exceeds(&self, own: One, peer: One) -> bool {
        difference(own, peer).is_ok_and(|(delta, uncertainty)| {
            delta.magnitude()
                > self
                    .threshold
                    .max(uncertainty.saturating_mul(self.coverage))
        })
    }
}

/// The reason why a whole channel does not measure; an axis it never measures does not count.
fn reason(reading: Reading) -> Option<Invalid> {
    [reading.x, reading.y]
        .into_iter()
        .filter_map(Result::err)
        .find(|&reason| reason != Invalid::NotMeasured)
}

fn ill(own: Reading, peer: Reading) -> Option<Judgement> {
    match (reason(own), reason(peer)) {
        (None, None) => None,
        (Some(a), Some(b)) if !a.is_transient() && !b.is_transient() => {
            Some(Judgement::NoChannel(a))
        }
        (Some(reason), _) if !reason.is_transient() => Some(Judgement::OneChannel {
            ill: Node::Own,
            reason,
        }),
        (_, Some(reason)) if !reason.is_transient() => Some(Judgement::OneChannel {
            ill: Node::Peer,
            reason,
        }),
        (Some(reason), _) | (_, Some(reason)) => Some(Judgement::Waiting(reason)),
    }
}

/// The judgement on channels without an angle for too long, whatever their reasons.
fn lasting(own: Reading, peer: Reading) -> Judgement {
    match (reason(own), reason(peer)) {
        (Some(reason), None) => Judgement::OneChannel {
            ill: Node::Own,
            reason,
        },
        (None, Some(reason)) => Judgement::OneChannel {
            ill: Node::Peer,
            reason,
        },
        (Some(reason), Some(_)) => Judgement::NoChannel(reason),
        (None, None) => Judgement::Agree,
    }
}

/// A check of either kind with its state: what an instrument holds one of.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no heap on the chip")]
pub enum CrossCheck {
    /// The paper's rule.
    Paper(PaperCheck, PaperState),
    /// The product's window.
    Window(WindowCheck, WindowState),
}

impl CrossCheck {
    /// The paper's rule, fresh.
    pub fn paper() -> Self {
        Self::Paper(PaperCheck::PAPER, PaperState::default())
    }

    /// The product's window, fresh.
    pub fn product() -> Self {
        Self::Window(WindowCheck::PRODUCT, WindowState::default())
    }

    /// Judges one pair taken at `now`.
    pub fn step(&mut self, own: Reading, peer: Reading, now: Instant) -> Verdict {
        match self {
            Self::Paper(check, state) => check.step(state, own, peer, now),
            Self::Window(check, state) => check.step(state, own, peer, now),
        }
    }

    /// Forgets everything, as a reset does.
    pub fn reset(&mut self) {
        match self {
            Self::Paper(_, state) => *state = PaperState::default(),
            Self::Window(_, state) => *state = WindowState::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::uncertainty::Uncertainty;

    fn reading(x: u32) -> Reading {
        let m = |steps: u32| {
            Ok(Measurement {
                angle: Angle(steps as i32),
                uncertainty: Uncertainty::from_degrees(0.03),
                unshared: Uncertainty::from_degrees(0.03),
                at: Instant(0),
                latency_us: 0,
            })
        };
        Axes { x: m(x), y: m(0) }
    }

    fn absent(reason: Invalid) -> Reading {
        Axes {
            x: Err(reason),
            y: Err(reason),
        }
    }

    fn seconds(s: f64) -> Instant {
        Instant((s * 1e6) as u64)
    }

    /// `n` warnings, 20 ms apart from `start` on; the last judgement.
    fn warn(state: &mut PaperState, n: usize, start: f64) -> Judgement {
        let mut last = Judgement::Agree;
        for i in 0..n {
            let now = seconds(start + 0.02 * i as f64);
            let pair = (reading(THRESHOLD + 1), reading(0));
            last = PaperCheck::PAPER
                .step(state, pair.0, pair.1, now)
                .judgement();
        }
        last
    }

    #[test]
    fn r12_0_40_itself_is_not_an_excess() {
        let mut state = PaperState::default();
        let mut judge = |x| PaperCheck::PAPER.step(&mut state, reading(x), reading(0), Instant(1));
        assert_eq!(judge(THRESHOLD).judgement(), Judgement::Agree);
        assert_eq!(judge(THRESHOLD + 1).judgement(), Judgement::Warning);
        assert_eq!(
            judge(0u32.wrapping_sub(THRESHOLD)).judgement(),
            Judgement::Agree
        );
        assert_eq!(
            judge(0u32.wrapping_sub(THRESHOLD + 1)).judgement(),
            Judgement::Warning
        );
    }

    #[test]
    fn r13_110_does_not_stop_111_does() {
        let mut state = PaperState::default();
        assert_eq!(warn(&mut state, 110, 0.0), Judgement::Warning);
        assert_eq!(warn(&mut state, 1, 599.0), Judgement::StopMotion);
    }

    #[test]
    fn r13_a_warning_leaves_after_exactly_600_s() {
        // The first of 110 at t = 0; the 111th at 600 s exactly does not count it any more.
        let mut state = PaperState::default();
        warn(&mut state, 110, 0.0);
        assert_eq!(warn(&mut state, 1, 600.0), Judgement::Warning);
        let mut state = PaperState::default();
        warn(&mut state, 110, 0.0);
        assert_eq!(warn(&mut state, 1, 599.999_999), Judgement::StopMotion);
    }

    #[test]
    fn r13_stop_lasts_45_s_then_data_delay_resumes() {
        let mut state = PaperState::default();
        assert_eq!(warn(&mut state, 111, 0.0), Judgement::StopMotion);
        let stopped = 110.0 * 0.02;
        let mut judge =
            |x, t| PaperCheck::PAPER.step(&mut state, reading(x), reading(0), seconds(t));
        assert_eq!(
            judge(0, stopped + 44.999).judgement(),
            Judgement::StopMotion
        );
        assert_eq!(
            judge(THRESHOLD - 1, stopped + 45.0).judgement(),
            Judgement::DataDelay
        );
        assert_eq!(judge(0, stopped + 45.02).judgement(), Judgement::Agree);
        assert_eq!(
            warn(&mut state, 110, 60.0),
            Judgement::Warning,
            "the window starts anew"
        );
    }

    #[test]
    fn r13_still_0_40_after_the_stop_is_a_physical_fault_until_reset() {
        let mut state = PaperState::default();
        warn(&mut state, 111, 0.0);
        let mut judge =
            |x, t| PaperCheck::PAPER.step(&mut state, reading(x), reading(0), seconds(t));
        assert_eq!(judge(THRESHOLD, 50.0).judgement(), Judgement::PhysicalFault);
        assert_eq!(judge(0, 60.0).judgement(), Judgement::PhysicalFault);
        state = PaperState::default();
        let after = PaperCheck::PAPER.step(&mut state, reading(0), reading(0), seconds(61.0));
        assert_eq!(after.judgement(), Judgement::Agree);
    }

    #[test]
    fn paper_counts_a_silent_channel_as_an_excess() {
        let mut state = PaperState::default();
        let verdict =
            PaperCheck::PAPER.step(&mut state, reading(0), absent(Invalid::Stale), Instant(5));
        assert_eq!(verdict.judgement(), Judgement::Warning);
        assert_eq!(verdict.delta().x, None);
    }

    #[test]
    fn paper_compares_only_the_axes_it_watches() {
        let only_y = PaperCheck {
            watch: Axes { x: false, y: true },
            ..PaperCheck::PAPER
        };
        let mut state = PaperState::default();
        let pair = (reading(2 * THRESHOLD), reading(0));
        assert_eq!(
            only_y
                .step(&mut state, pair.0, pair.1, Instant(1))
                .judgement(),
            Judgement::Agree
        );
    }

    #[test]
    fn product_excess_must_last() {
        let mut state = WindowState::default();
        let mut judge = |x, ms: u64| {
            let now = Instant(1_000_000 + ms * 1000);
            WindowCheck::PRODUCT
                .step(&mut state, reading(x), reading(0), now)
                .judgement()
        };
        assert_eq!(judge(2 * THRESHOLD, 0), Judgement::Agree);
        assert_eq!(judge(2 * THRESHOLD, 180), Judgement::Agree);
        assert_eq!(judge(0, 190), Judgement::Agree);
        assert_eq!(judge(2 * THRESHOLD, 200), Judgement::Agree);
        assert_eq!(judge(2 * THRESHOLD, 400), Judgement::Agree);
        assert_eq!(judge(2 * THRESHOLD, 401), Judgement::Disagree);
        assert_eq!(judge(0, 500), Judgement::Disagree, "latched until a reset");
    }

    #[test]
    fn an_unlatched_disagreement_ends_with_its_cause() {
        let check = WindowCheck {
            latched: false,
            ..WindowCheck::PRODUCT
        };
        let mut state = WindowState::default();
        let mut judge = |x, ms: u64| {
            let now = Instant(1_000_000 + ms * 1000);
            check
                .step(&mut state, reading(x), reading(0), now)
                .judgement()
        };
        assert_eq!(judge(2 * THRESHOLD, 0), Judgement::Agree);
        assert_eq!(judge(2 * THRESHOLD, 201), Judgement::Disagree);
        assert_eq!(judge(0, 220), Judgement::Agree);
        assert_eq!(
            judge(2 * THRESHOLD, 240),
            Judgement::Agree,
            "it has to last anew"
        );
        assert_eq!(judge(2 * THRESHOLD, 441), Judgement::Disagree);
    }

    #[test]
    fn product_threshold_follows_the_uncertainty() {
        let mut wide = reading(2 * THRESHOLD);
        wide.x = wide.x.map(|m| Measurement {
            unshared: Uncertainty::from_degrees(1.0),
            ..m
        });
        assert!(!WindowCheck::PRODUCT.exceeds(wide.x, reading(0).x));
        assert!(WindowCheck::PRODUCT.exceeds(reading(2 * THRESHOLD).x, reading(0).x));
    }

    #[test]
    fn product_names_the_channel_that_knows_itself_ill() {
        let mut state = WindowState::default();
        let mut judge = |own, peer| {
            WindowCheck::PRODUCT
                .step(&mut state, own, peer, Instant(9))
                .judgement()
        };
        let reset = Invalid::PartReset;
        assert_eq!(
            judge(reading(0), absent(reset)),
            Judgement::OneChannel {
                ill: Node::Peer,
                reason: reset
            }
        );
        assert_eq!(
            judge(absent(Invalid::Stale), absent(Invalid::Settling)),
            Judgement::OneChannel {
                ill: Node::Own,
                reason: Invalid::Stale
            }
        );
        assert_eq!(
            judge(absent(reset), absent(reset)),
            Judgement::NoChannel(reset)
        );
        let over = Invalid::OverRange;
        assert_eq!(judge(reading(0), absent(over)), Judgement::Waiting(over));
    }

    #[test]
    fn a_channel_that_never_delivers_is_a_fault_after_two_seconds() {
        for why in [Invalid::NoSample, Invalid::Settling, Invalid::OverRange] {
            let mut state = WindowState::default();
            let mut judge = |ms: u64| {
                let now = Instant(ms * 1000);
                WindowCheck::PRODUCT
                    .step(&mut state, reading(0), absent(why), now)
                    .judgement()
            };
            assert_eq!(judge(0), Judgement::Waiting(why));
            assert_eq!(judge(2000), Judgement::Waiting(why));
            let fault = Judgement::OneChannel {
                ill: Node::Peer,
                reason: why,
            };
            assert_eq!(judge(2001), fault);
        }
        let mut state = PaperState::default();
        let dead = absent(Invalid::NoSample);
        let mut judge = |t| PaperCheck::PAPER.step(&mut state, reading(0), dead, seconds(t));
        assert_eq!(
            judge(0.0).judgement(),
            Judgement::Waiting(Invalid::NoSample)
        );
        assert_eq!(judge(2.1).judgement(), Judgement::Warning);
    }

    #[test]
    fn clipping_again_and_again_is_a_fault_too() {
        let mut state = WindowState::default();
        let mut fault_at = None;
        for ms in (0..10_000).step_by(20) {
            let clipped = ms % 200 < 160;
            let peer = if clipped {
                absent(Invalid::OverRange)
            } else {
                reading(0)
            };
            let verdict =
                WindowCheck::PRODUCT.step(&mut state, reading(0), peer, Instant(ms * 1000));
            if verdict.judgement().is_fault() {
                fault_at.get_or_insert(ms);
            }
        }
        assert_eq!(fault_at, Some(2020));
    }

    #[test]
    fn an_excess_goes_on_over_a_shock() {
        let mut state = WindowState::default();
        let mut judge = |peer, ms: u64| {
            let now = Instant(ms * 1000);
            WindowCheck::PRODUCT
                .step(&mut state, reading(2 * THRESHOLD), peer, now)
                .judgement()
        };
        assert_eq!(judge(reading(0), 0), Judgement::Agree);
        judge(absent(Invalid::OverRange), 100);
        assert_eq!(judge(reading(0), 220), Judgement::Disagree);
    }

    #[test]
    fn one_axis_instruments_compare_their_one_axis() {
        let one = |x| Axes {
            y: Err(Invalid::NotMeasured),
            ..reading(x)
        };
        let mut state = PaperState::default();
        let mut judge = |a, b| {
            PaperCheck::PAPER
                .step(&mut state, a, b, Instant(3))
                .judgement()
        };
        assert_eq!(judge(one(0), one(0)), Judgement::Agree);
        assert_eq!(judge(one(2 * THRESHOLD), one(0)), Judgement::Warning);
        let mut state = WindowState::default();
        let verdict = WindowCheck::PRODUCT.step(&mut state, one(0), one(0), Instant(3));
        assert_eq!(verdict.judgement(), Judgement::Agree);
    }
}
