//! `report.html` of a demo run.
//!
//! In: a [`DemoReport`]. Out: one page that stands alone: verdict, specification, the paper's
//! tables and figures beside both modes, and what of all this is simulated.

use super::data::DemoReport;
use super::figures::{self, Group};
use super::summary;
use super::tables;
use super::terminal;
use output::html;

/// The page.
pub fn demo(report: &DemoReport) -> String {
    let sections = [
        header(report),
        static_test(report),
        dynamic_test(report),
        redundancy(report),
    ];
    let body = format!(
        "{}{}{}",
        sections.concat(),
        preparation(report),
        footer(report)
    );
    html::page("Plumb demo report", &body)
}

const LEAD: &str = "A two-channel inclinometer on a virtual bench: characterised in the climatic \
    chamber, calibrated on the motor, then put through the static test, the dynamic test and the \
    days on the excavator that Hoang and Pietrosanto describe, IEEE Sensors Journal 21(5), 2021.";

const SIMULATED: &str = "Simulated: sensors with part-to-part errors, noise, temperature, motor, \
    chamber, excavator arm and power supply. Not simulated: the measuring code, which is the \
    code that is built for the device. Published figures are those printed in the paper; nothing \
    here was measured on hardware.";

fn header(report: &DemoReport) -> String {
    let facts = [
        ("Seed", report.seed.to_string()),
        ("Instruments", report.units.to_string()),
        ("Days", report.days.to_string()),
        ("Plumb", report.plumb_version.clone()),
    ];
    format!(
        "<header>\n<h1>Plumb demo report</h1>\n<p class=\"lead\">{}</p>\n{}{}{}</header>\n{}",
        html::escape(LEAD),
        html::verdict(report.within_specification, terminal::verdict(report)),
        html::facts(&facts),
        html::paragraph(SIMULATED),
        [summary::summary(report), tables::specification(report)]
            .iter()
            .map(html::table)
            .collect::<String>()
    )
}

fn static_test(report: &DemoReport) -> String {
    let intro = "The motor stops at each angle between -90 and 90 deg, and the nodes are \
        compared with it and with each other.";
    let tables = [tables::table_two(report), tables::one_axis(report)];
    section("Static test", intro, &tables, &figures::static_test(report))
}

fn dynamic_test(report: &DemoReport) -> String {
    let intro = "The motor swings between -40 and 40 deg at 80 deg/s. Every figure is given as \
        the angle arrives, and aligned by the latency that the device declares.";
    let tables = [tables::table_three(report)];
    section(
        "Dynamic test",
        intro,
        &tables,
        &figures::dynamic_test(report),
    )
}

fn redundancy(report: &DemoReport) -> String {
    let intro = "Two nodes watch each other. First each cause in Table I is provoked alone, then \
        the arm digs for some hours a day.";
    let tables = [tables::table_one(report), tables::week(report)];
    section("Two channels", intro, &tables, &figures::week(report))
}

fn preparation(report: &DemoReport) -> String {
    let intro = "How the instruments of this run were prepared. The verification round follows \
        the calibration; above its tolerance the unit is calibrated again.";
    section("Calibration", intro, &[tables::calibration(report)], &[])
}

/// A section: heading, introduction, tables, figures.
fn section(title: &str, intro: &str, tables: &[output::table::Table], groups: &[Group]) -> String {
    let tables: String = tables.iter().map(html::table).collect();
    let groups: String = groups.iter().map(group).collect();
    let intro = html::paragraph(intro);
    format!(
        "<section>\n<h2>{}</h2>\n{intro}{tables}{groups}</section>\n",
        html::escape(title)
    )
}

/// A figure of one or more charts with its caption.
pub fn group(group: &Group) -> String {
    let charts: String = match group.charts.as_slice() {
        [] => "<p class=\"empty\">Not run.</p>\n".to_owned(),
        charts => charts.iter().map(output::chart::Chart::html).collect(),
    };
    format!(
        "<h3>{}</h3>\n<div class=\"charts\">\n{charts}</div>\n<p class=\"note\">{}</p>\n",
        html::escape(&group.title),
        html::escape(&group.caption)
    )
}

fn footer(report: &DemoReport) -> String {
    let text = format!(
        "The same figures are in report.json in the same folder (format {}, version {}). The same \
         seed gives the same report.",
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
        let html = demo(&sample::demo());
        check::assert_balanced(&html);
        check::assert_stands_alone(&html);
        assert!(html.len() < 1_000_000, "{}", html.len());
    }

    #[test]
    fn the_verdict_is_said_in_words() {
        let mut report = sample::demo();
        assert!(demo(&report).contains("<p class=\"verdict pass\">Product mode is WITHIN"));
        report.within_specification = false;
        assert!(demo(&report).contains("<p class=\"verdict fail\">Product mode is OUTSIDE"));
    }

    #[test]
    fn an_empty_report_is_still_a_page() {
        let html = demo(&DemoReport::new(1, 1, 0, Vec::new()));
        check::assert_balanced(&html);
        assert!(html.contains("Not run.") && html.contains("OUTSIDE"));
        assert!(!html.contains("NaN"));
    }
}
