//! Faults put into one of two real channels, and what the check reports of them.
//!
//! In: a [`Board`] and a [`ProductCheck`]. Out: what the healthy pair is told of itself
//! ([`Healthy`]), and for each kind of fault a [`Tally`] over all moments.
//!
//! A trial goes on from the healthy run: the check has learned what it had learned by then. Faults
//! go into channel 1 and 2 in turn, into axes x, y and z in turn, up and down in turn.

use sim::fault::SensorFault;
use sim::rng::Rng;
use tilt::cross_check::{Judgement, Member, ProductCheck, ProductState, RateState};

use super::board::{Board, PAIR_US, Pair};

/// What the healthy pair is told.
#[derive(Default)]
pub struct Healthy {
    /// Time lying still, s.
    pub still_s: f64,
    /// Alarms in it.
    pub still_alarms: u32,
    /// Turns by hand from one pose to the next.
    pub turns: u32,
    /// Turns with an alarm.
    pub turns_told: u32,
    /// Share of the vigorous motion that is under an alarm.
    pub shaken_told: f64,
    /// From its beginning to the first alarm, s.
    pub shaken_after_s: Option<f64>,
    /// Pairs at which a channel is named, although both are healthy.
    pub named: u32,
    /// What the check remembers before each kept pair.
    pub states: Vec<(usize, ProductState)>,
}

/// What is told of one fault.
#[derive(Clone, Copy, Debug, Default)]
struct Told {
    after_s: Option<f64>,
    right: bool,
    wrong: bool,
    wrong_lying: bool,
}

/// What is told of one kind of fault at all moments.
#[derive(Default)]
pub struct Tally {
    /// Trials.
    pub trials: usize,
    /// Delays of those that were told, s, ascending.
    pub told_s: Vec<f64>,
    /// The channel with the fault was named, and the other one never.
    pub right: usize,
    /// The healthy channel was named at some time.
    pub wrong: usize,
    /// It was first named while the board lay still.
    pub wrong_lying: usize,
}

/// Plays the healthy pair.
pub fn healthy(board: &Board, check: &ProductCheck) -> Healthy {
    let mut seen = Healthy::default();
    let mut state = ProductState::default();
    let mut before = false;
    let mut motion = (0, 0);
    let mut turn_told = vec![false; board.stills.len()];
    for (index, pair) in board.pairs.iter().enumerate() {
        if board.kept.contains_key(&index) {
            seen.states.push((index, state));
        }
        let judgement = check.judge(
            (&mut state, None::<&mut RateState>),
            &pair.own,
            &pair.peer,
            pair.now,
        );
        let told = judgement.is_fault();
        seen.named += u32::from(matches!(judgement, Judgement::OneChannel { .. }));
        if (board.motion.0..board.motion.1).contains(&pair.now.0) {
            motion = (motion.0 + 1, motion.1 + u32::from(told));
            let since_s = (pair.now.0 - board.motion.0) as f64 / 1e6;
            if told && seen.shaken_after_s.is_none() {
                seen.shaken_after_s = Some(since_s);
            }
        } else if pair.lies {
            seen.still_s += PAIR_US as f64 / 1e6;
            seen.still_alarms += u32::from(told && !before);
        } else if let Some(turn) = turn(board, pair) {
            turn_told[turn] |= told;
        }
        before = told;
    }
    seen.turns = board.stills.len() as u32 - 1;
    seen.turns_told = turn_told.iter().filter(|told| **told).count() as u32;
    seen.shaken_told = f64::from(motion.1) / f64::from(motion.0.max(1));
    seen
}

/// Which turn a pair belongs to that doesn't lie.
fn turn(board: &Board, pair: &Pair) -> Option<usize> {
    let after = board.stills.iter().position(|(_, to)| *to > pair.now.0)?;
    after.checked_sub(1)
}

/// How trials of one part of the recording are run.
#[derive(Clone, Copy)]
pub struct Plan {
    /// The pairs of the beginning.
    pub from: usize,
    /// One pair beyond the last beginning.
    pub to: usize,
    /// How long each is watched, pairs.
    pub watched: usize,
    /// Only what is told while the board lies still counts, or names the channel.
    pub still: bool,
}

/// Runs a kind of fault at every kept pair of the plan; `None` is no fault at all.
pub fn trials(
    board: &Board,
    check: &ProductCheck,
    healthy: &Healthy,
    plan: Plan,
    fault: &dyn Fn(usize, f64) -> Option<SensorFault>,
) -> Tally {
    let mut tally = Tally::default();
    let begins = healthy.states.iter();
    for (index, state) in begins.filter(|(index, _)| (plan.from..plan.to).contains(index)) {
        let turn = tally.trials;
        let sign = if (turn / 6).is_multiple_of(2) {
            1.0
        } else {
            -1.0
        };
        let fault = fault((turn / 2) % 3, sign);
        let faulty = [Member::Own, Member::Peer][turn % 2];
        let told = trial(board, check, (*index, *state), plan, (faulty, fault));
        tally.trials += 1;
        tally.told_s.extend(told.after_s);
        tally.right += usize::from(told.right && !told.wrong);
        tally.wrong += usize::from(told.wrong);
        tally.wrong_lying += usize::from(told.wrong_lying);
    }
    tally.told_s.sort_by(f64::total_cmp);
    tally
}

fn trial(
    board: &Board,
    check: &ProductCheck,
    (begin, mut state): (usize, ProductState),
    plan: Plan,
    (faulty, fault): (Member, Option<SensorFault>),
) -> Told {
    let mut told = Told::default();
    let (Some([own, peer]), Some(first)) = (board.kept.get(&begin), board.pairs.get(begin)) else {
        return told;
    };
    let rng = Rng::stream(begin as u64, "fault in a real channel");
    let healthy = if faulty == Member::Own { own } else { peer };
    let mut channel = match fault {
        Some(fault) => healthy.with(fault, first.now, rng),
        None => healthy.clone(),
    };
    for pair in board.pairs.iter().skip(begin).take(plan.watched) {
        let seen = channel.observe(pair.now);
        let (own, peer) = match faulty {
            Member::Own => (seen, pair.peer),
            Member::Peer => (pair.own, seen),
        };
        let judgement = check.judge((&mut state, None::<&mut RateState>), &own, &peer, pair.now);
        told.take(judgement, faulty, plan.still && pair.lies, || {
            pair.now.micros_since(first.now) as f64 / 1e6
        });
    }
    told
}

impl Told {
    fn take(
        &mut self,
        judgement: Judgement,
        faulty: Member,
        lies: bool,
        after_s: impl Fn() -> f64,
    ) {
        let mut counts = lies && judgement.is_fault();
        if let Judgement::OneChannel { faulty: named, .. } = judgement {
            self.right |= named == faulty;
            self.wrong_lying |= named != faulty && lies && !self.wrong;
            self.wrong |= named != faulty;
            counts |= named == faulty;
        }
        if counts && self.after_s.is_none() {
            self.after_s = Some(after_s());
        }
    }
}

impl Tally {
    /// The delay that `share` of all trials stay within, s; none when fewer were told.
    pub fn within_s(&self, share: f64) -> Option<f64> {
        let rank = (share * self.trials as f64).ceil() as usize;
        self.told_s.get(rank.checked_sub(1)?).copied()
    }
}
