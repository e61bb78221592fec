//! Rest, and the gravity of a quiet housing that contradicts the vertical.
//!
//! In: what each block of samples adds up to. Out: whether the machine is at rest, by how much the
//! stated uncertainty grows, and when the estimator has to begin again.
//!
//! At rest the housing hardly turns, rate and acceleration are what they were before, and beside
//! the vertical there is no more acceleration than the vertical's uncertainty explains. After a
//! start that explains anything; so there rest takes longer, and nothing that drifts. An arm that
//! sets out slowly is no longer at rest: its rate changes before it is large.
//!
//! Where there is more beside it, the machine changes its speed steadily, or the vertical is wrong:
//! the gyroscope is, or the housing was moved without a rate. Both look alike at first, so the
//! uncertainty contains what is seen. No machine gains speed at a steady rate for seconds; after
//! that the vertical is wrong.
//!
//! While the machine moves, gravity in a wrong frame is a velocity without end, and what is more
//! than any machine's contradicts the vertical as well.
//!
//! Left out: less contradiction than that while the machine moves, which one channel alone cannot
//! tell from the machine's own acceleration (`cross_check::gravity` compares two).

use super::block::Shown;
use super::{Motion, MotionState, mean_square};

/// Blocks of quiet gravity that contradict the vertical until the uncertainty contains them: one
/// may be a moment between two moves.
const CONTRADICTS: u32 = 2;

/// At rest the acceleration may change as little over so many blocks as from one to the next. Over
/// more, a bias of the gyroscope that is not known yet would turn the frame too far.
pub(super) const DRIFT_BLOCKS: u32 = 3;

/// Velocity that a block gained, 2^-30 g s per step, and its turns, 2^-30 rad per step.
type Moved = [i32; 5];

/// For how long the machine has been quiet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Quiet {
    /// Blocks in a row that look like rest.
    rest: u32,
    /// They have been enough: the machine is at rest.
    at_rest: bool,
    /// Blocks in a row whose quiet gravity contradicts the vertical.
    against: u32,
    /// Mean square of what the last of them had beside the vertical; a variance of tilt.
    beside: i64,
    /// The last block. Of it nothing but the velocity is compared, but two of a kind are smaller in
    /// the image.
    last: Moved,
    /// One before, from which neither acceleration nor rate must drift: the first one that looked
    /// like rest; of the acceleration, at rest one of the last [`DRIFT_BLOCKS`].
    first: Moved,
}

impl Quiet {
    /// True where the machine is at rest.
    pub(super) const fn at_rest(&self) -> bool {
        self.at_rest
    }

    /// Vertical and bias were corrected: a block of the same acceleration and rate has `more`.
    pub(super) fn corrected(&mut self, more: &Moved) {
        for moved in [&mut self.last, &mut self.first] {
            for (moved, more) in moved.iter_mut().zip(more) {
                *moved = moved.saturating_add(*more);
            }
        }
    }
}

impl Motion {
    /// Counts the blocks at rest, and those that contradict. A steady speed looks like rest; so
    /// from there on velocity is that against what is at rest now.
    pub(super) fn look_for_rest(&self, state: &mut MotionState, shown: Shown, gained: [i32; 2]) {
        let slower = |most: u32| shown.turned.iter().all(|t| t.unsigned_abs() < most);
        let ([x, y], [turn_x, turn_y, turn_z]) = (gained, shown.turned);
        let now = [x, y, turn_x, turn_y, turn_z];
        let steady = self.alike(&now[..2], &state.quiet.last[..2]);
        state.quiet.last = now;
        let square = mean_square(gained) >> 15;
        let fall = i64::from(self.period_q32 >> 12);
        // Five standard deviations of the tilt, and the noise. Where it starts, more than three
        // tell that it started wrongly.
        let deviations = match self.is_vague(state) {
            true => 3 * 3,
            false => 5 * 5,
        };
        let tilt = (deviations * i64::from(state.covariance.tilt()) * fall * fall) >> 20;
        let noise = (i64::from(self.rest_change[0]) * i64::from(self.rest_change[0])) >> 15;
        let level = square < tilt + noise;
        let quiet = &mut state.quiet;
        // A gyroscope that is wrong turns, too; but a cab that slews faster feels it.
        let against = steady && !level && slower(3 * self.rest_turn);
        // What it has beside the vertical, as a variance of tilt.
        let beside = (square.min(1 << 42) << 20).checked_div(fall * fall);
        let beside = beside.unwrap_or(0);
        if against && self.gravity.contains(&shown.length_square) {
            quiet.against = quiet.against.saturating_add(1);
            quiet.beside = beside;
        } else if steady && level {
            // Where it has contradicted, the vertical is as uncertain as what is left of it.
            if quiet.against >= CONTRADICTS {
                state.covariance.widen_tilt(beside);
            }
            quiet.against = 0;
        } else {
            // A blow, or a move, shows neither that the vertical is right nor that it is wrong.
            quiet.against = quiet.against.saturating_sub(1);
        }
        if !(steady && level && slower(self.rest_turn)) {
            (quiet.rest, quiet.at_rest) = (0, false);
            return;
        }
        // Where a boom turns back, or sets out, it is slow and steady, too, but its acceleration
        // and its rate drift. So they must not while a doubted vertical waits for rest, nor during
        // a rest.
        let vague = state.covariance.tilt() > self.doubt;
        let doubted = vague && !quiet.at_rest;
        let drifts = vague != quiet.at_rest && !self.alike(&now, &quiet.first);
        if quiet.rest == 0 || drifts {
            (quiet.rest, quiet.at_rest, quiet.first) = (0, false, now);
        } else if !doubted && quiet.rest.is_multiple_of(DRIFT_BLOCKS) {
            let [first_x, first_y, ..] = &mut quiet.first;
            (*first_x, *first_y) = (x, y);
        }
        quiet.rest = quiet.rest.saturating_add(1);
        let enough = match doubted {
            true => self.doubted_blocks,
            false => self.rest_blocks,
        };
        if quiet.rest >= enough && !quiet.at_rest {
            quiet.at_rest = true;
            // What this block has gained is added. The vertical would follow it twice: now, and as
            // soon as the tilt explains it.
            state.velocity = gained.map(i32::saturating_neg);
            state.covariance.forget_velocity(self.rest_variance);
        }
    }

    /// True for two blocks with the same acceleration, and the same rate where it is given.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn alike(&self, these: &[i32], those: &[i32]) -> bool {
        let both = these.iter().zip(those).zip(&self.rest_change);
        let mut changes = both.map(|((this, that), most)| this.abs_diff(*that) < *most);
        changes.all(|small| small)
    }

    /// The variance of tilt that quiet gravity shows beside the vertical; 0 where it does not
    /// contradict.
    pub(super) const fn contradiction(state: &MotionState) -> i64 {
        if state.quiet.against >= CONTRADICTS {
            state.quiet.beside
        } else {
            0
        }
    }

    /// True where quiet gravity has contradicted for too long: at once where the vertical is not
    /// known yet, so that nothing is lost with it. And where the vertical gives the machine a
    /// velocity that none has.
    pub(super) fn refuted(&self, state: &MotionState) -> bool {
        let most = match self.is_vague(state) {
            true => CONTRADICTS,
            false => self.refuted_blocks,
        };
        state.quiet.against >= most || state.seen > self.most_speed.into()
    }

    /// True where the vertical is not known yet, whatever contradicts it.
    pub(super) fn is_vague(&self, state: &MotionState) -> bool {
        state.unshared > self.limit
    }
}
