//! Fewer points for the same picture.
//!
//! In: any number of points. Out: the same points while there are at most [`MOST`]; else, for
//! each column of the picture, the least and the greatest value in the order in which they came,
//! so that every peak survives. Gaps stay gaps.

use super::ticks::{Range, drawable};

/// More points than this are thinned.
pub const MOST: usize = 2000;
/// Columns across the picture; at most two points and a gap remain of each.
pub const COLUMNS: usize = 500;

/// The points to draw; a point that cannot be drawn is a gap, `(0, NaN)`.
pub fn thin(points: &[(f64, f64)], x: Range) -> Vec<(f64, f64)> {
    let clean = points.iter().map(|&(x, y)| {
        if drawable(x) && drawable(y) {
            (x, y)
        } else {
            GAP
        }
    });
    if points.len() <= MOST {
        return clean.collect();
    }
    let mut out = Vec::with_capacity(3 * COLUMNS);
    let mut column: Option<Column> = None;
    for point in clean {
        let number = column_of(point, x);
        match &mut column {
            Some(open) if number == open.number => open.take(point),
            _ => {
                column
                    .take()
                    .into_iter()
                    .for_each(|done| done.finish(&mut out));
                column = Some(Column {
                    number,
                    least: point,
                    greatest: point,
                    least_first: true,
                });
            }
        }
    }
    column.into_iter().for_each(|done| done.finish(&mut out));
    out
}

/// Stands for an interruption of the line.
pub const GAP: (f64, f64) = (0.0, f64::NAN);

/// The column of a point; `None` for a gap.
fn column_of((x, y): (f64, f64), range: Range) -> Option<usize> {
    (!y.is_nan()).then(|| (range.share(x).clamp(0.0, 1.0) * COLUMNS as f64) as usize)
}

/// Neighbouring points that fall into the same column of the picture, or neighbouring gaps.
struct Column {
    number: Option<usize>,
    least: (f64, f64),
    greatest: (f64, f64),
    least_first: bool,
}

impl Column {
    fn take(&mut self, point: (f64, f64)) {
        if point.1 < self.least.1 {
            self.least = point;
            self.least_first = false;
        } else if point.1 > self.greatest.1 {
            self.greatest = point;
            self.least_first = true;
        }
    }

    fn finish(self, out: &mut Vec<(f64, f64)>) {
        let (first, second) = if self.least_first {
            (self.least, self.greatest)
        } else {
            (self.greatest, self.least)
        };
        out.push(first);
        if first != second && self.number.is_some() {
            out.push(second);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPAN: Range = Range {
        from: 0.0,
        to: 100_000.0,
    };

    #[test]
    fn a_short_line_is_left_alone() {
        let points: Vec<_> = (0..2000)
            .map(|i| (f64::from(i), f64::from(i % 7)))
            .collect();
        assert_eq!(thin(&points, SPAN), points);
    }

    #[test]
    fn a_long_line_keeps_its_peaks_in_order() {
        let mut points: Vec<_> = (0..100_000).map(|i| (f64::from(i), 0.0)).collect();
        points[50_010].1 = 7.0;
        points[50_020].1 = -3.0;
        points[70_001].1 = -5.0;
        points[70_002].1 = 5.0;
        let out = thin(&points, SPAN);
        assert!(out.len() <= 2 * COLUMNS + 2, "{}", out.len());
        assert!(out.windows(2).all(|pair| pair[0].0 < pair[1].0));
        for kept in [
            (50_010.0, 7.0),
            (50_020.0, -3.0),
            (70_001.0, -5.0),
            (70_002.0, 5.0),
        ] {
            assert!(out.contains(&kept), "{kept:?}");
        }
    }

    #[test]
    fn a_gap_survives_thinning() {
        let mut points: Vec<_> = (0..100_000).map(|i| (f64::from(i), 1.0)).collect();
        points[40_000..40_500]
            .iter_mut()
            .for_each(|point| point.1 = f64::NAN);
        points[90_000].0 = f64::INFINITY;
        let out = thin(&points, SPAN);
        assert_eq!(out.iter().filter(|point| point.1.is_nan()).count(), 2);
    }
}
