//! What the terminal and `report.html` show of a demo run.
//!
//! In: a [`DemoReport`]. Out: its sections, and one page of them that stands alone: verdict,
//! specification, the paper's tables and figures beside both modes, and what of all this is
//! simulated.

use super::data::DemoReport;
use super::figures::{self, Group};
use super::{summary, tables};
use output::html;
use output::table::Table;

/// A part of the report.
pub struct Section {
    title: &'static str,
    intro: &'static str,
    /// Its tables.
    pub tables: Vec<Table>,
    groups: Vec<Group>,
}

/// What a reader wants first.
pub fn first(report: &DemoReport) -> [Table; 2] {
    [summary::summary(report), tables::specification(report)]
}

/// Everything else, in reading order.
pub fn sections(report: &DemoReport) -> [Section; 4] {
    [
        Section {
            title: "Static test",
            intro: "The motor stops at each angle between -90 and 90 deg, and the nodes are \
                    compared with it and with each other.",
            tables: vec![tables::table_two(report), tables::one_axis(report)],
            groups: figures::static_test(report),
        },
        Section {
            title: "Dynamic test",
            intro: "The motor swings between -40 and 40 deg at 80 deg/s. Every figure is given as \
                    the angle arrives, and aligned by the latency that the device declares.",
            tables: vec![tables::table_three(report)],
            groups: figures::dynamic_test(report),
        },
        Section {
            title: "Two channels",
            intro: "Two nodes monitor each other. First each cause in Table I is provoked alone, \
                    then the arm digs for some hours a day.",
            tables: vec![tables::table_one(report), tables::week(report)],
            groups: figures::week(report),
        },
        Section {
            title: "Calibration",
            intro: "How the instruments of this run were prepared. The verification round follows \
                    the calibration; above its tolerance the unit is calibrated again.",
            tables: vec![tables::calibration(report)],
            groups: Vec::new(),
        },
    ]
}

impl Section {
    fn html(&self) -> String {
        let mut content = html::paragraph(self.intro);
        content.extend(self.tables.iter().map(html::table));
        content.extend(self.groups.iter().map(Group::html));
        html::section(self.title, &content)
    }
}

/// The page.
pub fn demo(report: &DemoReport) -> String {
    let mut body = header(report);
    body.extend(first(report).iter().map(html::table));
    body.extend(sections(report).iter().map(Section::html));
    let again = " The same seed gives the same report.";
    body += &html::footer(&report.format, report.version, again);
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
    let more = [
        html::verdict(report.within_specification, summary::verdict(report)),
        html::facts(&facts),
        html::paragraph(SIMULATED),
    ];
    html::header("Plumb demo report", LEAD, &more.concat())
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
