//! What the boom's sensor feels: forces of turning, vibration, shocks, and the cost of a tick.

use super::*;

fn machine(setup: &ExcavatorSetup, seed: u64) -> Excavator {
    Excavator::new(setup, &mut Rng::stream(seed, "excavator"))
}

fn at(tick: u32) -> f64 {
    f64::from(tick) * TICK_S
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// Force beyond that of the same machine without `rough`, tick by tick, one axis.
fn beyond(rough: ExcavatorSetup, ticks: u32, axis: usize) -> Vec<f64> {
    let smooth = ExcavatorSetup {
        scene: rough.scene,
        ..ExcavatorSetup::SMOOTH
    };
    let (mut rough, mut smooth) = (machine(&rough, 1), machine(&smooth, 1));
    let difference = |t| rough.step(at(t)).force_g[axis] - smooth.step(at(t)).force_g[axis];
    (0..ticks).map(difference).collect()
}

#[test]
fn without_roughness_it_feels_gravity_and_the_truth_is_its_slopes() {
    let mut machine = machine(&ExcavatorSetup::SMOOTH, 1);
    for tick in 0..60_000 {
        let motion = machine.step(at(tick));
        let length: f64 = motion.force_g.iter().map(|f| f * f).sum();
        assert!((length - 1.0).abs() < 1e-12);
        let want = Attitude::from_gravity(motion.force_g, motion.attitude.turn_deg);
        assert!((want.slope_x_deg - motion.attitude.slope_x_deg).abs() < 1e-9);
        assert!((want.slope_y_deg - motion.attitude.slope_y_deg).abs() < 1e-9);
        assert_eq!(motion.attitude.turn_deg, motion.attitude.slope_y_deg);
    }
}

/// Along the housing's axes, which slew and pitch have turned, deg.
fn along_axes([east, north, up]: [f64; 3], slew_deg: f64, pitch_deg: f64) -> [f64; 3] {
    let (sin, cos) = slew_deg.to_radians().sin_cos();
    let (outwards, along) = (cos * east + sin * north, cos * north - sin * east);
    let (sin, cos) = pitch_deg.to_radians().sin_cos();
    [-along, cos * outwards + sin * up, cos * up - sin * outwards]
}

#[test]
fn the_force_on_the_boom_is_the_acceleration_of_its_path() {
    for (slew_deg, most) in [((0.0, 0.0), 0.0), ((60.0, 120.0), 0.05)] {
        let setup = ExcavatorSetup {
            lever_arm_m: 1.0,
            sway_deg: 0.0,
            slew_deg,
            ..ExcavatorSetup::SMOOTH
        };
        let mut machine = machine(&setup, 2);
        let (mut centripetal, mut sideways) = (0.0f64, 0.0f64);
        for tick in 0..60_000 {
            let motion = machine.step(at(tick));
            let h = 1e-4;
            let pose = |t: f64| machine.arm.pose(t);
            let place = |t: f64| {
                let (sin, cos) = pose(t).pitch_deg.to_radians().sin_cos();
                let radius = PIVOT_M + cos;
                let slew = pose(t).slew_deg.to_radians();
                [radius * slew.cos(), radius * slew.sin(), sin]
            };
            let (a, b, c) = (place(at(tick) - h), place(at(tick)), place(at(tick) + h));
            let felt = |i: usize| (a[i] - 2.0 * b[i] + c[i]) / (h * h) / STANDARD_GRAVITY_M_S2;
            let now = pose(at(tick));
            let felt = [felt(0), felt(1), felt(2) + 1.0];
            let want = along_axes(felt, now.slew_deg, now.pitch_deg);
            let far = (0..3)
                .map(|i| (want[i] - motion.force_g[i]).abs())
                .fold(0.0, f64::max);
            // Where one move ends the next acceleration is another; a difference spans both.
            assert!(far < 2e-4, "{tick}: {want:?} {motion:?}");
            let level = now.pitch_deg.to_radians().sin();
            centripetal = centripetal.max((motion.force_g[1] - level).abs());
            sideways = sideways.max(motion.force_g[0].abs());
        }
        assert!(centripetal > 0.03, "{centripetal}");
        assert!((sideways > most) == (most > 0.0), "{sideways}");
    }
}

#[test]
fn a_cab_that_slews_turns_the_housing_about_the_vertical_and_comes_back() {
    let mut machine = machine(&ExcavatorSetup::SLEWING, 3);
    let (mut fastest, mut farthest, mut turned_deg) = (0.0f64, 0.0f64, 0.0f64);
    let mut home = 0;
    for tick in 0..120_000 {
        let motion = machine.step(at(tick));
        let gravity = gravity_g(&machine.arm.pose(at(tick)));
        let about_up: f64 = (0..3).map(|i| motion.rate_dps[i] * gravity[i]).sum();
        turned_deg += about_up * TICK_S;
        let slew_deg = machine.arm.pose(at(tick)).slew_deg;
        // What turns gravity turns about level axes.
        assert!(
            (turned_deg - slew_deg).abs() < 0.5,
            "{tick}: {turned_deg} {slew_deg}"
        );
        fastest = fastest.max(about_up.abs());
        farthest = farthest.max(slew_deg);
        home += u32::from(slew_deg.abs() < 1e-9);
    }
    assert!((40.0..=60.5).contains(&fastest), "{fastest}");
    assert!((80.0..=120.0).contains(&farthest), "{farthest}");
    assert!(home > 30_000, "{home}");
}

#[test]
fn rumble_and_engine_have_their_rms_at_work_and_a_tenth_when_idle() {
    let smooth = ExcavatorSetup::SMOOTH;
    let rumble = ExcavatorSetup {
        rumble_g: 0.030,
        ..smooth
    };
    let engine = ExcavatorSetup {
        engine_g: 0.050,
        ..smooth
    };
    for (setup, want) in [(rumble, 0.030), (engine, 0.050)] {
        for axis in 0..3 {
            let at_work = rms(&beyond(setup, 300_000, axis));
            assert!((at_work / want - 1.0).abs() < 0.1, "{axis}: {at_work}");
        }
        let idle = ExcavatorSetup {
            scene: Scene::Standstill,
            ..setup
        };
        let idle = rms(&beyond(idle, 300_000, 2));
        assert!((idle / want - 0.1).abs() < 0.01, "{idle}");
    }
}

#[test]
fn shocks_are_bursts_of_1_to_5_g() {
    let setup = ExcavatorSetup {
        shock_g: (1.0, 5.0),
        ..ExcavatorSetup::SMOOTH
    };
    let axes = [0, 1, 2].map(|axis| beyond(setup, 1_800_000, axis));
    let size = |t: usize| axes.iter().map(|a| a[t] * a[t]).sum::<f64>().sqrt();
    let (mut peaks, mut peak, mut quiet) = (Vec::new(), 0.0f64, 0);
    for t in 0..1_800_000 {
        quiet = if size(t) < 0.02 { quiet + 1 } else { 0 };
        peak = peak.max(size(t));
        // The burst swings through zero; only a longer quiet ends it.
        if quiet == 60 && peak > 0.1 {
            peaks.push(peak);
            peak = 0.0;
        }
    }
    // About 103 cycles with two strikes each.
    assert!((150..260).contains(&peaks.len()), "{}", peaks.len());
    assert!(peaks.iter().all(|p| (0.95..=5.01).contains(p)), "{peaks:?}");
    assert!(peaks.iter().any(|p| *p > 4.5) && peaks.iter().any(|p| *p < 1.5));
}

#[test]
fn a_stopped_machine_stands_and_only_idles() {
    let mut machine = machine(&ExcavatorSetup::NOMINAL, 3);
    (0..5000).for_each(|t| {
        machine.step(at(t));
    });
    machine.stop(at(5000));
    assert!(machine.stopped());
    let (mut still, mut shaking) = (Vec::new(), Vec::new());
    for tick in 5000..50_000 {
        let motion = machine.step(at(tick));
        if tick >= 7500 {
            still.push(motion.attitude.slope_y_deg);
            let level = motion.attitude.slope_y_deg.to_radians().sin();
            shaking.push(motion.force_g[1] - level);
        }
    }
    assert!(still.iter().all(|p| *p == still[0]));
    let idle = 0.1 * 0.030f64.hypot(0.050);
    assert!(
        (rms(&shaking) / idle - 1.0).abs() < 0.1,
        "{}",
        rms(&shaking)
    );
    machine.resume(at(50_000));
    let moved = (50_000..60_000).map(|t| machine.step(at(t)).attitude.slope_y_deg);
    assert!(moved.fold(0.0f64, |m, p| m.max((p - still[0]).abs())) > 10.0);
}

#[test]
fn one_seed_gives_the_same_bits_and_roughness_does_not_change_the_moves() {
    let run = |setup: &ExcavatorSetup, seed| {
        let mut machine = machine(setup, seed);
        (0..60_000)
            .map(move |t| machine.step(at(t)))
            .collect::<Vec<Motion>>()
    };
    let nominal = run(&ExcavatorSetup::NOMINAL, 1);
    assert_eq!(nominal, run(&ExcavatorSetup::NOMINAL, 1));
    assert_ne!(nominal, run(&ExcavatorSetup::NOMINAL, 2));
    let smooth = run(&ExcavatorSetup::SMOOTH, 1);
    assert!(
        nominal
            .iter()
            .zip(&smooth)
            .all(|(n, s)| n.attitude == s.attitude)
    );
}

#[test]
fn sines_are_those_of_the_library_wherever_the_arm_goes() {
    for step in -2000..=2000 {
        let angle = f64::from(step) * 1e-3;
        for (got, of) in sines([angle, 0.3 * angle]).iter().zip([angle, 0.3 * angle]) {
            assert!((got - of.sin()).abs() < 5e-15, "{of}: {got}");
        }
    }
}
