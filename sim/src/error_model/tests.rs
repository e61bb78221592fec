//! Statistics of drawn parts, each term alone, and how temperature, power and sags act.

use super::*;
use crate::rng::Rng;

const G: f64 = 1e-3;
const LEVEL: [f64; 3] = [0.0, 0.0, 1.0];

fn rng() -> Rng {
    Rng::stream(1, "error model")
}

/// What a part measures at once, without white noise.
fn quiet(part: &mut Part, force_g: [f64; 3]) -> [f64; 3] {
    part.feel(force_g, 0.0, 1e-9, &mut Rng::stream(0, "quiet"))
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// 4000 draws of `figure` from parts that have one term only.
fn draws(term: Term, mut figure: impl FnMut(&mut Part, &mut Rng) -> f64) -> Vec<f64> {
    let (mut rng, model) = (rng(), ErrorModel::NOMINAL.only(term));
    (0..4000)
        .map(|_| figure(&mut Part::draw(&model, &mut rng), &mut rng))
        .collect()
}

fn assert_sigma(term: Term, want: f64, figure: impl FnMut(&mut Part, &mut Rng) -> f64) {
    let values = draws(term, figure);
    let got = rms(&values);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    assert!(
        (got / want - 1.0).abs() < 0.1,
        "{term:?}: {got} instead of {want}"
    );
    assert!(mean.abs() < 0.1 * want, "{term:?}: mean {mean}");
}

#[test]
fn a_perfect_part_adds_nothing() {
    let mut rng = rng();
    let mut part = Part::draw(&ErrorModel::PERFECT, &mut rng);
    part.power_on(&mut rng);
    part.set_sag(true);
    for die_c in [-10.0, 25.0, 70.0, 40.0] {
        part.set_die_temperature(die_c);
        for force in [LEVEL, [0.3, -0.4, 0.5], [-2.0, 1.0, 0.0]] {
            assert_eq!(part.feel(force, 0.002, 0.0025, &mut rng), force);
        }
        assert_eq!(part.thermometer(&mut rng), die_c);
    }
    assert!(part.clock_factor() == 1.0 && !part.quantises());
}

#[test]
fn offsets_have_their_sigma() {
    assert_sigma(Term::Bias, 20.0 * G, |part, _| quiet(part, [0.0; 3])[0]);
    assert_sigma(Term::Tco, 0.2 * 40.0 * G, |part, _| {
        part.set_die_temperature(65.0);
        quiet(part, [0.0; 3])[1]
    });
    assert_sigma(Term::Curvature, 0.8e-6 * 1225.0, |part, _| {
        part.set_die_temperature(-10.0);
        quiet(part, [0.0; 3])[2]
    });
    assert_sigma(Term::TurnOn, 0.3 * G, |part, rng| {
        part.power_on(rng);
        quiet(part, [0.0; 3])[0]
    });
    assert_sigma(Term::Flicker, 40e-6, |part, _| quiet(part, [0.0; 3])[0]);
}

#[test]
fn gains_and_angles_have_their_sigma() {
    assert_sigma(Term::Scale, 0.01, |part, _| quiet(part, LEVEL)[2] - 1.0);
    assert_sigma(Term::ScaleOverTemperature, 1e-4 * 45.0, |part, _| {
        part.set_die_temperature(70.0);
        quiet(part, LEVEL)[2] - 1.0
    });
    let deg = |force: f64| force.to_degrees();
    assert_sigma(Term::NonOrthogonality, 0.5, |part, _| {
        deg(quiet(part, LEVEL)[0])
    });
    assert_sigma(Term::NonOrthogonality, 0.5, |part, _| {
        deg(quiet(part, [1.0, 0.0, 0.0])[1])
    });
    assert_sigma(Term::Mounting, 1.0, |part, _| deg(quiet(part, LEVEL)[1]));
    assert_sigma(Term::Mounting, 1.0, |part, _| {
        deg(quiet(part, [0.0, 1.0, 0.0])[0])
    });
}

#[test]
fn nonlinearities_have_their_sigma_and_their_power() {
    for (term, parity) in [(Term::Quadratic, 1.0), (Term::Cubic, -1.0)] {
        assert_sigma(term, 1.0 * G, |part, _| quiet(part, LEVEL)[2] - 1.0);
        assert!(
            draws(term, |part, _| {
                let up = quiet(part, [1.0, 0.0, 0.0])[0] - 1.0;
                let down = quiet(part, [-1.0, 0.0, 0.0])[0] + 1.0;
                let half = quiet(part, [0.5, 0.0, 0.0])[0] - 0.5;
                let power = if parity > 0.0 { 4.0 } else { 8.0 };
                (down - parity * up).abs() + (half * power - up).abs()
            })
            .iter()
            .all(|wrong| *wrong < 1e-12)
        );
    }
}

#[test]
fn the_clock_is_uniform_within_three_percent() {
    let values = draws(Term::Clock, |part, _| part.clock_factor() - 1.0);
    assert!(values.iter().all(|v| v.abs() <= 0.03));
    assert!(values.iter().any(|v| v.abs() > 0.0295));
    assert!((rms(&values) - 0.03 / 3f64.sqrt()).abs() < 1e-3);
}

#[test]
fn the_thermometer_has_its_offset_gain_and_noise() {
    assert_sigma(Term::ThermometerOffset, 5.0, |part, rng| {
        part.thermometer(rng) - 25.0
    });
    assert_sigma(Term::ThermometerNoise, 0.1, |part, rng| {
        part.thermometer(rng) - 25.0
    });
    assert_sigma(Term::ThermometerGain, 0.02 * 40.0, |part, rng| {
        part.set_die_temperature(65.0);
        part.thermometer(rng) - 65.0
    });
}

#[test]
fn white_noise_is_that_of_the_mode() {
    let mut rng = rng();
    let mut part = Part::draw(&ErrorModel::NOMINAL.only(Term::WhiteNoise), &mut rng);
    let noise: Vec<f64> = (0..40_000)
        .map(|_| part.feel([0.0; 3], 0.00127, 0.0025, &mut rng)[1])
        .collect();
    assert!((rms(&noise) / 0.00127 - 1.0).abs() < 0.02);
    let neighbours: f64 = noise.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
    assert!((neighbours / 40_000.0 / 0.00127f64.powi(2)).abs() < 0.02);
}

/// Offset of x along a path of temperatures in steps of 0.5 degC, mg.
fn along(part: &mut Part, stops: &[f64]) -> Vec<f64> {
    let mut out = Vec::new();
    for stop in stops {
        while (part.die_c() - stop).abs() > 0.01 {
            let next = part.die_c() + 0.5 * (stop - part.die_c()).signum();
            part.set_die_temperature(next);
        }
        out.push(quiet(part, [0.0; 3])[0] / G);
    }
    out
}

#[test]
fn the_hysteresis_loop_closes_at_its_ends_and_repeats() {
    let model = ErrorModel::NOMINAL.only(Term::Hysteresis);
    let mut part = Part::draw(&model, &mut rng());
    assert_eq!(quiet(&mut part, [0.0; 3]), [0.0; 3]);
    let stops = [-10.0, 30.0, 70.0, 30.0, -10.0];
    let first = along(&mut part, &stops);
    let second = along(&mut part, &stops);
    assert_eq!(first, second);
    assert!(
        [first[0], first[2], first[4]]
            .iter()
            .all(|end| end.abs() < 1e-12),
        "{first:?}"
    );
    assert!(
        first[1].abs() > 0.0 && (first[1] + first[3]).abs() < 1e-12,
        "{first:?}"
    );
}

#[test]
fn reversing_by_ten_degrees_leads_to_the_middle_of_the_loop() {
    let model = ErrorModel::NOMINAL.only(Term::Hysteresis);
    let mut part = Part::draw(&model, &mut rng());
    let [down, middle] = along(&mut part, &[-10.0, 35.0, 25.0])[1..] else {
        panic!()
    };
    assert!(down.abs() > 0.0 && middle.abs() < 1e-12, "{down} {middle}");
}

#[test]
fn the_half_loop_has_its_sigma_and_grows_with_the_pessimistic_columns() {
    let half = |part: &mut Part, _: &mut Rng| along(part, &[-10.0, 30.0])[1] * G;
    assert_sigma(Term::Hysteresis, 0.5 * G, half);
    let column = ErrorModel::pessimistic(3.0, 6.0);
    assert!((column.hysteresis_mg - 1.5).abs() < 1e-12 && (column.turn_on_mg - 1.8).abs() < 1e-12);
    assert_eq!(
        ErrorModel {
            hysteresis_mg: 0.5,
            turn_on_mg: 0.3,
            ..column
        },
        ErrorModel::NOMINAL
    );
}

#[test]
fn only_a_power_on_changes_the_turn_on_offset() {
    let mut rng = rng();
    let mut part = Part::draw(&ErrorModel::NOMINAL.only(Term::TurnOn), &mut rng);
    assert_eq!(quiet(&mut part, [0.0; 3]), [0.0; 3]);
    part.power_on(&mut rng);
    let first = quiet(&mut part, [0.0; 3]);
    part.set_die_temperature(60.0);
    assert_eq!(quiet(&mut part, [0.0; 3]), first);
    part.power_on(&mut rng);
    assert_ne!(quiet(&mut part, [0.0; 3]), first);
}

#[test]
fn a_sag_doubles_the_noise_and_wanders_by_12_mg_until_it_ends() {
    let (mut rng, sigma) = (rng(), 0.00127);
    let mut part = Part::draw(&ErrorModel::NOMINAL.only(Term::SagWander), &mut rng);
    part.set_sag(true);
    // Starts where the offset was: after one sample the wander is still small.
    assert!(rms(&part.feel([0.0; 3], sigma, 0.0025, &mut rng)) < 0.004);
    let wander: Vec<f64> = (0..400_000)
        .map(|_| part.feel([0.0; 3], sigma, 0.0025, &mut rng)[0])
        .collect();
    assert!((rms(&wander) / 0.012 - 1.0).abs() < 0.1, "{}", rms(&wander));
    part.set_sag(true);
    assert!((part.feel([0.0; 3], 0.0, 1e-9, &mut rng)[0] - wander[399_999]).abs() < 0.003);
    part.set_sag(false);
    assert_eq!(part.feel([0.0; 3], sigma, 0.0025, &mut rng), [0.0; 3]);

    let model = ErrorModel {
        white_noise: 1.0,
        ..ErrorModel::NOMINAL.only(Term::SagNoise)
    };
    let mut part = Part::draw(&model, &mut rng);
    part.set_sag(true);
    let noise: Vec<f64> = (0..20_000)
        .map(|_| part.feel([0.0; 3], sigma, 0.0025, &mut rng)[0])
        .collect();
    assert!(
        (rms(&noise) / (2.0 * sigma) - 1.0).abs() < 0.03,
        "{}",
        rms(&noise)
    );
}

#[test]
fn switching_a_term_off_leaves_the_other_numbers_of_a_part() {
    let felt = |model: ErrorModel| quiet(&mut Part::draw(&model, &mut rng()), [0.0; 3]);
    let whole = felt(ErrorModel::NOMINAL.without(Term::Flicker));
    assert_ne!(whole[0], 0.0);
    assert_eq!(felt(ErrorModel::NOMINAL.only(Term::Bias)), whole);
    for term in Term::ALL {
        let without = ErrorModel::NOMINAL.without(term);
        assert_ne!(without, ErrorModel::NOMINAL, "{term:?}");
        assert_eq!(
            without.with(term, &ErrorModel::NOMINAL),
            ErrorModel::NOMINAL,
            "{term:?}"
        );
        assert_eq!(
            ErrorModel::NOMINAL.only(term).without(term),
            ErrorModel::PERFECT,
            "{term:?}"
        );
    }
}

#[test]
fn one_seed_gives_the_same_part_and_the_same_samples() {
    let run = |seed| {
        let mut rng = Rng::stream(seed, "part");
        let mut part = Part::draw(&ErrorModel::NOMINAL, &mut rng);
        part.power_on(&mut rng);
        (0..5000)
            .map(|_| part.feel(LEVEL, 0.001, 0.0025, &mut rng).map(f64::to_bits))
            .collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}
