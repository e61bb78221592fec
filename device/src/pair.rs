//! The pair: the one state machine that determines whether an angle may be used.
//!
//! In: what both channels observed at each SYNC, leaving OPERATIONAL, restarts of either, and the
//! policy (2004h, 2005h). Out, derived at the instant at which it is read: the judgement, whether
//! this channel may be used, what may be shown of the peer, and the consent to safety frames.
//!
//! Nothing of what is read is stored, so no copy of it can lag behind. Stored are the memory of
//! the cross-check, the newest pair with its instant, the time between SYNCs, and whether the peer
//! has been heard. The states, the events and what is shown in each stand in docs/safety.md.
//!
//! An angle of this channel may be used
//! - while a pair that is younger than four and a half SYNCs shows no difference, or
//! - alone, while the peer is absent or held faulty, if the two have agreed for half a second
//!   since this channel was last away, have not differed since, and 2005h allows it;
//! - and never while the two disagree or this channel is held faulty.
//!
//! Left out: which observation of the peer belongs to which SYNC (`device::matching`), and how a
//! pair is judged (`tilt::cross_check`).

use instant::Instant;
use tilt::angle::{Angle, Axes};
use tilt::chain::{Invalid, Reading};
use tilt::composition::{Composition, Whole};
use tilt::cross_check::{CrossCheck, Judgement, Latch, Member, Verdict};
use tilt::observation::Observation;

use crate::presentation::{PeerPresentation, Presentation};

/// How long a pair counts once no new one comes, us: at least and at most so long.
const COUNTS_FOR_US: (u32, u32) = (400_000, 10_500_000);

/// What the user has decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Policy {
    /// How long a finding must be over, s; 0: until a reset (2004h).
    pub latch_s: u16,
    /// Whether this channel's angles may be used without the other one (2005h).
    pub may_go_on_alone: bool,
}

impl Policy {
    /// For how long the cross-check holds what it finds.
    pub const fn latch(self) -> Latch {
        match self.latch_s {
            0 => Latch::UntilReset,
            seconds => Latch::Healthy((seconds as u32).saturating_mul(1_000_000)),
        }
    }
}

/// The newest pair.
#[derive(Clone, Copy, Debug)]
struct Newest {
    verdict: Verdict,
    /// What it shows by itself, whatever was found before.
    shows: Judgement,
    /// When it was judged.
    at: Instant,
    /// How long it counts, us. It only becomes shorter: what has stopped to count does not begin
    /// again, however SYNC changes.
    counts_us: u32,
}

/// State of the pair, as one of its nodes has it.
#[derive(Clone, Debug)]
pub struct Pair<C: Composition = Whole> {
    newest: Option<Newest>,
    /// When SYNC was last obeyed.
    last_sync: Instant,
    /// Time between the SYNCs before, the newest first, us.
    periods_us: [u32; 2],
    /// The peer has been heard since this node became OPERATIONAL.
    heard: bool,
    /// How the peer shows its angles.
    shown: PeerPresentation,
    check: CrossCheck<C>,
}

/// Time from one instant to another, us; stops at 71 minutes.
fn between(from: Instant, to: Instant) -> u32 {
    u32::try_from(to.micros_since(from).max(0)).unwrap_or(u32::MAX)
}

/// The peer has not been heard yet, so it may still be starting.
const STARTING: Judgement = Judgement::Waiting(Invalid::Unconfirmed);

impl<C: Composition> Pair<C> {
    /// Nothing heard and nothing found.
    #[inline(never)]
    pub const fn new(check: CrossCheck<C>) -> Self {
        Self {
            newest: None,
            last_sync: Instant(0),
            periods_us: [0; 2],
            heard: false,
            shown: PeerPresentation::NONE,
            check,
        }
    }

    /// This node starts, at `now`: everything is forgotten.
    pub fn start(&mut self, now: Instant) {
        self.check.reset();
        self.newest = None;
        self.last_sync = now;
        self.periods_us = [0; 2];
        self.heard = false;
        self.shown = PeerPresentation::NONE;
    }

    const fn unhear(&mut self) {
        self.heard = false;
        self.shown.hear_anew();
    }

    /// Judges by another check from now on.
    pub fn set_check(&mut self, check: CrossCheck<C>) {
        self.check = check;
    }

    /// SYNC was obeyed at `now`.
    pub fn synchronised(&mut self, now: Instant) {
        let [newest, _] = self.periods_us;
        self.periods_us = [between(self.last_sync, now), newest];
        self.last_sync = now;
        let counts_us = self.counts_for_us();
        if let Some(newest) = &mut self.newest {
            newest.counts_us = newest.counts_us.min(counts_us);
        }
    }

    /// When SYNC was last obeyed.
    pub const fn last_sync(&self) -> Instant {
        self.last_sync
    }

    /// No SYNC is expected before `now`.
    pub const fn excuse_sync(&mut self, now: Instant) {
        self.last_sync = now;
    }

    /// The peer's exchange has come.
    pub const fn hear(&mut self) {
        self.heard = true;
    }

    /// A peer that has sent nothing: until it has been heard once, it may still be starting.
    pub const fn silence(&self) -> Observation {
        Observation::absent(if self.heard {
            Invalid::Silent
        } else {
            Invalid::Unconfirmed
        })
    }

    /// Compares how both nodes show their angles, by a byte of the peer's with its capture time.
    pub fn compare_shown(
        &mut self,
        piece: (u8, u8),
        own: Presentation,
        pair: [&Observation; 2],
        now: Instant,
    ) {
        self.shown.hear(piece, own, pair, now);
    }

    /// True when both nodes are set to show different angles.
    pub const fn is_shown_apart(&self) -> bool {
        self.shown.is_apart()
    }

    /// Judges at `now` what both channels observed at the SYNC of `at`.
    pub fn judge(
        &mut self,
        own: &Observation,
        peer: &Observation,
        (at, now): (Instant, Instant),
        policy: Policy,
    ) {
        if let CrossCheck::Product(check, ..) = &mut self.check {
            check.latch = policy.latch();
        }
        let verdict = self.check.judge(own, peer, at);
        let delta = verdict.delta();
        let compared = delta.x.is_some() || delta.y.is_some();
        // A miss that is not held against anybody yet proves nothing: the pair before it counts
        // for as long as it would have without.
        if !compared && verdict.judgement() == Judgement::Agree {
            return;
        }
        // What was found is told by the check for as long as it counts, and not by the pair.
        let shows = match self.check.found() {
            Some(_) => STARTING,
            None => verdict.judgement(),
        };
        self.newest = Some(Newest {
            verdict,
            shows,
            at: now,
            counts_us: self.counts_for_us(),
        });
    }

    /// The node leaves OPERATIONAL.
    pub fn leave(&mut self) {
        self.compare_anew();
        self.unhear();
    }

    /// This channel has to be compared again before its angles may be used: its sensor is set up
    /// anew.
    pub fn compare_anew(&mut self) {
        self.check.own_away();
        self.newest = None;
    }

    /// The peer has been started anew: what was held against it belongs to its life before.
    pub fn peer_restarted(&mut self) {
        self.check.peer_restarted();
        self.unhear();
    }

    /// The peer has announced that it is not OPERATIONAL.
    pub fn peer_away(&mut self) {
        self.check.peer_away();
    }

    /// This channel reports a fault of itself before the next SYNC.
    pub fn own_faulty(&mut self, reason: Invalid) {
        if self.check.own_fault().is_none() {
            self.check.own_faulty(reason);
        }
    }

    /// An observation of either channel was lost on the way.
    pub fn lost(&mut self) {
        self.check.pair_lost();
    }

    /// How long a pair counts: four SYNCs and a half, by the shorter of the last two times between
    /// SYNCs, so that one pause does not stretch it.
    fn counts_for_us(&self) -> u32 {
        let [a, b] = self.periods_us;
        let (least, most) = COUNTS_FOR_US;
        a.min(b)
            .min(most)
            .saturating_mul(9)
            .div_euclid(2)
            .clamp(least, most)
    }

    /// The newest pair, while it counts.
    fn current(&self, now: Instant) -> Option<&Newest> {
        let newest = self.newest.as_ref()?;
        (between(newest.at, now) <= newest.counts_us).then_some(newest)
    }

    /// The judgement; `None` when comparisons have not begun, or have stopped and nothing was
    /// found.
    pub fn judgement(&self, now: Instant) -> Option<Judgement> {
        let shown = || Some(self.current(now)?.shows);
        self.check.found().or_else(shown)
    }

    /// Why this channel is held faulty; the peer is told so instead of an angle.
    pub fn own_fault(&self) -> Option<Invalid> {
        self.check.own_fault()
    }

    /// True while the two differ and nobody is known to be the wrong one.
    pub fn disagree(&self) -> bool {
        self.check.disagree()
    }

    /// True while something stands that lasts as long as 2004h sets.
    pub fn is_latched(&self) -> bool {
        self.check.is_latched()
    }

    /// True while a fault stands that only a reset takes away, whatever 2004h sets.
    pub fn needs_reset(&self) -> bool {
        self.check.found() == Some(Judgement::PhysicalFault)
    }

    /// Whether this channel's angles may be used in OPERATIONAL, and why not.
    pub fn usable(&self, now: Instant, policy: Policy) -> Result<(), Invalid> {
        if let Some(reason) = self.own_fault() {
            return Err(reason);
        }
        if self.disagree() {
            return Err(Invalid::Refused);
        }
        match self.judgement(now) {
            None => Err(Invalid::Unconfirmed),
            Some(
                Judgement::Agree
                | Judgement::Warning
                | Judgement::StopMotion
                | Judgement::DataDelay,
            ) => Ok(()),
            Some(
                Judgement::Waiting(_)
                | Judgement::OneChannel {
                    faulty: Member::Peer,
                    ..
                },
            ) => self.alone(policy),
            Some(Judgement::OneChannel { reason, .. }) => Err(reason),
            Some(Judgement::Disagree | Judgement::PhysicalFault | Judgement::NoChannel(_)) => {
                Err(Invalid::Refused)
            }
        }
    }

    /// Whether this channel may go on without the other one.
    fn alone(&self, policy: Policy) -> Result<(), Invalid> {
        match (self.check.have_agreed(), policy.may_go_on_alone) {
            (false, _) => Err(Invalid::Unconfirmed),
            (true, false) => Err(Invalid::Alone),
            (true, true) => Ok(()),
        }
    }

    /// The cross-check with its memory, for looking at.
    pub const fn check(&self) -> &CrossCheck<C> {
        &self.check
    }

    /// When the two last agreed, if nothing speaks against safety frames since.
    pub fn agreed_at(&self) -> Option<Instant> {
        let newest = self.newest.as_ref()?;
        let agrees = matches!(newest.shows, Judgement::Agree | Judgement::DataDelay);
        (agrees && self.check.found().is_none()).then_some(newest.at)
    }

    /// What may be shown of the peer: nothing that cannot be trusted.
    pub fn peer(&self, now: Instant) -> Option<Reading> {
        match self.judgement(now) {
            _ if self.disagree() => None,
            Some(
                Judgement::Disagree
                | Judgement::PhysicalFault
                | Judgement::NoChannel(_)
                | Judgement::OneChannel {
                    faulty: Member::Peer,
                    ..
                },
            ) => None,
            _ => Some(self.current(now)?.verdict.peer()),
        }
    }

    /// This channel minus the peer, of each axis that was compared.
    pub fn difference(&self, now: Instant) -> Axes<Option<Angle>> {
        match self.current(now) {
            Some(newest) => newest.verdict.delta(),
            None => Axes { x: None, y: None },
        }
    }

    /// This channel's acceleration minus the peer's, low-passed, 2^-26 g per step.
    pub fn residual(&self) -> [i32; 3] {
        self.check.residual()
    }
}
