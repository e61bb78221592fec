//! Line, marker, bar and band charts as inline SVG.
//!
//! In: series of plain numbers in the unit that the axis names. Out: a piece of HTML, a `figure`
//! with title, legend and drawing, which takes its colours from the style sheet of the page and
//! scales with the width it is given. Values that are not finite, or beyond 1e12, are gaps; a
//! chart without any value is a sentence that states this. No script and no interaction.

mod bars;
mod data;
mod draw;
mod frame;
mod thin;
mod ticks;

use super::html::escape;
pub use data::{Chart, Ink, Level, Plot, Shape};
pub use ticks::Range;

impl Chart {
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
