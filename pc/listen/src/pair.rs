//! Two channels, and what they are to each other.
//!
//! In: what both have sent. Out: a [`Round`] for each SYNC; with the second slopes of a SYNC their
//! difference; and beside what the channels report themselves an own comparison of the angles that
//! they exchange (TPDO 3), which is found to contradict them or not. A round ends with the next
//! SYNC, or where a channel sends the same PDO again, in a log without SYNCs.
//!
//! The comparison takes what the nodes compare: angles without preset and offset. 2024h has to be
//! one of the latest differences, and a pair that reports that it agrees must not be apart for long
//! by more than 0.40 deg and five standard uncertainties (the product's window, the paper's
//! threshold).
//!
//! Left out: a judgement of who is wrong; the nodes send theirs.

use super::checks::Check;
use super::exchange::Measured;
use super::round::Round;
use super::side::Side;

/// The difference of the two channels at one SYNC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delta {
    /// When the SYNC was seen.
    pub time_ns: u64,
    /// Slope X and Y of channel A minus those of channel B, 0.001 deg; `None` where one of them
    /// has none.
    pub mdeg: [Option<i32>; 2],
}

/// One instrument.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Channel A and channel B.
    pub sides: [Side; 2],
    /// The latest difference.
    pub delta: Option<Delta>,
    /// The latest difference of the angles that the channels have told each other, 0.001 deg.
    pub exchanged_mdeg: [Option<i32>; 2],
    /// How often that was formed.
    pub exchanges: u64,
    /// The SYNC under way, and the one before it that something was sent at.
    round: Round,
    ended: Option<Round>,
    rounds: u64,
    /// Differences of the exchanged angles of the latest SYNCs, the newest first.
    recent: [[Option<i32>; 2]; RECENT],
    /// SYNCs for which 2024h may still be of one at which a node did not send its angle: it has
    /// that angle, and states the difference with it.
    unsent: usize,
    /// By how much 2024h of each side was off, when it was sent.
    off_mdeg: [Option<u32>; 2],
    /// Since when the exchanged angles are apart although both report that they agree.
    apart_ns: Option<u64>,
    /// Since when both have told states that exclude each other.
    at_odds_ns: Option<u64>,
}

/// How many SYNCs back 2024h may be; as the nodes work it is of the SYNC before.
const RECENT: usize = 4;

/// 2024h is rounded, and the exchange cuts the angle to 2^-24 of a circle.
const ROUNDING_MDEG: u32 = 2;

/// The largest number of 2024h, which stands for all above.
const LARGEST_MDEG: i32 = 32_767;

/// An excess is a fault after 0.2 s, and the state that tells of it comes a SYNC later; the
/// slowest SYNC of the nodes themselves is one in a second.
const MAY_LAST_NS: u64 = 1_500_000_000;

/// 0.40 deg.
const THRESHOLD_MDEG: u32 = 400;

/// Standard uncertainties that two angles may be apart.
const COVERAGE: f64 = 5.0;

impl Pair {
    pub(super) fn new(sides: [Side; 2]) -> Self {
        Self {
            sides,
            delta: None,
            exchanged_mdeg: [None; 2],
            exchanges: 0,
            round: Round::default(),
            ended: None,
            rounds: 0,
            recent: [[None; 2]; RECENT],
            unsent: 0,
            off_mdeg: [None; 2],
            apart_ns: None,
            at_odds_ns: None,
        }
    }

    /// The SYNC that ended last, and how many have ended; those at which nothing was sent are none.
    pub const fn ended(&self) -> (Option<&Round>, u64) {
        (self.ended.as_ref(), self.rounds)
    }

    /// The SYNC under way.
    pub const fn under_way(&self) -> &Round {
        &self.round
    }

    #[inline]
    pub(super) fn sync(&mut self, time_ns: u64) {
        // A plan may have many pairs of which none is there.
        if self.sides.iter().any(|side| side.seen_ns.is_some()) {
            self.sides.iter_mut().for_each(|side| side.sync(time_ns));
            self.end_round(time_ns);
        }
        self.round.time_ns = time_ns;
    }

    fn end_round(&mut self, time_ns: u64) {
        if !self.round.is_of_measured() {
            self.remember([None; 2]);
        }
        if !self.round.is_empty() {
            self.ended = Some(self.round);
            self.rounds += 1;
        }
        self.round = Round::at(time_ns);
    }

    /// Side `number` has sent slopes: the difference, if it is the second one.
    #[inline]
    pub(super) fn slopes(&mut self, number: usize, time_ns: u64) -> Option<Delta> {
        let is_again = self.round.slopes.get(number).is_some_and(Option::is_some);
        if is_again {
            self.end_round(time_ns);
        }
        let sent = self.sides.get(number).and_then(|side| side.slopes);
        if let (Some(sent), Some(place)) = (sent, self.round.slopes.get_mut(number)) {
            *place = Some(sent.mdeg);
        }
        self.judge_unit(number, time_ns);
        let [Some(a), Some(b)] = [self.sides[0].slopes, self.sides[1].slopes] else {
            return None;
        };
        if self.round.slopes.iter().any(Option::is_none) {
            return None;
        }
        self.compare_states(a.state, b.state);
        self.delta = Some(Delta {
            time_ns: self.round.time_ns,
            mdeg: [0, 1].map(|axis| self.round.slope_difference(axis)),
        });
        self.delta
    }

    /// States that exclude each other are so for a SYNC or two while something happens.
    fn compare_states(&mut self, a: Option<u8>, b: Option<u8>) {
        let (Some(a), Some(b)) = (a, b) else {
            self.at_odds_ns = None;
            return;
        };
        let fit = a == b
            || matches!(
                (a, b),
                (0, _) | (_, 0) | (7, 8) | (8, 7) | (7..=9, 9) | (9, 7 | 8)
            );
        if fit {
            self.at_odds_ns = None;
            return;
        }
        let since_ns = *self.at_odds_ns.get_or_insert(self.round.time_ns);
        if self.round.time_ns.saturating_sub(since_ns) > MAY_LAST_NS {
            let now_ns = self.round.time_ns;
            self.sides
                .iter_mut()
                .for_each(|side| side.checks.add(Check::State, now_ns));
        }
    }

    /// Side `number` has sent the angles for the other one.
    #[inline]
    pub(super) fn exchange(&mut self, number: usize, time_ns: u64) {
        let is_again = self.round.measured.get(number).is_some_and(Option::is_some);
        if is_again {
            self.end_round(time_ns);
        }
        let sent = self.sides.get(number).and_then(|side| side.told);
        if let (Some(sent), Some(place)) = (sent, self.round.measured.get_mut(number)) {
            *place = Some(Measured::of(&sent.exchange));
        }
        self.judge_unit(number, time_ns);
        let [Some(a), Some(b)] = self.round.measured else {
            return;
        };
        let mdeg = [0, 1].map(|axis| a.minus(&b, axis));
        let axes = mdeg.into_iter().enumerate();
        let is_apart = axes
            .filter_map(|(axis, mdeg)| Some((axis, mdeg?.unsigned_abs())))
            .any(|(axis, apart)| apart > THRESHOLD_MDEG && is_beyond(apart, &a, &b, axis));
        self.remember(mdeg);
        self.exchanged_mdeg = mdeg;
        self.exchanges += 1;
        self.watch_apart(is_apart);
    }

    /// Of side `number` one of slopes and measured angles has come: when it is the second one of
    /// the SYNC, they show whether the slopes have the unit that they are taken in.
    #[inline]
    fn judge_unit(&mut self, number: usize, time_ns: u64) {
        let round = &self.round;
        let slopes = round.slopes.get(number).is_some_and(Option::is_some);
        let measured = round.measured.get(number).copied().flatten();
        if let (true, Some(measured), Some(side)) = (slopes, measured, self.sides.get_mut(number)) {
            side.judge_unit(time_ns, &measured);
            if let (true, Some(place)) = (side.unit.is_another(), self.round.slopes.get_mut(number))
            {
                *place = Some([None; 2]);
            }
        }
    }

    fn remember(&mut self, mdeg: [Option<i32>; 2]) {
        self.unsent = match mdeg.contains(&None) {
            true => RECENT,
            false => self.unsent.saturating_sub(1),
        };
        self.recent.rotate_right(1);
        self.recent[0] = mdeg;
    }

    fn watch_apart(&mut self, is_apart: bool) {
        let agree = |side: &Side| {
            side.slopes
                .is_some_and(|slopes| slopes.state == Some(AGREE))
        };
        if !is_apart || !self.sides.iter().any(agree) {
            self.apart_ns = None;
            return;
        }
        let now_ns = self.round.time_ns;
        let since_ns = *self.apart_ns.get_or_insert(now_ns);
        if now_ns.saturating_sub(since_ns) > MAY_LAST_NS {
            let accused = self.sides.iter_mut().filter(|side| agree(side));
            accused.for_each(|side| side.checks.add(Check::State, now_ns));
        }
    }

    /// Side `number` has sent its difference.
    #[inline]
    pub(super) fn detail(&mut self, number: usize, time_ns: u64) {
        let off = self.find_off(number);
        if let Some(place) = self.off_mdeg.get_mut(number) {
            *place = off;
        }
        if let (Some(off), Some(side)) = (off, self.sides.get_mut(number))
            && off > ROUNDING_MDEG
        {
            side.checks.add(Check::Difference, time_ns);
        }
    }

    /// 2024h of side `number` as A - B, 0.001 deg: each node sends its own angle minus the other's.
    pub fn difference_sent(&self, number: usize) -> Option<i32> {
        let sent = self
            .sides
            .get(number)?
            .detail?
            .difference_mdeg
            .map(i32::from)?;
        Some(if number == 0 { sent } else { -sent })
    }

    /// By how much 2024h of side `number` was off the closest difference of the SYNCs before it,
    /// of the angles that the channels have sent each other, 0.001 deg; `None` without either.
    pub fn difference_off(&self, number: usize) -> Option<u32> {
        self.off_mdeg.get(number).copied().flatten()
    }

    fn find_off(&self, number: usize) -> Option<u32> {
        if self.unsent > 0 {
            return None;
        }
        let sent = self.difference_sent(number)?;
        let axis = self.sides.get(number)?.detail?.difference_axis;
        let recent = self.recent.iter().flat_map(|mdeg| may_be_meant(mdeg, axis));
        let off = recent.map(|own| own.clamp(-LARGEST_MDEG, LARGEST_MDEG).abs_diff(sent));
        off.min()
    }

    /// The log has a hole, or time has gone back: what lasted is not known any longer.
    pub(super) fn excuse(&mut self, time_ns: u64) {
        (self.apart_ns, self.at_odds_ns) = (None, None);
        self.recent = [[None; 2]; RECENT];
        self.sides.iter_mut().for_each(|side| side.excuse(time_ns));
    }
}

/// 2021h of a pair that agrees.
const AGREE: u8 = 1;

/// The differences of a SYNC that 2024h may be: that of its axis; else the larger one, and the
/// other one too where they are as large but for the rounding.
fn may_be_meant(mdeg: &[Option<i32>; 2], axis: Option<u8>) -> impl Iterator<Item = i32> {
    let largest = mdeg.iter().flatten().map(|mdeg| mdeg.unsigned_abs()).max();
    let least = largest.unwrap_or(0).saturating_sub(ROUNDING_MDEG);
    let is_meant = move |(number, mdeg): &(u8, i32)| match axis {
        Some(axis) => *number == axis,
        None => mdeg.unsigned_abs() >= least,
    };
    let both = (0_u8..)
        .zip(*mdeg)
        .filter_map(|(number, mdeg)| Some((number, mdeg?)));
    both.filter(is_meant).map(|(_, mdeg)| mdeg)
}

/// Whether the angles of an axis are this much apart by more than their uncertainties explain.
fn is_beyond(apart_mdeg: u32, a: &Measured, b: &Measured, axis: usize) -> bool {
    // Of an angle whose uncertainty is not known nothing follows.
    let both = a.uncertainty_mdeg(axis).zip(b.uncertainty_mdeg(axis));
    both.is_some_and(|(a, b)| f64::from(apart_mdeg) > COVERAGE * a.hypot(b))
}
