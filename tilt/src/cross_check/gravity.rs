//! Which of two sensors of a kind contradicts gravity, while the machine moves.
//!
//! In: for each pair the mean and the difference of both accelerations, how far either gyroscope
//! has turned, and which of the two kinds differ. Out: the channel whose sensor is the wrong one,
//! once gravity shows it.
//!
//! Gravity stands still in space. What a machine adds to it from one instant without speed to the
//! next averages out in space, at any distance from the pivot. A machine that does not turn has no
//! speed. So the acceleration is averaged over windows between two instants without a rate, turned
//! back by as much as the housing turns meanwhile: that average is the place of gravity. Where the
//! machine pauses, a mean over the pause is blurred by what shakes it only, and is one too.
//!
//! A place is carried on by the turn of the housing until the next one is known. While the pair
//! agrees, the distance of the two shows how uncertain a place is, and which bias has carried it
//! there. Once the two differ, each new place shows by how much the mean of both channels has
//! moved, and by how much half of their difference has. A channel that is wrong moves both alike:
//! the own one in the same direction, the peer's in opposite ones. The machine moves the mean
//! alone. When the gyroscopes differ, the two vectors are one acceleration, carried by either.
//!
//! Left out: the rate about gravity itself, which moves nothing; a gyroscope wrong about that axis
//! alone is named once the machine has tilted. A machine that drives has speed where it does not
//! turn: its windows scatter, so that they name the faulty channel seldom and the healthy one not.

use super::Member;
use crate::motion::frame::{Turn as Rotation, cross};
use crate::root::{root, root_sum};
use crate::saturate::saturate;

/// Configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gravity {
    /// An exchanged acceleration is so much older than the turn that comes with it, us.
    pub older_us: u32,
    /// Shortest and longest window, us.
    pub window_us: [u32; 2],
    /// Pairs farther apart make no window, us: they miss the instant without a rate.
    pub apart_us: u32,
    /// Standard uncertainty of a mean over a pause, as a share of the change from pair to pair,
    /// in 1/16.
    pub paused: u32,
    /// Standard uncertainty of a place is at least this, 2^-26 g.
    pub floor: u32,
    /// So many windows show their scatter; with fewer, a window is at least so uncertain, 2^-26 g.
    pub scatter: (u8, u32),
    /// What a place that is carried on loses, 2^-26 g in a second.
    pub drift: u32,
    /// How far mean and half of the difference have to move alike: the product of both in squares
    /// of the standard uncertainty, 1/256; in a pause, and in all windows together.
    pub alike: [i32; 2],
    /// The same while the gyroscopes differ: what their error turns a place by grows with time, so
    /// it waits for more.
    pub alike_turned: [i32; 2],
    /// A machine pauses where one gyroscope turns by less than this about each axis, 2^-30 rad/s.
    pub slow: u32,
    /// In a pause one gyroscope reads at most the first about each axis, and the one that is wrong
    /// at least the second about one, 2^-30 rad/s.
    pub reads: [u32; 2],
    /// A machine moves where both gyroscopes turn by more than this about an axis, 2^-30 rad/s.
    pub moves: u32,
    /// A mean over a pause is over so much, us.
    pub pause_us: u32,
    /// How long the place is carried on, us: the bias of a gyroscope turns it away.
    pub longest_us: u32,
    /// Two that have not differed for so long differ no more, us.
    pub alike_us: u32,
}

/// The largest bias that is corrected, 5 deg/s; 2^-32 rad/s.
const LARGEST_BIAS: i32 = (5.0 * core::f64::consts::PI / 180.0 * 4_294_967_296.0) as i32;

/// A thousandth of g in 2^-26 g.
const MG: u32 = 67_109;

impl Gravity {
    /// For two ISM330DHCX on a machine that digs; the example `gyroscope_faults` of `sim` prints
    /// the evidence.
    pub const PRODUCT: Self = Self {
        older_us: 19_540,
        window_us: [1_500_000, 15_000_000],
        apart_us: 60_000,
        paused: 5,
        floor: 3 * MG / 2,
        scatter: (4, 9 * MG / 2),
        drift: MG / 10,
        alike: [384, 230],
        alike_turned: [1024, 640],
        // 0.6 deg/s.
        slow: 11_244_000,
        // 0.15 and 0.3 deg/s.
        reads: [2_811_000, 5_622_000],
        // 3 deg/s.
        moves: 56_220_000,
        pause_us: 190_000,
        longest_us: 60_000_000,
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
    /// Sum over the pause under way, 2^-20 g.
    sum: [i32; 3],
    /// Sum over the window under way, 2^-15 g times [`MOMENT_US`].
    window: [i32; 3],
    /// Where it was last, carried on since.
    place: [i32; 3],
}

/// What is remembered.
#[derive(Clone, Copy, Debug, Default)]
pub struct GravityState {
    /// The mean, carried by the own gyroscope.
    mean: Followed,
    /// Half of the difference, carried by the own gyroscope; while rates differ, the mean carried
    /// by the peer's.
    other: Followed,
    dispute: Option<Kind>,
    /// Both kinds have differed in it: neither can be held against gravity by the other one.
    mixed: bool,
    /// The window under way: its length, [`MOMENT_US`]; `None` where no instant without speed began
    /// it.
    window: Option<u32>,
    /// By how much the housing turned from each of its moments until now, summed; 2^-14 rad times
    /// [`MOMENT_US`].
    turned_since: [i32; 3],
    /// Windows whose distance from the place before is known, and their usual distance, 2^-26 g.
    windows: u8,
    scatter: u32,
    /// What the windows of a dispute have shown so far, and whether the machine has moved in one of
    /// them or in the one before.
    shown: Shown,
    has_moved: bool,
    /// The own gyroscope's bias beside its calibration, 2^-32 rad/s.
    bias: Option<[i32; 3]>,
    /// Time since the middle of what the place was averaged over, us.
    age_us: u32,
    /// Standard uncertainty of the place, 2^-26 g; `None` before there is one.
    blur: Option<u32>,
    /// The mean of the pair before, 2^-26 g.
    before: [i32; 3],
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
    /// For how long the two have not differed, us.
    alike_us: u32,
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

    /// The own gyroscope's bias beside its calibration, 2^-32 rad/s: what the estimator has `found`
    /// when all this began, corrected since by what the windows show.
    pub(super) fn bias(&mut self, found: Option<[i32; 3]>) -> Option<[i32; 3]> {
        self.bias = self.bias.or(found);
        self.bias
    }

    /// The means over a pause.
    fn of_pause(&self) -> [[i32; 3]; 2] {
        [&self.mean.sum, &self.other.sum].map(|sum| mean(sum, self.paused.into(), FINER))
    }

    /// The means over a window of so many [`MOMENT_US`].
    fn of_window(&self, length: u32) -> [[i32; 3]; 2] {
        [&self.mean.window, &self.other.window].map(|sum| mean(sum, length, COARSER))
    }

    /// The machine has not moved in a window of so many [`MOMENT_US`] that ends now.
    fn stood(&self, length: u32) -> bool {
        self.slow_us >= length.saturating_mul(MOMENT_US)
    }

    /// By how much mean and half of the difference have moved from the place.
    fn moved(&self, kind: Kind, [mean, other]: [[i32; 3]; 2]) -> [[i32; 3]; 2] {
        let mean = minus(&mean, &self.mean.place);
        let other = minus(&other, &self.other.place);
        match kind {
            Kind::Accelerations => [mean, other],
            Kind::Rates => halves(&mean, &other),
        }
    }

    /// By so much the mean over a window is away from the place that was carried on: half of it
    /// corrects the bias that has carried it.
    // Out of line: the image is smaller.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn correct(&mut self, moved: &[i32; 3], length: u32) {
        /// Across a shorter way a place is too uncertain to show the whole rate, or any; us.
        const LONG_US: i64 = 2_000_000;
        const SHORTEST_US: i64 = 500_000;
        let carried_us = i64::from(self.age_us) - i64::from(half_us(length));
        let way_us = carried_us.saturating_abs();
        if way_us < SHORTEST_US {
            return;
        }
        let Some(bias) = &mut self.bias else {
            return;
        };
        // 2^-22 rad, and half of it in a second in 2^-32 rad/s.
        let half = 512_000_000 * carried_us.signum();
        let rate = cross(self.mean.place, *moved).map(|turned| {
            let rate = (i64::from(turned) * half).checked_div(way_us.max(LONG_US));
            saturate(rate.unwrap_or(0))
        });
        // The bias stands still in the housing: it has acted as the housing stood on average.
        let back = mean(&self.turned_since, length, 16).map(i32::saturating_neg);
        let rate = rotation(back).apply(rate);
        for (bias, rate) in bias.iter_mut().zip(rate) {
            let corrected = bias.saturating_add(rate);
            *bias = corrected.clamp(-LARGEST_BIAS, LARGEST_BIAS);
        }
    }
}

/// Mean and half of the difference of two vectors.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
pub(super) fn halves(own: &[i32; 3], peer: &[i32; 3]) -> [[i32; 3]; 2] {
    let [mut mean, mut half] = [*own, *peer];
    for (a, b) in mean.iter_mut().zip(&mut half) {
        let (own, peer) = (*a >> 1, *b >> 1);
        (*a, *b) = (own + peer, own - peer);
    }
    [mean, half]
}

/// The mean of so many, in a unit that is so many bits finer.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn mean(sum: &[i32; 3], count: u32, bits: u32) -> [i32; 3] {
    let mean = |sum: i32| sum.checked_div(count as i32).unwrap_or(0);
    sum.map(|sum| mean(sum).saturating_mul(1 << bits))
}

/// Half of a time in [`MOMENT_US`], us.
fn half_us(length: u32) -> u32 {
    length.saturating_mul(MOMENT_US / 2)
}

/// How mean and half of the difference have moved: products of their movements, in squares of the
/// standard uncertainty, 1/256.
#[derive(Clone, Copy, Debug, Default)]
struct Shown {
    /// Of both.
    alike: i32,
    /// Of half of the difference with itself.
    apart: i32,
    /// Of the mean with itself, less one for each window: what it scatters anyway.
    moved: i32,
}

impl Shown {
    /// By what both have `moved`, where the place is uncertain by `blur`; 2^-26 g.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn of([mean, half]: &[[i32; 3]; 2], blur: u32) -> Self {
        let square = (i64::from(blur) * i64::from(blur)) >> 8;
        let product = |a, b| saturate(dot(a, b).checked_div(square).unwrap_or(0));
        Self {
            alike: product(mean, half),
            apart: product(half, half),
            moved: product(mean, mean),
        }
    }

    /// Adds a window.
    fn add(&mut self, window: Self) {
        self.alike = self.alike.saturating_add(window.alike);
        self.apart = self.apart.saturating_add(window.apart);
        let beyond = window.moved.saturating_sub(256);
        self.moved = self.moved.saturating_add(beyond);
    }

    /// The channel that has moved while the other one has not: the mean has moved by half of the
    /// difference in either direction, to two thirds of it, and both alike by `least`.
    fn names(&self, least: i32) -> Option<Member> {
        let [alike, apart, moved] = [self.alike.abs(), self.apart, self.moved].map(i64::from);
        let rest = moved - 2 * alike + apart;
        if alike < i64::from(least) || 9 * rest > 4 * apart {
            return None;
        }
        Some(match self.alike > 0 {
            true => Member::Own,
            false => Member::Peer,
        })
    }
}

impl Followed {
    /// Turns back by what the housing has turned, and takes in an acceleration, which is `older`
    /// than the turn.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn follow(&mut self, turn: Turn, older: u32, value: Option<(&[i32; 3], u32, bool)>) {
        let by = rotation(turn);
        for vector in [&mut self.window, &mut self.place] {
            *vector = by.apply(*vector);
        }
        let Some((value, moments, pauses)) = value else {
            return;
        };
        let ahead = turn.map(|axis| saturate((i64::from(axis) * i64::from(older)) >> 12));
        let now = rotation(ahead).apply(*value);
        let sums = self.window.iter_mut().zip(&mut self.sum);
        for ((window, sum), (now, value)) in sums.zip(now.iter().zip(value)) {
            let moments = (now >> COARSER).saturating_mul(moments as i32);
            *window = window.saturating_add(moments);
            if pauses {
                *sum = sum.saturating_add(value >> FINER);
            }
        }
    }
}

/// Unit of time of a window, us; a power of two.
const MOMENT_US: u32 = 1 << 10;

/// From 2^-26 g to the unit of a window's sum.
const COARSER: u32 = 11;

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

/// The rotation of a turn, of at most an eighth of a circle about each axis: pairs that are far
/// apart, or a gyroscope that is wrong, may claim more, and a rotation of more has no room.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn rotation(turn: Turn) -> Rotation {
    /// 2^30 pi / 4.
    const EIGHTH: i32 = (core::f64::consts::FRAC_PI_4 * 1_073_741_824.0) as i32;
    Rotation::of(turn.map(|axis| axis.clamp(-EIGHTH, EIGHTH)))
}

// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
pub(super) fn dot(a: &[i32; 3], b: &[i32; 3]) -> i64 {
    let products = a.iter().zip(b);
    products.fold(0, |sum: i64, (a, b)| {
        sum.saturating_add(i64::from(*a) * i64::from(*b))
    })
}

fn length_of(v: &[i32; 3]) -> u32 {
    root(dot(v, v).unsigned_abs())
}

impl Gravity {
    /// Takes in a pair; the channel that is the wrong one, while the two differ in something:
    /// `differs`. It is named at the end of a window or in a pause, and not again in between.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn step(
        &self,
        state: &mut GravityState,
        pair: &Pair,
        differs: Option<Kind>,
    ) -> Option<Member> {
        self.note(state, differs, pair.elapsed_us);
        state.age_us = state.age_us.saturating_add(pair.elapsed_us);
        let drift = part(self.drift, pair.elapsed_us, 1_000_000);
        state.blur = state.blur.map(|blur| blur.saturating_add(drift));
        self.note_movement(state, pair);
        let moments = pair.elapsed_us / MOMENT_US;
        let at_rest = self.follow(state, pair, moments)?;
        let ended = state.window.filter(|_| at_rest);
        let found = match state.dispute {
            // What was found before is over where the two agree again.
            Some(_) if state.mixed || state.alike_us > 0 => None,
            Some(kind) => self.judge(state, kind, ended),
            None => {
                self.find_place(state, ended);
                None
            }
        };
        if at_rest {
            (state.mean.window, state.other.window) = ([0; 3], [0; 3]);
            (state.window, state.turned_since) = (Some(0), [0; 3]);
        }
        found
    }

    /// Carries on what stands in space and adds a pair to it; whether a window ends or may begin.
    /// `None` where an acceleration is missing, which breaks the window under way.
    fn follow(&self, state: &mut GravityState, pair: &Pair, moments: u32) -> Option<bool> {
        let rates = state.dispute == Some(Kind::Rates);
        let [own, peer] = pair.turns;
        let accelerations = pair.accelerations.as_ref();
        let pauses = accelerations.is_some_and(|[mean, _]| self.pauses(state, pair, mean));
        let older = (self.older_us << 12) / pair.elapsed_us.max(1);
        let both = [
            (&mut state.mean, own, 0),
            (
                &mut state.other,
                if rates { peer } else { own },
                usize::from(!rates),
            ),
        ];
        for (followed, turn, which) in both {
            let value = accelerations.and_then(|values| values.get(which));
            followed.follow(turn, older, value.map(|value| (value, moments, pauses)));
        }
        if accelerations.is_none() {
            state.window = None;
            return None;
        }
        let near = pair.elapsed_us <= self.apart_us;
        state.window = state.window.filter(|_| near);
        Some(near && self.lengthen(state, &own, moments))
    }

    /// Adds a pair to the length of the window under way; whether it ends or may begin: the machine
    /// has no speed.
    fn lengthen(&self, state: &mut GravityState, turn: &Turn, moments: u32) -> bool {
        let [shortest, longest] = self.window_us.map(|us| us / MOMENT_US);
        if let Some(length) = state.window {
            for (sum, turn) in state.turned_since.iter_mut().zip(turn) {
                let turned = (turn >> 16).saturating_mul(length as i32);
                *sum = sum.saturating_add(turned);
            }
            state.window = Some(length + moments).filter(|length| *length <= longest);
        }
        let long_enough = state.window.is_none_or(|length| length >= shortest);
        state.slow_us > 0 && long_enough
    }

    /// What was averaged over a pause is the place where it is better than the one that was carried
    /// on, and what was averaged over a window that has `ended` always.
    fn find_place(&self, state: &mut GravityState, ended: Option<u32>) {
        if state.paused_us >= self.pause_us {
            let blur = self.pause_blur(state);
            if state.blur.is_none_or(|carried| blur < carried) {
                let [mean, other] = state.of_pause();
                (state.mean.place, state.other.place) = (mean, other);
                (state.blur, state.age_us) = (Some(blur), state.paused_us / 2);
            }
        }
        let Some(length) = ended else {
            return;
        };
        let [mean, other] = state.of_window(length);
        if state.blur.is_some() {
            let moved = minus(&mean, &state.mean.place);
            let distance = length_of(&across_halved(&moved, &state.mean.place));
            let way = i64::from(distance) - i64::from(state.scatter);
            let (several, _) = self.scatter;
            let step = (way / i64::from(state.windows.max(1))) as i32;
            state.windows = (state.windows + 1).min(several);
            state.scatter = state.scatter.saturating_add_signed(step);
            state.correct(&moved, length);
        }
        self.place(state, [mean, other], length);
    }

    /// The place is the average over a window.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn place(&self, state: &mut GravityState, [mean, other]: [[i32; 3]; 2], length: u32) {
        (state.mean.place, state.other.place) = (mean, other);
        let (several, unknown) = self.scatter;
        let least = if state.windows < several {
            unknown
        } else {
            self.floor
        };
        state.blur = Some(state.scatter.max(least));
        state.age_us = half_us(length);
        state.has_moved &= state.dispute.is_some();
        state.has_moved |= !state.stood(length);
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
                state.mixed |= before != kind;
            }
        }
    }

    /// Two begin to differ: gravity is where it has been so far.
    fn begin(&self, state: &mut GravityState, kind: Kind) {
        if kind == Kind::Rates {
            state.other = state.mean;
        }
        state.dispute = Some(kind);
        if state.windows == 0 {
            // What was averaged once is no place.
            state.age_us = u32::MAX;
        }
    }

    /// Whether the machine pauses; ends the mean of a pause that is over or long enough.
    ///
    /// The first part of a pause is left out: accelerations come later than the turn of the same
    /// moment, and still have the end of the movement.
    fn pauses(&self, state: &mut GravityState, pair: &Pair, mean: &[i32; 3]) -> bool {
        let before = core::mem::replace(&mut state.before, *mean);
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
        let change = length_of(&minus(mean, &before));
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

    /// Standard uncertainty of gravity in the mean of a pause, 2^-26 g.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn pause_blur(&self, state: &GravityState) -> u32 {
        let change = state.change / u32::from(state.paused.max(1));
        part(change, self.paused, 16).max(self.floor)
    }

    /// The channel that a pause or a window which has `ended` shows to be wrong. Each window is the
    /// place for the next one, so that a bias counts for one window at a time.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn judge(&self, state: &mut GravityState, kind: Kind, ended: Option<u32>) -> Option<Member> {
        let [in_pause, in_windows] = match kind {
            Kind::Accelerations => self.alike,
            Kind::Rates => self.alike_turned,
        };
        let carried = state.blur.filter(|_| state.age_us <= self.longest_us);
        if state.paused_us >= self.pause_us
            && let Some(blur) = carried
        {
            let blur = root_sum(self.pause_blur(state), blur);
            let moved = state.moved(kind, state.of_pause());
            let found = Shown::of(&moved, blur).names(in_pause);
            let reads = || self.reads(state).filter(|_| kind == Kind::Rates);
            if let Some(found) = found.or_else(reads) {
                return Some(found);
            }
        }
        let length = ended?;
        let means = state.of_window(length);
        let moved = state.moved(kind, means);
        let moved = moved.map(|moved| across_halved(&moved, &state.mean.place));
        self.place(state, means, length);
        let shown = Shown::of(&moved, carried?);
        if kind == Kind::Rates && state.stood(length) && state.has_moved {
            // The bias was found where the machine stood otherwise. What is left of it turns the
            // place alike in each window of this standstill, so they are not added up.
            return None;
        }
        state.shown.add(shown);
        state.shown.names(in_windows)
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
}

/// A vector with the part across gravity halved: the bias of a gyroscope turns gravity, which moves
/// it across itself and never along.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn across_halved(vector: &[i32; 3], gravity: &[i32; 3]) -> [i32; 3] {
    let along = saturate(dot(vector, gravity) >> 26);
    let mut halved = *vector;
    for (part, gravity) in halved.iter_mut().zip(gravity) {
        let along = (i64::from(*gravity) * i64::from(along)) >> 26;
        *part = saturate((i64::from(*part) + along) >> 1);
    }
    halved
}

/// So many parts of a whole of `whole` parts, rounded down.
fn part(of: u32, parts: u32, whole: u32) -> u32 {
    let part = u64::from(of) * u64::from(parts) / u64::from(whole.max(1));
    u32::try_from(part).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests;
