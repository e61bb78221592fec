//! Turns by a motor and by hand, of sensors drawn from a seed.

mod scale;

use std::vec::Vec;

use super::*;
use crate::calibration::algebra::cross;
use crate::calibration::least_squares::{invert, times};
use crate::motion::{RATE_STEPS, Rate};
use crate::sample::Temperature;

const RAD: f64 = core::f64::consts::PI / 180.0;
const RATE_HZ: f64 = 416.0;
const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const ONE: [[f64; 3]; 3] = [X, Y, Z];

/// 5 mdeg/s/sqrt(Hz), 0.02 deg of the vertical, and the earth in the bias.
const ACCURACY: Accuracy = Accuracy {
    vertical: 0.02 * RAD,
    noise: 0.005 * RAD,
    bias: EARTH_RATE,
};

/// Numbers as random as a test needs them, the same every time.
struct Dice(u64);

impl Dice {
    fn new(seed: u64) -> Self {
        let mut dice = Self((seed + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        dice.uniform();
        dice
    }

    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Mean 0, standard deviation 1.
    fn normal(&mut self) -> f64 {
        let length = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        length * (core::f64::consts::TAU * self.uniform()).cos()
    }

    fn sign(&mut self) -> f64 {
        if self.uniform() < 0.5 { -1.0 } else { 1.0 }
    }

    fn vector(&mut self, size: f64) -> [f64; 3] {
        core::array::from_fn(|_| size * self.normal())
    }

    fn direction(&mut self) -> [f64; 3] {
        unit(self.vector(1.0))
    }

    /// M of a sensor whose axes are `angle_deg` off, each its own way, and whose scales are off by
    /// `scale`, up or down.
    fn sensor(&mut self, scale: f64, angle_deg: f64) -> [[f64; 3]; 3] {
        let (sin, cos) = (angle_deg * RAD).sin_cos();
        let axes = ONE.map(|axis| {
            let beside = unit(cross(axis, self.direction()));
            let gain = 1.0 + scale * self.sign();
            core::array::from_fn(|i| gain * (cos * axis[i] + sin * beside[i]))
        });
        invert(axes).unwrap()
    }

    /// M with normal errors of these standard deviations.
    fn drawn(&mut self, scale: f64, alignment: f64) -> [[f64; 3]; 3] {
        let mut gains = ONE;
        for (i, row) in gains.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry += self.normal() * if i == j { scale } else { alignment };
            }
        }
        gains
    }
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

/// Where the vertical is after the housing has turned by `angle` (rad) about `axis`.
fn turned(up: [f64; 3], axis: [f64; 3], angle: f64) -> [f64; 3] {
    let (sin, cos) = angle.sin_cos();
    let beside = cross(up, axis);
    let along: f64 = (0..3).map(|i| up[i] * axis[i]).sum();
    core::array::from_fn(|i| cos * up[i] + sin * beside[i] + (1.0 - cos) * along * axis[i])
}

/// A turn as it was: verticals, and the mean true rate of each sample.
struct Truth {
    before: [f64; 3],
    after: [f64; 3],
    rates: Vec<[f64; 3]>,
}

/// A motor's turn with a soft start and end, 90 deg/s at its fastest.
fn motor(before: [f64; 3], axis: [f64; 3], angle_deg: f64) -> Truth {
    let samples = (angle_deg.abs() / 45.0 * RATE_HZ).round().max(1.0) as usize;
    let share = |n: usize| {
        let t = core::f64::consts::TAU * n as f64 / samples as f64;
        (t - t.sin()) / core::f64::consts::TAU
    };
    let angle = angle_deg * RAD;
    let rate = |n| axis.map(|a| a * angle * (share(n + 1) - share(n)) * RATE_HZ);
    Truth {
        before,
        after: turned(before, axis, angle),
        rates: (0..samples).map(rate).collect(),
    }
}

/// A hand's turn of `seconds`: three rates that swell and fade, each with a swing of its own.
fn hand(dice: &mut Dice, before: [f64; 3], seconds: f64) -> Truth {
    const FINE: usize = 4;
    let samples = (seconds * RATE_HZ) as usize;
    let (steady, swing) = (dice.vector(60.0 * RAD), dice.vector(40.0 * RAD));
    let phase = dice.vector(2.0);
    let rate = |s: f64| {
        let swell = (core::f64::consts::PI * s).sin().powi(2);
        core::array::from_fn(|i| swell * (steady[i] + swing[i] * (6.0 * s + phase[i]).sin()))
    };
    let mut up = before;
    let mut sample = |n: usize| {
        let mut sum = [0.0; 3];
        for k in 0..FINE {
            let s = ((n * FINE + k) as f64 + 0.5) / (samples * FINE) as f64;
            let w: [f64; 3] = rate(s);
            let length = w.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-12);
            let axis = w.map(|x| x / length);
            up = turned(up, axis, length / RATE_HZ / FINE as f64);
            sum = core::array::from_fn(|i| sum[i] + w[i] / FINE as f64);
        }
        sum
    };
    let rates = (0..samples).map(&mut sample).collect();
    Truth {
        before,
        after: up,
        rates,
    }
}

/// What a motor does in one mount: quarters of a turn all round, and halves there and back.
fn mount(axis: [f64; 3], start: [f64; 3]) -> Vec<Truth> {
    let stops = [0.0, 90.0, 180.0, 270.0, 360.0, 180.0, 0.0, -90.0, 90.0, 0.0];
    let turn = |pair: &[f64]| {
        let before = turned(start, axis, pair[0] * RAD);
        motor(before, axis, pair[1] - pair[0])
    };
    stops.windows(2).map(turn).collect()
}

fn three_mounts() -> Vec<Truth> {
    let mounts = [(X, Z), (Y, Z), (Z, X)];
    mounts.into_iter().flat_map(|(a, s)| mount(a, s)).collect()
}

/// A turn as sensors give it: verticals, and rates without the bias that is known.
struct Measured {
    before: [f64; 3],
    after: [f64; 3],
    rates: Vec<[f64; 3]>,
}

/// Without noise.
fn measured(truth: &[Truth], gains: [[f64; 3]; 3]) -> Vec<Measured> {
    let sensor = invert(gains).unwrap();
    let each = |turn: &Truth| Measured {
        before: turn.before,
        after: turn.after,
        rates: turn.rates.iter().map(|&w| times(&sensor, w)).collect(),
    };
    truth.iter().map(each).collect()
}

/// With the noise of [`ACCURACY`].
fn noisy(dice: &mut Dice, truth: &[Truth], gains: [[f64; 3]; 3]) -> Vec<Measured> {
    let bias = dice.vector(ACCURACY.bias / 3f64.sqrt());
    let noise = ACCURACY.noise * (RATE_HZ / 2.0).sqrt();
    let mut turns = measured(truth, gains);
    for turn in &mut turns {
        for vertical in [&mut turn.before, &mut turn.after] {
            let error = dice.vector(ACCURACY.vertical);
            *vertical = unit(core::array::from_fn(|i| vertical[i] + error[i]));
        }
        for rate in &mut turn.rates {
            let error = dice.vector(noise);
            *rate = core::array::from_fn(|i| rate[i] + bias[i] + error[i]);
        }
    }
    turns
}

fn summed(turn: &Measured, start: [[f64; 3]; 3]) -> Result<Turn, FitError> {
    let mut sum = TurnSum::new(turn.before, start);
    for &rate in &turn.rates {
        sum.sample(rate, 1.0 / RATE_HZ);
    }
    sum.finish(turn.after)
}

/// One pass, in which each turn begins with the gains found so far.
fn first_pass(turns: &[Measured]) -> Result<GainFit, FitError> {
    let mut fit = GainFit::new(ACCURACY);
    for turn in turns {
        fit.add(&summed(turn, fit.present())?);
    }
    Ok(fit)
}

/// A pass in which all turns begin with the same gains.
fn later_pass(turns: &[Measured], start: [[f64; 3]; 3]) -> Result<GainFit, FitError> {
    let mut fit = GainFit::new(ACCURACY);
    for turn in turns {
        fit.add(&summed(turn, start)?);
    }
    Ok(fit)
}

fn by_hand(dice: &mut Dice, turns: usize) -> Vec<Truth> {
    let turn = |_| {
        let before = dice.direction();
        hand(dice, before, 3.0)
    };
    (0..turns).map(turn).collect()
}

/// The largest error of an entry.
fn worst(found: &[[f64; 3]; 3], truth: &[[f64; 3]; 3]) -> f64 {
    let pairs = found.iter().flatten().zip(truth.iter().flatten());
    pairs.fold(0.0, |worst, (f, t)| worst.max((f - t).abs()))
}

/// What a first and a second pass over turns without noise leave of 3 % and 2 deg.
fn left_by_two_passes(seeds: u64, turns: impl Fn(&mut Dice) -> Vec<Truth>) -> [f64; 2] {
    let mut left = [0.0f64; 2];
    for seed in 0..seeds {
        let mut dice = Dice::new(seed);
        let gains = dice.sensor(0.03, 2.0);
        let turns = measured(&turns(&mut dice), gains);
        let first = first_pass(&turns).unwrap().solve().unwrap();
        let second = later_pass(&turns, first.gains).unwrap().solve().unwrap();
        let [a, b] = left;
        left = [
            a.max(worst(&first.gains, &gains)),
            b.max(worst(&second.gains, &gains)),
        ];
    }
    left
}

#[test]
fn one_pass_of_a_motor_leaves_less_than_a_hundred_thousandth() {
    let [first, second] = left_by_two_passes(40, |_| three_mounts());
    assert!(first < 1e-5 && second < 1e-5, "{first:e} {second:e}");
}

#[test]
fn one_pass_by_hand_leaves_half_a_thousandth_and_two_a_hundred_thousandth() {
    let [first, second] = left_by_two_passes(40, |dice| by_hand(dice, 24));
    assert!(first < 5e-4 && second < 1e-5, "{first:e} {second:e}");
}

/// Share of the entries within two standard uncertainties, in one pass over noisy turns.
fn coverage(seeds: u64, turns: impl Fn(&mut Dice) -> Vec<Truth>) -> f64 {
    let (mut inside, mut all) = (0, 0);
    for seed in 0..seeds {
        let mut dice = Dice::new(1000 + seed);
        let gains = dice.drawn(0.01, 1.0 * RAD);
        let truth = turns(&mut dice);
        let turns = noisy(&mut dice, &truth, gains);
        let fitted = first_pass(&turns).unwrap().solve_all(0.001).unwrap();
        let found = fitted.gains.iter().flatten();
        let uncertainty = fitted.uncertainty.iter().flatten();
        for ((found, u), truth) in found.zip(uncertainty).zip(gains.iter().flatten()) {
            inside += u32::from((found - truth).abs() <= 2.0 * u);
            all += 1;
        }
        let residual = fitted.residual_rms_deg;
        assert!((0.01..0.06).contains(&residual), "{seed}: {residual} deg");
    }
    f64::from(inside) / f64::from(all)
}

#[test]
fn the_uncertainty_of_a_motors_run_holds() {
    let share = coverage(200, |_| three_mounts());
    assert!(share > 0.94, "{share}");
}

#[test]
fn the_uncertainty_of_turns_by_hand_holds() {
    let share = coverage(200, |dice| by_hand(dice, 16));
    assert!(share > 0.94, "{share}");
}

#[test]
fn two_mounts_leave_the_third_axis_open() {
    let mut dice = Dice::new(5);
    let gains = dice.sensor(0.01, 1.0);
    let truth: Vec<_> = [X, Y].into_iter().flat_map(|a| mount(a, Z)).collect();
    let fit = first_pass(&noisy(&mut dice, &truth, gains)).unwrap();
    let fitted = fit.solve().unwrap();
    for (i, prior) in [ALIGNMENT_PRIOR, ALIGNMENT_PRIOR, SCALE_PRIOR]
        .iter()
        .enumerate()
    {
        let [x, y, z] = fitted.uncertainty[i];
        assert!(x < 0.001 && y < 0.001, "{:?}", fitted.uncertainty);
        assert!((z / prior - 1.0).abs() < 0.01, "{z}");
        let [.., z] = fitted.gains[i];
        assert!((z - ONE[i][2]).abs() < 0.001, "stays nominal: {z}");
    }
    let refused = fit.solve_all(0.001);
    assert!(matches!(refused, Err(FitError::IllConditioned { .. })));
}

#[test]
fn too_few_turns_and_the_same_turn_again_are_refused() {
    let truth = mount(X, Z);
    let turns = measured(&truth, ONE);
    let fit = first_pass(&turns[..4]).unwrap();
    assert_eq!(fit.solve(), Err(FitError::TooFew { have: 4, need: 5 }));
    let same: Vec<_> = (0..20).map(|_| motor(Z, X, 90.0)).collect();
    let fit = first_pass(&measured(&same, ONE)).unwrap();
    assert!(fit.solve().is_ok());
    let refused = fit.solve_all(0.01);
    assert!(matches!(refused, Err(FitError::IllConditioned { .. })));
}

#[test]
fn no_turn_and_one_there_and_back_are_refused() {
    let rest = motor(Z, X, 0.0);
    let mut back = motor(Z, X, 90.0);
    back.rates.extend(motor(Z, X, -90.0).rates);
    back.after = Z;
    for turn in measured(&[rest, back], ONE) {
        let refused = summed(&turn, ONE);
        assert!(matches!(refused, Err(FitError::IllConditioned { .. })));
    }
}

#[test]
fn numbers_that_are_none_are_refused() {
    let bad = |change: &dyn Fn(&mut Measured)| {
        let mut turns = measured(&[motor(Z, X, 90.0)], ONE);
        change(&mut turns[0]);
        summed(&turns[0], ONE)
    };
    assert!(bad(&|_| ()).is_ok());
    assert_eq!(
        bad(&|t| t.rates[9][1] = f64::NAN),
        Err(FitError::Implausible)
    );
    assert_eq!(bad(&|t| t.before[0] = f64::NAN), Err(FitError::Implausible));
    assert_eq!(bad(&|t| t.after = [0.0; 3]), Err(FitError::Implausible));
    assert_eq!(
        bad(&|t| t.after = [0.0, 9.8, 0.0]),
        Err(FitError::Implausible)
    );
    let mut fit = GainFit::new(Accuracy {
        vertical: f64::NAN,
        ..ACCURACY
    });
    for turn in measured(&mount(X, Z), ONE) {
        fit.add(&summed(&turn, ONE).unwrap());
    }
    assert!(matches!(fit.solve(), Err(FitError::IllConditioned { .. })));
    assert_eq!(fit.present(), ONE);
}

/// The whole calibration of a sensor whose rates are changed.
fn changed(change: impl Fn([f64; 3]) -> [f64; 3]) -> Result<FittedGains, FitError> {
    let mut turns = measured(&three_mounts(), ONE);
    for rate in turns.iter_mut().flat_map(|turn| &mut turn.rates) {
        *rate = change(*rate);
    }
    first_pass(&turns)?.solve_all(0.001)
}

#[test]
fn wrong_units_axes_and_signs_are_implausible() {
    assert!(changed(|rate| rate).is_ok());
    let implausible = Err(FitError::Implausible);
    assert_eq!(changed(|rate| rate.map(|w| w / RAD)), implausible);
    assert_eq!(changed(|rate| rate.map(|w| w * RAD)), implausible);
    assert_eq!(changed(|[x, y, z]| [y, x, z]), implausible);
    assert_eq!(changed(|[x, y, z]| [y, z, x]), implausible);
    assert_eq!(changed(|rate| rate.map(|w| -w)), implausible);
    assert_eq!(changed(|[x, y, z]| [x, y, -z]), implausible);
}

#[test]
fn a_scale_of_12_per_cent_and_an_axis_of_12_deg_are_implausible() {
    assert!(changed(|rate| rate.map(|w| w * 1.08)).is_ok());
    let scaled = changed(|[x, y, z]| [x, y * 1.12, z]);
    assert_eq!(scaled, Err(FitError::Implausible));
    let (sin, cos) = (12.0 * RAD).sin_cos();
    let skewed = changed(|[x, y, z]| [x * cos + y * sin, y, z]);
    assert_eq!(skewed, Err(FitError::Implausible));
}

#[test]
fn uncertainty_grows_with_turns_that_fit_badly() {
    let mut dice = Dice::new(3);
    let turns = noisy(&mut dice, &three_mounts(), ONE);
    let with = |accuracy| {
        let mut fit = GainFit::new(accuracy);
        for turn in &turns {
            fit.add(&summed(turn, ONE).unwrap());
        }
        fit.solve().unwrap().uncertainty[0][0]
    };
    let flattered = Accuracy {
        vertical: ACCURACY.vertical / 10.0,
        noise: ACCURACY.noise / 10.0,
        bias: ACCURACY.bias / 10.0,
    };
    let ratio = with(flattered) / with(ACCURACY);
    assert!((0.7..1.3).contains(&ratio), "{ratio}");
}

/// Rests, turns, and the integers of the chip behind them.
#[test]
fn the_chips_correction_gives_true_rates() {
    let mut dice = Dice::new(8);
    let gains = dice.sensor(0.02, 1.0);
    let sensor = invert(gains).unwrap();
    let bias_at = |t: f64| [2.0 + 0.02 * (t - 25.0), -1.0, 0.5 - 0.01 * (t - 25.0)];
    let felt = |rate, t| {
        let (rate, bias) = (times(&sensor, rate), bias_at(t));
        core::array::from_fn(|i| rate[i] + bias[i] * RAD)
    };
    let mut rests = BiasFit::default();
    for celsius in [-10, 10, 25, 40, 60] {
        let mean = felt([0.0; 3], f64::from(celsius));
        rests.add(mean, Temperature::from_celsius(celsius));
    }
    let bias = rests.solve().unwrap();
    let known = bias.at(Temperature::REFERENCE);
    let mut turns = measured(&three_mounts(), gains);
    for rate in turns.iter_mut().flat_map(|turn| &mut turn.rates) {
        *rate = core::array::from_fn(|i| rate[i] + bias_at(25.0)[i] * RAD - known[i]);
    }
    let fitted = first_pass(&turns).unwrap().solve_all(0.001).unwrap();
    let chip = correction(&bias, &fitted).unwrap();
    for celsius in [-5, 25, 50] {
        let truth = [1.0, -2.0, 0.5];
        let measured = Rate {
            rate: felt(truth, f64::from(celsius)).map(|w| (w * RATE_STEPS).round() as i32),
        };
        let at = chip.at(Temperature::from_celsius(celsius));
        let found = at.apply(measured).rad_s();
        for (found, truth) in found.into_iter().zip(truth) {
            assert!((found - truth).abs() < 2e-5, "{celsius}: {found} {truth}");
        }
    }
}
