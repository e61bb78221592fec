//! Gyroscopes of simulated parts against what these do to a known rate, and an axis that moves.

use tilt::calibration::gyroscope::TurnSum;

use super::*;
use crate::held::Held;

/// From pose to pose, pitch and roll.
const WAY: [(f64, f64); 18] = [
    (0.0, 0.0),
    (0.0, 90.0),
    (0.0, -90.0),
    (90.0, 0.0),
    (-90.0, 0.0),
    (0.0, 90.0),
    (90.0, 0.0),
    (0.0, 0.0),
    (0.0, 180.0),
    (0.0, 45.0),
    (45.0, 0.0),
    (-45.0, 0.0),
    (0.0, -45.0),
    (40.0, 40.0),
    (40.0, -40.0),
    (-40.0, -40.0),
    (-40.0, 40.0),
    (0.0, 0.0),
];

fn demand() -> Demand {
    Demand {
        vertical_deg: 0.03,
        fewest: 8,
        shown: [true; 3],
    }
}

/// Of 24 gyroscopes; the gains of one are not independent of each other.
#[test]
fn true_gains_of_simulated_gyroscopes_are_within_what_is_stated() {
    let (mut within, mut all, mut worst, mut largest) = (0, 0, 0.0_f64, 0.0_f64);
    for seed in 1..=12 {
        let mut held = Held::new(seed, 15);
        let calibrations = held.accelerometers();
        for (pitch, roll) in WAY {
            held.rest(pitch, roll);
        }
        let outcomes = [0, 1].map(|node| {
            let rests: Vec<Rest> = held.rests.iter().map(|rest| rest[node].clone()).collect();
            let period_s = f64::from(held.instrument.sides[node].node.channel.period_q8()) / 256e6;
            solve(
                &calibrations[node],
                period_s,
                &held.logs[node],
                &rests,
                &demand(),
            )
        });
        let truths = held.truth();
        for (outcome, truth) in outcomes.iter().zip(truths) {
            let Found { gains, .. } = outcome.found.as_ref().unwrap();
            let pairs = gains.gains.iter().flatten().zip(truth.iter().flatten());
            for ((found, truth), u) in pairs.zip(gains.uncertainty.iter().flatten()) {
                let error = (found - truth).abs();
                within += usize::from(error <= 2.0 * u);
                all += 1;
                worst = worst.max(error / u);
                largest = largest.max(error);
            }
        }
    }
    let share = f64::from(within as u32) / f64::from(all);
    println!(
        "{all} gains: {:.1} % within U (k = 2), worst {worst:.1} u, largest error {:.2} %",
        100.0 * share,
        100.0 * largest
    );
    assert!(share >= 0.9, "{share}");
    assert!(worst < 5.0, "{worst}");
    assert!(largest < 0.006, "{largest}");
}

#[test]
fn samples_lost_leave_a_turn_out_and_too_few_turns_leave_the_gyroscope() {
    let mut held = Held::new(1, 15);
    let calibrations = held.accelerometers();
    for (place, (pitch, roll)) in WAY.into_iter().enumerate() {
        // Nobody looks for 0.3 s where the housing turns.
        held.look_ms = if place == 3 { 300 } else { 15 };
        held.rest(pitch, roll);
        held.look_ms = 15;
    }
    let solved =
        |rests: Vec<Rest>| solve(&calibrations[0], 0.0024, &held.logs[0], &rests, &demand());
    let mut rests: Vec<Rest> = held.rests.iter().map(|rest| rest[0].clone()).collect();
    let outcome = solved(rests.clone());
    let unfollowed =
        |(_, reason): &&(usize, BadTurn)| *reason == BadTurn::Spoilt(Spoilt::Unfollowed);
    let lost: Vec<usize> = outcome
        .bad
        .iter()
        .filter(unfollowed)
        .map(|(n, _)| *n)
        .collect();
    // At its own rest nobody looked for 0.3 s either, which leaves the mean of a small rate.
    assert_eq!(lost, [3]);
    assert!(outcome.found.is_ok());
    for rest in &mut rests[9..] {
        rest.gaps += 1;
    }
    assert_eq!(
        solved(rests.clone()).bad.last(),
        Some(&(9, BadTurn::Spoilt(Spoilt::Gap)))
    );
    for (number, rest) in rests.iter_mut().enumerate() {
        rest.gaps = number as u16;
    }
    let refused = solved(rests).found.unwrap_err().to_string();
    assert!(
        refused.contains("0 of its turns can be used and 8 are needed"),
        "{refused}"
    );
    assert!(refused.contains("missed samples"), "{refused}");
}

#[test]
fn two_axes_exchanged_and_a_gyroscope_that_stands_still_are_refused() {
    let mut held = Held::new(2, 15);
    let calibrations = held.accelerometers();
    for (pitch, roll) in WAY {
        held.rest(pitch, roll);
    }
    let rests: Vec<Rest> = held.rests.iter().map(|rest| rest[0].clone()).collect();
    let refused = |change: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let log = held.logs[0].changed(change);
        let outcome = solve(&calibrations[0], 0.0024, &log, &rests, &demand());
        outcome.found.map(|found| found.gains.gains)
    };
    assert!(refused(&|sum| sum).is_ok());
    for change in [
        (|[x, y, z]| [y, x, z]) as fn([f64; 3]) -> [f64; 3],
        |[x, y, z]| [-x, y, z],
        |[_, y, z]| [0.0, y, z],
        |[x, y, z]| [0.7 * x, y, z],
        |_| [0.0; 3],
    ] {
        let told = refused(&change);
        assert!(told.is_err(), "{told:?}");
    }
}

/// What is left of a turn of 2 s about an axis that itself turns, deg, with looks so far apart: as
/// it is, and with each look's integral taken as the rotation.
fn coning_deg(look_ms: u32) -> [f64; 2] {
    let rate_rad_s = 120f64.to_radians();
    let rate = |t: f64| {
        let (sin, cos) = (rate_rad_s * t).sin_cos();
        [rate_rad_s * cos, rate_rad_s * sin, 0.0]
    };
    let turned = |rotations: &[([f64; 3], f64)]| {
        let mut sum = TurnSum::new([0.6, 0.0, 0.8], identity());
        for (rotation, dt_s) in rotations {
            sum.sample(rotation.map(|a| a / dt_s), *dt_s);
        }
        sum.expected()
    };
    // 0.1 ms is fine enough for the truth.
    let fine = |n: u32| (rate((f64::from(n) + 0.5) * 1e-4).map(|r| r * 1e-4), 1e-4);
    let truth = turned(&(0..20_000).map(fine).collect::<Vec<_>>());
    let steps: Vec<Step> = (0..2000 / look_ms)
        .map(|look| {
            let mut sum = [0.0; 3];
            for n in 0..10 * look_ms {
                let r = rate((f64::from(look * look_ms * 10 + n) + 0.5) * 1e-4);
                // In samples of 1 ms.
                sum = [0, 1, 2].map(|axis| sum[axis] + r[axis] / 10.0);
            }
            let samples = look_ms as u16;
            Step { samples, sum }
        })
        .collect();
    let with = rotations(&steps, [0.0; 3], 1e-3);
    let plain = |step: &Step| {
        let dt_s = f64::from(step.samples) * 1e-3;
        (step.sum.map(|sum| sum * 1e-3), dt_s)
    };
    let without: Vec<_> = steps.iter().map(plain).collect();
    [with, without].map(|rotations| angle_deg(turned(&rotations), truth))
}

fn identity() -> [[f64; 3]; 3] {
    RateCorrection::IDENTITY.real().matrix
}

#[test]
fn an_axis_that_moves_between_two_looks_costs_little() {
    for (look_ms, with_deg, without_deg) in [(10, 0.0002, 0.002), (50, 0.005, 0.05)] {
        let [with, without] = coning_deg(look_ms);
        println!("looks {look_ms} ms apart leave {with:.5} deg, uncorrected {without:.4} deg");
        assert!(with < with_deg && without < without_deg && with < without / 10.0);
    }
}

#[test]
fn slopes_over_temperature_and_what_is_open_are_kept() {
    let mut held = Held::new(3, 15);
    let calibrations = held.accelerometers();
    let about_x: Vec<f64> = vec![0.0, 90.0, -90.0, 45.0, -45.0, 90.0, 0.0, -90.0, 90.0, 0.0];
    for roll in &about_x {
        held.rest(0.0, *roll);
    }
    for pitch in &about_x {
        held.rest(*pitch, 0.0);
    }
    let mut before = RateCorrection::IDENTITY.real();
    for row in &mut before.matrix {
        row[2] += 0.012_5;
    }
    before.bias1 = [1e-5; 3];
    before.scale1 = [1e-4; 3];
    let calibration = Calibration {
        rates: RateCorrection::from_real(&before),
        ..calibrations[0].clone()
    };
    let mut rests: Vec<Rest> = held.rests.iter().map(|rest| rest[0].clone()).collect();
    for rest in &mut rests {
        rest.reading.temperature_c = 25.0;
    }
    let solved = |rests: &[Rest], shown| {
        let demand = Demand { shown, ..demand() };
        solve(&calibration, 0.0024, &held.logs[0], rests, &demand).found
    };
    let at_25 = solved(&rests, [true, true, false]).unwrap();
    assert_eq!(at_25.open, [false, false, true]);
    for row in 0..3 {
        let kept = at_25.rates.real().matrix[row][2] - before.matrix[row][2];
        assert!(kept.abs() < 0.003, "{kept}");
    }
    let open = solved(&rests, [true; 3]).unwrap_err().to_string();
    assert!(open.contains("about axis z show too little"), "{open}");
    for rest in &mut rests {
        rest.reading.temperature_c = 35.0;
    }
    let at_35 = solved(&rests, [true, true, false]).unwrap().rates.real();
    let at_25 = at_25.rates.real();
    assert_eq!((at_35.bias1, at_35.scale1), (at_25.bias1, at_25.scale1));
    let moved = [0, 1, 2].map(|axis| at_25.bias[axis] - at_35.bias[axis]);
    assert!(
        moved.iter().all(|moved| (moved - 1e-4).abs() < 1e-7),
        "{moved:?}"
    );
    let scaled = at_25.matrix[0][0] / at_35.matrix[0][0];
    assert!((scaled - 1.001).abs() < 2e-4, "{scaled}");
}
