//! The product's check: a ladder of tests, the surest first, and a memory of what was found.
//!
//! In: what both channels report of one instant ([`Observation`]). Out: a judgement that names the
//! faulty channel wherever physics allows it:
//!
//! 1. a channel that reports itself faulty and why (set-up, samples, stuck codes, silence);
//! 2. a channel too loud above 150 Hz, against itself and the other (`activity`);
//! 3. the difference of the two vectors (`residual`), which names nobody;
//! 4. the difference of the two angles (`window`), which names nobody either;
//! 5. of a pair that differs, the channel that moved while the other one stood (`movement`);
//! 6. at the next standstill, gravity (`standstill`) names the culprit of 3 and 4, if it can.
//!
//! Left out: how long what was found counts ([`Findings`]), and what the instrument does about it,
//! which is the device's.

use crate::chain::Invalid;
use crate::composition::Place;
use crate::observation::Observation;
use crate::vector::Corrected;
use instant::Instant;

use super::activity::{ActivityCheck, ActivityState};
use super::findings::{Against, Comparison, Evidence, Findings, Latch};
use super::movement::{Finding, Movement, MovementState};
use super::rates::{RateCheck, RateState};
use super::residual::{Residual, ResidualState};
use super::standstill::{self, Standstill, StandstillState};
use super::window::{WindowCheck, WindowState};
use super::{HEARD_US, Judgement, Member, PATIENCE_US, Silence, combined, reason};

/// Configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProductCheck {
    /// Noise and spikes.
    pub activity: ActivityCheck,
    /// Difference of the vectors.
    pub residual: Residual,
    /// Difference of the angles.
    pub window: WindowCheck,
    /// Who has moved alone.
    pub movement: Movement,
    /// Whose gravity is wrong.
    pub standstill: Standstill,
    /// Difference of the rates of turn, where there are gyroscopes.
    pub rates: RateCheck,
    /// How long a finding stays.
    pub latch: Latch,
}

impl ProductCheck {
    /// As delivered: latched until a reset.
    pub const PRODUCT: Self = Self {
        activity: ActivityCheck::PRODUCT,
        residual: Residual::PRODUCT,
        window: WindowCheck {
            latched: false,
            ..WindowCheck::PRODUCT
        },
        movement: Movement::PRODUCT,
        standstill: Standstill::PRODUCT,
        rates: RateCheck::PRODUCT,
        latch: Latch::UntilReset,
    };
}

/// The longest time between two pairs that averages are fed with, us; beyond, they start anew. A
/// master may send SYNC as seldom as every ten seconds.
const LONGEST_PAUSE_US: u32 = 11_000_000;

/// How long both channels together may go without an angle while shocks drive both over their
/// range, us: that is the machine's doing and accuses neither, but somebody has to be told at last.
const SHAKEN_PATIENCE_US: i64 = 10_000_000;

/// How long a channel that follows its gyroscope may look for the vertical, us: until the machine
/// has paused. Its samples come, so nothing is wrong with it that has to be told sooner.
const FOLLOWING_PATIENCE_US: i64 = 30_000_000;

/// What the check remembers. A reset is a new state.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProductState {
    activity: ActivityState,
    residual: ResidualState,
    window: WindowState,
    movement: MovementState,
    standstill: StandstillState,
    /// Own channel, then the peer.
    silence: [Silence; 2],
    /// When both were last over their range at once.
    both_over: Option<Instant>,
    before: Option<Instant>,
    findings: Findings,
}

impl ProductState {
    /// Nothing is remembered yet.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn fresh() -> Self {
        Self::default()
    }

    /// Own minus peer behind the longest low-pass, 2^-26 g per step, in the housing's axes.
    pub fn residual(&self) -> [i32; 3] {
        self.residual.difference()
    }

    /// What was found so far.
    pub const fn findings(&self) -> &Findings {
        &self.findings
    }

    /// What was found so far, for what is not shown by a pair.
    pub const fn findings_mut(&mut self) -> &mut Findings {
        &mut self.findings
    }

    /// This channel was away, or has been set up anew: it may have another calibration since, so
    /// what is averaged and the baseline begin anew.
    pub fn own_away(&mut self) {
        self.findings.own_away();
        self.restart();
        self.residual.begin_anew();
    }

    /// The peer has been started anew.
    pub fn peer_restarted(&mut self) {
        self.findings.peer_restarted();
        self.movement.restart();
    }

    /// There is no pair: what happened to a channel meanwhile is not known, so where it stood
    /// no longer counts.
    fn interrupt(&mut self) {
        self.activity.skip();
        self.movement.restart();
    }

    /// One of the two did not measure for a while, so what is averaged begins anew.
    fn restart(&mut self) {
        self.interrupt();
        self.activity.restart();
        self.residual.restart();
        self.window.interrupt();
    }

    /// A pair was lost on the way: what was heard at its instant stands alone.
    pub fn pair_lost(&mut self) {
        self.activity.skip();
    }

    /// How long a channel may go without an angle for a reason that passes.
    fn patience_us(&mut self, absent: [Option<Invalid>; 2], now: Instant) -> i64 {
        if absent == [Some(Invalid::OverRange); 2] {
            self.both_over = Some(now);
        }
        let shaken = |at: Instant| now.micros_since(at) < HEARD_US;
        if self.both_over.is_some_and(shaken) {
            SHAKEN_PATIENCE_US
        } else {
            PATIENCE_US
        }
    }
}

impl ProductState {
    /// What a missing angle shows against either channel, and the reason that is waited for;
    /// `measure` is what [`measures`] returns.
    fn miss(
        &mut self,
        absent: [Option<Invalid>; 2],
        measure: [bool; 2],
        now: Instant,
    ) -> ([Option<Against>; 2], Option<Invalid>) {
        let patience_us = self.patience_us(absent, now);
        let disagree = self.findings.disagree();
        let mut against = [None; 2];
        let mut waiting = None;
        let whys = absent.into_iter().zip(measure);
        let channels = self.silence.iter_mut().zip(whys).zip(&mut against);
        for (node, ((silence, (why, measures)), against)) in
            [Member::Own, Member::Peer].into_iter().zip(channels)
        {
            let mut lasts = || match measures {
                true => silence.follows_for(now, FOLLOWING_PATIENCE_US),
                false => silence.lasts_for(now, patience_us),
            };
            // Both begin anew for as long as they disagree: neither is looking for its vertical.
            match why.filter(|_| !(measures && disagree)) {
                None => silence.hear(now),
                Some(why) if why.is_transient() && !lasts() => {
                    waiting = Some(why);
                }
                Some(reason) => {
                    if !reason.is_transient() {
                        *silence = Silence::default();
                    }
                    let told = node == Member::Peer;
                    *against = Some(Against { reason, told });
                }
            }
        }
        (against, waiting)
    }

    /// There is nothing to compare. What is not heard has changed nothing: the difference of the
    /// two is averaged on where it was. A channel that stopped measuring may come back with
    /// another offset, and a shock takes its angle away for a moment only.
    fn lapse(&mut self, absent: [Option<Invalid>; 2]) {
        let mut reasons = absent.iter().flatten();
        if reasons.all(|why| why.is_unheard()) {
            self.interrupt();
            self.activity.restart();
            return self.window.interrupt();
        }
        let lasting = absent.iter().flatten().any(|why| !why.is_transient());
        if lasting {
            self.restart();
        } else {
            self.interrupt();
            self.residual.restart();
        }
    }
}

impl ProductCheck {
    /// Judges one pair taken at `now`.
    pub fn judge<R: Place<RateState>>(
        &self,
        (state, rates): (&mut ProductState, Option<&mut R>),
        own: &Observation,
        peer: &Observation,
        now: Instant,
    ) -> Judgement {
        let elapsed_us = pause(state.before.replace(now), now);
        let paused = elapsed_us == LONGEST_PAUSE_US;
        let absent = [reason(&own.reading), reason(&peer.reading)];
        let [a, b] = absent;
        let measure = [measures(a, own), measures(b, peer)];
        let (mut against, waiting) = state.miss(absent, measure, now);
        let (mut comparison, vectors) = if measure == [true; 2] {
            let angles = absent == [None, None];
            self.compare(state, own, peer, angles, &mut against, (now, elapsed_us))
        } else {
            state.lapse(absent);
            (Comparison::Absent, false)
        };
        if let Some(rates) = rates {
            let shaken = self.rings(&state.activity);
            let pair = [own, peer];
            let found = (self.rates).step(rates.get_mut(), pair, (vectors, shaken), elapsed_us);
            accuse(&mut against, found.loud.map(|node| (node, Invalid::Noise)));
            accuse(
                &mut against,
                found.contradicts.map(|node| (node, Invalid::Biased)),
            );
            if found.differ && comparison != Comparison::Absent {
                comparison = Comparison::Differ;
            }
        }
        let evidence = Evidence {
            against,
            measures: measure,
            comparison,
            elapsed_us: if paused { 0 } else { elapsed_us },
        };
        state.findings.take(&evidence, self.latch);
        let found = state.findings.judgement();
        let waiting = waiting.map(Judgement::Waiting);
        found.or(waiting).unwrap_or(Judgement::Agree)
    }

    /// True while a shock may be going through the machine, or what a part with a gyroscope keeps
    /// of it.
    fn rings(&self, activity: &ActivityState) -> bool {
        self.activity.is_shaken(activity) || activity.quiet_us() < self.rates.calm_us
    }

    /// Both channels measure: how they compare, and whether it is their vectors that differ.
    /// Without `angles` one of them looks for its vertical, and what is behind both is compared.
    // Out of line: the image is smaller.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn compare(
        &self,
        state: &mut ProductState,
        own: &Observation,
        peer: &Observation,
        angles: bool,
        against: &mut [Option<Against>; 2],
        (now, elapsed_us): (Instant, u32),
    ) -> (Comparison, bool) {
        if elapsed_us == LONGEST_PAUSE_US {
            state.restart();
        }
        let loud = self
            .activity
            .step(&mut state.activity, own.activity, peer.activity, elapsed_us);
        accuse(against, loud);
        let window = &mut state.window;
        let mut differ = if angles {
            let judged = self
                .window
                .compare(window, &own.reading, &peer.reading, now);
            judged == Judgement::Disagree
        } else {
            window.interrupt();
            false
        };
        let mut vectors = false;
        if let (Some(a), Some(b)) = (&own.vector, &peer.vector) {
            let shaken = self.activity.is_shaken(&state.activity);
            let mut uncertainty = uncertainty(own, peer);
            let (check, shaken) = match (own.turned, peer.turned) {
                (Some(_), Some(_)) => {
                    let shaken = self.rings(&state.activity);
                    if shaken {
                        uncertainty = uncertainty.max(self.rates.shaken);
                    }
                    (&self.rates.accelerations, shaken)
                }
                _ => (&self.residual, shaken),
            };
            let residual = &mut state.residual;
            vectors = check.step(residual, [a, b], uncertainty, shaken, elapsed_us);
            differ |= vectors;
            let culprit = self.weigh(state, [a, b], elapsed_us, (uncertainty, differ));
            accuse(against, culprit.map(|node| (node, Invalid::Biased)));
        }
        let comparison = if differ {
            Comparison::Differ
        } else if !angles {
            Comparison::Alike
        } else if state.window.exceeds() {
            Comparison::Excess
        } else {
            Comparison::Agree
        };
        (comparison, vectors)
    }

    /// The channel that moved alone is named, or the one whose gravity is wrong at a standstill,
    /// which is learned from while the pair agrees.
    fn weigh(
        &self,
        state: &mut ProductState,
        pair: [&Corrected; 2],
        elapsed_us: u32,
        (uncertainty, differ): (u32, bool),
    ) -> Option<Member> {
        let movement = &mut state.movement;
        let beyond = match self.movement.step(movement, pair, differ, elapsed_us)? {
            Finding::Moved(node) => return Some(node),
            Finding::Stood(beyond) => beyond,
        };
        if differ || state.findings.disagree() {
            let usual = standstill::along(state.residual.baseline(), pair);
            return self
                .standstill
                .blame(&state.standstill, beyond, usual, uncertainty);
        }
        if state.findings.judgement().is_none() {
            state.standstill.learn(beyond);
        }
        None
    }
}

/// True for a channel that measures, by why it has no angle: one that follows its gyroscope and
/// looks for its vertical does.
fn measures(why: Option<Invalid>, observation: &Observation) -> bool {
    match why {
        None => true,
        Some(Invalid::Settling | Invalid::NoSample) => observation.turned.is_some(),
        Some(_) => false,
    }
}

/// Notes what was found against a channel; gravity, which comes last, counts before noise.
fn accuse(against: &mut [Option<Against>; 2], found: Option<(Member, Invalid)>) {
    let Some((node, reason)) = found else { return };
    let [own, peer] = against;
    let place = match node {
        Member::Own => own,
        Member::Peer => peer,
    };
    *place = Some(Against {
        reason,
        told: false,
    });
}

/// Time since the pair before, stopping at [`LONGEST_PAUSE_US`].
fn pause(before: Option<Instant>, now: Instant) -> u32 {
    let elapsed = before.map_or(i64::MAX, |before| now.micros_since(before));
    u32::try_from(elapsed.max(0)).map_or(LONGEST_PAUSE_US, |us| us.min(LONGEST_PAUSE_US))
}

/// The pair's combined standard uncertainty as an acceleration, 2^-26 g per step.
///
/// An angle step is 2 pi / 2^32 rad, so 1 g away it is 2^26 times that: 0.098175 = 6434 / 65536.
fn uncertainty(own: &Observation, peer: &Observation) -> u32 {
    if let (Some(own), Some(_)) = (&own.turned, &peer.turned) {
        // Both are calibrated alike: the root of 2.
        return own.accel.saturating_add(own.accel / 5 * 2);
    }
    let axis = |a, b| combined(a, b).unwrap_or(0);
    let (own, peer) = (&own.reading, &peer.reading);
    // The smaller one: where an axis stands upright its angle is vague, and the vector is not.
    let (x, y) = (axis(&own.x, &peer.x), axis(&own.y, &peer.y));
    let angle = if x == 0 || y == 0 { x.max(y) } else { x.min(y) };
    u32::try_from((u64::from(angle) * 6434) >> 16).unwrap_or(u32::MAX)
}
