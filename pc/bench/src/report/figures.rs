//! The paper's figures 14 to 18, 20 and 21 as charts.
//!
//! In: a [`DemoReport`]. Out: one group of charts per figure, paper mode beside product mode on
//! the same vertical scale, with a caption that says what is to be seen. Figures 1 to 13 and 19
//! are drawings and photographs, so they have no counterpart here.

use sim::bench::published::DAYS;
use sim::bench::week::{FAULT_DAY, HEALTHY_DEG};

use super::data::*;
use super::tables::{axis_name, mode_name, modes};
use output::chart::{Chart, Ink, Level, Plot, Shape, share_y};
use output::series::{Bin, Point};

/// Charts that belong together.
pub struct Group {
    /// Which figure of the paper, and what it shows.
    pub title: String,
    /// What the reader sees.
    pub caption: String,
    /// The charts, in reading order.
    pub charts: Vec<Chart>,
}

/// Tolerance of one channel, deg (paper IV.A).
const TOLERANCE_DEG: f64 = 0.20;
/// Threshold of the cross-check, deg (paper IV.A).
const THRESHOLD_DEG: f64 = 0.40;

/// Points for the chart; an absent value becomes NaN there, which is a gap.
pub fn pairs(points: &[Point]) -> Vec<(f64, f64)> {
    points
        .iter()
        .map(|point| (point.0, point.1.unwrap_or(f64::NAN)))
        .collect()
}

/// Bins for the chart, x divided by `divisor`.
pub fn band(bins: &[Bin], divisor: f64) -> Shape {
    Shape::Band(
        bins.iter()
            .map(|bin| (bin.0 / divisor, bin.1, bin.2))
            .collect(),
    )
}

/// A limit and its mirror image.
pub fn both_signs(limit_deg: f64) -> Vec<Level> {
    let level = |at: f64, sign: &str| Level {
        at,
        name: format!("{sign}{limit_deg:.2} deg"),
    };
    vec![level(limit_deg, "+"), level(-limit_deg, "\u{2212}")]
}

/// Colour of a node or channel.
pub fn ink_of(node: u8) -> Ink {
    match node {
        1 => Ink::First,
        2 => Ink::Second,
        _ => Ink::Other,
    }
}

/// Figures 14 to 16.
pub fn static_test(report: &DemoReport) -> Vec<Group> {
    vec![
        static_error(report, Axis::X, 14),
        static_error(report, Axis::Y, 15),
        static_delta(report),
    ]
}

/// The mode's word as part of an identifier.
fn id_of(mode: Mode) -> String {
    word(mode).replace(' ', "-")
}

fn static_error(report: &DemoReport, axis: Axis, figure: u32) -> Group {
    let name = axis_name(axis);
    let chart = |mode: Mode| {
        let curves = report.figures.static_error.iter();
        let plots = curves
            .filter(|curve| curve.mode == mode && curve.axis == axis)
            .map(node_plot);
        Chart {
            id: format!("f{figure}-{}", id_of(mode)),
            title: mode_name(mode).to_owned(),
            description: format!(
                "Error of both nodes on axis {name} at every 10 degrees, {}, against the \
                 tolerance of 0.20 degrees.",
                mode_name(mode).to_lowercase()
            ),
            x_label: "reference angle, deg".to_owned(),
            x_step: Some(30.0),
            y_label: "angle \u{2212} reference, deg".to_owned(),
            plots: plots.collect(),
            levels: both_signs(TOLERANCE_DEG),
            ..Chart::default()
        }
    };
    Group {
        title: format!("Figure {figure}: error on axis {name}, static"),
        caption: "Each marker is one standstill on a calibration angle. The paper draws absolute \
                  values; here the sign is kept. The dashed lines are the tolerance of one \
                  channel. A single axis loses its sensitivity towards 90 deg, which paper mode \
                  shows at both ends."
            .to_owned(),
        charts: alike(modes(report).into_iter().map(chart).collect()),
    }
}

fn node_plot(curve: &Curve) -> Plot {
    let node = curve.node.unwrap_or(0);
    let name = curve
        .node
        .map_or("Both".to_owned(), |node| format!("Node {node}"));
    Plot::new(name, ink_of(node), Shape::Markers(pairs(&curve.points)))
}

fn alike(mut charts: Vec<Chart>) -> Vec<Chart> {
    share_y(&mut charts);
    charts
}

fn static_delta(report: &DemoReport) -> Group {
    let chart = |mode: Mode| {
        let curves = report
            .figures
            .static_delta
            .iter()
            .filter(|curve| curve.mode == mode);
        let plot = |curve: &Curve| {
            let ink = if curve.axis == Axis::X {
                Ink::First
            } else {
                Ink::Second
            };
            let name = format!("Axis {}", axis_name(curve.axis));
            Plot::new(name, ink, Shape::Markers(pairs(&curve.points)))
        };
        Chart {
            id: format!("f16-{}", id_of(mode)),
            title: mode_name(mode).to_owned(),
            description: "Difference of the two nodes over the angle, both axes.".to_owned(),
            x_label: "reference angle, deg".to_owned(),
            x_step: Some(30.0),
            y_label: "node 1 \u{2212} node 2, deg".to_owned(),
            plots: curves.map(plot).collect(),
            levels: both_signs(THRESHOLD_DEG),
            ..Chart::default()
        }
    };
    Group {
        title: "Figure 16: difference of the two nodes, static".to_owned(),
        caption: "The difference at each standstill, as in the cross-check. Errors that both \
         nodes share, such as that of the reference, cancel here and remain undetected. The \
         dashed lines are the warning threshold."
            .to_owned(),
        charts: alike(modes(report).into_iter().map(chart).collect()),
    }
}

/// Figures 17 and 18.
pub fn dynamic_test(report: &DemoReport) -> Vec<Group> {
    vec![dynamic(report, Axis::X, 17), dynamic(report, Axis::Y, 18)]
}

fn dynamic(report: &DemoReport, axis: Axis, figure: u32) -> Group {
    let find = |mode: Mode| {
        let mut traces = report.figures.dynamic.iter();
        traces.find(|trace| trace.mode == mode && trace.axis == axis)
    };
    let of = |part: DynamicPart| {
        modes(report)
            .into_iter()
            .map(|mode| dynamic_chart(find(mode), mode, figure, part))
            .collect()
    };
    let mut charts = alike(of(DynamicPart::Angle));
    charts.extend(alike(of(DynamicPart::Error)));
    charts.extend(alike(of(DynamicPart::Aligned)));
    Group {
        title: format!(
            "Figure {figure}: motion at 80 deg/s on axis {}",
            axis_name(axis)
        ),
        caption: "The beginning of the dynamic test without lever arm. First the angles, then \
                  what separates them from the reference: as they arrive, which is mostly the \
                  delay of the filter, and with the declared latency taken off."
            .to_owned(),
        charts,
    }
}

/// The three charts of a dynamic figure.
#[derive(Clone, Copy, PartialEq, Eq)]
enum DynamicPart {
    Angle,
    Error,
    Aligned,
}

impl DynamicPart {
    /// Name for the id, title, label of y.
    fn words(self) -> (&'static str, &'static str, &'static str) {
        match self {
            Self::Angle => ("angle", "angle", "angle, deg"),
            Self::Error => (
                "error",
                "error as it arrives",
                "angle \u{2212} reference, deg",
            ),
            Self::Aligned => ("aligned", "error aligned", "angle \u{2212} reference, deg"),
        }
    }

    fn points(self, trace: &NodeTrace) -> &[Point] {
        match self {
            Self::Angle => &trace.angle,
            Self::Error => &trace.error,
            Self::Aligned => &trace.error_aligned,
        }
    }
}

fn dynamic_chart(
    trace: Option<&DynamicTrace>,
    mode: Mode,
    figure: u32,
    part: DynamicPart,
) -> Chart {
    let (id, title, y_label) = part.words();
    let mut plots = Vec::new();
    if let Some(trace) = trace {
        if part == DynamicPart::Angle {
            let shape = Shape::Line(pairs(&trace.reference));
            plots.push(Plot::new("Motor", Ink::Reference, shape));
        }
        plots.extend(trace.nodes.iter().map(|node| {
            let name = format!("Node {}", node.node);
            Plot::new(
                name,
                ink_of(node.node),
                Shape::Line(pairs(part.points(node))),
            )
        }));
    }
    let limited = part == DynamicPart::Aligned;
    Chart {
        id: format!("f{figure}-{id}-{}", id_of(mode)),
        title: format!("{}: {title}", mode_name(mode)),
        description: format!("{title} of both nodes over time during the motion of the motor."),
        x_label: "time, s".to_owned(),
        y_label: y_label.to_owned(),
        plots,
        levels: if limited {
            both_signs(TOLERANCE_DEG)
        } else {
            Vec::new()
        },
        ..Chart::default()
    }
}

/// Figures 20 and 21.
pub fn week(report: &DemoReport) -> Vec<Group> {
    vec![per_day(report), delta(report)]
}

/// The faults that the paper reports of the days of this run: one, on the day of the unstable
/// supply (section VII, Fig 20).
fn published_faults(report: &DemoReport) -> Option<Plot> {
    let dug = report.week.iter().map(|row| row.day).max()?;
    let faults = |day| f64::from(u8::from(day == FAULT_DAY));
    let days = (1..=dug.min(DAYS)).map(|day| (f64::from(day), faults(day)));
    let bars = Shape::Bars(days.collect());
    Some(Plot::new("Published", Ink::Reference, bars))
}

fn per_day(report: &DemoReport) -> Group {
    let chart = |title: &str, id: &str, published, count: fn(&WeekRow) -> u64| {
        let bars = |mode: Mode| {
            let rows = report.week.iter().filter(|row| row.mode == mode);
            let points = rows
                .map(|row| (f64::from(row.day), count(row) as f64))
                .collect();
            let ink = match mode {
                Mode::Paper => Ink::Other,
                Mode::AsPrinted => Ink::Second,
                Mode::Product => Ink::First,
            };
            Plot::new(mode_name(mode), ink, Shape::Bars(points))
        };
        // Without a single day there is nothing to draw, not even empty series.
        let modes = modes(report)
            .into_iter()
            .filter(|mode| report.week.iter().any(|row| row.mode == *mode));
        Chart {
            id: format!("f20-{id}"),
            title: title.to_owned(),
            description: format!("{title}, each mode; the table above holds the numbers."),
            x_label: "day".to_owned(),
            y_label: "count".to_owned(),
            plots: Option::into_iter(published)
                .chain(modes.map(bars))
                .collect(),
            ..Chart::default()
        }
    };
    Group {
        title: "Figure 20: errors per day on the excavator".to_owned(),
        caption: "The supply of one node becomes unstable on day 5. A warning is one compared \
         pair above the threshold; a fault is reported to the user. Published are the paper's own \
         seven days, for which it reports the fault of day 5 and no number of warnings."
            .to_owned(),
        charts: vec![
            chart("Warnings per day", "warnings", None, |row| row.warnings),
            chart(
                "Faults per day",
                "faults",
                published_faults(report),
                |row| row.faults,
            ),
        ],
    }
}

fn delta(report: &DemoReport) -> Group {
    let traces = report.figures.delta.iter();
    let chart = |trace: &DeltaTrace| Chart {
        id: format!("f21-{}-{}", id_of(trace.mode), trace.day),
        title: format!("{}, day {}", mode_name(trace.mode), trace.day),
        description: "Difference of the two nodes during the day with the unstable supply: least \
                      and greatest value per bin."
            .to_owned(),
        x_label: "time, min".to_owned(),
        y_label: "node 1 \u{2212} node 2, deg".to_owned(),
        plots: vec![Plot::new("Difference", Ink::First, band(&trace.bins, 60.0))],
        levels: [THRESHOLD_DEG, HEALTHY_DEG].map(both_signs).concat(),
        ..Chart::default()
    };
    Group {
        title: "Figure 21: difference of the two nodes on the day of the fault".to_owned(),
        caption: "The area spans the least and the greatest difference in each stretch of time. A \
                  healthy pair stays between the dashed threshold lines; an unstable supply shows \
                  as bursts beyond them. Published: below 0.20 deg while the supply is good, then \
                  differences above 0.40 deg again and again for ten minutes, 10 deg at most."
            .to_owned(),
        charts: alike(traces.map(chart).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;

    #[test]
    fn every_figure_of_the_paper_is_there_in_both_modes() {
        let report = sample::demo();
        let groups: Vec<Group> = [static_test(&report), dynamic_test(&report), week(&report)]
            .into_iter()
            .flatten()
            .collect();
        let titles: String = groups.iter().map(|group| group.title.as_str()).collect();
        for figure in [14, 15, 16, 17, 18, 20, 21] {
            assert!(titles.contains(&format!("Figure {figure}:")), "{figure}");
        }
        for chart in groups.iter().flat_map(|group| &group.charts) {
            assert!(chart.html().contains("<svg role=\"img\""), "{}", chart.id);
        }
    }

    #[test]
    fn modes_are_drawn_on_the_same_scale() {
        for group in static_test(&sample::demo()) {
            assert!(group.charts[0].y_range.is_some());
            assert_eq!(group.charts[0].y_range, group.charts[1].y_range);
        }
    }

    #[test]
    fn an_absent_value_is_a_gap_and_not_a_zero() {
        let mut report = sample::demo();
        report.figures.static_error[0].points[3].1 = None;
        let whole = static_error(&sample::demo(), Axis::X, 14).charts[0].html();
        let broken = static_error(&report, Axis::X, 14).charts[0].html();
        let line = |html: &str| {
            html.split("<path class=\"line thin ink1\" d=\"")
                .nth(2)
                .unwrap()
                .split('"')
                .next()
                .unwrap()
                .matches('M')
                .count()
        };
        assert_eq!((line(&whole), line(&broken)), (1, 2));
    }

    #[test]
    fn figure_20_has_the_published_week_beside_it() {
        let faults = |report: &DemoReport| week(report)[0].charts[1].plots[0].clone();
        let mut report = sample::demo();
        let Shape::Bars(days) = faults(&report).shape else {
            panic!("no bars");
        };
        let told: Vec<_> = days.iter().filter(|day| day.1 > 0.0).collect();
        assert_eq!(
            (faults(&report).name.as_str(), told),
            ("Published", vec![&(5.0, 1.0)])
        );
        report.week.retain(|row| row.day < 4);
        let few = faults(&report).shape;
        assert_eq!(few, Shape::Bars(vec![(1.0, 0.0), (2.0, 0.0), (3.0, 0.0)]));
    }

    #[test]
    fn a_run_without_a_week_says_so() {
        let mut report = sample::demo();
        report.week.clear();
        report.figures.delta.clear();
        let groups = week(&report);
        assert!(groups[0].charts[0].html().contains("No data"));
        assert!(groups[1].charts.is_empty());
    }
}
