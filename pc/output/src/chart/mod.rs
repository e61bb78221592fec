//! Line, marker, bar and band charts as inline SVG.
//!
//! In: series of plain numbers in the unit that the axis names. Out: a piece of HTML, a `figure`
//! with title, legend and drawing, which takes its colours from the style sheet of the page and
//! scales with the width it is given. Values that are not finite, or beyond 1e12, are gaps; a
//! chart without any value is a sentence that says so. No script and no interaction.

mod bars;
mod draw;
mod thin;
mod ticks;

use super::html::escape;
pub use ticks::Range;

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
    fn class(self) -> &'static str {
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
                .filter(|p| ticks::drawable(p.1))
                .map(|p| p.0)
                .collect(),
            Shape::Band(bins) => {
                let seen = bins
                    .iter()
                    .filter(|b| ticks::drawable(b.1) && ticks::drawable(b.2));
                seen.map(|bin| bin.0).collect()
            }
        }
    }

    /// All y that have a place; bars also reach to zero.
    fn ys(&self) -> Vec<f64> {
        let placed = |x: f64| ticks::drawable(x);
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
    fn x_extent(&self) -> Option<Range> {
        let data = Range::of(self.plots.iter().flat_map(Plot::xs))?;
        let wanted = self.x_range.and_then(|(from, to)| Range::of([from, to]));
        Some(wanted.map_or(data, |wanted| wanted.join(data)))
    }

    /// The chart as a `figure`.
    pub fn html(&self) -> String {
        let title = escape(&self.title);
        let body = match (self.x_extent(), self.y_extent()) {
            (Some(x), Some(y)) => format!("{}{}", self.legend(), draw::svg(self, x, y)),
            _ => "<p class=\"empty\">No data: this was not run or gave no value.</p>".to_owned(),
        };
        format!("<figure class=\"chart\"><h4>{title}</h4>{body}</figure>\n")
    }

    /// The legend as a list above the drawing, where it can wrap; none for a single series.
    fn legend(&self) -> String {
        let shaded = !self.shaded.is_empty();
        if self.plots.len() < 2 && !shaded {
            return String::new();
        }
        let mut entries: String = self.plots.iter().map(draw::legend_entry).collect();
        if shaded {
            let key = "<svg class=\"key\" viewBox=\"0 0 28 14\" aria-hidden=\"true\">\
                <rect class=\"shaded\" width=\"28\" height=\"14\"/></svg>";
            entries.push_str(&format!("<li>{key}{}</li>", escape(&self.shaded_name)));
        }
        format!("<ul class=\"legend\">{entries}</ul>")
    }
}

/// Gives charts that stand beside each other the same vertical range.
pub fn share_y(charts: &mut [Chart]) {
    let extents = charts.iter().filter_map(Chart::y_extent);
    let joined = extents.reduce(Range::join);
    charts.iter_mut().for_each(|chart| chart.y_range = joined);
}

#[cfg(test)]
mod tests;
