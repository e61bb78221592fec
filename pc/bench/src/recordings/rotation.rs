//! The rotation that best brings one set of vectors onto another, whatever their attitudes.
//!
//! In: pairs of vectors. Out: the rotation with the least squares of distances, and how well the
//! pairs determine it. Closed form by Davenport's q-method: the quaternion is the eigenvector of
//! the largest eigenvalue of a symmetric 4 x 4 matrix, found by Jacobi rotations. Gauss-Newton as
//! in `tilt::calibration::poses` needs frames within some 30 deg of each other; a logger's sensor
//! sits on its board as it likes.

/// A rotation found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Times a vector of the first set, gives the second's.
    pub rotation: [[f64; 3]; 3],
    /// Largest eigenvalue over its distance to the next: 1 or a little more is well determined,
    /// infinite is open. Not a number when the vectors are not numbers.
    pub condition: f64,
}

/// The best rotation from the vectors of `from` to those of `to`, paired in order.
pub fn best_rotation(from: &[[f64; 3]], to: &[[f64; 3]]) -> Found {
    let mut b = [[0.0; 3]; 3];
    for (from, to) in from.iter().zip(to) {
        for (row, t) in b.iter_mut().zip(to) {
            for (cell, f) in row.iter_mut().zip(from) {
                *cell += t * f;
            }
        }
    }
    let (values, vectors) = eigen(davenport(&b));
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&i: &usize, &j| values[j].total_cmp(&values[i]));
    let [first, second, ..] = order;
    let quaternion = vectors.map(|row| row[first]);
    let gap = values[first] - values[second];
    let condition = if gap > 0.0 {
        values[first] / gap
    } else {
        f64::INFINITY
    };
    let condition = if b.iter().flatten().all(|c| c.is_finite()) {
        condition
    } else {
        f64::NAN
    };
    Found {
        rotation: matrix(quaternion),
        condition,
    }
}

/// Davenport's matrix of the sum of to * from^T, for quaternions (w, x, y, z).
fn davenport(b: &[[f64; 3]; 3]) -> [[f64; 4]; 4] {
    let trace = b[0][0] + b[1][1] + b[2][2];
    let z = [b[2][1] - b[1][2], b[0][2] - b[2][0], b[1][0] - b[0][1]];
    let mut k = [[0.0; 4]; 4];
    k[0][0] = trace;
    for i in 0..3 {
        k[0][i + 1] = z[i];
        k[i + 1][0] = z[i];
        for j in 0..3 {
            k[i + 1][j + 1] = b[i][j] + b[j][i] - if i == j { trace } else { 0.0 };
        }
    }
    k
}

/// Eigenvalues and eigenvectors (in columns) of a symmetric matrix, by cyclic Jacobi rotations.
fn eigen(mut a: [[f64; 4]; 4]) -> ([f64; 4], [[f64; 4]; 4]) {
    let mut vectors = [[0.0; 4]; 4];
    for (i, row) in vectors.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    // Convergence is quadratic; a 4 x 4 matrix is done in five or six sweeps.
    for _ in 0..12 {
        for p in 0..3 {
            for q in p + 1..4 {
                rotate(&mut a, &mut vectors, p, q);
            }
        }
    }
    ([a[0][0], a[1][1], a[2][2], a[3][3]], vectors)
}

/// One Jacobi rotation that makes element (p, q) zero.
fn rotate(a: &mut [[f64; 4]; 4], vectors: &mut [[f64; 4]; 4], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for row in a.iter_mut().chain(vectors.iter_mut()) {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
    let (low, high) = (a[p], a[q]);
    for k in 0..4 {
        a[p][k] = c * low[k] - s * high[k];
        a[q][k] = s * low[k] + c * high[k];
    }
}

fn matrix([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use tilt::calibration::least_squares::times;

    const VECTORS: [[f64; 3]; 4] = [
        [1.0, 0.0, 0.0],
        [0.0, 0.9, 0.1],
        [0.3, -0.2, 0.8],
        [-0.5, 0.5, -0.7],
    ];

    #[test]
    fn any_rotation_is_found() {
        let quaternions: [[f64; 4]; 5] = [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.5, 0.5, -0.5, 0.5],
            [0.0, 0.6, 0.0, -0.8],
            [0.1, 0.7, 0.1, 0.7],
        ];
        for q in quaternions {
            let turn = matrix(q);
            let to = VECTORS.map(|v| times(&turn, v));
            let found = best_rotation(&VECTORS, &to);
            for (a, b) in found.rotation.iter().flatten().zip(turn.iter().flatten()) {
                assert!((a - b).abs() < 1e-12, "{q:?}: {found:?}");
            }
            assert!(found.condition < 10.0, "{}", found.condition);
        }
    }

    #[test]
    fn what_leaves_the_rotation_open_shows_in_the_condition() {
        let line = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.5]];
        assert!(best_rotation(&line, &line).condition > 1e6);
        assert!(best_rotation(&[], &[]).condition > 1e6);
        assert!(best_rotation(&[[f64::NAN; 3]; 3], &line).condition.is_nan());
    }
}
