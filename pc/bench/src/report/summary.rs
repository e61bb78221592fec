//! What a reader wants first: the paper's results, what paper mode obtains, and the product.
//!
//! In: a [`DemoReport`]. Out: one table of a dozen rows. The whole tables are in `tables`.

use sim::bench::published::{Published, TABLE_THREE, TABLE_TWO};
use sim::bench::week::FAULT_DAY;

use super::data::*;
use super::tables::{FEWEST_FOR_MEDIANS, axis_name, mode_name, modes};
use output::table::{Rows, Table, format_number};

/// Published, paper mode and product mode, row by row.
pub fn summary(report: &DemoReport) -> Table {
    let mut rows = static_rows(report);
    rows.extend(dynamic_rows(report));
    rows.extend(other_rows(report));
    let mut made = Rows::of("The paper's results, reproduced, and the product", &rows)
        .text("Result of the paper", |row| &row.name)
        .count("Published", |row| &row.published);
    for mode in modes(report) {
        made = made.count(mode_name(mode), |row| (row.obtained)(mode));
    }
    made.table().noted(NOTE)
}

const NOTE: &str = "Errors in deg, of node 1 and node 2, medians of the units. Table II is \
    the static test on the knots, Table III the swing at 80 deg/s; aligned means compared \
    with where the motor was the declared latency earlier. Paper mode is the paper read so that \
    its own results hold, on the paper's machine (docs/paper.md); product mode works on a \
    rougher one.";

/// One row: its name, what is published, and what each mode obtained.
struct Row<'a> {
    name: String,
    published: String,
    obtained: Box<dyn Fn(Mode) -> String + 'a>,
}

impl<'a> Row<'a> {
    fn new(
        name: impl Into<String>,
        published: impl Into<String>,
        obtained: impl Fn(Mode) -> String + 'a,
    ) -> Self {
        Self {
            name: name.into(),
            published: published.into(),
            obtained: Box::new(obtained),
        }
    }
}

fn both(figures: [Option<f64>; 2]) -> String {
    figures.map(|figure| format_number(figure, 3)).join(", ")
}

/// The rows of one of Tables II and III: RMSE of each axis, then the differences.
fn rows_of<'a>(
    title: &'static str,
    published: &'static [Published; 2],
    rmse: impl Fn(Mode, Axis, u8) -> Option<f64> + Copy + 'a,
    difference: impl Fn(Mode, Axis) -> Option<f64> + 'a,
) -> Vec<Row<'a>> {
    let mut rows = Vec::new();
    for (mount, [one, two, _]) in *published {
        let axis = Axis::from(mount);
        rows.push(Row::new(
            format!("{title}, slope {}: RMSE", axis_name(axis)),
            both([Some(one), Some(two)]),
            move |mode| both([1, 2].map(|node| rmse(mode, axis, node))),
        ));
    }
    rows.push(Row::new(
        format!("{title}, X and Y: node difference"),
        both(published.map(|(_, figures)| Some(figures[2]))),
        move |mode| both([Axis::X, Axis::Y].map(|axis| difference(mode, axis))),
    ));
    rows
}

fn static_rows(report: &DemoReport) -> Vec<Row<'_>> {
    let find = |mode, axis, node| report.static_row(mode, axis, Angles::Knots, node);
    rows_of(
        "Table II",
        &TABLE_TWO,
        move |mode, axis, node| find(mode, axis, node)?.rmse_deg,
        move |mode, axis| find(mode, axis, 1)?.mean_node_difference_deg,
    )
}

fn dynamic_rows(report: &DemoReport) -> Vec<Row<'_>> {
    let find = |mode, axis, node| report.dynamic_row(mode, axis, 0, node);
    let mut rows = rows_of(
        "Table III, aligned",
        &TABLE_THREE,
        move |mode, axis, node| find(mode, axis, node)?.rmse_aligned_deg,
        move |mode, axis| find(mode, axis, 1)?.mean_node_difference_deg,
    );
    let warnings = move |mode| {
        let count = |axis| find(mode, axis, 1).map_or_else(dash, |row| row.warnings.to_string());
        [Axis::X, Axis::Y].map(count).join(", ")
    };
    let name = "Table III, X and Y: warnings";
    rows.push(Row::new(name, "none, none", warnings));
    rows
}

fn other_rows(report: &DemoReport) -> [Row<'_>; 4] {
    [
        Row::new("R15, verification round", "passed", |mode| {
            accepted(report, mode)
        }),
        Row::new(
            "Table I, data delay and physical fault",
            "distinguished",
            |mode| told(report, mode),
        ),
        Row::new(
            "Fig 20, faults on the day of the bad supply",
            "at least 1",
            |mode| faults(report, mode, |day| day == FAULT_DAY),
        ),
        Row::new("Fig 20, faults on the other days", "none", |mode| {
            faults(report, mode, |day| day != FAULT_DAY)
        }),
    ]
}

fn dash() -> String {
    "-".to_owned()
}

fn accepted(report: &DemoReport, mode: Mode) -> String {
    let rows = report.calibration.iter().filter(|row| row.mode == mode);
    let (passed, failed): (Vec<_>, Vec<_>) = rows.partition(|row| row.accepted);
    match (passed.is_empty(), failed.is_empty()) {
        (true, true) => dash(),
        (false, true) => "passed".to_owned(),
        _ => "NOT PASSED".to_owned(),
    }
}

/// What Table I's two causes led to.
fn told(report: &DemoReport, mode: Mode) -> String {
    let rows: Vec<_> = report
        .table1
        .iter()
        .filter(|row| row.mode == mode)
        .collect();
    let mut outcomes: Vec<_> = rows.iter().map(|row| row.outcome).collect();
    outcomes.dedup();
    if rows.is_empty() {
        dash()
    } else if !rows.iter().all(|row| row.as_expected) {
        "NOT AS ASKED".to_owned()
    } else if outcomes.len() == rows.len() {
        "distinguished".to_owned()
    } else {
        "both reported".to_owned()
    }
}

/// Faults over the days that `which` names; a dash where none of them was dug.
fn faults(report: &DemoReport, mode: Mode, which: impl Fn(u32) -> bool) -> String {
    let days = report.week.iter().filter(|row| row.mode == mode);
    let days: Vec<_> = days.filter(|row| which(row.day)).collect();
    if days.is_empty() {
        return dash();
    }
    days.iter().map(|row| row.faults).sum::<u64>().to_string()
}

/// The verdict in one sentence, which states it where a run is too short for some lines of the
/// specification.
pub fn verdict(report: &DemoReport) -> &'static str {
    let whole = report.units >= FEWEST_FOR_MEDIANS && report.days >= FAULT_DAY;
    match (report.within_specification, whole) {
        (true, true) => "Product mode is WITHIN its specification.",
        (true, false) => {
            "Product mode is WITHIN those lines of its specification that so short a run can judge."
        }
        (false, _) => "Product mode is OUTSIDE its specification.",
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;

    #[test]
    fn every_row_has_a_figure_of_each_mode() {
        let table = summary(&sample::demo());
        assert_eq!(table.rows.len(), 11);
        for row in &table.rows {
            assert_eq!(row.len(), table.columns.len());
            assert!(row.iter().all(|cell| !cell.text.is_empty()), "{row:?}");
        }
        let first: Vec<_> = table.rows[0]
            .iter()
            .map(|cell| cell.text.as_str())
            .collect();
        let expected = ["0.106, 0.111", "0.113, 0.115", "0.030, 0.031"];
        assert_eq!(first[1..], expected);
    }

    #[test]
    fn what_was_not_run_is_a_dash() {
        let mut report = sample::demo();
        report.week.clear();
        report.table1.clear();
        let table = summary(&report);
        for row in &table.rows[8..] {
            assert!(row[2..].iter().all(|cell| cell.text == "-"), "{row:?}");
        }
    }

    #[test]
    fn a_verification_that_was_not_passed_is_said() {
        let mut report = sample::demo();
        report
            .calibration
            .iter_mut()
            .for_each(|row| row.accepted = false);
        let table = summary(&report);
        assert_eq!(table.rows[7][2].text, "NOT PASSED");
    }
}
