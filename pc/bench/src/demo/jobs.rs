//! The worlds of a demo, shared out over the cores.
//!
//! In: seed, units and days. Out: the results of every world, in the order of the jobs, whichever
//! thread ran them. The longest jobs start first.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use sim::bench::interpretation::Interpretation;
use sim::bench::scene::scene;
use sim::bench::unit::{Plan, UnitResult, run_unit};
use sim::bench::week::{Day, Trouble};
use sim::bench::{Bench, BenchError, Mode, World};

use super::options::Arguments;
use output::progress::{Progress, Task};

/// Length of a scene of Table I, s, and when its trouble begins.
const SCENE_S: f64 = 1200.0;
const TROUBLE_FROM_S: f64 = 60.0;
/// How late node 2's frames are in the first row of Table I: ten periods of 20 ms and a half.
const LATE_MS: u32 = 210;

/// Which instrument is built, and in which world it is tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Paper mode, read so that the paper's own results hold, on the paper's machine.
    Paper,
    /// Paper mode to the letter, on the product's machine.
    AsPrinted,
    /// The product on two axes.
    Product,
    /// The product on one axis, full circle.
    OneAxis,
}

impl Kind {
    /// The bench's mode.
    pub fn mode(self) -> Mode {
        match self {
            Self::Paper | Self::AsPrinted => Mode::Paper,
            Self::Product => Mode::Product,
            Self::OneAxis => Mode::OneAxis,
        }
    }

    fn world(self) -> World {
        let paper = match self {
            Self::AsPrinted => Interpretation::AS_PRINTED,
            Self::Paper | Self::Product | Self::OneAxis => Interpretation::REPRODUCED,
        };
        World {
            paper,
            ..World::NOMINAL
        }
    }
}

/// The two-axis kinds of this run, in the order of the tables.
pub fn two_axes(arguments: &Arguments) -> Vec<Kind> {
    let printed = arguments.as_printed.then_some(Kind::AsPrinted);
    [Some(Kind::Paper), printed, Some(Kind::Product)]
        .into_iter()
        .flatten()
        .collect()
}

/// One world to run.
#[derive(Clone, Copy, Debug)]
enum Job {
    Week(Kind),
    TableOne(Kind, Trouble),
    Unit(Kind, u32),
}

/// What a world gave.
#[derive(Debug)]
enum Outcome {
    Week(Kind, Vec<Day>),
    TableOne(Kind, Trouble, Box<Day>),
    Unit(Kind, Box<UnitResult>),
}

/// Everything that the report is made of.
#[derive(Debug, Default)]
pub struct Results {
    /// Units by kind, in their order.
    pub units: Vec<(Kind, UnitResult)>,
    /// The week by kind.
    pub weeks: Vec<(Kind, Vec<Day>)>,
    /// The two rows of Table I by kind.
    pub table_one: Vec<(Kind, Trouble, Day)>,
}

impl Results {
    /// The units of one kind.
    pub fn of(&self, kind: Kind) -> impl Iterator<Item = &UnitResult> {
        self.units
            .iter()
            .filter(move |(k, _)| *k == kind)
            .map(|(_, unit)| unit)
    }
}

fn list(arguments: &Arguments) -> Vec<Job> {
    let kinds = two_axes(arguments);
    let mut jobs: Vec<_> = kinds.iter().rev().map(|&kind| Job::Week(kind)).collect();
    for &kind in &kinds {
        for trouble in [
            Trouble::Delay {
                from_s: TROUBLE_FROM_S,
                ms: LATE_MS,
            },
            Trouble::Supply {
                from_s: TROUBLE_FROM_S,
            },
        ] {
            jobs.push(Job::TableOne(kind, trouble));
        }
    }
    for kind in [Kind::OneAxis].into_iter().chain(kinds) {
        jobs.extend((0..arguments.units).map(|unit| Job::Unit(kind, unit)));
    }
    jobs
}

/// Runs everything.
///
/// Errors: the first instrument that could not be brought up.
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<Results, BenchError> {
    let jobs = list(arguments);
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<(usize, Result<Outcome, BenchError>)>> = Mutex::new(Vec::new());
    let kinds = two_axes(arguments).len() as u64;
    let built = u64::from(arguments.units) * (kinds + 1);
    let units = progress.task("instruments", built + 2 * kinds);
    let week = progress.task("excavator, days", u64::from(arguments.days) * kinds);
    let workers = std::thread::available_parallelism()
        .map_or(1, usize::from)
        .min(jobs.len());
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(&job) = jobs.get(index) else { break };
                    let outcome = work(job, arguments, &units, &week);
                    if let Ok(mut done) = done.lock() {
                        done.push((index, outcome));
                    }
                }
            });
        }
    });
    let mut outcomes = done.into_inner().unwrap_or_default();
    outcomes.sort_by_key(|(index, _)| *index);
    collect(outcomes.into_iter().map(|(_, outcome)| outcome))
}

fn collect(
    outcomes: impl Iterator<Item = Result<Outcome, BenchError>>,
) -> Result<Results, BenchError> {
    let mut results = Results::default();
    for outcome in outcomes {
        match outcome? {
            Outcome::Unit(kind, unit) => results.units.push((kind, *unit)),
            Outcome::Week(kind, days) => results.weeks.push((kind, days)),
            Outcome::TableOne(kind, trouble, day) => {
                results.table_one.push((kind, trouble, *day));
            }
        }
    }
    Ok(results)
}

fn work(job: Job, arguments: &Arguments, units: &Task, week: &Task) -> Result<Outcome, BenchError> {
    let Arguments { seed, days, .. } = *arguments;
    match job {
        Job::Unit(kind, unit) => {
            let plan = if kind == Kind::OneAxis {
                Plan {
                    lever_arms_cm: &[],
                    ..Plan::WHOLE
                }
            } else {
                Plan::WHOLE
            };
            let mut result = run_unit(kind.mode(), &kind.world(), seed, unit, &plan)?;
            if unit > 0 {
                // Figures are drawn from the first unit; the others keep their sums only.
                result
                    .dynamics
                    .iter_mut()
                    .for_each(|run| run.result.points = Vec::new());
            }
            units.advance(1);
            Ok(Outcome::Unit(kind, Box::new(result)))
        }
        Job::Week(kind) => {
            let mut list = Vec::new();
            if days > 0 {
                let (mut bench, _) = Bench::commissioned(kind.mode(), &kind.world(), seed, 0)?;
                bench.week(days, seed, |day| {
                    week.advance(1);
                    list.push(keep(day));
                });
            }
            Ok(Outcome::Week(kind, list))
        }
        Job::TableOne(kind, trouble) => {
            let day = scene(kind.mode(), &kind.world(), (seed, 0), SCENE_S, trouble)?;
            units.advance(1);
            Ok(Outcome::TableOne(kind, trouble, Box::new(day)))
        }
    }
}

/// Only the day of the fault is drawn (Fig 21), so only its trace is kept.
fn keep(mut day: Day) -> Day {
    if day.day != sim::bench::week::FAULT_DAY {
        day.trace = Vec::new();
    }
    day
}
