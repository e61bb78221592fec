//! Noise and spikes: the energy above 150 Hz of each channel, against its own level and the
//! other's.
//!
//! In: what each channel reports of its energy since the pair before ([`Activity`], which counts in
//! units of that channel's own noise). Out: the channel that is louder than it should be, and
//! how. Nothing a machine does reaches above 150 Hz in one channel only, so what both hear
//! accuses nobody: a shock, a resonance, an engine.
//!
//! The two look at the same times but sample at different ones, so an event that begins near the
//! end of one look may stand in the next one of the other channel. For noise a single look
//! therefore counts up to a ceiling only, and four make a verdict; a spike, which may stand in two
//! looks, is judged when the look after it has come, and only between quiet ones. While the other
//! channel is loud nobody is judged.
//!
//! Of a weak, steady vibration both channels measure about the same, but each look scatters by
//! half: now and then one look is low where the other channel's is high. A channel is therefore
//! held against what the other one has measured in the same looks, never against quiet ones that
//! were chosen.
//!
//! Left out: what happens below 150 Hz (`residual`).

use crate::chain::Invalid;
use crate::health::Activity;

use super::Member;

/// Configuration; energies are ratios to the channel's own noise, in 1/256.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActivityCheck {
    /// A channel below this is quiet; above it, it may hear the machine.
    pub quiet: u32,
    /// A single look above this, or two together, between quiet ones, are a spike.
    pub spike: u32,
    /// The mean of the last four looks above this many times the other's, and of its level, is
    /// noise.
    pub fast: u32,
    /// ... when the two quieter ones of the last three have a mean above this as well.
    pub two: u32,
    /// A look counts up to this in that mean.
    pub ceiling: u32,
    /// A channel's level above this many times the other's is noise too.
    pub slow: u32,
    /// Time constant of the level, us.
    pub slow_us: u32,
    /// The machine is calm again when neither channel has been loud for this long, us.
    pub calm_us: u32,
}

impl ActivityCheck {
    /// For a LIS2DW12 at 400 samples/s, looked at 50 times a second: eight samples a look, of
    /// which a healthy channel's energies scatter by half. `docs/faults.md` has the evidence.
    pub const PRODUCT: Self = Self {
        quiet: 5 * 256,
        spike: 60 * 256,
        fast: 1152,
        two: 1152,
        ceiling: 16 * 256,
        slow: 3 * 256,
        slow_us: 250_000,
        calm_us: 80_000,
    };
}

/// One channel's energies: the last four looks, newest first, and the level.
#[derive(Clone, Copy, Debug)]
struct ChannelActivity {
    looks: [u32; 4],
    /// The average of all looks that are known, each up to [`ActivityCheck::quiet`]: a steady
    /// vibration is in it, and a shock hardly.
    level: u32,
}

/// A look of which nothing is known counts as loud, so that nobody is judged by it.
const UNKNOWN: u32 = u32::MAX;

/// The level of healthy noise.
const OWN_LEVEL: u32 = 256;

impl ChannelActivity {
    const NEW: Self = Self {
        looks: [UNKNOWN; 4],
        level: OWN_LEVEL,
    };

    fn push(&mut self, energy: u32) {
        let [a, b, c, _] = self.looks;
        self.looks = [energy, a, b, c];
    }

    fn loudest(&self) -> u32 {
        self.looks.iter().copied().fold(0, u32::max)
    }

    fn mean(&self, ceiling: u32) -> u32 {
        let looks = self.looks.iter();
        looks.fold(0, |sum: u32, look| sum.saturating_add(*look.min(&ceiling))) / 4
    }

    /// The mean of the two quieter ones of the last three looks.
    fn quieter_two(&self) -> u32 {
        let [a, b, c, _] = self.looks;
        let (less, more) = (a.min(b), a.max(b));
        less.min(c).midpoint(more.min(less.max(c)))
    }

    fn is_spike(&self, check: &ActivityCheck) -> bool {
        let [after, second, first, before] = self.looks;
        let alone = second > check.spike && first < check.quiet;
        let in_two = second.saturating_add(first) > check.spike && before < check.quiet;
        after < check.quiet && (alone || in_two)
    }
}

/// What a channel has heard so far, and what it has heard since.
fn joined(before: Option<u32>, activity: Activity) -> u32 {
    let energy = activity.energy_q8();
    match before {
        _ if activity == Activity::GAP => UNKNOWN,
        Some(UNKNOWN) => UNKNOWN,
        Some(before) => before.midpoint(energy),
        None => energy,
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
pub struct ActivityState {
    channels: [ChannelActivity; 2],
    /// What each has heard since the last judgement, until both have had a look.
    heard: [Option<u32>; 2],
    /// Time since then, us.
    elapsed_us: u32,
    /// For how long no shock has been heard, us.
    quiet_us: u32,
    /// One of the two has just become loud: the next look will show whether it was a shock.
    pending: bool,
}

impl Default for ActivityState {
    fn default() -> Self {
        Self {
            channels: [ChannelActivity::NEW; 2],
            heard: [None; 2],
            elapsed_us: 0,
            quiet_us: 0,
            pending: false,
        }
    }
}

impl ActivityState {
    /// One of the two could not measure: nothing is known of what they heard meanwhile, and what
    /// was usual may have changed.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// For how long no shock has been heard, us.
    pub const fn quiet_us(&self) -> u32 {
        self.quiet_us
    }

    /// A pair was missing: its look is not known.
    pub fn skip(&mut self) {
        for channel in &mut self.channels {
            channel.push(UNKNOWN);
        }
        self.heard = [None; 2];
        self.quiet_us = 0;
    }
}

impl ActivityCheck {
    /// Takes in what both channels report; who is too loud, and how.
    ///
    /// [`Activity::NONE`] is no look: too few samples since the last one. The two are judged when
    /// both have had a look, because what the one has heard may still be coming from the other;
    /// what one of them has reported meanwhile counts as a single look, or the other's would
    /// reach further back.
    pub fn step(
        &self,
        state: &mut ActivityState,
        own: Activity,
        peer: Activity,
        elapsed_us: u32,
    ) -> Option<(Member, Invalid)> {
        for (heard, activity) in state.heard.iter_mut().zip([own, peer]) {
            if activity != Activity::NONE {
                *heard = Some(joined(*heard, activity));
            }
        }
        state.elapsed_us = state.elapsed_us.saturating_add(elapsed_us);
        let [Some(of_own), Some(of_peer)] = state.heard else {
            return None;
        };
        state.heard = [None; 2];
        let elapsed_us = core::mem::take(&mut state.elapsed_us);
        let [a, b] = &mut state.channels;
        a.push(of_own);
        b.push(of_peer);
        let shock = self.was_shock(a, b) || self.was_shock(b, a);
        let quiet_us = state.quiet_us.saturating_add(elapsed_us);
        state.quiet_us = if shock { 0 } else { quiet_us };
        state.pending = self.is_new(a) || self.is_new(b);
        // Both learn before either is judged, so that both nodes judge alike.
        self.learn(a, elapsed_us);
        self.learn(b, elapsed_us);
        let (of_own, of_peer) = (self.judge(a, b), self.judge(b, a));
        let blame = |node| move |reason| (node, reason);
        of_own
            .map(blame(Member::Own))
            .or(of_peer.map(blame(Member::Peer)))
    }

    /// True while a shock may be going through the machine, or what the filters have left of it;
    /// between two looks that is not known.
    pub fn is_shaken(&self, state: &ActivityState) -> bool {
        let between_looks = state.elapsed_us > 0;
        between_looks || state.pending || state.quiet_us < self.calm_us
    }

    /// True when what made `one` loud in the look before the last was heard by the other as well,
    /// in that look or in one beside it.
    fn was_shock(&self, one: &ChannelActivity, other: &ChannelActivity) -> bool {
        let [_, middle, ..] = one.looks;
        let [a, b, c, _] = other.looks;
        middle > self.quiet && a.max(b).max(c) > self.quiet / 2
    }

    /// True when `one` has become loud in the last look, or nothing is known of that.
    fn is_new(&self, one: &ChannelActivity) -> bool {
        let [newest, before, ..] = one.looks;
        newest == UNKNOWN || newest > self.quiet && before <= self.quiet
    }

    /// True while what `one` reports can be held against it.
    fn is_clear(&self, one: &ChannelActivity, other: &ChannelActivity) -> bool {
        other.loudest() <= self.quiet && one.loudest() != UNKNOWN
    }

    fn learn(&self, one: &mut ChannelActivity, elapsed_us: u32) {
        let [newest, ..] = one.looks;
        if newest != UNKNOWN {
            one.level = towards(one.level, newest.min(self.quiet), self.slow_us, elapsed_us);
        }
    }

    fn judge(&self, one: &ChannelActivity, other: &ChannelActivity) -> Option<Invalid> {
        if !self.is_clear(one, other) {
            return None;
        }
        if one.is_spike(self) {
            return Some(Invalid::Spikes);
        }
        let others = other.mean(self.ceiling).max(other.level).max(OWN_LEVEL);
        let exceeds =
            |mine: u32, ratio: u32| u64::from(mine) << 8 > u64::from(others) * u64::from(ratio);
        // A shock that fades out is heard by both, and by one of them longer. Nor does a single
        // look make noise, since a shock may begin at the end of one.
        let fast = one.quieter_two() > self.two;
        let noisy =
            fast && exceeds(one.mean(self.ceiling), self.fast) || exceeds(one.level, self.slow);
        noisy.then_some(Invalid::Noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Feeds looks of both channels, 20 ms apart; the first verdict and its look.
    fn listen(looks: impl IntoIterator<Item = (u8, u8)>) -> Option<(usize, Member, Invalid)> {
        let mut state = ActivityState::default();
        for (n, (own, peer)) in looks.into_iter().enumerate() {
            let (own, peer) = (Activity(own), Activity(peer));
            let verdict = ActivityCheck::PRODUCT.step(&mut state, own, peer, 20_000);
            if let Some((node, reason)) = verdict {
                return Some((n, node, reason));
            }
        }
        None
    }

    /// `n` looks at both channels' own noise, then what follows.
    fn after_quiet(n: usize, then: &[(u8, u8)]) -> Option<(usize, Member, Invalid)> {
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
        assert_eq!(own, Some((6, Member::Own, Invalid::Spikes)));
        let peer = after_quiet(5, &[(64, 140), (64, 64), (64, 64)]);
        assert_eq!(peer, Some((6, Member::Peer, Invalid::Spikes)));
    }

    #[test]
    fn a_spike_across_two_looks_is_a_spike_of_its_channel() {
        for (first, second) in [(140, 70), (110, 120), (90, 140), (140, 90), (111, 111)] {
            let looks = [(first, 64), (second, 64), (64, 64), (64, 64)];
            let found = after_quiet(5, &looks).map(|(_, member, _)| member);
            assert_eq!(found, Some(Member::Own), "{first} {second}");
            let of_both = looks.map(|(own, _)| (own, own));
            assert_eq!(after_quiet(5, &of_both), None, "{first} {second}");
        }
    }

    #[test]
    fn three_times_the_noise_is_found_within_four_looks_and_twice_within_a_second() {
        let (n, node, reason) = after_quiet(5, &[(89, 64); 10]).expect("found");
        assert_eq!((node, reason), (Member::Own, Invalid::Noise));
        assert!((6..9).contains(&n), "{n}");
        let (n, node, reason) = after_quiet(5, &[(64, 80); 50]).expect("found");
        assert_eq!((node, reason), (Member::Peer, Invalid::Noise));
        assert!(n < 45, "{n}");
    }

    #[test]
    fn the_machine_counts_as_shaken_until_both_have_been_quiet_for_80_ms() {
        let check = ActivityCheck::PRODUCT;
        let mut state = ActivityState::default();
        let mut shaken_after = |own, peer| {
            check.step(&mut state, Activity(own), Activity(peer), 20_000);
            check.is_shaken(&state)
        };
        assert_eq!(
            [(); 5].map(|()| shaken_after(64, 64)),
            [true, true, true, true, false]
        );
        assert!(
            shaken_after(90, 64) && shaken_after(64, 90),
            "9 times the energy"
        );
        assert!((0..4).all(|_| shaken_after(64, 64)));
        assert!(!shaken_after(64, 64));
        assert!(shaken_after(90, 64), "the other may hear it later");
        assert!(!shaken_after(90, 64), "a step of one channel, and no shock");
        assert!(shaken_after(Activity::GAP.0, 64), "not known");
    }

    #[test]
    fn a_shock_that_began_between_two_looks_was_taken_for_a_fault_of_the_pair() {
        // Ten milliseconds between SYNCs: a look at every other pair.
        let check = ActivityCheck::PRODUCT;
        let mut state = ActivityState::default();
        let mut shaken_after = |activity| {
            check.step(&mut state, Activity(activity), Activity(activity), 10_000);
            check.is_shaken(&state)
        };
        assert_eq!(
            (0..100)
                .map(|_| shaken_after(64))
                .filter(|shaken| *shaken)
                .count(),
            8
        );
        assert!(shaken_after(0));
        assert!(!shaken_after(64));
    }

    #[test]
    fn looks_that_are_not_known_judge_nobody() {
        let mut state = ActivityState::default();
        for _ in 0..100 {
            state.skip();
            let verdict =
                ActivityCheck::PRODUCT.step(&mut state, Activity(255), Activity(64), 20_000);
            assert_eq!(verdict, None);
        }
        for _ in 0..100 {
            let verdict =
                ActivityCheck::PRODUCT.step(&mut state, Activity(0), Activity(64), u32::MAX);
            assert_eq!(verdict, None);
        }
    }

    #[test]
    fn two_looks_of_the_one_beside_one_of_the_other_made_a_shock_noise() {
        // Fifteen milliseconds between SYNCs hold five samples or six, and six make a look.
        let shock = [(64, 0), (150, 150), (64, 0), (64, 72), (64, 0), (64, 72)];
        let looks = [shock; 20].concat();
        assert_eq!(after_quiet(5, &looks), None);
        let swapped: std::vec::Vec<_> = looks.iter().map(|(own, peer)| (*peer, *own)).collect();
        assert_eq!(after_quiet(5, &swapped), None);
    }

    #[test]
    fn a_shock_in_a_gap_of_the_other_was_called_a_spike() {
        let gap = Activity::GAP.0;
        let looks = [(gap, 150), (gap, 64), (64, 64), (64, 64), (64, 64)];
        assert_eq!(after_quiet(5, &looks), None);
        let uneven = [(gap, 0), (64, 150), (64, 64), (64, 64), (64, 64)];
        assert_eq!(after_quiet(5, &uneven), None);
    }

    #[test]
    fn noise_that_had_gone_while_the_channel_was_refused_was_found_again() {
        let mut state = ActivityState::default();
        let step = |state: &mut ActivityState, own| {
            ActivityCheck::PRODUCT.step(state, Activity(own), Activity(64), 50_000)
        };
        assert!((0..50).any(|_| step(&mut state, 80).is_some()));
        state.restart();
        assert!((0..50).all(|_| step(&mut state, 64).is_none()));
    }

    #[test]
    fn a_shock_whose_other_half_was_lost_on_the_way_was_called_noise() {
        let mut state = ActivityState::default();
        let step = |state: &mut ActivityState, own, peer| {
            let (own, peer) = (Activity(own), Activity(peer));
            ActivityCheck::PRODUCT.step(state, own, peer, 20_000)
        };
        assert!((0..10).all(|_| step(&mut state, 64, 64).is_none()));
        // A shock in one look, of which the peer's never comes.
        state.skip();
        assert_eq!(step(&mut state, 160, 0), None);
        for (own, peer) in [(64, 64); 4] {
            assert_eq!(step(&mut state, own, peer), None, "{own}");
        }
    }

    #[test]
    fn a_shock_that_the_other_had_not_told_yet_was_called_noise() {
        let shock = [(64, 64), (150, 0), (150, 160), (64, 64), (64, 64), (64, 64)];
        assert_eq!(after_quiet(5, &shock), None);
    }
}
