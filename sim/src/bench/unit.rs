//! One unit's whole passage over the bench: chamber, motor, verification, static and dynamic test.
//!
//! In: mode, world, seed and unit number. Out: a [`UnitResult`]. The product is switched off and
//! on between calibration and tests, so that the turn-on repeatability is in every figure; the
//! paper's is not (assumption A6).

use super::calibrate::CalibrationReport;
use super::dynamic_test::DynamicResult;
use super::static_test::{StaticPoint, knots};
use super::{Bench, BenchError, Mode, World};
use crate::rig::Mount;

/// How much of the passage is run.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Random angles of the static test, per axis.
    pub random_angles: usize,
    /// Lever arms of the dynamic test, in cm; none for no dynamic test.
    pub lever_arms_cm: &'static [u32],
}

impl Plan {
    /// Everything the demo shows: R16 on knots and 40 random angles, R17 at 0, 2 and 5 cm.
    pub const WHOLE: Self = Self {
        random_angles: 40,
        lever_arms_cm: &[0, 2, 5],
    };
}

/// A static test.
#[derive(Clone, Debug)]
pub struct StaticRun {
    /// Which slope the motor turned.
    pub mount: Mount,
    /// On the 10 deg knots, or at random angles.
    pub knots: bool,
    /// What was read.
    pub points: Vec<StaticPoint>,
}

/// A dynamic test.
#[derive(Clone, Debug)]
pub struct DynamicRun {
    /// Which slope the motor turned.
    pub mount: Mount,
    /// Distance of the sensor from the axis, cm.
    pub lever_arm_cm: u32,
    /// What was found.
    pub result: DynamicResult,
}

/// All of one unit.
#[derive(Clone, Debug)]
pub struct UnitResult {
    /// How the calibration of both nodes went.
    pub calibration: [CalibrationReport; 2],
    /// Static tests.
    pub statics: Vec<StaticRun>,
    /// Dynamic tests.
    pub dynamics: Vec<DynamicRun>,
}

impl Bench {
    /// Brings up a new instrument: chamber, motor, verification, power cycle.
    ///
    /// Errors: see [`BenchError`].
    pub fn commissioned(
        mode: Mode,
        world: &World,
        seed: u64,
        unit: u32,
    ) -> Result<(Self, [CalibrationReport; 2]), BenchError> {
        let mut bench = Self::new(mode, world, seed, unit);
        bench.characterise()?;
        let calibration = bench.calibrate()?;
        bench.gyroscopes = bench.calibrate_gyroscopes()?;
        if mode != Mode::Paper || bench.paper.power_off_between {
            bench.power_cycle();
        }
        Ok((bench, calibration))
    }

    /// Static and dynamic tests of `plan` on both axes (one for a one-axis instrument).
    pub fn tests(&mut self, plan: &Plan) -> (Vec<StaticRun>, Vec<DynamicRun>) {
        let (mut statics, mut dynamics) = (Vec::new(), Vec::new());
        let one_axis = self.mode == Mode::OneAxis;
        let mounts: &[Mount] = if one_axis {
            &[Mount::X]
        } else {
            &[Mount::X, Mount::Y]
        };
        let range_deg = if one_axis { 180.0 } else { 90.0 };
        for &mount in mounts {
            self.mount(mount, 0.0, 0.0);
            let random = self.random_angles(plan.random_angles, range_deg);
            for (knots, angles) in [(true, knots()), (false, random)] {
                let points = self.static_test(mount, &angles);
                statics.push(StaticRun {
                    mount,
                    knots,
                    points,
                });
            }
            for &lever_arm_cm in plan.lever_arms_cm {
                let result = self.dynamic_test(mount, f64::from(lever_arm_cm) / 100.0);
                dynamics.push(DynamicRun {
                    mount,
                    lever_arm_cm,
                    result,
                });
            }
            self.mount(mount, 0.0, 0.0);
        }
        (statics, dynamics)
    }
}

/// Runs one unit through everything of `plan`.
///
/// Errors: see [`BenchError`].
pub fn run_unit(
    mode: Mode,
    world: &World,
    seed: u64,
    unit: u32,
    plan: &Plan,
) -> Result<UnitResult, BenchError> {
    let (mut bench, calibration) = Bench::commissioned(mode, world, seed, unit)?;
    let (statics, dynamics) = bench.tests(plan);
    Ok(UnitResult {
        calibration,
        statics,
        dynamics,
    })
}
