//! Tables II and III and the calibration: the published figures, paper mode and product mode.

use std::fmt::Write as _;

use sim::bench::dynamic_test::DynamicResult;
use sim::bench::published::{TABLE_THREE, TABLE_TWO};
use sim::bench::static_test::{StaticPoint, differences, errors};
use sim::bench::statistics::{Tally, median};
use sim::bench::unit::UnitResult;
use sim::rig::Mount;

use crate::{Passage, summary};

pub fn points_of(unit: &UnitResult, mount: Mount, knots: bool) -> &[StaticPoint] {
    let run = unit
        .statics
        .iter()
        .find(|r| r.mount == mount && r.knots == knots);
    run.map_or(&[], |run| run.points.as_slice())
}

/// Node differences of a static test over all units: sizes, and how many are above 0.40 deg.
pub fn node_differences(units: &[Passage], mount: Mount, knots: bool) -> (Tally, usize) {
    let mut difference = Tally::default();
    let mut warnings = 0;
    for unit in units {
        let points = points_of(&unit.unit, mount, knots);
        difference.join(&differences(points));
        warnings += points.iter().filter(|p| p.warning).count();
    }
    (difference, warnings)
}

/// Errors of one node in a static test, by unit.
pub fn static_errors(units: &[Passage], mount: Mount, knots: bool, node: usize) -> Vec<Tally> {
    let of = |unit: &Passage| errors(points_of(&unit.unit, mount, knots), node);
    units.iter().map(of).collect()
}

pub fn table_two(page: &mut String, compared: &[(&str, &[Passage])]) {
    page.push_str(
        "## Static test (Table II)\n\nThe paper stands on knots of its table only (E5); the \
         random angles are the representative figure. Differences between the nodes are mean \
         sizes; a warning is a difference above 0.40 deg.\n\n\
         | axis | angles | | node 1, deg | node 2, deg | largest, deg | difference, deg | \
         warnings |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for (mount, [a, b, d]) in TABLE_TWO {
        for knots in [true, false] {
            if knots {
                let _ = writeln!(
                    page,
                    "| {mount:?} | knots | published | {a:.3} | {b:.3} | | {d:.3} | none |"
                );
            }
            for (name, units) in compared {
                static_row(page, name, units, mount, knots);
            }
        }
    }
    page.push_str(
        "\nCorrelation of the two nodes' errors on knots (E9; the paper's Table II implies about \
         0.98):",
    );
    for (i, (name, units)) in compared.iter().enumerate() {
        let comma = if i == 0 { "" } else { "," };
        let _ = write!(page, "{comma} {name} {:.2}", correlation(units));
    }
    page.push_str(".\n\n");
}

fn static_row(page: &mut String, name: &str, units: &[Passage], mount: Mount, knots: bool) {
    let angles = if knots { "knots" } else { "random" };
    let node = |n: usize| summary(&static_errors(units, mount, knots, n));
    let ((one, max_one), (two, max_two)) = (node(0), node(1));
    let (difference, warnings) = node_differences(units, mount, knots);
    let _ = writeln!(
        page,
        "| {mount:?} | {angles} | {name} | {one:.3} | {two:.3} | {:.3} | {:.3} | {warnings} |",
        f64::max(max_one, max_two),
        difference.mean(),
    );
}

/// Correlation of node 1's and node 2's errors over all knots of all units.
fn correlation(units: &[Passage]) -> f64 {
    let (mut product, mut squares) = (0.0, [0.0; 2]);
    for run in units
        .iter()
        .flat_map(|u| &u.unit.statics)
        .filter(|r| r.knots)
    {
        for [a, b] in run.points.iter().map(|p| p.nodes.map(|n| n.error_deg)) {
            product += a * b;
            squares[0] += a * a;
            squares[1] += b * b;
        }
    }
    product / (squares[0] * squares[1]).sqrt()
}

pub fn table_three(page: &mut String, compared: &[(&str, &[Passage])]) {
    page.push_str(
        "## Dynamic test (Table III)\n\n+-40 deg at 80 deg/s, ten cycles, 50 readings a second. \
         An accelerometer alone cannot have 0.1 deg as it arrives (E2). The sensor sits the lever \
         arm above the axis (E15).\n\n\
         | axis | lever arm, cm | | as it arrives: node 1 | node 2 | aligned: node 1 | node 2 | \
         latency, ms | difference | warnings |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (mount, [a, b, d]) in TABLE_THREE {
        let _ = writeln!(
            page,
            "| {mount:?} | 0 | published | {a:.3} | {b:.3} | | | | {d:.1} | none |"
        );
        for arm in [0, 2, 5] {
            for (name, units) in compared {
                dynamic_row(page, units, mount, arm, name);
            }
        }
    }
    page.push('\n');
}

/// The dynamic tests of all units with this lever arm.
pub fn swings(units: &[Passage], mount: Mount, arm_cm: u32) -> Vec<&DynamicResult> {
    let runs = units.iter().flat_map(|u| &u.unit.dynamics);
    let runs = runs.filter(|r| r.mount == mount && r.lever_arm_cm == arm_cm);
    runs.map(|r| &r.result).collect()
}

fn dynamic_row(page: &mut String, units: &[Passage], mount: Mount, arm: u32, name: &str) {
    let runs = swings(units, mount, arm);
    let arrives =
        |n: usize| summary(&runs.iter().map(|r| r.as_it_arrives[n]).collect::<Vec<_>>()).0;
    let aligned = |n: usize| summary(&runs.iter().map(|r| r.aligned[n]).collect::<Vec<_>>()).0;
    let mut latency: Vec<_> = runs.iter().map(|r| r.latency_ms[0].mean()).collect();
    let mut difference = Tally::default();
    runs.iter().for_each(|r| difference.join(&r.difference));
    let warnings: u64 = runs.iter().map(|r| r.warnings).sum();
    let _ = writeln!(
        page,
        "| {mount:?} | {arm} | {name} | {:.3} | {:.3} | {:.3} | {:.3} | {:.1} | {:.3} \
         | {warnings} |",
        arrives(0),
        arrives(1),
        aligned(0),
        aligned(1),
        median(&mut latency),
        difference.mean(),
    );
}

pub fn calibration(page: &mut String, compared: &[(&str, &[Passage])], one_axis: &[Passage]) {
    page.push_str(
        "## Calibration and verification round (R5, R15)\n\nTolerance 0.20 deg against the motor; \
         above it the calibration is repeated, three times at most. Paper mode is judged up to 80 \
         deg either side and shows what is beyond; as printed it is judged up to 90 deg.\n\n\
         | mode | largest error, median node, deg | nodes within tolerance | beyond 80 deg, \
         median node, deg | rounds, mean | residual, median, deg |\n\
         |---|---|---|---|---|---|\n",
    );
    let one_axis = ("product mode, one axis", one_axis);
    for (name, units) in compared.iter().chain([&one_axis]) {
        let nodes: Vec<_> = units.iter().flat_map(|u| u.unit.calibration).collect();
        let mut largest: Vec<_> = nodes.iter().map(|n| n.verification.largest()).collect();
        let mut beyond: Vec<_> = nodes.iter().map(|n| n.beyond.largest()).collect();
        let passed = nodes.iter().filter(|n| n.passed()).count();
        let rounds: u32 = nodes.iter().map(|n| n.rounds).sum();
        let mut residual: Vec<_> = nodes.iter().map(|n| n.residual_deg).collect();
        let _ = writeln!(
            page,
            "| {name} | {:.3} | {passed} of {} | {} | {:.2} | {:.4} |",
            median(&mut largest),
            nodes.len(),
            dash(median(&mut beyond)),
            f64::from(rounds) / nodes.len() as f64,
            median(&mut residual),
        );
    }
    page.push_str(
        "\nOne axis loses its sensitivity towards +-90 deg, where the last degree spans 0.6 LSB \
         (E6): there no table of one axis achieves 0.20 deg.\n\n",
    );
}

/// The figure, or nothing where none was taken.
fn dash(deg: f64) -> String {
    if deg > 0.0 {
        format!("{deg:.3}")
    } else {
        String::new()
    }
}
