//! Calibration without a reference: at a standstill the vector is one g long, whichever way it
//! points.
//!
//! In: mean readings of a standing sensor in many poses. Out: nine parameters (three offsets and
//! a symmetric matrix with six) and the residual of the norm. Gravity's length shows nothing of a
//! rotation of the whole sensor in its housing, so the three of mounting stay open; two channels
//! on one board are brought together by [`align`].

use super::FitError;
use super::algebra::minus;
use super::least_squares::{Normal, times};
use crate::vector::Vector;

/// Fewest poses for nine parameters; more, and well spread, is better.
pub const FEWEST_POSES: usize = 9;

/// A fit from poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedPoses {
    /// For the chain.
    pub vector: Vector,
    /// g per g, symmetric.
    pub matrix: [[f64; 3]; 3],
    /// Added after the matrix, in g.
    pub offset_g: [f64; 3],
    /// Mean square of (norm - 1 g) over the poses, in g^2.
    pub mean_square_g2: f64,
    /// Condition figure of the last step.
    pub condition: f64,
}

/// Fits nine parameters to mean readings in nominal g, one per pose.
///
/// Gauss-Newton on |C (a - b)|^2 = 1. Errors: [`FitError::TooFew`] under [`FEWEST_POSES`],
/// [`FitError::IllConditioned`] when the poses do not surround the sphere,
/// [`FitError::NoConvergence`], [`FitError::Implausible`].
pub fn fit(poses_g: &[[f64; 3]]) -> Result<FittedPoses, FitError> {
    if poses_g.len() < FEWEST_POSES {
        return Err(FitError::TooFew {
            have: poses_g.len(),
            need: FEWEST_POSES,
        });
    }
    let mut matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut bias = [0.0; 3];
    for _ in 0..50 {
        let (step, condition) = newton(poses_g, &matrix, bias)?;
        let size = apply(&mut matrix, &mut bias, step);
        if size.is_nan() || size > 1e3 {
            return Err(FitError::NoConvergence);
        }
        if size < 1e-20 {
            return finish(poses_g, matrix, bias, condition);
        }
    }
    Err(FitError::NoConvergence)
}

/// One Gauss-Newton step for \[c00 c11 c22 c01 c02 c12 b0 b1 b2\].
fn newton(poses: &[[f64; 3]], c: &[[f64; 3]; 3], b: [f64; 3]) -> Result<([f64; 9], f64), FitError> {
    let mut normal = Normal::<9, 1>::default();
    for &pose in poses {
        let [dx, dy, dz] = minus(pose, b);
        let [x, y, z] = times(c, [dx, dy, dz]);
        let [gx, gy, gz] = times(c, [x, y, z]);
        let row = [
            2.0 * x * dx,
            2.0 * y * dy,
            2.0 * z * dz,
            2.0 * (x * dy + y * dx),
            2.0 * (x * dz + z * dx),
            2.0 * (y * dz + z * dy),
            -2.0 * gx,
            -2.0 * gy,
            -2.0 * gz,
        ];
        normal.add(row, [1.0 - (x * x + y * y + z * z)], 1.0);
    }
    let ([step], condition) = normal.solve()?;
    Ok((step, condition))
}

/// Adds the step; returns the sum of its squares.
fn apply(matrix: &mut [[f64; 3]; 3], bias: &mut [f64; 3], step: [f64; 9]) -> f64 {
    let [xx, yy, zz, xy, xz, yz, bx, by, bz] = step;
    let change = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    for (row, delta) in matrix.iter_mut().flatten().zip(change.iter().flatten()) {
        *row += delta;
    }
    for (value, delta) in bias.iter_mut().zip([bx, by, bz]) {
        *value += delta;
    }
    step.iter().map(|s| s * s).sum()
}

fn finish(
    poses: &[[f64; 3]],
    matrix: [[f64; 3]; 3],
    bias: [f64; 3],
    condition: f64,
) -> Result<FittedPoses, FitError> {
    let offset_g = times(&matrix, bias).map(|v| -v);
    let plausible = matrix.iter().flatten().all(|v| v.abs() < 1.5)
        && matrix
            .iter()
            .enumerate()
            .all(|(i, row)| row.get(i).is_some_and(|&d| d > 0.5))
        && bias.iter().all(|v| v.abs() < 0.5);
    let vector = Vector::from_real(matrix, offset_g);
    let (Some(vector), true) = (vector, plausible) else {
        return Err(FitError::Implausible);
    };
    // (n^2 - 1) / 2 is n - 1 to within its square, and needs no root.
    let sum: f64 = poses
        .iter()
        .map(|&p| {
            let [x, y, z] = times(&matrix, minus(p, bias));
            let left = (x * x + y * y + z * z - 1.0) / 2.0;
            left * left
        })
        .sum();
    let mean_square_g2 = sum / poses.len() as f64;
    Ok(FittedPoses {
        vector,
        matrix,
        offset_g,
        mean_square_g2,
        condition,
    })
}

/// The rotation that best brings `from` onto `to`, pairs of unit vectors of the same moments.
///
/// Three small-angle Gauss-Newton steps at a time from the identity, so the two frames must
/// already agree to within some 30 deg. Errors: as [`fit`], with at least three pairs.
pub fn align(from: &[[f64; 3]], to: &[[f64; 3]]) -> Result<[[f64; 3]; 3], FitError> {
    let mut rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..30 {
        let mut normal = Normal::<3, 1>::default();
        for (&a, &b) in from.iter().zip(to) {
            let [x, y, z] = times(&rotation, a);
            let [ex, ey, ez] = minus(b, [x, y, z]);
            // w cross v, component by component.
            normal.add([0.0, z, -y], [ex], 1.0);
            normal.add([-z, 0.0, x], [ey], 1.0);
            normal.add([y, -x, 0.0], [ez], 1.0);
        }
        if normal.rows() < 9 {
            return Err(FitError::TooFew {
                have: normal.rows() / 3,
                need: 3,
            });
        }
        let ([w], _) = normal.solve()?;
        rotation = product(&small_rotation(w), &rotation);
        if w.iter().map(|v| v * v).sum::<f64>() < 1e-22 {
            return Ok(rotation);
        }
    }
    Err(FitError::NoConvergence)
}

/// The rotation by the vector `w` (Cayley form: exactly orthogonal, needs no trigonometry); by
/// 2 atan(|w| / 2), so too little by |w|^2 / 12 of it.
pub(super) fn small_rotation(w: [f64; 3]) -> [[f64; 3]; 3] {
    let [a, b, c] = w.map(|v| v / 2.0);
    let n = 1.0 + a * a + b * b + c * c;
    let m = [
        [
            1.0 + a * a - b * b - c * c,
            2.0 * (a * b - c),
            2.0 * (a * c + b),
        ],
        [
            2.0 * (a * b + c),
            1.0 - a * a + b * b - c * c,
            2.0 * (b * c - a),
        ],
        [
            2.0 * (a * c - b),
            2.0 * (b * c + a),
            1.0 - a * a - b * b + c * c,
        ],
    ];
    m.map(|row| row.map(|v| v / n))
}

/// Matrix product.
pub fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let [[b00, b01, b02], [b10, b11, b12], [b20, b21, b22]] = *b;
    a.map(|[x, y, z]| {
        [
            x * b00 + y * b10 + z * b20,
            x * b01 + y * b11 + z * b21,
            x * b02 + y * b12 + z * b22,
        ]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Directions spread over the sphere.
    fn sphere(n: usize) -> Vec<[f64; 3]> {
        (0..n)
            .map(|i| {
                let z = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
                let (s, c) = (2.399_963 * i as f64).sin_cos();
                let r = (1.0 - z * z).sqrt();
                [r * c, r * s, z]
            })
            .collect()
    }

    fn distort(v: [f64; 3]) -> [f64; 3] {
        let m = [
            [1.02, 0.01, -0.02],
            [0.01, 0.97, 0.015],
            [-0.02, 0.015, 1.01],
        ];
        let [x, y, z] = times(&m, v);
        [x + 0.03, y - 0.05, z + 0.02]
    }

    #[test]
    fn norm_alone_finds_scale_and_offset() {
        let poses: Vec<_> = sphere(21).into_iter().map(distort).collect();
        let fitted = fit(&poses).unwrap();
        assert!(fitted.mean_square_g2 < 1e-20);
        let [x, y, z] = times(&fitted.matrix, distort([0.6, 0.0, 0.8]));
        let [bx, by, bz] = fitted.offset_g;
        assert!(
            ((x + bx) - 0.6).abs() < 1e-6 && (y + by).abs() < 1e-6 && ((z + bz) - 0.8).abs() < 1e-6
        );
    }

    #[test]
    fn poses_that_do_not_surround_the_sphere_are_refused() {
        assert_eq!(fit(&sphere(8)), Err(FitError::TooFew { have: 8, need: 9 }));
        let flat: Vec<_> = (0..20)
            .map(|i| {
                let (s, c) = (0.3 * f64::from(i)).sin_cos();
                distort([s, c, 0.0])
            })
            .collect();
        assert!(
            matches!(fit(&flat), Err(FitError::IllConditioned { .. })),
            "{:?}",
            fit(&flat)
        );
        assert!(fit(&[[0.0; 3]; 20]).is_err());
        assert!(fit(&[[f64::NAN; 3]; 20]).is_err());
    }

    #[test]
    fn align_finds_a_rotation() {
        let turn = small_rotation([0.1, -0.2, 0.15]);
        let from = sphere(12);
        let to: Vec<_> = from.iter().map(|&v| times(&turn, v)).collect();
        let found = align(&from, &to).unwrap();
        for (a, b) in found.iter().flatten().zip(turn.iter().flatten()) {
            assert!((a - b).abs() < 1e-9);
        }
        assert!(align(&from[..2], &to[..2]).is_err());
    }
}
