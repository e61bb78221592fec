//! From the results of the worlds to the report's rows, figures and specification.
//!
//! In: [`Results`]. Out: a [`DemoReport`]. Errors of several units are given as the median of
//! the units' RMSE and as the largest error of all; the figures are drawn from the first unit.

use sim::bench::Mode;
use sim::bench::calibrate::{CalibrationReport, TOLERANCE_DEG};
use sim::bench::dynamic_test::DynamicResult;
use sim::bench::static_test::{StaticPoint, differences, errors};
use sim::bench::statistics::{Tally, median};
use sim::bench::unit::UnitResult;
use sim::bench::week::{self, Day, FAULT_DAY, HOURS_PER_DAY, Trouble};
use sim::rig::Mount;

use super::Arguments;
use super::jobs::{Kind, Results, two_axes};
use crate::report::data::{
    Angles, Axis, CalibrationRow, Curve, DeltaTrace, DemoReport, DynamicRow, DynamicTrace,
    ErrorType, Figures, Mode as ReportMode, NodeTrace, OneAxisRow, Outcome, Relation,
    SpecificationRow, StaticRow, Table1Row, WeekRow,
};
use crate::report::tables::FEWEST_FOR_MEDIANS;
use output::series::{Binner, finite, points};

const MOUNTS: [Mount; 2] = [Mount::X, Mount::Y];

/// Seconds of the dynamic test that are drawn.
const DRAWN_S: f64 = 6.0;

/// The whole report.
pub fn report(arguments: &Arguments, results: &Results) -> DemoReport {
    let specification = specification(results);
    let mut report = DemoReport::new(
        arguments.seed,
        arguments.units,
        arguments.days,
        specification,
    );
    for kind in two_axes(arguments) {
        let name = report_mode(kind);
        for mount in MOUNTS {
            let axis = Axis::from(mount);
            report
                .static_test
                .extend(static_rows(results, kind, mount, (name, axis)));
            report
                .dynamic
                .extend(dynamic_rows(results, kind, mount, (name, axis)));
        }
        report
            .calibration
            .extend(calibration_rows(results, kind, name));
    }
    for (kind, days) in &results.weeks {
        report
            .week
            .extend(days.iter().map(|day| week_row(*kind, day)));
    }
    report.one_axis = [0, 1].map(|node| one_axis_row(results, node)).to_vec();
    report.table1 = results.table_one.iter().map(table_one_row).collect();
    report.figures = figures(arguments, results);
    report
}

fn report_mode(kind: Kind) -> ReportMode {
    match kind {
        Kind::Paper => ReportMode::Paper,
        Kind::AsPrinted => ReportMode::AsPrinted,
        Kind::Product | Kind::OneAxis => ReportMode::Product,
    }
}

fn static_points(unit: &UnitResult, mount: Mount, knots: bool) -> &[StaticPoint] {
    let run = unit
        .statics
        .iter()
        .find(|run| run.mount == mount && run.knots == knots);
    run.map_or(&[], |run| run.points.as_slice())
}

fn static_rows(
    results: &Results,
    kind: Kind,
    mount: Mount,
    (name, axis): (ReportMode, Axis),
) -> Vec<StaticRow> {
    let mut rows = Vec::new();
    for (knots, angles) in [(true, Angles::Knots), (false, Angles::Random)] {
        let lists: Vec<_> = results
            .of(kind)
            .map(|u| static_points(u, mount, knots))
            .collect();
        let mut difference = Tally::default();
        lists
            .iter()
            .for_each(|points| difference.join(&differences(points)));
        let warnings = lists
            .iter()
            .flat_map(|p| p.iter())
            .filter(|p| p.warning)
            .count();
        for node in 0..2 {
            let tallies: Vec<_> = lists.iter().map(|points| errors(points, node)).collect();
            rows.push(StaticRow {
                mode: name,
                axis,
                node: node as u8 + 1,
                angles,
                rmse_deg: median_rms(&tallies),
                max_deg: largest(&tallies),
                mean_node_difference_deg: finite(difference.mean()),
                warnings: warnings as u64,
            });
        }
    }
    rows
}

fn median_rms(tallies: &[Tally]) -> Option<f64> {
    let mut rms: Vec<_> = tallies
        .iter()
        .filter(|t| t.count() > 0)
        .map(Tally::rms)
        .collect();
    (!rms.is_empty()).then(|| median(&mut rms))
}

fn largest(tallies: &[Tally]) -> Option<f64> {
    tallies
        .iter()
        .filter(|t| t.count() > 0)
        .map(Tally::largest)
        .reduce(f64::max)
}

fn dynamic_rows(
    results: &Results,
    kind: Kind,
    mount: Mount,
    (name, axis): (ReportMode, Axis),
) -> Vec<DynamicRow> {
    let mut rows = Vec::new();
    for arm in [0, 2, 5] {
        let runs: Vec<&DynamicResult> = results
            .of(kind)
            .flat_map(|unit| &unit.dynamics)
            .filter(|run| run.mount == mount && run.lever_arm_cm == arm)
            .map(|run| &run.result)
            .collect();
        let mut difference = Tally::default();
        runs.iter().for_each(|run| difference.join(&run.difference));
        for node in 0..2 {
            let of = |pick: fn(&DynamicResult) -> &[Tally; 2]| -> Vec<Tally> {
                runs.iter().map(|run| pick(run)[node]).collect()
            };
            let arrives = of(|run| &run.as_it_arrives);
            let aligned = of(|run| &run.aligned);
            let mut latency: Vec<_> = of(|run| &run.latency_ms).iter().map(Tally::mean).collect();
            rows.push(DynamicRow {
                mode: name,
                axis,
                node: node as u8 + 1,
                lever_arm_cm: arm,
                rmse_deg: median_rms(&arrives),
                rmse_aligned_deg: median_rms(&aligned),
                latency_ms: finite(median(&mut latency)),
                max_deg: largest(&arrives),
                max_aligned_deg: largest(&aligned),
                mean_node_difference_deg: finite(difference.mean()),
                warnings: runs.iter().map(|run| run.warnings).sum(),
            });
        }
    }
    rows
}

fn calibration_rows(results: &Results, kind: Kind, name: ReportMode) -> Vec<CalibrationRow> {
    let row = |node: usize| {
        let reports: Vec<CalibrationReport> = results
            .of(kind)
            .map(|unit| unit.calibration[node])
            .collect();
        let worst = |pick: fn(&CalibrationReport) -> f64| {
            let value = reports.iter().map(pick).fold(0.0, f64::max);
            (kind.mode() != Mode::Paper).then_some(value)
        };
        CalibrationRow {
            mode: name,
            node: node as u8 + 1,
            residual_deg: worst(|r| r.residual_deg),
            condition: worst(|r| r.condition),
            verification_max_deg: reports
                .iter()
                .map(|r| r.verification.largest())
                .reduce(f64::max),
            tolerance_deg: TOLERANCE_DEG,
            rounds: reports.iter().map(|r| r.rounds).max().unwrap_or(0),
            accepted: reports.iter().all(CalibrationReport::passed),
        }
    };
    [0, 1].map(row).to_vec()
}

/// As printed the instrument reports faults without a cause on every day, so that there one after
/// the cure does not say that the cure failed.
fn outcome(kind: Kind, day: &Day) -> Outcome {
    match day.outcome {
        week::Outcome::None => Outcome::None,
        week::Outcome::Warnings => Outcome::Warnings,
        week::Outcome::DataDelay => Outcome::DataDelay,
        week::Outcome::FaultWithoutCause => Outcome::FaultWithoutCause,
        week::Outcome::SupplyFault if kind != Kind::AsPrinted && day.after_cure > 0 => {
            Outcome::NotCured
        }
        week::Outcome::SupplyFault => Outcome::PhysicalFault,
    }
}

fn week_row(kind: Kind, day: &Day) -> WeekRow {
    WeekRow {
        mode: report_mode(kind),
        day: day.day,
        hours: HOURS_PER_DAY,
        warnings: day.warnings,
        stops: day.stops,
        faults: day.faults,
        outcome: outcome(kind, day),
    }
}

fn one_axis_row(results: &Results, node: usize) -> OneAxisRow {
    let tallies: Vec<_> = results
        .of(Kind::OneAxis)
        .map(|unit| errors(static_points(unit, Mount::X, false), node))
        .collect();
    OneAxisRow {
        node: node as u8 + 1,
        angle_count: tallies.iter().map(Tally::count).sum(),
        rmse_deg: median_rms(&tallies),
        max_deg: largest(&tallies),
    }
}

fn table_one_row((kind, trouble, day): &(Kind, Trouble, Day)) -> Table1Row {
    let delay = matches!(trouble, Trouble::Delay { .. });
    let expected = if delay {
        Outcome::DataDelay
    } else {
        Outcome::PhysicalFault
    };
    let outcome = outcome(*kind, day);
    Table1Row {
        mode: report_mode(*kind),
        error_type: if delay {
            ErrorType::DataDelay
        } else {
            ErrorType::PhysicalFault
        },
        warnings: day.warnings,
        stop_s: if day.stops > 0 { 45.0 } else { 0.0 },
        delta_after_stop_deg: day.delta_after_stop_deg,
        outcome,
        as_expected: outcome == expected,
    }
}

/// The specification of product mode, as the demo can check it.
fn specification(results: &Results) -> Vec<SpecificationRow> {
    let line = |name: &str, value: Option<f64>, limit: f64| {
        SpecificationRow::new(
            name,
            value.unwrap_or(f64::NAN),
            Relation::AtMost,
            limit,
            "deg",
        )
    };
    let units: Vec<_> = results.of(Kind::Product).collect();
    let per_unit = |pick: &dyn Fn(&UnitResult) -> Tally| -> Vec<Tally> {
        units.iter().map(|unit| pick(unit)).collect()
    };
    let random = per_unit(&|unit| all_errors(unit, |run_knots, _| !run_knots));
    let vertical = per_unit(&|unit| all_errors(unit, |knots, p| knots && p.truth_deg.abs() > 89.0));
    let swing = per_unit(&|unit| {
        let mut tally = Tally::default();
        for run in unit.dynamics.iter().filter(|run| run.lever_arm_cm == 0) {
            run.result.aligned.iter().for_each(|t| tally.join(t));
        }
        tally
    });
    let one_axis: Vec<_> = results
        .of(Kind::OneAxis)
        .map(|u| all_errors(u, |k, _| !k))
        .collect();
    let medians = [
        line(
            "two axes, random angles +-90, RMSE, median unit",
            median_rms(&random),
            0.040,
        ),
        line(
            "two axes, at +-90 only, RMSE, median unit",
            median_rms(&vertical),
            0.09,
        ),
        line(
            "one axis 360 deg, RMSE, median unit",
            median_rms(&one_axis),
            0.035,
        ),
        line(
            "80 deg/s, lever arm 0, aligned, RMSE, median unit",
            median_rms(&swing),
            0.045,
        ),
    ];
    let largest = largest(&random);
    let mut lines = vec![line(
        "two axes, random angles +-90, largest error",
        largest,
        0.20,
    )];
    if units.len() >= FEWEST_FOR_MEDIANS as usize {
        lines.extend(medians);
    }
    lines.extend(week_specification(results));
    lines
}

fn all_errors(unit: &UnitResult, keep: impl Fn(bool, &StaticPoint) -> bool) -> Tally {
    let mut tally = Tally::default();
    for run in &unit.statics {
        let kept: Vec<_> = run
            .points
            .iter()
            .copied()
            .filter(|p| keep(run.knots, p))
            .collect();
        (0..2).for_each(|node| tally.join(&errors(&kept, node)));
    }
    tally
}

fn week_specification(results: &Results) -> Vec<SpecificationRow> {
    let days = results
        .weeks
        .iter()
        .filter(|(kind, _)| *kind == Kind::Product);
    let days: Vec<_> = days.flat_map(|(_, days)| days).collect();
    if days.is_empty() {
        return Vec::new();
    }
    let quiet: u64 = days
        .iter()
        .filter(|d| d.day != FAULT_DAY)
        .map(|d| d.warnings)
        .sum();
    let count = |name: &str, value: u64, relation, limit| {
        SpecificationRow::new(name, value as f64, relation, limit, "")
    };
    let mut lines = vec![count(
        "excavator, warnings on days with a good supply",
        quiet,
        Relation::Exactly,
        0.0,
    )];
    if let Some(day) = days.iter().find(|d| d.day == FAULT_DAY) {
        let name = "excavator, faults reported on the day of the bad supply";
        lines.push(count(name, day.faults, Relation::AtLeast, 1.0));
        let name = "excavator, faults left after the supply was mended and reset";
        lines.push(count(name, day.after_cure, Relation::Exactly, 0.0));
    }
    lines
}

fn figures(arguments: &Arguments, results: &Results) -> Figures {
    let mut figures = Figures::default();
    for kind in two_axes(arguments) {
        let name = report_mode(kind);
        let Some(unit) = results.of(kind).next() else {
            continue;
        };
        for mount in MOUNTS {
            let axis = Axis::from(mount);
            let knots = static_points(unit, mount, true);
            figures.static_error.extend(error_curves(knots, name, axis));
            let delta = knots
                .iter()
                .map(|p| (p.truth_deg, p.delta_deg.unwrap_or(f64::NAN)));
            let points = points(delta);
            figures.static_delta.push(Curve {
                mode: name,
                axis,
                node: None,
                points,
            });
            let swing = unit
                .dynamics
                .iter()
                .find(|r| r.mount == mount && r.lever_arm_cm == 0);
            figures
                .dynamic
                .extend(swing.map(|run| trace(&run.result, name, axis)));
        }
    }
    for (kind, days) in &results.weeks {
        let day = days.iter().find(|day| day.day == FAULT_DAY);
        figures
            .delta
            .extend(day.map(|day| delta_trace(report_mode(*kind), day)));
    }
    figures
}

fn error_curves(knots: &[StaticPoint], mode: ReportMode, axis: Axis) -> [Curve; 2] {
    [0, 1].map(|node| Curve {
        mode,
        axis,
        node: Some(node as u8 + 1),
        points: points(knots.iter().map(|p| (p.truth_deg, p.nodes[node].error_deg))),
    })
}

fn trace(result: &DynamicResult, mode: ReportMode, axis: Axis) -> DynamicTrace {
    let drawn: Vec<_> = result
        .points
        .iter()
        .take_while(|p| p.time_s <= DRAWN_S)
        .collect();
    let node_trace = |node: usize| {
        let angle =
            |p: &sim::bench::dynamic_test::DynamicPoint| p.nodes_deg[node].unwrap_or(f64::NAN);
        NodeTrace {
            node: node as u8 + 1,
            angle: points(drawn.iter().map(|p| (p.time_s, angle(p)))),
            error: points(drawn.iter().map(|p| (p.time_s, angle(p) - p.truth_deg))),
            error_aligned: points(
                drawn
                    .iter()
                    .map(|p| (p.time_s, angle(p) - p.truth_then_deg[node])),
            ),
        }
    };
    DynamicTrace {
        mode,
        axis,
        reference: points(drawn.iter().map(|p| (p.time_s, p.truth_deg))),
        nodes: [0, 1].map(node_trace).to_vec(),
    }
}

fn delta_trace(mode: ReportMode, day: &Day) -> DeltaTrace {
    let mut binner = Binner::new(0.0, HOURS_PER_DAY * 3600.0, 540);
    for bin in &day.trace {
        bin.range_deg
            .iter()
            .for_each(|&d| binner.push(bin.time_s, d));
    }
    DeltaTrace {
        mode,
        day: day.day,
        bins: binner.finish(),
    }
}
