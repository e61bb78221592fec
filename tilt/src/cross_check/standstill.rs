//! Standstill: the one moment at which gravity itself tells which of two channels is wrong.
//!
//! In: both channels' angles and vectors, pair by pair. Out: at the end of each second of strict
//! standstill, how long each vector was. A healthy vector is 1 g long at every pose, so of two
//! channels that differ, the one whose length is off is the wrong one: as far as the error lies
//! along gravity. An error across gravity (the offset of X at level) leaves the length alone,
//! and then nobody is named.
//!
//! The gate is strict because a moving machine changes the length too: a norm test without it
//! blames the wrong channel more often than not while digging.
//!
//! The true length is the local gravity, which differs from standard gravity by up to 0.27 % on
//! the ground. Each channel's length is therefore measured against its own baseline, learned at
//! standstills at which the pair agrees and held within [`BASELINE_LIMIT`].
//!
//! Left out: the self-test, which takes the channel away for 0.7 s and does not see an offset.

use crate::saturate::saturate;
use crate::vector::Corrected;

use super::Member;
use super::gravity::dot;

/// Configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Standstill {
    /// The two lengths must differ by at least this much more than usual before either is blamed,
    /// 2^-26 g.
    pub least: u32,
    /// As long as local gravity has not been learned nobody is blamed beside a channel whose
    /// length is farther from 1 g, 2^-26 g.
    pub unlearned: u32,
}

/// A thousandth of g in 2^-26 g.
const MG: u32 = 67_109;

/// How far a channel's baseline may be from standard gravity: local gravity (2.7 mg) and the
/// calibration's own error.
pub const BASELINE_LIMIT: i32 = 4 * MG as i32;

/// A baseline that was learned more often follows each standstill by an eighth.
const LEARNED: u8 = 7;

impl Standstill {
    /// Lengths that differ by 2 mg more than usual tell.
    pub const PRODUCT: Self = Self {
        least: 2 * MG,
        unlearned: MG,
    };
}

/// What the detector remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct StandstillState {
    /// What each channel's length usually is beyond standard gravity, 2^-26 g.
    baseline: [i32; 2],
    /// How often that was learned.
    learned: u8,
}

impl StandstillState {
    /// The pair agrees: lengths `beyond` 1 g as they are now are what they should be. The first
    /// standstills count by their number, later ones by an eighth.
    pub fn learn(&mut self, beyond: [i32; 2]) {
        let times = self.learned.min(LEARNED) + 1;
        self.learned = times;
        for (baseline, beyond) in self.baseline.iter_mut().zip(&beyond) {
            let learned = *baseline + beyond.saturating_sub(*baseline) / i32::from(times);
            *baseline = learned.clamp(-BASELINE_LIMIT, BASELINE_LIMIT);
        }
    }
}

impl Standstill {
    /// Which channel the lengths `beyond` 1 g speak against; `None` where they do not tell.
    ///
    /// `usual` is by how much more the own one is longer than the peer's in this pose while they
    /// agree, and `uncertainty` the combined standard uncertainty of the pair; all 2^-26 g.
    pub fn blame(
        &self,
        state: &StandstillState,
        beyond: [i32; 2],
        usual: i32,
        uncertainty: u32,
    ) -> Option<Member> {
        let ([own, peer], [own_baseline, peer_baseline]) = (beyond, state.baseline);
        let apart = own.saturating_sub(peer).saturating_sub(usual);
        let size = apart.unsigned_abs();
        if size < self.least.max(uncertainty.saturating_mul(2)) {
            return None;
        }
        let own = own.saturating_sub(own_baseline);
        let peer = peer.saturating_sub(peer_baseline);
        // One channel off alone has all of the difference, and the sum is as large.
        let sum = own.saturating_add(peer);
        if sum.unsigned_abs() < size / 2 {
            return None;
        }
        let (node, sound) = if (sum > 0) == (apart > 0) {
            (Member::Own, peer)
        } else {
            (Member::Peer, own)
        };
        let right = self.unlearned.max(uncertainty);
        (state.learned > 0 || sound.unsigned_abs() <= right).then_some(node)
    }
}

/// The part of `difference` that lies along the mean of a pair's vectors, which are about 1 g
/// long, 2^-26 g. The peer, to whom the pair comes in the other order, comes to the same part.
pub fn along(difference: [i32; 3], [own, peer]: [&Corrected; 2]) -> i32 {
    let twice = dot(&difference, &own.accel).saturating_add(dot(&difference, &peer.accel));
    let part = twice / (1 << 27);
    saturate(part)
}
