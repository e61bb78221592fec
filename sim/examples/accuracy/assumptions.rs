//! What each assumption about the paper moves, switched alone, and what averaging does.

use std::fmt::Write as _;

use sim::bench::calibrate::CalibrationReport;
use sim::bench::interpretation::{Fixture, Interpretation};
use sim::bench::published::TABLE_TWO;
use sim::bench::static_test::{differences, errors};
use sim::bench::statistics::{Tally, median};
use sim::bench::unit::{Plan, UnitResult, run_unit};
use sim::bench::week::Day;
use sim::bench::{Bench, BenchError, Mode, World};
use tilt::table::Rule;

use crate::tables::points_of;
use crate::{SEED, Scale, shared};

const PAPER: Interpretation = Interpretation::REPRODUCED;
const PRINTED: Interpretation = Interpretation::AS_PRINTED;

/// Each assumption switched to its other side, with the words for it.
fn switched() -> Vec<(&'static str, &'static str, Interpretation)> {
    type Switch = fn(&mut Interpretation);
    let switches: [(_, _, Switch); 10] = [
        ("A1", "nearest point of the 1 deg table, by the text", |p| {
            p.rule = Rule::Nearest;
        }),
        ("A1", "the same by eq 7 to the letter", |p| {
            p.rule = Rule::PrintedQuarter;
        }),
        ("A2", "each node's newest sample", |p| {
            p.timing = PRINTED.timing;
        }),
        ("A3", "one sample memorised at each step", |p| {
            p.memorised_over_s = 0.0;
        }),
        ("A4", "one sample read at standstill", |p| {
            p.read_over_s = 0.0;
        }),
        ("A5", "parts as soldered", |p| p.fixture = PRINTED.fixture),
        ("A5", "mounting true, sensitive axes skew by 0.5 deg", |p| {
            p.fixture = SKEWED;
        }),
        ("A6", "power off and on before the tests", |p| {
            p.power_off_between = true;
        }),
        ("A7", "verification judged up to 90 deg", |p| {
            p.judged_within_deg = 90.0;
        }),
        ("A8", "the product's machine", |p| {
            p.machine = PRINTED.machine;
        }),
    ];
    let mut rows = vec![("-", "all as in paper mode", PAPER)];
    for (name, words, switch) in switches {
        let mut paper = PAPER;
        switch(&mut paper);
        rows.push((name, words, paper));
    }
    rows.push(("all", "as printed", PRINTED));
    rows
}

/// The part held true, its sensitive axes as they come.
const SKEWED: Fixture = Fixture::True {
    mounting_deg: 0.1,
    skew_deg: 0.5,
};

/// Figures of one interpretation.
struct Figures {
    units: Vec<UnitResult>,
}

fn world(paper: Interpretation) -> World {
    World {
        paper,
        ..World::NOMINAL
    }
}

fn figures(
    count: u32,
    paper: Interpretation,
    lever_arms_cm: &'static [u32],
) -> Result<Figures, BenchError> {
    let world = world(paper);
    let plan = Plan {
        random_angles: 0,
        lever_arms_cm,
    };
    let units = shared(count, |unit| {
        run_unit(Mode::Paper, &world, SEED, unit, &plan)
    })?;
    Ok(Figures { units })
}

/// A healthy day on the machine.
fn healthy_day(paper: Interpretation) -> Result<Day, BenchError> {
    let (mut bench, _) = Bench::commissioned(Mode::Paper, &world(paper), SEED, 0)?;
    let mut day = Day::default();
    bench.week(1, SEED, |first| day = first);
    Ok(day)
}

impl Figures {
    /// Median RMSE of the aligned swing, deg, and warnings of all swings.
    fn dynamic(&self) -> (f64, u64) {
        let runs = || self.units.iter().flat_map(|u| &u.dynamics);
        let mut rms: Vec<_> = runs()
            .flat_map(|r| r.result.aligned)
            .map(|t| t.rms())
            .collect();
        (median(&mut rms), runs().map(|r| r.result.warnings).sum())
    }

    /// RMSE of each cell of Table II over the published one, and the mean difference, deg.
    fn knots(&self) -> ([f64; 4], f64) {
        let mut ratios = [0.0; 4];
        let mut difference = Tally::default();
        for (i, (mount, published)) in TABLE_TWO.into_iter().enumerate() {
            for node in 0..2 {
                let of = |u: &UnitResult| errors(points_of(u, mount, true), node).rms();
                let mut rms: Vec<_> = self.units.iter().map(of).collect();
                ratios[2 * i + node] = median(&mut rms) / published[node];
            }
            for unit in &self.units {
                difference.join(&differences(points_of(unit, mount, true)));
            }
        }
        (ratios, difference.mean())
    }

    fn accepted(&self) -> usize {
        let passed = |u: &&UnitResult| u.calibration.iter().all(CalibrationReport::passed);
        self.units.iter().filter(passed).count()
    }
}

pub fn section(page: &mut String, scale: &Scale) -> Result<(), BenchError> {
    let count = scale.assumed;
    let _ = writeln!(
        page,
        "## What each assumption about the paper moves\n\nEach one switched alone; \
         [paper.md](paper.md) explains them. {count} units; Table II is the RMSE on knots over \
         the published one, lowest and highest of the four cells; the day is one healthy day on \
         the machine.\n\n\
         | | switched to | Table III, aligned, deg | its warnings | Table II over published \
         | its difference, deg | R15 accepted | the day: warnings | stops | faults |\n\
         |---|---|---|---|---|---|---|---|---|---|"
    );
    for (name, words, paper) in switched() {
        let figures = figures(count, paper, &[0])?;
        let day = healthy_day(paper)?;
        let (dynamic, warnings) = figures.dynamic();
        let (ratios, difference) = figures.knots();
        let _ = writeln!(
            page,
            "| {name} | {words} | {dynamic:.3} | {warnings} | {} | {difference:.3} \
             | {} of {count} | {} | {} | {} |",
            range(&ratios),
            figures.accepted(),
            day.warnings,
            day.stops,
            day.faults,
        );
    }
    averaging(page, count)
}

fn range(ratios: &[f64; 4]) -> String {
    let low = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    let high = ratios.iter().copied().fold(0.0, f64::max);
    format!("{low:.2} to {high:.2}")
}

/// What averaging Table II takes.
fn averaging(page: &mut String, count: u32) -> Result<(), BenchError> {
    page.push_str(
        "\nThe averaging that Table II requires: its RMSE on knots over the published one, lowest \
         and highest cell, by how long the acceleration is averaged at each step of the motor \
         (down) and at each reading (across).\n\n\
         | | 0 s | 0.1 s | 0.3 s | 1 s | 5 s |\n\
         |---|---|---|---|---|---|\n",
    );
    for memorised_over_s in [0.0, 0.1, 0.3, 1.0] {
        let _ = write!(page, "| {memorised_over_s} s |");
        for read_over_s in [0.0, 0.1, 0.3, 1.0, 5.0] {
            let paper = Interpretation {
                memorised_over_s,
                read_over_s,
                ..PAPER
            };
            let figures = figures(count, paper, &[])?;
            let _ = write!(page, " {} |", range(&figures.knots().0));
        }
        page.push('\n');
    }
    page.push('\n');
    Ok(())
}
