//! Grouped bars.
//!
//! In: the bar series of a chart and its frame. Out: rectangles from zero to each value, series
//! side by side at each place, and the values written above while there are few. A value that
//! would be written over its neighbour's moves up.

use std::fmt::Write;

use super::data::Chart;
use super::frame::{Frame, slot};
use crate::table::format_number;

/// Bars get their value written above them up to this many.
const MOST_LABELS: usize = 16;
/// Width of a digit and height of a line of the labels.
const DIGIT: f64 = 8.5;
const LINE: f64 = 15.0;

/// Draws all bars, then their values.
pub fn push(chart: &Chart, frame: &Frame, out: &mut String) {
    let series = chart.bars();
    let group = 0.8 * (frame.x(slot(chart)) - frame.x(0.0));
    let width = group / series.len().max(1) as f64;
    let mut labels = Vec::new();
    for (number, (ink, points)) in series.iter().enumerate() {
        for &(at, value) in points {
            let left = frame.x(at) - 0.5 * group + width * number as f64;
            let (zero, top) = (frame.y(0.0), frame.y(value));
            let (upper, height) = (zero.min(top), (zero - top).abs().max(1.0));
            let _ = write!(
                out,
                "<rect class=\"bar {}\" x=\"{left:.1}\" y=\"{upper:.1}\" width=\"{:.1}\" \
                 height=\"{height:.1}\"/>",
                ink.class(),
                (width - 1.0).max(0.5)
            );
            labels.push(Label::new(left + 0.5 * width, upper - 4.0, value));
        }
    }
    if labels.len() <= MOST_LABELS {
        push_labels(labels, out);
    }
}

/// A value written above its bar.
struct Label {
    middle: f64,
    half: f64,
    y: f64,
    text: String,
}

impl Label {
    fn new(middle: f64, y: f64, value: f64) -> Self {
        let text = format_number(Some(value), if value.fract() == 0.0 { 0 } else { 2 });
        Self {
            middle,
            half: 0.5 * DIGIT * text.chars().count() as f64,
            y,
            text,
        }
    }

    fn hits(&self, other: &Self) -> bool {
        (self.middle - other.middle).abs() < self.half + other.half
            && (self.y - other.y).abs() < LINE
    }
}

fn push_labels(labels: Vec<Label>, out: &mut String) {
    let mut placed: Vec<Label> = Vec::new();
    for mut label in labels {
        // Each step up clears one placed label, so as many steps as labels are enough.
        for _ in 0..placed.len() {
            let Some(other) = placed.iter().find(|other| label.hits(other)) else {
                break;
            };
            label.y = other.y - LINE;
        }
        let _ = write!(
            out,
            "<text class=\"count mid\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            label.middle, label.y, label.text
        );
        placed.push(label);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_equal_neighbours_are_not_written_over_each_other() {
        let labels = (0..4).map(|i| Label::new(100.0 + 20.0 * f64::from(i), 50.0, 36_500.0));
        let mut out = String::new();
        push_labels(labels.collect(), &mut out);
        let heights: Vec<&str> = out
            .split(" y=\"")
            .skip(1)
            .map(|rest| rest.split('"').next().unwrap())
            .collect();
        assert_eq!(heights, ["50.0", "35.0", "20.0", "50.0"]);
    }

    #[test]
    fn values_that_fit_stay_above_their_bars() {
        let labels = (0..3).map(|i| Label::new(100.0 + 20.0 * f64::from(i), 50.0, 3.0));
        let mut out = String::new();
        push_labels(labels.collect(), &mut out);
        assert_eq!(out.matches("y=\"50.0\"").count(), 3);
    }
}
