//! What a vertical states that gravity contradicts.

use super::tests::{Housing, Vec3, accel_of, between_deg, motion, rate_of, real};
use super::*;

const CALIBRATED: Expected = Expected::CALIBRATED;

const STILL: Vec3 = [0.0; 3];

/// One channel, sample by sample.
struct Channel {
    motion: Motion,
    state: MotionState,
    housing: Housing,
    /// What the gyroscope adds to each rate, rad/s and share; what a blow adds to gravity, g.
    bias: Vec3,
    scale: f64,
    blow: Vec3,
}

impl Channel {
    fn new(e: &Expected, up: Vec3, lever_m: Vec3) -> Self {
        Self {
            motion: motion(e),
            state: MotionState::default(),
            housing: Housing::new(up, lever_m),
            bias: STILL,
            scale: 1.0,
            blow: STILL,
        }
    }

    /// Error and standard uncertainty, deg; the reason where there is no vertical.
    fn step(&mut self, rate: Vec3) -> Result<(f64, f64), Invalid> {
        let (w, a) = self.housing.step(rate, CALIBRATED.period_s);
        let w = [0, 1, 2].map(|i| w[i] * self.scale + self.bias[i]);
        let a = [0, 1, 2].map(|i| a[i] + self.blow[i]);
        let found = self.motion.step(&mut self.state, rate_of(w), accel_of(a))?;
        let error = between_deg(real(&found), self.housing.up);
        Ok((error, found.uncertainty.degrees()))
    }

    /// The last of so many seconds, the share of those with a vertical that were within twice the
    /// uncertainty, and how many there were.
    fn run(&mut self, seconds: f64, rate: impl Fn(f64) -> Vec3) -> (f64, f64, [u32; 2]) {
        let mut last = (f64::NAN, f64::NAN);
        let (mut within, mut valid) = (0, 0);
        for n in 0..(seconds / CALIBRATED.period_s) as u32 {
            if let Ok(found) = self.step(rate(f64::from(n) * CALIBRATED.period_s)) {
                last = found;
                valid += 1;
                within += u32::from(found.0 <= 2.0 * found.1);
            }
        }
        (last.0, last.1, [within, valid])
    }

    /// Gains speed along y for so long, on ground that shakes it by `rough` (g). The vertical is
    /// within twice its uncertainty wherever there is one, as there is at the end.
    fn drive(&mut self, (accel, seconds): (f64, f64), rough: f64) {
        let mut last = Err(Invalid::NoSample);
        for n in 0..(seconds / CALIBRATED.period_s) as u32 {
            let t = f64::from(n) * CALIBRATED.period_s;
            let [x, y] = [40.0, 23.0].map(|angular| rough * f64::sin(angular * t));
            self.blow = [x, accel + y, 0.0];
            last = self.step(STILL);
            let wrong = last.is_ok_and(|(error, stated)| error > 2.0 * stated);
            assert!(!wrong, "{accel} g, rough {rough}, after {t} s: {last:?}");
        }
        assert!(accel != 0.0 || last.is_ok(), "{last:?}");
    }
}

/// A bench in a chamber: the scale was calibrated at 25 degC and is 0.8 % off at 70.
#[test]
fn a_scale_that_temperature_has_changed_is_in_the_uncertainty_and_is_mended_at_rest() {
    let mut channel = Channel::new(&CALIBRATED, [0.0, 0.9, 0.4], STILL);
    channel.run(5.0, |_| STILL);
    let hot = Temperature::from_celsius(70);
    channel.motion.temperature(&mut channel.state, hot);
    channel.scale = 1.008;
    // 126 deg at 80 deg/s, then a rest.
    let turn = |t: f64| [if t < 1.575 { 80f64.to_radians() } else { 0.0 }, 0.0, 0.0];
    let (error, stated, _) = channel.run(1.575, turn);
    assert!(error > 0.8 && error < 4.0 * stated, "{error} {stated}");
    let (error, stated, _) = channel.run(1.5, |_| STILL);
    assert!(error < 0.2 && error < 2.0 * stated, "{error} {stated}");
}

#[test]
fn a_housing_put_elsewhere_without_a_rate_is_found_again() {
    for jump_deg in [1.0f64, 5.0, 20.0, 90.0, 170.0] {
        let mut channel = Channel::new(&CALIBRATED, [0.1, 0.2, 1.0], STILL);
        channel.run(10.0, |_| STILL);
        let (sin, cos) = jump_deg.to_radians().sin_cos();
        let [x, y, z] = channel.housing.up;
        channel.housing.up = [x, y * cos - z * sin, z * cos + y * sin];
        channel.run(0.3, |_| STILL);
        let (_, _, [within, valid]) = channel.run(2.7, |_| STILL);
        assert_eq!(within, valid, "{jump_deg} deg");
        let (error, stated, [within, valid]) = channel.run(4.0, |_| STILL);
        assert!(
            error < 0.02 && stated < 0.2,
            "{jump_deg} deg: {error} {stated}"
        );
        assert!(
            within == valid && valid > 800,
            "{jump_deg} deg: {within} of {valid}"
        );
    }
}

#[test]
fn a_blow_now_and_then_hid_that_gravity_contradicts() {
    let mut channel = Channel::new(&CALIBRATED, [0.1, 0.2, 1.0], STILL);
    channel.run(10.0, |_| STILL);
    channel.housing.up = [0.1, -0.2, 1.0].map(|c| c / 1.05f64.sqrt());
    let mut last = f64::NAN;
    for _ in 0..15 {
        channel.run(0.75, |_| STILL);
        // It leaves no velocity.
        for blow in [[1.0, 0.5, 0.0], [-1.0, -0.5, 0.0], STILL] {
            channel.blow = blow;
            last = channel.run(0.02, |_| STILL).0;
        }
    }
    assert!(last < 0.1, "{last}");
}

#[test]
fn a_bias_step_of_a_gyroscope_is_stated_after_0_7_s_and_never_stated_away() {
    let mut channel = Channel::new(&CALIBRATED, [0.1, 0.2, 1.0], STILL);
    channel.run(10.0, |_| STILL);
    channel.bias = [2f64.to_radians(), 0.0, 0.0];
    let (_, _, [within, valid]) = channel.run(0.7, |_| STILL);
    assert!(within < valid, "{within} of {valid}");
    let (_, _, [within, valid]) = channel.run(20.0, |_| STILL);
    assert!(within * 100 >= valid * 95, "{within} of {valid}");
}

/// A gyroscope was wrong for a while: its vertical counted as certain again while it was still 3
/// deg off, was corrected by too much where rest began, and looked for rest anew after each
/// correction.
#[test]
fn a_vertical_that_gravity_contradicted_is_uncertain_until_it_is_right_again() {
    let biases = [0.3, 0.5, 1.0, 1.5, 2.0, 3.0];
    let durations = [0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 6.0];
    for (dps, seconds) in biases
        .into_iter()
        .flat_map(|dps| durations.map(|s| (dps, s)))
    {
        for e in [CALIBRATED, Expected::INDUSTRIAL] {
            let mut channel = Channel::new(&e, [0.1, 0.2, 1.0], STILL);
            channel.run(10.0, |_| STILL);
            channel.bias = [0.0, f64::to_radians(dps), 0.0];
            channel.run(seconds, |_| STILL);
            channel.bias = STILL;
            // Until two blocks contradict.
            channel.run(0.2, |_| STILL);
            for n in 0..4000 {
                let Ok((error, stated)) = channel.step(STILL) else {
                    continue;
                };
                let most = if n < 1520 {
                    0.4f64.max(3.0 * stated)
                } else {
                    0.3
                };
                let at = f64::from(n) * e.period_s;
                assert!(
                    error < most,
                    "{dps} deg/s, {seconds} s: {error} {stated} after {at}"
                );
            }
        }
    }
}

#[test]
fn a_start_while_the_boom_moves_states_what_it_deserves() {
    let stroke = |hz: f64, t: f64| (2.0 * core::f64::consts::PI * hz * t).sin();
    let rate = |t: f64| [0.0, 0.4 * stroke(0.15, t) + 0.25 * stroke(0.3, t), 0.0];
    for e in [CALIBRATED, Expected::INDUSTRIAL] {
        let mut channel = Channel::new(&e, [0.0, 0.0, 1.0], [3.0, 0.0, 0.3]);
        channel.run(10.0, |_| STILL);
        let mut counts = [0; 2];
        for start in 0..60 {
            channel.state.restart();
            let (_, _, found) = channel.run(3.7, |t| rate(3.7 * f64::from(start) + t));
            counts = [0, 1].map(|i| counts[i] + found[i]);
        }
        let [within, valid] = counts;
        assert!(
            within * 100 >= valid * 95 && valid > 0,
            "{within} of {valid}"
        );
    }
}

/// A boom that set out slowly was taken to be at rest, and the vertical 0.7 deg off with 0.1 deg
/// stated (seed 1449 of the trials with a gyroscope).
#[test]
fn a_boom_that_set_out_slowly_was_at_rest() {
    let stroke = |t: f64| {
        [
            0.0,
            0.5 * (2.0 * core::f64::consts::PI * 0.3 * t).sin(),
            0.0,
        ]
    };
    let faster = [0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.3];
    let arms = [1.5, 3.0].map(|lever_m| faster.map(|faster| (lever_m, faster)));
    for (lever_m, faster) in arms.into_iter().flatten() {
        for moment_s in [0.3, 0.5, 0.8, 1.5, 5.0] {
            let mut channel = Channel::new(&CALIBRATED, [0.0, 0.0, 1.0], [0.3, 0.0, lever_m]);
            channel.run(10.0, |_| STILL);
            // A start in motion: the vertical is hardly known when the boom stops for a moment.
            channel.state.restart();
            channel.run(10.0, stroke);
            channel.run(moment_s, |_| STILL);
            for n in 0..800 {
                let t = f64::from(n) * CALIBRATED.period_s;
                let found = channel.step([0.0, faster * t, 0.0]);
                let wrong = found.is_ok_and(|(error, stated)| error > 2.0 * stated.max(0.1));
                assert!(
                    !wrong,
                    "{lever_m} m, {faster} rad/s^2, {moment_s} s, {t}: {found:?}"
                );
            }
        }
    }
}

/// A gyroscope that had turned the vertical away while the machine moved was believed afterwards,
/// 13 deg off with 1.6 deg stated (seed 23489 of the trials).
#[test]
fn a_wrong_vertical_was_believed_for_as_long_as_the_machine_moved() {
    let stroke = |hz: f64, t: f64| (2.0 * core::f64::consts::PI * hz * t).sin();
    let rate = |t: f64| [0.0, 0.4 * stroke(0.15, t) + 0.25 * stroke(0.3, t), 0.0];
    for e in [CALIBRATED, Expected::INDUSTRIAL] {
        // A smaller error gives the housing no velocity that is more than a machine's.
        for wrong_deg in [15.0f64, 30.0, 60.0, 90.0, 170.0] {
            let mut channel = Channel::new(&e, [0.0, 0.0, 1.0], [3.0, 0.0, 0.3]);
            channel.run(10.0, |_| STILL);
            channel.run(10.0, rate);
            channel.bias = [0.6, 0.8, 0.0].map(|share| share * wrong_deg.to_radians());
            channel.run(1.0, |t| rate(t + 10.0));
            channel.bias = STILL;
            channel.run(8.0, |t| rate(t + 11.0));
            let (error, _, [within, valid]) = channel.run(10.0, |t| rate(t + 19.0));
            assert!(error < 2.0, "{wrong_deg} deg: {error}");
            assert!(
                within * 100 >= valid * 95 && valid > 3000,
                "{wrong_deg} deg: {within} of {valid}"
            );
        }
    }
}

/// A wheel loader that braked from 5 m/s on rough ground was 7 deg off at its standstill: its speed
/// had counted as that of a wrong vertical.
#[test]
fn a_machine_that_drives_off_and_brakes_keeps_its_vertical() {
    const SPEEDS: [f64; 4] = [0.3, 0.5, 0.75, 1.0];
    let accelerations = [0.1, 0.15, 0.2, 0.25, 0.3, 0.5, 1.0];
    let drives = accelerations.map(|accel| SPEEDS.map(|speed| (accel, speed / accel)));
    for (accel, seconds) in drives.into_iter().flatten() {
        for rough in [0.0, 0.05] {
            // A steady acceleration for longer looks like tilt.
            if rough == 0.0 && seconds > 3.0 {
                continue;
            }
            for e in [CALIBRATED, Expected::INDUSTRIAL] {
                let mut channel = Channel::new(&e, [0.0, 0.0, 1.0], STILL);
                channel.run(10.0, |_| STILL);
                for stretch in [
                    (accel, seconds),
                    (0.0, 10.0),
                    (-accel, seconds),
                    (0.0, 10.0),
                ] {
                    channel.drive(stretch, rough);
                }
            }
        }
    }
}

/// No machine of the scenes, and nobody who carries a sensor (BROAD), is as fast as what counts as
/// a wrong vertical; a start in motion is not, either.
#[test]
fn a_machine_that_moves_as_fast_as_it_may_keeps_its_vertical() {
    // Velocity along y, back and forth in 2 s, g s.
    let speed = 1.2f64;
    for e in [CALIBRATED, Expected::INDUSTRIAL] {
        let mut channel = Channel::new(&e, [0.0, 0.0, 1.0], STILL);
        channel.run(10.0, |_| STILL);
        let mut invalid = 0;
        for n in 0..24_000u32 {
            let angular = core::f64::consts::PI;
            let t = f64::from(n) * e.period_s;
            channel.blow = [0.0, speed * angular * (angular * t).cos(), 0.0];
            invalid += u32::from(channel.step(STILL).is_err());
        }
        assert_eq!(invalid, 0, "{speed} g s");
    }
}
