//! Tests of the bias over temperature, with gyroscopes whose errors are drawn.

use sim::rng::Rng;

use super::super::measured::{Begun, Felt};
use super::super::model::Model;
use super::super::profile::{Profile, Step};
use super::*;

const DEG: f64 = std::f64::consts::PI / 180.0;

/// The motor's tetrahedron.
const POSES: [[f64; 3]; 4] = [
    [0.816, 0.0, -0.577],
    [-0.816, 0.0, -0.577],
    [0.0, 0.816, 0.577],
    [0.0, -0.816, 0.577],
];

/// b0, b1 and b2 of each axis, deg/s: within what the fit takes as plausible.
const TRUE: [[f64; 3]; 3] = [[2.0, 0.02, 1e-4], [-1.0, -0.03, 0.0], [0.5, 0.0, -2e-4]];

fn empty(runs: u32) -> Measured {
    let stairs = [-10.0, 10.0, 30.0, 50.0, 70.0, 50.0, 30.0, 10.0, -10.0];
    let step = |temperature_degc| Step {
        temperature_degc,
        dwell_min: 40.0,
    };
    let begun = Begun {
        model: Model::Quadratic,
        chamber: "Maker,Model".to_owned(),
        turned_by: None,
        profile: Profile {
            runs,
            steps: stairs.map(step).to_vec(),
        },
        channels: Vec::new(),
    };
    Measured::new(begun, 0)
}

/// A run with `more` deg/s on top at a run, a step and a pose.
fn measured(runs: u32, mut more: impl FnMut(u32, usize, [f64; 3]) -> [f64; 3]) -> Measured {
    let mut measured = empty(runs);
    let places: Vec<_> = measured.begun.profile.places().collect();
    for (run, step) in places {
        let degc = measured.begun.profile.steps[step].temperature_degc;
        let d = degc - 25.0;
        let felt = |pose: &[f64; 3]| {
            let more = more(run, step, *pose);
            let rate = [0, 1, 2].map(|axis| {
                let [b0, b1, b2] = TRUE[axis];
                (b0 + b1 * d + b2 * d * d + more[axis]) * DEG
            });
            vec![Felt {
                accel_g: *pose,
                scatter_mg: 0.3,
                sensor_degc: degc,
                rate_rad_s: Some(rate),
            }]
        };
        measured.dwells.push(Dwelt {
            run,
            step,
            air_degc: None,
            minutes: 40.0,
            repeated: 0,
            orientations: POSES.iter().map(felt).collect(),
            turns: Vec::new(),
        });
    }
    measured
}

fn solved(measured: &Measured) -> Result<Found, NoBias> {
    bias(measured, 0, Some(&RateCorrection::IDENTITY)).unwrap()
}

/// What was found less what is true, and its standard uncertainty, deg/s.
fn errors(found: &Found) -> Vec<(f64, f64)> {
    let real = found.rates.real();
    let all = [real.bias, real.bias1, real.bias2];
    let mut errors = Vec::new();
    for (n, of) in all.iter().enumerate() {
        for axis in 0..3 {
            let u = found.uncertainty[axis][n] / DEG;
            errors.push((of[axis] / DEG - TRUE[axis][n], u));
        }
    }
    errors
}

/// Acceleration, earth, noise, and a bias that wanders from dwell to dwell.
fn drawn(seed: u64, wander: f64) -> Measured {
    let mut rng = Rng::stream(seed, "bias");
    let of_g = [(); 3].map(|()| rng.normals().map(|n| 0.02 * n));
    let earth = rng.direction().map(|share| share * EARTH_RATE / DEG);
    let mut dwell = ((0, usize::MAX), [0.0; 3]);
    measured(1, |run, step, pose| {
        if dwell.0 != (run, step) {
            dwell = ((run, step), rng.normals().map(|n| wander * n));
        }
        let noise = rng.normals().map(|n| 0.004 * n);
        [0, 1, 2].map(|axis| {
            let by_g: f64 = (0..3).map(|n| of_g[axis][n] * pose[n]).sum();
            dwell.1[axis] + by_g + earth[axis] + noise[axis]
        })
    })
}

#[test]
fn what_is_found_is_within_twice_its_uncertainty() {
    for wander in [0.0, 0.003, 0.02] {
        let (mut inside, mut all) = ([0.0; 3], 0.0);
        for seed in 0..200 {
            let found = solved(&drawn(seed, wander)).unwrap();
            let errors = errors(&found);
            for (share, errors) in inside.iter_mut().zip(errors.chunks(3)) {
                let within = |(error, u): &&(f64, f64)| error.abs() <= 2.0 * u;
                *share += errors.iter().filter(within).count() as f64;
            }
            all += 3.0;
        }
        // The resolution of the chip's numbers is part of the error too.
        let shares = inside.map(|inside| inside / all);
        // Of six degrees of freedom t is 2.45: k = 2 then covers 91 %.
        assert!(
            shares.iter().all(|share| *share > 0.9),
            "{wander}: {shares:?}"
        );
    }
}

#[test]
fn acceleration_cancels_in_the_mean_and_shows_in_the_residual() {
    let found = solved(&measured(1, |_, _, [x, _, z]| [0.05 * z, 0.0, 0.02 * x])).unwrap();
    for (error, _) in errors(&found) {
        assert!(error.abs() < 0.001, "{error}");
    }
    assert!((0.01..0.05).contains(&found.residual_deg_s));
    let [x, y, _] = found.uncertainty.map(|[b0, _, _]| b0 / DEG);
    assert!(x > 0.01 && y < 0.003, "{x} {y}");
    assert_eq!((found.rests, found.left_out), (36, 0));
    let none = found.hysteresis_deg_s.unwrap();
    assert!(none.iter().all(|half| *half < 1e-6) && found.between_runs_deg_s.is_none());
}

#[test]
fn a_branch_and_a_run_that_differ_are_told_and_make_it_less_certain() {
    let certain = solved(&measured(2, |_, _, _| [0.0; 3])).unwrap();
    let branch = |_, step: usize, _| [if step > 4 { 0.1 } else { 0.0 }, 0.0, 0.0];
    let found = solved(&measured(2, branch)).unwrap();
    let [x, y, _] = found.hysteresis_deg_s.unwrap();
    assert!((x - 0.05).abs() < 0.005 && y < 1e-6, "{x} {y}");
    assert!(found.uncertainty[0][0] > 2.0 * certain.uncertainty[0][0]);
    // A bias that has wandered by 0.1 deg/s on an axis from run to run.
    let run = |run: u32, _, _| [0.0, 0.1 * f64::from(run), 0.0];
    let found = solved(&measured(2, run)).unwrap();
    let between = found.between_runs_deg_s.unwrap();
    assert!((between - 0.1 / 3f64.sqrt()).abs() < 0.001, "{between}");
    assert!(found.uncertainty[1][0] > 2.0 * certain.uncertainty[1][0]);
}

#[test]
fn a_dwell_that_was_not_followed_whole_is_left_out_and_a_temperature_without_one_is_refused() {
    let mut measured = measured(1, |_, _, _| [0.0; 3]);
    measured.dwells[8].orientations[2][0].rate_rad_s = None;
    let found = solved(&measured).unwrap();
    assert_eq!((found.rests, found.left_out), (32, 4));
    measured.dwells[0].orientations[0][0].rate_rad_s = None;
    assert_eq!(solved(&measured).unwrap_err(), NoBias::Unfollowed(-10.0));
}

#[test]
fn without_gains_it_stays_and_without_a_gyroscope_nothing_is_told() {
    let mut measured = measured(1, |_, _, _| [0.0; 3]);
    let refused = bias(&measured, 0, None).unwrap();
    assert_eq!(refused.unwrap_err(), NoBias::Uncalibrated);
    let felt = measured.dwells.iter_mut().flat_map(|d| &mut d.orientations);
    felt.flatten().for_each(|felt| felt.rate_rad_s = None);
    assert!(bias(&measured, 0, None).is_none());
    // A gyroscope that was never followed is one nevertheless.
    assert_eq!(solved(&measured).unwrap_err(), NoBias::Unfollowed(-10.0));
}

#[test]
fn too_few_dwells_are_refused() {
    let mut measured = measured(1, |_, _, _| [0.0; 3]);
    measured.dwells.truncate(3);
    measured.begun.profile.steps.truncate(3);
    let refused = solved(&measured).unwrap_err();
    assert_eq!(refused, NoBias::Fit(FitError::TooFew { have: 3, need: 4 }));
}
