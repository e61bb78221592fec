//! The product's check: a ladder of tests, the surest first, and a memory of what was found.
//!
//! In: what both channels say of one instant ([`Observation`]). Out: a judgement that names the
//! faulty channel wherever physics allows it:
//!
//! 1. a channel that knows itself to be ill says why (set-up, samples, stuck codes, silence);
//! 2. a channel too loud above 150 Hz, against itself and the other (`activity`);
//! 3. the difference of the two vectors (`residual`), which names nobody;
//! 4. the difference of the two angles (`window`), which names nobody either;
//! 5. of a pair that differs, the channel that moved while the other one stood (`movement`);
//! 6. at the next standstill, gravity (`standstill`) names the culprit of 3 and 4, if it can.
//!
//! What was found stays according to a [`Latch`]: until a reset, or until the channel has been
//! sound for a while. A channel that was merely late or silent is taken back after one second in
//! either case, because nothing it measured was wrong.
//!
//! Left out: what the instrument does about it, which is the device's.

use crate::chain::Invalid;
use crate::observation::Observation;
use crate::sample::Instant;
use crate::vector::Corrected;

use super::activity::{self, Loudness};
use super::movement::{self, Finding, Movement};
use super::residual::{self, Residual};
use super::standstill::{self, Standstill};
use super::window::{WindowCheck, WindowState};
use super::{HEARD_US, Judgement, Node, PATIENCE_US, Silence, difference, reason};

/// How long something found stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Latch {
    /// Until the instrument is reset: somebody has to look.
    UntilReset,
    /// Until nothing of it has been seen for this many microseconds.
    Healthy(u32),
}

/// Configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProductCheck {
    /// Noise and spikes.
    pub loudness: Loudness,
    /// Difference of the vectors.
    pub residual: Residual,
    /// Difference of the angles.
    pub window: WindowCheck,
    /// Who has moved alone.
    pub movement: Movement,
    /// Whose gravity is wrong.
    pub standstill: Standstill,
    /// How long a finding stays.
    pub latch: Latch,
}

impl ProductCheck {
    /// As delivered: latched until a reset.
    pub const PRODUCT: Self = Self {
        loudness: Loudness::PRODUCT,
        residual: Residual::PRODUCT,
        window: WindowCheck {
            latched: false,
            ..WindowCheck::PRODUCT
        },
        movement: Movement::PRODUCT,
        standstill: Standstill::PRODUCT,
        latch: Latch::UntilReset,
    };
}

/// How long a channel that was late or silent has to be in time before it counts again.
pub const RECOVERY_US: i64 = 1_000_000;

/// The longest time between two pairs that averages are fed with, us; beyond, they start anew. A
/// master may send SYNC as seldom as every ten seconds.
const LONGEST_PAUSE_US: u32 = 11_000_000;

/// How long both channels together may go without an angle while shocks drive both over their
/// range, us: that is the machine's doing and accuses neither, but somebody has to be told at last.
const SHAKEN_PATIENCE_US: i64 = 10_000_000;

/// A finding, and when it was last seen.
#[derive(Clone, Copy, Debug)]
struct Held<T> {
    what: T,
    seen: Instant,
    /// The peer says it of itself, and holds it by its own latch.
    told: bool,
}

/// What the check remembers. A reset is a new state.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProductState {
    activity: activity::State,
    residual: residual::State,
    window: WindowState,
    movement: movement::State,
    standstill: standstill::State,
    /// Own channel, then the peer.
    silence: [Silence; 2],
    /// When both were last over their range at once.
    both_over: Option<Instant>,
    before: Option<Instant>,
    /// Own channel, then the peer.
    ill: [Option<Held<Invalid>>; 2],
    disagreement: Option<Held<()>>,
}

impl Held<Invalid> {
    /// True for what is over soon after it is no longer seen.
    const fn passes_with_its_cause(&self) -> bool {
        self.told || self.what.passes_with_its_cause()
    }
}

impl ProductState {
    /// Own minus peer behind the longest low-pass, 2^-26 g per step, in the housing's axes.
    pub fn residual(&self) -> [i32; 3] {
        self.residual.difference()
    }

    /// There is no pair, so whatever is averaged begins anew; what is usual does so after a
    /// `lasting` pause.
    fn interrupt(&mut self, lasting: bool) {
        self.activity.skip();
        self.residual.restart();
        self.movement.restart();
        if lasting {
            self.activity.restart();
            self.window.interrupt();
        }
    }

    /// A pair was lost on the way: what was heard at its instant stands alone.
    pub fn pair_lost(&mut self) {
        self.activity.skip();
    }

    /// The peer has been started anew: what it is held ill for belongs to its life before.
    pub fn peer_restarted(&mut self) {
        let [_, peer] = &mut self.ill;
        *peer = None;
        self.movement.restart();
    }

    fn accuse(&mut self, node: Node, reason: Invalid, now: Instant) {
        self.hold(node, reason, now, false);
    }

    fn hold(&mut self, node: Node, reason: Invalid, now: Instant, told: bool) {
        let [own, peer] = &mut self.ill;
        let place = match node {
            Node::Own => own,
            Node::Peer => peer,
        };
        self.disagreement = None;
        // A channel that falls silent after it was found wrong is still the wrong one.
        match place {
            Some(held) if !held.passes_with_its_cause() && told => {}
            Some(held) if !held.passes_with_its_cause() => held.seen = now,
            _ => {
                *place = Some(Held {
                    what: reason,
                    seen: now,
                    told,
                });
            }
        }
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

    fn accused(&self) -> bool {
        self.ill.iter().any(Option::is_some)
    }

    /// What is held, as a judgement.
    fn held(&self) -> Option<Judgement> {
        let one = |ill, reason| Some(Judgement::OneChannel { ill, reason });
        match self.ill.map(|held| held.map(|h| h.what)) {
            [Some(reason), Some(_)] => Some(Judgement::NoChannel(reason)),
            [Some(reason), None] => one(Node::Own, reason),
            [None, Some(reason)] => one(Node::Peer, reason),
            [None, None] => self.disagreement.map(|_| Judgement::Disagree),
        }
    }
}

impl ProductCheck {
    /// Judges one pair taken at `now`.
    pub fn judge(
        &self,
        state: &mut ProductState,
        own: &Observation,
        peer: &Observation,
        now: Instant,
    ) -> Judgement {
        self.release(state, now);
        let elapsed_us = pause(state.before.replace(now), now);
        let absent = [reason(own.reading), reason(peer.reading)];
        let patience_us = state.patience_us(absent, now);
        let mut waiting = None;
        for (node, why) in [Node::Own, Node::Peer].into_iter().zip(absent) {
            let [own, peer] = &mut state.silence;
            let silence = match node {
                Node::Own => own,
                Node::Peer => peer,
            };
            match why {
                None => silence.hear(now),
                Some(why) if why.is_transient() && !silence.lasts_for(now, patience_us) => {
                    waiting = Some(why);
                }
                Some(why) => {
                    if !why.is_transient() {
                        *silence = Silence::default();
                    }
                    state.hold(node, why, now, node == Node::Peer);
                }
            }
        }
        if absent == [None, None] {
            self.compare(state, own, peer, (now, elapsed_us));
        } else {
            // A shock takes the angle away for a moment only.
            let lasting = absent.iter().flatten().any(|why| !why.is_transient());
            state.interrupt(lasting);
        }
        let waiting = waiting.map(Judgement::Waiting);
        state.held().or(waiting).unwrap_or(Judgement::Agree)
    }

    /// Forgets what has been over for long enough.
    fn release(&self, state: &mut ProductState, now: Instant) {
        let latched = |seen: Instant| match self.latch {
            Latch::UntilReset => true,
            Latch::Healthy(us) => now.micros_since(seen) < i64::from(us),
        };
        for place in &mut state.ill {
            *place = place.filter(|held| {
                let recent = now.micros_since(held.seen) < RECOVERY_US;
                recent || !held.passes_with_its_cause() && latched(held.seen)
            });
        }
        let held = state.disagreement;
        state.disagreement = held.filter(|held| latched(held.seen));
    }

    /// Both channels measure.
    fn compare(
        &self,
        state: &mut ProductState,
        own: &Observation,
        peer: &Observation,
        (now, elapsed_us): (Instant, u32),
    ) {
        if elapsed_us == LONGEST_PAUSE_US {
            state.interrupt(true);
        }
        let loud = self
            .loudness
            .step(&mut state.activity, own.activity, peer.activity, elapsed_us);
        if let Some((node, reason)) = loud {
            state.accuse(node, reason, now);
        }
        let angles = self
            .window
            .compare(&mut state.window, own.reading, peer.reading, now);
        let mut differ = angles == Judgement::Disagree;
        let mut culprit = None;
        if let (Some(a), Some(b)) = (own.vector, peer.vector) {
            let uncertainty = uncertainty(own, peer);
            let shaken = self.loudness.is_shaken(&state.activity);
            let residual = &mut state.residual;
            differ |= (self.residual).step(residual, [a, b], uncertainty, shaken, elapsed_us);
            culprit = self.weigh(state, [a, b], elapsed_us, (uncertainty, differ));
        }
        self.differ(state, differ, culprit, now);
    }

    /// The channel that moved alone is named, or the one whose gravity is wrong at a standstill,
    /// which is learned from while the pair agrees.
    fn weigh(
        &self,
        state: &mut ProductState,
        pair: [Corrected; 2],
        elapsed_us: u32,
        (uncertainty, differ): (u32, bool),
    ) -> Option<Node> {
        let movement = &mut state.movement;
        let beyond = match self.movement.step(movement, pair, differ, elapsed_us)? {
            Finding::Moved(node) => return Some(node),
            Finding::Stood(beyond) => beyond,
        };
        if differ || state.disagreement.is_some() {
            let usual = standstill::along(state.residual.usual(), pair);
            return self
                .standstill
                .blame(&state.standstill, beyond, usual, uncertainty);
        }
        if !state.accused() {
            state.standstill.learn(beyond);
        }
        None
    }

    fn differ(&self, state: &mut ProductState, differ: bool, culprit: Option<Node>, now: Instant) {
        if let Some(node) = culprit {
            return state.accuse(node, Invalid::Biased, now);
        }
        if !differ {
            return;
        }
        // A channel already known as ill explains the difference.
        let mut accused = false;
        for held in state.ill.iter_mut().flatten() {
            accused = true;
            if !held.passes_with_its_cause() {
                held.seen = now;
            }
        }
        if !accused {
            state.disagreement = Some(Held {
                what: (),
                seen: now,
                told: false,
            });
        }
    }
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
    let axis = |a, b| difference(a, b).map_or(0, |(_, combined)| combined);
    let (own, peer) = (own.reading, peer.reading);
    // The smaller one: where an axis stands upright its angle is vague, and the vector is not.
    let (x, y) = (axis(own.x, peer.x), axis(own.y, peer.y));
    let angle = if x == 0 || y == 0 { x.max(y) } else { x.min(y) };
    u32::try_from((u64::from(angle) * 6434) >> 16).unwrap_or(u32::MAX)
}
