//! Calibration against a reference that has the true direction of gravity (R5).
//!
//! In: readings of a standing sensor, each with the specific force that it should feel by the
//! reference. Out: the twelve parameters and the harmonics. All twelve are fitted from the two
//! mounts (roll and pitch runs) together: one run alone leaves the third column of the matrix open,
//! which showed as 3.5 deg of error at 5 deg roll in the study this design rests on. The
//! conditioning is checked, so such a set is refused rather than fitted. [`two_axis`] and
//! [`one_axis`] make a whole correction from the stands of a motor.

use super::FitError;
use super::least_squares::{Normal, invert, times};
use crate::ONE_G;
use crate::angle::{Angle, Axes, Harmonics, slopes, turn};
use crate::chain::Correction;
use crate::temperature::Compensated;
use crate::vector::Vector;

/// Beyond this the fold at the vertical bends what the harmonics of a slope would follow, deg.
pub const FOLD_DEG: f64 = 86.0;

/// Variance of one stand over that expected of a harmonic: (0.012 / 0.04)^2.
const RIDGE: f64 = 0.09;

/// What a motor turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slope {
    /// Slope X; all of the turn of a one-axis instrument.
    X,
    /// Slope Y.
    Y,
}

/// One stand of a motor.
#[derive(Clone, Copy, Debug)]
pub struct Stand {
    /// What was turned.
    pub slope: Slope,
    /// The motor's angle, deg.
    pub reference_deg: f64,
    /// Sine and cosine of it: the fits have nothing but + - * /.
    pub sin_cos: (f64, f64),
    /// What the part felt.
    pub felt: Compensated,
}

impl Stand {
    /// The specific force that the part should feel, g.
    pub const fn reference_g(&self) -> [f64; 3] {
        let (sin, cos) = self.sin_cos;
        match self.slope {
            Slope::X => [sin, 0.0, cos],
            Slope::Y => [0.0, sin, cos],
        }
    }
}

/// A correction of two slopes with its condition figure: twelve parameters, and three harmonics of
/// each slope.
///
/// Errors: see [`FitError`].
pub fn two_axis(stands: &[Stand]) -> Result<(Correction, f64), FitError> {
    let mut fit = VectorFit::default();
    for stand in stands {
        fit.add(stand.reference_g(), stand.felt);
    }
    let fitted = fit.solve()?;
    let vector = fitted.vector;
    let mut left = Axes::<HarmonicFit>::default();
    let unfolded = |stand: &&Stand| stand.reference_deg.abs() <= FOLD_DEG;
    for stand in stands.iter().filter(unfolded) {
        let found = slopes(vector.apply(stand.felt));
        let reference = Angle::from_degrees(stand.reference_deg);
        match stand.slope {
            Slope::X => left.x.add(found.x, reference),
            Slope::Y => left.y.add(found.y, reference),
        }
    }
    let harmonics = Axes::<Harmonics> {
        x: left.x.solve(RIDGE)?,
        y: left.y.solve(RIDGE)?,
    };
    Ok((Correction::TwoAxis { vector, harmonics }, fitted.condition))
}

/// A correction of a turn of 360 deg with its condition figure: six parameters, and three
/// harmonics.
///
/// Errors: see [`FitError`].
pub fn one_axis(stands: &[Stand]) -> Result<(Correction, f64), FitError> {
    let mut fit = PlaneFit::default();
    for stand in stands {
        let (sin, cos) = stand.sin_cos;
        fit.add(sin, cos, stand.felt);
    }
    let fitted = fit.solve()?;
    let vector = fitted.vector;
    let mut left = HarmonicFit::default();
    for stand in stands {
        let found = turn(vector.apply(stand.felt));
        left.add(found, Angle::from_degrees(stand.reference_deg));
    }
    let harmonics = left.solve(0.0)?;
    Ok((Correction::OneAxis { vector, harmonics }, fitted.condition))
}

/// Accumulates standing readings with their reference.
#[derive(Clone, Debug, Default)]
pub struct VectorFit {
    /// reading = M reference + b, one right-hand side per axis of the part.
    normal: Normal<4, 3>,
}

/// A fitted affine correction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedVector {
    /// For the chain.
    pub vector: Vector,
    /// The same matrix in g per g, housing axis by part axis.
    pub matrix: [[f64; 3]; 3],
    /// The same offset in g.
    pub offset_g: [f64; 3],
    /// Condition figure of the set of readings.
    pub condition: f64,
}

impl VectorFit {
    /// Adds a reading, compensated for temperature, for the reference's specific force in g.
    pub fn add(&mut self, reference_g: [f64; 3], reading: Compensated) {
        let [x, y, z] = reference_g;
        let values = reading.accel.map(|a| f64::from(a) / f64::from(ONE_G));
        self.normal.add([x, y, z, 1.0], values, 1.0);
    }

    /// The twelve parameters.
    ///
    /// Errors: [`FitError::TooFew`], [`FitError::IllConditioned`], and [`FitError::Implausible`]
    /// when an axis is dead or the result does not fit the chain's format.
    pub fn solve(&self) -> Result<FittedVector, FitError> {
        let (solution, condition) = self.normal.solve()?;
        let forward = solution.map(|[a, b, c, _]| [a, b, c]);
        let bias = solution.map(|[_, _, _, b]| b);
        undo(forward, bias, condition)
    }
}

/// Accumulates readings of a one-axis 360 deg instrument: six parameters in the plane of x and z.
#[derive(Clone, Debug, Default)]
pub struct PlaneFit {
    /// reading = M (sin, cos) + b for the part's x and z.
    normal: Normal<3, 2>,
}

impl PlaneFit {
    /// Adds a reading, compensated for temperature, for the sine and cosine of the reference.
    pub fn add(&mut self, sin: f64, cos: f64, reading: Compensated) {
        let [x, _, z] = reading.accel.map(|a| f64::from(a) / f64::from(ONE_G));
        self.normal.add([sin, cos, 1.0], [x, z], 1.0);
    }

    /// The six parameters, as a correction that leaves y alone. Errors: as [`VectorFit::solve`].
    pub fn solve(&self) -> Result<FittedVector, FitError> {
        let ([[a, b, bias_x], [c, d, bias_z]], condition) = self.normal.solve()?;
        let forward = [[a, 0.0, b], [0.0, 1.0, 0.0], [c, 0.0, d]];
        undo(forward, [bias_x, 0.0, bias_z], condition)
    }
}

/// The correction that undoes reading = forward reference + bias.
fn undo(
    forward: [[f64; 3]; 3],
    bias_g: [f64; 3],
    condition: f64,
) -> Result<FittedVector, FitError> {
    let matrix = invert(forward).ok_or(FitError::Implausible)?;
    let offset_g = times(&matrix, bias_g).map(|v| -v);
    let vector = Vector::from_real(matrix, offset_g).ok_or(FitError::Implausible)?;
    Ok(FittedVector {
        vector,
        matrix,
        offset_g,
        condition,
    })
}

/// Accumulates what is left of the angle after the affine correction.
#[derive(Clone, Debug, Default)]
pub struct HarmonicFit {
    normal: Normal<6, 1>,
}

impl HarmonicFit {
    /// Adds one point: the angle found and the reference's.
    pub fn add(&mut self, found: Angle, reference: Angle) {
        let (c1, s1) = found.cos_sin();
        let (c2, s2) = (c1 * c1 - s1 * s1, 2.0 * s1 * c1);
        let (c3, s3) = (c1 * c2 - s1 * s2, s1 * c2 + c1 * s2);
        let left = f64::from(reference.minus(found).0);
        self.normal.add([c1, c2, c3, s1, s2, s3], [left], 1.0);
    }

    /// The harmonics that take up most of it.
    ///
    /// `ridge` is the variance of one point over the variance expected of an amplitude: over half
    /// a circle the six functions are nearly dependent, and without a prior they would follow the
    /// noise. Errors: [`FitError::TooFew`].
    pub fn solve(&self, ridge: f64) -> Result<Harmonics, FitError> {
        let mut normal = self.normal.clone();
        normal.ridge(ridge);
        let ([[c1, c2, c3, s1, s2, s3]], _) = normal.solve()?;
        Ok(Harmonics {
            cosine: [c1, c2, c3].map(|v| v as i32),
            sine: [s1, s2, s3].map(|v| v as i32),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::slopes;
    use std::f64::consts::PI;
    use std::vec::Vec;

    const M: [[f64; 3]; 3] = [
        [1.01, 0.02, -0.015],
        [-0.01, 0.99, 0.02],
        [0.02, -0.01, 1.005],
    ];
    const B: [f64; 3] = [0.02, -0.015, 0.03];

    fn feel(f: [f64; 3]) -> Compensated {
        let v = times(&M, f);
        let mut accel = [0; 3];
        for ((a, v), b) in accel.iter_mut().zip(v).zip(B) {
            *a = ((v + b) * f64::from(ONE_G)).round() as i32;
        }
        Compensated { accel }
    }

    fn runs(mounts: &[bool]) -> VectorFit {
        let mut fit = VectorFit::default();
        for &pitch in mounts {
            for d in -90..=90 {
                let (s, c) = (f64::from(d) * PI / 180.0).sin_cos();
                let f = if pitch { [s, 0.0, c] } else { [0.0, s, c] };
                fit.add(f, feel(f));
            }
        }
        fit
    }

    #[test]
    fn two_mounts_give_all_twelve() {
        let fitted = runs(&[true, false]).solve().unwrap();
        let f = [0.6, -0.48, 0.64];
        let got = slopes(fitted.vector.apply(feel(f)));
        assert!((got.x.degrees() - 0.6f64.asin() * 180.0 / PI).abs() < 2e-4);
        assert!((got.y.degrees() + 0.48f64.asin() * 180.0 / PI).abs() < 2e-4);
    }

    fn stands(slopes: &[Slope]) -> Vec<Stand> {
        let stand = |slope: Slope, d: i32| {
            let stand = Stand {
                slope,
                reference_deg: f64::from(d),
                sin_cos: (f64::from(d) * PI / 180.0).sin_cos(),
                felt: Compensated { accel: [0; 3] },
            };
            let felt = feel(stand.reference_g());
            Stand { felt, ..stand }
        };
        let all = slopes.iter().flat_map(|s| (-90..=90).map(move |d| (*s, d)));
        all.map(|(slope, d)| stand(slope, d)).collect()
    }

    #[test]
    fn stands_of_both_slopes_give_a_whole_correction_and_those_of_one_only_a_turn() {
        let both = stands(&[Slope::X, Slope::Y]);
        let (correction, condition) = two_axis(&both).unwrap();
        assert!(condition < 100.0, "{condition}");
        let Correction::TwoAxis { vector, harmonics } = correction else {
            panic!("{correction:?}");
        };
        let found = slopes(vector.apply(feel([0.5, 0.0, 0.75f64.sqrt()]))).x;
        let found = found.degrees() + harmonics.x.correction(found).degrees();
        assert!((found - 30.0).abs() < 1e-3, "{found}");
        let one = stands(&[Slope::X]);
        let refused = two_axis(&one).map(|(_, condition)| condition);
        assert!(matches!(refused, Err(FitError::IllConditioned { .. })));
        let (correction, _) = one_axis(&one).unwrap();
        assert!(matches!(correction, Correction::OneAxis { .. }));
    }

    #[test]
    fn one_mount_alone_is_refused_as_ill_conditioned() {
        assert!(matches!(
            runs(&[true]).solve(),
            Err(FitError::IllConditioned { .. })
        ));
        assert!(matches!(
            runs(&[]).solve(),
            Err(FitError::TooFew { have: 0, need: 4 })
        ));
    }

    #[test]
    fn a_dead_axis_is_refused() {
        let mut fit = VectorFit::default();
        for d in -90..=90 {
            let (s, c) = (f64::from(d) * PI / 180.0).sin_cos();
            for f in [[s, 0.0, c], [0.0, s, c]] {
                let mut reading = feel(f);
                reading.accel[1] = 77;
                fit.add(f, reading);
            }
        }
        assert_eq!(fit.solve(), Err(FitError::Implausible));
    }

    #[test]
    fn six_parameters_give_the_turn() {
        let mut fit = PlaneFit::default();
        for d in -180..180 {
            let (s, c) = (f64::from(d) * PI / 180.0).sin_cos();
            fit.add(s, c, feel([s, 0.0, c]));
        }
        let vector = fit.solve().unwrap().vector;
        for d in [-179.0, -90.0, -3.3, 45.0, 90.0, 170.0] {
            let (s, c) = (d * PI / 180.0f64).sin_cos();
            let got = crate::angle::turn(vector.apply(feel([s, 0.0, c]))).degrees();
            assert!((got - d).abs() < 2e-4, "{d}: {got}");
        }
    }

    #[test]
    fn harmonics_come_back() {
        let wave = |d: f64| 0.03 * (2.0 * d * PI / 180.0).sin() - 0.02 * (d * PI / 180.0).cos();
        let mut fit = HarmonicFit::default();
        for d in -180..180 {
            let d = f64::from(d);
            fit.add(Angle::from_degrees(d), Angle::from_degrees(d + wave(d)));
        }
        let harmonics = fit.solve(0.0).unwrap();
        for d in [-170.0, -45.0, 0.0, 33.3, 120.0] {
            let got = harmonics.correction(Angle::from_degrees(d)).degrees();
            assert!((got - wave(d)).abs() < 1e-5, "{d}: {got}");
        }
    }
}
