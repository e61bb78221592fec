//! Turning the second channel onto the first, whatever a fault did to some of the standstills.
//!
//! In: both fits, and the mean readings of both channels over the standstills that they share.
//! Out: [`Aligned`]. Gravity's length leaves the mounting open, so two channels on one board must
//! be brought into one frame before their angles can be compared. A least-squares rotation over
//! all standstills would share out a fault between the good part and the bad one, and the
//! cross-check would then accuse the whole recording. So the rotation that most of the standstills
//! agree on is looked for first, and the rest is left out.

use tilt::calibration::algebra::cross;
use tilt::calibration::least_squares::times;

use super::calibrate::{FEWEST_PLATEAUS, Fit, align};
use super::error::CalibrateError;
use super::reference::angle_between_deg;
use super::rotation::best_rotation;
use super::windows::quantile;

/// Mean readings of both channels over one standstill: the second channel's, then the first's.
pub type Pair = ([f64; 3], [f64; 3]);

/// The second channel in the first one's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Aligned {
    /// The turned fit.
    pub fit: Fit,
    /// Standstills used.
    pub used: usize,
    /// Standstills left out, because they contradict the others.
    pub left_out: usize,
    /// Root mean square angle that is left between the channels over those used, deg.
    pub left_deg: f64,
    /// Median over all standstills, deg.
    pub median_deg: f64,
}

/// Angles left that are this small contradict nothing, deg.
const ALIKE_DEG: f64 = 0.25;

/// Times the median angle left that a standstill may be off.
const MOST_MEDIANS: f64 = 4.0;

/// More standstills than this are thinned out before pairs of them are tried.
const MOST_TRIED: usize = 60;

/// Two directions this close to one line don't fix a rotation, deg.
const LEAST_SPREAD_DEG: f64 = 20.0;

/// Turns `fit` so that most of the `pairs` agree with `other`.
pub fn align_robustly(fit: &Fit, other: &Fit, pairs: &[Pair]) -> Result<Aligned, CalibrateError> {
    let seen: Vec<Pair> = pairs
        .iter()
        .map(|(a, b)| (fit.apply(*a), other.apply(*b)))
        .collect();
    let Some((rotation, median_deg)) = most_agreed(&seen) else {
        // Too few or too alike: the plain fit reports which directions are missing.
        let plain = align(fit, other, pairs)?;
        return Ok(all_used(plain, pairs.len()));
    };
    let limit = ALIKE_DEG.max(MOST_MEDIANS * median_deg);
    let agrees = |pair: &Pair| left_deg(&rotation, pair) <= limit;
    let kept: Vec<Pair> = pairs
        .iter()
        .zip(&seen)
        .filter(|(_, seen)| agrees(seen))
        .map(|(pair, _)| *pair)
        .collect();
    let turned = align(fit, other, &kept)?;
    Ok(Aligned {
        left_out: pairs.len() - kept.len(),
        median_deg,
        ..all_used(turned, kept.len())
    })
}

fn all_used(turned: Fit, used: usize) -> Aligned {
    let left_deg = turned.angle_residual_deg.unwrap_or(0.0);
    Aligned {
        fit: turned,
        used,
        left_out: 0,
        left_deg,
        median_deg: left_deg,
    }
}

fn left_deg(rotation: &[[f64; 3]; 3], pair: &Pair) -> f64 {
    angle_between_deg(times(rotation, pair.0), pair.1)
}

/// Of the rotations that two standstills each give, the one with the smallest median angle left.
fn most_agreed(seen: &[Pair]) -> Option<([[f64; 3]; 3], f64)> {
    if seen.len() < FEWEST_PLATEAUS {
        return None;
    }
    let tried: Vec<&Pair> = seen
        .iter()
        .step_by(seen.len().div_ceil(MOST_TRIED))
        .collect();
    let mut best: Option<([[f64; 3]; 3], f64)> = None;
    for (i, one) in tried.iter().enumerate() {
        for two in tried.iter().skip(i + 1) {
            let Some(rotation) = rotation_of_two(one, two) else {
                continue;
            };
            let lefts = seen.iter().map(|pair| left_deg(&rotation, pair)).collect();
            let median = quantile(lefts, 0.5)?;
            if best.is_none_or(|(_, least)| median < least) {
                best = Some((rotation, median));
            }
        }
    }
    best
}

fn rotation_of_two(one: &Pair, two: &Pair) -> Option<[[f64; 3]; 3]> {
    let apart = angle_between_deg(one.0, two.0);
    if !(LEAST_SPREAD_DEG..=180.0 - LEAST_SPREAD_DEG).contains(&apart) {
        return None;
    }
    let from = [one.0, two.0, cross(one.0, two.0)];
    let to = [one.1, two.1, cross(one.1, two.1)];
    Some(best_rotation(&from, &to).rotation)
}

#[cfg(test)]
mod tests {
    use super::super::calibration_file::Method;
    use super::super::windows::norm;
    use super::*;

    const PLAIN: Fit = Fit {
        method: Method::Poses,
        ..Fit::IDENTITY
    };

    fn about_z(v: [f64; 3], deg: f64) -> [f64; 3] {
        let (s, c) = deg.to_radians().sin_cos();
        [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]
    }

    fn about_x(v: [f64; 3], deg: f64) -> [f64; 3] {
        let (s, c) = deg.to_radians().sin_cos();
        [v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]]
    }

    /// Directions over the sphere, seen by two sensors 30 deg apart; `late` ones by a second
    /// sensor that has slipped by another degree.
    fn pairs(count: usize, late: usize) -> Vec<Pair> {
        (0..count)
            .map(|i| {
                let (a, b) = (i as f64 * 2.4, (i as f64 + 0.5) / count as f64 * 2.0 - 1.0);
                let flat = (1.0 - b * b).sqrt();
                let truth = [flat * a.cos(), flat * a.sin(), b];
                let seen = about_z(truth, -30.0);
                let slipped = i + late >= count;
                (if slipped { about_x(seen, 1.0) } else { seen }, truth)
            })
            .collect()
    }

    #[test]
    fn a_slip_in_the_last_third_does_not_turn_the_rest() {
        let aligned = align_robustly(&PLAIN, &PLAIN, &pairs(21, 7)).unwrap();
        // A direction along the axis of the slip does not move, so fewer than seven are left out.
        assert!((4..=7).contains(&aligned.left_out), "{aligned:?}");
        assert!(aligned.left_deg < 0.1, "{}", aligned.left_deg);
        let turned = aligned.fit.apply(about_z([0.6, 0.0, 0.8], -30.0));
        assert!(angle_between_deg(turned, [0.6, 0.0, 0.8]) < 0.1);
        let plain = align(&PLAIN, &PLAIN, &pairs(21, 7)).unwrap();
        let shared = plain.apply(about_z([0.6, 0.0, 0.8], -30.0));
        assert!(angle_between_deg(shared, [0.6, 0.0, 0.8]) > 0.2);
    }

    #[test]
    fn all_are_used_where_nothing_contradicts() {
        let aligned = align_robustly(&PLAIN, &PLAIN, &pairs(12, 0)).unwrap();
        assert_eq!((aligned.used, aligned.left_out), (12, 0));
        assert!((norm(aligned.fit.apply([0.0, 0.0, 1.0])) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn too_few_or_all_on_one_line_is_refused() {
        let few = align_robustly(&PLAIN, &PLAIN, &pairs(2, 0));
        assert!(matches!(few, Err(CalibrateError::TooFew { have: 2, .. })));
        let up = ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]);
        let alike = align_robustly(&PLAIN, &PLAIN, &[up; 5]);
        assert!(matches!(alike, Err(CalibrateError::IllConditioned { .. })));
    }
}
