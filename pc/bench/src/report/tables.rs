//! The tables of a demo report.
//!
//! In: a [`DemoReport`]. Out: the specification, Tables I, II and III, the week, the one-axis
//! instrument and the calibration as [`Table`]s, which the terminal prints and the page shows.
//! A figure that was not obtained is a dash.

use sim::bench::published::{Published, TABLE_THREE, TABLE_TWO};

use super::data::*;
use output::table::{Cell, Column, Rows, Table, format_number};

/// Both axes in the order of the tables.
const AXES: [Axis; 2] = [Axis::X, Axis::Y];

/// The modes of a report in the order of the tables: as printed only where it was asked for.
pub fn modes(report: &DemoReport) -> Vec<Mode> {
    let printed = |row: &StaticRow| row.mode == Mode::AsPrinted;
    let printed = report.static_test.iter().any(printed);
    [Mode::Paper, Mode::AsPrinted, Mode::Product]
        .into_iter()
        .filter(|mode| printed || *mode != Mode::AsPrinted)
        .collect()
}

/// "X" or "Y".
pub fn axis_name(axis: Axis) -> &'static str {
    match axis {
        Axis::X => "X",
        Axis::Y => "Y",
    }
}

/// "Paper mode", "As printed" or "Product mode".
pub fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Paper => "Paper mode",
        Mode::AsPrinted => "As printed",
        Mode::Product => "Product mode",
    }
}

/// With fewer units than this a median means little, and a single unit's RMSE is not specified.
pub const FEWEST_FOR_MEDIANS: u32 = 10;

/// The specification with pass or fail per line.
pub fn specification(report: &DemoReport) -> Table {
    let number = |row: &SpecificationRow, value| {
        let decimals = if row.unit.is_empty() { 0 } else { 3 };
        format_number(value, decimals)
    };
    let limit = |row: &SpecificationRow| {
        let limit = number(row, Some(row.limit));
        format!("{} {limit}", word(row.relation))
    };
    let table = Rows::of("Specification", &report.specification)
        .text("Product mode must keep", |row| &row.name)
        .verdict("Result", ["pass", "FAIL"], |row| row.pass)
        .count("Value", |row| number(row, row.value))
        .count("Limit", limit)
        .text("Unit", |row| &row.unit)
        .table();
    if report.units >= FEWEST_FOR_MEDIANS {
        return table;
    }
    table.noted(format!(
        "The limits of RMSE are for the median unit; with fewer than {FEWEST_FOR_MEDIANS} units \
         they are not judged."
    ))
}

/// What stands in a row of Tables II and III beside the figures of both nodes.
#[derive(Clone, Copy, PartialEq)]
enum Beside {
    /// The published figures, and the difference of the nodes, which stands once per condition.
    Both,
    /// The published figures.
    Published,
    /// Nothing.
    Nothing,
}

/// A figure of Tables II and III: its name, which one of a node's row, and what stands beside it.
type Figure<R> = (&'static str, fn(&R) -> Option<f64>, Beside);

const STATIC_FIGURES: [Figure<StaticRow>; 2] = [
    ("RMSE", |row| row.rmse_deg, Beside::Both),
    ("max", |row| row.max_deg, Beside::Nothing),
];

const DYNAMIC_FIGURES: [Figure<DynamicRow>; 4] = [
    ("RMSE as it arrives", |row| row.rmse_deg, Beside::Both),
    (
        "RMSE aligned",
        |row| row.rmse_aligned_deg,
        Beside::Published,
    ),
    ("max as it arrives", |row| row.max_deg, Beside::Nothing),
    ("max aligned", |row| row.max_aligned_deg, Beside::Nothing),
];

/// Table II or III without rows: published and each mode, three figures each.
fn compared(title: &str, first: &[&str], report: &DemoReport) -> Table {
    let groups = std::iter::once("Published").chain(modes(report).into_iter().map(mode_name));
    let figures = groups.flat_map(|group| {
        ["Node 1", "Node 2", "Diff"].map(|name| Column::number(name).under(group))
    });
    let first = first.iter().map(|name| Column::text(name));
    Table::new(title, first.chain(figures).collect())
}

/// The figures of a row of Table II or III: those of the axis among the published ones, then of
/// each mode those of the nodes' rows that `find` finds.
fn compared_cells<'a, R: 'a>(
    report: &DemoReport,
    published: Option<&Published>,
    (_, value, beside): Figure<R>,
    difference: fn(&R) -> Option<f64>,
    find: impl Fn(Mode, u8) -> Option<&'a R>,
) -> Vec<Cell> {
    let empty = || Cell::text("");
    let mut cells = match published {
        Some((_, figures)) if beside != Beside::Nothing => {
            figures.map(|figure| Cell::number(Some(figure), 3)).to_vec()
        }
        _ => vec![empty(); 3],
    };
    for mode in modes(report) {
        cells.extend([1, 2].map(|node| Cell::number(find(mode, node).and_then(value), 3)));
        let difference = find(mode, 1).and_then(difference);
        cells.push(match beside {
            Beside::Both => Cell::number(difference, 3),
            _ => empty(),
        });
    }
    cells
}

/// What is published of an axis.
fn published(list: &[Published], axis: Axis) -> Option<&Published> {
    list.iter().find(|(mount, _)| Axis::from(*mount) == axis)
}

/// Each mode with what is to be said of it.
fn each_mode(report: &DemoReport, of: impl Fn(Mode) -> String) -> String {
    let named = |mode| format!("{} {}", mode_name(mode).to_lowercase(), of(mode));
    let each: Vec<String> = modes(report).into_iter().map(named).collect();
    each.join(", ")
}

/// Paper Table II beside both modes, on knots and at random angles.
pub fn table_two(report: &DemoReport) -> Table {
    let title = "Table II: static test from -90 to 90 deg, errors in deg";
    let mut table = compared(title, &["Axis", "Angles and figure"], report);
    let conditions = AXES.map(|axis| [Angles::Knots, Angles::Random].map(|angles| (axis, angles)));
    for (axis, angles) in conditions.into_iter().flatten() {
        let published = published(&TABLE_TWO, axis).filter(|_| angles == Angles::Knots);
        let find = |mode, node| report.static_row(mode, axis, angles, node);
        let difference = |row: &StaticRow| row.mean_node_difference_deg;
        for figure in STATIC_FIGURES {
            let name = format!("{}, {}", word(angles), figure.0);
            let mut cells = vec![Cell::text(axis_name(axis)), Cell::text(name)];
            cells.extend(compared_cells(report, published, figure, difference, find));
            table.rows.push(cells);
        }
    }
    let warnings = each_mode(report, |mode| {
        let of = |row: &&StaticRow| row.mode == mode && row.node == 1;
        let rows = report.static_test.iter().filter(of);
        rows.map(|row| row.warnings).sum::<u64>().to_string()
    });
    table.noted(format!(
        "On all angles: warnings: published none, {warnings}. {STATIC_NOTE}"
    ))
}

const STATIC_NOTE: &str = "Diff is the mean absolute difference of the two nodes, max the greatest \
    absolute error. The knots are the calibration angles every 10 deg, where the paper stood; \
    random angles show what the table leaves between them. In paper mode a reading is the mean of \
    1 s, in the others one sample.";

/// Paper Table III beside both modes, as it arrives and aligned, for each lever arm.
pub fn table_three(report: &DemoReport) -> Table {
    let title = "Table III: dynamic test, +-40 deg at 80 deg/s, errors in deg";
    let mut table = compared(title, &["Axis", "Arm", "Figure"], report);
    let mut arms: Vec<u32> = report.dynamic.iter().map(|row| row.lever_arm_cm).collect();
    arms.sort_unstable();
    arms.dedup();
    for (arm, axis) in arms.iter().flat_map(|arm| AXES.map(|axis| (*arm, axis))) {
        let published = published(&TABLE_THREE, axis).filter(|_| arm == 0);
        let find = |mode, node| report.dynamic_row(mode, axis, arm, node);
        let difference = |row: &DynamicRow| row.mean_node_difference_deg;
        for figure in DYNAMIC_FIGURES {
            let arm = format!("{arm} cm");
            let first = [axis_name(axis), &arm, figure.0];
            let mut cells = first.map(Cell::text).to_vec();
            cells.extend(compared_cells(report, published, figure, difference, find));
            table.rows.push(cells);
        }
    }
    // On a lever arm the motion itself is measured, on which the paper has nothing.
    let warnings = each_mode(report, |mode| {
        let of = |row: &&DynamicRow| row.mode == mode && row.node == 1 && row.lever_arm_cm == 0;
        let rows = report.dynamic.iter().filter(of);
        rows.map(|row| row.warnings).sum::<u64>().to_string()
    });
    let latencies = each_mode(report, |mode| {
        let row = report.dynamic.iter().find(|row| row.mode == mode);
        format_number(row.and_then(|row| row.latency_ms), 1) + " ms"
    });
    table.noted(format!(
        "Without an arm: warnings: published none, {warnings}. Declared latency: {latencies}. \
         {DYNAMIC_NOTE}"
    ))
}

const DYNAMIC_NOTE: &str = "Max is the greatest absolute error; arm is the distance of the sensor \
 from the motor's axis. Aligned means compared with the motor's angle that much earlier. The \
 paper gives one figure and does not state that it was aligned; its filter alone lags 0.64 deg at \
 this speed, so the figure stands next to both. An accelerometer on a lever arm also feels the \
 motion itself, and nothing is done about that here.";

/// Paper Table I: what was provoked and what the cross-check made of it.
pub fn table_one(report: &DemoReport) -> Table {
    let note = "Whole devices on a simulated bus. Diff is the difference of the nodes after the \
     stop. Right means reported as Table I requires; in product mode without a stop of 45 s, by \
     the reason for which the channel is reported as faulty.";
    Rows::of("Table I: error warning", &report.table1)
        .text("Mode", |row| word(row.mode))
        .text("Provoked", |row| word(row.error_type))
        .count("Warnings", |row| row.warnings)
        .number("Stop, s", 0, |row| row.stop_s)
        .number("Diff, deg", 3, |row| row.delta_after_stop_deg)
        .text("Outcome", |row| word(row.outcome))
        .verdict("Right", ["yes", "NO"], |row| row.as_expected)
        .table()
        .noted(note)
}

/// The excavator week, one row per mode and day.
pub fn week(report: &DemoReport) -> Table {
    let of = |mode| report.week.iter().filter(move |row| row.mode == mode);
    let rows: Vec<&WeekRow> = modes(report).into_iter().flat_map(of).collect();
    Rows::of("Excavator week", &rows)
        .text("Mode", |row| word(row.mode))
        .count("Day", |row| row.day)
        .number("Hours", 1, |row| row.hours)
        .count("Warnings", |row| row.warnings)
        .count("Stops", |row| row.stops)
        .count("Faults", |row| row.faults)
        .text("Outcome", |row| word(row.outcome))
        .table()
}

/// The 360 degree instrument.
pub fn one_axis(report: &DemoReport) -> Table {
    Rows::of(
        "One-axis instrument, full circle, product mode, errors in deg",
        &report.one_axis,
    )
    .text("Node", |row| row.node)
    .count("Angles", |row| row.angle_count)
    .number("RMSE", 3, |row| row.rmse_deg)
    .number("Largest error", 3, |row| row.max_deg)
    .table()
}

/// Calibration and verification round.
pub fn calibration(report: &DemoReport) -> Table {
    let note = "In paper mode the round is judged up to 80 deg either side: beyond, the table of \
                one axis cannot keep the tolerance.";
    let words = ["accepted", "NOT ACCEPTED"];
    Rows::of("Calibration and verification round", &report.calibration)
        .text("Mode", |row| word(row.mode))
        .text("Node", |row| row.node)
        .number("Residual, deg", 4, |row| row.residual_deg)
        .number("Condition", 1, |row| row.condition)
        .number("Largest error, deg", 3, |row| row.verification_max_deg)
        .number("Tolerance, deg", 3, |row| row.tolerance_deg)
        .count("Rounds", |row| row.rounds)
        .verdict("Result", words, |row| row.accepted)
        .table()
        .noted(note)
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;

    fn texts(row: &[Cell]) -> Vec<&str> {
        row.iter().map(|cell| cell.text.as_str()).collect()
    }

    #[test]
    fn table_two_puts_the_papers_figures_beside_both_modes() {
        let table = table_two(&sample::demo());
        assert_eq!(table.rows.len(), 8);
        let first = texts(&table.rows[0]);
        assert_eq!(first[..5], ["X", "knots, RMSE", "0.106", "0.111", "0.018"]);
        assert_eq!(
            first[5..],
            ["0.113", "0.115", "0.021", "0.030", "0.031", "0.012"]
        );
        let random = texts(&table.rows[2]);
        assert_eq!(random[..5], ["X", "random, RMSE", "", "", ""]);
        assert_eq!(
            texts(&table.rows[4])[..5],
            ["Y", "knots, RMSE", "0.107", "0.112", "0.015"]
        );
        assert_eq!(
            texts(&table.rows[1])[7],
            "",
            "the difference stands once per condition"
        );
    }

    #[test]
    fn table_three_publishes_only_without_lever_arm() {
        let table = table_three(&sample::demo());
        assert_eq!(table.rows.len(), 3 * 2 * 4);
        let arrives = texts(&table.rows[0]);
        assert_eq!(
            arrives[..6],
            ["X", "0 cm", "RMSE as it arrives", "0.091", "0.100", "0.200"]
        );
        let aligned = texts(&table.rows[5]);
        assert_eq!(
            aligned[..6],
            ["Y", "0 cm", "RMSE aligned", "0.088", "0.085", "0.100"]
        );
        assert_eq!(
            texts(&table.rows[8])[1..4],
            ["2 cm", "RMSE as it arrives", ""]
        );
        assert!(table.notes[0].contains("paper mode 16.0 ms, product mode 25.0 ms"));
    }

    #[test]
    fn a_figure_that_is_missing_is_a_dash_and_never_another_ones() {
        let mut report = sample::demo();
        report
            .static_test
            .retain(|row| !(row.mode == Mode::Product && row.node == 2));
        let table = table_two(&report);
        assert_eq!(texts(&table.rows[0])[8..], ["0.030", "-", "0.012"]);
    }

    #[test]
    fn every_row_fills_its_columns() {
        let report = sample::demo();
        let tables = [
            specification(&report),
            table_one(&report),
            table_two(&report),
            table_three(&report),
            week(&report),
            one_axis(&report),
            calibration(&report),
        ];
        for table in tables {
            assert!(!table.rows.is_empty(), "{}", table.title);
            for row in &table.rows {
                assert_eq!(row.len(), table.columns.len(), "{}", table.title);
            }
        }
    }

    #[test]
    fn the_week_lists_one_mode_after_the_other() {
        let table = week(&sample::demo());
        assert_eq!(table.rows.len(), 14);
        assert_eq!(texts(&table.rows[7])[..3], ["product", "1", "3.0"]);
        let outcome = "physical fault, supply checked and reset";
        assert_eq!(
            texts(&table.rows[11])[1..],
            ["5", "3.0", "1730", "1", "3", outcome]
        );
    }

    #[test]
    fn a_broken_limit_is_said_in_a_word() {
        let mut report = sample::demo();
        report.specification[0].pass = false;
        let table = specification(&report);
        assert_eq!(table.rows[0][1].text, "FAIL");
        assert_eq!(table.rows[1][1].text, "pass");
    }
}
