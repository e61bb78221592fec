//! The equations of turns, weighted, for numbers of which something is known beforehand.
//!
//! In: for each turn its lines and weight; what each number is near, with its standard deviation.
//! Out: the numbers with their standard uncertainties, and what they leave.
//!
//! Left out: which numbers these are, and which of them are plausible.

use super::super::FitError;
use super::super::least_squares::{Normal, square_root};
use super::{DEGREES, WORST_CONDITION};

/// Accumulates turns, for N numbers.
#[derive(Clone, Debug, Default)]
pub(super) struct Equations<const N: usize> {
    /// Three lines for each turn, of which two are independent.
    normal: Normal<N, 1>,
    /// Weighted sum of squares of the values.
    square: f64,
    /// Sum of the weights.
    weight: f64,
    turns: usize,
}

/// What the turns show.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solved<const N: usize> {
    pub(super) numbers: [f64; N],
    /// Standard uncertainty (k = 1) of each; that of before where the turns leave it open. It
    /// grows with the residual where that is above what the weights let expect.
    pub(super) uncertainty: [f64; N],
    /// Weighted root mean square of what is left in one direction of a turn's end, deg.
    pub(super) residual_rms_deg: f64,
    /// Condition figure of the turns with what was known before.
    pub(super) condition: f64,
}

impl<const N: usize> Equations<N> {
    /// Adds the lines of a turn: coefficients and value of each.
    pub(super) fn add(&mut self, lines: impl IntoIterator<Item = ([f64; N], f64)>, weight: f64) {
        for (row, value) in lines {
            self.normal.add(row, [value], weight);
            self.square += weight * value * value;
        }
        self.weight += weight;
        self.turns += 1;
    }

    /// How many turns there are.
    ///
    /// Errors: [`FitError::TooFew`] below `need`.
    pub(super) fn at_least(&self, need: usize) -> Result<usize, FitError> {
        match self.turns {
            have if have < need => Err(FitError::TooFew { have, need }),
            have => Ok(have),
        }
    }

    /// The numbers; `known` has what each is near, and the standard deviation from that.
    ///
    /// Errors: [`FitError::IllConditioned`] for numbers that no arithmetic copes with.
    pub(super) fn solve(&self, known: [(f64, f64); N]) -> Result<Solved<N>, FitError> {
        let with_known = self.with(known);
        let (solution, condition) = with_known.solve_within(WORST_CONDITION)?;
        let [left] = self.normal.left_over(&solution, [self.square]);
        let [numbers] = solution;
        let free = (2 * self.turns).saturating_sub(N).max(1) as f64;
        let grown = (left / free).max(1.0);
        let mut uncertainty = with_known.variances();
        for (own, (_, known)) in uncertainty.iter_mut().zip(known) {
            *own = square_root(*own * grown).min(known);
        }
        Ok(Solved {
            numbers,
            uncertainty,
            residual_rms_deg: square_root(left / (2.0 * self.weight)) * DEGREES,
            condition,
        })
    }

    /// One more observation for each number: that it is what it is near.
    fn with(&self, known: [(f64, f64); N]) -> Normal<N, 1> {
        let mut normal = self.normal.clone();
        for (n, (near, deviation)) in known.into_iter().enumerate() {
            let mut row = [0.0; N];
            if let Some(one) = row.get_mut(n) {
                *one = 1.0;
            }
            normal.add(row, [near], 1.0 / (deviation * deviation));
        }
        normal
    }
}
