//! Which of two sensors of a kind contradicts gravity, while the machine moves.
//!
//! In: for each pair the mean and the difference of both accelerations, how far either gyroscope
//! has turned, and which of the two kinds differ. Out: the channel whose sensor is the wrong one,
//! once gravity shows it.
//!
//! Gravity stands still in space, and what a machine adds to it averages out, since its speed stays
//! small. So the acceleration is low-passed in space: what was averaged is turned back by as much
//! as the housing has turned. While the pair agrees, that average is the place of gravity. When
//! the two gyroscopes differ, that place is kept and carried on by either of them: the acceleration
//! leaves the one that the wrong gyroscope carries. When the two accelerations differ, the place is
//! carried on by the gyroscopes, which agree, and the wrong acceleration leaves it. In both cases
//! one of two vectors has moved from the place by their whole difference, and the other one has
//! not; what the machine does moves both alike, so it only blurs which.
//!
//! How much it blurs is measured: the acceleration's usual distance from its average, of which two
//! low-passes one after the other leave a share each. Where the machine pauses, a mean over the
//! pause is blurred by what shakes it only, and shows at once what a turn has left.
//!
//! Left out: the rate about gravity itself, which moves nothing; a gyroscope wrong about that axis
//! alone is named once the machine has tilted.

use super::Member;
use super::residual::{share_q22, towards_zero};
use crate::motion::frame::Turn as Rotation;
use crate::root::{root, root_sum};

/// Configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gravity {
    /// Time constant of each of the two low-passes, us.
    pub tau_us: u32,
    /// How far apart the two vectors have to be, 2^-26 g.
    pub least: u32,
    /// Standard uncertainty of gravity as a share of the usual distance from the average, in 1/64:
    /// behind one low-pass and behind both.
    pub blur: [u32; 2],
    /// The same of a mean over a pause, as a share of the change from pair to pair, in 1/16.
    pub paused: u32,
    /// At least so much, 2^-26 g.
    pub floor: u32,
    /// What a place that is carried on loses, 2^-26 g in a second.
    pub drift: u32,
    /// How many standard uncertainties the two have to be apart.
    pub coverage: u32,
    /// A machine pauses where one gyroscope turns by less than this about each axis, 2^-30 rad/s.
    pub slow: u32,
    /// In a pause one gyroscope reads at most the first about each axis, and the one that is wrong
    /// at least the second about one, 2^-30 rad/s.
    pub reads: [u32; 2],
    /// A machine moves where both gyroscopes turn by more than this about an axis, 2^-30 rad/s.
    pub moves: u32,
    /// A mean over a pause is over so much, us.
    pub pause_us: u32,
    /// For how long the place has to have been averaged, us.
    pub known_us: u32,
    /// How long it is carried on, us: the bias of a gyroscope turns it away.
    pub longest_us: u32,
    /// For how long a channel has to be the wrong one, us.
    pub confirm_us: u32,
    /// Two that have not differed for so long differ no more, us.
    pub alike_us: u32,
}

/// A thousandth of g in 2^-26 g.
const MG: u32 = 67_109;

impl Gravity {
    /// For two ISM330DHCX on a machine that digs; the example `gyroscope_faults` of `sim` prints
    /// the evidence.
    pub const PRODUCT: Self = Self {
        tau_us: 6_000_000,
        least: 5 * MG,
        blur: [16, 4],
        paused: 5,
        floor: 3 * MG / 2,
        drift: MG / 6,
        coverage: 3,
        // 0.6 deg/s.
        slow: 11_244_000,
        // 0.15 and 0.3 deg/s.
        reads: [2_811_000, 5_622_000],
        // 3 deg/s.
        moves: 56_220_000,
        pause_us: 190_000,
        known_us: 10_000_000,
        longest_us: 60_000_000,
        confirm_us: 250_000,
        alike_us: 2_000_000,
    };
}

/// What differs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The accelerations.
    Accelerations,
    /// The rates of turn.
    Rates,
}

/// How far the housing has turned since the pair before, rad in 2^-30, about its axes.
pub type Turn = [i32; 3];

/// What one pair shows.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Mean of the two accelerations, and half of own minus peer, 2^-26 g; `None` where one is
    /// missing.
    pub accelerations: Option<[[i32; 3]; 2]>,
    /// By the own gyroscope, by the peer's.
    pub turns: [Turn; 2],
    /// A shock may be going through the machine.
    pub shaken: bool,
    /// Time since the pair before, us.
    pub elapsed_us: u32,
}

impl Pair {
    /// The fastest axis of the gyroscope that turns less, 2^-30 rad.
    fn slower(&self) -> u32 {
        let [own, peer] = &self.turns;
        fastest(own).min(fastest(peer))
    }
}

/// A vector that stands still in space, seen from the housing; 2^-26 g.
#[derive(Clone, Copy, Debug, Default)]
struct Followed {
    now: [i32; 3],
    /// Sum over the pause under way, 2^-20 g.
    sum: [i32; 3],
    near: [i32; 3],
    far: [i32; 3],
    /// Where gravity is: the best of what was averaged; carried on while the two differ.
    place: [i32; 3],
}

/// What is remembered.
#[derive(Clone, Copy, Debug)]
pub struct GravityState {
    /// The mean, carried by the own gyroscope.
    mean: Followed,
    /// Half of the difference, carried by the own gyroscope; while rates differ, the mean carried
    /// by the peer's.
    other: Followed,
    dispute: Option<Kind>,
    /// For how long the place has been averaged, or carried on; us.
    age_us: u32,
    /// Usual distance of the mean from its average, 2^-26 g.
    usual: u32,
    /// Standard uncertainty of the place, 2^-26 g.
    blur: u32,
    /// Of the pause under way: pairs, time in us, and the sum of what the mean has changed by from
    /// pair to pair, 2^-26 g.
    paused: u16,
    paused_us: u32,
    /// For how long a gyroscope has been slow, us.
    slow_us: u32,
    change: u32,
    /// By how much own and peer have turned in it.
    turned: [Turn; 2],
    /// The channel that read a rate in a pause before, and whether the machine has moved since.
    reads: Option<(Member, bool)>,
    /// The channel that was the wrong one, and for how long; us.
    suspect: Option<Member>,
    suspect_us: u32,
    /// For how long the two have not differed, us.
    alike_us: u32,
}

impl Default for GravityState {
    fn default() -> Self {
        Self {
            mean: Followed::default(),
            other: Followed::default(),
            dispute: None,
            age_us: 0,
            usual: 0,
            blur: u32::MAX,
            paused: 0,
            paused_us: 0,
            slow_us: 0,
            change: 0,
            turned: [[0; 3]; 2],
            reads: None,
            suspect: None,
            suspect_us: 0,
            alike_us: 0,
        }
    }
}

impl GravityState {
    /// The two differ, or have done so lately.
    pub(super) const fn is_disputed(&self) -> bool {
        self.dispute.is_some()
    }

    /// There was no pair: everything begins anew.
    pub fn restart(&mut self) {
        *self = Self::default();
    }
}

impl Followed {
    /// What stands in space turns back by what the housing turns.
    fn turn_back(&mut self, by: &Rotation) {
        for vector in [&mut self.near, &mut self.far, &mut self.place] {
            *vector = by.apply(*vector);
        }
    }

    fn follow(&mut self, value: &[i32; 3], share: u32) {
        self.now = *value;
        towards(&mut self.near, value, share);
        let near = self.near;
        towards(&mut self.far, &near, share);
    }

    /// A pair of a pause.
    fn pause(&mut self, value: &[i32; 3]) {
        for (sum, value) in self.sum.iter_mut().zip(value) {
            *sum = sum.saturating_add(value >> FINER);
        }
    }

    /// The mean over a pause of so many pairs, what is behind one low-pass, and behind both.
    fn averages(&self, pairs: u16) -> [[i32; 3]; 3] {
        let pairs = i32::from(pairs.max(1));
        let mean = self.sum.map(|sum| (sum / pairs) << FINER);
        [mean, self.near, self.far]
    }

    /// How far each of [`Followed::averages`] has left the place.
    fn left(&self, pairs: u16) -> [[i32; 3]; 3] {
        self.averages(pairs).map(|stage| minus(&stage, &self.place))
    }
}

/// How much of a pause is left out, us.
const SKIPPED_US: u32 = 80_000;

/// From 2^-26 g to the unit of a pause's sum.
const FINER: u32 = 6;

// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
pub(super) fn minus(a: &[i32; 3], b: &[i32; 3]) -> [i32; 3] {
    let ([ax, ay, az], [bx, by, bz]) = (*a, *b);
    [
        ax.saturating_sub(bx),
        ay.saturating_sub(by),
        az.saturating_sub(bz),
    ]
}

/// The fastest of the three axes.
#[cfg_attr(target_pointer_width = "32", inline(never))]
pub(super) fn fastest(turn: &[i32; 3]) -> u32 {
    let axes = turn.iter().map(|axis| axis.unsigned_abs());
    axes.fold(0, u32::max)
}

fn towards(low: &mut [i32; 3], value: &[i32; 3], share: u32) {
    for (low, value) in low.iter_mut().zip(value) {
        let way = i64::from(*value) - i64::from(*low);
        *low += towards_zero(way * i64::from(share), 22) as i32;
    }
}

/// The rotation of a turn, of at most an eighth of a circle about each axis: pairs that are far
/// apart, or a gyroscope that is wrong, may claim more, and a rotation of more has no room.
fn rotation(turn: Turn) -> Rotation {
    /// 2^30 pi / 4.
    const EIGHTH: i32 = (core::f64::consts::FRAC_PI_4 * 1_073_741_824.0) as i32;
    Rotation::of(turn.map(|axis| axis.clamp(-EIGHTH, EIGHTH)))
}

fn dot(a: &[i32; 3], b: &[i32; 3]) -> i64 {
    let products = a.iter().zip(b);
    products.fold(0, |sum: i64, (a, b)| {
        sum.saturating_add(i64::from(*a) * i64::from(*b))
    })
}

fn length(v: &[i32; 3]) -> u32 {
    root(dot(v, v).unsigned_abs())
}

impl Gravity {
    /// Takes in a pair; the channel that is the wrong one, while `differs` says that the two
    /// differ in something.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn step(
        &self,
        state: &mut GravityState,
        pair: &Pair,
        differs: Option<Kind>,
    ) -> Option<Member> {
        self.note(state, differs, pair.elapsed_us);
        let [own, peer] = pair.turns;
        let own = rotation(own);
        state.mean.turn_back(&own);
        let rates = state.dispute == Some(Kind::Rates);
        state
            .other
            .turn_back(&if rates { rotation(peer) } else { own });
        state.age_us = state.age_us.saturating_add(pair.elapsed_us);
        let [mean, half] = pair.accelerations.as_ref()?;
        let averaged_us = match state.dispute {
            None => state.age_us.min(self.tau_us),
            Some(_) => self.tau_us,
        };
        let share = share_q22(pair.elapsed_us, averaged_us);
        let other = if rates { mean } else { half };
        if self.pauses(state, pair, mean) {
            state.mean.pause(mean);
            state.other.pause(other);
        }
        state.mean.follow(mean, share);
        state.other.follow(other, share);
        let distance = length(&minus(&state.mean.now, &state.mean.near));
        let way = i64::from(distance) - i64::from(state.usual);
        // What has shaken the average stays in it for longer than it takes to get there.
        let share = if way < 0 { share / 4 } else { share };
        let step = towards_zero(way * i64::from(share), 22) as i32;
        state.usual = state.usual.saturating_add_signed(step);
        let drift = part(self.drift, pair.elapsed_us, 1_000_000);
        state.blur = state.blur.saturating_add(drift);
        self.note_movement(state, pair);
        if state.dispute.is_none() {
            self.find_place(state);
        }
        self.judge(state, pair.elapsed_us)
    }

    /// The best of what was averaged is the place: the mean of a pause, or what is behind both
    /// low-passes, or what was the best and has been carried on since.
    fn find_place(&self, state: &mut GravityState) {
        let [of_mean, ..] = state.mean.averages(state.paused);
        let [of_other, ..] = state.other.averages(state.paused);
        let [pause, _, far] = self.blurs(state);
        if state.paused_us >= self.pause_us && pause < state.blur {
            (state.mean.place, state.other.place) = (of_mean, of_other);
            state.blur = pause;
        } else if far < state.blur {
            (state.mean.place, state.other.place) = (state.mean.far, state.other.far);
            state.blur = far;
        }
    }

    /// Standard uncertainties of gravity: in the mean of a pause, behind one low-pass, behind
    /// both; 2^-26 g.
    fn blurs(&self, state: &GravityState) -> [u32; 3] {
        let change = state.change / u32::from(state.paused.max(1));
        let [near, far] = self.blur.map(|share| part(state.usual, share, 64));
        [part(change, self.paused, 16), near, far].map(|blur| blur.max(self.floor))
    }

    /// A dispute begins, or has ended.
    fn note(&self, state: &mut GravityState, differs: Option<Kind>, elapsed_us: u32) {
        match (state.dispute, differs) {
            (None, None) => {}
            (None, Some(kind)) => self.begin(state, kind),
            (Some(_), None) => {
                state.alike_us = state.alike_us.saturating_add(elapsed_us);
                if state.alike_us >= self.alike_us {
                    state.restart();
                }
            }
            (Some(before), Some(kind)) => {
                state.alike_us = 0;
                if before != kind {
                    // Neither kind can be held against gravity by the other one.
                    state.age_us = u32::MAX;
                }
            }
        }
    }

    /// Two begin to differ: gravity is where it has been so far.
    fn begin(&self, state: &mut GravityState, kind: Kind) {
        // What has not been averaged for long enough is no place.
        let known = state.age_us >= self.known_us;
        if kind == Kind::Rates {
            state.other = state.mean;
        }
        state.dispute = Some(kind);
        state.age_us = if known { 0 } else { u32::MAX };
    }

    /// Whether the machine pauses; ends the mean of a pause that is over or long enough.
    ///
    /// The first part of a pause is left out: accelerations come later than the turn of the same
    /// moment, and still have the end of the movement.
    fn pauses(&self, state: &mut GravityState, pair: &Pair, mean: &[i32; 3]) -> bool {
        let most = part(self.slow, pair.elapsed_us, 1_000_000);
        let slow = !pair.shaken && pair.slower() <= most;
        if !slow || state.paused_us >= self.pause_us {
            (state.paused, state.paused_us, state.change) = (0, 0, 0);
            (state.mean.sum, state.other.sum) = ([0; 3], [0; 3]);
            state.turned = [[0; 3]; 2];
        }
        state.slow_us = match slow {
            true => state.slow_us.saturating_add(pair.elapsed_us),
            false => 0,
        };
        if state.slow_us < SKIPPED_US {
            return false;
        }
        let change = length(&minus(mean, &state.mean.now));
        state.paused = state.paused.saturating_add(1);
        state.paused_us = state.paused_us.saturating_add(pair.elapsed_us);
        state.change = state.change.saturating_add(change);
        for (sum, turn) in state.turned.iter_mut().zip(&pair.turns) {
            for (sum, turn) in sum.iter_mut().zip(turn) {
                *sum = sum.saturating_add(*turn);
            }
        }
        true
    }

    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn judge(&self, state: &mut GravityState, elapsed_us: u32) -> Option<Member> {
        let kind = state.dispute?;
        if state.age_us > self.longest_us {
            return None;
        }
        let [mean, other] = [&state.mean, &state.other].map(|v| v.left(state.paused));
        let mut stages = mean.into_iter().zip(other).zip(self.blurs(state));
        let pause = stages.next().filter(|_| state.paused_us >= self.pause_us);
        let of_place = state.blur;
        let which = |((mean, other), blur)| {
            let blur = root_sum(blur, of_place);
            self.which(kind, [mean, other], blur)
        };
        if let Some(found) = pause.and_then(which) {
            return Some(found);
        }
        if pause.is_some()
            && kind == Kind::Rates
            && let Some(found) = self.reads(state)
        {
            return Some(found);
        }
        let suspect = stages.find_map(which);
        if suspect.is_none() || suspect != state.suspect {
            state.suspect_us = 0;
        }
        state.suspect = suspect;
        state.suspect_us = state.suspect_us.saturating_add(elapsed_us);
        suspect.filter(|_| state.suspect_us >= self.confirm_us)
    }

    /// The channel that has read a rate in two pauses with a movement between them, while the
    /// other one has read none: what gravity does not show where the rate is about itself.
    ///
    /// A gyroscope that reads none because it is dead would name the sound one in a pause in which
    /// the machine slews slowly; so it takes two.
    fn reads(&self, state: &mut GravityState) -> Option<Member> {
        let most = self
            .reads
            .map(|rate| part(rate, state.paused_us, 1_000_000));
        let [none, some] = most;
        let [own, peer] = &state.turned;
        let (own, peer) = (fastest(own), fastest(peer));
        let reads = if own > some && peer <= none {
            Member::Own
        } else if peer > some && own <= none {
            Member::Peer
        } else {
            return None;
        };
        match state.reads {
            Some((before, moved)) if before == reads => moved.then_some(reads),
            _ => {
                state.reads = Some((reads, false));
                None
            }
        }
    }

    /// Notes a movement between two pauses.
    fn note_movement(&self, state: &mut GravityState, pair: &Pair) {
        let most = part(self.moves, pair.elapsed_us, 1_000_000);
        if let Some((_, moved)) = &mut state.reads {
            *moved |= pair.slower() > most;
        }
    }

    /// Which of two vectors has left the place and not the other one, where each is uncertain by
    /// `blur`, 2^-26 g: one is within a quarter of what they are apart, the other one beyond
    /// three.
    fn which(&self, kind: Kind, [mut own, mut peer]: [[i32; 3]; 2], blur: u32) -> Option<Member> {
        if kind == Kind::Accelerations {
            // Mean and half of the difference.
            for (own, peer) in own.iter_mut().zip(&mut peer) {
                let half = *peer;
                (*own, *peer) = (own.saturating_add(half), own.saturating_sub(half));
            }
        }
        let apart = length(&minus(&own, &peer));
        if apart < blur.saturating_mul(self.coverage).max(self.least) {
            return None;
        }
        let (of_own, of_peer) = (length(&own), length(&peer));
        let (near, far) = (apart / 4, apart / 4 * 3);
        if of_own > far && of_peer < near {
            return Some(Member::Own);
        }
        (of_peer > far && of_own < near).then_some(Member::Peer)
    }
}

/// So many parts of a whole of `whole` parts, rounded down.
fn part(of: u32, parts: u32, whole: u32) -> u32 {
    let part = u64::from(of) * u64::from(parts) / u64::from(whole.max(1));
    u32::try_from(part).unwrap_or(u32::MAX)
}
