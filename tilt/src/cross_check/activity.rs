//! Noise and spikes: the energy above 150 Hz of each channel, against its own level and the
//! other's.
//!
//! In: what each channel says of its energy since the pair before ([`Activity`], which counts in
//! units of that channel's own noise). Out: the channel that is louder than it should be, and
//! how. Nothing a machine does reaches above 150 Hz in one channel only, so what both hear
//! accuses nobody: a shock, a resonance, an engine.
//!
//! The two look at the same times but sample at different ones, so an event that begins near the
//! end of one look may stand in the next one of the other channel. For noise a single look
//! therefore counts up to a ceiling only, and three make a verdict; a spike is judged when the
//! look after it has come, and only between quiet ones. Looks at which the other channel is loud
//! don't count at all.
//!
//! Left out: what happens below 150 Hz (`residual`).

use crate::chain::Invalid;
use crate::health::Activity;

use super::Node;

/// Configuration; energies are ratios to the channel's own noise, in 1/256.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Loudness {
    /// A channel below this is quiet; above it, it may hear the machine.
    pub quiet: u32,
    /// A single look above this, between quiet ones, is a spike.
    pub spike: u32,
    /// The mean of the last three looks above this many times the other's usual level is noise.
    pub fast: u32,
    /// A look counts up to this in that mean.
    pub ceiling: u32,
    /// A channel's usual level above this many times the other's is noise too.
    pub slow: u32,
    /// Time constant of the usual level, us.
    pub slow_us: u32,
}

impl Loudness {
    /// For a LIS2DW12 at 400 samples/s, looked at 50 times a second: eight samples a look, of
    /// which a healthy channel's energies scatter by half. `docs/faults.md` has the evidence.
    pub const PRODUCT: Self = Self {
        quiet: 5 * 256,
        spike: 60 * 256,
        fast: 1664,
        ceiling: 16 * 256,
        slow: 3 * 256,
        slow_us: 250_000,
    };
}

/// One channel's energies: the last three looks, newest first, and the usual level.
#[derive(Clone, Copy, Debug)]
struct Channel {
    looks: [u32; 3],
    usual: u32,
}

/// A look of which nothing is known counts as loud, so that nobody is judged by it.
const UNKNOWN: u32 = u32::MAX;

/// The level of healthy noise.
const OWN_LEVEL: u32 = 256;

impl Channel {
    const NEW: Self = Self {
        looks: [UNKNOWN; 3],
        usual: OWN_LEVEL,
    };

    fn push(&mut self, energy: u32) {
        let [a, b, _] = self.looks;
        self.looks = [energy, a, b];
    }

    fn loudest(&self) -> u32 {
        self.looks.iter().copied().fold(0, u32::max)
    }

    fn mean(&self, ceiling: u32) -> u32 {
        let looks = self.looks.iter();
        looks.fold(0, |sum: u32, look| sum.saturating_add(*look.min(&ceiling))) / 3
    }

    fn is_spike(&self, check: &Loudness) -> bool {
        let [after, middle, before] = self.looks;
        middle > check.spike && before < check.quiet && after < check.quiet
    }
}

/// An exponential average.
fn towards(average: u32, value: u32, tau_us: u32, elapsed_us: u32) -> u32 {
    let whole = u64::from(tau_us)
        .saturating_add(u64::from(elapsed_us))
        .max(1);
    let kept = u64::from(average) * u64::from(tau_us);
    let added = u64::from(value) * u64::from(elapsed_us);
    u32::try_from(kept.saturating_add(added) / whole).unwrap_or(u32::MAX)
}

/// What the detector remembers of both channels.
#[derive(Clone, Copy, Debug)]
pub struct State {
    channels: [Channel; 2],
    /// Which of them has had a look since the last judgement.
    fresh: [bool; 2],
    /// Time since then, us.
    elapsed_us: u32,
}

impl Default for State {
    fn default() -> Self {
        Self {
            channels: [Channel::NEW; 2],
            fresh: [false; 2],
            elapsed_us: 0,
        }
    }
}

impl State {
    /// A pair was missing, or one of the two could not measure: its look is not known.
    pub fn skip(&mut self) {
        for channel in &mut self.channels {
            channel.push(UNKNOWN);
        }
    }
}

impl Loudness {
    /// Takes in what both channels say; who is too loud, and how.
    ///
    /// [`Activity::NONE`] is no look: too few samples since the last one. The two are judged when
    /// both have had a look, because what the one has heard may still be coming from the other.
    pub fn step(
        &self,
        state: &mut State,
        own: Activity,
        peer: Activity,
        elapsed_us: u32,
    ) -> Option<(Node, Invalid)> {
        let channels = state.channels.iter_mut().zip(&mut state.fresh);
        for ((channel, fresh), activity) in channels.zip([own, peer]) {
            if activity != Activity::NONE {
                channel.push(activity.energy_q8());
                *fresh = true;
            }
        }
        state.elapsed_us = state.elapsed_us.saturating_add(elapsed_us);
        if state.fresh != [true; 2] {
            return None;
        }
        state.fresh = [false; 2];
        let elapsed_us = core::mem::take(&mut state.elapsed_us);
        let [a, b] = &mut state.channels;
        let of_own = self.judge(a, b, elapsed_us);
        let of_peer = self.judge(b, a, elapsed_us);
        let blame = |node| move |reason| (node, reason);
        of_own
            .map(blame(Node::Own))
            .or(of_peer.map(blame(Node::Peer)))
    }

    fn judge(&self, one: &mut Channel, other: &Channel, elapsed_us: u32) -> Option<Invalid> {
        if other.loudest() > self.quiet || one.loudest() == UNKNOWN {
            return None;
        }
        if one.is_spike(self) {
            return Some(Invalid::Spikes);
        }
        let mean = one.mean(self.ceiling);
        one.usual = towards(one.usual, mean, self.slow_us, elapsed_us);
        let others = u64::from(other.usual.max(OWN_LEVEL));
        let exceeds = |mine: u32, ratio: u32| u64::from(mine) << 8 > others * u64::from(ratio);
        // A shock that fades out is heard by both, and by one of them longer.
        let alone = u64::from(mean) > 3 * u64::from(other.mean(self.ceiling));
        let noisy = alone && exceeds(mean, self.fast) || exceeds(one.usual, self.slow);
        noisy.then_some(Invalid::Noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Feeds looks of both channels, 20 ms apart; the first verdict and its look.
    fn listen(looks: impl IntoIterator<Item = (u8, u8)>) -> Option<(usize, Node, Invalid)> {
        let mut state = State::default();
        for (n, (own, peer)) in looks.into_iter().enumerate() {
            let (own, peer) = (Activity(own), Activity(peer));
            let verdict = Loudness::PRODUCT.step(&mut state, own, peer, 20_000);
            if let Some((node, reason)) = verdict {
                return Some((n, node, reason));
            }
        }
        None
    }

    /// `n` looks at both channels' own noise, then what follows.
    fn after_quiet(n: usize, then: &[(u8, u8)]) -> Option<(usize, Node, Invalid)> {
        listen(std::iter::repeat_n((64, 64), n).chain(then.iter().copied()))
    }

    #[test]
    fn what_both_hear_accuses_nobody() {
        let shock = [(150, 90), (160, 150), (90, 150), (64, 80), (64, 64)];
        assert_eq!(after_quiet(5, &shock), None);
        let begun_in_one_look_only = [(200, 64), (64, 200), (64, 64), (64, 64)];
        assert_eq!(after_quiet(5, &begun_in_one_look_only), None);
        assert_eq!(listen(std::iter::repeat_n((110, 110), 1000)), None);
    }

    #[test]
    fn a_lone_loud_look_is_a_spike_of_its_channel() {
        let own = after_quiet(5, &[(140, 64), (64, 64), (64, 64)]);
        assert_eq!(own, Some((6, Node::Own, Invalid::Spikes)));
        let peer = after_quiet(5, &[(64, 140), (64, 64), (64, 64)]);
        assert_eq!(peer, Some((6, Node::Peer, Invalid::Spikes)));
    }

    #[test]
    fn three_times_the_noise_is_found_within_four_looks_and_twice_within_a_second() {
        let (n, node, reason) = after_quiet(5, &[(89, 64); 10]).expect("found");
        assert_eq!((node, reason), (Node::Own, Invalid::Noise));
        assert!((6..9).contains(&n), "{n}");
        let (n, node, reason) = after_quiet(5, &[(64, 80); 50]).expect("found");
        assert_eq!((node, reason), (Node::Peer, Invalid::Noise));
        assert!(n < 45, "{n}");
    }

    #[test]
    fn looks_that_are_not_known_judge_nobody() {
        let mut state = State::default();
        for _ in 0..100 {
            state.skip();
            let verdict = Loudness::PRODUCT.step(&mut state, Activity(255), Activity(64), 20_000);
            assert_eq!(verdict, None);
        }
        for _ in 0..100 {
            let verdict = Loudness::PRODUCT.step(&mut state, Activity(0), Activity(64), u32::MAX);
            assert_eq!(verdict, None);
        }
    }

    #[test]
    fn a_shock_that_the_other_had_not_told_yet_was_called_noise() {
        let shock = [(64, 64), (150, 0), (150, 160), (64, 64), (64, 64), (64, 64)];
        assert_eq!(after_quiet(5, &shock), None);
    }
}
