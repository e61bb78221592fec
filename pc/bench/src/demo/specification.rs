//! What product mode must keep, as far as the demo can judge it.
//!
//! In: [`Results`]. Out: a row for each limit. A line is left out where too little was run for it.

use sim::bench::static_test::{StaticPoint, errors};
use sim::bench::statistics::Tally;
use sim::bench::unit::{StaticRun, UnitResult};
use sim::bench::week::{Day, FAULT_DAY};

use super::jobs::{Kind, Results};
use super::medians::{largest, median_rms};
use crate::report::data::{Relation, SpecificationRow};
use crate::report::tables::FEWEST_FOR_MEDIANS;

/// What must have been run for a line to be judged.
#[derive(Clone, Copy)]
enum Needs {
    /// Any unit.
    Units,
    /// As many units as a median takes.
    Medians,
    /// A day on the excavator.
    Days,
    /// The day of the bad supply.
    FaultDay,
}

/// One line.
struct Line {
    name: &'static str,
    value: fn(&Results) -> Option<f64>,
    relation: Relation,
    limit: f64,
    unit: &'static str,
    needs: Needs,
}

impl Line {
    /// A limit of an error, deg.
    const fn error(
        name: &'static str,
        limit: f64,
        needs: Needs,
        value: fn(&Results) -> Option<f64>,
    ) -> Self {
        Self {
            unit: "deg",
            ..Self::count(name, (Relation::AtMost, limit), needs, value)
        }
    }

    /// A limit of something counted on the excavator.
    const fn count(
        name: &'static str,
        (relation, limit): (Relation, f64),
        needs: Needs,
        value: fn(&Results) -> Option<f64>,
    ) -> Self {
        Self {
            name,
            value,
            relation,
            limit,
            unit: "",
            needs,
        }
    }
}

const NONE: (Relation, f64) = (Relation::Exactly, 0.0);

const LINES: [Line; 8] = [
    Line::error(
        "two axes, random angles +-90, largest error",
        0.20,
        Needs::Units,
        |results| largest(&random(results, Kind::Product)),
    ),
    Line::error(
        "two axes, random angles +-90, RMSE, median unit",
        0.040,
        Needs::Medians,
        |results| median_rms(&random(results, Kind::Product)),
    ),
    Line::error(
        "two axes, at +-90 only, RMSE, median unit",
        0.09,
        Needs::Medians,
        |results| {
            let upright = |run: &StaticRun, p: &StaticPoint| run.knots && p.truth_deg.abs() > 89.0;
            median_rms(&static_errors(results, Kind::Product, upright))
        },
    ),
    Line::error(
        "one axis 360 deg, RMSE, median unit",
        0.035,
        Needs::Medians,
        |results| median_rms(&random(results, Kind::OneAxis)),
    ),
    Line::error(
        "80 deg/s, lever arm 0, aligned, RMSE, median unit",
        0.045,
        Needs::Medians,
        |results| median_rms(&results.of(Kind::Product).map(swing).collect::<Vec<_>>()),
    ),
    Line::count(
        "excavator, warnings on days with a good supply",
        NONE,
        Needs::Days,
        |results| {
            let quiet = days(results).filter(|day| day.day != FAULT_DAY);
            Some(quiet.map(|day| day.warnings).sum::<u64>() as f64)
        },
    ),
    Line::count(
        "excavator, faults reported on the day of the bad supply",
        (Relation::AtLeast, 1.0),
        Needs::FaultDay,
        |results| Some(fault_day(results)?.faults as f64),
    ),
    Line::count(
        "excavator, faults left after the supply was mended and reset",
        NONE,
        Needs::FaultDay,
        |results| Some(fault_day(results)?.after_cure as f64),
    ),
];

/// The lines that this run can judge, each with its value.
pub fn judged(results: &Results) -> Vec<SpecificationRow> {
    let can = |line: &&Line| match line.needs {
        Needs::Units => true,
        Needs::Medians => results.of(Kind::Product).count() >= FEWEST_FOR_MEDIANS as usize,
        Needs::Days => days(results).next().is_some(),
        Needs::FaultDay => fault_day(results).is_some(),
    };
    let row = |line: &Line| {
        let value = (line.value)(results).unwrap_or(f64::NAN);
        SpecificationRow::new(line.name, value, line.relation, line.limit, line.unit)
    };
    LINES.iter().filter(can).map(row).collect()
}

/// Errors of each unit at the points to keep, both nodes together.
fn static_errors(
    results: &Results,
    kind: Kind,
    keep: impl Fn(&StaticRun, &StaticPoint) -> bool,
) -> Vec<Tally> {
    let of = |unit: &UnitResult| {
        let mut tally = Tally::default();
        for run in &unit.statics {
            let points = run.points.iter().copied();
            let kept: Vec<_> = points.filter(|point| keep(run, point)).collect();
            (0..2).for_each(|node| tally.join(&errors(&kept, node)));
        }
        tally
    };
    results.of(kind).map(of).collect()
}

fn random(results: &Results, kind: Kind) -> Vec<Tally> {
    static_errors(results, kind, |run, _| !run.knots)
}

/// Aligned errors of a unit on the swing without lever arm.
fn swing(unit: &UnitResult) -> Tally {
    let runs = unit.dynamics.iter().filter(|run| run.lever_arm_cm == 0);
    let mut tally = Tally::default();
    runs.flat_map(|run| &run.result.aligned)
        .for_each(|aligned| tally.join(aligned));
    tally
}

/// The days of product mode.
fn days(results: &Results) -> impl Iterator<Item = &Day> {
    let weeks = results.weeks.iter();
    let product = weeks.filter(|(kind, _)| *kind == Kind::Product);
    product.flat_map(|(_, days)| days)
}

fn fault_day(results: &Results) -> Option<&Day> {
    days(results).find(|day| day.day == FAULT_DAY)
}
