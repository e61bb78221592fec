//! The two real channels of one board, instant by instant, and when the board lay still.
//!
//! In: two [`Prepared`] recordings. Out: a [`Board`]: the healthy [`Pair`] of each instant, and
//! copies of both channels at the moments at which faults will begin.

use std::collections::BTreeMap;

use instant::Instant;
use tilt::chain::Chain;
use tilt::observation::Observation;

use super::super::prepare::Prepared;
use super::super::segments::Span;
use super::channel::Channel;

/// Time between two pairs, us: the SYNC of the instrument.
pub const PAIR_US: u64 = 20_000;

/// From laying the board down until it counts as lying still, us: the low-passes and the latch
/// have to forget the hand first.
const SETTLED_US: u64 = 4_000_000;

/// Until the board is taken up again, us.
const BEFORE_UP_US: u64 = 500_000;

/// Both channels at one instant.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// The instant.
    pub now: Instant,
    /// What channel 1 reports.
    pub own: Observation,
    /// What channel 2 reports.
    pub peer: Observation,
    /// Whether the board lies still, and has done so for a while.
    pub lies: bool,
}

/// The healthy recording.
pub struct Board<'a> {
    /// Every [`PAIR_US`].
    pub pairs: Vec<Pair>,
    /// Both channels as they are before the pair of this index is taken.
    pub kept: BTreeMap<usize, [Channel<'a>; 2]>,
    /// When the board was laid down and taken up, in both channels, us.
    pub stills: Vec<(u64, u64)>,
    /// The longest time without one: vigorous motion, us.
    pub motion: (u64, u64),
}

impl<'a> Board<'a> {
    /// Plays both channels; both are kept before each pair for which `keep` is true.
    pub fn play(
        prepared: &'a [Prepared; 2],
        chains: &'a [Chain; 2],
        keep: impl Fn(usize) -> bool,
    ) -> Self {
        let stills = stills(prepared);
        let [one, other] = prepared;
        let [chain, other_chain] = chains;
        let mut channels = [Channel::new(one, chain), Channel::new(other, other_chain)];
        let mut pairs = Vec::new();
        let mut kept = BTreeMap::new();
        for index in 0..count(prepared) {
            if keep(index) {
                kept.insert(index, channels.clone());
            }
            let now = Instant(index as u64 * PAIR_US);
            let [own, peer] = channels.each_mut().map(|channel| channel.observe(now));
            let lies = lies(&stills, now);
            pairs.push(Pair {
                now,
                own,
                peer,
                lies,
            });
        }
        let motion = longest_gap(&stills, count(prepared));
        Self {
            pairs,
            kept,
            stills,
            motion,
        }
    }

    /// The pairs of the vigorous motion.
    pub fn shaken(&self) -> impl Iterator<Item = &Pair> {
        let (from_us, to_us) = self.motion;
        let during = move |pair: &&Pair| (from_us..to_us).contains(&pair.now.0);
        self.pairs.iter().filter(during)
    }
}

/// Pairs of both recordings.
pub fn count(prepared: &[Prepared; 2]) -> usize {
    let ends = prepared.each_ref().map(|channel| {
        let last_us = channel.fed().last().map_or(0, |row| row.time_us);
        last_us.saturating_add(channel.offset_us)
    });
    ends.into_iter()
        .min()
        .map_or(0, |end_us| (end_us / PAIR_US) as usize)
}

/// When both channels stood still, us.
pub fn stills(prepared: &[Prepared; 2]) -> Vec<(u64, u64)> {
    let spans = |channel: &Prepared| -> Vec<(u64, u64)> {
        let place = |span: &Span| {
            let offset_us = channel.offset_us;
            (span.start_us + offset_us, span.end_us + offset_us)
        };
        channel.standstill.spans.iter().map(place).collect()
    };
    let [ones, others] = prepared.each_ref().map(spans);
    let mut stills = Vec::new();
    for (from, to) in ones {
        for (other_from, other_to) in &others {
            let both = (from.max(*other_from), to.min(*other_to));
            if both.0 + SETTLED_US + BEFORE_UP_US < both.1 {
                stills.push(both);
            }
        }
    }
    stills
}

/// True when the board has lain still for a while at `now`, and will for another moment.
pub fn lies(stills: &[(u64, u64)], now: Instant) -> bool {
    let inside = |&(from, to): &(u64, u64)| {
        (from + SETTLED_US..to.saturating_sub(BEFORE_UP_US)).contains(&now.0)
    };
    stills.iter().any(inside)
}

/// The longest time between two standstills, or from the last one to the end, us.
pub fn longest_gap(stills: &[(u64, u64)], pairs: usize) -> (u64, u64) {
    let ends = stills.iter().map(|still| still.1);
    let begins = stills.iter().map(|still| still.0).skip(1);
    let gaps = ends.zip(begins.chain([pairs as u64 * PAIR_US]));
    gaps.max_by_key(|(from, to)| to.saturating_sub(*from))
        .unwrap_or((0, 0))
}
