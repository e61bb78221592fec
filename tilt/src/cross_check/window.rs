//! The angle window: two angles may differ by a threshold that follows their uncertainty.
//!
//! In: both readings of one instant. Out: a judgement. An excess must last before it is a fault,
//! and a channel that reports itself faulty is named at once.
//!
//! Left out: everything that is not in the two angles (`product`).

use super::{Judgement, One, Silence, THRESHOLD, Verdict, apart, combined, faulty, lasting};
use crate::angle::Angle;
use crate::chain::Reading;
use instant::Instant;

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

impl WindowState {
    /// There is no pair: an excess that lasts must begin anew.
    pub(super) fn interrupt(&mut self) {
        self.excess_since = None;
    }

    /// True while the two angles are further apart than they may be, for however short a time.
    pub(super) const fn exceeds(&self) -> bool {
        self.excess_since.is_some()
    }
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
        let judgement = match faulty(&own, &peer) {
            Some(Judgement::Waiting(_)) if state.silence.lasts(now) => lasting(&own, &peer),
            Some(judgement) => judgement,
            None => {
                state.silence.hear(now);
                self.compare(state, &own, &peer, now)
            }
        };
        Verdict {
            own,
            peer,
            judgement,
        }
    }

    /// The comparison of two channels that both measure.
    pub(super) fn compare(
        &self,
        state: &mut WindowState,
        own: &Reading,
        peer: &Reading,
        now: Instant,
    ) -> Judgement {
        if state.disagreed && self.latched {
            return Judgement::Disagree;
        }
        if !self.exceeds(&own.x, &peer.x) && !self.exceeds(&own.y, &peer.y) {
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

    pub(super) fn exceeds(&self, own: &One, peer: &One) -> bool {
        // What one of the two does not measure can't be compared.
        if own.is_ok() != peer.is_ok() {
            return true;
        }
        let beyond = |delta: &Angle| delta.magnitude() > self.threshold;
        // The uncertainty, which takes a root, is asked for only where it decides.
        let delta = apart(own, peer).ok().filter(beyond);
        let allowed = |uncertainty: u32| uncertainty.saturating_mul(self.coverage);
        delta
            .zip(combined(own, peer))
            .is_some_and(|(delta, uncertainty)| delta.magnitude() > allowed(uncertainty))
    }
}
