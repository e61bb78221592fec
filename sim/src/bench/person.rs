//! A person who puts the housing down in poses by hand.
//!
//! In: where the housing should point, and whether it was turned about the vertical. Out: where it
//! points: the surface is not level, a turn not quite half a circle, and what leans does so to some
//! degrees. Left out: a hand that shakes while the housing is let go of.

use crate::rng::Rng;

/// One person at one surface.
#[derive(Clone, Debug)]
pub struct Person {
    /// Tilt of the surface about two axes, deg.
    pub surface_deg: [f64; 2],
    /// What leaning poses are off, deg either side.
    pub lean_deg: f64,
    /// What a turn by 180 deg is off, deg either side.
    pub turn_deg: f64,
    rng: Rng,
}

impl Person {
    /// Somebody whose errors are drawn from `seed`.
    pub fn new(surface_deg: [f64; 2], lean_deg: f64, turn_deg: f64, seed: u64) -> Self {
        let rng = Rng::stream(seed, "person");
        Self {
            surface_deg,
            lean_deg,
            turn_deg,
            rng,
        }
    }

    /// What points up, in the housing's axes, when `up` was asked for, of any length: on a face
    /// where it lies along an axis, and leaning where it does not. `turned` means that the housing
    /// was to be turned by 180 deg on its surface.
    pub fn put(&mut self, up: [f64; 3], turned: bool) -> [f64; 3] {
        let face = up.iter().filter(|c| **c != 0.0).count() == 1;
        if !face {
            let lean = self.lean_deg.to_radians();
            return normal(normal(up).map(|c| c + self.rng.range(-1.0, 1.0) * lean));
        }
        let heading_deg = if turned {
            180.0 + self.rng.range(-self.turn_deg, self.turn_deg)
        } else {
            0.0
        };
        let (sin, cos) = heading_deg.to_radians().sin_cos();
        let [a, b] = self.surface_deg.map(|deg| deg.to_radians().sin());
        let (a, b) = (a * cos - b * sin, a * sin + b * cos);
        let axis = up.iter().position(|c| *c != 0.0).unwrap_or(0);
        let mut put = up;
        put[(axis + 1) % 3] = a;
        put[(axis + 2) % 3] = b;
        normal(put)
    }
}

fn normal(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    v.map(|c| c / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_two_poses_turned_by_half_a_circle_is_the_face() {
        let mut person = Person::new([0.4, -0.3], 5.0, 0.0, 1);
        let up = [0.0, 0.0, 1.0];
        let [one, other] = [false, true].map(|turned| person.put(up, turned));
        assert!(one[0].abs() > 0.004 && (one[0] + other[0]).abs() < 1e-12);
        assert!((one[1] + other[1]).abs() < 1e-12);
    }

    #[test]
    fn what_leans_does_so_to_its_degrees() {
        let mut person = Person::new([0.0; 2], 5.0, 2.0, 1);
        let off = (0..200).map(|_| {
            let [x, _, z] = person.put([1.0, 0.0, 1.0], false);
            (x.atan2(z).to_degrees() - 45.0).abs()
        });
        let largest = off.fold(0.0, f64::max);
        assert!((3.0..8.0).contains(&largest), "{largest}");
    }
}
