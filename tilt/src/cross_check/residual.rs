//! The three-axis residual: the difference of the two calibrated accelerations, low-passed.
//!
//! In: both channels' vectors of the same instant (2^-26 g per step) and the time since the pair
//! before. Out: whether the difference is larger than two healthy channels can have. Both
//! channels feel the same motion, so the difference holds their errors alone: a step or drift of
//! the zero-g offset, a gain, a sagging supply, a swapped axis.
//!
//! Two healthy channels differ a little, and steadily: what switching on, hysteresis and
//! calibration have left in each. That baseline is learned while they agree, up to half of what the
//! whole difference may be, and taken off; what remains is as small as the pair's noise. The
//! difference goes through low-passes of different lengths, each with its own thresholds: the short
//! ones find large faults at once, the long ones small ones. In a shock two healthy channels differ
//! by ten times as much as without one, briefly, so each low-pass has one threshold for calm and
//! one for shaken times. Beside them the whole difference, baseline included, has a threshold of
//! its own, so that a fault that was there from the start, or grows slowly, is found.
//!
//! A pair whose uncertainty is wide may differ by more, baseline and changes of pose alike: above
//! [`Residual::whole`] each threshold grows with the uncertainty, and the baseline with it. Without
//! a temperature model the offsets of both channels drift apart with the temperature, which the
//! baseline takes up, and their sensitivities, which shows when the housing turns.
//!
//! Left out: which of the two is wrong; that takes a standstill (`standstill`).

use crate::saturate::saturate;
use crate::vector::Corrected;

/// One low-pass with its thresholds, 2^-26 g per step, of the length of the vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stage {
    /// Time constant, us; 0 lets every pair stand for itself.
    pub tau_us: u32,
    /// Differences above this are faults.
    pub calm: u32,
    /// The same while a shock goes through the machine, or it is not known whether one does.
    pub shaken: u32,
}

/// Low-passes in use.
pub const STAGES: usize = 5;

/// Configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Residual {
    /// The low-passes of the difference without its baseline, the longest last.
    pub stages: [Stage; STAGES],
    /// Time constant of the low-pass of the whole difference, us.
    pub whole_us: u32,
    /// The whole difference above this is a fault, 2^-26 g per step.
    pub whole: u32,
    /// It is at least this many combined standard uncertainties of the pair.
    pub coverage: u32,
    /// Time constant with which the baseline is learned, us.
    pub baseline_us: u32,
}

/// A thousandth of g in 2^-26 g.
const MG: u32 = 67_109;

/// How long a baseline takes to be known, us.
const KNOWN_US: u32 = 5_000_000;

impl Residual {
    /// What two LIS2DW12 channels on one housing never reach in healthy work; `docs/faults.md`
    /// has the evidence.
    pub const PRODUCT: Self = Self {
        stages: [
            stage(0, 20 * MG, 110 * MG),
            stage(20_000, 9 * MG, 45 * MG),
            stage(100_000, 6 * MG, 13 * MG),
            stage(250_000, 4 * MG, 11 * MG / 2),
            stage(500_000, 3 * MG, 7 * MG / 2),
        ],
        whole_us: 500_000,
        whole: 4 * MG,
        coverage: 5,
        baseline_us: 100_000_000,
    };
}

const fn stage(tau_us: u32, calm: u32, shaken: u32) -> Stage {
    Stage {
        tau_us,
        calm,
        shaken,
    }
}

/// What the detector remembers; accelerations in 2^-34 g per step, which leaves room for +-8 g in
/// each of three axes.
#[derive(Clone, Copy, Debug, Default)]
pub struct ResidualState {
    low: [[i64; 3]; STAGES],
    whole: [i64; 3],
    /// As `whole`, without an end.
    shown: [i64; 3],
    baseline: [i64; 3],
    /// How long the baseline has been learned, us.
    learned_us: u32,
}

/// Fraction bits of the low-passes below 2^-26 g, against a dead band.
const FRACTION: u32 = 8;

impl ResidualState {
    /// The whole difference own minus peer, low-passed, 2^-26 g per step.
    pub fn difference(&self) -> [i32; 3] {
        self.shown.map(|low| {
            let steps = towards_zero(low, FRACTION);
            saturate(steps)
        })
    }

    /// The baseline: what own minus peer usually is, 2^-26 g per step.
    pub fn baseline(&self) -> [i32; 3] {
        self.baseline
            .map(|baseline| towards_zero(baseline, FRACTION) as i32)
    }

    /// What the two usually differ by is learned anew.
    pub const fn begin_anew(&mut self) {
        self.learned_us = 0;
    }

    /// There was a gap: the low-passes start from zero. The baseline stays.
    pub fn restart(&mut self) {
        self.low = [[0; 3]; STAGES];
        self.whole = [0; 3];
        self.shown = [0; 3];
    }
}

impl Residual {
    /// Takes in a pair `elapsed_us` after the one before; true when a threshold is exceeded.
    ///
    /// `uncertainty` is the combined standard uncertainty of the pair, 2^-26 g per step; `shaken`
    /// means that a shock may be going through the machine.
    pub fn step(
        &self,
        state: &mut ResidualState,
        [own, peer]: [&Corrected; 2],
        uncertainty: u32,
        shaken: bool,
        elapsed_us: u32,
    ) -> bool {
        let mut whole = [0; 3];
        for (d, (own, peer)) in whole.iter_mut().zip(own.accel.iter().zip(&peer.accel)) {
            *d = i64::from(*own) - i64::from(*peer);
        }
        self.take(state, whole, uncertainty, shaken, elapsed_us)
    }

    /// The same with the difference own minus peer, 2^-26 per step, of whatever unit the
    /// thresholds are.
    pub(super) fn take(
        &self,
        state: &mut ResidualState,
        difference: [i64; 3],
        uncertainty: u32,
        shaken: bool,
        elapsed_us: u32,
    ) -> bool {
        let whole = difference.map(|axis| axis << FRACTION);
        let least = uncertainty.saturating_mul(self.coverage);
        let threshold = self.whole.max(least);
        let counted_us = elapsed_us.min(LONGEST_US);
        let share = share_q22(counted_us, self.whole_us);
        follow(&mut state.shown, &whole, share);
        follow(&mut state.whole, &whole, share);
        let mut exceeded = exceeds(&mut state.whole, threshold, threshold);
        // Half for what is steady, half for what changes with the pose; 1 mg of noise on top.
        let half = threshold / 2;
        let least = (least / 2).saturating_add(MG);
        let known = state.learned_us >= KNOWN_US;
        let mut rest = whole;
        for (rest, baseline) in rest.iter_mut().zip(&state.baseline) {
            *rest -= baseline;
        }
        for (stage, low) in self.stages.iter().zip(&mut state.low) {
            follow(low, &rest, share_q22(counted_us, stage.tau_us));
            let highest = stage.shaken.max(least);
            let threshold = if shaken {
                highest
            } else {
                stage.calm.max(least)
            };
            exceeded |= exceeds(low, threshold, highest) && known;
        }
        if !exceeded {
            self.learn(state, &whole, half, elapsed_us);
        }
        exceeded
    }

    /// The first pairs count by their time, later ones by the time constant.
    fn learn(&self, state: &mut ResidualState, whole: &[i64; 3], limit: u32, elapsed_us: u32) {
        let so_far_us = state.learned_us.min(self.baseline_us);
        follow(&mut state.baseline, whole, share_q22(elapsed_us, so_far_us));
        let limit = i64::from(limit) << FRACTION;
        for baseline in &mut state.baseline {
            *baseline = (*baseline).clamp(-limit, limit);
        }
        state.learned_us = state.learned_us.saturating_add(elapsed_us);
    }
}

/// A pair counts for this long at most: on a slow bus a shock that is seen once must not count
/// for more than on a fast one.
const LONGEST_US: u32 = 20_000;

/// A low-pass holds up to this many times its threshold on each axis: beyond, it would take the
/// longer to come back the larger the fault was that has gone.
const CEILING: i64 = 4;

fn stop(low: &mut [i64; 3], threshold: u32) {
    let limit = (i64::from(threshold) << FRACTION) * CEILING;
    for low in low {
        *low = (*low).clamp(-limit, limit);
    }
}

/// Whether a low-pass is longer than `threshold`, which is at most `highest`; it is held below
/// [`CEILING`] times that, 2^-26 g per step.
fn exceeds(low: &mut [i64; 3], threshold: u32, highest: u32) -> bool {
    let largest = low.iter().fold(0, |most, c| c.unsigned_abs().max(most));
    // Three axes of half the threshold each are shorter than it. Mostly that is all.
    if largest <= u64::from(threshold) << (FRACTION - 1) {
        return false;
    }
    stop(low, highest);
    length_exceeds(low, threshold)
}

/// More than two vectors of 8 g are apart: a share of it has room in 64 bits.
const LONGEST_WAY: i64 = 1 << 40;

/// Longer times count as this, 35 minutes, us: below half of 32 bits there is room for a digit.
const LONGEST_SHARE_US: u32 = u32::MAX / 2;

/// Takes a low-pass a share of the way to the value. 2^-22 is the least share: a hundred seconds
/// in steps of a millisecond are 2^-17.
fn follow(low: &mut [i64; 3], value: &[i64; 3], share: u32) {
    for (low, value) in low.iter_mut().zip(value) {
        let way = value - *low;
        // Healthy channels are less than 0.1 g apart, and then one multiplication will do.
        let part = match i32::try_from(way) {
            Ok(way) => i64::from(way) * i64::from(share),
            Err(_) => way.clamp(-LONGEST_WAY, LONGEST_WAY) * i64::from(share),
        };
        *low += towards_zero(part, 22);
    }
}

/// `value` / 2^`bits`, towards zero. A shift alone rounds down: the peer, to whom each difference
/// has the other sign, would round it the other way and could judge otherwise.
pub(super) const fn towards_zero(value: i64, bits: u32) -> i64 {
    (value + ((value >> 63) as u64 >> (64 - bits)) as i64) >> bits
}

/// `elapsed` / (`elapsed` + `tau`) in 2^-22, rounded down: long division by the chip's own of 32
/// bits, as many digits at a time as there is room for.
pub(super) fn share_q22(elapsed_us: u32, tau_us: u32) -> u32 {
    let elapsed_us = elapsed_us.min(LONGEST_SHARE_US);
    let sum = elapsed_us.saturating_add(tau_us);
    let whole = sum.clamp(1, LONGEST_SHARE_US);
    let (mut share, mut rest) = (elapsed_us / whole, elapsed_us % whole);
    let mut left = 22;
    while left > 0 {
        // A rest is smaller than what divides it, so it has at least as much room above.
        let digits = whole.leading_zeros().min(left);
        let next = rest << digits;
        share = (share << digits) | (next / whole);
        rest = next % whole;
        left -= digits;
    }
    share
}

/// True when the vector is longer than `threshold`, 2^-26 g per step, without a root. A threshold
/// above 4 g counts as 4 g.
fn length_exceeds(vector: &[i64; 3], threshold: u32) -> bool {
    // A product of 32 bits is one instruction.
    let square = |value: u32| u64::from(value) * u64::from(value);
    let size = |c: i64| u32::try_from(c.unsigned_abs() >> 4).unwrap_or(u32::MAX);
    let squares = vector.iter().map(|c| square(size(*c)));
    let sum = squares.fold(0u64, u64::saturating_add);
    sum > square(threshold.min((1 << 28) - 1) << (FRACTION - 4))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ONE_G;

    const LEVEL: Corrected = Corrected {
        accel: [0, 0, ONE_G],
    };

    fn shifted(mg: f64) -> Corrected {
        Corrected {
            accel: [(mg * f64::from(MG)) as i32, 0, ONE_G],
        }
    }

    #[test]
    fn a_pair_was_blind_where_sync_came_every_200_ms_or_slower() {
        for period_us in [200_000, 300_000, 1_000_000, 10_000_000] {
            let mut state = ResidualState::default();
            let mut step = |mg| {
                Residual::PRODUCT.step(&mut state, [&shifted(mg), &LEVEL], 0, false, period_us)
            };
            assert!((0..60).all(|_| !step(1.0)));
            let after = [40.0, 10.0].map(|mg| (0..60).position(|_| step(mg)));
            assert_eq!(after[0], Some(0), "{period_us}");
            assert!(
                after[1].is_some_and(|pairs| pairs < 20),
                "{period_us} {after:?}"
            );
        }
    }

    /// Steps of 20 ms; `baseline` mg for `before` pairs, then the pair until it is
    /// found.
    fn found_after(baseline: f64, before: usize, mg: f64, most: usize) -> Option<usize> {
        let mut state = ResidualState::default();
        let mut step =
            |mg| Residual::PRODUCT.step(&mut state, [&shifted(mg), &LEVEL], 0, false, 20_000);
        assert!((0..before).all(|_| !step(baseline)));
        (0..most).find(|_| step(mg))
    }

    #[test]
    fn the_whole_difference_may_be_4_mg_from_the_start() {
        assert_eq!(found_after(0.0, 0, 3.99, 3000), None);
        assert_eq!(found_after(0.0, 0, -3.99, 3000), None);
        assert!(found_after(0.0, 0, 4.1, 3000).is_some());
    }

    #[test]
    fn a_baseline_is_taken_off_up_to_2_mg() {
        assert_eq!(found_after(1.5, 1000, 1.5, 10_000), None);
        let five = found_after(1.5, 1000, 6.5, 100).expect("found");
        assert!((15..36).contains(&five), "{five}");
        let back = found_after(-1.5, 1000, 3.5, 100).expect("4 mg alone would not show it");
        assert!((15..36).contains(&back), "{back}");
    }

    #[test]
    fn the_larger_the_sooner() {
        let after = [4.8, 5.0, 10.0, 50.0, 1000.0]
            .map(|mg| found_after(0.0, 500, mg, 1000).expect("found"));
        assert!(after.is_sorted_by(|a, b| a >= b), "{after:?}");
        assert!(after[1] < 36 && after[2] < 12, "{after:?}");
        assert!(after[3] <= 1 && after[4] == 0, "{after:?}");
    }

    #[test]
    fn a_swapped_axis_was_held_against_the_pair_for_ten_seconds_after_its_end() {
        // 50 ms between pairs, as on a slow bus.
        let mut state = ResidualState::default();
        let mut step =
            |mg| Residual::PRODUCT.step(&mut state, [&shifted(mg), &LEVEL], 0, false, 50_000);
        assert!((0..300).all(|_| !step(0.0)));
        assert!((0..200).filter(|_| step(1400.0)).count() > 190);
        let over = (0..1000).find(|_| !step(0.0)).expect("it ends");
        assert!(over < 40, "{over}");
    }

    #[test]
    fn a_slow_drift_is_not_learned_away() {
        let mut state = ResidualState::default();
        let mut mg = 0.0;
        let found = (0..10_000).find(|_| {
            mg += 0.2 * 0.02;
            Residual::PRODUCT.step(&mut state, [&shifted(mg), &LEVEL], 0, false, 20_000)
        });
        assert!(found.is_some() && mg < 4.3, "{mg} mg");
    }

    #[test]
    fn a_shock_allows_more() {
        let found = |mg: f64, shaken: bool| {
            let mut state = ResidualState::default();
            let mut step = |mg, shaken| {
                Residual::PRODUCT.step(&mut state, [&shifted(mg), &LEVEL], 0, shaken, 20_000)
            };
            assert!((0..300).all(|_| !step(0.0, false)));
            step(mg, shaken)
        };
        assert_eq!((found(60.0, true), found(17.0, false)), (false, false));
        assert_eq!((found(120.0, true), found(21.0, false)), (true, true));
    }

    #[test]
    fn a_vague_pair_is_allowed_more() {
        let mut state = ResidualState::default();
        let check = Residual::PRODUCT;
        let wide = |state: &mut ResidualState, mg| {
            check.step(state, [&shifted(mg), &LEVEL], 2 * MG, false, 20_000)
        };
        assert!(
            (0..200).all(|_| !wide(&mut state, 9.0)),
            "five uncertainties are 10 mg"
        );
        assert!((0..200).any(|_| wide(&mut state, 11.0)));
    }

    #[test]
    fn differences_were_rounded_down_so_that_a_pair_in_the_other_order_was_not_judged_alike() {
        let check = Residual::PRODUCT;
        let (mut here, mut there) = (ResidualState::default(), ResidualState::default());
        let mut seed = 0x2545_F491_4F6C_DD1D_u64;
        for n in 0..20_000 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let [x, y, z] = [25, 29, 32].map(|bits| (seed >> bits) as i32 % (3 * MG as i32));
            let own = Corrected {
                accel: [x, y, ONE_G + z],
            };
            let shaken = n % 7 == 0;
            let judged = check.step(&mut here, [&own, &LEVEL], 0, shaken, 20_000);
            let seen = check.step(&mut there, [&LEVEL, &own], 0, shaken, 20_000);
            assert_eq!(judged, seen, "{n}");
            assert_eq!(here.difference(), there.difference().map(|d| -d), "{n}");
            assert_eq!(here.baseline(), there.baseline().map(|d| -d), "{n}");
        }
    }

    #[test]
    fn a_share_is_the_quotient_rounded_down() {
        let times = [0, 1, 3, 999, 2_500, 20_000, 100_000_000, 1 << 30, u32::MAX];
        for elapsed in times {
            for tau in times {
                let counted = elapsed.min(LONGEST_SHARE_US);
                let whole = counted.saturating_add(tau).clamp(1, LONGEST_SHARE_US);
                let exact = (u64::from(counted) << 22) / u64::from(whole);
                assert_eq!(u64::from(share_q22(elapsed, tau)), exact, "{elapsed} {tau}");
            }
        }
    }

    #[test]
    fn a_length_is_compared_alike_where_it_is_short_and_where_it_saturates() {
        let longer = |c: i64, threshold| length_exceeds(&[c << FRACTION, 0, 0], threshold);
        for threshold in [0, 1, 5000, (1 << 27) - 1, 1 << 27, (1 << 28) - 1] {
            for sign in [-1, 1] {
                let at = sign * i64::from(threshold);
                let above = longer(at + sign, threshold);
                assert!(above && !longer(at, threshold), "{at}");
            }
            assert!(length_exceeds(&[i64::MIN; 3], threshold));
        }
        for threshold in [1 << 28, u32::MAX] {
            let [four, more] = [(1 << 28) - 1, 1 << 28].map(|c| longer(c, threshold));
            assert!(more && !four && length_exceeds(&[i64::MIN; 3], threshold));
        }
    }

    #[test]
    fn extremes_do_not_overflow() {
        let mut state = ResidualState::default();
        let [low, high] = [i32::MIN, i32::MAX].map(|v| Corrected { accel: [v; 3] });
        for elapsed in [0, 1, u32::MAX] {
            for uncertainty in [0, u32::MAX] {
                let check = Residual::PRODUCT;
                check.step(&mut state, [&low, &high], uncertainty, false, elapsed);
                check.step(&mut state, [&high, &low], uncertainty, true, elapsed);
            }
        }
        assert!((0..100).any(|_| Residual::PRODUCT.step(
            &mut state,
            [&high, &low],
            0,
            true,
            u32::MAX
        )));
    }
}
