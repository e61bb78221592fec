//! Two gyroscopes on one housing: whether they turn alike, and which of them is wrong.
//!
//! In: how far each channel has turned ([`Turned`]) and both accelerations. Out: whether the rates
//! differ by more than two healthy channels' can, and the channel that is the wrong one, by noise
//! of its own or by what gravity shows ([`gravity`](super::gravity)).
//!
//! The difference goes through the low-passes of the [`Residual`], with its baseline: what a
//! power-on has left in the bias of either. What calibration leaves of scale and alignment grows
//! with the rate, so that is allowed beside it.
//!
//! Left out: what a channel finds of itself, such as codes that repeat (`fusion`).

use super::Member;
use super::activity::{ActivityCheck, ActivityState};
use super::gravity::{Gravity, GravityState, Kind, Pair, Turn, halves, minus};
use super::residual::{Residual, ResidualState, Stage, share_q22};
use crate::observation::Observation;
use crate::turned::Turned;

/// Configuration; rates in 2^-26 rad/s.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RateCheck {
    /// Noise.
    pub activity: ActivityCheck,
    /// Difference of the accelerations of a part with a gyroscope, in place of
    /// [`ProductCheck::residual`](super::ProductCheck::residual); 2^-26 g.
    pub accelerations: Residual,
    /// The machine is calm again so long after a shock, us: the part passes more of one than a
    /// part without a gyroscope, and the low-passes keep it.
    pub calm_us: u32,
    /// Until then the pair's combined standard uncertainty is at least this, 2^-26 g.
    pub shaken: u32,
    /// Difference of the rates.
    pub residual: Residual,
    /// Combined standard uncertainty of two rates at 25 degC, as a share of them, 2^-16; away from
    /// there [`Turned::scale_share`] comes on top.
    pub share: u32,
    /// Whose gravity leaves its place.
    pub gravity: Gravity,
}

/// A hundredth of a degree per second, 2^-26 rad/s.
const CENTIDEGREE: u32 = (67_108_864.0 * core::f64::consts::PI / 18_000.0) as u32;

/// Half a thousandth of g, 2^-26 g.
const HALF_MG: u32 = 33_554;

/// A stage with thresholds in so many of a unit.
const fn stage(unit: u32, tau_us: u32, calm: u32, shaken: u32) -> Stage {
    Stage {
        tau_us,
        calm: calm * unit,
        shaken: shaken * unit,
    }
}

impl RateCheck {
    /// For two ISM330DHCX; the example `gyroscope_faults` of `sim` prints the evidence.
    pub const PRODUCT: Self = Self {
        activity: ActivityCheck {
            // A single jerk of the housing is no fault of a gyroscope.
            spike: u32::MAX - 1,
            ..ActivityCheck::PRODUCT
        },
        accelerations: Residual {
            stages: [
                stage(HALF_MG, 0, 50, 400),
                stage(HALF_MG, 20_000, 24, 200),
                stage(HALF_MG, 100_000, 15, 70),
                stage(HALF_MG, 250_000, 10, 30),
                stage(HALF_MG, 500_000, 8, 18),
            ],
            whole: 335_545,
            ..Residual::PRODUCT
        },
        calm_us: 800_000,
        // 1.6 mg.
        shaken: 107_374,
        residual: Residual {
            stages: [
                stage(CENTIDEGREE, 0, 150, 300),
                stage(CENTIDEGREE, 20_000, 80, 160),
                stage(CENTIDEGREE, 100_000, 40, 80),
                stage(CENTIDEGREE, 250_000, 30, 40),
                stage(CENTIDEGREE, 500_000, 25, 30),
            ],
            whole_us: 500_000,
            whole: 70 * CENTIDEGREE,
            coverage: 5,
            baseline_us: 100_000_000,
        },
        // 0.3 %.
        share: 192,
        gravity: Gravity::PRODUCT,
    };
}

/// Pairs farther apart are not compared, us: two sound gyroscopes may differ by more than an angle
/// of [`Turned`] can show.
const LONGEST_US: u32 = 2_000_000;

/// Pairs farther apart show nothing of gravity, us: the housing may have turned by more than such
/// an angle can show.
const LONGEST_OF_GRAVITY_US: u32 = 250_000;

/// What is remembered.
#[derive(Clone, Copy, Debug, Default)]
pub struct RateState {
    activity: ActivityState,
    residual: ResidualState,
    gravity: GravityState,
    /// Where both had turned to at the pair before.
    before: Option<[[i16; 3]; 2]>,
    /// Time since that pair, us.
    elapsed_us: u32,
    /// The fastest turn of late: it falls to that of now no faster than the low-passes do, 2^-26
    /// rad/s.
    fastest: u32,
}

impl RateState {
    /// Nothing is remembered yet.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn fresh() -> Self {
        Self::default()
    }

    /// A pair was lost on the way: what was heard at its instant stands alone.
    pub fn skip(&mut self) {
        self.activity.skip();
    }

    /// A channel was away, or began anew: everything does.
    pub fn restart(&mut self) {
        *self = Self::fresh();
    }

    /// How far either has turned since the pair before is not known.
    fn interrupt(&mut self) {
        self.skip();
        self.before = None;
        self.gravity.restart();
    }
}

/// What one pair of rates shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// The rates differ.
    pub differ: bool,
    /// This channel's gyroscope is too loud.
    pub loud: Option<Member>,
    /// This channel's gyroscope or accelerometer contradicts gravity.
    pub contradicts: Option<Member>,
}

impl RateCheck {
    /// Takes in a pair; `differ` means that the accelerations do, and `shaken` that a shock may be
    /// going through the machine.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn step(
        &self,
        state: &mut RateState,
        [own, peer]: [&Observation; 2],
        (differ, shaken): (bool, bool),
        elapsed_us: u32,
    ) -> Found {
        let mut found = Found::default();
        state.elapsed_us = state.elapsed_us.saturating_add(elapsed_us);
        let Some(a) = &own.turned else {
            state.interrupt();
            return found;
        };
        let Some(b) = &peer.turned else {
            // What it tells next has all that it turns meanwhile.
            state.skip();
            return found;
        };
        let loud = (self.activity).step(&mut state.activity, a.activity, b.activity, elapsed_us);
        found.loud = loud.map(|(member, _)| member);
        let elapsed_us = core::mem::take(&mut state.elapsed_us);
        let turned = turned(&mut state.before, a, b);
        let Some(turned) = turned.filter(|_| elapsed_us <= LONGEST_US) else {
            state.gravity.restart();
            return found;
        };
        let [rate, difference] = turned.map(|angle| per_second(&angle, elapsed_us));
        let uncertainty = self.uncertainty(&mut state.fastest, &rate, a.scale_share, elapsed_us);
        let residual = &mut state.residual;
        found.differ = (self.residual).take(residual, difference, uncertainty, shaken, elapsed_us);
        if elapsed_us > LONGEST_OF_GRAVITY_US {
            state.gravity.restart();
            return found;
        }
        // What the estimator finds during a dispute may come from the fault, or from no more than
        // the moment since it began anew.
        let learns = !(found.differ || state.gravity.is_disputed());
        let bias = state.gravity.bias(a.bias.filter(|_| learns));
        let differs = match (found.differ, differ) {
            (true, _) => Some(Kind::Rates),
            (_, true) => Some(Kind::Accelerations),
            _ => None,
        };
        if let Some(bias) = bias {
            let pair = Pair {
                accelerations: accelerations(own, peer),
                turns: turns(turned, bias, state.residual.baseline(), elapsed_us),
                shaken,
                elapsed_us,
            };
            found.contradicts = self.gravity.step(&mut state.gravity, &pair, differs);
        }
        found
    }

    /// The pair's combined standard uncertainty, 2^-26 rad/s: a share of the `fastest` turn that
    /// the low-passes still keep, which need not be the turn of now.
    fn uncertainty(
        &self,
        fastest: &mut u32,
        rate: &[i64; 3],
        scale_share: u16,
        elapsed_us: u32,
    ) -> u32 {
        let axes = rate.iter();
        let most = axes.fold(0, |most, axis| axis.unsigned_abs().max(most));
        let now = u32::try_from(most).unwrap_or(u32::MAX);
        let slower = fastest.saturating_sub(now);
        let share = share_q22(elapsed_us, self.residual.whole_us);
        *fastest = now + slower - ((u64::from(slower) * u64::from(share)) >> 22) as u32;
        let share = self.share + u32::from(scale_share);
        ((u64::from(*fastest) * u64::from(share)) >> 16) as u32
    }
}

/// How far this channel has turned since the pair before, and how much farther than the peer;
/// 2^-18 of a circle.
fn turned(
    before: &mut Option<[[i16; 3]; 2]>,
    own: &Turned,
    peer: &Turned,
) -> Option<[[i16; 3]; 2]> {
    let [own_before, peer_before] = before.replace([own.angle, peer.angle])?;
    let own = apart(own.angle, own_before);
    Some([own, apart(own, apart(peer.angle, peer_before))])
}

fn apart([ax, ay, az]: [i16; 3], [bx, by, bz]: [i16; 3]) -> [i16; 3] {
    [
        ax.wrapping_sub(bx),
        ay.wrapping_sub(by),
        az.wrapping_sub(bz),
    ]
}

/// An angle of 2^-18 of a circle in so much time as a rate, 2^-26 rad/s.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn per_second(angle: &[i16; 3], elapsed_us: u32) -> [i64; 3] {
    /// 2 pi 2^26 / 2^18 1e6.
    const FACTOR: u64 = (core::f64::consts::TAU * 256.0 * 1e6) as u64;
    let factor = (FACTOR / u64::from(elapsed_us.max(1))) as i64;
    let mut rate = [0; 3];
    for (rate, angle) in rate.iter_mut().zip(angle) {
        *rate = (i64::from(*angle) * factor).clamp(-LARGEST, LARGEST);
    }
    rate
}

/// Mean of both accelerations, and half of own minus peer.
fn accelerations(own: &Observation, peer: &Observation) -> Option<[[i32; 3]; 2]> {
    Some(halves(&own.vector?.accel, &peer.vector?.accel))
}

/// The most that is taken of a rate, 16 rad/s.
const LARGEST: i64 = 1 << 30;

/// Both turns without their bias: the peer's is the own one, and what they differ by beyond what
/// they usually do.
fn turns(
    [own, difference]: [[i16; 3]; 2],
    bias: [i32; 3],
    baseline: [i32; 3],
    elapsed_us: u32,
) -> [Turn; 2] {
    let own = less(&own, &bias, (32, elapsed_us));
    let farther = less(&difference, &baseline, (26, elapsed_us));
    [own, minus(&own, &farther)]
}

/// An angle of 2^-18 of a circle, less a rate of 2^-`bits` rad/s for so many us; 2^-30 rad.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn less(angle: &[i16; 3], rate: &[i32; 3], (bits, elapsed_us): (u32, u32)) -> Turn {
    /// 2 pi 2^30 / 2^18.
    const RADIANS: i32 = (core::f64::consts::TAU * 4096.0 + 0.5) as i32;
    /// 1e-6 2^30; 0.02 % too much.
    const MICROSECOND: i64 = 1074;
    let mut turn = [0; 3];
    for (turn, (angle, rate)) in turn.iter_mut().zip(angle.iter().zip(rate)) {
        let of_rate = (i64::from(*rate) * i64::from(elapsed_us) * MICROSECOND) >> bits;
        *turn = (i32::from(*angle) * RADIANS).saturating_sub(of_rate as i32);
    }
    turn
}

#[cfg(test)]
mod tests;
