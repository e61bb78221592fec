//! The two charts: the slopes of one axis, and their difference with its band.
//!
//! In: points. Out: axes that hold them with some room, and the charts. A and B have different
//! marks as well as colours.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType, LegendPosition};

use super::picture::{Picture, Points};
use super::screen::Screen;

/// The least height of the slopes' axis, deg.
const LEAST_DEG: f64 = 0.2;

/// The least half height of the difference's axis, deg.
const LEAST_DIFFERENCE_DEG: f64 = 0.05;

/// The lowest and highest value that an axis needs, with a tenth of room at either end.
fn bounds(lines: &[&Points], least: f64) -> [f64; 2] {
    let values = || {
        lines
            .iter()
            .flat_map(|points| points.iter())
            .map(|(_, y)| *y)
    };
    let low = values().fold(f64::INFINITY, f64::min);
    let high = values().fold(f64::NEG_INFINITY, f64::max);
    if low > high {
        return [-least / 2.0, least / 2.0];
    }
    let middle = f64::midpoint(low, high);
    let half = ((high - low) * 0.6).max(least / 2.0);
    [middle - half, middle + half]
}

/// The bounds of the difference: as far above zero as below.
fn bounds_around_zero(points: &Points, band: Option<f64>) -> [f64; 2] {
    let far = points.iter().map(|(_, y)| y.abs()).fold(0.0, f64::max);
    let half = (far * 1.1)
        .max(band.unwrap_or(0.0) * 1.3)
        .max(LEAST_DIFFERENCE_DEG);
    [-half, half]
}

/// Draws both.
pub fn draw(frame: &mut Frame, area: Rect, picture: &Picture, screen: &Screen) {
    if area.height < 4 {
        return;
    }
    let halves = Layout::horizontal([Constraint::Percentage(56), Constraint::Fill(1)]);
    let [left, right] = halves.areas(area);
    let axis = screen.axis & 1;
    let name = if axis == 0 { "X" } else { "Y" };
    let [a, b] = [&picture.lines[axis], &picture.lines[2 + axis]];
    // A's finer marks go over those of B.
    let slopes = [
        dataset("B", b, Marker::Dot, Color::Yellow, screen),
        dataset("A", a, Marker::Braille, Color::Cyan, screen),
    ];
    let title = format!(" slope {name}, deg, last {} s ", screen.span_s());
    let y = bounds(&[a, b], LEAST_DEG);
    frame.render_widget(chart(slopes.to_vec(), title, y, screen), left);
    let instrument = picture.snapshot.instruments.get(screen.instrument);
    let band = instrument.and_then(|one| one.band_deg);
    let difference = &picture.lines[4 + axis];
    let span = -(screen.span_s() as f64);
    let edges = band.map(|band| [-band, band].map(|y| vec![(span, y), (0.0, y)]));
    let mut sets = vec![dataset(
        "A-B",
        difference,
        Marker::Braille,
        Color::Reset,
        screen,
    )];
    for edge in edges.iter().flatten() {
        let line = dataset("", edge, Marker::Dot, Color::DarkGray, screen);
        sets.push(line.graph_type(GraphType::Line));
    }
    let title = match band {
        Some(_) => format!(" A-B in {name}, deg, and its band "),
        None => format!(" A-B in {name}, deg "),
    };
    let y = bounds_around_zero(difference, band);
    frame.render_widget(chart(sets, title, y, screen), right);
}

fn dataset<'a>(
    name: &'a str,
    points: &'a Points,
    marker: Marker,
    colour: Color,
    screen: &Screen,
) -> Dataset<'a> {
    let style = if screen.colours {
        Style::default().fg(colour)
    } else {
        Style::default()
    };
    let set = Dataset::default()
        .marker(marker)
        .graph_type(GraphType::Scatter)
        .style(style)
        .data(points);
    if name.is_empty() { set } else { set.name(name) }
}

fn chart<'a>(sets: Vec<Dataset<'a>>, title: String, y: [f64; 2], screen: &Screen) -> Chart<'a> {
    let span = screen.span_s() as f64;
    let [low, high] = y;
    // Two values that read the same would be no scale.
    let places = if high - low < 0.5 { 3 } else { 2 };
    let label = |value: f64| Line::from(format!("{value:+.places$}"));
    Chart::new(sets)
        .block(Block::bordered().title(title))
        .x_axis(Axis::default().bounds([-span, 0.0]))
        .y_axis(Axis::default().bounds(y).labels([
            label(low),
            label(f64::midpoint(low, high)),
            label(high),
        ]))
        .legend_position(Some(LegendPosition::TopLeft))
        .hidden_legend_constraints((Constraint::Fill(1), Constraint::Fill(1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_holds_its_points_with_room_and_a_level_one_has_a_height() {
        let points = vec![(-1.0, 10.0), (0.0, 20.0)];
        let [low, high] = bounds(&[&points], LEAST_DEG);
        assert!(low < 10.0 && high > 20.0 && high - low < 13.0);
        let level = vec![(0.0, 5.0)];
        let [low, high] = bounds(&[&level], LEAST_DEG);
        assert!((low - 4.9).abs() < 1e-9 && (high - 5.1).abs() < 1e-9);
        assert_eq!(bounds(&[&Vec::new()], 1.0), [-0.5, 0.5]);
    }

    #[test]
    fn the_difference_lies_around_zero_with_its_band_in_sight() {
        let points = vec![(0.0, -0.02)];
        assert_eq!(bounds_around_zero(&points, None), [-0.05, 0.05]);
        let [low, high] = bounds_around_zero(&points, Some(0.1));
        assert!(low < -0.1 && high > 0.1);
    }
}
