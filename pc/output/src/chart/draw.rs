//! From a chart to SVG elements.
//!
//! In: a chart and the ranges of its data. Out: one `svg` element.

use std::fmt::Write;

use super::bars;
use super::data::{Chart, Ink, Plot, Shape};
use super::frame::{ABOVE, Frame, SIZE};
use super::thin::{self, thin};
use super::ticks::{Range, drawable};
use crate::html::escape;

/// The drawing.
pub fn svg(chart: &Chart, x: Range, y: Range) -> String {
    let frame = Frame::new(chart, x, y);
    let id = escape(&chart.id);
    let mut out = format!(
        "<svg role=\"img\" viewBox=\"0 0 {} {}\" aria-labelledby=\"{id}-t {id}-d\">\
         <title id=\"{id}-t\">{}</title><desc id=\"{id}-d\">{}</desc>",
        SIZE.0,
        SIZE.1,
        escape(&chart.title),
        escape(&chart.description)
    );
    push_shaded(chart, &frame, &mut out);
    push_axes(chart, &frame, &mut out);
    bars::push(chart, &frame, &mut out);
    for plot in &chart.plots {
        push_plot(plot, &frame, &mut out);
    }
    push_levels(chart, &frame, &mut out);
    push_level_names(chart, &frame, &mut out);
    out.push_str("</svg>");
    out
}

fn push_shaded(chart: &Chart, frame: &Frame, out: &mut String) {
    for &(from, to) in &chart.shaded {
        if !drawable(from) || !drawable(to) || to < frame.x.from || from > frame.x.to {
            continue;
        }
        let (left, right) = (frame.x(from.max(frame.x.from)), frame.x(to.min(frame.x.to)));
        let (width, height) = ((right - left).max(1.0), frame.bottom() - ABOVE);
        let _ = write!(
            out,
            "<rect class=\"shaded\" x=\"{left:.1}\" y=\"{ABOVE}\" width=\"{width:.1}\" \
             height=\"{height}\"/>"
        );
    }
}

fn push_axes(chart: &Chart, frame: &Frame, out: &mut String) {
    let (left, right, bottom) = (frame.left, frame.right(), frame.bottom());
    for tick in &frame.y_ticks {
        let y = frame.y(tick.at);
        let class = if tick.at.abs() < 1e-12 {
            "zero"
        } else {
            "grid"
        };
        let _ = write!(
            out,
            "<path class=\"{class}\" d=\"M{left:.1} {y:.1}H{right:.1}\"/>\
             <text class=\"tick end\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            left - 6.0,
            y + 4.5,
            tick.label
        );
    }
    for tick in &frame.x_ticks {
        let x = frame.x(tick.at);
        let _ = write!(
            out,
            "<path class=\"axis\" d=\"M{x:.1} {bottom:.1}v4\"/>\
             <text class=\"tick mid\" x=\"{x:.1}\" y=\"{:.1}\">{}</text>",
            bottom + 20.0,
            escape(&tick.label)
        );
    }
    let _ = write!(
        out,
        "<path class=\"axis\" d=\"M{left:.1} {bottom:.1}H{right:.1}\"/>\
         <text class=\"name\" x=\"4\" y=\"16\">{}</text>\
         <text class=\"name end\" x=\"{right:.1}\" y=\"{:.1}\">{}</text>",
        escape(&chart.y_label),
        SIZE.1 - 7.0,
        escape(&chart.x_label)
    );
}

fn push_levels(chart: &Chart, frame: &Frame, out: &mut String) {
    for level in chart.levels.iter().filter(|level| drawable(level.at)) {
        let (left, right, y) = (frame.left, frame.right(), frame.y(level.at));
        let _ = write!(
            out,
            "<path class=\"level\" d=\"M{left:.1} {y:.1}H{right:.1}\"/>"
        );
    }
}

/// The names of the levels come last, above the data; a name that would run into the one before
/// it is left out.
fn push_level_names(chart: &Chart, frame: &Frame, out: &mut String) {
    let mut taken: Vec<f64> = Vec::new();
    for level in chart.levels.iter().filter(|level| drawable(level.at)) {
        // Below zero the name hangs under its line, clear of the data between the levels, unless
        // there is no room left above the axis.
        let line = frame.y(level.at);
        let hangs = level.at < 0.0 && line + 20.0 < frame.bottom();
        let y = line + if hangs { 15.0 } else { -5.0 };
        if taken.iter().any(|other| (other - y).abs() < 17.0) || level.name.is_empty() {
            continue;
        }
        taken.push(y);
        let _ = write!(
            out,
            "<text class=\"name end halo\" x=\"{:.1}\" y=\"{y:.1}\">{}</text>",
            frame.right() - 3.0,
            escape(&level.name)
        );
    }
}

fn push_plot(plot: &Plot, frame: &Frame, out: &mut String) {
    let class = plot.ink.class();
    match &plot.shape {
        Shape::Line(points) => {
            let path = line_path(&thin(points, frame.x), frame);
            let _ = write!(out, "<path class=\"line {class}\" d=\"{path}\"/>");
        }
        Shape::Markers(points) => {
            let points = thin(points, frame.x);
            let path = line_path(&points, frame);
            let marks: String = points
                .iter()
                .filter(|point| !point.1.is_nan())
                .map(|point| marker(plot.ink, frame.x(point.0), frame.y(point.1)))
                .collect();
            let _ = write!(
                out,
                "<path class=\"line thin {class}\" d=\"{path}\"/>\
                 <path class=\"mark {class}\" d=\"{marks}\"/>"
            );
        }
        Shape::Band(bins) => {
            let path = band_path(bins, frame);
            let _ = write!(out, "<path class=\"band {class}\" d=\"{path}\"/>");
        }
        Shape::Bars(_) => {}
    }
}

/// Lines from the first of these points through the others.
fn go_through<'a>(path: &mut String, points: impl Iterator<Item = &'a (f64, f64)>, frame: &Frame) {
    for (index, (x, y)) in points.enumerate() {
        let command = if index == 0 { 'M' } else { 'L' };
        let _ = write!(path, "{command}{:.1} {:.1}", frame.x(*x), frame.y(*y));
    }
}

/// Lines through the points, interrupted at gaps; a lone point becomes a dot.
fn line_path(points: &[(f64, f64)], frame: &Frame) -> String {
    let mut path = String::new();
    for run in points.split(|point| point.1.is_nan()) {
        go_through(&mut path, run.iter(), frame);
        if run.len() == 1 {
            path.push_str("h0");
        }
    }
    path
}

/// The area between least and greatest, closed at each gap.
fn band_path(bins: &[(f64, f64, f64)], frame: &Frame) -> String {
    let most: Vec<_> = bins.iter().map(|bin| (bin.0, bin.2)).collect();
    let least: Vec<_> = bins.iter().map(|bin| (bin.0, bin.1)).collect();
    let (most, least) = (
        band_edge(&most, &least, frame),
        band_edge(&least, &most, frame),
    );
    let mut path = String::new();
    let upper = most.split(|point| point.1.is_nan());
    for (upper, lower) in upper.zip(least.split(|point| point.1.is_nan())) {
        go_through(&mut path, upper.iter().chain(lower.iter().rev()), frame);
        if !upper.is_empty() {
            path.push('Z');
        }
    }
    path
}

/// One edge of a band with the gaps of both edges, so that the two stay alike.
fn band_edge(edge: &[(f64, f64)], other: &[(f64, f64)], frame: &Frame) -> Vec<(f64, f64)> {
    let both = edge.iter().zip(other).map(
        |(point, other)| {
            if drawable(other.1) { *point } else { thin::GAP }
        },
    );
    thin(&both.collect::<Vec<_>>(), frame.x)
}

/// A marker around a place, as a closed path.
fn marker(ink: Ink, x: f64, y: f64) -> String {
    match ink {
        Ink::First => {
            format!(
                "M{:.1} {y:.1}a3.4 3.4 0 1 0 6.8 0a3.4 3.4 0 1 0 -6.8 0Z",
                x - 3.4
            )
        }
        Ink::Second => format!("M{:.1} {y:.1}l4.8 -4.8 4.8 4.8 -4.8 4.8Z", x - 4.8),
        Ink::Reference | Ink::Other => {
            format!("M{:.1} {:.1}h6v6h-6Z", x - 3.0, y - 3.0)
        }
    }
}

/// The entry of one series in the legend, drawn as the series is.
pub fn legend_entry(plot: &Plot) -> String {
    let class = plot.ink.class();
    let key = match plot.shape {
        Shape::Line(_) => format!("<path class=\"line {class}\" d=\"M1 7H27\"/>"),
        Shape::Markers(_) => {
            let mark = marker(plot.ink, 14.0, 7.0);
            let line = format!("<path class=\"line thin {class}\" d=\"M1 7H27\"/>");
            format!("{line}<path class=\"mark {class}\" d=\"{mark}\"/>")
        }
        Shape::Bars(_) => {
            format!("<rect class=\"bar {class}\" x=\"7\" width=\"14\" height=\"14\"/>")
        }
        Shape::Band(_) => format!("<path class=\"band {class}\" d=\"M1 2H27V12H1Z\"/>"),
    };
    let view = "<svg class=\"key\" viewBox=\"0 0 28 14\" aria-hidden=\"true\">";
    format!("<li>{view}{key}</svg>{}</li>", escape(&plot.name))
}
