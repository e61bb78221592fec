//! The reference motor: angles to go to in, the shaft's true motion and the host's belief out.
//!
//! In: targets in degrees and speeds in deg/s. Out: at any time t the commanded position, the
//! true position, velocity and acceleration of the shaft. The model is the Oriental Motor
//! DGM130R-ASAA `[RECALL]`: its figures have not been confirmed against the maker's data sheet.
//! Left out: overshoot of the drive's control loop, and the velocity of the shaft's own error
//! (under 1 % of the profile's velocity).

use crate::rng::Rng;
use std::f64::consts::TAU;
use std::fmt;

/// What sets one motor apart from a perfect one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorModel {
    /// 1st, 2nd and 18th harmonic of the shaft's angle together, degrees peak to peak. The
    /// three share it alike and their phases are drawn. `[RECALL]` 0.05
    pub harmonic_deg_pp: f64,
    /// Repeatability of a stop, degrees either side, uniform. `[RECALL]` +-0.0042
    pub repeatability_deg: f64,
    /// Error by the direction of approach, degrees either side. `[RECALL]` +-0.0083
    pub direction_deg: f64,
    /// Acceleration of the profile, deg/s^2. `[RECALL]` 800
    pub acceleration_deg_s2: f64,
}

impl MotorModel {
    /// The bench's motor, see each field.
    pub const NOMINAL: MotorModel = MotorModel {
        harmonic_deg_pp: 0.05,
        repeatability_deg: 0.0042,
        direction_deg: 0.0083,
        acceleration_deg_s2: 800.0,
    };

    /// A motor that stands exactly where it was told to, with the same profile.
    pub const PERFECT: MotorModel = MotorModel {
        harmonic_deg_pp: 0.0,
        repeatability_deg: 0.0,
        direction_deg: 0.0,
        ..MotorModel::NOMINAL
    };
}

/// Why a motor does not start a move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MoveError {
    /// The target is not a finite number.
    Target,
    /// The speed is not a finite number above zero.
    Speed,
    /// The last move is not over.
    Busy,
}

impl fmt::Display for MoveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            MoveError::Target => "the target angle is not a finite number",
            MoveError::Speed => "the speed must be a finite number above zero",
            MoveError::Busy => "the motor has not finished its last move",
        })
    }
}

impl std::error::Error for MoveError {}

/// The shaft at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shaft {
    /// Where the profile is, which is what the host believes, degrees, not wrapped.
    pub commanded_deg: f64,
    /// Where the shaft truly is, degrees, not wrapped.
    pub true_deg: f64,
    /// Velocity of the profile, deg/s.
    pub velocity_deg_s: f64,
    /// Acceleration of the profile, deg/s^2; a step from one value to the next.
    pub acceleration_deg_s2: f64,
}

/// Speeding up, cruising and slowing down from one angle to another; a triangle when the way is
/// too short to reach the speed.
#[derive(Clone, Copy, Debug)]
struct Trapezoid {
    start_s: f64,
    from_deg: f64,
    to_deg: f64,
    acceleration_deg_s2: f64,
    ramp_s: f64,
    cruise_s: f64,
}

impl Trapezoid {
    fn plan(start_s: f64, from_deg: f64, to_deg: f64, speed: f64, acceleration: f64) -> Trapezoid {
        let way_deg = (to_deg - from_deg).abs();
        let ramp_s = (speed / acceleration).min((way_deg / acceleration).sqrt());
        let peak_deg_s = acceleration * ramp_s;
        let cruise_s = if way_deg > 0.0 {
            (way_deg / peak_deg_s - ramp_s).max(0.0)
        } else {
            0.0
        };
        let acceleration_deg_s2 = acceleration * (to_deg - from_deg).signum();
        Trapezoid {
            start_s,
            from_deg,
            to_deg,
            acceleration_deg_s2,
            ramp_s,
            cruise_s,
        }
    }

    fn end_s(&self) -> f64 {
        self.start_s + 2.0 * self.ramp_s + self.cruise_s
    }

    /// Position, velocity and acceleration.
    fn at(&self, time_s: f64) -> (f64, f64, f64) {
        let (a, ramp) = (self.acceleration_deg_s2, self.ramp_s);
        let t = time_s - self.start_s;
        let left = self.end_s() - time_s;
        if t <= 0.0 {
            (self.from_deg, 0.0, 0.0)
        } else if left <= 0.0 {
            (self.to_deg, 0.0, 0.0)
        } else if t < ramp {
            (self.from_deg + 0.5 * a * t * t, a * t, a)
        } else if left < ramp {
            (self.to_deg - 0.5 * a * left * left, a * left, -a)
        } else {
            (self.from_deg + a * ramp * (t - 0.5 * ramp), a * ramp, 0.0)
        }
    }

    /// 0 at the start, 1 from the end of the speeding up, smooth between.
    fn take_up(&self, time_s: f64) -> f64 {
        let u = ((time_s - self.start_s) / self.ramp_s.max(1e-9)).clamp(0.0, 1.0);
        u * u * (3.0 - 2.0 * u)
    }
}

/// One motor with its own errors and its present move.
#[derive(Clone, Debug)]
pub struct Motor {
    model: MotorModel,
    phases_rad: [f64; 3],
    rng: Rng,
    profile: Trapezoid,
    /// Error of the last stop and of the next one, degrees.
    stop_deg: [f64; 2],
    /// The shaft after the present move: kept, because a motor stands most of the time.
    rest: Shaft,
}

/// Which harmonics of a turn the shaft's error holds.
const HARMONICS: [f64; 3] = [1.0, 2.0, 18.0];

impl Motor {
    /// A motor of this model at 0 degrees, its harmonics drawn. Its stops are drawn from a
    /// stream of its own.
    pub fn draw(model: &MotorModel, rng: &mut Rng) -> Motor {
        let mut motor = Motor {
            model: *model,
            phases_rad: [0; 3].map(|_| rng.range(0.0, TAU)),
            rng: rng.fork(),
            profile: Trapezoid::plan(0.0, 0.0, 0.0, 1.0, model.acceleration_deg_s2),
            stop_deg: [0.0; 2],
            rest: Shaft::default(),
        };
        motor.rest = motor.on_the_way(0.0);
        motor
    }

    /// Starts a move to `target_deg` (any finite angle, not wrapped) at `speed_deg_s` at most
    /// and returns when it will arrive, s. The error by direction is taken up while the shaft
    /// speeds up; a target where it stands already changes nothing.
    ///
    /// # Errors
    /// [`MoveError`] when a number is unusable or the last move is not over; nothing changes.
    pub fn move_to(
        &mut self,
        target_deg: f64,
        speed_deg_s: f64,
        now_s: f64,
    ) -> Result<f64, MoveError> {
        if !target_deg.is_finite() {
            return Err(MoveError::Target);
        }
        if !(speed_deg_s.is_finite() && speed_deg_s > 0.0) {
            return Err(MoveError::Speed);
        }
        if !self.settled(now_s) {
            return Err(MoveError::Busy);
        }
        let from_deg = self.profile.to_deg;
        if target_deg == from_deg {
            return Ok(now_s);
        }
        let model = &self.model;
        let spread = self
            .rng
            .range(-model.repeatability_deg, model.repeatability_deg);
        let approach = model.direction_deg * (target_deg - from_deg).signum();
        self.stop_deg = [self.stop_deg[1], approach + spread];
        let acceleration = model.acceleration_deg_s2;
        self.profile = Trapezoid::plan(now_s, from_deg, target_deg, speed_deg_s, acceleration);
        let end_s = self.profile.end_s();
        self.rest = self.on_the_way(end_s);
        Ok(end_s)
    }

    /// Whether the last move is over.
    pub fn settled(&self, now_s: f64) -> bool {
        now_s >= self.profile.end_s()
    }

    /// Error of the shaft at this commanded angle by its harmonics, degrees: the same at every
    /// visit, and for the same angle a turn later.
    pub fn harmonic_error_deg(&self, commanded_deg: f64) -> f64 {
        let each = self.model.harmonic_deg_pp / 2.0 / HARMONICS.len() as f64;
        let turn = commanded_deg.to_radians();
        let wave = |(order, phase): (f64, f64)| (order * turn + phase).sin();
        each * HARMONICS
            .into_iter()
            .zip(self.phases_rad)
            .map(wave)
            .sum::<f64>()
    }

    /// The shaft at `time_s`, which may be any time since the last move began.
    pub fn shaft(&self, time_s: f64) -> Shaft {
        if self.settled(time_s) {
            return self.rest;
        }
        self.on_the_way(time_s)
    }

    fn on_the_way(&self, time_s: f64) -> Shaft {
        let (commanded_deg, velocity_deg_s, acceleration_deg_s2) = self.profile.at(time_s);
        let [before, after] = self.stop_deg;
        let stop = before + (after - before) * self.profile.take_up(time_s);
        let true_deg = commanded_deg + self.harmonic_error_deg(commanded_deg) + stop;
        Shaft {
            commanded_deg,
            true_deg,
            velocity_deg_s,
            acceleration_deg_s2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motor(model: MotorModel, seed: u64) -> Motor {
        Motor::draw(&model, &mut Rng::stream(seed, "motor"))
    }

    #[test]
    fn a_long_move_is_a_trapezoid() {
        let mut motor = motor(MotorModel::PERFECT, 1);
        // 0.1 s to 80 deg/s (4 deg), 0.9 s at it (72 deg), 0.1 s down (4 deg).
        assert!((motor.move_to(80.0, 80.0, 2.0).unwrap() - 3.1).abs() < 1e-12);
        let want = [
            (2.0, 0.0, 0.0),
            (2.05, 1.0, 40.0),
            (2.1, 4.0, 80.0),
            (2.55, 40.0, 80.0),
            (3.05, 79.0, 40.0),
            (3.1, 80.0, 0.0),
            (9.0, 80.0, 0.0),
        ];
        for (time_s, position, velocity) in want {
            let shaft = motor.shaft(time_s);
            assert!(
                (shaft.true_deg - position).abs() < 1e-9,
                "{time_s}: {shaft:?}"
            );
            assert!(
                (shaft.velocity_deg_s - velocity).abs() < 1e-9,
                "{time_s}: {shaft:?}"
            );
        }
        assert_eq!(motor.shaft(2.05).acceleration_deg_s2, 800.0);
        assert_eq!(motor.shaft(2.5).acceleration_deg_s2, 0.0);
        assert_eq!(motor.shaft(3.05).acceleration_deg_s2, -800.0);
    }

    #[test]
    fn a_short_move_is_a_triangle_and_runs_backwards_alike() {
        let mut motor = motor(MotorModel::PERFECT, 1);
        let arrival_s = motor.move_to(-2.0, 80.0, 0.0).unwrap();
        assert!((arrival_s - 0.1).abs() < 1e-12, "{arrival_s}");
        let middle = motor.shaft(0.05 - 1e-9);
        assert!((middle.velocity_deg_s + 40.0).abs() < 1e-5);
        assert!((middle.true_deg + 1.0).abs() < 1e-6);
        assert!(!motor.settled(0.099) && motor.settled(arrival_s));
    }

    #[test]
    fn position_is_the_integral_of_velocity_and_that_of_acceleration() {
        let mut motor = motor(MotorModel::PERFECT, 1);
        let end_s = motor.move_to(37.0, 25.0, 0.0).unwrap();
        let (mut position, mut velocity) = (0.0, 0.0);
        let dt = 1e-5;
        for n in 0..(end_s / dt) as u32 {
            let shaft = motor.shaft((f64::from(n) + 0.5) * dt);
            velocity += shaft.acceleration_deg_s2 * dt;
            position += shaft.velocity_deg_s * dt;
            assert!((velocity - shaft.velocity_deg_s).abs() < 0.02);
        }
        assert!((position - 37.0).abs() < 1e-3, "{position}");
    }

    #[test]
    fn harmonics_stay_within_their_peak_to_peak_and_use_most_of_it() {
        let mut widest = 0.0f64;
        for seed in 0..200 {
            let motor = motor(MotorModel::NOMINAL, seed);
            let errors = (0..3600).map(|n| motor.harmonic_error_deg(f64::from(n) * 0.1));
            let (low, high) =
                errors.fold((0.0f64, 0.0f64), |(low, high), e| (low.min(e), high.max(e)));
            widest = widest.max(high - low);
            let again = motor.harmonic_error_deg(33.0) - motor.harmonic_error_deg(393.0);
            assert!(again.abs() < 1e-12);
        }
        assert!((0.042..=0.05).contains(&widest), "{widest}");
    }

    #[test]
    fn stops_scatter_by_repeatability_around_the_error_of_their_direction() {
        let model = MotorModel {
            harmonic_deg_pp: 0.0,
            ..MotorModel::NOMINAL
        };
        let mut motor = motor(model, 9);
        let (mut up, mut down) = (Vec::new(), Vec::new());
        let mut now_s = 0.0;
        for n in 0..2000 {
            let target = if n % 2 == 0 { 10.0 } else { 0.0 };
            now_s = motor.move_to(target, 80.0, now_s).unwrap();
            let error = motor.shaft(now_s).true_deg - target;
            if n % 2 == 0 {
                up.push(error)
            } else {
                down.push(error)
            }
        }
        for (errors, middle) in [(up, 0.0083), (down, -0.0083)] {
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            assert!((mean - middle).abs() < 3e-4, "{mean}");
            assert!(errors.iter().all(|e| (e - middle).abs() <= 0.0042));
            let widest = errors.iter().fold(0.0f64, |m, e| m.max((e - middle).abs()));
            assert!(widest > 0.0040, "{widest}");
        }
    }

    #[test]
    fn the_shaft_never_jumps() {
        let mut motor = motor(MotorModel::NOMINAL, 4);
        let (mut now_s, mut last) = (0.0, motor.shaft(0.0).true_deg);
        for target in [30.0, 29.0, -15.0, 200.0, 380.0] {
            let end_s = motor.move_to(target, 80.0, now_s).unwrap();
            while now_s < end_s {
                now_s += 0.001;
                let here = motor.shaft(now_s).true_deg;
                assert!((here - last).abs() < 0.082, "{now_s}: {}", here - last);
                last = here;
            }
        }
    }

    #[test]
    fn bad_commands_are_refused_and_change_nothing() {
        let mut motor = motor(MotorModel::NOMINAL, 4);
        assert_eq!(motor.move_to(f64::NAN, 10.0, 0.0), Err(MoveError::Target));
        assert_eq!(motor.move_to(10.0, 0.0, 0.0), Err(MoveError::Speed));
        assert_eq!(
            motor.move_to(10.0, f64::INFINITY, 0.0),
            Err(MoveError::Speed)
        );
        let end_s = motor.move_to(10.0, 10.0, 0.0).unwrap();
        assert_eq!(motor.move_to(20.0, 10.0, 0.5), Err(MoveError::Busy));
        assert_eq!(motor.move_to(10.0, 10.0, end_s), Ok(end_s));
        assert_eq!(motor.shaft(end_s).commanded_deg, 10.0);
        assert!(MoveError::Busy.to_string().contains("last move"));
    }
}
