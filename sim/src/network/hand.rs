//! A hand that turns the housing: pitch and roll asked for in words, at any time.
//!
//! In: an angle for each slope, and how fast to get there. Out: [`Motion`] per tick. Pitch is
//! slope Y and roll slope X; both are slopes against the horizontal, so a pitch does not change
//! what the roll is. Each speeds up and slows down at [`ACCELERATION_DEG_S2`], and a new angle may
//! be asked for on the way.
//!
//! Left out: forces of the turn itself (the sensor sits in the axis), and the motor's errors; the
//! motor of the bench is [`crate::rig`].

use crate::TICK_S;
use crate::motion::vibration::BandNoise;
use crate::motion::{Attitude, Motion, Mover, add, rate_dps};
use crate::rng::Rng;

/// How fast a turn speeds up and slows down, deg/s^2. `[ASSUME]`
pub const ACCELERATION_DEG_S2: f64 = 200.0;

/// Speed of the first turns, deg/s. `[ASSUME]`
pub const RATE_DEG_S: f64 = 20.0;

/// Band of the vibration, Hz, that of the bench. `[ASSUME]`
const VIBRATION_HZ: (f64, f64) = (20.0, 200.0);

/// Where the housing is to stand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Slope Y, degrees.
    pub pitch_deg: f64,
    /// Slope X, degrees.
    pub roll_deg: f64,
}

impl Pose {
    /// True when a housing can stand so: both slopes share the quarter circle from level to
    /// upright, and one alone may go all the way round to +-180.
    pub fn is_possible(&self) -> bool {
        let [pitch, roll] = [self.pitch_deg, self.roll_deg].map(f64::abs);
        let alone = pitch == 0.0 || roll == 0.0;
        pitch + roll <= if alone { 180.0 } else { 90.0 }
    }
}

/// One angle on its way.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    deg: f64,
    speed: f64,
    target_deg: f64,
    rate: f64,
}

impl Axis {
    fn is_still(&self) -> bool {
        self.speed == 0.0 && self.deg == self.target_deg
    }

    /// One tick: no faster than what still allows a stop at the target.
    fn step(&mut self) {
        let step = ACCELERATION_DEG_S2 * TICK_S;
        let way = self.target_deg - self.deg;
        if way.abs() <= step * TICK_S && self.speed.abs() <= 2.0 * step {
            self.deg = self.target_deg;
            self.speed = 0.0;
            return;
        }
        // The speed from which a stop in whole ticks is just possible.
        let stop = ((1.0 + 8.0 * way.abs() / (step * TICK_S)).sqrt() - 1.0) / 2.0 * step;
        let wanted = stop.min(self.rate).copysign(way);
        self.speed += (wanted - self.speed).clamp(-step, step);
        self.deg += self.speed * TICK_S;
    }
}

/// A housing in a hand.
#[derive(Clone, Debug)]
pub struct Hand {
    pitch: Axis,
    roll: Axis,
    rate: f64,
    noise: Option<BandNoise>,
    rng: Rng,
    attitude: Attitude,
}

impl Hand {
    /// Level and at rest; `rng` is for vibration.
    pub fn new(rng: Rng) -> Self {
        Self {
            pitch: Axis::default(),
            roll: Axis::default(),
            rate: RATE_DEG_S,
            noise: None,
            rng,
            attitude: Attitude::default(),
        }
    }

    /// Where the housing is going.
    pub fn target(&self) -> Pose {
        Pose {
            pitch_deg: self.pitch.target_deg,
            roll_deg: self.roll.target_deg,
        }
    }

    /// Goes to another pose; false, and nothing changes, when there is no such pose
    /// ([`Pose::is_possible`]).
    pub fn go(&mut self, pose: Pose) -> bool {
        let possible = pose.is_possible();
        if possible {
            for (axis, target_deg) in [
                (&mut self.pitch, pose.pitch_deg),
                (&mut self.roll, pose.roll_deg),
            ] {
                axis.target_deg = target_deg;
                axis.rate = self.rate;
            }
        }
        possible
    }

    /// Speed of the turns from now on, deg/s; above 0.
    pub fn set_rate(&mut self, deg_s: f64) {
        self.rate = deg_s;
    }

    /// Vibration from now on, g rms on each axis; 0 for none.
    pub fn set_vibration(&mut self, rms_g: f64) {
        let (low, high) = VIBRATION_HZ;
        self.noise = (rms_g > 0.0).then(|| BandNoise::new(rms_g, low, high, 1));
    }

    /// True when the housing stands where it was to go.
    pub fn is_still(&self) -> bool {
        self.pitch.is_still() && self.roll.is_still()
    }

    /// Where the housing truly stands.
    pub fn attitude(&self) -> Attitude {
        self.attitude
    }

    /// Gravity along the housing's axes for slopes that may be on their way, g.
    fn gravity_g(&self) -> [f64; 3] {
        let (x, cos_roll) = self.roll.deg.to_radians().sin_cos();
        let (y, cos_pitch) = self.pitch.deg.to_radians().sin_cos();
        let across = x * x + y * y;
        // On the way from one pose to another both sines may be too large for a moment.
        let scale = across.max(1.0).sqrt();
        let down = (1.0 - across).max(0.0).sqrt();
        let side = (cos_roll * cos_pitch).signum();
        [x / scale, y / scale, down * side]
    }
}

impl Mover for Hand {
    fn step(&mut self, _time_s: f64) -> Motion {
        let before_g = self.gravity_g();
        self.pitch.step();
        self.roll.step();
        let gravity_g = self.gravity_g();
        self.attitude = Attitude::from_gravity(gravity_g, self.roll.deg);
        let rng = &mut self.rng;
        let shaking_g = self.noise.as_mut().map_or([0.0; 3], |n| n.step(rng));
        Motion {
            force_g: add(gravity_g, shaking_g),
            rate_dps: rate_dps(before_g, gravity_g),
            attitude: self.attitude,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand() -> Hand {
        Hand::new(Rng::stream(1, "hand"))
    }

    fn pose(pitch_deg: f64, roll_deg: f64) -> Pose {
        Pose {
            pitch_deg,
            roll_deg,
        }
    }

    /// Ticks until the hand is still; the largest step and the largest change of it, deg/tick.
    fn go(hand: &mut Hand, to: Pose) -> (usize, f64, f64) {
        assert!(hand.go(to));
        let (mut ticks, mut fastest, mut hardest) = (0, 0.0f64, 0.0f64);
        let (mut at, mut speed) = (hand.pitch.deg, hand.pitch.speed * TICK_S);
        while !hand.is_still() {
            hand.step(0.0);
            let next = hand.pitch.deg - at;
            fastest = fastest.max(next.abs());
            hardest = hardest.max((next - speed).abs());
            (at, speed) = (hand.pitch.deg, next);
            ticks += 1;
            assert!(ticks < 100_000, "{hand:?}");
        }
        (ticks, fastest, hardest)
    }

    #[test]
    fn it_gets_there_in_time_and_not_harder_than_it_may() {
        let mut hand = hand();
        hand.set_rate(80.0);
        let (ticks, fastest, hardest) = go(&mut hand, pose(60.0, 0.0));
        // 60 deg at 80 deg/s take 0.75 s, speeding up and slowing down 0.4 s more.
        assert!((1140..1170).contains(&ticks), "{ticks}");
        assert!(fastest < 0.080_001, "{fastest}");
        assert!(hardest < 0.000_401, "{hardest}");
        assert_eq!(hand.attitude().slope_y_deg.round(), 60.0);
    }

    #[test]
    fn both_slopes_are_what_was_asked_for() {
        let mut hand = hand();
        go(&mut hand, pose(30.0, -10.0));
        let Attitude {
            slope_x_deg,
            slope_y_deg,
            ..
        } = hand.attitude();
        assert!((slope_y_deg - 30.0).abs() < 1e-9 && (slope_x_deg + 10.0).abs() < 1e-9);
    }

    #[test]
    fn it_turns_back_on_the_way() {
        let mut hand = hand();
        hand.go(pose(50.0, 0.0));
        for _ in 0..300 {
            hand.step(0.0);
        }
        let (_, _, hardest) = go(&mut hand, pose(-5.0, 0.0));
        assert!(hardest < 0.000_401, "{hardest}");
        assert!((hand.attitude().slope_y_deg + 5.0).abs() < 1e-9);
    }

    #[test]
    fn one_slope_alone_goes_all_the_way_round() {
        let mut hand = hand();
        go(&mut hand, pose(0.0, 180.0));
        let force_g = hand.step(0.0).force_g;
        assert!((force_g[2] + 1.0).abs() < 1e-9, "{force_g:?}");
        assert_eq!(hand.attitude().turn_deg, 180.0);
    }

    #[test]
    fn a_pose_that_is_none_is_refused_and_changes_nothing() {
        let mut hand = hand();
        hand.go(pose(20.0, 0.0));
        for impossible in [pose(60.0, 31.0), pose(181.0, 0.0), pose(f64::NAN, 0.0)] {
            assert!(!hand.go(impossible), "{impossible:?}");
        }
        assert_eq!(hand.target(), pose(20.0, 0.0));
    }

    #[test]
    fn vibration_comes_and_goes() {
        let mut hand = hand();
        hand.set_vibration(0.01);
        let shaken: f64 = (0..10_000).map(|_| hand.step(0.0).force_g[0].powi(2)).sum();
        assert!(
            ((shaken / 10_000.0).sqrt() - 0.01).abs() < 0.001,
            "{shaken}"
        );
        hand.set_vibration(0.0);
        assert_eq!(hand.step(0.0).force_g, [0.0, 0.0, 1.0]);
    }
}
