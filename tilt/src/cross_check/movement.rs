//! Movement: of two channels on one housing, the one that moved while the other stood.
//!
//! In: both channels' vectors pair by pair (2^-26 g per step), the time since the pair before,
//! and whether the pair differs. Out: at the end of a block of some tenths of a second, either the
//! channel that alone has left its place, or how long the two vectors were while both stood.
//!
//! A machine moves both channels, so a channel that leaves its place while the other one stays
//! and goes on to feel the same vibration has moved by itself: a step or drift of its zero-g
//! offset, a gain, swapped axes. Each channel's mean over a block is held against a reference,
//! its mean while the pair agreed. Rumble averages out in a block, so that the test works beside a
//! running engine, where single samples are too restless for `standstill`. The reference follows
//! slowly as long as the pair agrees and is held while it differs, so that a drift is found that
//! took long to be told.
//!
//! Where the channel that stood could be a frozen one nobody is named: each of its axes has to
//! show a third at least of the other channel's change from pair to pair. Where both have left
//! their places the machine has moved, and references are taken anew; so is everything after a
//! pair that is missing. Vectors are rounded to the step in which the nodes exchange them, so that
//! both nodes come to the same answer.
//!
//! Left out: faults that begin while the machine moves, of which a movement tells nothing;
//! a frozen channel that still shows noise on a machine without vibration.

use crate::ONE_G;
use crate::angle::hypot;
use crate::vector::Corrected;

use super::Node;

/// Configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Movement {
    /// Length of a block at least, us.
    pub block_us: u32,
    /// Pairs in a block at least.
    pub pairs: u16,
    /// A channel stands as long as no axis of its mean is farther from its reference, 2^-26 g.
    pub still: u32,
    /// A channel has moved when an axis of its mean is so far from its reference, 2^-26 g.
    pub moved: u32,
}

/// A thousandth of g in 2^-26 g.
const MG: u32 = 67_109;

/// Means are in 2^-19 g.
const SHIFT: u32 = 7;

/// From the step of the exchange, 2^-13 g, to that of the means.
const FRACTION: u32 = 6;

/// A block has no more pairs than this, so that a sum in steps of a mean has room in 32 bits.
const MOST_PAIRS: u16 = 1000;

/// Beside a channel that has moved far the other one stands within this share of the way.
const SHARE: u32 = 8;

/// The references go this share of the way to each block's mean.
const FOLLOW: i32 = 8;

/// How many blocks it is held against a channel that it has left its place, while the pair agrees.
const MEMORY: u8 = 8;

/// Blocks in a row in which the same channel has to have moved.
const CONFIRMED: u8 = 2;

/// Blocks in a row of standstill whose lengths are averaged: about a second.
const RESTED: u8 = 4;

/// A channel that stands shows at least this part of the other one's change from pair to pair.
const ALIVE: u32 = 3;

/// Pairs farther apart have nothing to do with each other, us.
const LONGEST_US: u32 = 2_000_000;

impl Movement {
    /// A block is no whole number of usual SYNC periods long, so that two clocks count alike.
    pub const PRODUCT: Self = Self {
        block_us: 236_000,
        pairs: 12,
        still: 17 * MG / 10,
        moved: 3 * MG,
    };
}

/// One channel's block under way, and its place.
#[derive(Clone, Copy, Debug, Default)]
struct Channel {
    /// The vector of the pair before, 2^-13 g.
    before: [i16; 3],
    /// Sum of the vectors, 2^-13 g.
    sum: [i32; 3],
    /// Sum of the changes from pair to pair, 2^-13 g.
    change: [u16; 3],
    /// Where the channel was while the pair agreed, 2^-19 g.
    reference: [i32; 3],
    /// For how many more blocks it counts as having left that place.
    strayed: u8,
    /// In how many blocks in a row it has moved while the other one stood.
    moved: u8,
    /// Sum of the lengths beyond 1 g of the blocks of a rest, 2^-26 g.
    length: i32,
}

/// What the detector remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    /// Own channel, then the peer.
    channels: [Channel; 2],
    elapsed_us: u32,
    pairs: u16,
    /// There are references.
    placed: bool,
    /// Blocks in a row in which both stood.
    rested: u8,
}

/// What a block has shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finding {
    /// This channel has moved while the other one stood.
    Moved(Node),
    /// Both have stood: how much longer than 1 g the own vector and the peer's were, 2^-26 g.
    Stood([i32; 2]),
}

impl State {
    /// There was no pair, or nobody knows what happened to a channel: everything begins anew.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// The machine has moved: both channels are where they are now.
    fn place(&mut self, means: [[i32; 3]; 2]) {
        for (channel, mean) in self.channels.iter_mut().zip(means) {
            channel.reference = mean;
            (channel.strayed, channel.moved, channel.length) = (0, 0, 0);
        }
        self.placed = true;
        self.rested = 0;
    }

    /// Takes in whether both stood in a block; at the end of a rest, the mean lengths of it.
    fn rest(&mut self, means: [[i32; 3]; 2], stood: bool) -> Option<[i32; 2]> {
        self.rested = if stood { self.rested + 1 } else { 0 };
        for (channel, mean) in self.channels.iter_mut().zip(means) {
            let so_far = if self.rested > 1 { channel.length } else { 0 };
            channel.length = so_far.saturating_add(beyond_one_g(mean));
        }
        if self.rested < RESTED {
            return None;
        }
        self.rested = 0;
        Some(
            self.channels
                .map(|channel| channel.length / i32::from(RESTED)),
        )
    }
}

impl Channel {
    fn take_in(&mut self, vector: Corrected) {
        let axes = self.before.iter_mut().zip(&mut self.sum);
        for (((before, sum), change), accel) in axes.zip(&mut self.change).zip(vector.accel) {
            let steps = accel.saturating_add(1 << 12) >> 13;
            let value = steps.clamp(-i32::from(i16::MAX), i32::from(i16::MAX)) as i16;
            *sum = sum.saturating_add(i32::from(value));
            *change = change.saturating_add(value.abs_diff(*before));
            *before = value;
        }
    }

    /// The mean of the block of so many pairs, which ends, 2^-19 g.
    fn mean(&mut self, pairs: i32) -> [i32; 3] {
        core::mem::take(&mut self.sum).map(|sum| (sum << FRACTION) / pairs)
    }

    /// How far the axis is from its reference that has moved farthest, 2^-26 g.
    fn way(&self, mean: &[i32; 3]) -> u32 {
        let ways = self.reference.iter().zip(mean).map(|(a, b)| a.abs_diff(*b));
        ways.fold(0, u32::max) << SHIFT
    }

    fn follow(&mut self, mean: &[i32; 3]) {
        for (reference, mean) in self.reference.iter_mut().zip(mean) {
            *reference += (mean - *reference) / FOLLOW;
        }
    }
}

impl Movement {
    /// Takes in a pair `elapsed_us` after the one before; `differ` says that the pair differs.
    ///
    /// A channel is named while the pair differs only.
    pub fn step(
        &self,
        state: &mut State,
        pair: [Corrected; 2],
        differ: bool,
        elapsed_us: u32,
    ) -> Option<Finding> {
        if elapsed_us > LONGEST_US {
            state.restart();
        }
        for (channel, vector) in state.channels.iter_mut().zip(pair) {
            channel.take_in(vector);
        }
        state.pairs = state.pairs.saturating_add(1);
        state.elapsed_us = state.elapsed_us.saturating_add(elapsed_us);
        let long = state.elapsed_us >= self.block_us || state.pairs >= MOST_PAIRS;
        if state.pairs < self.pairs || !long {
            return None;
        }
        state.elapsed_us = 0;
        let pairs = i32::from(core::mem::take(&mut state.pairs));
        let means = state.channels.each_mut().map(|channel| channel.mean(pairs));
        self.end_block(state, means, differ)
    }

    fn end_block(&self, state: &mut State, means: [[i32; 3]; 2], differ: bool) -> Option<Finding> {
        let [own, peer] = &mut state.channels;
        let [of_own, of_peer] = &means;
        let (own_way, peer_way) = (own.way(of_own), peer.way(of_peer));
        self.watch(own, own_way, peer_way, differ);
        self.watch(peer, peer_way, own_way, differ);
        let changes = [
            core::mem::take(&mut own.change),
            core::mem::take(&mut peer.change),
        ];
        if !state.placed || own.strayed > 0 && peer.strayed > 0 {
            state.place(means);
            return None;
        }
        let [own_lives, peer_lives] = alive(changes);
        let own_moved = self.has_moved(own, own_way, peer_lives && peer.strayed == 0);
        let peer_moved = self.has_moved(peer, peer_way, own_lives && own.strayed == 0);
        if !differ {
            own.follow(of_own);
            peer.follow(of_peer);
        }
        let stood = own_way.max(peer_way) <= self.still && own_lives && peer_lives;
        let lengths = state.rest(means, stood);
        match (differ && own_moved, differ && peer_moved) {
            (true, _) => Some(Finding::Moved(Node::Own)),
            (_, true) => Some(Finding::Moved(Node::Peer)),
            _ => lengths.map(Finding::Stood),
        }
    }

    /// Whether the channel has left its place. While the pair differs that isn't forgotten.
    fn watch(&self, one: &mut Channel, way: u32, others: u32, differ: bool) {
        if way > self.still.max(others / SHARE) {
            one.strayed = MEMORY;
        } else if !differ {
            one.strayed = one.strayed.saturating_sub(1);
        }
    }

    fn has_moved(&self, one: &mut Channel, way: u32, other_stood: bool) -> bool {
        let moved = way >= self.moved && other_stood;
        one.moved = if moved {
            one.moved.saturating_add(1)
        } else {
            0
        };
        one.moved >= CONFIRMED
    }
}

/// Whether each of two channels with these changes from pair to pair feels what the other one
/// feels.
fn alive([own, peer]: [[u16; 3]; 2]) -> [bool; 2] {
    let mut alive = [true; 2];
    for (own, peer) in own.into_iter().zip(peer) {
        let enough = |one: u16, other: u16| one > 0 && u32::from(one) * ALIVE >= u32::from(other);
        let [own_lives, peer_lives] = &mut alive;
        *own_lives &= enough(own, peer);
        *peer_lives &= enough(peer, own);
    }
    alive
}

/// How much longer than 1 g a mean is, 2^-26 g.
fn beyond_one_g(mean: [i32; 3]) -> i32 {
    let [x, y, z] = mean.map(|c| c << SHIFT);
    hypot(hypot(x, y), z).saturating_sub(ONE_G)
}
