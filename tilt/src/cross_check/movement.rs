//! Movement: when the machine stands, and of two channels the one that moved meanwhile.
//!
//! In: both channels' vectors pair by pair (2^-26 g per step), the time since the pair before,
//! and whether the pair differs. Out: at the end of a block of a quarter of a second, the channel
//! that has left its place while the other one stood; or, at the end of a second in which the
//! machine stood, how long both vectors were, for `standstill` to weigh.
//!
//! A machine moves both channels. One that leaves its place while the other one stays, and goes on
//! to feel the same vibration, has moved by itself: a step or drift of its zero-g offset, a gain,
//! swapped axes. Each channel's mean of a block is held against its place, which is its mean while
//! the pair agreed. Rumble averages out in a block, so that a machine stands beside its running
//! engine too. Places follow slowly as long as the pair agrees and are held while it differs, so
//! that a slow drift is found that took long to be told.
//!
//! A channel that stands because it is frozen speaks for nobody: each of its axes has to show
//! noise, and a third at least of the other channel's change from pair to pair. Where both have
//! left their places the machine has moved, and both have new ones; so they have after a pair that
//! was missing. Vectors are rounded to the step in which the nodes exchange them, so that both
//! nodes come to the same answer.
//!
//! A slow movement of the machine that undoes a small step takes the faulty channel past its place
//! within a second, while the sound one leaves its own. So a channel is named after six blocks in a
//! row, and after two if it is farther away than such a movement takes it.
//!
//! Left out: faults that begin while the machine moves, of which a movement tells nothing; a
//! channel that no longer feels anything and still shows noise, on a machine without vibration.

use crate::ONE_G;
use crate::angle::hypot;
use crate::vector::Corrected;

use super::Member;

/// Configuration; accelerations in 2^-26 g, of any one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Movement {
    /// A block lasts at least so long, us.
    pub block_us: u32,
    /// A block has at least so many pairs.
    pub pairs: u16,
    /// A channel stands as long as its mean is no farther from its place.
    pub still: u32,
    /// A channel has moved when its mean is at least so far from its place.
    pub moved: u32,
    /// A machine that shakes more than this from pair to pair, in the mean, does not stand.
    pub calm: u32,
    /// Lengths are those of a standstill of at least so long, us.
    pub rest_us: u32,
}

/// A thousandth of g in 2^-26 g.
const MG: u32 = 67_109;

/// From the step of the exchange, 2^-13 g, to that of means and places, 2^-19 g, and from there to
/// 2^-26 g.
const FINER: u32 = 6;
/// See [`FINER`].
const FINEST: u32 = 7;

/// A block has no more pairs than this, so that the sum of its vectors has room in 2^-19 g.
const MOST_PAIRS: u16 = 1000;

/// A standstill has no more blocks than this, where they take no time.
const MOST_BLOCKS: u8 = 8;

/// Beside a channel that has moved far the other one stands within this share of the way, up to
/// twice what counts as moved.
const SHARE: u32 = 8;

/// While the pair agrees a place goes this share of the way to the mean of each block, as a shift.
const FOLLOWS: u32 = 3;

/// How many blocks it is held against a channel that it left its place, while the pair agrees.
const MEMORY: u8 = 8;

/// Blocks in a row in which the same channel has to have moved beside the other one that stood. A
/// slow movement of the machine that undoes a small step as it goes takes the faulty channel past
/// its place, and does so within fewer blocks.
const CONFIRMED: u8 = 6;
/// The same for a channel that is at least [`FAR`] from its place: no movement that takes it so far
/// leaves the other one where it was.
const CONFIRMED_FAR: u8 = 2;
/// 2^-26 g.
const FAR: u32 = 20 * MG;

/// A channel that feels what the other one feels changes by this part of it at least ...
const PART: u32 = 3;
/// ... or by so little less in a block, 2^-13 g, that it may be rounding.
const ROUNDING: u32 = 12;

/// Pairs farther apart have nothing to do with each other, us.
const LONGEST_US: u32 = 2_000_000;

impl Movement {
    /// Blocks of 12 pairs, at SYNCs of 20 ms. The least time lies between whole numbers of usual
    /// SYNC periods, so that two clocks count alike.
    pub const PRODUCT: Self = Self {
        block_us: 236_000,
        pairs: 12,
        still: 17 * MG / 10,
        moved: 3 * MG,
        calm: 6 * MG,
        rest_us: 940_000,
    };
}

/// One axis of a channel.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    /// Sum of the block under way, 2^-13 g; at its end the mean, 2^-19 g.
    sum: i32,
    /// Where the axis was while the pair agreed, 2^-19 g.
    place: i32,
    /// The pair before, 2^-13 g.
    before: i16,
    /// Sum of the changes from pair to pair, 2^-13 g.
    change: u16,
}

/// One channel.
#[derive(Clone, Copy, Debug, Default)]
struct ChannelMovement {
    axes: [Axis; 3],
    /// Sum of the lengths beyond 1 g of the blocks of a standstill, 2^-26 g.
    length: i32,
    /// For how many more blocks it counts as having left its place.
    strayed: u8,
    /// In how many blocks in a row it has moved while the other one stood.
    moved: u8,
}

/// What one channel's block has come to.
#[derive(Clone, Copy, Debug)]
struct Block {
    /// How far the axis is from its place that is farthest, 2^-26 g.
    way: u32,
    /// The least and the most that an axis has changed from pair to pair in all, 2^-13 g.
    least: u16,
    most: u16,
}

/// What the detector remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct MovementState {
    /// Own channel, then the peer.
    channels: [ChannelMovement; 2],
    /// Of the block under way.
    block_us: u32,
    pairs: u16,
    /// The channels have places.
    placed: bool,
    /// Blocks of the standstill under way, and its length.
    rested: u8,
    rest_us: u32,
}

/// What a block has shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finding {
    /// This channel has moved while the other one stood.
    Moved(Member),
    /// The machine stood: how much longer than 1 g the own vector and the peer's were, 2^-26 g.
    Stood([i32; 2]),
}

impl MovementState {
    /// There was no pair, or what happened to a channel is not known: everything begins anew.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// The machine has moved: both channels have new places.
    fn place(&mut self) {
        for channel in &mut self.channels {
            (channel.strayed, channel.moved) = (0, 0);
            channel.end(Some(0));
        }
        self.placed = true;
        self.rise();
    }

    /// A standstill is over.
    fn rise(&mut self) {
        (self.rested, self.rest_us) = (0, 0);
        for channel in &mut self.channels {
            channel.length = 0;
        }
    }
}

impl ChannelMovement {
    fn take_in(&mut self, vector: &Corrected) {
        for (axis, accel) in self.axes.iter_mut().zip(&vector.accel) {
            let steps = accel.saturating_add(1 << 12) >> 13;
            let value = steps.clamp(-i32::from(i16::MAX), i32::from(i16::MAX)) as i16;
            axis.sum = axis.sum.saturating_add(i32::from(value));
            axis.change = axis.change.saturating_add(value.abs_diff(axis.before));
            axis.before = value;
        }
    }

    /// Turns sums into means.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn average(&mut self, pairs: i32) -> Block {
        let mut block = Block {
            way: 0,
            least: u16::MAX,
            most: 0,
        };
        for axis in &mut self.axes {
            axis.sum = (axis.sum << FINER) / pairs.max(1);
            block.way = block.way.max(axis.sum.abs_diff(axis.place) << FINEST);
            block.least = block.least.min(axis.change);
            block.most = block.most.max(axis.change);
        }
        block
    }

    /// The block is over, and the place follows its mean by so much.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn end(&mut self, follows: Option<u32>) {
        for axis in &mut self.axes {
            if let Some(shift) = follows {
                axis.place += (axis.sum - axis.place) >> shift;
            }
            (axis.sum, axis.change) = (0, 0);
        }
    }

    /// Whether each axis has felt in this block what that of the `other` has.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn feels(&self, other: &Self) -> bool {
        let mut axes = self.axes.iter().zip(&other.axes);
        axes.all(|(one, other)| u32::from(one.change) * PART + ROUNDING >= u32::from(other.change))
    }

    /// How much longer than 1 g the mean is, 2^-26 g.
    fn beyond_one_g(&self) -> i32 {
        let [x, y, z] = &self.axes;
        let plane = hypot(x.sum << FINEST, y.sum << FINEST);
        hypot(plane, z.sum << FINEST).saturating_sub(ONE_G)
    }
}

impl Block {
    const fn is_calm(&self, most: u32) -> bool {
        (self.most as u32) < most
    }
}

impl Movement {
    /// Takes in a pair `elapsed_us` after the one before; `differ` means that the pair differs.
    ///
    /// A channel is named only while the pair differs.
    // Out of line: the image is smaller.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn step(
        &self,
        state: &mut MovementState,
        pair: [&Corrected; 2],
        differ: bool,
        elapsed_us: u32,
    ) -> Option<Finding> {
        if elapsed_us > LONGEST_US {
            state.restart();
        }
        for (channel, vector) in state.channels.iter_mut().zip(pair) {
            channel.take_in(vector);
        }
        state.pairs += 1;
        state.block_us = state.block_us.saturating_add(elapsed_us);
        let whole = state.pairs >= self.pairs && state.block_us >= self.block_us;
        if !whole && state.pairs < MOST_PAIRS {
            return None;
        }
        let finding = self.end_block(state, differ);
        (state.pairs, state.block_us) = (0, 0);
        finding
    }

    fn end_block(&self, state: &mut MovementState, differ: bool) -> Option<Finding> {
        let pairs = i32::from(state.pairs);
        let [own, peer] = &mut state.channels;
        let (of_own, of_peer) = (own.average(pairs), peer.average(pairs));
        self.watch(own, of_own.way, of_peer.way, differ);
        self.watch(peer, of_peer.way, of_own.way, differ);
        if !state.placed || own.strayed > 0 && peer.strayed > 0 {
            state.place();
            return None;
        }
        let calm = (self.calm >> 13) * u32::from(state.pairs);
        let own_stands = own.strayed == 0 && of_own.is_calm(calm) && own.feels(peer);
        let peer_stands = peer.strayed == 0 && of_peer.is_calm(calm) && peer.feels(own);
        let own_moved = self.has_moved(own, of_own.way, peer_stands && of_peer.least > 0);
        let peer_moved = self.has_moved(peer, of_peer.way, own_stands && of_own.least > 0);
        let both_calm = of_own.is_calm(calm) && of_peer.is_calm(calm);
        let lengths = self.rest(state, both_calm && (own_stands || peer_stands));
        for channel in &mut state.channels {
            channel.end((!differ).then_some(FOLLOWS));
        }
        match (own_moved && differ, peer_moved && differ) {
            (true, _) => Some(Finding::Moved(Member::Own)),
            (_, true) => Some(Finding::Moved(Member::Peer)),
            _ => lengths.map(Finding::Stood),
        }
    }

    /// Whether the channel has left its place. While the pair differs that is not forgotten.
    fn watch(&self, one: &mut ChannelMovement, way: u32, others: u32, differ: bool) {
        if way > self.still.max((others / SHARE).min(2 * self.moved)) {
            one.strayed = MEMORY;
        } else if !differ {
            one.strayed = one.strayed.saturating_sub(1);
        }
    }

    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn has_moved(&self, one: &mut ChannelMovement, way: u32, other_stood: bool) -> bool {
        let moved = way >= self.moved && other_stood;
        one.moved = if moved {
            one.moved.saturating_add(1)
        } else {
            0
        };
        let enough = if way < FAR { CONFIRMED } else { CONFIRMED_FAR };
        one.moved >= enough
    }

    /// Takes in whether the machine stood in a block; at the end of a standstill the mean lengths
    /// of its blocks.
    fn rest(&self, state: &mut MovementState, stood: bool) -> Option<[i32; 2]> {
        if !stood {
            state.rise();
            return None;
        }
        state.rested += 1;
        state.rest_us = state.rest_us.saturating_add(state.block_us);
        for channel in &mut state.channels {
            channel.length = channel.length.saturating_add(channel.beyond_one_g());
        }
        if state.rest_us < self.rest_us && state.rested < MOST_BLOCKS {
            return None;
        }
        let blocks = i32::from(state.rested).max(1);
        let lengths = state
            .channels
            .each_ref()
            .map(|channel| channel.length / blocks);
        state.rise();
        Some(lengths)
    }
}
