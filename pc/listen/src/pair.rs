//! Two channels, and the difference between them.
//!
//! In: what both have told. Out: with the second slopes of a SYNC their difference; and beside
//! what the channels say of themselves an own comparison of the angles that they exchange
//! (TPDO 3), which is found to contradict them or not.
//!
//! The comparison takes what the nodes compare: angles without preset and offset. 2024h has to be
//! one of the latest differences, and a pair that says it agrees must not be apart for long by
//! more than 0.40 deg and five standard uncertainties (the product's window, the paper's
//! threshold).
//!
//! Left out: a judgement of who is wrong; the nodes send theirs.

use super::checks::Check;
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
    sync_ns: u64,
    /// Which of them have sent slopes since the SYNC, and which the exchange.
    told: [bool; 2],
    exchanged: [bool; 2],
    /// Differences of the latest SYNCs, the newest first.
    recent: [[Option<i32>; 2]; RECENT],
    /// Since when the exchanged angles are apart although both say that they agree.
    apart_ns: Option<u64>,
    /// Since when both have told states that exclude each other.
    at_odds_ns: Option<u64>,
    /// Squared uncertainty of each quality, 2^-24 of a circle.
    variance: Box<[f32; 256]>,
}

/// How many SYNCs back 2024h may be; as the nodes work it is of the SYNC before.
const RECENT: usize = 4;

/// 2024h is rounded, and the exchange cuts the angle to 2^-24 of a circle.
const ROUNDING_MDEG: i32 = 2;

/// The largest number of 2024h, which stands for all above.
const LARGEST_MDEG: i32 = 32_767;

/// An excess is a fault after 0.2 s, and the state that tells of it comes a SYNC later; the
/// slowest SYNC of the nodes themselves is one in a second.
const MAY_LAST_NS: u64 = 1_500_000_000;

/// 0.40 deg in 2^-24 of a circle.
const THRESHOLD: f32 = 0.40 / 360.0 * 16_777_216.0;

/// Standard uncertainties that two angles may be apart.
const COVERAGE: f32 = 5.0;

impl Pair {
    pub(super) fn new(sides: [Side; 2]) -> Self {
        let steps_per_mdeg = 16_777_216.0 / 360_000.0;
        let variance = |quality: usize| {
            let mdeg = f32::exp2((quality as f32 - 32.0) / 16.0);
            (mdeg * steps_per_mdeg).powi(2)
        };
        let mut table = Box::new([0.0; 256]);
        let all = table.iter_mut().enumerate();
        all.for_each(|(quality, square)| *square = variance(quality));
        // The highest quality says that nothing is known.
        if let Some(last) = table.last_mut() {
            *last = f32::INFINITY;
        }
        Self {
            sides,
            delta: None,
            exchanged_mdeg: [None; 2],
            exchanges: 0,
            sync_ns: 0,
            told: [false; 2],
            exchanged: [false; 2],
            recent: [[None; 2]; RECENT],
            apart_ns: None,
            at_odds_ns: None,
            variance: table,
        }
    }

    #[inline]
    pub(super) fn sync(&mut self, time_ns: u64) {
        self.sync_ns = time_ns;
        // A plan may have many pairs of which none is there.
        if self.sides.iter().all(|side| side.seen_ns.is_none()) {
            return;
        }
        self.told = [false; 2];
        if self.exchanged != [true; 2] {
            self.remember([None; 2]);
        }
        self.exchanged = [false; 2];
        self.sides.iter_mut().for_each(|side| side.sync(time_ns));
    }

    /// Side `number` has sent slopes: the difference, if it is the second one.
    #[inline]
    pub(super) fn slopes(&mut self, number: usize) -> Option<Delta> {
        if let Some(told) = self.told.get_mut(number) {
            *told = true;
        }
        let [Some(a), Some(b)] = [self.sides[0].slopes, self.sides[1].slopes] else {
            return None;
        };
        if self.told != [true; 2] {
            return None;
        }
        self.compare_states(a.state, b.state);
        let minus = |axis: usize| Some(a.mdeg[axis]? - b.mdeg[axis]?);
        self.delta = Some(Delta {
            time_ns: self.sync_ns,
            mdeg: [minus(0), minus(1)],
        });
        self.delta
    }

    /// States that exclude each other are so for a SYNC or two while something happens.
    fn compare_states(&mut self, a: u8, b: u8) {
        let fit = a == b
            || matches!(
                (a, b),
                (0, _) | (_, 0) | (7, 8) | (8, 7) | (7..=9, 9) | (9, 7 | 8)
            );
        if fit {
            self.at_odds_ns = None;
            return;
        }
        let since_ns = *self.at_odds_ns.get_or_insert(self.sync_ns);
        if self.sync_ns.saturating_sub(since_ns) > MAY_LAST_NS {
            let now_ns = self.sync_ns;
            self.sides
                .iter_mut()
                .for_each(|side| side.checks.add(Check::State, now_ns));
        }
    }

    /// Side `number` has sent the angles for the other one.
    #[inline]
    pub(super) fn exchange(&mut self, number: usize) {
        if let Some(exchanged) = self.exchanged.get_mut(number) {
            *exchanged = true;
        }
        let [Some(a), Some(b)] = [self.sides[0].told, self.sides[1].told] else {
            return;
        };
        if self.exchanged != [true; 2] {
            return;
        }
        let (a, b) = (a.exchange, b.exchange);
        let mut mdeg = [None; 2];
        let mut is_apart = false;
        for (axis, mdeg) in mdeg.iter_mut().enumerate() {
            let [qa, qb] = [a.quality[axis], b.quality[axis]];
            if qa < FIRST_ANGLE || qb < FIRST_ANGLE {
                continue;
            }
            // Half a circle wraps, as angles do.
            let steps = (a.angle[axis].wrapping_sub(b.angle[axis]) << 8) >> 8;
            *mdeg = Some(as_mdeg(steps));
            let variance = self.variance[usize::from(qa)] + self.variance[usize::from(qb)];
            let apart = steps as f32;
            is_apart |= apart.abs() > THRESHOLD && apart * apart > COVERAGE * COVERAGE * variance;
        }
        self.remember(mdeg);
        self.exchanged_mdeg = mdeg;
        self.exchanges += 1;
        self.watch_apart(is_apart);
    }

    fn remember(&mut self, mdeg: [Option<i32>; 2]) {
        self.recent.rotate_right(1);
        self.recent[0] = mdeg;
    }

    fn watch_apart(&mut self, is_apart: bool) {
        let agree = |side: &Side| side.slopes.is_some_and(|slopes| slopes.state == AGREE);
        if !is_apart || !self.sides.iter().any(agree) {
            self.apart_ns = None;
            return;
        }
        let now_ns = self.sync_ns;
        let since_ns = *self.apart_ns.get_or_insert(now_ns);
        if now_ns.saturating_sub(since_ns) > MAY_LAST_NS {
            let accused = self.sides.iter_mut().filter(|side| agree(side));
            accused.for_each(|side| side.checks.add(Check::State, now_ns));
        }
    }

    /// Side `number` has told its difference.
    #[inline]
    pub(super) fn detail(&mut self, number: usize, time_ns: u64) {
        let Some(side) = self.sides.get_mut(number) else {
            return;
        };
        let Some(told) = side.detail.and_then(|detail| detail.difference_mdeg) else {
            return;
        };
        let told = i32::from(told) * if number == 0 { 1 } else { -1 };
        let mut any = false;
        for mdeg in self.recent.iter().flatten().flatten() {
            any = true;
            let own = (*mdeg).clamp(-LARGEST_MDEG, LARGEST_MDEG);
            if (own - told).abs() <= ROUNDING_MDEG {
                return;
            }
        }
        if any {
            side.checks.add(Check::Difference, time_ns);
        }
    }

    /// The log has a hole, or time has gone back: what lasted is not known any longer.
    pub(super) fn excuse(&mut self, time_ns: u64) {
        (self.apart_ns, self.at_odds_ns) = (None, None);
        self.recent = [[None; 2]; RECENT];
        self.sides.iter_mut().for_each(|side| side.excuse(time_ns));
    }
}

/// The lowest quality that stands for an angle.
const FIRST_ANGLE: u8 = 32;

/// 2021h of a pair that agrees.
const AGREE: u8 = 1;

/// 2^-24 of a circle to 0.001 deg, rounded.
const fn as_mdeg(steps: i32) -> i32 {
    ((steps as i64 * 360_000 + (1 << 23)) >> 24) as i32
}
