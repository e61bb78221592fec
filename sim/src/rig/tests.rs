//! The rig's forces, truth, vibration and the four poses of the chamber.

use super::*;
use crate::TICK_S;

/// A rig that has been stepped tick by tick.
struct Bench {
    rig: Rig,
    tick: u32,
}

impl Bench {
    fn new(setup: RigSetup) -> Bench {
        Bench {
            rig: Rig::new(&setup, &mut Rng::stream(11, "rig")),
            tick: 0,
        }
    }

    fn step(&mut self) -> Motion {
        self.tick += 1;
        self.rig.step(f64::from(self.tick) * TICK_S)
    }

    /// Goes to an angle and waits until it stands there.
    fn go(&mut self, target_deg: f64, speed_deg_s: f64) -> Motion {
        self.rig.command(target_deg, speed_deg_s).unwrap();
        while !self.rig.settled() {
            self.step();
        }
        self.step()
    }

    /// The motion at which the profile first passes this angle at its full speed.
    fn passing(&mut self, angle_deg: f64) -> Motion {
        loop {
            let motion = self.step();
            if self.rig.reference_deg() >= angle_deg && self.rig.shaft().velocity_deg_s > 79.999 {
                return motion;
            }
        }
    }
}

fn close(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9)
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn a_perfect_rig_adds_nothing_to_gravity() {
    let setup = RigSetup {
        lever_arm_m: 0.05,
        ..RigSetup::PERFECT
    };
    let motion = Bench::new(setup).go(30.0, 20.0);
    assert!(
        close(motion.force_g, [0.5, 0.0, 0.75f64.sqrt()]),
        "{motion:?}"
    );
    assert!((motion.attitude.slope_x_deg - 30.0).abs() < 1e-9);
    assert!((motion.attitude.turn_deg - 30.0).abs() < 1e-9);
}

#[test]
fn the_wedge_tilts_the_other_axis() {
    let setup = RigSetup {
        wedge_deg: 10.0,
        ..RigSetup::PERFECT
    };
    let (s, c) = 10f64.to_radians().sin_cos();
    let (ts, tc) = 40f64.to_radians().sin_cos();
    let motion = Bench::new(setup).go(40.0, 80.0);
    assert!(close(motion.force_g, [ts, tc * s, tc * c]), "{motion:?}");
    let slope_y_deg = (tc * s).asin().to_degrees();
    assert!((motion.attitude.slope_y_deg - slope_y_deg).abs() < 1e-9);
    let motion = Bench::new(RigSetup {
        mount: Mount::Y,
        ..setup
    })
    .go(40.0, 80.0);
    assert!(close(motion.force_g, [tc * s, ts, tc * c]), "{motion:?}");
    assert!((motion.attitude.slope_y_deg - 40.0).abs() < 1e-9);
}

#[test]
fn a_centimetre_of_lever_reads_0_114_degrees_at_80_deg_per_s() {
    for (mount, driven) in [(Mount::X, 0), (Mount::Y, 1)] {
        let setup = RigSetup {
            mount,
            lever_arm_m: 0.01,
            ..RigSetup::PERFECT
        };
        let mut bench = Bench::new(setup);
        bench.rig.command(120.0, 80.0).unwrap();
        let level = bench.passing(-1.0);
        assert!((level.force_g[2].hypot(level.force_g[driven]) - 1.0 + 0.001988).abs() < 1e-5);
        // At 90 degrees the pull lies across gravity and looks like tilt.
        let motion = bench.passing(90.0);
        let angle_deg = motion.force_g[driven].atan2(motion.force_g[2]).to_degrees();
        let error_deg = angle_deg - motion.attitude.turn_deg;
        assert!((error_deg - 0.114).abs() < 0.001, "{error_deg}");
    }
}

#[test]
fn the_force_on_the_lever_is_the_acceleration_of_its_path() {
    // Differences of the sensor's position in the plane (horizontal, up), turned into the
    // housing's frame, must give the same force as the formulas.
    let r = 0.05;
    let setup = RigSetup {
        lever_arm_m: r,
        ..RigSetup::PERFECT
    };
    let mut bench = Bench::new(setup);
    bench.rig.command(60.0, 80.0).unwrap();
    for _ in 0..700 {
        let motion = bench.step();
        let time_s = f64::from(bench.tick) * TICK_S;
        let h = 1e-4;
        let place = |t: f64| {
            let (sin, cos) = bench.rig.motor.shaft(t).true_deg.to_radians().sin_cos();
            [-r * sin, r * cos]
        };
        let jolt = bench.rig.motor.shaft(time_s + h).acceleration_deg_s2
            - bench.rig.motor.shaft(time_s - h).acceleration_deg_s2;
        if jolt != 0.0 {
            continue;
        }
        let (a, b, c) = (place(time_s - h), place(time_s), place(time_s + h));
        let felt = |i: usize| (a[i] - 2.0 * b[i] + c[i]) / (h * h) / STANDARD_GRAVITY_M_S2;
        let (across, up) = (felt(0), felt(1) + 1.0);
        let (sin, cos) = motion.attitude.turn_deg.to_radians().sin_cos();
        let want = [cos * across + sin * up, 0.0, -sin * across + cos * up];
        let far = (0..3)
            .map(|i| (want[i] - motion.force_g[i]).abs())
            .fold(0.0, f64::max);
        assert!(far < 1e-6, "{time_s}: {want:?} {motion:?}");
    }
}

#[test]
fn the_lever_shortens_with_the_wedge() {
    let setup = RigSetup {
        lever_arm_m: 0.05,
        wedge_deg: 60.0,
        ..RigSetup::PERFECT
    };
    let mut bench = Bench::new(setup);
    bench.rig.command(120.0, 80.0).unwrap();
    let pulled = bench.passing(45.0);
    let length = pulled.force_g.iter().map(|f| f * f).sum::<f64>();
    let (sin, cos) = pulled.attitude.turn_deg.to_radians().sin_cos();
    let pull = 0.05 * 0.5 * 80f64.to_radians().powi(2) / STANDARD_GRAVITY_M_S2;
    assert!((length - (sin * sin + (cos - pull).powi(2))).abs() < 1e-9);
}

#[test]
fn vibration_has_its_rms_while_turning_and_is_nothing_at_rest() {
    let setup = RigSetup {
        vibration_g: 0.002,
        ..RigSetup::PERFECT
    };
    let mut bench = Bench::new(setup);
    bench.rig.command(1e5, 80.0).unwrap();
    let mut shaking: [Vec<f64>; 3] = Default::default();
    for _ in 0..100_000 {
        let motion = bench.step();
        let (sin, cos) = motion.attitude.turn_deg.to_radians().sin_cos();
        let clean = [sin, 0.0, cos];
        (0..3).for_each(|i| shaking[i].push(motion.force_g[i] - clean[i]));
    }
    for axis in &shaking {
        assert!((rms(axis) / 0.002 - 1.0).abs() < 0.1, "{}", rms(axis));
    }
    let rest = Bench::new(setup).go(30.0, 80.0);
    assert!(close(rest.force_g, [0.5, 0.0, 0.75f64.sqrt()]), "{rest:?}");
}

#[test]
fn each_step_of_acceleration_rings_by_5_mg_and_dies_away() {
    let setup = RigSetup {
        ringing_g: 0.005,
        ..RigSetup::PERFECT
    };
    let mut bench = Bench::new(setup);
    let steady = |motion: Motion| motion.force_g[0] - motion.attitude.turn_deg.to_radians().sin();
    bench.rig.command(80.0, 80.0).unwrap();
    let first: Vec<f64> = (0..95).map(|_| steady(bench.step())).collect();
    let peak = first.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    assert!((peak - 0.00477).abs() < 5e-5, "{peak}");
    while !bench.rig.settled() {
        bench.step();
    }
    let after: Vec<f64> = (0..3000).map(|_| steady(bench.step())).collect();
    assert!(rms(&after[..100]) > 0.001);
    assert!(after[2500..].iter().all(|x| x.abs() < 1e-6));
}

#[test]
fn truth_is_the_shaft_and_the_reference_is_what_was_commanded() {
    let mut bench = Bench::new(RigSetup {
        ringing_g: 0.0,
        ..RigSetup::NOMINAL
    });
    let motion = bench.go(45.0, 80.0);
    let error_deg = motion.attitude.turn_deg - bench.rig.reference_deg();
    assert_eq!(bench.rig.reference_deg(), 45.0);
    assert!(
        error_deg != 0.0 && error_deg.abs() < 0.025 + 0.0042 + 0.0083,
        "{error_deg}"
    );
    assert!((motion.attitude.slope_x_deg - motion.attitude.turn_deg).abs() < 1e-9);
}

#[test]
fn a_remount_turns_the_housing_at_once_and_keeps_the_motor() {
    let mut bench = Bench::new(RigSetup::PERFECT);
    bench.go(30.0, 80.0);
    bench.rig.remount(Mount::Y, 0.0, 0.0);
    let motion = bench.step();
    assert!(
        close(motion.force_g, [0.0, 0.5, 0.75f64.sqrt()]),
        "{motion:?}"
    );
    assert!((motion.attitude.slope_y_deg - 30.0).abs() < 1e-9);
    assert_eq!(bench.rig.reference_deg(), 30.0);
}

#[test]
fn full_circles_keep_counting_while_the_slope_folds() {
    let motion = Bench::new(RigSetup::PERFECT).go(490.0, 80.0);
    assert!((motion.attitude.turn_deg - 490.0).abs() < 1e-9);
    assert!(
        (motion.attitude.slope_x_deg - 50.0).abs() < 1e-9,
        "{motion:?}"
    );
    assert!(motion.force_g[2] < 0.0);
}

#[test]
fn one_seed_gives_the_same_bits() {
    let run = || {
        let mut bench = Bench::new(RigSetup {
            lever_arm_m: 0.02,
            ..RigSetup::NOMINAL
        });
        bench.rig.command(40.0, 80.0).unwrap();
        (0..2000)
            .map(|_| bench.step().force_g.map(f64::to_bits))
            .collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

#[test]
fn the_four_poses_show_each_axis_plus_and_minus() {
    let mut sum = [0.0; 3];
    for index in 0..4 {
        let force = Fixture::tetrahedral(index).step(0.0).force_g;
        assert!(
            force
                .iter()
                .all(|f| (f.abs() - 1.0 / 3f64.sqrt()).abs() < 1e-12)
        );
        sum = add(sum, force);
    }
    assert!(close(sum, [0.0; 3]));
    assert_eq!(Fixture::tetrahedral(5), Fixture::tetrahedral(1));
    assert_eq!(Fixture::level().step(3.0).attitude, Attitude::default());
    assert_eq!(Fixture::facing([0.0; 3]), Fixture::level());
    assert_eq!(Fixture::facing([f64::NAN, 0.0, 0.0]), Fixture::level());
}
