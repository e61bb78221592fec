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
//! the ground. Each channel's length is therefore measured against its own habit, learned at
//! standstills at which the pair agrees and held within [`HABIT_LIMIT`].
//!
//! Left out: the self-test, which takes the channel away for 0.7 s and does not see an offset.

use crate::ONE_G;
use crate::angle::{Angle, hypot};
use crate::chain::{Invalid, Measurement, Reading};
use crate::sample::Instant;
use crate::vector::Corrected;

use super::Node;

/// Configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Standstill {
    /// How long the machine has to stand, us.
    pub window_us: u32,
    /// Largest peak-to-peak of each angle meanwhile.
    pub angle: u32,
    /// Largest peak-to-peak of each length meanwhile, 2^-26 g.
    pub norm: u32,
    /// The two lengths must differ by at least this much more than usual before either is blamed,
    /// 2^-26 g.
    pub least: u32,
    /// As long as local gravity has not been learned nobody is blamed beside a channel whose
    /// length is farther from 1 g, 2^-26 g.
    pub unlearned: u32,
}

/// A thousandth of g in 2^-26 g.
const MG: u32 = 67_109;

/// How far a channel's habit may be from standard gravity: local gravity (2.7 mg) and the
/// calibration's own error.
pub const HABIT_LIMIT: i32 = 4 * MG as i32;

/// A habit that was learned so often follows each standstill by one part of as many.
const LEARNED: u8 = 8;

/// A window has at least this many pairs: two that are seconds apart may lie both at the ends of a
/// move.
const LEAST_PAIRS: u32 = 10;

impl Standstill {
    /// One second, 0.5 deg, 6 mg; lengths that differ by 2 mg more than usual tell, and 1 mg.
    pub const PRODUCT: Self = Self {
        window_us: 1_000_000,
        angle: Angle::from_degrees(0.5).magnitude(),
        norm: 6 * MG,
        least: 2 * MG,
        unlearned: MG,
    };
}

/// Lowest and highest of something within the window.
#[derive(Clone, Copy, Debug)]
struct Span {
    low: i32,
    high: i32,
}

impl Span {
    const fn at(value: i32) -> Self {
        Self {
            low: value,
            high: value,
        }
    }

    fn widen(&mut self, value: i32) {
        self.low = self.low.min(value);
        self.high = self.high.max(value);
    }

    const fn width(&self) -> u32 {
        self.high.abs_diff(self.low)
    }
}

/// A second under way.
#[derive(Clone, Copy, Debug)]
struct Window {
    since: Instant,
    /// The first angles; later ones are taken relative to these, so that they do not wrap.
    first: [Angle; 4],
    angles: [Span; 4],
    norms: [Span; 2],
    sums: [i64; 2],
    count: u32,
}

/// What the detector remembers.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    window: Option<Window>,
    /// What each channel's length usually is beyond standard gravity, 2^-26 g.
    habit: [i32; 2],
    /// How often that was learned.
    learned: u8,
}

impl State {
    /// The machine moves, or there was no pair: a second has to begin anew.
    pub fn interrupt(&mut self) {
        self.window = None;
    }

    /// The pair agrees: lengths `beyond` 1 g as they are now are what they should be. The first
    /// standstills count by their number, later ones by an eighth.
    pub fn learn(&mut self, beyond: [i32; 2]) {
        self.learned = (self.learned + 1).min(LEARNED);
        let off = self.off(beyond);
        for (habit, off) in self.habit.iter_mut().zip(off) {
            let learned = habit.saturating_add(off / i32::from(self.learned));
            *habit = learned.clamp(-HABIT_LIMIT, HABIT_LIMIT);
        }
    }

    /// How far each length is from its habit, 2^-26 g.
    fn off(&self, mut beyond: [i32; 2]) -> [i32; 2] {
        for (off, habit) in beyond.iter_mut().zip(self.habit) {
            *off = off.saturating_sub(habit);
        }
        beyond
    }
}

impl Standstill {
    /// Takes in a pair; at the end of a whole second of standstill, the mean lengths of that
    /// second beyond 1 g.
    pub fn step(
        &self,
        state: &mut State,
        own: (Reading, Corrected),
        peer: (Reading, Corrected),
        now: Instant,
    ) -> Option<[i32; 2]> {
        let Some(angles) = angles(own.0, peer.0) else {
            state.interrupt();
            return None;
        };
        let norms = [own.1, peer.1].map(beyond_one_g);
        let begin = || Window::new(now, angles, norms);
        let window = state.window.get_or_insert_with(begin);
        window.add(angles, norms);
        if !self.stands(window) {
            state.interrupt();
            return None;
        }
        let long = now.micros_since(window.since) >= i64::from(self.window_us);
        if !long || window.count < LEAST_PAIRS {
            return None;
        }
        let means = window.means();
        state.interrupt();
        Some(means)
    }

    fn stands(&self, window: &Window) -> bool {
        window.angles.iter().all(|span| span.width() < self.angle)
            && window.norms.iter().all(|span| span.width() < self.norm)
    }

    /// Which channel the lengths `beyond` 1 g speak against; `None` where they do not tell.
    ///
    /// `usual` is by how much more the own one is longer than the peer's in this pose while they
    /// agree, and `uncertainty` the combined standard uncertainty of the pair; all 2^-26 g.
    pub fn blame(
        &self,
        state: &State,
        beyond: [i32; 2],
        usual: i32,
        uncertainty: u32,
    ) -> Option<Node> {
        let [own, peer] = beyond.map(i64::from);
        let apart = own - peer - i64::from(usual);
        if apart.unsigned_abs() < u64::from(self.least.max(uncertainty.saturating_mul(2))) {
            return None;
        }
        let [own, peer] = state.off(beyond).map(i64::from);
        // One channel off alone has all of the difference, and the sum is as large.
        let sum = (own + peer) * apart.signum();
        if 2 * sum.abs() < apart.abs() {
            return None;
        }
        let (node, sound) = if sum > 0 {
            (Node::Own, peer)
        } else {
            (Node::Peer, own)
        };
        let right = u64::from(self.unlearned.max(uncertainty));
        (state.learned > 0 || sound.unsigned_abs() <= right).then_some(node)
    }
}

impl Window {
    fn new(since: Instant, first: [Angle; 4], norms: [i32; 2]) -> Self {
        Self {
            since,
            first,
            angles: [Span::at(0); 4],
            norms: norms.map(Span::at),
            sums: [0; 2],
            count: 0,
        }
    }

    fn add(&mut self, angles: [Angle; 4], norms: [i32; 2]) {
        let firsts = self.first.iter().zip(&mut self.angles);
        for (angle, (first, span)) in angles.iter().zip(firsts) {
            span.widen(angle.minus(*first).0);
        }
        let sums = self.norms.iter_mut().zip(&mut self.sums);
        for (norm, (span, sum)) in norms.into_iter().zip(sums) {
            span.widen(norm);
            *sum = sum.saturating_add(i64::from(norm));
        }
        self.count = self.count.saturating_add(1);
    }

    fn means(&self) -> [i32; 2] {
        let count = i64::from(self.count.max(1));
        self.sums.map(|sum| (sum / count) as i32)
    }
}

/// How much longer than 1 g, 2^-26 g per step.
fn beyond_one_g(vector: Corrected) -> i32 {
    let [x, y, z] = vector.accel;
    let length = i64::from(hypot(hypot(x, y), z));
    (length - i64::from(ONE_G)).clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
}

/// All angles of the pair; an axis that is not measured stands at zero, for it cannot move.
fn angles(own: Reading, peer: Reading) -> Option<[Angle; 4]> {
    let axis = |one: Result<Measurement, Invalid>| match one {
        Ok(measured) => Some(measured.angle),
        Err(Invalid::NotMeasured) => Some(Angle(0)),
        Err(_) => None,
    };
    Some([axis(own.x)?, axis(own.y)?, axis(peer.x)?, axis(peer.y)?])
}

/// The part of `difference` that lies along `vector`, which is about 1 g long, 2^-26 g.
pub fn along(difference: [i32; 3], vector: Corrected) -> i32 {
    let products = difference.iter().zip(vector.accel);
    let sum = products.fold(0, |sum: i64, (d, v)| sum + i64::from(*d) * i64::from(v));
    (sum >> 26) as i32
}
