//! Which steps make up the test command, in what order, and which of them run side by side.
//!
//! In: the workspace. Out: a heading and what it has to print for each step, then the steps with
//! what they have cost, the most costly first, and the count of what passed; the first failure ends
//! the run with a sentence that states what to do. First comes, one after another, what the rest
//! needs. The rest runs side by side: rows that wait for buses in real time, and rows that compute
//! with what those leave.
//!
//! Left out: the steps themselves (`steps`), and their processes (`side_by_side`).

use std::process::ExitCode;
use std::time::Instant;

use crate::command::Tally;
use crate::cost::{self, Cost};
use crate::failure::StepError;
use crate::side_by_side::{self, Row};
use crate::steps::{self, Step};
use crate::workspace::Workspace;

/// What the rest needs, and what fails soonest.
const FIRST: [&Step; 6] = [
    &steps::TOOLCHAIN,
    &steps::CHECK_FORMAT,
    &steps::TIDY,
    &steps::CLIPPY,
    &steps::BUILD,
    &steps::EMULATED_IMAGES,
];

/// Side by side. The long ones come first, so that none of them is left alone for long; what one
/// step builds and another one uses stands in one row.
const SIDE_BY_SIDE: [Row; 4] = [
    Row {
        steps: &[&steps::WAITING_TESTS],
        gives_way: false,
    },
    Row {
        steps: &[&steps::INTEROP],
        gives_way: false,
    },
    Row {
        steps: &[
            &steps::NO_STD,
            &steps::COMPUTING_TESTS,
            &steps::EXAMPLES_OF_COMMENTS,
            &steps::DOCUMENTATION,
        ],
        gives_way: true,
    },
    Row {
        steps: &[
            &steps::ACCURACY,
            &steps::FAULTS,
            &steps::SEEDS,
            &steps::SIZE,
            &steps::IMAGE_OF_TWO_FOLDERS,
            &steps::PROGRAM,
            &steps::PYTHON,
            &steps::DEMO,
        ],
        gives_way: true,
    },
];

/// Between two changes.
const QUICK: [&Step; 6] = [
    &steps::TOOLCHAIN,
    &steps::CHECK_FORMAT,
    &steps::TIDY,
    &steps::CLIPPY,
    &steps::QUICK_TESTS,
    &steps::FEW_SEEDS,
];

/// What has passed, and what it has cost.
#[derive(Default)]
struct Run {
    tally: Tally,
    costs: Vec<Cost>,
}

/// Runs everything, up to the first failure.
pub fn test(workspace: &Workspace) -> ExitCode {
    let mut run = Run::default();
    let start = Instant::now();
    let succeeded = in_order(&FIRST, workspace, &mut run) && side_by_side(workspace, &mut run);
    end(run, start, succeeded)
}

/// Runs what takes few minutes.
pub fn quick(workspace: &Workspace) -> ExitCode {
    let mut run = Run::default();
    let start = Instant::now();
    let succeeded = in_order(&QUICK, workspace, &mut run);
    end(run, start, succeeded)
}

/// Runs one step by itself.
pub fn alone(step: &Step, workspace: &Workspace) -> ExitCode {
    println!("{}", step.name);
    exit_code(perform(step, workspace, &mut Tally::default()))
}

/// Runs one step by itself, behind the set-up that a fresh machine lacks.
pub fn equipped(step: &Step, workspace: &Workspace) -> ExitCode {
    let mut tally = Tally::default();
    if !perform(&steps::TOOLCHAIN, workspace, &mut tally) {
        return ExitCode::FAILURE;
    }
    alone(step, workspace)
}

/// Runs one step for the process that has started this one.
pub fn one_step(key: &str, workspace: &Workspace) -> ExitCode {
    let mut steps = SIDE_BY_SIDE.iter().flat_map(|row| row.steps);
    let Some(step) = steps.find(|step| step.key == key) else {
        eprintln!("no such step: {key}");
        return ExitCode::from(2);
    };
    side_by_side::end_with_caller();
    let mut tally = Tally::default();
    let succeeded = perform(step, workspace, &mut tally);
    println!("{}", side_by_side::report(tally));
    exit_code(succeeded)
}

fn in_order(steps: &[&Step], workspace: &Workspace, run: &mut Run) -> bool {
    steps.iter().all(|step| {
        println!("{}", step.name);
        let (start, spent) = (Instant::now(), cost::processor_s());
        let succeeded = perform(step, workspace, &mut run.tally);
        let now = cost::processor_s();
        run.costs.push(Cost {
            name: step.name,
            took: start.elapsed(),
            processor_s: now.zip(spent).map(|(now, before)| now - before),
        });
        succeeded
    })
}

fn side_by_side(workspace: &Workspace, run: &mut Run) -> bool {
    let count = SIDE_BY_SIDE
        .iter()
        .map(|row| row.steps.len())
        .sum::<usize>();
    println!("{count} steps side by side; the output of each stands here when it has ended");
    let ended = side_by_side::run(workspace, &SIDE_BY_SIDE, &mut run.tally, &mut run.costs);
    ended.unwrap_or_else(|error| {
        eprintln!("failed: steps side by side could not be started ({error})");
        false
    })
}

fn end(run: Run, start: Instant, succeeded: bool) -> ExitCode {
    let Run { tally, costs } = run;
    println!("the most costly first, by the clock and by the processors:");
    for line in cost::lines(costs) {
        println!("{line}");
    }
    println!("{:7.1} s in all", start.elapsed().as_secs_f64());
    let failed = if succeeded { 0 } else { tally.failed.max(1) };
    println!("{} passed, {failed} failed", tally.passed);
    exit_code(succeeded)
}

fn exit_code(succeeded: bool) -> ExitCode {
    if succeeded {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

fn perform(step: &Step, workspace: &Workspace, total: &mut Tally) -> bool {
    let start = Instant::now();
    let mut tally = Tally::default();
    let outcome = (step.run)(workspace, &mut tally);
    *total = total.plus(tally);
    match outcome {
        Ok(()) => {
            *total = total.plus(Tally::ONE);
            println!(
                "      ok, {:.1} s{}",
                start.elapsed().as_secs_f64(),
                words(tally)
            );
            true
        }
        Err(error) => {
            fail(step, &error);
            false
        }
    }
}

fn fail(step: &Step, error: &StepError) {
    eprintln!("failed: {}: {error}\n        {}", step.name, step.advice);
}

/// What the step's own tests came to, for the line that ends it.
fn words(tally: Tally) -> String {
    match (tally.passed, tally.skipped) {
        (0, _) => String::new(),
        (passed, 0) => format!(", {passed} tests"),
        (passed, skipped) => format!(", {passed} tests, {skipped} with something skipped"),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn fails(_: &Workspace, _: &mut Tally) -> Result<(), StepError> {
        Err(StepError::NoTests)
    }

    fn counts_two(_: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
        *tally = Tally {
            passed: 2,
            failed: 0,
            skipped: 1,
        };
        Ok(())
    }

    fn step(run: fn(&Workspace, &mut Tally) -> Result<(), StepError>) -> Step {
        Step {
            key: "a-step",
            name: "a step",
            advice: "none",
            run,
        }
    }

    #[test]
    fn a_step_counts_itself_and_its_tests() {
        let mut total = Tally::default();
        assert!(perform(&step(counts_two), &Workspace::locate(), &mut total));
        assert_eq!(
            total,
            Tally {
                passed: 3,
                failed: 0,
                skipped: 1
            }
        );
    }

    #[test]
    fn a_failed_step_counts_nothing() {
        let mut total = Tally::default();
        assert!(!perform(&step(fails), &Workspace::locate(), &mut total));
        assert_eq!(total, Tally::default());
    }

    #[test]
    fn the_first_failure_ends_what_runs_in_order() {
        let mut run = Run::default();
        let (good, bad) = (step(counts_two), step(fails));
        assert!(!in_order(
            &[&good, &bad, &good],
            &Workspace::locate(),
            &mut run
        ));
        assert_eq!(run.tally.passed, 3);
        assert_eq!(run.costs.len(), 2);
    }

    #[test]
    fn the_quick_test_of_a_fresh_machine_lacked_the_packages_of_the_distribution() {
        for plan in [&FIRST[..], &QUICK[..]] {
            assert_eq!(plan[0].key, steps::TOOLCHAIN.key);
        }
    }

    #[test]
    fn every_step_has_a_key_of_its_own() {
        let rest = SIDE_BY_SIDE.iter().flat_map(|row| row.steps);
        let all: Vec<_> = FIRST.iter().chain(rest).map(|step| step.key).collect();
        let different: BTreeSet<_> = all.iter().collect();
        assert_eq!(different.len(), all.len(), "{all:?}");
    }
}
