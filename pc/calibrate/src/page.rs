//! The calibration report as a page: report.html.
//!
//! In: a [`Report`]. Out: one page that stands alone, in the order of ISO/IEC 17025, 7.8: who and
//! what, reference, surroundings, as found, as left, uncertainty, decision.
//!
//! Left out: a signature, and the word certificate as its title.

use super::data::{Channel, Difference, Method, Point, Report, largest_error_deg, said};
use super::fit;
use super::gyroscope;
use super::over_temperature;
use output::chart::{Chart, Ink, Level, Plot, Shape};
use output::html;
use output::table::{Cell, Column, Rows, Table};

const LEAD: &str = "A report of a redundant inclinometer, made by whoever is named in it. It is no \
    certificate of an accredited laboratory.";

/// The page.
pub fn page(report: &Report) -> String {
    let mut body = header(report);
    body += &html::section("Reference and surroundings", &reference(report));
    let angles = |c: &Channel| !c.as_left.is_empty();
    if report.channels.iter().any(angles) {
        body += &html::section("Results", &results(report));
    }
    if report.method == Method::ByHand {
        body += &html::section("Poses", &poses(report));
    }
    let thermal = over_temperature::page(report);
    if !thermal.is_empty() {
        body += &html::section("Over temperature", &thermal);
    }
    let gyroscope = gyroscope::page(report);
    if !gyroscope.is_empty() {
        body += &html::section("Gyroscope", &gyroscope);
    }
    body += &html::section("Uncertainty", &uncertainty(report));
    body += &format!("<footer>{}</footer>\n", html::paragraph(&footer(report)));
    html::page("Calibration report", &body)
}

const fn method(method: Method) -> &'static str {
    match method {
        Method::Motor => "by a motor; parameters and harmonics fitted on the host",
        Method::MotorTables => "by a motor; tables made by the nodes",
        Method::ByHand => "by hand, in poses, without a motor",
        Method::ChamberQuadratic => "in a chamber; offset and gain over temperature",
        Method::ChamberPiecewise => "in a chamber, level; the paper's eq 6",
    }
}

fn header(report: &Report) -> String {
    let decision = &report.decision;
    let verdict = match decision.accepted {
        true => "The instrument is within its tolerance.",
        false => "The instrument is NOT within its tolerance; the calibration found counts again.",
    };
    let facts = [
        ("Report", report.identifier.clone()),
        ("Method", method(report.method).to_owned()),
        ("Begun (UTC)", report.begun_utc.clone()),
        ("Ended (UTC)", report.ended_utc.clone()),
        ("Laboratory", said(&report.laboratory)),
        ("Operator", said(&report.operator)),
        ("Customer", said(&report.customer)),
        ("Bus", report.bus.clone()),
        ("Plumb", report.plumb_version.clone()),
    ];
    let more = [
        html::verdict(decision.accepted, verdict),
        html::paragraph(&decision.rule),
        html::facts(&facts),
        html::table(&items(report)),
        as_shown(report),
    ];
    html::header("Calibration report", LEAD, &more.concat())
}

/// What the nodes add to the angles that this report is of.
fn as_shown(report: &Report) -> String {
    let lines = report.channels.iter().filter_map(Channel::as_shown);
    lines.map(|line| html::paragraph(&line)).collect()
}

fn items(report: &Report) -> Table {
    let found = |c: &Channel| match c.calibrated_before {
        true => c.as_found_crc32.clone(),
        false => format!("{} (none of its own)", c.as_found_crc32),
    };
    Rows::of("Calibrated", &report.channels)
        .text("Channel", |c| &c.channel)
        .count("Node", |c| c.node)
        .count("Serial number", |c| c.serial_number)
        .text("Product", |c| format!("{:08X}h", c.product_code))
        .text("Program", |c| &c.software)
        .text("Calibration as found", found)
        .text("Calibration as left", |c| &c.as_left_crc32)
        .table()
}

fn reference(report: &Report) -> String {
    let reference = &report.reference;
    let uncertainty = reference.standard_uncertainty_deg;
    let uncertainty = uncertainty.map_or("not stated".to_owned(), |u| format!("{u:.4} deg"));
    let environment = &report.environment;
    let temperature = match (environment.sensor_min_degc, environment.sensor_max_degc) {
        (Some(low), Some(high)) => format!("{low:.1} to {high:.1} degC"),
        _ => "not known".to_owned(),
    };
    let facts = [
        ("Reference", reference.name.clone()),
        ("Its standard uncertainty", uncertainty),
        ("Temperature of the sensors", temperature),
    ];
    let mut out = html::facts(&facts);
    out += &html::paragraph(&reference.statement);
    out += &html::paragraph(&environment.statement);
    out += &html::paragraph(&report.spans());
    out
}

fn results(report: &Report) -> String {
    let mut out = html::table(&summary(report));
    for axis in ["X", "Y"] {
        let charts = [
            errors(report, axis, true),
            errors(report, axis, false),
            difference(report, axis),
        ];
        let charts: Vec<Chart> = charts.into_iter().flatten().collect();
        if !charts.is_empty() {
            out += &format!("<h3>Slope {axis}</h3>\n{}", html::charts(&charts));
        }
    }
    for channel in &report.channels {
        out += &html::table(&readings(channel));
    }
    out
}

fn rms(points: &[Point]) -> Option<f64> {
    let errors: Vec<f64> = points.iter().filter_map(|p| p.error_deg).collect();
    (!errors.is_empty()).then(|| fit::rms(errors))
}

fn summary(report: &Report) -> Table {
    const FOUND: &str = "Error as found, deg";
    const LEFT: &str = "Error as left, deg";
    let within = |c: &Channel| {
        let u = c.expanded_uncertainty_deg;
        c.largest_error_deg()
            .is_some_and(|error| error + u <= report.decision.tolerance_deg)
    };
    Rows::of("Errors", &report.channels)
        .text("Channel", |c| &c.channel)
        .number("largest", 3, |c| largest_error_deg(&c.as_found))
        .under(FOUND)
        .number("rms", 3, |c| rms(&c.as_found))
        .under(FOUND)
        .number("largest", 3, Channel::largest_error_deg)
        .under(LEFT)
        .number("rms", 3, |c| rms(&c.as_left))
        .under(LEFT)
        .number("U (k = 2), deg", 3, |c| c.expanded_uncertainty_deg)
        .number("Residual of the fit, deg", 4, |c| c.residual_deg)
        .verdict("Within tolerance", ["yes", "NO"], within)
        .table()
}

fn readings(channel: &Channel) -> Table {
    let title = format!("Channel {} as left, at other angles", channel.channel);
    Rows::of(&title, &channel.as_left)
        .text("Slope", |p| &p.axis)
        .number("Reference, deg", 3, |p| p.reference_deg)
        .number("Reading, deg", 3, |p| p.reading_deg)
        .number("Error, deg", 3, |p| p.error_deg)
        .table()
}

/// Errors of both channels over the reference's angle.
fn errors(report: &Report, axis: &str, found: bool) -> Option<Chart> {
    let (when, word) = match found {
        true => ("found", "as found"),
        false => ("left", "as left and residuals"),
    };
    let mut plots = Vec::new();
    for (channel, ink) in report.channels.iter().zip([Ink::First, Ink::Second]) {
        let of = |points: &[Point]| -> Vec<(f64, f64)> {
            let here = points.iter().filter(|p| p.axis == axis);
            by_angle(here.filter_map(|p| Some((p.reference_deg, p.error_deg?))))
        };
        let name = format!("Channel {}", channel.channel);
        if found {
            plots.push(Plot::new(name, ink, Shape::Line(of(&channel.as_found))));
        } else {
            let fit = format!("{name}, residual of the fit");
            plots.push(Plot::new(fit, ink, Shape::Line(of(&channel.residuals))));
            plots.push(Plot::new(name, ink, Shape::Markers(of(&channel.as_left))));
        }
    }
    let empty = |plot: &Plot| match &plot.shape {
        Shape::Line(points) | Shape::Markers(points) => points.is_empty(),
        _ => true,
    };
    plots.retain(|plot| !empty(plot));
    (!plots.is_empty()).then(|| Chart {
        id: format!("{when}-{}", axis.to_lowercase()),
        title: format!("Errors of slope {axis} {word}"),
        description: format!("Reading less reference of slope {axis} over the reference's angle"),
        x_label: "Reference, deg".to_owned(),
        y_label: "Error, deg".to_owned(),
        plots,
        ..Chart::default()
    })
}

/// Points in the order of their angles, those of both ways of a sweep as their mean.
fn by_angle(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut points: Vec<_> = points.collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let same = |a: &(f64, f64), b: &(f64, f64)| b.0 - a.0 < 0.01;
    let mean = |group: &[(f64, f64)]| {
        let sum = group.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
        let count = group.len() as f64;
        (sum.0 / count, sum.1 / count)
    };
    points.chunk_by(same).map(mean).collect()
}

/// A less B, as found and as left.
fn difference(report: &Report, axis: &str) -> Option<Chart> {
    let of = |all: &[Difference]| -> Vec<(f64, f64)> {
        let here = all.iter().filter(|d| d.axis == axis);
        by_angle(here.filter_map(|d| Some((d.reference_deg, d.difference_deg?))))
    };
    let (found, left) = (
        of(&report.difference_as_found),
        of(&report.difference_as_left),
    );
    if left.is_empty() {
        return None;
    }
    Some(Chart {
        id: format!("difference-{}", axis.to_lowercase()),
        title: format!("Channel A less channel B, slope {axis}"),
        description: format!("Difference of the channels over the reference's angle, slope {axis}"),
        x_label: "Reference, deg".to_owned(),
        y_label: "Difference, deg".to_owned(),
        plots: vec![
            Plot::new("as found", Ink::Reference, Shape::Line(found)),
            Plot::new("as left", Ink::First, Shape::Markers(left)),
        ],
        levels: vec![Level {
            at: 0.0,
            name: String::new(),
        }],
        ..Chart::default()
    })
}

fn poses(report: &Report) -> String {
    let mut out = String::new();
    if let Some(faces) = &report.faces {
        let off_level = |deg: f64| format!("{deg:.2} deg off level");
        let off_square = format!("{:+.2} deg off square", faces.off_square_deg);
        let between = format!("{:.3} deg rms", faces.between_channels_deg);
        out += &html::facts(&[
            ("Surface under the base", off_level(faces.base_surface_deg)),
            ("Surface under the side", off_level(faces.side_surface_deg)),
            ("Side to base", off_square),
            ("Between channels", between),
        ]);
    }
    const FOUND: &str = "As found, deg";
    const LEFT: &str = "With the new calibration, deg";
    for channel in &report.channels {
        let poses = Rows::of(&format!("Channel {}", channel.channel), &channel.poses)
            .text("Pose", |p| &p.words)
            .number("Length less 1 g, mg", 3, |p| p.length_error_mg)
            .number("X", 3, |p| p.as_found_deg[0])
            .under(FOUND)
            .number("Y", 3, |p| p.as_found_deg[1])
            .under(FOUND)
            .number("X", 3, |p| p.as_left_deg[0])
            .under(LEFT)
            .number("Y", 3, |p| p.as_left_deg[1])
            .under(LEFT);
        out += &html::table(&poses.table());
    }
    out
}

fn uncertainty(report: &Report) -> String {
    let columns = vec![
        Column::text("Channel"),
        Column::text("Contribution"),
        Column::text("Evaluation"),
        Column::number("Standard uncertainty, deg"),
        Column::text("Source"),
    ];
    let mut table = Table::new("Of an error as left", columns);
    for channel in &report.channels {
        for contribution in &channel.uncertainty {
            table.rows.push(vec![
                Cell::text(&channel.channel),
                Cell::text(&contribution.name),
                Cell::text(&contribution.evaluation),
                Cell::number(Some(contribution.standard_uncertainty_deg), 4),
                Cell::text(&contribution.source),
            ]);
        }
        table.rows.push(vec![
            Cell::text(&channel.channel),
            Cell::text("Combined; expanded U with k = 2"),
            Cell::text(""),
            Cell::number(Some(channel.combined_uncertainty_deg), 4),
            Cell::text(format!("U = {:.4} deg", channel.expanded_uncertainty_deg)),
        ]);
    }
    table.notes.push(
        "The expanded uncertainty is the standard uncertainty times k = 2, about 95 % for a normal \
         distribution (JCGM 100). It is that of the errors at the time of the calibration: what a \
         later power-on, another temperature and time do is told by the node itself (2022h)."
            .to_owned(),
    );
    html::table(&table)
}

fn footer(report: &Report) -> String {
    let kept = match &report.dcc_sha256 {
        Some(hash) => format!(
            "The nodes store the SHA-256 of the dcc.xml in the same folder (2063h): {hash}. \
             `plumb verify dcc.xml` compares."
        ),
        None => "The nodes keep no hash of this report.".to_owned(),
    };
    format!(
        "{kept} The same figures are in report.json (format {}, version {}). The report may be \
         copied as a whole only.",
        report.format, report.version
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;
    use output::check;

    #[test]
    fn the_page_is_whole_fetches_nothing_and_is_no_certificate() {
        let page = page(&sample::report());
        check::assert_balanced(&page);
        check::assert_stands_alone(&page);
        assert!(page.contains("<title>Calibration report</title>"));
        assert!(page.contains("<h1>Calibration report</h1>"));
        assert!(page.contains("no certificate of an accredited"));
    }

    #[test]
    fn a_chamber_s_run_is_shown_by_temperature_and_without_empty_tables_of_angles() {
        let page = page(&sample::chamber());
        check::assert_balanced(&page);
        check::assert_stands_alone(&page);
        assert!(page.contains("<h2>Over temperature</h2>"));
        assert!(!page.contains("<h2>Results</h2>"));
        assert!(page.contains("-7.0 to 73.0 degC"), "{page}");
    }

    #[test]
    fn both_ways_of_a_sweep_are_one_point() {
        let swept = [(0.0, 1.0), (5.0, 2.0), (5.0, 4.0), (0.0, 2.0)];
        assert_eq!(by_angle(swept.into_iter()), [(0.0, 1.5), (5.0, 3.0)]);
    }

    #[test]
    fn a_channel_outside_is_shown_as_such() {
        let mut report = sample::report();
        report.decision.tolerance_deg = 0.04;
        report.decision.accepted = false;
        let page = page(&report);
        assert!(page.contains("<td class=\"fail\">NO</td>"));
        assert!(page.contains("NOT within its tolerance"));
    }
}
