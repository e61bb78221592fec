//! The true attitude by a recording's reference columns.
//!
//! In: a quaternion (body to world) or slopes in degrees. Out: the up vector in the body's frame,
//! which is what an ideal accelerometer at rest reads in g: (0, 0, 1) when level.

use tilt::calibration::algebra::{cross, dot};

use super::windows::norm;

/// An attitude as a unit quaternion, body to world. A quaternion and its negative are the same
/// attitude; nothing here depends on which of the two a recording gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude {
    quaternion: [f64; 4],
}

impl Attitude {
    /// From w, x, y, z; `None` when the length is further than 10 % from 1.
    pub fn new(quaternion: [f64; 4]) -> Option<Self> {
        let length = quaternion.iter().map(|c| c * c).sum::<f64>().sqrt();
        let is_one = (length - 1.0).abs() < 0.1;
        is_one.then(|| Self {
            quaternion: quaternion.map(|c| c / length),
        })
    }

    /// The up vector in the body's frame: the third row of the rotation matrix.
    pub fn up(&self) -> [f64; 3] {
        let [w, x, y, z] = self.quaternion;
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ]
    }

    /// The angle of the rotation that leads from the other attitude to this one, 0 to 180 deg.
    #[cfg(test)]
    pub fn angle_to_deg(&self, other: &Self) -> f64 {
        let dot: f64 = self
            .quaternion
            .iter()
            .zip(other.quaternion)
            .map(|(a, b)| a * b)
            .sum();
        2.0 * dot.abs().min(1.0).acos().to_degrees()
    }
}

/// The reference in one row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reference {
    /// A whole attitude.
    Attitude(Attitude),
    /// Slope X and slope Y in degrees, as far as they are given.
    Slopes([Option<f64>; 2]),
}

impl Reference {
    /// The up vector in the body's frame.
    ///
    /// Two slopes leave open whether the housing lies on its back; it is taken not to. `None`
    /// when one slope is missing or the two contradict each other.
    pub fn up(&self) -> Option<[f64; 3]> {
        match self {
            Self::Attitude(attitude) => Some(attitude.up()),
            Self::Slopes([Some(x), Some(y)]) => {
                let (x, y) = (x.to_radians().sin(), y.to_radians().sin());
                let square = 1.0 - x * x - y * y;
                (square > -1e-6).then(|| [x, y, square.max(0.0).sqrt()])
            }
            Self::Slopes(_) => None,
        }
    }

    /// Slope X and slope Y in degrees, as far as they are known.
    pub fn slopes_deg(&self) -> [Option<f64>; 2] {
        match self {
            Self::Attitude(attitude) => slopes_deg(attitude.up()).map(Some),
            Self::Slopes(slopes) => *slopes,
        }
    }
}

/// Slope X = atan2(x, hypot(y, z)) and slope Y = atan2(y, hypot(x, z)) of an up vector.
pub fn slopes_deg(up: [f64; 3]) -> [f64; 2] {
    let [x, y, z] = up;
    [
        x.atan2(y.hypot(z)).to_degrees(),
        y.atan2(x.hypot(z)).to_degrees(),
    ]
}

/// The angle between two vectors, 0 to 180 deg.
pub fn angle_between_deg(a: [f64; 3], b: [f64; 3]) -> f64 {
    norm(cross(a, b)).atan2(dot(a, b)).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quaternion_and_its_negative_are_one_attitude() {
        let half = 15f64.to_radians();
        let q = [half.cos(), 0.0, -half.sin(), 0.0];
        let one = Attitude::new(q).unwrap();
        let other = Attitude::new(q.map(|c| -c)).unwrap();
        assert!(one.angle_to_deg(&other) < 1e-6);
        assert!(angle_between_deg(one.up(), other.up()) < 1e-9);
        // 30 deg about -y lifts x by sin 30.
        let slopes = Reference::Attitude(one).slopes_deg();
        assert!((slopes[0].unwrap() - 30.0).abs() < 1e-9 && slopes[1].unwrap().abs() < 1e-9);
        let level = Attitude::new([1.0, 0.0, 0.0, 0.0]).unwrap();
        assert!((one.angle_to_deg(&level) - 30.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_attitude_is_refused() {
        for q in [
            [0.0; 4],
            [f64::NAN; 4],
            [2.0, 0.0, 0.0, 0.0],
            [f64::INFINITY; 4],
        ] {
            assert_eq!(Attitude::new(q), None);
        }
        assert_eq!(Reference::Slopes([Some(80.0), Some(80.0)]).up(), None);
        assert_eq!(Reference::Slopes([Some(80.0), None]).up(), None);
    }

    #[test]
    fn slopes_and_up_vector_agree() {
        let up = Reference::Slopes([Some(20.0), Some(-35.0)]).up().unwrap();
        assert!((norm(up) - 1.0).abs() < 1e-12);
        let [x, y] = slopes_deg(up);
        assert!((x - 20.0).abs() < 1e-9 && (y + 35.0).abs() < 1e-9);
        assert!((angle_between_deg(up, up.map(|c| -c)) - 180.0).abs() < 1e-9);
    }
}
