//! How well plateaus come back from one run of a path to the next: for tests on real recordings.

use super::calibrate::{Fit, rms};
use super::reference::{angle_between_deg, slopes_deg};
use super::segments::Segment;

/// Plateaus of two runs of the same path, paired in order by the reference's attitude.
///
/// The attitudes (or up vectors, where the reference gives no more) must agree within 5 deg. A
/// plateau that only one of the runs shows is passed over.
pub fn matching(one: &[Segment], other: &[Segment]) -> Vec<(Segment, Segment)> {
    let alike = |a: &Segment, b: &Segment| match (a.reference, b.reference) {
        (Some(a), Some(b)) => match (a.attitude, b.attitude) {
            (Some(a), Some(b)) => a.angle_to_deg(&b) < 5.0,
            _ => angle_between_deg(a.up, b.up) < 5.0,
        },
        _ => false,
    };
    let mut pairs = Vec::new();
    let mut next = 0;
    for a in one {
        let rest = other.iter().enumerate().skip(next);
        if let Some((i, b)) = rest.into_iter().find(|(_, b)| alike(a, b)) {
            pairs.push((*a, *b));
            next = i + 1;
        }
    }
    pairs
}

/// How well slopes come back: root mean square over both slopes of all pairs, deg.
pub fn repeatability_deg(fit: &Fit, pairs: &[(Segment, Segment)]) -> f64 {
    rms(pairs.iter().flat_map(|(a, b)| {
        let (a, b) = (
            slopes_deg(fit.apply(a.mean_g)),
            slopes_deg(fit.apply(b.mean_g)),
        );
        [a[0] - b[0], a[1] - b[1]]
    }))
}
