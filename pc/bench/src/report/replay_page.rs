//! `report.html` of a replay.
//!
//! In: a [`ReplayReport`]. Out: one page that stands alone: what was read, angle and uncertainty
//! over time, difference of two channels, verdicts, accuracy where a reference was recorded.

use super::figures::{Group, band, both_signs, ink_of};
use super::page::group;
use super::replay_data::*;
use super::replay_tables;
use super::tables::axis_name;
use super::{data::Axis, data::word};
use output::chart::{Chart, Ink, Plot, Shape};
use output::html;
use output::series::Bin;

/// Recordings longer than this are drawn in minutes, s.
const LONG_S: f64 = 600.0;

/// The page.
pub fn replay(report: &ReplayReport) -> String {
    let tables: String = replay_tables::all(report).iter().map(html::table).collect();
    let notes: String = report
        .notes
        .iter()
        .map(|note| html::paragraph(note))
        .collect();
    let groups: String = figures(report).iter().map(group).collect();
    let body = format!(
        "{}<section>\n<h2>Over time</h2>\n{groups}</section>\n\
         <section>\n<h2>In numbers</h2>\n{notes}{tables}</section>\n{}",
        header(report),
        footer(report)
    );
    html::page("Plumb replay report", &body)
}

fn header(report: &ReplayReport) -> String {
    let files: Vec<&str> = report
        .channels
        .iter()
        .map(|channel| channel.file.as_str())
        .collect();
    let facts = [
        ("Recordings", files.join(", ")),
        ("Chain", replay_tables::mode_words(report)),
        ("Plumb", report.plumb_version.clone()),
    ];
    let lead = "Recorded accelerations, put through the measuring code of the instrument. \
        Nothing on this page is simulated.";
    let (trusted, words) = summary(report);
    format!(
        "<header>\n<h1>Plumb replay report</h1>\n<p class=\"lead\">{lead}</p>\n{}{}</header>\n",
        html::verdict(trusted, &words),
        html::facts(&facts)
    )
}

/// Whether the angle could be used all the time, and for how long it could not.
fn summary(report: &ReplayReport) -> (bool, String) {
    let length = |interval: &VerdictInterval| interval.to_s - interval.from_s;
    let all: f64 = report.verdicts.iter().map(length).sum();
    let lost: f64 = report
        .verdicts
        .iter()
        .filter(|v| !v.trusted)
        .map(length)
        .sum();
    if report.verdicts.is_empty() {
        (false, "No verdict was reached.".to_owned())
    } else if report.verdicts.iter().all(|verdict| verdict.trusted) {
        (
            true,
            format!("The angle could be used all the time ({all:.1} s)."),
        )
    } else {
        (
            false,
            format!("The angle could NOT be used for {lost:.1} s of {all:.1} s."),
        )
    }
}

/// One unit of time for all charts: divisor and label.
fn time_axis(report: &ReplayReport) -> (f64, &'static str) {
    let longest = report
        .channels
        .iter()
        .map(|channel| channel.duration_s)
        .fold(0.0, f64::max);
    if longest > LONG_S {
        (60.0, "time, min")
    } else {
        (1.0, "time, s")
    }
}

fn figures(report: &ReplayReport) -> Vec<Group> {
    let mut groups = vec![angles(report), uncertainties(report)];
    groups.extend(
        report
            .cross_check
            .as_ref()
            .map(|check| differences(report, check)),
    );
    groups
}

/// A chart of both channels for each slope.
fn per_slope(
    report: &ReplayReport,
    id: &str,
    y_label: &str,
    plots: impl Fn(&ReplayChannel, &SlopeSeries, f64) -> Vec<Plot>,
) -> Vec<Chart> {
    let (divisor, x_label) = time_axis(report);
    let chart = |axis: Axis| {
        let mut all = Vec::new();
        for channel in &report.channels {
            let slopes = channel.slopes.iter().filter(|slope| slope.axis == axis);
            all.extend(slopes.flat_map(|slope| plots(channel, slope, divisor)));
        }
        let title = format!("Slope {}", axis_name(axis));
        Chart {
            id: format!("{id}-{}", word(axis)),
            description: format!("{title}, {y_label}, over time; least and greatest per bin."),
            title,
            x_label: x_label.to_owned(),
            y_label: y_label.to_owned(),
            plots: all,
            shaded: untrusted(report, divisor),
            shaded_name: "not to be used".to_owned(),
            ..Chart::default()
        }
    };
    [Axis::X, Axis::Y].map(chart).to_vec()
}

/// The stretches of time during which the angle may not be used.
fn untrusted(report: &ReplayReport, divisor: f64) -> Vec<(f64, f64)> {
    let intervals = report.verdicts.iter().filter(|verdict| !verdict.trusted);
    intervals
        .map(|verdict| (verdict.from_s / divisor, verdict.to_s / divisor))
        .collect()
}

fn channel_name(channel: &ReplayChannel) -> String {
    format!("Channel {}", channel.channel)
}

fn angles(report: &ReplayReport) -> Group {
    let plots = |channel: &ReplayChannel, slope: &SlopeSeries, divisor: f64| {
        let name = channel_name(channel);
        let mut plots = Vec::new();
        if !slope.reference.is_empty() {
            let reference = Shape::Line(middles(&slope.reference, divisor));
            plots.push(Plot::new(
                format!("{name} reference"),
                Ink::Reference,
                reference,
            ));
        }
        let measured = band(&slope.angle, divisor);
        plots.push(Plot::new(name, ink_of(channel.channel), measured));
        plots
    };
    Group {
        title: "Angle".to_owned(),
        caption: "Least and greatest angle in each stretch of time. Motion that the accelerometer \
         measures is part of it, so the area is wide while the sensor moves."
            .to_owned(),
        charts: per_slope(report, "angle", "angle, deg", plots),
    }
}

/// The middle of each bin.
fn middles(bins: &[Bin], divisor: f64) -> Vec<(f64, f64)> {
    bins.iter()
        .map(|bin| (bin.0 / divisor, 0.5 * (bin.1 + bin.2)))
        .collect()
}

fn uncertainties(report: &ReplayReport) -> Group {
    let plots = |channel: &ReplayChannel, slope: &SlopeSeries, divisor: f64| {
        let shape = band(&slope.uncertainty, divisor);
        vec![Plot::new(
            channel_name(channel),
            ink_of(channel.channel),
            shape,
        )]
    };
    Group {
        title: "Standard uncertainty".to_owned(),
        caption: "What the device reports with each angle. It grows while the machine \
                  accelerates, as far as the length of the measured vector shows it."
            .to_owned(),
        charts: per_slope(report, "uncertainty", "standard uncertainty, deg", plots),
    }
}

fn differences(report: &ReplayReport, check: &CrossCheck) -> Group {
    let (divisor, x_label) = time_axis(report);
    let chart = |slope: &SlopeDelta| Chart {
        id: format!("delta-{}", word(slope.axis)),
        title: format!("Slope {}", axis_name(slope.axis)),
        description: "Difference of the two channels over time; least and greatest per bin."
            .to_owned(),
        x_label: x_label.to_owned(),
        y_label: "channel 1 \u{2212} channel 2, deg".to_owned(),
        plots: vec![Plot::new(
            "Difference",
            Ink::First,
            band(&slope.bins, divisor),
        )],
        levels: both_signs(check.threshold_deg),
        shaded: untrusted(report, divisor),
        shaded_name: "not to be used".to_owned(),
        ..Chart::default()
    };
    Group {
        title: "Difference of the two channels".to_owned(),
        caption: "The dashed lines are the threshold of the cross-check.".to_owned(),
        charts: check.slopes.iter().map(chart).collect(),
    }
}

fn footer(report: &ReplayReport) -> String {
    let text = format!(
        "The same figures are in report.json in the same folder (format {}, version {}).",
        report.format, report.version
    );
    format!("<footer>{}</footer>\n", html::paragraph(&text))
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;
    use output::check;

    #[test]
    fn the_page_is_whole_and_fetches_nothing() {
        let html = replay(&sample::replay());
        check::assert_balanced(&html);
        check::assert_stands_alone(&html);
    }

    #[test]
    fn the_summary_counts_the_time_that_was_lost() {
        let mut report = sample::replay();
        assert_eq!(
            summary(&report),
            (
                false,
                "The angle could NOT be used for 19.5 s of 599.0 s.".to_owned()
            )
        );
        report
            .verdicts
            .iter_mut()
            .for_each(|verdict| verdict.trusted = true);
        assert_eq!(
            summary(&report),
            (
                true,
                "The angle could be used all the time (599.0 s).".to_owned()
            )
        );
        report.verdicts.clear();
        assert!(!summary(&report).0);
    }

    #[test]
    fn a_file_name_cannot_carry_markup() {
        let mut report = sample::replay();
        report.channels[0].file = "<img src=x>.csv".to_owned();
        let html = replay(&report);
        assert!(!html.contains("<img") && html.contains("&lt;img"));
    }

    #[test]
    fn one_channel_has_no_difference_and_a_long_one_is_drawn_in_minutes() {
        let mut report = sample::replay();
        report.cross_check = None;
        report.channels.truncate(1);
        assert!(!replay(&report).contains("Difference of the two channels"));
        assert_eq!(time_axis(&report), (1.0, "time, s"));
        report.channels[0].duration_s = 10_800.0;
        assert_eq!(time_axis(&report), (60.0, "time, min"));
    }
}
