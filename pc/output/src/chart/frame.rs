//! Where the values of a chart stand in its drawing.
//!
//! In: a chart and the ranges of its data. Out: the plot area with its ticks, and the place of a
//! value in it. Lengths are units of the view box; the text is larger on narrow screens (the style
//! sheet does that), so the margins leave room for 17 units.

use super::data::{Chart, Shape};
use super::ticks::{Range, Tick, nice_step, ticks};
use crate::table::format_number;

/// Width and height of the view box.
pub const SIZE: (f64, f64) = (520.0, 306.0);
/// Margins above, right of and below the plot; the left one fits the labels.
pub const ABOVE: f64 = 36.0;
const RIGHT: f64 = 20.0;
const BELOW: f64 = 50.0;
/// Space that one character of a tick label may take.
const CHARACTER: f64 = 9.5;
/// At most this many places of bars are labelled.
const MOST_BAR_TICKS: usize = 12;

/// The plot area and its ranges.
pub struct Frame {
    /// The left edge of the plot area.
    pub left: f64,
    /// What the horizontal axis spans.
    pub x: Range,
    y: Range,
    /// The ticks of the horizontal axis.
    pub x_ticks: Vec<Tick>,
    /// The ticks of the vertical axis.
    pub y_ticks: Vec<Tick>,
}

impl Frame {
    /// The frame of a chart with these ranges of its data.
    pub fn new(chart: &Chart, x: Range, y: Range) -> Self {
        let y = chart.y_range.map_or(y, |range| range.join(y)).widened();
        let step = nice_step(y, 5);
        let y = y.to_multiples(step);
        let x = padded(chart, x).widened();
        let y_ticks = ticks(y, step);
        let longest = y_ticks.iter().map(|tick| tick.label.chars().count()).max();
        let left = 14.0 + CHARACTER * longest.unwrap_or(1) as f64;
        Self {
            left,
            x,
            y,
            x_ticks: x_ticks(chart, x),
            y_ticks,
        }
    }

    /// The right edge of the plot area.
    pub fn right(&self) -> f64 {
        SIZE.0 - RIGHT
    }

    /// The lower edge of the plot area.
    pub fn bottom(&self) -> f64 {
        SIZE.1 - BELOW
    }

    /// Place of a value on the horizontal axis.
    pub fn x(&self, value: f64) -> f64 {
        self.left + self.x.share(value) * (self.right() - self.left)
    }

    /// Place of a value on the vertical axis.
    pub fn y(&self, value: f64) -> f64 {
        self.bottom() - self.y.share(value) * (self.bottom() - ABOVE)
    }
}

/// Bars need half a slot at each end, markers a little air; lines fill the width.
fn padded(chart: &Chart, x: Range) -> Range {
    let has = |wanted: fn(&Shape) -> bool| chart.plots.iter().any(|plot| wanted(&plot.shape));
    let air = if chart.x_range.is_some() {
        0.0
    } else if has(|shape| matches!(shape, Shape::Bars(_))) {
        0.5 * slot(chart)
    } else if has(|shape| matches!(shape, Shape::Markers(_))) {
        0.03 * (x.to - x.from)
    } else {
        0.0
    };
    Range {
        from: x.from - air,
        to: x.to + air,
    }
}

/// Names where there are any. Bars are labelled at their own places; other axes get round ticks.
fn x_ticks(chart: &Chart, x: Range) -> Vec<Tick> {
    if !chart.x_names.is_empty() {
        let named = chart
            .x_names
            .iter()
            .filter(|(at, _)| (x.from..=x.to).contains(at));
        return named
            .map(|(at, name)| Tick {
                at: *at,
                label: name.clone(),
            })
            .collect();
    }
    let places = places(chart);
    if places.is_empty() || chart.x_ticks_are_round {
        let many = |step: f64| (x.to - x.from) / step > 12.0;
        let step = chart.x_step.filter(|step| *step > 0.0 && !many(*step));
        return ticks(x, step.unwrap_or_else(|| nice_step(x, 6)));
    }
    let every = places.len().div_ceil(MOST_BAR_TICKS);
    let labelled = places.into_iter().step_by(every);
    labelled
        .map(|at| Tick {
            at,
            label: format_number(Some(at), 0),
        })
        .collect()
}

/// Where bars stand, in order, each place once.
fn places(chart: &Chart) -> Vec<f64> {
    let points = chart.bars().into_iter().flat_map(|(_, points)| points);
    let mut places: Vec<f64> = points.map(|point| point.0).collect();
    places.sort_by(f64::total_cmp);
    places.dedup();
    places
}

/// Width of one group: the least distance between two places, 1 when there is only one.
pub fn slot(chart: &Chart) -> f64 {
    let places = places(chart);
    let steps = places.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    steps
        .reduce(f64::min)
        .map_or(1.0, |step| step.clamp(1e-3, 1e6))
}
