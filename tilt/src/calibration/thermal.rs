//! Characterisation in the climatic chamber (R4): slopes for the paper, quadratics for the product.
//!
//! In: mean readings at each temperature the chamber held. Out: a [`Piecewise`] or a
//! [`Quadratic`]. Temperatures are those the part itself reported.
//!
//! Erratum E12 shapes both: the slopes of eq 6 have to be summed into a bias (done by the model),
//! and one pose cannot separate the offset of z from its gain, so the product's fit takes four
//! orientations in which every axis sees both signs of gravity, and both branches of the run so
//! that the thermal hysteresis averages out.

use super::FitError;
use super::least_squares::Normal;
use crate::ONE_G;
use crate::sample::Temperature;
use crate::temperature::{KNOTS, Piecewise, Quadratic};

/// A mean reading at one held temperature.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dwell {
    /// What the part's thermometer showed.
    pub temperature: Temperature,
    /// Mean acceleration, 2^-26 g nominal per step, part's axes.
    pub accel: [f64; 3],
}

/// Eq 6 for each interval: B_n = (A_n - A_(n-1)) / (T_n - T_(n-1)).
///
/// `dwells` are the nine temperatures from -10 to 70 degC of one level pose, rising. Errors:
/// [`FitError::IllConditioned`] when two neighbours are closer than 1 degC or do not rise.
pub fn piecewise(dwells: &[Dwell; KNOTS]) -> Result<Piecewise, FitError> {
    let mut model = Piecewise {
        knots: dwells.map(|d| d.temperature),
        ..Piecewise::default()
    };
    for (pair, slopes) in dwells.windows(2).zip(&mut model.slopes_q8) {
        let [low, high] = pair else { continue };
        let step = high.temperature.0 - low.temperature.0;
        if step < 256 {
            return Err(FitError::IllConditioned {
                condition: f64::INFINITY,
            });
        }
        for ((slope, a), b) in slopes.iter_mut().zip(low.accel).zip(high.accel) {
            *slope = ((b - a) * 65536.0 / f64::from(step)) as i32;
        }
    }
    Ok(model)
}

/// Accumulates dwells of several orientations.
///
/// Each axis follows reading = a (1 + e d + e2 d^2) + b d + b2 d^2 + constant of the orientation,
/// where `a` is gravity's share of the orientation and d the distance from 25 degC. Orientations
/// differ by their constant, so they need not be known better than a degree or two.
#[derive(Clone, Debug, Default)]
pub struct QuadraticFit {
    axes: [Normal<8, 1>; 3],
}

/// Orientations a [`QuadraticFit`] takes.
pub const ORIENTATIONS: usize = 4;

impl QuadraticFit {
    /// Adds a dwell in orientation `which` (0 to 3), in which gravity's share is `share_g`.
    pub fn add(&mut self, which: usize, share_g: [f64; 3], dwell: Dwell) {
        // Tens of degrees keep the regressors near 1, so the condition figure means something.
        let d = f64::from(dwell.temperature.0 - Temperature::REFERENCE.0) / 2560.0;
        for ((normal, share), accel) in self.axes.iter_mut().zip(share_g).zip(dwell.accel) {
            let mut row = [d, d * d, share * d, share * d * d, 0.0, 0.0, 0.0, 0.0];
            if let Some(slot) = row.get_mut(4 + which) {
                *slot = 1.0;
            }
            normal.add(row, [accel / f64::from(ONE_G)], 1.0);
        }
    }

    /// The quadratics that undo what was found.
    ///
    /// Errors: [`FitError::TooFew`], [`FitError::IllConditioned`] when an orientation or a range
    /// of temperature is missing, [`FitError::Implausible`] beyond 10 mg/degC or 0.2 %/degC.
    pub fn solve(&self) -> Result<Quadratic, FitError> {
        let mut model = Quadratic::default();
        for (axis, normal) in self.axes.iter().enumerate() {
            let ([[b1, b2, e1, e2, ..]], _) = normal.solve()?;
            let (b1, b2) = (b1 / 10.0, b2 / 100.0);
            let (e1, e2) = (e1 / 10.0, e2 / 100.0);
            if !(b1.abs() < 0.01 && e1.abs() < 0.002 && b2.abs() < 1e-4 && e2.abs() < 2e-5) {
                return Err(FitError::Implausible);
            }
            // 1 / (1 + e1 d + e2 d^2) = 1 - e1 d + (e1^2 - e2) d^2, to the second order.
            let (g1, g2) = (-e1, e1 * e1 - e2);
            let g = f64::from(ONE_G);
            put(&mut model.offset1_q8, axis, b1 * g * 256.0);
            put(&mut model.offset2_q16, axis, b2 * g * 65536.0);
            put(&mut model.gain1_q38, axis, g1 * 274_877_906_944.0);
            put(&mut model.gain2_q46, axis, g2 * 70_368_744_177_664.0);
        }
        Ok(model)
    }
}

fn put(target: &mut [i32; 3], axis: usize, value: f64) {
    if let Some(slot) = target.get_mut(axis) {
        *slot = value as i32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::composition::Whole;
    use crate::filter::Filtered;
    use crate::temperature::TemperatureModel;

    const G: f64 = ONE_G as f64;

    /// A part with offset and gain over temperature, in an orientation.
    fn reading(share: [f64; 3], celsius: f64) -> Dwell {
        let d = celsius - 25.0;
        let accel = share.map(|a| (a * (1.0 + 1e-4 * d) + 0.017 + 0.0003 * d - 0.8e-6 * d * d) * G);
        Dwell {
            temperature: Temperature((celsius * 256.0) as i32),
            accel,
        }
    }

    #[test]
    fn eq6_slopes_undo_the_offset() {
        let dwells = core::array::from_fn(|i| reading([0.0, 0.0, 1.0], -10.0 + 10.0 * i as f64));
        let model = piecewise(&dwells).unwrap();
        for c in [-10.0, 10.0, 40.0, 70.0] {
            let raw = reading([0.0, 0.0, 1.0], c);
            let input = Filtered {
                accel: raw.accel.map(|a| a as i32),
            };
            let out = TemperatureModel::<Whole>::Piecewise(model)
                .apply(input, raw.temperature)
                .accel[0];
            assert!((f64::from(out) - 0.017 * G).abs() < 0.0001 * G, "{c}");
        }
        let mut folded = dwells;
        folded[3].temperature = folded[2].temperature;
        assert!(piecewise(&folded).is_err());
    }

    #[test]
    fn four_orientations_give_offset_and_gain() {
        let s = 0.577_350_27;
        let shares = [[s, s, s], [s, -s, -s], [-s, s, -s], [-s, -s, s]];
        let mut fit = QuadraticFit::default();
        for (i, share) in shares.into_iter().enumerate() {
            for step in 0..9 {
                fit.add(i, share, reading(share, -10.0 + 10.0 * f64::from(step)));
            }
        }
        let model: TemperatureModel = TemperatureModel::Quadratic(fit.solve().unwrap());
        for share in [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.6, 0.0, -0.8]] {
            let at_25 = reading(share, 25.0).accel;
            for c in [-10.0, 0.0, 30.0, 70.0] {
                let raw = reading(share, c);
                let input = Filtered {
                    accel: raw.accel.map(|a| a as i32),
                };
                let out = model.apply(input, raw.temperature).accel;
                for (o, want) in out.iter().zip(at_25) {
                    // The constant offset is scaled by the gain too: 17 mg times 0.5 %.
                    assert!(
                        (f64::from(*o) - want).abs() < 0.000_09 * G,
                        "{c}: {o} {want}"
                    );
                }
            }
        }
    }

    #[test]
    fn e12_one_pose_cannot_separate_offset_from_gain() {
        let mut fit = QuadraticFit::default();
        for step in 0..40 {
            fit.add(
                0,
                [0.0, 0.0, 1.0],
                reading([0.0, 0.0, 1.0], -10.0 + 2.0 * f64::from(step)),
            );
        }
        assert!(matches!(fit.solve(), Err(FitError::IllConditioned { .. })));
    }
}
