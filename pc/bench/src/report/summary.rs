//! What a reader wants first: the paper's results, what paper mode obtains, and the product.
//!
//! In: a [`DemoReport`]. Out: one table of a dozen rows. The whole tables are in `tables`.

use sim::bench::published::{Published, TABLE_THREE, TABLE_TWO};
use sim::bench::week::FAULT_DAY;

use super::data::*;
use super::tables::{mode_name, modes};
use output::table::{Cell, Column, Table, format_number};

/// Published, paper mode and product mode, row by row.
pub fn summary(report: &DemoReport) -> Table {
    let modes = modes(report);
    let mut columns = vec![
        Column::text("Result of the paper"),
        Column::number("Published"),
    ];
    columns.extend(modes.iter().map(|mode| Column::number(mode_name(*mode))));
    let title = "The paper's results, reproduced, and the product";
    let mut table = Table::new(title, columns);
    let rows = [
        static_rows(report),
        dynamic_rows(report),
        other_rows(report),
    ];
    for row in rows.into_iter().flatten() {
        let mut cells = vec![Cell::text(row.name), Cell::text(row.published)];
        cells.extend(modes.iter().map(|mode| Cell::text((row.obtained)(*mode))));
        table.rows.push(cells);
    }
    table.notes.push(NOTE.to_owned());
    table
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

fn three(figure: Option<f64>) -> String {
    format_number(figure, 3)
}

fn both(figures: [Option<f64>; 2]) -> String {
    figures.map(three).join(", ")
}

/// The rows of one of Tables II and III: RMSE of each axis, then the differences.
fn rows_of<'a>(
    title: &'static str,
    published: &'static [Published; 2],
    rmse: impl Fn(Mode, Axis) -> [Option<f64>; 2] + Copy + 'a,
    difference: impl Fn(Mode, Axis) -> Option<f64> + 'a,
) -> Vec<Row<'a>> {
    let mut rows: Vec<Row<'a>> = Vec::new();
    for (mount, [one, two, _]) in *published {
        let axis = Axis::from(mount);
        rows.push(Row {
            name: format!("{title}, slope {}: RMSE", super::tables::axis_name(axis)),
            published: both([Some(one), Some(two)]),
            obtained: Box::new(move |mode| both(rmse(mode, axis))),
        });
    }
    let [x, y] = published.map(|(_, figures)| Some(figures[2]));
    rows.push(Row {
        name: format!("{title}, X and Y: node difference"),
        published: both([x, y]),
        obtained: Box::new(move |mode| both([Axis::X, Axis::Y].map(|axis| difference(mode, axis)))),
    });
    rows
}

fn static_rows(report: &DemoReport) -> Vec<Row<'_>> {
    let find = move |mode: Mode, axis: Axis, node: u8| {
        let mut rows = report.static_test.iter();
        rows.find(move |row| {
            row.angles == Angles::Knots && row.mode == mode && row.axis == axis && row.node == node
        })
    };
    rows_of(
        "Table II",
        &TABLE_TWO,
        move |mode, axis| [1, 2].map(|node| find(mode, axis, node).and_then(|row| row.rmse_deg)),
        move |mode, axis| find(mode, axis, 1).and_then(|row| row.mean_node_difference_deg),
    )
}

fn dynamic_rows(report: &DemoReport) -> Vec<Row<'_>> {
    let find = move |mode: Mode, axis: Axis, node: u8| {
        let mut rows = report.dynamic.iter();
        rows.find(move |row| {
            row.lever_arm_cm == 0 && row.mode == mode && row.axis == axis && row.node == node
        })
    };
    let mut rows = rows_of(
        "Table III, aligned",
        &TABLE_THREE,
        move |mode, axis| {
            [1, 2].map(|node| find(mode, axis, node).and_then(|row| row.rmse_aligned_deg))
        },
        move |mode, axis| find(mode, axis, 1).and_then(|row| row.mean_node_difference_deg),
    );
    rows.push(Row {
        name: "Table III, X and Y: warnings".to_owned(),
        published: "none, none".to_owned(),
        obtained: Box::new(move |mode| {
            let count =
                |axis| find(mode, axis, 1).map_or_else(dash, |row| row.warnings.to_string());
            [Axis::X, Axis::Y].map(count).join(", ")
        }),
    });
    rows
}

fn other_rows(report: &DemoReport) -> Vec<Row<'_>> {
    vec![
        Row {
            name: "R15, verification round".to_owned(),
            published: "passed".to_owned(),
            obtained: Box::new(move |mode| accepted(report, mode)),
        },
        Row {
            name: "Table I, data delay and physical fault".to_owned(),
            published: "distinguished".to_owned(),
            obtained: Box::new(move |mode| told(report, mode)),
        },
        Row {
            name: "Fig 20, faults on the day of the bad supply".to_owned(),
            published: "at least 1".to_owned(),
            obtained: Box::new(move |mode| faults(report, mode, |day| day == FAULT_DAY)),
        },
        Row {
            name: "Fig 20, faults on the other days".to_owned(),
            published: "none".to_owned(),
            obtained: Box::new(move |mode| faults(report, mode, |day| day != FAULT_DAY)),
        },
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
