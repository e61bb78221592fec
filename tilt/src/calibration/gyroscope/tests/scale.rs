//! The scale over temperature, by turns of a motor in a chamber, of sensors drawn from a seed.

use super::*;
use crate::calibration::gyroscope::with_slopes;
use crate::rate::RateCorrection;

/// Up the stairs and down again, degC.
const STAIRS: [f64; 9] = [-10.0, 10.0, 30.0, 50.0, 70.0, 50.0, 30.0, 10.0, -10.0];

/// A gyroscope with its scale over temperature.
#[derive(Clone, Copy)]
struct Part {
    gains: [[f64; 3]; 3],
    slopes: [f64; 3],
}

impl Part {
    fn drawn(dice: &mut Dice) -> Self {
        Self {
            gains: dice.drawn(0.01, 1.0 * RAD),
            slopes: dice.vector(7e-5),
        }
    }

    /// M diag(1 + s d).
    fn at(&self, celsius: f64) -> [[f64; 3]; 3] {
        let scale = self.slopes.map(|s| 1.0 + s * (celsius - 25.0));
        self.gains
            .map(|row| core::array::from_fn(|j| row[j] * scale[j]))
    }
}

/// From rest to rest about `axis`, as a motor goes through a tetrahedron.
fn about(axis: [f64; 3], up: &mut [f64; 3], angles: &[f64]) -> Vec<Truth> {
    let turn = |angle: &f64| {
        let turn = motor(*up, axis, *angle);
        *up = turn.after;
        turn
    };
    angles.iter().map(turn).collect()
}

/// Turns about x and y only.
fn flat() -> Vec<Truth> {
    let mut up = Z;
    let mut turns = about(X, &mut up, &[125.3, -250.6, 125.3]);
    turns.extend(about(Y, &mut up, &[54.7, -109.4, 54.7]));
    turns
}

/// The same, and on each axis with the other one tilted by 54.7 deg.
fn tilted() -> Vec<Truth> {
    let mut turns = flat();
    let (sin, cos) = (54.7 * RAD).sin_cos();
    for (tilt, axis) in [(X, [0.0, cos, -sin]), (Y, [cos, 0.0, sin])] {
        let mut up = turned(Z, tilt, 54.7 * RAD);
        turns.extend(about(axis, &mut up, &[-35.0, 70.0, -35.0]));
    }
    turns
}

/// The fit of turns that begin near `near`, each with its temperature.
fn fit(near: Part, turns: &[(Measured, f64)]) -> ScaleFit {
    let mut fit = ScaleFit::near(near.gains, near.slopes, ACCURACY);
    for (turn, celsius) in turns {
        let turn = summed(turn, near.gains).unwrap();
        fit.add(&turn, Temperature((celsius * 256.0) as i32));
    }
    fit
}

/// What a part measures in a chamber that goes up and down the stairs.
fn run(
    part: Part,
    turns: &[Truth],
    mut measure: impl FnMut(&[Truth], [[f64; 3]; 3]) -> Vec<Measured>,
) -> Vec<(Measured, f64)> {
    let mut all = Vec::new();
    for celsius in STAIRS {
        let measured = measure(turns, part.at(celsius));
        all.extend(measured.into_iter().map(|turn| (turn, celsius)));
    }
    all
}

const NOMINAL: Part = Part {
    gains: ONE,
    slopes: [0.0; 3],
};

#[test]
fn slopes_are_within_their_uncertainty_whether_the_part_was_calibrated_or_not() {
    for (calibrated, named, largest) in [(false, "nominal", 1.7e-5), (true, "calibrated", 1e-5)] {
        let (mut inside, mut all, mut worst) = (0, 0, [0.0f64; 3]);
        let mut stated = [0.0f64; 3];
        for seed in 0..100 {
            let mut dice = Dice::new(2000 + seed);
            let part = Part::drawn(&mut dice);
            let turns = run(part, &tilted(), |t, gains| noisy(&mut dice, t, gains));
            let gains = if calibrated { part.gains } else { ONE };
            let near = Part { gains, ..NOMINAL };
            let fitted = fit(near, &turns).solve().unwrap();
            for axis in 0..3 {
                let error = (fitted.slopes[axis] - part.slopes[axis]).abs();
                inside += u32::from(error <= 2.0 * fitted.uncertainty[axis]);
                all += 1;
                worst[axis] = worst[axis].max(error);
                stated[axis] = stated[axis].max(fitted.uncertainty[axis]);
            }
            assert!(
                fitted.residual_rms_deg < 0.06,
                "{}",
                fitted.residual_rms_deg
            );
        }
        let share = f64::from(inside) / f64::from(all);
        let at_70 = |s: [f64; 3]| s.map(|s| 100.0 * s * 45.0);
        std::println!(
            "{named}: {:.1} % within 2 u; at 70 degC u {:.3?} %, largest error {:.3?} %",
            100.0 * share,
            at_70(stated),
            at_70(worst)
        );
        assert!(share > 0.94, "{share}");
        assert!(stated.iter().all(|u| *u < largest), "{stated:?}");
    }
}

#[test]
fn gains_off_by_3_per_cent_and_2_deg_cost_a_few_per_cent_of_a_slope() {
    let mut worst = 0.0f64;
    for seed in 0..40 {
        let mut dice = Dice::new(seed);
        let part = Part {
            gains: dice.sensor(0.03, 2.0),
            slopes: [1e-4, -1e-4, 1e-4],
        };
        let fitted = fit(NOMINAL, &run(part, &tilted(), measured))
            .solve()
            .unwrap();
        for (found, slope) in fitted.slopes.iter().zip(part.slopes) {
            worst = worst.max((found / slope - 1.0).abs());
        }
    }
    std::println!("largest error {:.1} % of a slope", 100.0 * worst);
    assert!(worst < 0.08, "{worst}");
}

#[test]
fn an_axis_that_is_not_turned_about_keeps_the_slope_of_before() {
    let mut dice = Dice::new(7);
    let part = Part {
        gains: dice.drawn(0.005, 0.3 * RAD),
        slopes: [8e-5, -6e-5, 9e-5],
    };
    let turns = run(part, &flat(), |t, gains| noisy(&mut dice, t, gains));
    let before = Part {
        slopes: [2e-5, 2e-5, -4e-5],
        ..NOMINAL
    };
    let fitted = fit(before, &turns).solve().unwrap();
    let [x, y, z] = fitted.uncertainty;
    assert!(x < 1e-5 && y < 1e-5, "{x} {y}");
    assert!(z > 0.95 * SLOPE_PRIOR, "{z}");
    assert!((fitted.slopes[0] - 8e-5).abs() < 3.0 * x);
    assert!((fitted.slopes[1] + 6e-5).abs() < 3.0 * y);
    assert!((fitted.slopes[2] + 4e-5).abs() < 1e-5, "{fitted:?}");
}

#[test]
fn turns_of_one_temperature_show_no_slope() {
    let part = Part {
        gains: ONE,
        slopes: [1e-4; 3],
    };
    let turns: Vec<_> = run(part, &tilted(), measured)
        .into_iter()
        .filter(|(_, celsius)| *celsius == 70.0)
        .collect();
    let fitted = fit(NOMINAL, &turns).solve().unwrap();
    for (slope, u) in fitted.slopes.iter().zip(fitted.uncertainty) {
        assert!(u > 0.9 * SLOPE_PRIOR && slope.abs() < 3e-5, "{fitted:?}");
    }
}

#[test]
fn turns_that_contradict_each_other_are_refused_or_make_it_less_certain() {
    let part = Part {
        gains: ONE,
        slopes: [5e-5; 3],
    };
    // A sensor that has come loose: its ends are about so far off, each its own way.
    let off = |deg: f64| {
        let mut dice = Dice::new(4);
        let mut turns = run(part, &tilted(), measured);
        for (turn, _) in &mut turns {
            let error = dice.vector(deg * RAD);
            turn.after = unit(core::array::from_fn(|i| turn.after[i] + error[i]));
        }
        fit(NOMINAL, &turns).solve()
    };
    assert_eq!(off(4.0), Err(FitError::Implausible));
    let (certain, loose) = (off(0.0).unwrap(), off(0.5).unwrap());
    for (loose, certain) in loose.uncertainty.iter().zip(certain.uncertainty) {
        assert!(*loose > 4.0 * certain, "{loose} {certain}");
    }
}

#[test]
fn too_few_turns_steep_slopes_and_what_is_no_number_are_refused() {
    let part = |slope: f64| Part {
        gains: ONE,
        slopes: [0.0, slope, 0.0],
    };
    let turns = run(part(0.0), &tilted(), measured);
    let need = FEWEST_SCALE_TURNS;
    let few = fit(NOMINAL, &turns[..need - 1]).solve();
    let have = need - 1;
    assert_eq!(few, Err(FitError::TooFew { have, need }));
    assert!(fit(NOMINAL, &turns[..need]).solve().is_ok());
    let steep = run(part(1e-3), &tilted(), measured);
    assert_eq!(fit(NOMINAL, &steep).solve(), Err(FitError::Implausible));
    let mut none = ScaleFit::near(ONE, [f64::NAN; 3], ACCURACY);
    for (turn, _) in &turns {
        none.add(&summed(turn, ONE).unwrap(), Temperature::REFERENCE);
    }
    let refused = none.solve();
    assert!(matches!(refused, Err(FitError::IllConditioned { .. })));
}

#[test]
fn new_slopes_leave_the_rates_where_the_gains_were_found() {
    let mut real = RateCorrection::IDENTITY.real();
    real.matrix[0][1] = 0.01;
    real.scale1 = [1e-4, 0.0, -5e-5];
    let before = RateCorrection::from_real(&real).unwrap();
    let slopes = [5e-5, 8e-5, -5e-5];
    let at = Temperature::from_celsius(40);
    let after = with_slopes(&before, slopes, at).unwrap();
    for (found, slope) in after.real().scale1.iter().zip(slopes) {
        assert!((found - slope).abs() < 1e-11);
    }
    let rate = crate::motion::Rate {
        rate: [1 << 24, -(1 << 25), 3 << 24],
    };
    let [old, new] = [before, after].map(|rates| rates.at(at).apply(rate).rate);
    for (old, new) in old.iter().zip(new) {
        // A few steps of 2^-30 in the entries of the matrix.
        assert!(old.abs_diff(new) < 4, "{old} {new}");
    }
    let hot = [before, after].map(|rates| rates.at(Temperature::from_celsius(70)).apply(rate).rate);
    assert!(hot[0][1].abs_diff(hot[1][1]) > 50_000, "{hot:?}");
    assert_eq!(with_slopes(&before, [f64::NAN; 3], at), None);
}
