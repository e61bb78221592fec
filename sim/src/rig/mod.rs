//! The motor rig and the fixed poses: what the housing feels when a motor or a block holds it.
//!
//! In: commands to the motor (degrees, deg/s) and the time in s. Out: [`Motion`] per tick, and
//! the angle that the host believes in. The housing is mounted with slope X or slope Y along the
//! motor's turn, wedged by a fixed angle about the other one, and its sensor may sit above the
//! axis, where turning adds centripetal and tangential force (erratum E15). Vibration is that
//! of spec/sensor.md, `[ASSUME]`: noise from 20 to 200 Hz while the motor turns and none while it
//! stands, and a damped 25 Hz ringing after each step of the acceleration.
//! Left out: run-out of the shaft, and tilt of the rig's foot.

use tilt::calibration::algebra::cross;

use crate::motion::vibration::{BandNoise, Ring};
use crate::motion::{Attitude, Motion, Mover, STANDARD_GRAVITY_M_S2, add};
use crate::motor::{Motor, MotorModel, MoveError, Shaft};
use crate::rng::Rng;

/// Which slope the motor turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mount {
    /// Slope X, the paper's roll run.
    #[default]
    X,
    /// Slope Y, the paper's pitch run.
    Y,
    /// Slope X with the housing on edge: the shaft lies along z, and y points up at 0 deg.
    Z,
}

impl Mount {
    /// Housing axes: the one the motor drives, the one along its shaft, the one that points up at
    /// 0 deg.
    const fn axes(self) -> (usize, usize, usize) {
        match self {
            Mount::X => (0, 1, 2),
            Mount::Y => (1, 0, 2),
            Mount::Z => (0, 2, 1),
        }
    }
}

/// How a housing is put on the rig and what shakes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigSetup {
    /// The slope that the motor turns.
    pub mount: Mount,
    /// Tilt of the housing about the driven axis, so of the other slope, degrees.
    pub wedge_deg: f64,
    /// Height of the sensor above the motor's axis along the housing's z, m.
    pub lever_arm_m: f64,
    /// Vibration while the motor turns, 20-200 Hz, g rms per axis; 0 switches it off.
    pub vibration_g: f64,
    /// Ringing at 25 Hz along the driven axis for each step of the profile's acceleration by
    /// its full value, g; 0 switches it off.
    pub ringing_g: f64,
    /// The motor.
    pub motor: MotorModel,
}

impl RigSetup {
    /// The bench of spec/sensor.md: no wedge, no lever arm, 2 mg rms of vibration and 5 mg of
    /// ringing `[ASSUME]`, the nominal motor.
    pub const NOMINAL: RigSetup = RigSetup {
        mount: Mount::X,
        wedge_deg: 0.0,
        lever_arm_m: 0.0,
        vibration_g: 0.002,
        ringing_g: 0.005,
        motor: MotorModel::NOMINAL,
    };

    /// A rig that adds nothing of its own.
    pub const PERFECT: RigSetup = RigSetup {
        vibration_g: 0.0,
        ringing_g: 0.0,
        motor: MotorModel::PERFECT,
        ..Self::NOMINAL
    };
}

/// Frequency and damping of the rig's ringing. `[ASSUME]`
const RINGING_HZ: f64 = 25.0;
const RINGING_DAMPING: f64 = 0.03;
/// Band of the rig's vibration, Hz. `[ASSUME]`
const VIBRATION_HZ: (f64, f64) = (20.0, 200.0);

/// A motor with a housing on it.
#[derive(Clone, Debug)]
pub struct Rig {
    setup: RigSetup,
    motor: Motor,
    noise: BandNoise,
    ring: Ring,
    rng: Rng,
    wedge_sin_cos: (f64, f64),
    now_s: f64,
    shaft: Shaft,
    /// Gravity, g, and truth at the shaft's last angle: kept, as the motor stands most of the time.
    stance: ([f64; 3], Attitude),
}

impl Rig {
    /// A rig at 0 degrees and time 0, its motor drawn from `rng`.
    pub fn new(setup: &RigSetup, rng: &mut Rng) -> Rig {
        let motor = Motor::draw(&setup.motor, rng);
        let mut rig = Rig {
            setup: *setup,
            shaft: motor.shaft(0.0),
            motor,
            noise: BandNoise::new(setup.vibration_g, VIBRATION_HZ.0, VIBRATION_HZ.1, 1),
            ring: Ring::damped(RINGING_HZ, RINGING_DAMPING),
            rng: rng.fork(),
            wedge_sin_cos: setup.wedge_deg.to_radians().sin_cos(),
            now_s: 0.0,
            stance: Default::default(),
        };
        rig.take_stance();
        rig
    }

    /// The same motor with the housing put on in another way: how the two calibration runs are
    /// made. The motor must stand; its position and its errors stay.
    pub fn remount(&mut self, mount: Mount, wedge_deg: f64, lever_arm_m: f64) {
        self.setup.mount = mount;
        self.setup.wedge_deg = wedge_deg;
        self.setup.lever_arm_m = lever_arm_m;
        self.wedge_sin_cos = wedge_deg.to_radians().sin_cos();
        self.take_stance();
    }

    /// Starts a move from the last tick's time, as [`Motor::move_to`]; returns its arrival, s.
    ///
    /// # Errors
    /// [`MoveError`] when a number is unusable or the last move is not over.
    pub fn command(&mut self, target_deg: f64, speed_deg_s: f64) -> Result<f64, MoveError> {
        self.motor.move_to(target_deg, speed_deg_s, self.now_s)
    }

    /// Whether the motor had finished its move at the last tick. The ringing may go on.
    pub fn settled(&self) -> bool {
        self.motor.settled(self.now_s)
    }

    /// What the host believes at the last tick: the commanded position, degrees, not wrapped.
    pub fn reference_deg(&self) -> f64 {
        self.shaft.commanded_deg
    }

    /// The shaft at the last tick.
    pub fn shaft(&self) -> Shaft {
        self.shaft
    }

    /// Gravity along the housing's axes and the truth at the shaft's angle.
    fn take_stance(&mut self) {
        let turn_deg = self.shaft.true_deg;
        let (driven, other, up) = self.setup.mount.axes();
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        let (wedge_sin, wedge_cos) = self.wedge_sin_cos;
        let mut gravity_g = [0.0; 3];
        gravity_g[up] = cos * wedge_cos;
        gravity_g[driven] = sin;
        gravity_g[other] = cos * wedge_sin;
        self.stance = (gravity_g, Attitude::from_gravity(gravity_g, turn_deg));
    }

    /// Rate about the housing's axes, deg/s, for a turn of the shaft by so much in this tick.
    fn rate_dps(&self, turned_deg: f64) -> [f64; 3] {
        let (driven, other, up) = self.setup.mount.axes();
        let (wedge_sin, wedge_cos) = self.wedge_sin_cos;
        let (mut along, mut level) = ([0.0; 3], [0.0; 3]);
        along[driven] = 1.0;
        level[up] = wedge_cos;
        level[other] = wedge_sin;
        cross(along, level).map(|axis| axis * turned_deg / crate::TICK_S)
    }

    /// Force from turning, g. The sensor's distance from the axis is the lever arm's part
    /// across the shaft; the centre lies in the plane of the wedge, on the side away from +z.
    fn turning_g(&self, shaft: &Shaft) -> [f64; 3] {
        let (driven, other, up) = self.setup.mount.axes();
        let (wedge_sin, wedge_cos) = self.wedge_sin_cos;
        let radius = self.setup.lever_arm_m * wedge_cos / STANDARD_GRAVITY_M_S2;
        let rate = shaft.velocity_deg_s.to_radians();
        let centripetal = -radius * rate * rate;
        let mut force = [0.0; 3];
        force[up] = centripetal * wedge_cos;
        force[other] = centripetal * wedge_sin;
        force[driven] = -radius * shaft.acceleration_deg_s2.to_radians();
        force
    }

    /// Vibration and ringing, g.
    fn shaking_g(&mut self, shaft: &Shaft) -> [f64; 3] {
        let jolt = shaft.acceleration_deg_s2 - self.shaft.acceleration_deg_s2;
        if jolt != 0.0 {
            // A push against the turn first, as the housing stays behind.
            let share = jolt / self.setup.motor.acceleration_deg_s2;
            self.ring.kick(-self.setup.ringing_g * share);
        }
        let turns = shaft.velocity_deg_s != 0.0;
        let mut force = if turns {
            self.noise.step(&mut self.rng)
        } else {
            [0.0; 3]
        };
        force[self.setup.mount.axes().0] += self.ring.step();
        force
    }
}

impl Mover for Rig {
    fn step(&mut self, time_s: f64) -> Motion {
        let shaft = self.motor.shaft(time_s);
        let turning_g = self.turning_g(&shaft);
        let shaking_g = self.shaking_g(&shaft);
        let turned_deg = shaft.true_deg - self.shaft.true_deg;
        self.now_s = time_s;
        self.shaft = shaft;
        let mut rate_dps = [0.0; 3];
        if turned_deg != 0.0 {
            self.take_stance();
            rate_dps = self.rate_dps(turned_deg);
        }
        let (gravity_g, attitude) = self.stance;
        Motion {
            force_g: add(gravity_g, add(turning_g, shaking_g)),
            rate_dps,
            attitude,
        }
    }
}

/// A housing that does not move: on a block in the chamber, or left alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fixture {
    motion: Motion,
}

impl Fixture {
    /// Level: the housing feels (0, 0, +1) g.
    pub fn level() -> Fixture {
        Fixture::facing([0.0, 0.0, 1.0])
    }

    /// One of four orientations in which each axis feels +1/sqrt(3) g twice and -1/sqrt(3) g
    /// twice, so that offset and gain of all axes can be told apart (erratum E12). `index`
    /// counts round: 4 is 0 again.
    pub fn tetrahedral(index: usize) -> Fixture {
        Fixture::facing(match index % 4 {
            0 => [1.0, 1.0, 1.0],
            1 => [1.0, -1.0, -1.0],
            2 => [-1.0, 1.0, -1.0],
            _ => [-1.0, -1.0, 1.0],
        })
    }

    /// A housing that feels 1 g along this direction of any length; level when the length is
    /// zero or not a number.
    pub fn facing(direction: [f64; 3]) -> Fixture {
        let length = direction.iter().map(|c| c * c).sum::<f64>().sqrt();
        let usable = length.is_finite() && length > 0.0;
        let force_g = if usable {
            direction.map(|c| c / length)
        } else {
            [0.0, 0.0, 1.0]
        };
        Fixture {
            motion: Motion {
                force_g,
                rate_dps: [0.0; 3],
                attitude: Attitude::from_gravity(force_g, 0.0),
            },
        }
    }
}

impl Mover for Fixture {
    fn step(&mut self, _time_s: f64) -> Motion {
        self.motion
    }
}

#[cfg(test)]
mod tests;
