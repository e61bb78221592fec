//! `report.html` of a replay.
//!
//! In: a [`ReplayReport`]. Out: one page that stands alone: what was read, angle and uncertainty
//! over time, difference of two channels, verdicts, accuracy where a reference was recorded.

use super::data::{Axis, word};
use super::figures::{Group, band, both_signs, ink_of};
use super::replay_data::*;
use super::replay_tables;
use super::tables::axis_name;
use output::chart::{Chart, Ink, Plot, Shape};
use output::html;
use output::series::Bin;

/// Recordings longer than this are drawn in minutes, s.
const LONG_S: f64 = 600.0;

/// The page.
pub fn replay(report: &ReplayReport) -> String {
    let groups: String = figures(report).iter().map(Group::html).collect();
    let notes = report.notes.iter().map(|note| html::paragraph(note));
    let mut numbers: String = notes.collect();
    numbers.extend(replay_tables::all(report).iter().map(html::table));
    let body = [
        header(report),
        html::section("Over time", &groups),
        html::section("In numbers", &numbers),
        html::footer(&report.format, report.version, ""),
    ];
    html::page("Plumb replay report", &body.concat())
}

const LEAD: &str = "Recorded accelerations, put through the measuring code of the instrument. \
    Nothing on this page is simulated.";

fn header(report: &ReplayReport) -> String {
    let files: Vec<&str> = report.channels.iter().map(|c| c.file.as_str()).collect();
    let facts = [
        ("Recordings", files.join(", ")),
        ("Chain", replay_tables::mode_words(report)),
        ("Plumb", report.plumb_version.clone()),
    ];
    let (trusted, words) = summary(report);
    let more = html::verdict(trusted, &words) + &html::facts(&facts);
    html::header("Plumb replay report", LEAD, &more)
}

/// Whether the angle could be used all the time, and for how long it could not.
fn summary(report: &ReplayReport) -> (bool, String) {
    let length = |interval: &VerdictInterval| interval.to_s - interval.from_s;
    let all: f64 = report.verdicts.iter().map(length).sum();
    let untrusted = || report.verdicts.iter().filter(|verdict| !verdict.trusted);
    if report.verdicts.is_empty() {
        return (false, "No verdict was reached.".to_owned());
    }
    if untrusted().next().is_none() {
        let words = format!("The angle could be used all the time ({all:.1} s).");
        return (true, words);
    }
    let lost: f64 = untrusted().map(length).sum();
    let words = format!("The angle could NOT be used for {lost:.1} s of {all:.1} s.");
    (false, words)
}

/// One unit of time for all charts: divisor and label.
fn time_axis(report: &ReplayReport) -> (f64, &'static str) {
    let lengths = report.channels.iter().map(|channel| channel.duration_s);
    if lengths.fold(0.0, f64::max) > LONG_S {
        (60.0, "time, min")
    } else {
        (1.0, "time, s")
    }
}

/// A chart over time of one slope: what every one has.
fn over_time(report: &ReplayReport, id: &str, axis: Axis, y_label: &str) -> Chart {
    let (divisor, x_label) = time_axis(report);
    let title = format!("Slope {}", axis_name(axis));
    let untrusted = report.verdicts.iter().filter(|verdict| !verdict.trusted);
    let place = |verdict: &VerdictInterval| (verdict.from_s / divisor, verdict.to_s / divisor);
    Chart {
        id: format!("{id}-{}", word(axis)),
        description: format!("{title}, {y_label}, over time; least and greatest per bin."),
        title,
        x_label: x_label.to_owned(),
        y_label: y_label.to_owned(),
        shaded: untrusted.map(place).collect(),
        shaded_name: "not to be used".to_owned(),
        ..Chart::default()
    }
}

/// A chart of both channels for each slope.
fn per_slope(
    report: &ReplayReport,
    id: &str,
    y_label: &str,
    plots: impl Fn(&ReplayChannel, &SlopeSeries) -> Vec<Plot>,
) -> Vec<Chart> {
    let chart = |axis: Axis| {
        let mut chart = over_time(report, id, axis, y_label);
        for channel in &report.channels {
            let slopes = channel.slopes.iter().filter(|slope| slope.axis == axis);
            chart
                .plots
                .extend(slopes.flat_map(|slope| plots(channel, slope)));
        }
        chart
    };
    [Axis::X, Axis::Y].map(chart).to_vec()
}

fn figures(report: &ReplayReport) -> Vec<Group> {
    let (divisor, _) = time_axis(report);
    let name = |channel: &ReplayChannel| format!("Channel {}", channel.channel);
    let drawn = |channel: &ReplayChannel, bins: &[Bin]| {
        Plot::new(name(channel), ink_of(channel.channel), band(bins, divisor))
    };
    let angles = |channel: &ReplayChannel, slope: &SlopeSeries| {
        let reference = (!slope.reference.is_empty()).then(|| {
            let name = format!("{} reference", name(channel));
            let middles = Shape::Line(middles(&slope.reference, divisor));
            Plot::new(name, Ink::Reference, middles)
        });
        let measured = drawn(channel, &slope.angle);
        reference.into_iter().chain([measured]).collect()
    };
    let uncertainties =
        |channel: &ReplayChannel, slope: &SlopeSeries| vec![drawn(channel, &slope.uncertainty)];
    let mut groups = vec![
        Group::new(
            "Angle",
            "Least and greatest angle in each stretch of time. Motion that the accelerometer \
             measures is part of it, so the area is wide while the sensor moves.",
            per_slope(report, "angle", "angle, deg", angles),
        ),
        Group::new(
            "Standard uncertainty",
            "What the device reports with each angle. It grows while the machine accelerates, as \
             far as the length of the measured vector shows it.",
            per_slope(
                report,
                "uncertainty",
                "standard uncertainty, deg",
                uncertainties,
            ),
        ),
    ];
    let check = report.cross_check.iter();
    groups.extend(check.map(|check| differences(report, check)));
    groups
}

/// The middle of each bin.
fn middles(bins: &[Bin], divisor: f64) -> Vec<(f64, f64)> {
    let middle = |bin: &Bin| (bin.0 / divisor, 0.5 * (bin.1 + bin.2));
    bins.iter().map(middle).collect()
}

fn differences(report: &ReplayReport, check: &CrossCheck) -> Group {
    let (divisor, _) = time_axis(report);
    let label = "channel 1 \u{2212} channel 2, deg";
    let chart = |slope: &SlopeDelta| {
        let shape = band(&slope.bins, divisor);
        Chart {
            plots: vec![Plot::new("Difference", Ink::First, shape)],
            levels: both_signs(check.threshold_deg),
            ..over_time(report, "delta", slope.axis, label)
        }
    };
    Group::new(
        "Difference of the two channels",
        "The dashed lines are the threshold of the cross-check.",
        check.slopes.iter().map(chart).collect(),
    )
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
