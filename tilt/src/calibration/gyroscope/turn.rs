//! One turn between two rests, as equations for the gains of a gyroscope.
//!
//! In: the vertical before the turn, each sample of the rate during it, the vertical after it.
//! Out: a [`Turn`]. No sample is kept, so it does not matter how long a turn takes; a [`TurnSum`]
//! takes 400 bytes. A [`Rotation`] is the same without the verticals, for those who have them
//! later only.
//!
//! # How
//! The vertical u in the housing's axes follows u' = u x (M w). With the gains M0 assumed, the
//! rates w give a rotation C(t) from the axes at the start to those at the time t, and u = C u0.
//! A change dM of the gains turns the start by phi = sum of A_ij dM_ij with
//! A_ij = integral of C^T e_i w_j dt, so what comes back from the end is
//!
//! ```text
//! C^T after - before = (C^T after + before) / 2 x phi
//! ```
//!
//! Three equations of which two are independent. The mean of both verticals makes them right to
//! the second order where phi has one direction; where it changes they neglect half the square of
//! phi, which is 0.06 % of scale for an axis that is 2 deg off. So a turn that ends far from where
//! it was expected counts for less: the square of that angle is added to its standard deviation.
//!
//! # Errors of the integration
//! A sample is taken as the mean rate over its time. Each step is a rotation right to
//! angle^4 / 120 of itself (below 1e-9 up to 1 deg per sample), A_ij to angle^2 / 12 of itself
//! (3e-5), which the error of M0 multiplies.
//!
//! # What a turn shows
//! Turns of 90 and 180 deg about a level axis show most. A turn that comes back to its start by
//! the same path shows nothing: what was wrong on the way out is undone on the way back. After
//! 180 deg a rate of the wrong sign, or about another level axis, ends in the same place, so turns
//! of 90 deg belong to every calibration. Left out: heading, which gravity does not show.

use super::super::FitError;
use super::super::algebra::{cross, dot, minus};
use super::super::least_squares::{square_root, times};
use super::super::poses::{product, small_rotation};

/// cos 45 deg: a turn that ends further than that from where it was expected is another turn.
const WORST_END: f64 = core::f64::consts::FRAC_1_SQRT_2;

/// The longest way of a turn, summed over the axes, rad: two circles. deg/s taken as rad/s make
/// more of a turn of 13 deg, and all ends look alike after so many circles.
const LONGEST: f64 = 4.0 * core::f64::consts::PI;

/// Least sum of squares of a turn's coefficients, rad^2: that of a turn of about 6 deg.
const LEAST_SHOWN: f64 = 0.01;

/// The matrix that leaves a vector as it is.
pub(super) const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// The rotation by the rates of a turn with its derivative by the gains. The vertical takes no
/// part in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotation {
    /// M0: the gains that the rates are taken with.
    pub gains: [[f64; 3]; 3],
    /// C: from the axes at the start to the present ones.
    pub frame: [[f64; 3]; 3],
    /// A_ij, three numbers each, rad.
    pub sums: [[[f64; 3]; 3]; 3],
    /// The way so far, summed over the axes, rad.
    pub way: f64,
    /// How long it has taken, s.
    pub duration_s: f64,
}

/// A turn that goes on.
#[derive(Clone, Debug)]
pub struct TurnSum {
    before: [f64; 3],
    rotation: Rotation,
}

/// The equations of a turn for the gains M: `rows` times (M - 1) = `values`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Coefficients of the nine entries of M - 1, row by row, rad; one line for each axis.
    pub(super) rows: [[f64; 9]; 3],
    pub(super) values: [f64; 3],
    pub(super) duration_s: f64,
    /// Square of the angle between the end and where it was expected, rad^2: as large as what the
    /// equations neglect.
    pub(super) missed: f64,
}

impl TurnSum {
    /// Begins at rest, with `before` the vertical (up, length 1, housing's axes) by the calibrated
    /// accelerometer and `gains` the best M so far (M0): that of `GainFit::present`, or of an
    /// earlier pass.
    pub const fn new(before: [f64; 3], gains: [[f64; 3]; 3]) -> Self {
        let rotation = Rotation::new(gains);
        Self { before, rotation }
    }

    /// Adds a sample: the measured rate without its bias, rad/s along the sensor's axes, and for
    /// how long it stands, s. Some 150 products.
    pub fn sample(&mut self, rate: [f64; 3], dt_s: f64) {
        self.rotation.sample(rate, dt_s);
    }

    /// The vertical expected now, housing's axes; to be compared.
    pub fn expected(&self) -> [f64; 3] {
        self.rotation.expected(self.before)
    }

    /// Ends at rest, with `after` the vertical as in [`TurnSum::new`].
    ///
    /// Errors: those of [`Rotation::between`].
    pub fn finish(&self, after: [f64; 3]) -> Result<Turn, FitError> {
        self.rotation.between(self.before, after)
    }
}

impl Rotation {
    /// Begins at rest, with `gains` the best M so far (M0).
    pub const fn new(gains: [[f64; 3]; 3]) -> Self {
        Self {
            gains,
            frame: IDENTITY,
            sums: [[[0.0; 3]; 3]; 3],
            way: 0.0,
            duration_s: 0.0,
        }
    }

    /// Adds a sample as [`TurnSum::sample`] does.
    pub fn sample(&mut self, rate: [f64; 3], dt_s: f64) {
        let angle = rate.map(|w| w * dt_s);
        let turned = times(&self.gains, angle).map(|a| -a);
        let next = product(&step(turned), &self.frame);
        let rows = self.frame.iter().zip(&next);
        for (sums, (row, next)) in self.sums.iter_mut().zip(rows) {
            let middle = mean(*row, *next);
            for (sum, angle) in sums.iter_mut().zip(angle) {
                for (sum, m) in sum.iter_mut().zip(middle) {
                    *sum += m * angle;
                }
            }
        }
        self.frame = next;
        self.way += angle.iter().map(|a| a.abs()).sum::<f64>();
        self.duration_s += dt_s;
    }

    /// Where the vertical that was `before` is expected now, housing's axes.
    pub fn expected(&self, before: [f64; 3]) -> [f64; 3] {
        times(&self.frame, before)
    }

    /// The turn from rest to rest, with the vertical `before` and `after` it (up, length 1,
    /// housing's axes) by the calibrated accelerometer.
    ///
    /// Errors: [`FitError::Implausible`] when a vertical is not 0.9 to 1.1 long, the way is
    /// longer than two circles (summed over the axes), or the end is more than 45 deg from where
    /// the rates lead: wrong unit, sign or axes, or samples that are missing.
    /// [`FitError::IllConditioned`] when the turn shows next to nothing: no turn, or back by the
    /// same path.
    pub fn between(&self, before: [f64; 3], after: [f64; 3]) -> Result<Turn, FitError> {
        let (before, after) = (unit(before)?, unit(after)?);
        let back = turned_back(&self.frame, after);
        // What is no number is neither.
        let plausible = dot(back, before) > WORST_END && self.way < LONGEST;
        if !plausible {
            return Err(FitError::Implausible);
        }
        let turn = self.equations(before, back);
        let shown: f64 = turn.rows.iter().flatten().map(|c| c * c).sum();
        if shown < LEAST_SHOWN {
            let condition = 1.0 / shown;
            return Err(FitError::IllConditioned { condition });
        }
        Ok(turn)
    }

    /// Those of a turn from the vertical `before` to the one that, turned back, is `back`.
    fn equations(&self, before: [f64; 3], back: [f64; 3]) -> Turn {
        let values = minus(back, before);
        let mut turn = Turn {
            rows: [[0.0; 9]; 3],
            values,
            duration_s: self.duration_s,
            missed: dot(values, values),
        };
        let middle = mean(before, back);
        let assumed = minus_identity(&self.gains);
        let sums = self.sums.iter().flatten().zip(assumed.iter().flatten());
        for (n, (&sum, assumed)) in sums.enumerate() {
            let lines = turn.rows.iter_mut().zip(&mut turn.values);
            for ((row, value), coefficient) in lines.zip(cross(middle, sum)) {
                if let Some(cell) = row.get_mut(n) {
                    *cell = coefficient;
                }
                *value += coefficient * assumed;
            }
        }
        turn
    }
}

/// The rotation by the vector `w`, to |w|^4 / 120 of itself.
fn step(w: [f64; 3]) -> [[f64; 3]; 3] {
    // 2 tan(a / 2) = a (1 + a^2 / 12) undoes what the Cayley form lacks.
    let longer = 1.0 + dot(w, w) / 12.0;
    small_rotation(w.map(|v| v * longer))
}

/// `v` with length 1.
fn unit(v: [f64; 3]) -> Result<[f64; 3], FitError> {
    let length = square_root(dot(v, v));
    if (0.9..=1.1).contains(&length) {
        Ok(v.map(|v| v / length))
    } else {
        Err(FitError::Implausible)
    }
}

/// C^T v.
fn turned_back(frame: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    let ([[a, b, c], [d, e, f], [g, h, i]], [x, y, z]) = (*frame, v);
    [
        a * x + d * y + g * z,
        b * x + e * y + h * z,
        c * x + f * y + i * z,
    ]
}

/// M - 1.
pub(super) fn minus_identity(gains: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let [[a, b, c], [d, e, f], [g, h, i]] = *gains;
    [[a - 1.0, b, c], [d, e - 1.0, f], [g, h, i - 1.0]]
}

fn mean([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [(ax + bx) / 2.0, (ay + by) / 2.0, (az + bz) / 2.0]
}
