//! The excavator's arm: an order to stop or go on in, what a housing on the boom feels out.
//!
//! In: the time in s, and the orders [`Excavator::stop`] and [`Excavator::resume`]. Out:
//! [`Motion`] per tick: the pitch of the arm is slope Y (the paper's pitch, section VII), a few
//! degrees of sway are slope X. The sensor sits on the boom, along the housing's y at
//! [`ExcavatorSetup::lever_arm_m`] from its pivot, so turning adds a centripetal force along y
//! and a tangential one across the boom (erratum E15). Where the cab slews, the housing goes round
//! the slew axis as well, which adds a rate about the vertical and forces towards the axis and
//! along the circle. The figures are those of spec/sensor.md,
//! all `[ASSUME]`: cycles of 15-20 s, moves of 20-45 deg/s with peaks up to 60, vibration of 30 mg
//! rms from 3 to 25 Hz and 50 mg rms at 80 Hz on each axis, shocks of 1-5 g when the bucket meets
//! the ground. With the engine idling vibration is a tenth.
//! Left out: the bending of the boom, and the forces of the sway.

mod arm;

use std::fmt;

use crate::TICK_S;
use crate::motion::vibration::{BandNoise, Burst, Tone};
use crate::motion::{Attitude, Motion, Mover, STANDARD_GRAVITY_M_S2, add, rate_dps};
use crate::rng::Rng;
use arm::{Arm, Pose};

pub use arm::Scene;

/// What the machine does and how rough it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExcavatorSetup {
    /// What the machine does when nobody has stopped it.
    pub scene: Scene,
    /// Distance of the sensor from the boom's pivot along the housing's y, m.
    pub lever_arm_m: f64,
    /// Largest sway on slope X, degrees either side, below 30.
    pub sway_deg: f64,
    /// How far the cab slews to where the bucket is emptied, and back, while the arm swings and
    /// returns, degrees, least and most; 0 and 0 where it stands.
    pub slew_deg: (f64, f64),
    /// Vibration from 3 to 25 Hz at work, g rms per axis.
    pub rumble_g: f64,
    /// The engine's tone at 80 Hz at work, g rms per axis.
    pub engine_g: f64,
    /// Smallest and largest peak of a shock, g; 0 and 0 for none.
    pub shock_g: (f64, f64),
}

impl ExcavatorSetup {
    /// The machine of spec/sensor.md with the sensor 1 m from the pivot. `[ASSUME]`
    pub const NOMINAL: ExcavatorSetup = ExcavatorSetup {
        scene: Scene::Digging,
        lever_arm_m: 1.0,
        sway_deg: 3.0,
        slew_deg: (0.0, 0.0),
        rumble_g: 0.030,
        engine_g: 0.050,
        shock_g: (1.0, 5.0),
    };

    /// The same machine where the cab slews, by up to the arm's peak rate. `[ASSUME]`
    pub const SLEWING: ExcavatorSetup = ExcavatorSetup {
        slew_deg: (60.0, 120.0),
        ..Self::NOMINAL
    };

    /// The machine of the paper's section VII: the same moves, shaken as little as Fig 21 shows.
    ///
    /// There the nodes of a healthy instrument differ by less than 0.20 deg. Two nodes that sample
    /// 50 times a second by clocks of their own alias what shakes them differently, so that this
    /// bounds the vibration: a thirtieth of [`Self::NOMINAL`], and no shocks. `[ASSUME]`
    pub const PAPER: ExcavatorSetup = ExcavatorSetup {
        rumble_g: 0.0010,
        engine_g: 0.0015,
        shock_g: (0.0, 0.0),
        ..Self::NOMINAL
    };

    /// The same moves with nothing but gravity.
    pub const SMOOTH: ExcavatorSetup = ExcavatorSetup {
        lever_arm_m: 0.0,
        rumble_g: 0.0,
        engine_g: 0.0,
        shock_g: (0.0, 0.0),
        ..Self::NOMINAL
    };
}

impl fmt::Display for ExcavatorSetup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:?}, sensor {:.2} m from the pivot, sway {:.1} deg, slew {:.0} to {:.0} deg, ",
            self.scene, self.lever_arm_m, self.sway_deg, self.slew_deg.0, self.slew_deg.1
        )?;
        write!(
            f,
            "rumble {:.0} mg, engine {:.0} mg, shocks {:.1} to {:.1} g",
            self.rumble_g * 1e3,
            self.engine_g * 1e3,
            self.shock_g.0,
            self.shock_g.1
        )
    }
}

/// Band of the rumble, Hz, and the ticks between its points: a tenth of the upper edge's period.
const RUMBLE_HZ: (f64, f64) = (3.0, 25.0);
const RUMBLE_EVERY: u32 = 5;
const ENGINE_HZ: f64 = 80.0;
/// Vibration with the engine idling, as a share of that at work. `[ASSUME]`
const IDLE_SHARE: f64 = 0.1;
/// Distance of the boom's pivot from the slew axis, m. `[ASSUME]`
const PIVOT_M: f64 = 0.5;
/// Time constant of the engine's change between the two, s. `[ASSUME]`
const ENGINE_LAG_S: f64 = 0.2;
/// Frequency of a shock, Hz, and its length, s. `[ASSUME]`
const SHOCK_HZ: (f64, f64) = (30.0, 60.0);
const SHOCK_S: (f64, f64) = (0.020, 0.060);

/// The machine with a housing on its boom.
#[derive(Clone, Debug)]
pub struct Excavator {
    setup: ExcavatorSetup,
    arm: Arm,
    shaking: Shaking,
    /// Gravity along the housing's axes at the last tick, g, and how far the cab had slewed, deg.
    before: Option<([f64; 3], f64)>,
}

impl Excavator {
    /// A machine that starts its scene at time 0. Takes the same amount of numbers from `rng`
    /// whatever the setup; moves, vibration and shocks have streams of their own.
    pub fn new(setup: &ExcavatorSetup, rng: &mut Rng) -> Excavator {
        Excavator {
            setup: *setup,
            arm: Arm::new(setup, rng.fork()),
            shaking: Shaking::new(setup, rng.fork()),
            before: None,
        }
    }

    /// Orders the machine to stop: it is at rest 0.8 s later and stays so, engine idling, until
    /// it is told to go on. A second order changes nothing.
    pub fn stop(&mut self, now_s: f64) {
        self.arm.stop(now_s);
    }

    /// Lets a stopped machine take up its scene again from where it stands; ignored otherwise.
    pub fn resume(&mut self, now_s: f64) {
        self.arm.resume(now_s);
    }

    /// Whether an order to stop is in force.
    pub fn stopped(&self) -> bool {
        self.arm.stopped()
    }
}

impl Mover for Excavator {
    #[inline]
    fn step(&mut self, time_s: f64) -> Motion {
        let strikes = self.arm.advance(time_s);
        let pose = self.arm.pose(time_s);
        let mut shaking_g = self.shaking.step(self.arm.works());
        if strikes {
            self.shaking.strike(self.setup.shock_g);
        }
        if let Some(shock_g) = self.shaking.shock() {
            shaking_g = add(shaking_g, shock_g);
        }
        let gravity_g = gravity_g(&pose);
        let now = (gravity_g, pose.slew_deg);
        let (before_g, before_deg) = self.before.replace(now).unwrap_or(now);
        let mut turning_g = turning_g(gravity_g, &pose, self.setup.lever_arm_m);
        let mut rate_dps = rate_dps(before_g, gravity_g);
        if pose.slew_deg != before_deg {
            turning_g = add(
                turning_g,
                slewing_g(gravity_g, &pose, self.setup.lever_arm_m),
            );
            let slew_dps = (pose.slew_deg - before_deg) / TICK_S;
            rate_dps = add(rate_dps, gravity_g.map(|up| up * slew_dps));
        }
        Motion {
            force_g: add(turning_g, shaking_g),
            rate_dps,
            attitude: Attitude {
                slope_x_deg: pose.sway_deg,
                slope_y_deg: pose.pitch_deg,
                turn_deg: pose.pitch_deg,
            },
        }
    }
}

/// Sines of two angles, rad; far faster than the library's where the arm can go.
///
/// The series to the 17th power: off by less than 2e-15 up to 1.25 rad (71 degrees).
#[inline]
fn sines(angles: [f64; 2]) -> [f64; 2] {
    /// Over the factorials 17 to 3, the odd ones.
    const OVER: [f64; 8] = [
        1.0 / 355_687_428_096_000.0,
        -1.0 / 1_307_674_368_000.0,
        1.0 / 6_227_020_800.0,
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5_040.0,
        1.0 / 120.0,
        -1.0 / 6.0,
    ];
    let [a, b] = angles;
    if a.abs().max(b.abs()) > 1.25 {
        return [a.sin(), b.sin()];
    }
    let squares = [a * a, b * b];
    let mut sums = [0.0; 2];
    for over in OVER {
        sums = [0, 1].map(|i| (sums[i] + over) * squares[i]);
    }
    [a + a * sums[0], b + b * sums[1]]
}

/// Gravity, g. Slopes are the arcsines of its components, so the components are the sines of the
/// slopes, and z is what is left of 1 g.
#[inline]
fn gravity_g(pose: &Pose) -> [f64; 3] {
    let [x, y] = sines([pose.sway_deg, pose.pitch_deg].map(f64::to_radians));
    let across_2 = 1.0 - y * y;
    [x, y, (across_2 - x * x).max(0.0).sqrt()]
}

/// Gravity and the forces of turning, g.
#[inline]
fn turning_g([x, y, z]: [f64; 3], pose: &Pose, lever_arm_m: f64) -> [f64; 3] {
    let across_2 = 1.0 - y * y;
    let lever = lever_arm_m / STANDARD_GRAVITY_M_S2;
    let rate = pose.rate_deg_s.to_radians();
    // Across the boom, upwards: the part of "up" that is not along y, made a unit vector.
    let tangential = lever * pose.acceleration_deg_s2.to_radians() / across_2.sqrt();
    [
        x + tangential * x,
        y - lever * rate * rate,
        z + tangential * z,
    ]
}

/// The forces of going round the slew axis, g: towards it, and along the circle with what the way
/// out and in adds to it (Coriolis).
fn slewing_g([x, y, z]: [f64; 3], pose: &Pose, lever_arm_m: f64) -> [f64; 3] {
    let level = (1.0 - y * y).sqrt();
    let radius_m = PIVOT_M + lever_arm_m * level;
    let outwards_m_s = -lever_arm_m * y * pose.rate_deg_s.to_radians();
    let slew = pose.slew_rate_deg_s.to_radians();
    let outwards = -radius_m * slew * slew;
    let along = radius_m * pose.slew_acceleration_deg_s2.to_radians() + 2.0 * outwards_m_s * slew;
    let [outwards, along] = [outwards, along].map(|a| a / (STANDARD_GRAVITY_M_S2 * level));
    // Outwards is the part of y that is level, along is up times that.
    [
        -outwards * y * x - along * z,
        outwards * (1.0 - y * y),
        -outwards * y * z + along * x,
    ]
}

/// Vibration and shocks.
#[derive(Clone, Debug)]
struct Shaking {
    rumble: BandNoise,
    engine: Tone,
    share: f64,
    keep: f64,
    shock: Burst,
    shock_along: [f64; 3],
    rng: Rng,
    shock_rng: Rng,
}

impl Shaking {
    fn new(setup: &ExcavatorSetup, mut rng: Rng) -> Shaking {
        let works = setup.scene != Scene::Standstill;
        Shaking {
            rumble: BandNoise::new(setup.rumble_g, RUMBLE_HZ.0, RUMBLE_HZ.1, RUMBLE_EVERY),
            engine: Tone::new(setup.engine_g, ENGINE_HZ, &mut rng),
            share: if works { 1.0 } else { IDLE_SHARE },
            keep: (-TICK_S / ENGINE_LAG_S).exp(),
            shock: Burst::default(),
            shock_along: [0.0; 3],
            shock_rng: rng.fork(),
            rng,
        }
    }

    #[inline]
    fn step(&mut self, works: bool) -> [f64; 3] {
        let wanted = if works { 1.0 } else { IDLE_SHARE };
        self.share = wanted + (self.share - wanted) * self.keep;
        add(self.rumble.step(&mut self.rng), self.engine.step()).map(|g| self.share * g)
    }

    /// The bucket meets the ground: a burst in any direction.
    fn strike(&mut self, peak_g: (f64, f64)) {
        let rng = &mut self.shock_rng;
        let peak_g = rng.range(peak_g.0, peak_g.1);
        let frequency_hz = rng.range(SHOCK_HZ.0, SHOCK_HZ.1);
        let duration_s = rng.range(SHOCK_S.0, SHOCK_S.1);
        self.shock = Burst::new(peak_g, frequency_hz, duration_s);
        self.shock_along = rng.direction();
    }

    #[inline]
    fn shock(&mut self) -> Option<[f64; 3]> {
        if !self.shock.sounds() {
            return None;
        }
        let force_g = self.shock.step();
        Some(self.shock_along.map(|along| along * force_g))
    }
}

#[cfg(test)]
mod tests;
