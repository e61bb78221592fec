//! The fit by hand: on sensors made up, and on units of the virtual bench.

use sim::bench::characterise::mean_of_both;
use sim::bench::person::Person;
use sim::bench::static_test::errors;
use sim::bench::{Bench, Mode, World};
use sim::motion::Mover;
use sim::rig::{Fixture, Mount};
use sim::rng::Rng;
use tilt::angle::Axes;
use tilt::chain::Correction;
use tilt::vector::Vector;

use super::*;

/// As many poses as the plan has at least.
const WANTED: usize = FEWEST as usize;

/// What points up in the housing's axes when a person was asked for this pose of the plan.
fn put(person: &mut Person, place: usize) -> [f64; 3] {
    let HandPose { words, up, .. } = &POSES[place];
    person.put(*up, words.contains("turned"))
}

/// A sensor with errors of every kind that nine parameters describe, turned in its housing.
fn feel(up: [f64; 3]) -> [f64; 3] {
    let (s, c) = 0.02f64.sin_cos();
    let about_z = [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]];
    let about_y = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]];
    let turned = times(&about_z, times(&about_y, up));
    let [x, y, z] = times(
        &[
            [1.02, 0.004, 0.0],
            [0.004, 0.98, -0.003],
            [0.0, -0.003, 1.01],
        ],
        turned,
    );
    [x + 0.02, y - 0.03, z + 0.04]
}

fn taken(person: &mut Person, poses: usize) -> Vec<Taken> {
    let one = |pose| Taken {
        pose,
        mean_g: feel(put(person, pose)),
    };
    (0..poses).map(one).collect()
}

#[test]
fn the_base_and_a_side_give_the_housings_frame() {
    let mut person = Person::new([0.4, -0.3], 8.0, 0.0, 1);
    let taken = taken(&mut person, WANTED);
    let (fits, faces) = fit(&[('A', taken.clone()), ('B', taken)], WANTED).unwrap();
    for up in [
        [0.0, 0.0, 1.0],
        [0.6, 0.0, 0.8],
        [0.0, -0.8, 0.6],
        [0.5, 0.5, 0.7],
    ] {
        let up = normal(up);
        for fit in &fits {
            let off = angle_deg(fit.apply(feel(up)), up);
            assert!(off < 1e-3, "{up:?}: {off}");
        }
    }
    assert!((faces.base_surface_deg - 0.5).abs() < 1e-3, "{faces:?}");
    assert!(faces.between_deg < 1e-6 && faces.off_square_deg.abs() < 1e-3);
    assert!(fits[0].condition < 30.0, "{}", fits[0].condition);
}

#[test]
fn what_the_poses_miss_is_known_once_there_are_more_than_parameters() {
    let mut taken = taken(&mut Person::new([0.0; 2], 5.0, 0.0, 1), WANTED);
    assert!(length_so_far_mg(&taken).unwrap() < 1e-3);
    // One of a pair: the thirteenth pose alone tells the angle of X to Y, and shows no error.
    taken[0].mean_g[2] += 0.002;
    let bumped = length_so_far_mg(&taken).unwrap();
    assert!(bumped > 0.1 && bumped < 2.0, "{bumped}");
    assert_eq!(length_so_far_mg(&taken[..9]), None);
}

#[test]
fn a_missing_pose_is_named() {
    let mut taken = taken(&mut Person::new([0.0; 2], 5.0, 0.0, 1), WANTED);
    taken.remove(7);
    let error = fit(&[('B', taken)], WANTED).unwrap_err();
    assert_eq!(error, HandError::Missing(vec![7]));
    assert!(error.to_string().contains("upside down"), "{error}");
}

#[test]
fn poses_that_never_lean_are_refused() {
    let mut person = Person::new([0.3, 0.2], 0.0, 0.0, 1);
    let flat = [0, 1, 2, 3, 4, 5, 6, 7, 7, 6, 5, 4, 0];
    let one = |(pose, stands): (usize, usize)| Taken {
        pose,
        mean_g: feel(put(&mut person, stands)),
    };
    let taken: Vec<_> = flat.into_iter().enumerate().map(one).collect();
    let error = fit(&[('B', taken)], WANTED).unwrap_err();
    assert!(
        matches!(error, HandError::IllConditioned('B', _)),
        "{error:?}"
    );
}

#[test]
fn what_was_bumped_and_what_stood_askew_is_named() {
    let mut bumped = taken(&mut Person::new([0.0; 2], 5.0, 0.0, 1), WANTED);
    bumped[9].mean_g[2] += 0.03;
    assert!(matches!(
        fit(&[('A', bumped)], WANTED),
        Err(HandError::Length('A', ..))
    ));
    let tilted = taken(&mut Person::new([3.0, 0.0], 5.0, 0.0, 1), WANTED);
    assert!(matches!(
        fit(&[('A', tilted)], WANTED),
        Err(HandError::Surface(0, _))
    ));
}

/// Takes the poses with a unit of the bench: a second to settle, two to measure.
fn take(bench: &mut Bench, person: &mut Person, poses: usize) -> [Vec<Taken>; 2] {
    let mut channels = [Vec::new(), Vec::new()];
    for pose in 0..poses {
        let mut fixture = Fixture::facing(put(person, pose));
        fixture.step(0.0);
        let means = mean_of_both(&mut bench.instrument, &mut fixture, 1.0, 2.0, "by hand");
        let sides = bench.instrument.sides.iter().zip(means.unwrap());
        for (taken, (side, mean)) in channels.iter_mut().zip(sides) {
            let model = &side.settings.chain.calibration.temperature;
            let mean_g = super::super::fit::compensated_g(model, mean.accel, mean.temperature);
            taken.push(Taken { pose, mean_g });
        }
    }
    channels
}

/// RMSE of each node at random angles, deg, both axes together.
fn static_rmse(bench: &mut Bench) -> [f64; 2] {
    bench.power_cycle();
    let mut squares = [0.0; 2];
    for mount in [Mount::X, Mount::Y] {
        bench.mount(mount, 0.0, 0.0);
        let angles = bench.random_angles(40, 90.0);
        let points = bench.static_test(mount, &angles);
        for (node, sum) in squares.iter_mut().enumerate() {
            *sum += errors(&points, node).rms().powi(2);
        }
    }
    squares.map(|sum| (sum / 2.0).sqrt())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn thirteen_hand_poses_come_within_a_factor_of_two_of_the_motor() {
    let (mut by_motor, mut by_hand) = (Vec::new(), Vec::new());
    for unit in 0..20 {
        let commissioned = Bench::commissioned(Mode::Product, &World::NOMINAL, 1, unit);
        let (mut bench, _) = commissioned.unwrap();
        by_motor.extend(static_rmse(&mut bench));
        let mut draw = Rng::stream(u64::from(unit), "surface");
        let surface = [draw.range(-0.5, 0.5), draw.range(-0.5, 0.5)];
        let mut person = Person::new(surface, 5.0, 2.0, u64::from(unit));
        let channels = take(&mut bench, &mut person, WANTED);
        let [a, b] = channels;
        let (fits, _) = fit(&[('A', a), ('B', b)], WANTED).unwrap();
        for (side, fit) in bench.instrument.sides.iter_mut().zip(fits) {
            let vector = Vector::from_real(fit.matrix, fit.offset_g).unwrap();
            let harmonics = Axes::default();
            side.settings.chain.calibration.correction = Correction::TwoAxis { vector, harmonics };
        }
        by_hand.extend(static_rmse(&mut bench));
    }
    let worst = by_hand.iter().copied().fold(0.0, f64::max);
    let (motor, hand) = (median(by_motor), median(by_hand));
    println!(
        "static RMSE at 25 degC, median of 20 units, 2 channels each: motor {motor:.4} deg, 13 \
         hand poses {hand:.4} deg, ratio {:.2}; worst channel by hand {worst:.4} deg",
        hand / motor
    );
    assert!(hand <= 2.0 * 0.04, "{hand}");
    assert!(hand <= 2.0 * motor, "{hand} {motor}");
}
