//! The twelve-parameter correction: scale, axis directions, mounting and zero-g offset at once.
//!
//! In: [`Compensated`] acceleration in the part's axes. Out: [`Corrected`] acceleration in the
//! housing's axes, 2^-26 g per step, one g long when the instrument stands still. Fitting the
//! twelve numbers is `calibration`'s business.

use crate::saturate::saturate;
use crate::temperature::Compensated;

/// Acceleration in the housing's frame, 2^-26 g per step, calibrated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Corrected {
    /// Along the housing's x, y and z axes.
    pub accel: [i32; 3],
}

/// An affine map from the part's axes to the housing's: matrix times input plus offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vector {
    /// Row i gives housing axis i; 2^-30 per step, so entries are under 2 in size.
    pub matrix: [[i32; 3]; 3],
    /// Added after the product; 2^-26 g per step.
    pub offset: [i32; 3],
}

impl Vector {
    /// Leaves the input as it is.
    pub const IDENTITY: Self = Self {
        matrix: [[1 << 30, 0, 0], [0, 1 << 30, 0], [0, 0, 1 << 30]],
        offset: [0; 3],
    };

    /// From real numbers: matrix in g per g, offset in g.
    ///
    /// `None` when an entry is not finite, is 2 g/g or more, or an offset is 2 g or more.
    pub fn from_real(matrix: [[f64; 3]; 3], offset_g: [f64; 3]) -> Option<Self> {
        let fits = |v: &f64| v.abs() < 2.0;
        if !matrix.iter().flatten().all(fits) || !offset_g.iter().all(fits) {
            return None;
        }
        Some(Self {
            matrix: matrix.map(|row| row.map(|v| (v * 1_073_741_824.0) as i32)),
            offset: offset_g.map(|v| (v * f64::from(crate::ONE_G)) as i32),
        })
    }

    /// Applies the correction; saturates at +-32 g.
    pub fn apply(&self, input: Compensated) -> Corrected {
        let mut accel = self.offset;
        let [x, y, z] = input.accel;
        // Below 16 g three products fit into 64 bits and need no saturating.
        let small = [x, y, z].iter().all(|v| v.unsigned_abs() < 1 << 30);
        for (out, row) in accel.iter_mut().zip(&self.matrix) {
            let [a, b, c] = *row;
            let product = |c: i32, v: i32| i64::from(c) * i64::from(v);
            let [a, b, c] = [product(a, x), product(b, y), product(c, z)];
            let sum = if small {
                a + b + c + (1 << 29)
            } else {
                let sum = a.saturating_add(b).saturating_add(c);
                sum.saturating_add(1 << 29)
            };
            let total = (sum >> 30) + i64::from(*out);
            *out = saturate(total);
        }
        Corrected { accel }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ONE_G;

    #[test]
    fn identity_is_identity() {
        let input = Compensated {
            accel: [ONE_G, -5, 7],
        };
        assert_eq!(Vector::IDENTITY.apply(input).accel, input.accel);
    }

    #[test]
    fn matches_real_arithmetic_to_a_step() {
        let m = [
            [1.01, 0.02, -0.01],
            [0.015, 0.98, 0.03],
            [-0.02, 0.01, 1.005],
        ];
        let b = [0.02, -0.031, 0.005];
        let v = Vector::from_real(m, b).unwrap();
        let a = [0.6, -0.7, 0.4];
        let got = v.apply(Compensated {
            accel: a.map(|v| (v * f64::from(ONE_G)) as i32),
        });
        for i in 0..3 {
            let want = m[i].iter().zip(a).map(|(c, a)| c * a).sum::<f64>() + b[i];
            assert!((f64::from(got.accel[i]) - want * f64::from(ONE_G)).abs() < 3.0);
        }
    }

    #[test]
    fn refuses_what_does_not_fit_and_saturates() {
        assert!(Vector::from_real([[2.0, 0.0, 0.0]; 3], [0.0; 3]).is_none());
        assert!(Vector::from_real([[f64::NAN, 0.0, 0.0]; 3], [0.0; 3]).is_none());
        let all = Vector {
            matrix: [[i32::MAX; 3]; 3],
            offset: [i32::MAX; 3],
        };
        assert_eq!(
            all.apply(Compensated {
                accel: [i32::MAX; 3]
            })
            .accel,
            [i32::MAX; 3]
        );
        assert_eq!(
            all.apply(Compensated {
                accel: [i32::MIN; 3]
            })
            .accel,
            [i32::MIN; 3]
        );
    }
}
