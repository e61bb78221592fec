//! What a chart is made of.
//!
//! In: series of plain numbers with their names and colours. Out: the chart, the ranges of its data
//! and its bars.
//!
//! Left out: how it is drawn.

use super::ticks::{Range, drawable};

/// Colour and marker of a series; the style sheet holds the colours for light and dark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ink {
    /// Node or channel 1; a filled circle.
    First,
    /// Node or channel 2; an open diamond.
    Second,
    /// The reference; a broad grey line, to be drawn first.
    Reference,
    /// Something else; a square.
    Other,
}

impl Ink {
    /// Class in the style sheet.
    pub(super) fn class(self) -> &'static str {
        match self {
            Self::First => "ink1",
            Self::Second => "ink2",
            Self::Reference => "ink0",
            Self::Other => "ink3",
        }
    }
}

/// How a series is drawn, and from what.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A line through `(x, y)`.
    Line(Vec<(f64, f64)>),
    /// A marker at each `(x, y)`, joined by a thin line.
    Markers(Vec<(f64, f64)>),
    /// A bar from zero to y at each `(x, y)`; series of bars stand side by side.
    Bars(Vec<(f64, f64)>),
    /// The area between min and max of each `(x, min, max)`.
    Band(Vec<(f64, f64, f64)>),
}

/// One series.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Its name in the legend.
    pub name: String,
    /// Its colour.
    pub ink: Ink,
    /// Its data.
    pub shape: Shape,
}

impl Plot {
    /// A series of this name.
    pub fn new(name: impl Into<String>, ink: Ink, shape: Shape) -> Self {
        Self {
            name: name.into(),
            ink,
            shape,
        }
    }

    /// All x that have a value.
    fn xs(&self) -> Vec<f64> {
        match &self.shape {
            Shape::Line(points) | Shape::Markers(points) | Shape::Bars(points) => points
                .iter()
                .filter(|p| drawable(p.1))
                .map(|p| p.0)
                .collect(),
            Shape::Band(bins) => {
                let seen = bins.iter().filter(|b| drawable(b.1) && drawable(b.2));
                seen.map(|bin| bin.0).collect()
            }
        }
    }

    /// All y that have a place; bars also reach to zero.
    fn ys(&self) -> Vec<f64> {
        let placed = |x: f64| drawable(x);
        match &self.shape {
            Shape::Line(points) | Shape::Markers(points) => {
                points.iter().filter(|p| placed(p.0)).map(|p| p.1).collect()
            }
            Shape::Bars(points) => points
                .iter()
                .filter(|p| placed(p.0))
                .flat_map(|p| [0.0, p.1])
                .collect(),
            Shape::Band(bins) => bins
                .iter()
                .filter(|b| placed(b.0))
                .flat_map(|b| [b.1, b.2])
                .collect(),
        }
    }
}

/// A horizontal line such as a limit.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// Where, in the unit of y.
    pub at: f64,
    /// What it is.
    pub name: String,
}

/// A chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Name of the chart within its page; letters, digits and `-`.
    pub id: String,
    /// Stands above it.
    pub title: String,
    /// What a reader who does not see it should know.
    pub description: String,
    /// Name and unit of the horizontal axis.
    pub x_label: String,
    /// Name and unit of the vertical axis.
    pub y_label: String,
    /// The series, drawn in this order.
    pub plots: Vec<Plot>,
    /// Limits.
    pub levels: Vec<Level>,
    /// Stretches of x that are shaded.
    pub shaded: Vec<(f64, f64)>,
    /// What the shading means.
    pub shaded_name: String,
    /// Distance of the ticks on the horizontal axis; `None` for a round one that fits.
    pub x_step: Option<f64>,
    /// Ticks with names of their own in place of numbers, such as days; none for numbers.
    pub x_names: Vec<(f64, String)>,
    /// Horizontal range that the chart must show.
    pub x_range: Option<(f64, f64)>,
    /// Round ticks below bars, which else are labelled at their own places.
    pub x_ticks_are_round: bool,
    /// Vertical range that the chart must show; for charts that are to be compared.
    pub y_range: Option<Range>,
}

impl Chart {
    /// The vertical range of data and levels; `None` without data.
    pub fn y_extent(&self) -> Option<Range> {
        let data = Range::of(self.plots.iter().flat_map(Plot::ys))?;
        Range::of(
            self.levels
                .iter()
                .map(|level| level.at)
                .chain([data.from, data.to]),
        )
    }

    /// The horizontal range of the data; `None` without data.
    pub(super) fn x_extent(&self) -> Option<Range> {
        let data = Range::of(self.plots.iter().flat_map(Plot::xs))?;
        let wanted = self.x_range.and_then(|(from, to)| Range::of([from, to]));
        Some(wanted.map_or(data, |wanted| wanted.join(data)))
    }

    /// The series of bars: colour and points that can be drawn.
    pub(super) fn bars(&self) -> Vec<(Ink, Vec<(f64, f64)>)> {
        let seen = |points: &[(f64, f64)]| {
            let points = points
                .iter()
                .filter(|point| drawable(point.0) && drawable(point.1));
            points.copied().collect()
        };
        let of = self.plots.iter().filter_map(|plot| match &plot.shape {
            Shape::Bars(points) => Some((plot.ink, seen(points))),
            _ => None,
        });
        of.collect()
    }
}
