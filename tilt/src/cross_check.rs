//! Two channels, one judgement: the only place where a [`Verdict`] is made.
//!
//! In: what both channels report of one instant. Out: a [`Verdict`] that carries both readings,
//! their difference and what follows from it. Three checks, chosen by configuration:
//!
//! - [`paper`] is R12 and R13, exact at their boundaries.
//! - [`window`] compares the two angles alone, which is all that a recording has.
//! - [`product`] is the instrument's: a ladder of tests that names the faulty channel.
//!
//! # What a comparison of two angles can and cannot see
//! - E9: the node errors of the paper's Table II are correlated at about 0.98, since both nodes
//!   share reference and method. Errors common to both channels do not show in the difference.
//! - E10: a single-channel error can hide behind the threshold up to 0.6 deg, when the other
//!   errs by 0.2 deg the same way. The product's residual is what looks behind it.
//! - E8: the paper's mean difference of 0.2 deg (Table III, X) exceeds the sum of the two RMSE,
//!   0.191; it is not a figure to chase.
//! - E11: the paper's rule fires on noise alone above 78.6 deg and on 5 ms of skew at 80 deg/s.
//! - E16: the paper's reaction takes up to 10 min 45 s.
//!
//! Left out: averaging, which is never done: two values that disagree have no mean worth
//! reporting.

pub mod activity;
pub mod findings;
pub mod gravity;
pub mod movement;
pub mod paper;
pub mod product;
pub mod rates;
pub mod residual;
pub mod standstill;
pub mod window;

pub use findings::{Findings, Latch};
pub use paper::{MOST_WARNINGS, PaperCheck, PaperState};
pub use product::{ProductCheck, ProductState};
pub use rates::RateState;
pub use window::{WindowCheck, WindowState};

use crate::angle::{Angle, Axes};
use crate::chain::{Invalid, Measurement, Reading};
use crate::composition::{Composition, Place, Whole};
use crate::observation::Observation;
use instant::Instant;

/// The two channels of an instrument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Member {
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
    /// Product: one channel is faulty and reports why; the other still measures.
    OneChannel {
        /// The channel that is faulty.
        faulty: Member,
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
            x: apart(&self.own.x, &self.peer.x).ok(),
            y: apart(&self.own.y, &self.peer.y).ok(),
        }
    }
}

type One = Result<Measurement, Invalid>;

/// The difference, or the first reason why there is none.
fn apart(own: &One, peer: &One) -> Result<Angle, Invalid> {
    let (own, peer) = (own.as_ref(), peer.as_ref());
    let angle = |one: &Measurement| one.angle;
    let (own, peer) = (own.map(angle), peer.map(angle));
    Ok(own.map_err(|why| *why)?.minus(peer.map_err(|why| *why)?))
}

/// The combined uncertainty of what the channels do not share; `None` where one does not measure.
fn combined(own: &One, peer: &One) -> Option<u32> {
    let (Ok(own), Ok(peer)) = (own, peer) else {
        return None;
    };
    Some(own.unshared.combined_with(peer.unshared).0)
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
    /// When the channel last followed its gyroscope meanwhile.
    followed: Option<Instant>,
}

impl Silence {
    /// A pair without both angles at `now`; true when that has lasted too long.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn lasts(&mut self, now: Instant) -> bool {
        self.lasts_for(now, PATIENCE_US)
    }

    /// [`Silence::lasts`] with a patience of its own, us.
    fn lasts_for(&mut self, now: Instant, patience_us: i64) -> bool {
        let since = self.since(now);
        now.micros_since(self.followed.unwrap_or(since)) > patience_us
    }

    /// The same of a channel that follows its gyroscope: true when it has looked for its vertical
    /// for too long.
    fn follows_for(&mut self, now: Instant, patience_us: i64) -> bool {
        self.followed = Some(now);
        now.micros_since(self.since(now)) > patience_us
    }

    /// Since when the channel has had no angle; from `now` on at the latest.
    fn since(&mut self, now: Instant) -> Instant {
        self.heard_since = None;
        *self.since.get_or_insert(now)
    }

    /// A pair with both angles at `now`.
    fn hear(&mut self, now: Instant) {
        if now.micros_since(*self.heard_since.get_or_insert(now)) >= HEARD_US {
            (self.since, self.followed) = (None, None);
        }
    }
}

/// 0.40 deg, the paper's threshold: twice the tolerance of 0.20 deg (R12).
pub const THRESHOLD: u32 = Angle::from_degrees(0.40).magnitude();

/// The reason why a whole channel does not measure; an axis it never measures does not count.
fn reason(reading: &Reading) -> Option<Invalid> {
    [&reading.x, &reading.y]
        .into_iter()
        .filter_map(|axis| axis.as_ref().err().copied())
        .find(|&reason| reason != Invalid::NotMeasured)
}

fn faulty(own: &Reading, peer: &Reading) -> Option<Judgement> {
    match (reason(own), reason(peer)) {
        (None, None) => None,
        (Some(a), Some(b)) if !a.is_transient() && !b.is_transient() => {
            Some(Judgement::NoChannel(a))
        }
        (Some(reason), _) if !reason.is_transient() => Some(Judgement::OneChannel {
            faulty: Member::Own,
            reason,
        }),
        (_, Some(reason)) if !reason.is_transient() => Some(Judgement::OneChannel {
            faulty: Member::Peer,
            reason,
        }),
        (Some(reason), _) | (_, Some(reason)) => Some(Judgement::Waiting(reason)),
    }
}

/// The judgement on channels without an angle for too long, whatever their reasons.
fn lasting(own: &Reading, peer: &Reading) -> Judgement {
    match (reason(own), reason(peer)) {
        (Some(reason), None) => Judgement::OneChannel {
            faulty: Member::Own,
            reason,
        },
        (None, Some(reason)) => Judgement::OneChannel {
            faulty: Member::Peer,
            reason,
        },
        (Some(reason), Some(_)) => Judgement::NoChannel(reason),
        (None, None) => Judgement::Agree,
    }
}

/// A check with its state: what an instrument holds one of. The window alone is for recordings.
// An image has one of the two; a box is not to be had.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug)]
pub enum CrossCheck<C: Composition = Whole> {
    /// The paper's rule.
    Paper(PaperCheck, C::PaperRule),
    /// The product's ladder, and where there are gyroscopes the memory of their comparison.
    Product(ProductCheck, C::Ladder, Option<C::RateLadder>),
}

impl CrossCheck {
    /// The paper's rule, fresh.
    pub fn paper() -> Self {
        Self::Paper(PaperCheck::PAPER, PaperState::default())
    }

    /// The product's ladder, fresh.
    // Out of line: it is made in more than one place, and is large.
    #[inline(never)]
    pub fn product() -> Self {
        Self::ladder(ProductState::fresh())
    }
}

impl<C: Composition> CrossCheck<C> {
    /// The paper's rule, fresh; `None` where this instrument has none.
    pub fn by_paper() -> Option<Self> {
        let state = C::PaperRule::put(PaperState::default)?;
        Some(Self::Paper(PaperCheck::PAPER, state))
    }

    /// The product's ladder, fresh; `None` where this instrument has none.
    // Out of line: it is made in more than one place, and is large.
    #[inline(never)]
    pub fn by_ladder() -> Option<Self> {
        C::Ladder::put(ProductState::fresh).map(Self::ladder)
    }

    /// The product's ladder with this memory.
    pub fn ladder(state: C::Ladder) -> Self {
        Self::Product(
            ProductCheck::PRODUCT,
            state,
            C::RateLadder::put(RateState::fresh),
        )
    }

    /// Judges one pair taken at `now`.
    pub fn step(
        &mut self,
        own: impl Into<Observation>,
        peer: impl Into<Observation>,
        now: Instant,
    ) -> Verdict {
        self.judge(&own.into(), &peer.into(), now)
    }

    /// [`CrossCheck::step`] of what stays where it is.
    pub fn judge(&mut self, own: &Observation, peer: &Observation, now: Instant) -> Verdict {
        match self {
            Self::Paper(check, state) => {
                check.step(state.get_mut(), own.reading, peer.reading, now)
            }
            Self::Product(check, state, rates) => Verdict {
                own: own.reading,
                peer: peer.reading,
                judgement: check.judge((state.get_mut(), rates.as_mut()), own, peer, now),
            },
        }
    }

    /// Forgets everything, as a reset does.
    pub fn reset(&mut self) {
        match self {
            Self::Paper(_, state) => *state.get_mut() = PaperState::default(),
            Self::Product(_, state, rates) => {
                *state.get_mut() = ProductState::fresh();
                restart_rates::<C>(rates);
            }
        }
    }

    /// One channel's word on an instant has got lost on the way, so that what the other has heard
    /// since the instant before has nothing to be held against.
    pub fn pair_lost(&mut self) {
        if let Self::Product(_, state, rates) = self {
            state.get_mut().pair_lost();
            if let Some(rates) = rates {
                rates.get_mut().skip();
            }
        }
    }

    /// What was found and still counts, whatever the newest pair shows.
    pub fn found(&self) -> Option<Judgement> {
        match self {
            Self::Paper(_, state) => state.get().is_faulted().then_some(Judgement::PhysicalFault),
            Self::Product(_, state, _) => state.get().findings().judgement(),
        }
    }

    /// Why this channel is held faulty.
    pub fn own_fault(&self) -> Option<Invalid> {
        self.findings()?.faulty(Member::Own)
    }

    /// True while the channels differ and nobody is known to be the wrong one, even where one of
    /// them is held faulty for another reason.
    pub fn disagree(&self) -> bool {
        match self {
            Self::Product(_, state, _) => state.get().findings().disagree(),
            Self::Paper(..) => self.found().is_some(),
        }
    }

    /// True when the channels have agreed so that one may go on without the other.
    pub fn have_agreed(&self) -> bool {
        match self {
            Self::Paper(_, state) => state.get().has_agreed(),
            Self::Product(_, state, _) => state.get().findings().have_agreed(),
        }
    }

    /// True for what lasts until a reset, or as long as the [`Latch`] sets.
    pub fn is_latched(&self) -> bool {
        match self {
            Self::Product(_, state, _) => state.get().findings().is_latched(),
            Self::Paper(..) => self.found().is_some(),
        }
    }

    /// The product's findings; other checks have none.
    pub fn findings(&self) -> Option<&Findings> {
        match self {
            Self::Product(_, state, _) => Some(state.get().findings()),
            Self::Paper(..) => None,
        }
    }

    /// This channel was away, or its part has been set up anew: it has to agree with the peer
    /// again.
    pub fn own_away(&mut self) {
        match self {
            Self::Paper(_, state) => state.get_mut().forget_agreement(),
            Self::Product(_, state, rates) => {
                state.get_mut().own_away();
                restart_rates::<C>(rates);
            }
        }
    }

    /// This channel reports a fault of itself before the next pair.
    pub fn own_faulty(&mut self, reason: Invalid) {
        if let Self::Product(_, state, _) = self {
            let told = false;
            let against = findings::Against { reason, told };
            state.get_mut().findings_mut().hold(Member::Own, against);
        }
    }

    /// The peer has been started anew.
    pub fn peer_restarted(&mut self) {
        match self {
            Self::Paper(_, state) => state.get_mut().peer_away(),
            Self::Product(_, state, rates) => {
                state.get_mut().peer_restarted();
                restart_rates::<C>(rates);
            }
        }
    }

    /// The peer has announced that it is not OPERATIONAL. The product holds its silence against it
    /// all the same, since it names the channel and goes on with the other one.
    pub fn peer_away(&mut self) {
        if let Self::Paper(_, state) = self {
            state.get_mut().peer_away();
        }
    }

    /// Own minus peer, low-passed, 2^-26 g per step; zero where vectors are not compared.
    pub fn residual(&self) -> [i32; 3] {
        match self {
            Self::Product(_, state, _) => state.get().residual(),
            Self::Paper(..) => [0; 3],
        }
    }
}

/// One of two gyroscopes begins anew.
fn restart_rates<C: Composition>(rates: &mut Option<C::RateLadder>) {
    if let Some(rates) = rates {
        rates.get_mut().restart();
    }
}

#[cfg(test)]
mod movement_tests;
#[cfg(test)]
mod product_tests;
#[cfg(test)]
mod random_tests;
#[cfg(test)]
mod second_fault_tests;
#[cfg(test)]
mod standstill_tests;
#[cfg(test)]
mod starting_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod vibration_tests;
