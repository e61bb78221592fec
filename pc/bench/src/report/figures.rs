//! The paper's figures 14 to 18, 20 and 21 as charts.
//!
//! In: a [`DemoReport`]. Out: one group of charts per figure, paper mode beside product mode on
//! the same vertical scale, with a caption that states what is to be seen. Figures 1 to 13 and 19
//! are drawings and photographs, so they have no counterpart here.

use sim::bench::published::DAYS;
use sim::bench::week::{FAULT_DAY, HEALTHY_DEG};

use super::data::*;
use super::tables::{axis_name, mode_name, modes};
use output::chart::{Chart, Ink, Level, Plot, Shape, share_y};
use output::html;
use output::series::{Bin, Point};

/// Charts that belong together.
pub struct Group {
    /// Which figure of the paper, and what it shows.
    pub title: String,
    /// What the reader sees.
    caption: &'static str,
    /// The charts, in reading order.
    pub charts: Vec<Chart>,
}

impl Group {
    /// Charts under a title, with a caption.
    pub fn new(title: impl Into<String>, caption: &'static str, charts: Vec<Chart>) -> Self {
        Self {
            title: title.into(),
            caption,
            charts,
        }
    }

    /// A figure of one or more charts with its caption.
    pub fn html(&self) -> String {
        let charts = match self.charts.as_slice() {
            [] => "<div class=\"charts\">\n<p class=\"empty\">Not run.</p>\n</div>\n".to_owned(),
            charts => html::charts(charts),
        };
        format!(
            "<h3>{}</h3>\n{charts}<p class=\"note\">{}</p>\n",
            html::escape(&self.title),
            html::escape(self.caption)
        )
    }
}

/// Tolerance of one channel, deg (paper IV.A).
const TOLERANCE_DEG: f64 = 0.20;
/// Threshold of the cross-check, deg (paper IV.A).
const THRESHOLD_DEG: f64 = 0.40;

/// Points for the chart; an absent value becomes NaN there, which is a gap.
fn pairs(points: &[Point]) -> Vec<(f64, f64)> {
    let pair = |point: &Point| (point.0, point.1.unwrap_or(f64::NAN));
    points.iter().map(pair).collect()
}

/// Bins for the chart, x divided by `divisor`.
pub fn band(bins: &[Bin], divisor: f64) -> Shape {
    let scaled = |bin: &Bin| (bin.0 / divisor, bin.1, bin.2);
    Shape::Band(bins.iter().map(scaled).collect())
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

/// The mode's word as part of an identifier.
fn id_of(mode: Mode) -> String {
    word(mode).replace(' ', "-")
}

/// A chart, once for each mode: with the mode in its name and title, and its plots.
fn per_mode(report: &DemoReport, drawn: Chart, plots: impl Fn(Mode) -> Vec<Plot>) -> Vec<Chart> {
    let charts = modes(report).into_iter().map(|mode| Chart {
        id: format!("{}-{}", drawn.id, id_of(mode)),
        title: format!("{}{}", mode_name(mode), drawn.title),
        plots: plots(mode),
        ..drawn.clone()
    });
    alike(charts.collect())
}

fn alike(mut charts: Vec<Chart>) -> Vec<Chart> {
    share_y(&mut charts);
    charts
}

/// Figures 14 to 16.
pub fn static_test(report: &DemoReport) -> Vec<Group> {
    vec![
        static_error(report, Axis::X, 14),
        static_error(report, Axis::Y, 15),
        static_delta(report),
    ]
}

/// A chart over the reference angle, still without plots.
fn over_angle(id: String, y_label: &str, description: String, limit_deg: f64) -> Chart {
    Chart {
        id,
        description,
        x_label: "reference angle, deg".to_owned(),
        x_step: Some(30.0),
        y_label: y_label.to_owned(),
        levels: both_signs(limit_deg),
        ..Chart::default()
    }
}

/// The curves of a mode, each with its name and colour.
fn curves<'a>(
    curves: &'a [Curve],
    mode: Mode,
    named: impl Fn(&Curve) -> Option<(String, Ink)> + 'a,
) -> Vec<Plot> {
    let of_mode = curves.iter().filter(|curve| curve.mode == mode);
    let plot = |curve: &Curve| {
        let (name, ink) = named(curve)?;
        Some(Plot::new(name, ink, Shape::Markers(pairs(&curve.points))))
    };
    of_mode.filter_map(plot).collect()
}

fn static_error(report: &DemoReport, axis: Axis, figure: u32) -> Group {
    let name = axis_name(axis);
    let node = |curve: &Curve| {
        let node = curve.node.filter(|_| curve.axis == axis)?;
        Some((format!("Node {node}"), ink_of(node)))
    };
    let description = format!(
        "Error of both nodes on axis {name} at every 10 degrees against the tolerance of 0.20 \
         degrees."
    );
    let label = "angle \u{2212} reference, deg";
    let drawn = over_angle(format!("f{figure}"), label, description, TOLERANCE_DEG);
    Group::new(
        format!("Figure {figure}: error on axis {name}, static"),
        "Each marker is one standstill on a calibration angle. The paper draws absolute values; \
         here the sign is kept. The dashed lines are the tolerance of one channel. A single axis \
         loses its sensitivity towards 90 deg, which paper mode shows at both ends.",
        per_mode(report, drawn, |mode| {
            curves(&report.figures.static_error, mode, node)
        }),
    )
}

fn static_delta(report: &DemoReport) -> Group {
    let axis = |curve: &Curve| {
        let ink = match curve.axis {
            Axis::X => Ink::First,
            Axis::Y => Ink::Second,
        };
        Some((format!("Axis {}", axis_name(curve.axis)), ink))
    };
    let description = "Difference of the two nodes over the angle, both axes.".to_owned();
    let label = "node 1 \u{2212} node 2, deg";
    let drawn = over_angle("f16".to_owned(), label, description, THRESHOLD_DEG);
    Group::new(
        "Figure 16: difference of the two nodes, static",
        "The difference at each standstill, as in the cross-check. Errors that both nodes share, \
         such as that of the reference, cancel here and remain undetected. The dashed lines are \
         the warning threshold.",
        per_mode(report, drawn, |mode| {
            curves(&report.figures.static_delta, mode, axis)
        }),
    )
}

/// Figures 17 and 18.
pub fn dynamic_test(report: &DemoReport) -> Vec<Group> {
    vec![dynamic(report, Axis::X, 17), dynamic(report, Axis::Y, 18)]
}

/// One of the charts of a dynamic figure.
struct DynamicPart {
    id: &'static str,
    title: &'static str,
    y_label: &'static str,
    points: fn(&NodeTrace) -> &[Point],
    /// The motor's own angle is drawn, too.
    with_motor: bool,
    /// The tolerance applies.
    limited: bool,
}

const DYNAMIC_PARTS: [DynamicPart; 3] = [
    DynamicPart {
        id: "angle",
        title: "angle",
        y_label: "angle, deg",
        points: |trace| &trace.angle,
        with_motor: true,
        limited: false,
    },
    DynamicPart {
        id: "error",
        title: "error as it arrives",
        y_label: "angle \u{2212} reference, deg",
        points: |trace| &trace.error,
        with_motor: false,
        limited: false,
    },
    DynamicPart {
        id: "aligned",
        title: "error aligned",
        y_label: "angle \u{2212} reference, deg",
        points: |trace| &trace.error_aligned,
        with_motor: false,
        limited: true,
    },
];

impl DynamicPart {
    fn charts(&self, report: &DemoReport, axis: Axis, figure: u32) -> Vec<Chart> {
        let title = self.title;
        let limit = self.limited.then(|| both_signs(TOLERANCE_DEG));
        let drawn = Chart {
            id: format!("f{figure}-{}", self.id),
            title: format!(": {title}"),
            description: format!("{title} of both nodes over time during the motion of the motor."),
            x_label: "time, s".to_owned(),
            y_label: self.y_label.to_owned(),
            levels: limit.unwrap_or_default(),
            ..Chart::default()
        };
        per_mode(report, drawn, |mode| {
            let mut traces = report.figures.dynamic.iter();
            let trace = traces.find(|trace| trace.mode == mode && trace.axis == axis);
            trace.map_or_else(Vec::new, |trace| self.plots(trace))
        })
    }

    fn plots(&self, trace: &DynamicTrace) -> Vec<Plot> {
        let motor = self.with_motor.then(|| {
            let shape = Shape::Line(pairs(&trace.reference));
            Plot::new("Motor", Ink::Reference, shape)
        });
        let node = |node: &NodeTrace| {
            let shape = Shape::Line(pairs((self.points)(node)));
            Plot::new(format!("Node {}", node.node), ink_of(node.node), shape)
        };
        let nodes = trace.nodes.iter().map(node);
        motor.into_iter().chain(nodes).collect()
    }
}

fn dynamic(report: &DemoReport, axis: Axis, figure: u32) -> Group {
    let name = axis_name(axis);
    let parts = DYNAMIC_PARTS.iter();
    Group::new(
        format!("Figure {figure}: motion at 80 deg/s on axis {name}"),
        "The beginning of the dynamic test without lever arm. First the angles, then what \
         separates them from the reference: as they arrive, which is mostly the delay of the \
         filter, and with the declared latency taken off.",
        parts
            .flat_map(|part| part.charts(report, axis, figure))
            .collect(),
    )
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

/// The bars of a mode; `None` without a single day, where there is nothing to draw.
fn bars(report: &DemoReport, mode: Mode, count: fn(&WeekRow) -> u64) -> Option<Plot> {
    let days = report.week.iter().filter(|row| row.mode == mode);
    let bar = |row: &WeekRow| (f64::from(row.day), count(row) as f64);
    let bars: Vec<_> = days.map(bar).collect();
    let ink = match mode {
        Mode::Paper => Ink::Other,
        Mode::AsPrinted => Ink::Second,
        Mode::Product => Ink::First,
    };
    (!bars.is_empty()).then(|| Plot::new(mode_name(mode), ink, Shape::Bars(bars)))
}

fn per_day(report: &DemoReport) -> Group {
    let chart = |title: &str, id: &str, published: Option<Plot>, count: fn(&WeekRow) -> u64| {
        let bars = modes(report)
            .into_iter()
            .filter_map(|mode| bars(report, mode, count));
        Chart {
            id: format!("f20-{id}"),
            title: title.to_owned(),
            description: format!("{title}, each mode; the table above holds the numbers."),
            x_label: "day".to_owned(),
            y_label: "count".to_owned(),
            plots: published.into_iter().chain(bars).collect(),
            ..Chart::default()
        }
    };
    let published = published_faults(report);
    Group::new(
        "Figure 20: errors per day on the excavator",
        "The supply of one node becomes unstable on day 5. A warning is one compared pair above \
         the threshold; a fault is reported to the user. Published are the paper's own seven \
         days, for which it reports the fault of day 5 and no number of warnings.",
        vec![
            chart("Warnings per day", "warnings", None, |row| row.warnings),
            chart("Faults per day", "faults", published, |row| row.faults),
        ],
    )
}

fn delta(report: &DemoReport) -> Group {
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
    Group::new(
        "Figure 21: difference of the two nodes on the day of the fault",
        "The area spans the least and the greatest difference in each stretch of time. A healthy \
         pair stays between the dashed threshold lines; an unstable supply shows as bursts beyond \
         them. Published: below 0.20 deg while the supply is good, then differences above 0.40 \
         deg again and again for ten minutes, 10 deg at most.",
        alike(report.figures.delta.iter().map(chart).collect()),
    )
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
    fn a_run_without_a_week_shows_no_data() {
        let mut report = sample::demo();
        report.week.clear();
        report.figures.delta.clear();
        let groups = week(&report);
        assert!(groups[0].charts[0].html().contains("No data"));
        assert!(groups[1].charts.is_empty());
    }
}
