//! The worlds of a demo, shared out over the cores.
//!
//! In: seed, units and days. Out: the results of every world, in the order of the jobs, whichever
//! thread ran them. The longest jobs start first.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use sim::bench::unit::{Plan, UnitResult, run_unit};
use sim::bench::week::{Day, Trouble};
use sim::bench::{Bench, BenchError, Mode, World};

use super::Arguments;
use crate::progress::{Progress, Task};

/// Length of a scene of Table I, s, and when its trouble begins.
const SCENE_S: f64 = 1200.0;
const TROUBLE_FROM_S: f64 = 60.0;
/// How late node 2's readings are in the first row of Table I: 10 periods of 20 ms.
const LATE_SYNCS: usize = 10;

/// One world to run.
#[derive(Clone, Copy, Debug)]
enum Job {
    Week(Mode),
    TableOne(Mode, Trouble),
    Unit(Mode, u32),
}

/// What a world gave.
#[derive(Debug)]
enum Outcome {
    Week(Mode, Vec<Day>),
    TableOne(Mode, Trouble, Box<Day>),
    Unit(Mode, Box<UnitResult>),
}

/// Everything that the report is made of.
#[derive(Debug, Default)]
pub struct Results {
    /// Units by mode, in their order.
    pub units: Vec<(Mode, UnitResult)>,
    /// The week by mode.
    pub weeks: Vec<(Mode, Vec<Day>)>,
    /// The two rows of Table I by mode.
    pub table_one: Vec<(Mode, Trouble, Day)>,
}

impl Results {
    /// The units of one mode.
    pub fn of(&self, mode: Mode) -> impl Iterator<Item = &UnitResult> {
        self.units
            .iter()
            .filter(move |(m, _)| *m == mode)
            .map(|(_, unit)| unit)
    }
}

fn list(arguments: &Arguments) -> Vec<Job> {
    let both = [Mode::Product, Mode::Paper];
    let mut jobs: Vec<_> = both.iter().map(|&m| Job::Week(m)).collect();
    for mode in [Mode::Paper, Mode::Product] {
        for trouble in [
            Trouble::Delay {
                from_s: TROUBLE_FROM_S,
                syncs: LATE_SYNCS,
            },
            Trouble::Supply {
                from_s: TROUBLE_FROM_S,
            },
        ] {
            jobs.push(Job::TableOne(mode, trouble));
        }
    }
    for mode in [Mode::Product, Mode::OneAxis, Mode::Paper] {
        jobs.extend((0..arguments.units).map(|unit| Job::Unit(mode, unit)));
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
    let units = progress.task("instruments", u64::from(arguments.units) * 3 + 4);
    let week = progress.task("excavator, days", u64::from(arguments.days) * 2);
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
            Outcome::Unit(mode, unit) => results.units.push((mode, *unit)),
            Outcome::Week(mode, days) => results.weeks.push((mode, days)),
            Outcome::TableOne(mode, trouble, day) => {
                results.table_one.push((mode, trouble, *day));
            }
        }
    }
    Ok(results)
}

fn work(job: Job, arguments: &Arguments, units: &Task, week: &Task) -> Result<Outcome, BenchError> {
    let Arguments { seed, days, .. } = *arguments;
    match job {
        Job::Unit(mode, unit) => {
            let plan = if mode == Mode::OneAxis {
                Plan {
                    lever_arms_cm: &[],
                    ..Plan::WHOLE
                }
            } else {
                Plan::WHOLE
            };
            let mut result = run_unit(mode, &World::NOMINAL, seed, unit, &plan)?;
            if unit > 0 {
                // Figures are drawn from the first unit; the others keep their sums only.
                result
                    .dynamics
                    .iter_mut()
                    .for_each(|run| run.result.points = Vec::new());
            }
            units.advance(1);
            Ok(Outcome::Unit(mode, Box::new(result)))
        }
        Job::Week(mode) => {
            let mut list = Vec::new();
            if days > 0 {
                let (mut bench, _) = Bench::commissioned(mode, &World::NOMINAL, seed, 0)?;
                bench.week(days, seed, |day| {
                    week.advance(1);
                    list.push(keep(day));
                });
            }
            Ok(Outcome::Week(mode, list))
        }
        Job::TableOne(mode, trouble) => {
            let (mut bench, _) = Bench::commissioned(mode, &World::NOMINAL, seed, 0)?;
            let day = bench.scene(SCENE_S, trouble, seed);
            units.advance(1);
            Ok(Outcome::TableOne(mode, trouble, Box::new(day)))
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
