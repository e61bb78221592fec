//! From the results of the worlds to the report's rows, figures and specification.
//!
//! In: [`Results`]. Out: a [`DemoReport`]. Errors of several units are given as the median of
//! the units' RMSE and as the largest error of all; the figures are drawn from the first unit.

use sim::bench::Mode;
use sim::bench::calibrate::{CalibrationReport, TOLERANCE_DEG};
use sim::bench::dynamic_test::{DynamicPoint, DynamicResult};
use sim::bench::static_test::{StaticPoint, differences, errors};
use sim::bench::statistics::{Tally, median};
use sim::bench::unit::UnitResult;
use sim::bench::week::{self, Day, FAULT_DAY, HOURS_PER_DAY, Trouble};
use sim::rig::Mount;

use super::jobs::{Kind, Results, two_axes};
use super::medians::{largest, median_rms};
use super::options::Arguments;
use super::specification;
use crate::report::data::{
    Angles, Axis, CalibrationRow, Curve, DeltaTrace, DemoReport, DynamicRow, DynamicTrace,
    ErrorType, Figures, Mode as ReportMode, NodeTrace, OneAxisRow, Outcome, StaticRow, Table1Row,
    WeekRow,
};
use output::series::{Binner, finite, points};

const MOUNTS: [Mount; 2] = [Mount::X, Mount::Y];

/// Seconds of the dynamic test that are drawn.
const DRAWN_S: f64 = 6.0;

/// The whole report.
pub fn report(arguments: &Arguments, results: &Results) -> DemoReport {
    let kinds = || two_axes(arguments).into_iter();
    let mounted = || kinds().flat_map(|kind| MOUNTS.map(|mount| (kind, mount)));
    let weeks = results.weeks.iter();
    let Arguments {
        seed, units, days, ..
    } = *arguments;
    DemoReport {
        static_test: mounted().flat_map(|of| static_rows(results, of)).collect(),
        dynamic: mounted().flat_map(|of| dynamic_rows(results, of)).collect(),
        week: weeks
            .flat_map(|(kind, days)| days.iter().map(|day| week_row(*kind, day)))
            .collect(),
        one_axis: [0, 1].map(|node| one_axis_row(results, node)).to_vec(),
        calibration: kinds()
            .flat_map(|kind| calibration_rows(results, kind))
            .collect(),
        table1: results.table_one.iter().map(table_one_row).collect(),
        figures: figures(arguments, results),
        ..DemoReport::new(seed, units, days, specification::judged(results))
    }
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

fn static_rows(results: &Results, (kind, mount): (Kind, Mount)) -> Vec<StaticRow> {
    let mut rows = Vec::new();
    for (knots, angles) in [(true, Angles::Knots), (false, Angles::Random)] {
        let units = results.of(kind);
        let lists: Vec<_> = units.map(|u| static_points(u, mount, knots)).collect();
        let mut difference = Tally::default();
        for points in &lists {
            difference.join(&differences(points));
        }
        let warned = lists.iter().flat_map(|points| *points);
        let warnings = warned.filter(|point| point.warning).count();
        rows.extend([0, 1].map(|node| {
            let tallies: Vec<_> = lists.iter().map(|points| errors(points, node)).collect();
            StaticRow {
                mode: report_mode(kind),
                axis: Axis::from(mount),
                node: node as u8 + 1,
                angles,
                rmse_deg: median_rms(&tallies),
                max_deg: largest(&tallies),
                mean_node_difference_deg: finite(difference.mean()),
                warnings: warnings as u64,
            }
        }));
    }
    rows
}

fn dynamic_rows(results: &Results, (kind, mount): (Kind, Mount)) -> Vec<DynamicRow> {
    let mut rows = Vec::new();
    for arm in [0, 2, 5] {
        let runs = results.of(kind).flat_map(|unit| &unit.dynamics);
        let runs = runs.filter(|run| run.mount == mount && run.lever_arm_cm == arm);
        let runs: Vec<&DynamicResult> = runs.map(|run| &run.result).collect();
        let mut difference = Tally::default();
        runs.iter().for_each(|run| difference.join(&run.difference));
        rows.extend([0, 1].map(|node| {
            let of = |pick: fn(&DynamicResult) -> &[Tally; 2]| -> Vec<Tally> {
                runs.iter().map(|run| pick(run)[node]).collect()
            };
            let arrives = of(|run| &run.as_it_arrives);
            let aligned = of(|run| &run.aligned);
            let mut latency: Vec<_> = of(|run| &run.latency_ms).iter().map(Tally::mean).collect();
            DynamicRow {
                mode: report_mode(kind),
                axis: Axis::from(mount),
                node: node as u8 + 1,
                lever_arm_cm: arm,
                rmse_deg: median_rms(&arrives),
                rmse_aligned_deg: median_rms(&aligned),
                latency_ms: finite(median(&mut latency)),
                max_deg: largest(&arrives),
                max_aligned_deg: largest(&aligned),
                mean_node_difference_deg: finite(difference.mean()),
                warnings: runs.iter().map(|run| run.warnings).sum(),
            }
        }));
    }
    rows
}

fn calibration_rows(results: &Results, kind: Kind) -> [CalibrationRow; 2] {
    [0, 1].map(|node: usize| {
        let reports = || results.of(kind).map(|unit| unit.calibration[node]);
        let worst = |pick: fn(CalibrationReport) -> f64| {
            let value = reports().map(pick).fold(0.0, f64::max);
            (kind.mode() != Mode::Paper).then_some(value)
        };
        let verified = reports().map(|report| report.verification.largest());
        CalibrationRow {
            mode: report_mode(kind),
            node: node as u8 + 1,
            residual_deg: worst(|report| report.residual_deg),
            condition: worst(|report| report.condition),
            verification_max_deg: verified.reduce(f64::max),
            tolerance_deg: TOLERANCE_DEG,
            rounds: reports().map(|report| report.rounds).max().unwrap_or(0),
            accepted: reports().all(|report| report.passed()),
        }
    })
}

/// As printed the instrument reports faults without a cause on every day, so that there one after
/// the cure does not show that the cure failed.
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
    let (error_type, expected) = match trouble {
        Trouble::Delay { .. } => (ErrorType::DataDelay, Outcome::DataDelay),
        _ => (ErrorType::PhysicalFault, Outcome::PhysicalFault),
    };
    let outcome = outcome(*kind, day);
    Table1Row {
        mode: report_mode(*kind),
        error_type,
        warnings: day.warnings,
        stop_s: if day.stops > 0 { 45.0 } else { 0.0 },
        delta_after_stop_deg: day.delta_after_stop_deg,
        outcome,
        as_expected: outcome == expected,
    }
}

/// The figures are those of the first unit.
fn figures(arguments: &Arguments, results: &Results) -> Figures {
    let mut figures = Figures::default();
    for kind in two_axes(arguments) {
        let mode = report_mode(kind);
        let Some(unit) = results.of(kind).next() else {
            continue;
        };
        for mount in MOUNTS {
            let axis = Axis::from(mount);
            let knots = static_points(unit, mount, true);
            let curve = |node: Option<usize>, value: &dyn Fn(&StaticPoint) -> f64| Curve {
                mode,
                axis,
                node: node.map(|node| node as u8 + 1),
                points: points(knots.iter().map(|p| (p.truth_deg, value(p)))),
            };
            let error = |node| curve(Some(node), &|p| p.nodes[node].error_deg);
            figures.static_error.extend([0, 1].map(error));
            let delta = curve(None, &|p| p.delta_deg.unwrap_or(f64::NAN));
            figures.static_delta.push(delta);
            let mut swings = unit.dynamics.iter();
            let swing = swings.find(|run| run.mount == mount && run.lever_arm_cm == 0);
            let drawn = swing.map(|run| trace(&run.result, mode, axis));
            figures.dynamic.extend(drawn);
        }
    }
    for (kind, days) in &results.weeks {
        let day = days.iter().find(|day| day.day == FAULT_DAY);
        let drawn = day.map(|day| delta_trace(report_mode(*kind), day));
        figures.delta.extend(drawn);
    }
    figures
}

fn trace(result: &DynamicResult, mode: ReportMode, axis: Axis) -> DynamicTrace {
    let drawn = || result.points.iter().take_while(|p| p.time_s <= DRAWN_S);
    let over_time = |value: &dyn Fn(&DynamicPoint) -> f64| {
        points(drawn().map(|point| (point.time_s, value(point))))
    };
    let node_trace = |node: usize| {
        let angle = |p: &DynamicPoint| p.nodes_deg[node].unwrap_or(f64::NAN);
        NodeTrace {
            node: node as u8 + 1,
            angle: over_time(&angle),
            error: over_time(&|p| angle(p) - p.truth_deg),
            error_aligned: over_time(&|p| angle(p) - p.truth_then_deg[node]),
        }
    };
    DynamicTrace {
        mode,
        axis,
        reference: over_time(&|p| p.truth_deg),
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
