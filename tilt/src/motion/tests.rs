//! A rigid housing that turns and swings by formulae, and what the estimator says of it.

use super::reference::{Reference, cross, dot, turned, unit};
use super::*;
use crate::ONE_G;
use proptest::prelude::*;
use std::f64::consts::PI;
use std::vec::Vec;

pub(super) type Vec3 = [f64; 3];
const G: f64 = 9.80665;

pub(super) fn motion(e: &Expected) -> Motion {
    Motion::new(e).unwrap()
}

pub(super) fn rate_of(v: Vec3) -> Rate {
    Rate {
        rate: v.map(|v| (v * RATE_STEPS).round() as i32),
    }
}

pub(super) fn accel_of(v: Vec3) -> Corrected {
    Corrected {
        accel: v.map(|v| (v * f64::from(ONE_G)).round() as i32),
    }
}

pub(super) fn real(vertical: &Vertical) -> Vec3 {
    vertical.up.map(|v| f64::from(v) / f64::from(1 << 30))
}

pub(super) fn between_deg(a: Vec3, b: Vec3) -> f64 {
    let c = cross(a, b);
    dot(c, c).sqrt().atan2(dot(a, b)).to_degrees()
}

/// A housing whose true vertical is kept to the last bit of a real number.
pub(super) struct Housing {
    pub(super) up: Vec3,
    /// From the axis of rotation to the sensor, m, in the housing's axes.
    lever_m: Vec3,
    before: Vec3,
}

impl Housing {
    pub(super) fn new(up: Vec3, lever_m: Vec3) -> Self {
        Self {
            up: unit(up),
            lever_m,
            before: [0.0; 3],
        }
    }

    /// Turns at `rate` (rad/s) for a period; what a perfect sensor says at its end.
    pub(super) fn step(&mut self, rate: Vec3, period_s: f64) -> (Vec3, Vec3) {
        self.up = turned(self.up, rate.map(|r| r * period_s));
        let speeding = [0, 1, 2].map(|i| (rate[i] - self.before[i]) / period_s);
        self.before = rate;
        let inward = cross(rate, cross(rate, self.lever_m));
        let along = cross(speeding, self.lever_m);
        let accel = [0, 1, 2].map(|i| self.up[i] + (inward[i] + along[i]) / G);
        (rate, accel)
    }
}

/// Runs for `seconds`; the errors in degrees from `after` seconds on, with the uncertainties.
fn run(
    e: &Expected,
    state: &mut MotionState,
    housing: &mut Housing,
    [seconds, after]: [f64; 2],
    rate: impl Fn(f64) -> Vec3,
    bias: Vec3,
) -> Vec<(f64, f64)> {
    let motion = motion(e);
    let samples = (seconds / e.period_s) as u32;
    let mut errors = Vec::new();
    for n in 0..samples {
        let t = f64::from(n) * e.period_s;
        let (w, a) = housing.step(rate(t), e.period_s);
        let said = [0, 1, 2].map(|i| w[i] + bias[i]);
        let vertical = motion.step(state, rate_of(said), accel_of(a));
        if t < after {
            continue;
        }
        let vertical = vertical.unwrap();
        let error = between_deg(real(&vertical), housing.up);
        errors.push((error, vertical.uncertainty.degrees()));
    }
    errors
}

fn rms(errors: &[(f64, f64)]) -> f64 {
    let sum: f64 = errors.iter().map(|(e, _)| e * e).sum();
    (sum / errors.len() as f64).sqrt()
}

const STILL: Vec3 = [0.0; 3];
const INDUSTRIAL: Expected = Expected::INDUSTRIAL;

#[test]
fn a_housing_at_rest_is_right_wherever_up_is() {
    let e = INDUSTRIAL;
    for up in [
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
        [1.0, 1.0, 1.0],
        [-0.7, 0.1, 0.5],
    ] {
        let mut housing = Housing::new(up, STILL);
        let mut state = MotionState::default();
        let errors = run(&e, &mut state, &mut housing, [20.0, 5.0], |_| STILL, STILL);
        let worst = errors.iter().map(|(e, _)| *e).fold(0.0, f64::max);
        assert!(worst < 1e-3, "{up:?}: {worst}");
        let (_, said) = errors.last().unwrap();
        // The accelerometer's offset is 0.252 deg of it.
        assert!((0.252..0.35).contains(said), "{up:?}: {said}");
    }
}

#[test]
fn turns_at_80_deg_s_with_a_lever_arm_show_less_than_a_tenth_of_a_degree() {
    let e = INDUSTRIAL;
    let speed = 80f64.to_radians();
    for axis in 0..3 {
        for lever in [0.0, 0.02, 0.05] {
            // Back and forth by 60 deg after five seconds of rest.
            let rate = |t: f64| {
                let mut rate = STILL;
                let forth = ((t - 5.0) / 0.75) as i32 % 2 == 0;
                if t >= 5.0 {
                    rate[axis] = if forth { speed } else { -speed };
                }
                rate
            };
            let mut arm = STILL;
            arm[(axis + 1) % 3] = lever;
            let mut housing = Housing::new([0.1, 0.2, 0.97], arm);
            let mut state = MotionState::default();
            let errors = run(&e, &mut state, &mut housing, [60.0, 5.0], rate, STILL);
            assert!(rms(&errors) < 0.1, "{axis} {lever}: {}", rms(&errors));
        }
    }
}

#[test]
fn a_boom_of_three_metres_shows_less_than_half_a_degree() {
    let e = INDUSTRIAL;
    let rate = |t: f64| {
        let swing = 0.5 * (2.0 * PI * 0.15 * (t - 10.0)).sin();
        [0.0, if t < 10.0 { 0.0 } else { swing }, 0.0]
    };
    let mut housing = Housing::new([0.0, 0.0, 1.0], [3.0, 0.0, 0.3]);
    let mut state = MotionState::default();
    let errors = run(&e, &mut state, &mut housing, [120.0, 10.0], rate, STILL);
    assert!(rms(&errors) < 0.5, "{}", rms(&errors));
    let beyond = |(error, said): &(f64, f64)| *error > 3.0 * said;
    assert!(!errors.iter().any(beyond));
}

#[test]
fn braking_from_a_steady_speed_is_no_tilt() {
    let e = INDUSTRIAL;
    let motion = motion(&e);
    for brake in [0.02, 0.1, 0.3] {
        let mut state = MotionState::default();
        let up = unit([0.1, -0.2, 1.0]);
        let along = unit(cross(up, [0.0, 1.0, 0.0]));
        for n in 0..24_000 {
            let t = f64::from(n) * e.period_s;
            let push = match t % 30.0 {
                10.0..12.0 => brake,
                16.0..18.0 => -brake,
                _ => 0.0,
            };
            let accel = [0, 1, 2].map(|i| up[i] + push * along[i]);
            let said = motion.step(&mut state, Rate::default(), accel_of(accel));
            if t > 5.0 {
                let error = between_deg(real(&said.unwrap()), up);
                assert!(error < 0.1, "{brake} g, {t} s: {error}");
            }
        }
    }
}

#[test]
fn two_seconds_after_digging_the_vertical_is_right_again() {
    let e = INDUSTRIAL;
    let rate = |t: f64| {
        let digs = (10.0..30.0).contains(&t);
        let stroke = |hz: f64| (2.0 * PI * hz * (t - 10.0)).sin();
        [
            0.0,
            if digs {
                0.4 * stroke(0.15) + 0.25 * stroke(0.3)
            } else {
                0.0
            },
            0.0,
        ]
    };
    // A gyroscope with a bias; what it turned wrongly has to come out in these two seconds.
    let bias = [0.003, 0.005, -0.004];
    let mut housing = Housing::new([0.0, 0.0, 1.0], [3.0, 0.0, 0.3]);
    let mut state = MotionState::default();
    let errors = run(&e, &mut state, &mut housing, [40.0, 32.0], rate, bias);
    assert!(rms(&errors) < 0.05, "{}", rms(&errors));
}

#[test]
fn a_bias_of_one_deg_per_s_is_found() {
    let e = INDUSTRIAL;
    let one = 1f64.to_radians();
    let bias = [one, -one, one];
    let mut housing = Housing::new([0.0, 0.0, 1.0], STILL);
    let mut state = MotionState::default();
    let off = |state: &MotionState| {
        let found = state.bias().unwrap().map(|b| f64::from(b) / 2f64.powi(32));
        [0, 1, 2].map(|i| (found[i] - bias[i]).to_degrees().abs())
    };
    let at_rest = run(&e, &mut state, &mut housing, [30.0, 10.0], |_| STILL, bias);
    assert!(rms(&at_rest) < 0.05, "{}", rms(&at_rest));
    // What turns about the vertical shows in no acceleration.
    let [x, y, _] = off(&state);
    assert!(x < 0.02 && y < 0.02, "{x} {y}");
    let rate = |t: f64| [0.6 * (1.3 * t).sin(), 0.5 * (0.9 * t).cos(), 0.0];
    let moving = run(&e, &mut state, &mut housing, [60.0, 20.0], rate, bias);
    assert!(rms(&moving) < 0.1, "{}", rms(&moving));
    assert!(off(&state).iter().all(|o| *o < 0.03), "{:?}", off(&state));
}

#[test]
fn the_uncertainty_grows_with_speed_and_shrinks_at_rest() {
    let e = INDUSTRIAL;
    let mut state = MotionState::default();
    let mut housing = Housing::new([0.0, 0.0, 1.0], [0.0, 0.0, 2.0]);
    let said = |errors: &[(f64, f64)]| errors.last().unwrap().1;
    let rest = said(&run(
        &e,
        &mut state,
        &mut housing,
        [20.0, 10.0],
        |_| STILL,
        STILL,
    ));
    let swing = |t: f64| [3.0 * (6.0 * t).sin(), 0.0, 0.0];
    let moving = said(&run(
        &e,
        &mut state,
        &mut housing,
        [20.0, 10.0],
        swing,
        STILL,
    ));
    let again = said(&run(
        &e,
        &mut state,
        &mut housing,
        [20.0, 10.0],
        |_| STILL,
        STILL,
    ));
    assert!(moving > 2.0 * rest, "{rest} {moving}");
    assert!((again / rest - 1.0).abs() < 0.1, "{rest} {again}");
}

#[test]
fn a_start_in_motion_expected_the_speed_of_a_machine_for_some_seconds_only() {
    let e = INDUSTRIAL;
    let expected = motion(&e).start_speed;
    let swing = |t: f64| [(2.0 * PI * 0.2 * t).sin(), 0.0, 0.0];
    let mut state = MotionState::default();
    let mut housing = Housing::new([0.0, 0.0, 1.0], [0.0, 1.4, 0.0]);
    let mut after = |seconds, rate: &dyn Fn(f64) -> Vec3| {
        run(
            &e,
            &mut state,
            &mut housing,
            [seconds, seconds],
            rate,
            STILL,
        );
        state.expected
    };
    assert_eq!(after(40.0, &swing), expected, "it has not rested");
    assert_eq!(
        after(2.0, &|_| STILL),
        expected,
        "it may move as fast again"
    );
    assert_eq!(after(60.0, &|_| STILL), 0, "it has rested for long");
    assert_eq!(after(40.0, &swing), 0, "what is seen counts now");
    // At rest from the start there is nothing to expect.
    let mut state = MotionState::default();
    let mut housing = Housing::new([0.0, 0.0, 1.0], [0.0, 1.4, 0.0]);
    run(&e, &mut state, &mut housing, [2.0, 2.0], |_| STILL, STILL);
    assert_eq!(state.expected, 0);
}

#[test]
fn a_gyroscope_that_is_late_is_made_up_for() {
    let e = Expected {
        delay_s: 0.0025,
        ..INDUSTRIAL
    };
    // Of a sensor that is one sample late, the vertical belongs to the sample before.
    let mut state = MotionState::default();
    let motion = motion(&e);
    let rate = |n: u32| [2.0 * (f64::from(n) * 0.005).sin(), 0.0, 0.0];
    let (mut late, mut now) = (Housing::new([0.0, 0.0, 1.0], STILL), [0.0; 3]);
    let mut worst = 0f64;
    for n in 0..20_000 {
        let (w, a) = late.step(rate(n), e.period_s);
        let said = motion.step(&mut state, rate_of(w), accel_of(a));
        now = turned(late.up, rate(n + 1).map(|r| r * e.period_s));
        if let (Ok(said), true) = (said, n > 12_000) {
            worst = worst.max(between_deg(real(&said), now));
        }
    }
    // One sample of 2 rad/s is 0.29 deg.
    assert!(worst < 0.01, "{worst} {now:?}");
}

#[test]
fn beyond_the_gyroscopes_range_the_vertical_is_lost_and_found_again() {
    let e = INDUSTRIAL;
    let motion = motion(&e);
    let mut state = MotionState::default();
    let mut housing = Housing::new([0.0, 0.3, 1.0], STILL);
    let first = motion.step(&mut state, Rate::default(), accel_of(housing.up));
    assert_eq!(first, Err(Invalid::NoSample));
    run(&e, &mut state, &mut housing, [10.0, 5.0], |_| STILL, STILL);
    let bias = state.bias();
    assert!(bias.is_some());
    let fast = rate_of([35.0, 0.0, 0.0]);
    let lost = motion.step(&mut state, fast, accel_of(housing.up));
    assert_eq!((lost, state.bias()), (Err(Invalid::OverRange), bias));
    let mut until = 0;
    loop {
        let said = motion.step(&mut state, Rate::default(), accel_of(housing.up));
        until += 1;
        match said {
            Ok(said) => break assert!(between_deg(real(&said), housing.up) < 0.01),
            Err(reason) => assert_eq!(reason, Invalid::OverRange),
        }
    }
    assert!((BLOCK..400).contains(&until), "{until}");
}

#[test]
fn without_gravity_there_is_no_start_and_an_accelerometer_at_its_end_is_not_believed() {
    let e = INDUSTRIAL;
    let motion = motion(&e);
    let mut state = MotionState::default();
    for _ in 0..100 {
        let fallen = motion.step(&mut state, Rate::default(), Corrected::default());
        assert_eq!(fallen, Err(Invalid::NoSample));
    }
    let mut housing = Housing::new([0.0, 0.0, 1.0], STILL);
    run(&e, &mut state, &mut housing, [10.0, 5.0], |_| STILL, STILL);
    for _ in 0..400 {
        let said = motion.step(&mut state, Rate::default(), accel_of([16.0, 0.0, 1.0]));
        assert!(between_deg(real(&said.unwrap()), housing.up) < 0.01);
    }
}

#[test]
fn refuses_what_it_cannot_be_set_to() {
    let with = |change: fn(&mut Expected)| {
        let mut e = INDUSTRIAL;
        change(&mut e);
        Motion::new(&e)
    };
    assert!(with(|_| ()).is_some());
    assert!(with(|e| e.period_s = 0.02).is_none());
    assert!(with(|e| e.period_s = f64::NAN).is_none());
    assert!(with(|e| e.delay_s = -0.001).is_none());
    assert!(with(|e| e.bias = 0.05).is_none());
    assert!(with(|e| e.hold_s = 0.0).is_none());
    assert!(with(|e| e.accel_range = 32.0).is_none());
}

/// Random motion of a poor sensor: what it says, sample by sample.
fn shaken(seed: u64) -> impl FnMut(f64) -> (Vec3, Vec3) {
    let mut state = seed;
    let mut random = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / 2f64.powi(52) - 1.0
    };
    let mut housing = Housing::new([0.3, -0.2, 0.9], [0.2, -0.1, 0.3]);
    let (mut n, mut aim, mut rate) = (0u32, STILL, STILL);
    move |period_s| {
        if n % 200 == 0 {
            let most = if n % 4000 < 1000 { 0.0 } else { 4.0 };
            aim = [0; 3].map(|_| most * random());
        }
        n += 1;
        rate = [0, 1, 2].map(|i| rate[i] + (aim[i] - rate[i]) * 0.02);
        let (w, a) = housing.step(rate, period_s);
        let said = [
            w[0] * 1.004 + 0.004 * w[1] + 0.01,
            w[1] * 0.997 - 0.015,
            w[2] + 0.003 * w[0] + 0.005,
        ];
        (
            said.map(|s| s + 0.002 * random()),
            a.map(|a| a + 0.002 * random()),
        )
    }
}

#[test]
fn integers_follow_real_numbers_to_a_thousandth_of_a_degree() {
    let e = INDUSTRIAL;
    let motion = motion(&e);
    for seed in 1..=3 {
        let mut sensor = shaken(seed);
        let mut state = MotionState::default();
        let (mut first, mut reference) = (STILL, None);
        let (mut worst, mut worst_share) = (0f64, 0f64);
        for n in 0..120_000u32 {
            let (w, a) = sensor(e.period_s);
            let said = motion.step(&mut state, rate_of(w), accel_of(a));
            let Some(reference) = &mut reference else {
                first = [0, 1, 2].map(|i| first[i] + a[i]);
                if n + 1 == BLOCK {
                    reference = Some(Reference::new(e, unit(first)));
                }
                continue;
            };
            reference.step(w, a);
            if let Ok(said) = said {
                worst = worst.max(between_deg(real(&said), reference.axes[2]));
                let share = said.uncertainty.degrees() / reference.uncertainty().to_degrees();
                worst_share = worst_share.max((share - 1.0).abs());
            }
        }
        std::println!(
            "{seed}: {worst:.5} deg, uncertainty {:.3} %",
            worst_share * 100.0
        );
        assert!(worst < 0.001, "{seed}: {worst}");
        assert!(worst_share < 0.001, "{seed}: {worst_share}");
    }
}

#[test]
fn the_covariance_stays_one_for_an_hour() {
    let e = INDUSTRIAL;
    let motion = motion(&e);
    let mut sensor = shaken(9);
    let mut state = MotionState::default();
    for n in 0..1_440_000u32 {
        let (w, a) = sensor(e.period_s);
        let _ = motion.step(&mut state, rate_of(w), accel_of(a));
        if n % 14_400 == 14_399 {
            assert!(state.covariance.is_one(), "sample {n}");
        }
    }
}

proptest! {
    #[test]
    fn nothing_overflows_at_full_scale(
        period_s in 0.0005..0.01f64,
        samples in prop::collection::vec((any::<[i32; 3]>(), any::<[i32; 3]>(), 0u8..4), 1..400),
        hold in 1usize..40,
    ) {
        let e = Expected { period_s, delay_s: 8.0 * period_s, rate_range: 127.0, ..INDUSTRIAL };
        let motion = motion(&e);
        let mut state = MotionState::default();
        for (rate, accel, kind) in samples {
            // Some are small enough to be followed, some are at the ends.
            let rate = rate.map(|r| if kind == 0 { r } else { r >> (kind + 1) });
            let accel = accel.map(|a| match kind { 1 => i32::MIN, 2 => a >> 4, _ => a });
            for _ in 0..hold {
                let said = motion.step(&mut state, Rate { rate }, Corrected { accel });
                if let Ok(said) = said {
                    let up = real(&said);
                    prop_assert!((dot(up, up) - 1.0).abs() < 0.1, "{up:?}");
                    prop_assert!(said.uncertainty <= motion.limit);
                }
            }
        }
    }
}
