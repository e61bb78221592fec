//! The tables of a demo report.
//!
//! In: a [`DemoReport`]. Out: the specification, Tables I, II and III, the week, the one-axis
//! instrument and the calibration as [`Table`]s, which the terminal prints and the page shows.
//! A figure that was not obtained is a dash.

use sim::bench::published::{Published, TABLE_THREE, TABLE_TWO};

use super::data::*;
use output::table::{Cell, Column, Table};

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

/// With fewer units than this a median says little, and a single unit's RMSE is not specified.
pub const FEWEST_FOR_MEDIANS: u32 = 10;

/// The specification with pass or fail per line.
pub fn specification(report: &DemoReport) -> Table {
    let columns = vec![
        Column::text("Product mode must keep"),
        Column::text("Result"),
        Column::number("Value"),
        Column::number("Limit"),
        Column::text("Unit"),
    ];
    let mut table = Table::new("Specification", columns);
    table.rows = report.specification.iter().map(specification_row).collect();
    if report.units < FEWEST_FOR_MEDIANS {
        let note = format!(
            "The limits of RMSE are for the median unit; with fewer than {FEWEST_FOR_MEDIANS} \
             units they are not judged."
        );
        table.notes.push(note);
    }
    table
}

fn specification_row(row: &SpecificationRow) -> Vec<Cell> {
    let decimals = if row.unit.is_empty() { 0 } else { 3 };
    let limit = Cell::number(Some(row.limit), decimals).text;
    vec![
        Cell::text(row.name.as_str()),
        Cell::verdict(row.pass, "pass", "FAIL"),
        Cell::number(row.value, decimals),
        Cell::text(format!("{} {limit}", word(row.relation))),
        Cell::text(row.unit.as_str()),
    ]
}

/// Columns of Tables II and III: published and each mode, three figures each.
fn compared(first: Vec<Column>, report: &DemoReport) -> Vec<Column> {
    let groups = std::iter::once("Published").chain(modes(report).into_iter().map(mode_name));
    let figures = groups.flat_map(|group| {
        ["Node 1", "Node 2", "Diff"].map(|name| Column::number(name).under(group))
    });
    first.into_iter().chain(figures).collect()
}

/// The three published figures of an axis, or three empty cells.
fn published(list: &[Published], axis: Axis, shown: bool) -> Vec<Cell> {
    let found = list
        .iter()
        .find(|(mount, _)| Axis::from(*mount) == axis && shown);
    match found {
        Some((_, figures)) => figures.map(|figure| Cell::number(Some(figure), 3)).to_vec(),
        None => vec![Cell::text(""); 3],
    }
}

/// Paper Table II beside both modes, on knots and at random angles.
pub fn table_two(report: &DemoReport) -> Table {
    let first = ["Axis", "Angles and figure"].map(Column::text).to_vec();
    let columns = compared(first, report);
    let mut table = Table::new(
        "Table II: static test from -90 to 90 deg, errors in deg",
        columns,
    );
    for axis in AXES {
        for angles in [Angles::Knots, Angles::Random] {
            for largest in [false, true] {
                table.rows.push(static_row(report, axis, angles, largest));
            }
        }
    }
    table.notes.push(format!(
        "On all angles: {} {STATIC_NOTE}",
        static_warnings(report)
    ));
    table
}

const STATIC_NOTE: &str = "Diff is the mean absolute difference of the two nodes, max the greatest \
    absolute error. The knots are the calibration angles every 10 deg, where the paper stood; \
    random angles show what the table leaves between them. In paper mode a reading is the mean of \
    1 s, in the others one sample.";

fn static_row(report: &DemoReport, axis: Axis, angles: Angles, largest: bool) -> Vec<Cell> {
    let figure = if largest { "max" } else { "RMSE" };
    let name = format!("{}, {figure}", word(angles));
    let mut cells = vec![Cell::text(axis_name(axis)), Cell::text(name)];
    let shown = angles == Angles::Knots && !largest;
    cells.extend(published(&TABLE_TWO, axis, shown));
    for mode in modes(report) {
        let find = |node: u8| {
            let mut rows = report.static_test.iter();
            rows.find(|r| r.mode == mode && r.axis == axis && r.node == node && r.angles == angles)
        };
        for node in [1, 2] {
            let value = find(node).and_then(|row| if largest { row.max_deg } else { row.rmse_deg });
            cells.push(Cell::number(value, 3));
        }
        cells.push(difference(
            find(1).and_then(|row| row.mean_node_difference_deg),
            largest,
        ));
    }
    cells
}

/// The difference of the nodes stands once per condition.
fn difference(value: Option<f64>, elsewhere: bool) -> Cell {
    if elsewhere {
        Cell::text("")
    } else {
        Cell::number(value, 3)
    }
}

fn static_warnings(report: &DemoReport) -> String {
    warnings_sentence(report, |mode| {
        let of_node_1 = report
            .static_test
            .iter()
            .filter(|r| r.mode == mode && r.node == 1);
        of_node_1.map(|row| row.warnings).sum()
    })
}

/// "warnings: published none, paper mode 0, product mode 0."
fn warnings_sentence(report: &DemoReport, count: impl Fn(Mode) -> u64) -> String {
    let each = modes(report).into_iter();
    let each = each.map(|mode| format!(", {} {}", mode_name(mode).to_lowercase(), count(mode)));
    format!("warnings: published none{}.", each.collect::<String>())
}

/// Paper Table III beside both modes, as it arrives and aligned, for each lever arm.
pub fn table_three(report: &DemoReport) -> Table {
    let first = ["Axis", "Arm", "Figure"].map(Column::text).to_vec();
    let title = "Table III: dynamic test, +-40 deg at 80 deg/s, errors in deg";
    let mut table = Table::new(title, compared(first, report));
    let mut arms: Vec<u32> = report.dynamic.iter().map(|row| row.lever_arm_cm).collect();
    arms.sort_unstable();
    arms.dedup();
    for arm in arms {
        for axis in AXES {
            let rows = DYNAMIC_FIGURES
                .iter()
                .map(|figure| dynamic_row(report, axis, arm, figure));
            table.rows.extend(rows);
        }
    }
    // On a lever arm the motion itself is measured, of which the paper says nothing.
    let warnings = warnings_sentence(report, |mode| {
        let of_node_1 = report
            .dynamic
            .iter()
            .filter(|r| r.mode == mode && r.node == 1 && r.lever_arm_cm == 0);
        of_node_1.map(|row| row.warnings).sum()
    });
    let latencies = latencies(report);
    table.notes.push(format!(
        "Without an arm: {warnings} {latencies} {DYNAMIC_NOTE}"
    ));
    table
}

const DYNAMIC_NOTE: &str = "Max is the greatest absolute error; arm is the distance of the sensor \
 from the motor's axis. Aligned means compared with the motor's angle that much earlier. The \
 paper gives one figure and does not state that it was aligned; its filter alone lags 0.64 deg at \
 this speed, so the figure stands beside both. An accelerometer on a lever arm also feels the \
 motion itself, and nothing is done about that here.";

/// One row of Table III: its name, which figure, and whether published figure and difference
/// stand in it.
struct DynamicFigure {
    name: &'static str,
    value: fn(&DynamicRow) -> Option<f64>,
    published: bool,
    difference: bool,
}

const DYNAMIC_FIGURES: [DynamicFigure; 4] = [
    DynamicFigure {
        name: "RMSE as it arrives",
        value: |row| row.rmse_deg,
        published: true,
        difference: true,
    },
    DynamicFigure {
        name: "RMSE aligned",
        value: |row| row.rmse_aligned_deg,
        published: true,
        difference: false,
    },
    DynamicFigure {
        name: "max as it arrives",
        value: |row| row.max_deg,
        published: false,
        difference: false,
    },
    DynamicFigure {
        name: "max aligned",
        value: |row| row.max_aligned_deg,
        published: false,
        difference: false,
    },
];

fn dynamic_row(report: &DemoReport, axis: Axis, arm: u32, figure: &DynamicFigure) -> Vec<Cell> {
    let mut cells = vec![
        Cell::text(axis_name(axis)),
        Cell::text(format!("{arm} cm")),
        Cell::text(figure.name),
    ];
    cells.extend(published(&TABLE_THREE, axis, figure.published && arm == 0));
    for mode in modes(report) {
        let find = |node: u8| {
            let mut rows = report.dynamic.iter();
            rows.find(|r| {
                r.mode == mode && r.axis == axis && r.node == node && r.lever_arm_cm == arm
            })
        };
        cells.extend([1, 2].map(|node| Cell::number(find(node).and_then(figure.value), 3)));
        let delta = find(1).and_then(|row| row.mean_node_difference_deg);
        cells.push(difference(delta, !figure.difference));
    }
    cells
}

fn latencies(report: &DemoReport) -> String {
    let of = |mode: Mode| {
        let row = report.dynamic.iter().find(|row| row.mode == mode);
        Cell::number(row.and_then(|row| row.latency_ms), 1).text
    };
    let each = modes(report).into_iter();
    let each = each.map(|mode| format!("{} {} ms", mode_name(mode).to_lowercase(), of(mode)));
    format!("Declared latency: {}.", each.collect::<Vec<_>>().join(", "))
}

/// Paper Table I: what was provoked and what the cross-check made of it.
pub fn table_one(report: &DemoReport) -> Table {
    let columns = vec![
        Column::text("Mode"),
        Column::text("Provoked"),
        Column::number("Warnings"),
        Column::number("Stop, s"),
        Column::number("Diff, deg"),
        Column::text("Outcome"),
        Column::text("Right"),
    ];
    let mut table = Table::new("Table I: error warning", columns);
    table.rows = report.table1.iter().map(table_one_row).collect();
    let note = "Whole devices on a simulated bus. Diff is the difference of the nodes after the \
     stop. Right means reported as Table I requires; in product mode without a stop of 45 s, by \
     the reason for which the channel is reported as faulty.";
    table.notes.push(note.to_owned());
    table
}

fn table_one_row(row: &Table1Row) -> Vec<Cell> {
    vec![
        Cell::text(word(row.mode)),
        Cell::text(word(row.error_type)),
        Cell::text(row.warnings.to_string()),
        Cell::number(Some(row.stop_s), 0),
        Cell::number(row.delta_after_stop_deg, 3),
        Cell::text(word(row.outcome)),
        Cell::verdict(row.as_expected, "yes", "NO"),
    ]
}

/// The excavator week, one row per mode and day.
pub fn week(report: &DemoReport) -> Table {
    let columns = vec![
        Column::text("Mode"),
        Column::number("Day"),
        Column::number("Hours"),
        Column::number("Warnings"),
        Column::number("Stops"),
        Column::number("Faults"),
        Column::text("Outcome"),
    ];
    let mut table = Table::new("Excavator week", columns);
    for mode in modes(report) {
        let rows = report.week.iter().filter(|row| row.mode == mode);
        table.rows.extend(rows.map(week_row));
    }
    table
}

fn week_row(row: &WeekRow) -> Vec<Cell> {
    let counts = [row.warnings, row.stops, row.faults];
    let mut cells = vec![
        Cell::text(word(row.mode)),
        Cell::text(row.day.to_string()),
        Cell::number(Some(row.hours), 1),
    ];
    cells.extend(counts.map(|count| Cell::text(count.to_string())));
    cells.push(Cell::text(word(row.outcome)));
    cells
}

/// The 360 degree instrument.
pub fn one_axis(report: &DemoReport) -> Table {
    let columns = vec![
        Column::text("Node"),
        Column::number("Angles"),
        Column::number("RMSE"),
        Column::number("Largest error"),
    ];
    let mut table = Table::new(
        "One-axis instrument, full circle, product mode, errors in deg",
        columns,
    );
    table.rows = report
        .one_axis
        .iter()
        .map(|row| {
            vec![
                Cell::text(row.node.to_string()),
                Cell::text(row.angle_count.to_string()),
                Cell::number(row.rmse_deg, 3),
                Cell::number(row.max_deg, 3),
            ]
        })
        .collect();
    table
}

/// Calibration and verification round.
pub fn calibration(report: &DemoReport) -> Table {
    let columns = vec![
        Column::text("Mode"),
        Column::text("Node"),
        Column::number("Residual, deg"),
        Column::number("Condition"),
        Column::number("Largest error, deg"),
        Column::number("Tolerance, deg"),
        Column::number("Rounds"),
        Column::text("Result"),
    ];
    let mut table = Table::new("Calibration and verification round", columns);
    table.rows = report.calibration.iter().map(calibration_row).collect();
    let note = "In paper mode the round is judged up to 80 deg either side: beyond, the table of \
                one axis cannot keep the tolerance.";
    table.notes.push(note.to_owned());
    table
}

fn calibration_row(row: &CalibrationRow) -> Vec<Cell> {
    vec![
        Cell::text(word(row.mode)),
        Cell::text(row.node.to_string()),
        Cell::number(row.residual_deg, 4),
        Cell::number(row.condition, 1),
        Cell::number(row.verification_max_deg, 3),
        Cell::number(Some(row.tolerance_deg), 3),
        Cell::text(row.rounds.to_string()),
        Cell::verdict(row.accepted, "accepted", "NOT ACCEPTED"),
    ]
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
