//! Points and bins: what a figure is drawn from.
//!
//! In: samples as they come, any number of them. Out: a bounded list of points or of bins that
//! hold the least and the greatest value, so that a report of three hours is no larger than one
//! of three minutes. Absent values are `None` and are written as `null`; a number that is not
//! finite never gets into a series. Drawing is left to the chart module.

use serde::{Deserialize, Serialize};

/// The greatest number of bins that a report keeps per series.
pub const MAX_BINS: usize = 600;

/// One point, written as `[x, y]`; `None` (`null`) is a gap.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point(pub f64, pub Option<f64>);

/// One bin, written as `[x, min, max]`: middle of the bin, least and greatest value seen in it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bin(pub f64, pub f64, pub f64);

/// The value to six decimals, which is finer than any figure means and keeps a report small.
pub fn rounded(value: f64) -> f64 {
    let shifted = value * 1e6;
    // Beyond this the value has no such decimals, and the product might not be finite.
    if shifted.abs() < 1e15 {
        shifted.round() / 1e6
    } else {
        value
    }
}

/// The value when it is finite, else `None`.
pub fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Points from `(x, y)` pairs. A pair whose x is not finite is left out, a y that is not finite
/// becomes a gap. Both are rounded to six decimals.
pub fn points(pairs: impl IntoIterator<Item = (f64, f64)>) -> Vec<Point> {
    let placed = pairs.into_iter().filter(|(x, _)| x.is_finite());
    placed
        .map(|(x, y)| Point(rounded(x), finite(y).map(rounded)))
        .collect()
}

/// Collects samples into equal bins over a span that is known beforehand; its memory does not
/// grow with the number of samples.
#[derive(Clone, Debug)]
pub struct Binner {
    from: f64,
    width: f64,
    bins: Vec<Option<(f64, f64)>>,
}

impl Binner {
    /// Bins over `from..=to`, between 1 and [`MAX_BINS`] of them. A span that is empty or not
    /// finite gets width 1, so that samples still have a place.
    pub fn new(from: f64, to: f64, bins: usize) -> Self {
        let bins = bins.clamp(1, MAX_BINS);
        let from = finite(from).unwrap_or(0.0);
        let width = finite((to - from) / bins as f64)
            .filter(|width| *width > 0.0)
            .unwrap_or(1.0);
        Self {
            from,
            width,
            bins: vec![None; bins],
        }
    }

    /// Takes one sample. A sample that is not finite, or lies outside the span, is left out.
    pub fn push(&mut self, x: f64, y: f64) {
        let place = (x - self.from) / self.width;
        // The end of the span belongs to the last bin.
        let last = self.bins.len();
        let outside = !y.is_finite() || !(0.0..=last as f64).contains(&place);
        if outside {
            return;
        }
        if let Some(bin) = self.bins.get_mut((place as usize).min(last - 1)) {
            let (min, max) = bin.unwrap_or((y, y));
            *bin = Some((min.min(y), max.max(y)));
        }
    }

    /// The bins that saw a sample, in order of x, rounded to six decimals.
    pub fn finish(self) -> Vec<Bin> {
        let middle = |index: usize| rounded(self.from + (index as f64 + 0.5) * self.width);
        let seen = self.bins.iter().enumerate();
        seen.filter_map(|(i, bin)| bin.map(|(min, max)| Bin(middle(i), rounded(min), rounded(max))))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_null_and_a_point_without_place_is_left_out() {
        let made = points([(0.0, 1.0), (1.0, f64::NAN), (f64::INFINITY, 2.0)]);
        assert_eq!(
            serde_json::to_string(&made).unwrap(),
            "[[0.0,1.0],[1.0,null]]"
        );
    }

    #[test]
    fn three_hours_at_50_hz_stay_within_the_bound_and_keep_the_extremes() {
        let mut binner = Binner::new(0.0, 10_800.0, 10_000);
        for i in 0..540_000 {
            binner.push(f64::from(i) / 50.0, if i == 123_456 { 9.7 } else { -0.01 });
        }
        let bins = binner.finish();
        assert_eq!(bins.len(), MAX_BINS);
        assert!(bins.windows(2).all(|pair| pair[0].0 < pair[1].0));
        let peak = bins
            .iter()
            .find(|bin| bin.2 == 9.7)
            .expect("the peak is kept");
        assert_eq!(peak.1, -0.01);
        assert!((peak.0 - 123_456.0 / 50.0).abs() <= 9.0);
    }

    #[test]
    fn the_ends_of_the_span_count_and_what_lies_outside_does_not() {
        let mut binner = Binner::new(-1.0, 1.0, 4);
        for x in [-1.0, 1.0, -1.001, 1.001, f64::NAN] {
            binner.push(x, x);
        }
        binner.push(0.1, f64::NAN);
        assert_eq!(
            binner.finish(),
            [Bin(-0.75, -1.0, -1.0), Bin(0.75, 1.0, 1.0)]
        );
    }

    #[test]
    fn six_decimals_are_kept() {
        assert_eq!(rounded(0.123_456_789), 0.123_457);
        assert_eq!(rounded(1e300), 1e300);
        assert!(rounded(f64::NAN).is_nan());
    }

    #[test]
    fn an_empty_span_still_takes_samples() {
        let mut binner = Binner::new(5.0, 5.0, 3);
        binner.push(5.0, 2.0);
        assert_eq!(binner.finish(), [Bin(5.5, 2.0, 2.0)]);
    }
}
