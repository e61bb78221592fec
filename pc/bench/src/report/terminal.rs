//! What the terminal shows at the end of a run.
//!
//! In: a report. Out: one string of plain text, tables aligned, the verdict as its last line.
//! Printing it, and progress on the way, are the caller's.

use super::data::{DemoReport, Mode};
use super::replay_data::ReplayReport;
use super::summary::verdict;
use super::{page, replay_tables, tables};
use output::table::{Table, wrap};

/// The summary, the specification and the verdict of a demo run; with `details` every table.
pub fn print_demo(report: &DemoReport, details: bool) -> String {
    let mut out = wrap(
        &format!(
            "Plumb {}, simulated bench: seed: {}, units: {}, days: {}",
            report.plumb_version, report.seed, report.units, report.days
        ),
        96,
    );
    if details {
        for section in page::sections(report) {
            push_tables(&section.tables, &mut out);
        }
    }
    push_tables(&page::first(report), &mut out);
    out.push('\n');
    if !details {
        out.push_str("Every table: --details.");
        if !tables::modes(report).contains(&Mode::AsPrinted) {
            out.push_str(" The paper to the letter as well: --as-printed.");
        }
        out.push('\n');
    }
    out.push_str(verdict(report));
    out.push('\n');
    out
}

/// Recordings, calibration, accuracy, comparison and verdicts of a replay.
pub fn print_replay(report: &ReplayReport) -> String {
    let mode = replay_tables::mode_words(report);
    let mut out = format!("Plumb {}, replay in {mode}\n", report.plumb_version);
    push_tables(&replay_tables::all(report), &mut out);
    if !report.notes.is_empty() {
        out.push('\n');
    }
    for note in &report.notes {
        out.push_str(&wrap(note, 96));
    }
    out
}

/// Tables with an empty line before each; those without rows are left out.
fn push_tables(tables: &[Table], out: &mut String) {
    for table in tables.iter().filter(|table| !table.rows.is_empty()) {
        out.push('\n');
        out.push_str(&table.to_text());
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;

    #[test]
    fn the_demo_ends_with_its_verdict_and_holds_every_table() {
        let mut report = sample::demo();
        (report.units, report.days) = (10, 7);
        let text = print_demo(&report, true);
        for title in [
            "Table I:",
            "Table II:",
            "Table III:",
            "Excavator week",
            "Specification",
        ] {
            assert!(text.contains(title), "{title}");
        }
        assert!(text.ends_with("Product mode is WITHIN its specification.\n"));
        report.within_specification = false;
        assert!(print_demo(&report, true).ends_with("OUTSIDE its specification.\n"));
    }

    #[test]
    fn without_details_the_demo_is_one_screen() {
        let text = print_demo(&sample::demo(), false);
        assert!(text.lines().count() <= 40, "{}", text.lines().count());
        assert!(text.contains("reproduced") && text.contains("--details"));
        assert!(!text.contains("Table I:"));
    }

    #[test]
    fn a_short_run_claims_only_what_it_judged() {
        let mut report = sample::demo();
        for short in [(9, 7), (10, 4)] {
            (report.units, report.days) = short;
            assert!(print_demo(&report, true).ends_with("that so short a run can judge.\n"));
        }
    }

    #[test]
    fn no_line_is_wider_than_103_columns_or_ends_in_a_space() {
        for text in [
            print_demo(&sample::demo(), true),
            print_replay(&sample::replay()),
        ] {
            for line in text.lines() {
                assert!(line.chars().count() <= 103, "{line}");
                assert_eq!(line, line.trim_end());
            }
        }
    }

    #[test]
    fn a_week_that_was_not_run_is_left_out() {
        let mut report = sample::demo();
        report.week.clear();
        assert!(!print_demo(&report, true).contains("Excavator week"));
    }

    #[test]
    fn the_replay_prints_its_notes() {
        let text = print_replay(&sample::replay());
        assert!(text.starts_with("Plumb "));
        assert!(text.contains("2048 LSB per g was taken"));
    }
}
