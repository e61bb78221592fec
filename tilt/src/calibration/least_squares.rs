//! Linear least squares by normal equations, with a figure for the conditioning.
//!
//! In: rows of regressors with observed values. Out: the parameters, or that they are not
//! determined. Up to a dozen parameters, no allocation, only + - * /. A ridge (a prior standard
//! deviation for each parameter against that of one observation) may be given. With each row
//! weighted by 1 / variance, the inverse of the matrix holds the variances of the parameters.

use super::FitError;

/// Accumulated normal equations for `N` parameters and `M` right-hand sides that share the rows.
#[derive(Clone, Debug)]
pub struct Normal<const N: usize, const M: usize> {
    matrix: [[f64; N]; N],
    right: [[f64; N]; M],
    rows: usize,
}

impl<const N: usize, const M: usize> Default for Normal<N, M> {
    fn default() -> Self {
        Self {
            matrix: [[0.0; N]; N],
            right: [[0.0; N]; M],
            rows: 0,
        }
    }
}

/// Scaled pivots further apart than this leave a parameter practically free.
pub const WORST_CONDITION: f64 = 1e6;

impl<const N: usize, const M: usize> Normal<N, M> {
    /// Adds one observation: `values[m]` = sum of `row[n]` times parameter n, for each m.
    pub fn add(&mut self, row: [f64; N], values: [f64; M], weight: f64) {
        for (line, &r) in self.matrix.iter_mut().zip(&row) {
            for (cell, &c) in line.iter_mut().zip(&row) {
                *cell += weight * r * c;
            }
        }
        for (right, v) in self.right.iter_mut().zip(values) {
            for (cell, &r) in right.iter_mut().zip(&row) {
                *cell += weight * r * v;
            }
        }
        self.rows += 1;
    }

    /// Pulls every parameter towards 0 with the weight of `strength` unit observations.
    pub fn ridge(&mut self, strength: f64) {
        for (n, line) in self.matrix.iter_mut().enumerate() {
            if let Some(cell) = line.get_mut(n) {
                *cell += strength;
            }
        }
    }

    /// Observations so far.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The parameters for each right-hand side, and the condition figure.
    ///
    /// Errors: [`FitError::TooFew`] below `N` rows, [`FitError::IllConditioned`] when the scaled
    /// pivots spread over more than [`WORST_CONDITION`].
    pub fn solve(&self) -> Result<([[f64; N]; M], f64), FitError> {
        self.solve_within(WORST_CONDITION)
    }

    /// As [`solve`](Self::solve), refused above `worst` instead of [`WORST_CONDITION`]: for fits
    /// that are judged by the variances of their parameters.
    pub fn solve_within(&self, worst: f64) -> Result<([[f64; N]; M], f64), FitError> {
        if self.rows < N {
            return Err(FitError::TooFew {
                have: self.rows,
                need: N,
            });
        }
        let (factor, pivots, condition) = self.factorise();
        if condition > worst {
            return Err(FitError::IllConditioned { condition });
        }
        Ok((
            self.right.map(|b| substitute(&factor, &pivots, b)),
            condition,
        ))
    }

    /// Diagonal of the inverse: the variance of each parameter, where each weight was 1 / variance
    /// of its observation. Means nothing where the fit is refused.
    pub fn variances(&self) -> [f64; N] {
        let (factor, pivots, _) = self.factorise();
        let mut variances = [0.0; N];
        for (n, variance) in variances.iter_mut().enumerate() {
            let mut unit = [0.0; N];
            if let Some(one) = unit.get_mut(n) {
                *one = 1.0;
            }
            *variance = at(&substitute(&factor, &pivots, unit), n);
        }
        variances
    }

    /// Weighted sum of squares left over by `solution` for each right-hand side, given that of the
    /// observed `values`: v^2 - 2 x b + x A x. Exact to 1e-16 of the larger sum.
    pub fn left_over(&self, solution: &[[f64; N]; M], values: [f64; M]) -> [f64; M] {
        let mut left = values;
        let sides = solution.iter().zip(&self.right);
        for (left, (x, right)) in left.iter_mut().zip(sides) {
            for ((row, b), x_row) in self.matrix.iter().zip(right).zip(x) {
                let fitted: f64 = row.iter().zip(x).map(|(a, x)| a * x).sum();
                *left += x_row * (fitted - 2.0 * b);
            }
            *left = left.max(0.0);
        }
        left
    }

    /// L D L^T without square roots; the condition is of pivots relative to their own diagonal,
    /// so that the units of the parameters do not matter.
    fn factorise(&self) -> ([[f64; N]; N], [f64; N], f64) {
        let mut factor = self.matrix;
        let mut pivots = [0.0; N];
        let (mut largest, mut smallest) = (0.0f64, f64::INFINITY);
        for j in 0..N {
            let diagonal = get(&self.matrix, j, j);
            let mut pivot = diagonal;
            for k in 0..j {
                let l = get(&factor, j, k);
                pivot -= l * l * at(&pivots, k);
            }
            let usable = diagonal > 0.0 && pivot.is_finite();
            let scaled = if usable { pivot / diagonal } else { 0.0 };
            largest = largest.max(scaled);
            smallest = smallest.min(scaled);
            if let Some(slot) = pivots.get_mut(j) {
                *slot = pivot;
            }
            for i in j + 1..N {
                let mut sum = get(&self.matrix, i, j);
                for k in 0..j {
                    sum -= get(&factor, i, k) * get(&factor, j, k) * at(&pivots, k);
                }
                if let Some(cell) = factor.get_mut(i).and_then(|row| row.get_mut(j)) {
                    *cell = sum / pivot;
                }
            }
        }
        let condition = if smallest > 0.0 {
            largest / smallest
        } else {
            f64::INFINITY
        };
        (factor, pivots, condition)
    }
}

fn at<const N: usize>(vector: &[f64; N], i: usize) -> f64 {
    vector.get(i).copied().unwrap_or(0.0)
}

fn get<const N: usize>(matrix: &[[f64; N]; N], i: usize, j: usize) -> f64 {
    matrix.get(i).map_or(0.0, |row| at(row, j))
}

fn substitute<const N: usize>(l: &[[f64; N]; N], d: &[f64; N], mut b: [f64; N]) -> [f64; N] {
    for i in 0..N {
        let known: f64 = (0..i).map(|k| get(l, i, k) * at(&b, k)).sum();
        if let Some(value) = b.get_mut(i) {
            *value -= known;
        }
    }
    for (value, pivot) in b.iter_mut().zip(d) {
        *value /= pivot;
    }
    for i in (0..N).rev() {
        let known: f64 = (i + 1..N).map(|k| get(l, k, i) * at(&b, k)).sum();
        if let Some(value) = b.get_mut(i) {
            *value -= known;
        }
    }
    b
}

/// Square root to the last bit or two, by Newton's method; 0 below 2e-308, and where there is none.
pub fn square_root(value: f64) -> f64 {
    if !(value >= f64::MIN_POSITIVE && value.is_finite()) {
        return 0.0;
    }
    // Half the exponent is within 6.1 % of the root; each step squares that and halves it.
    let mut root = f64::from_bits((value.to_bits() >> 1) + (1023 << 51));
    for _ in 0..4 {
        root = (root + value / root) / 2.0;
    }
    root
}

/// Inverse of a 3 x 3 matrix by cofactors; `None` when its determinant is under 1e-6.
pub fn invert(m: [[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let [[a, b, c], [d, e, f], [g, h, i]] = m;
    let (minor_a, minor_b, minor_c) = (e * i - f * h, f * g - d * i, d * h - e * g);
    let determinant = a * minor_a + b * minor_b + c * minor_c;
    if determinant.is_nan() || determinant.abs() < 1e-6 {
        return None;
    }
    let inverse = [
        [minor_a, c * h - b * i, b * f - c * e],
        [minor_b, a * i - c * g, c * d - a * f],
        [minor_c, b * g - a * h, a * e - b * d],
    ];
    Some(inverse.map(|row| row.map(|v| v / determinant)))
}

/// Matrix times vector.
pub fn times(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = v;
    m.map(|[a, b, c]| a * x + b * y + c * z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_a_line_exactly() {
        let mut normal = Normal::<2, 2>::default();
        for x in 0..10 {
            let x = f64::from(x);
            normal.add([1.0, x], [2.0 + 3.0 * x, -1.0 - 0.5 * x], 1.0);
        }
        let ([first, second], _) = normal.solve().unwrap();
        assert!((first[0] - 2.0).abs() < 1e-10 && (first[1] - 3.0).abs() < 1e-10);
        assert!((second[0] + 1.0).abs() < 1e-10 && (second[1] + 0.5).abs() < 1e-10);
    }

    #[test]
    fn names_what_is_wrong() {
        let mut normal = Normal::<2, 1>::default();
        normal.add([1.0, 1.0], [1.0], 1.0);
        assert_eq!(
            normal.solve().unwrap_err(),
            FitError::TooFew { have: 1, need: 2 }
        );
        normal.add([2.0, 2.0], [2.0], 1.0);
        normal.add([3.0, 3.0], [3.0], 1.0);
        assert!(matches!(
            normal.solve(),
            Err(FitError::IllConditioned { .. })
        ));
        normal.ridge(1e-3);
        assert!(normal.solve().is_ok());
    }

    #[test]
    fn variances_and_what_is_left_over_are_those_of_a_line() {
        let (mut normal, mut squares) = (Normal::<2, 1>::default(), 0.0);
        for (x, v) in [(-1.0, 1.1), (0.0, 1.9), (1.0, 3.1), (2.0, 3.9)] {
            normal.add([1.0, x], [v], 4.0);
            squares += 4.0 * v * v;
        }
        let (solution, _) = normal.solve().unwrap();
        // By hand: slope 0.96, intercept 2.02; residuals 0.04, -0.12, 0.12, -0.04.
        let [left] = normal.left_over(&solution, [squares]);
        assert!((left - 4.0 * 0.032).abs() < 1e-12, "{left}");
        let [constant, slope] = normal.variances();
        assert!((constant - 0.3 / 4.0).abs() < 1e-12 && (slope - 0.2 / 4.0).abs() < 1e-12);
    }

    #[test]
    fn roots_are_those_of_the_library() {
        for exponent in -300..300 {
            for mantissa in [1.0, 1.7, 2.0, 3.3, 9.9] {
                let value = mantissa * 10f64.powi(exponent);
                let error = square_root(value) / value.sqrt() - 1.0;
                assert!(error.abs() < 4e-16, "{value}: {error}");
            }
        }
        for none in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-320] {
            assert_eq!(square_root(none), 0.0);
        }
    }

    #[test]
    fn inverse_times_matrix_is_one() {
        let m = [[1.01, 0.02, -0.3], [0.4, 0.9, 0.0], [0.1, -0.2, 1.2]];
        let inverse = invert(m).unwrap();
        for axis in 0..3 {
            let mut unit = [0.0; 3];
            unit[axis] = 1.0;
            let back = times(&inverse, times(&m, unit));
            for (b, u) in back.iter().zip(unit) {
                assert!((b - u).abs() < 1e-12);
            }
        }
        assert!(invert([[1.0; 3]; 3]).is_none());
    }
}
