//! Rest, and the gravity of a quiet housing that contradicts the vertical.
//!
//! In: what each block of samples adds up to. Out: whether the machine is at rest, by how much the
//! stated uncertainty grows, and when the estimator has to begin again.
//!
//! At rest the housing hardly turns, the acceleration is what it was before, and beside the
//! vertical there is no more of it than the vertical's uncertainty explains. After a start that
//! explains anything; so there rest takes longer, and an acceleration that does not drift.
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
    /// Velocity that the last block gained, 2^-30 g s per step.
    gained: [i32; 2],
    /// The same of a block before, from which the acceleration must not drift: the first one that
    /// looked like rest, and at rest one of the last [`DRIFT_BLOCKS`].
    first: [i32; 2],
}

impl Quiet {
    /// True where the machine is at rest.
    pub(super) const fn at_rest(&self) -> bool {
        self.at_rest
    }

    /// The vertical was corrected, and so a block of the same acceleration gains `more`.
    pub(super) fn corrected(&mut self, more: [i32; 2]) {
        for gained in [&mut self.gained, &mut self.first] {
            for (gained, more) in gained.iter_mut().zip(more) {
                *gained = gained.saturating_add(more);
            }
        }
    }
}

impl Motion {
    /// Counts the blocks at rest, and those that contradict. A steady speed looks like rest; so
    /// from there on velocity is that against what is at rest now.
    pub(super) fn look_for_rest(&self, state: &mut MotionState, shown: Shown, gained: [i32; 2]) {
        let slower = |most: u32| shown.turned.iter().all(|t| t.unsigned_abs() < most);
        let last = core::mem::replace(&mut state.quiet.gained, gained);
        let steady = self.alike(gained, last);
        let square = mean_square(gained) >> 15;
        let fall = i64::from(self.period_q32 >> 12);
        // Five standard deviations of the tilt, and the noise. Where it starts, more than three
        // tell that it started wrongly.
        let deviations = match self.is_vague(state) {
            true => 3 * 3,
            false => 5 * 5,
        };
        let tilt = (deviations * i64::from(state.covariance.tilt()) * fall * fall) >> 20;
        let noise = (i64::from(self.rest_gain) * i64::from(self.rest_gain)) >> 15;
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
        // drifts. So it must not drift while a doubted vertical waits for rest, nor during a rest.
        let vague = state.covariance.tilt() > self.doubt;
        let doubted = vague && !quiet.at_rest;
        let drifts = vague != quiet.at_rest && !self.alike(gained, quiet.first);
        if quiet.rest == 0 || drifts {
            (quiet.rest, quiet.at_rest, quiet.first) = (0, false, gained);
        } else if !doubted && quiet.rest.is_multiple_of(DRIFT_BLOCKS) {
            quiet.first = gained;
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

    /// True for two blocks with the same acceleration.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn alike(&self, [x, y]: [i32; 2], [other_x, other_y]: [i32; 2]) -> bool {
        x.abs_diff(other_x).max(y.abs_diff(other_y)) < self.rest_gain
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
