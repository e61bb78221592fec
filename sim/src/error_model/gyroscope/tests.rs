//! Statistics of drawn gyroscopes, each term alone, and how temperature, power and sags act.

use super::super::{ErrorModel, Part, Term};
use super::*;
use crate::rng::Rng;

const LEVEL_G: [f64; 3] = [0.0, 0.0, 1.0];
const TURN_DPS: [f64; 3] = [0.0, 0.0, 100.0];
const DT_S: f64 = 0.0024;

fn rng() -> Rng {
    Rng::stream(1, "gyroscope model")
}

/// What a gyroscope measures at once, without white noise.
fn quiet(gyroscope: &mut Gyroscope, rate_dps: [f64; 3], force_g: [f64; 3]) -> [f64; 3] {
    let mut rng = Rng::stream(0, "quiet");
    gyroscope.feel(rate_dps, force_g, 0.0, 1e-9, &mut rng)
}

/// At rest and without gravity: its bias.
fn bias(gyroscope: &mut Gyroscope) -> [f64; 3] {
    quiet(gyroscope, [0.0; 3], [0.0; 3])
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

fn only(term: GyroscopeTerm, rng: &mut Rng) -> Gyroscope {
    Gyroscope::draw(&GyroscopeModel::NOMINAL.only(term), rng)
}

/// The sigma of a figure over 4000 gyroscopes that have one term only.
fn assert_sigma(
    term: GyroscopeTerm,
    want: f64,
    mut figure: impl FnMut(&mut Gyroscope, &mut Rng) -> f64,
) {
    let mut rng = rng();
    let values: Vec<f64> = (0..4000)
        .map(|_| figure(&mut only(term, &mut rng), &mut rng))
        .collect();
    let (got, mean) = (rms(&values), values.iter().sum::<f64>() / 4000.0);
    let close = (got / want - 1.0).abs() < 0.1 && mean.abs() < 0.1 * want;
    assert!(close, "{term:?}: {got} instead of {want}, mean {mean}");
}

#[test]
fn a_perfect_gyroscope_adds_nothing() {
    let mut rng = rng();
    let mut gyroscope = Gyroscope::draw(&GyroscopeModel::PERFECT, &mut rng);
    gyroscope.power_on(&mut rng);
    gyroscope.set_sag(true);
    assert_eq!(gyroscope.sample_sigma_dps(416.7), 0.0);
    for die_c in [-40.0, 25.0, 85.0] {
        gyroscope.set_die_temperature(die_c);
        for rate_dps in [TURN_DPS, [3.0, -40.0, 5.0]] {
            let felt_dps = gyroscope.feel(rate_dps, LEVEL_G, 0.07, DT_S, &mut rng);
            assert_eq!(felt_dps, rate_dps);
        }
    }
}

#[test]
fn biases_have_their_sigma() {
    assert_sigma(GyroscopeTerm::Bias, 1.0, |g, _| bias(g)[0]);
    assert_sigma(GyroscopeTerm::BiasOverTemperature, 0.005 * 40.0, |g, _| {
        g.set_die_temperature(65.0);
        bias(g)[1]
    });
    assert_sigma(GyroscopeTerm::BiasCurvature, 2e-5 * 1225.0, |g, _| {
        g.set_die_temperature(-10.0);
        bias(g)[2]
    });
    assert_sigma(GyroscopeTerm::TurnOn, 0.05, |g, rng| {
        g.power_on(rng);
        bias(g)[0]
    });
    assert_sigma(GyroscopeTerm::Flicker, 1.5e-3, |g, _| bias(g)[0]);
}

#[test]
fn gains_and_angles_have_their_sigma() {
    use GyroscopeTerm::{Misalignment, NonOrthogonality, Scale, ScaleOverTemperature};
    assert_sigma(Scale, 1.0, |g, _| quiet(g, TURN_DPS, LEVEL_G)[2] - 100.0);
    assert_sigma(ScaleOverTemperature, 100.0 * 5e-5 * 45.0, |g, _| {
        g.set_die_temperature(70.0);
        quiet(g, TURN_DPS, LEVEL_G)[2] - 100.0
    });
    let deg = |dps: f64| (dps / 100.0).to_degrees();
    assert_sigma(NonOrthogonality, 0.3, |g, _| {
        deg(quiet(g, TURN_DPS, LEVEL_G)[0])
    });
    assert_sigma(
        Misalignment,
        0.2,
        |g, _| deg(quiet(g, TURN_DPS, LEVEL_G)[1]),
    );
}

#[test]
fn force_turns_into_rate_by_nine_numbers() {
    let term = GyroscopeTerm::GSensitivity;
    for axis in 0..3 {
        let mut force_g = [0.0; 3];
        force_g[(axis + 1) % 3] = 2.0;
        assert_sigma(term, 0.04, |g, _| quiet(g, [0.0; 3], force_g)[axis]);
    }
    let mut gyroscope = only(term, &mut rng());
    let up = quiet(&mut gyroscope, [0.0; 3], LEVEL_G);
    let down = quiet(&mut gyroscope, [0.0; 3], [0.0, 0.0, -1.0]);
    assert_eq!(up, down.map(|dps| -dps));
}

#[test]
fn white_noise_is_its_density_and_doubles_in_a_sag() {
    let mut rng = rng();
    let model = GyroscopeModel {
        sag_noise_ratio: 1.0,
        ..GyroscopeModel::NOMINAL.only(GyroscopeTerm::WhiteNoise)
    };
    let mut gyroscope = Gyroscope::draw(&model, &mut rng);
    let sigma_dps = gyroscope.sample_sigma_dps(416.7);
    assert!((sigma_dps - 0.0722).abs() < 1e-4, "{sigma_dps}");
    for (sags, want) in [(false, sigma_dps), (true, 2.0 * sigma_dps)] {
        gyroscope.set_sag(sags);
        let noise: Vec<f64> = (0..40_000)
            .map(|_| gyroscope.feel([0.0; 3], LEVEL_G, sigma_dps, DT_S, &mut rng)[1])
            .collect();
        assert!((rms(&noise) / want - 1.0).abs() < 0.02, "{}", rms(&noise));
        let neighbours = noise.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / 40_000.0;
        assert!((neighbours / (want * want)).abs() < 0.02);
    }
}

#[test]
fn the_bias_walks_with_the_root_of_time() {
    for (dt_s, steps) in [(0.05, 8_000), (0.7, 572), (100.0, 4)] {
        let mut rng = rng();
        let mut ends = Vec::new();
        for _ in 0..300 {
            let mut gyroscope = only(GyroscopeTerm::Walk, &mut rng);
            for _ in 0..steps {
                gyroscope.feel([0.0; 3], LEVEL_G, 0.0, dt_s, &mut rng);
            }
            ends.extend(bias(&mut gyroscope));
        }
        let got = rms(&ends);
        assert!((got / (2e-5 * 20.0) - 1.0).abs() < 0.1, "{dt_s}: {got}");
    }
}

/// The Allan deviation of a record over `window` values, in the record's unit.
fn allan(record: &[f64], window: usize) -> f64 {
    let means: Vec<f64> = record
        .chunks_exact(window)
        .map(|chunk| chunk.iter().sum::<f64>() / window as f64)
        .collect();
    let steps: Vec<f64> = means.windows(2).map(|pair| pair[1] - pair[0]).collect();
    rms(&steps) / std::f64::consts::SQRT_2
}

#[test]
fn the_bias_instability_is_three_degrees_per_hour() {
    let mut rng = rng();
    let mut gyroscope = only(GyroscopeTerm::Flicker, &mut rng);
    let record: Vec<f64> = (0..200_000)
        .map(|_| gyroscope.feel([0.0; 3], LEVEL_G, 0.0, 0.1, &mut rng)[0] * 3600.0)
        .collect();
    for window_s in [3, 10, 30, 100] {
        let deviation = allan(&record, window_s * 10);
        assert!((2.2..3.8).contains(&deviation), "{window_s} s: {deviation}");
    }
}

#[test]
fn only_a_power_on_changes_the_turn_on_bias_and_ends_the_walk() {
    let mut rng = rng();
    let mut gyroscope = only(GyroscopeTerm::TurnOn, &mut rng);
    assert_eq!(bias(&mut gyroscope), [0.0; 3]);
    gyroscope.power_on(&mut rng);
    let first = bias(&mut gyroscope);
    gyroscope.set_die_temperature(60.0);
    assert_eq!(bias(&mut gyroscope), first);
    gyroscope.power_on(&mut rng);
    assert_ne!(bias(&mut gyroscope), first);

    let mut gyroscope = only(GyroscopeTerm::Walk, &mut rng);
    gyroscope.feel([0.0; 3], LEVEL_G, 0.0, 1000.0, &mut rng);
    assert_ne!(bias(&mut gyroscope), [0.0; 3]);
    gyroscope.power_on(&mut rng);
    assert_eq!(bias(&mut gyroscope), [0.0; 3]);
}

#[test]
fn a_gyroscope_is_mounted_as_the_accelerometer_of_its_die() {
    let mut rng = rng();
    let mut part = Part::draw(&ErrorModel::NOMINAL.only(Term::Mounting), &mut rng);
    let perfect = Gyroscope::draw(&GyroscopeModel::PERFECT, &mut rng);
    let mut gyroscope = perfect.mounted(part.mounting());
    let felt_g = part.feel([0.3, -0.4, 0.9], 0.0, DT_S, &mut rng);
    let felt_dps = quiet(&mut gyroscope, [30.0, -40.0, 90.0], LEVEL_G);
    let wrong = |i: usize| (felt_dps[i] - 100.0 * felt_g[i]).abs();
    assert!((0..3).all(|i| wrong(i) < 1e-9), "{felt_dps:?} {felt_g:?}");
    assert!((felt_dps[0] - 30.0).abs() > 0.01);
}

#[test]
fn switching_a_term_off_leaves_the_other_numbers() {
    let felt = |model: GyroscopeModel| {
        let mut gyroscope = Gyroscope::draw(&model, &mut rng());
        bias(&mut gyroscope)
    };
    let whole = felt(GyroscopeModel::NOMINAL.without(GyroscopeTerm::Flicker));
    assert_ne!(whole[0], 0.0);
    assert_eq!(
        felt(GyroscopeModel::NOMINAL.only(GyroscopeTerm::Bias)),
        whole
    );
    for term in GyroscopeTerm::ALL {
        let nominal = GyroscopeModel::NOMINAL;
        let without = nominal.without(term);
        assert_ne!(without, nominal, "{term:?}");
        assert_eq!(without.with(term, &nominal), nominal, "{term:?}");
        let perfect = nominal.only(term).without(term);
        assert_eq!(perfect, GyroscopeModel::PERFECT, "{term:?}");
    }
}

#[test]
fn draws_take_the_same_numbers_whichever_terms_are_off() {
    let after = |model: GyroscopeModel| {
        let mut rng = rng();
        let mut gyroscope = Gyroscope::draw(&model, &mut rng);
        gyroscope.power_on(&mut rng);
        for _ in 0..2000 {
            gyroscope.feel(TURN_DPS, LEVEL_G, 0.07, DT_S, &mut rng);
        }
        rng
    };
    let nominal = after(GyroscopeModel::NOMINAL);
    assert_eq!(after(GyroscopeModel::PERFECT), nominal);
    for term in GyroscopeTerm::ALL {
        assert_eq!(after(GyroscopeModel::NOMINAL.only(term)), nominal);
    }
}
