//! Steps side by side, each in a process of its own.
//!
//! In: rows of steps. Out: what each step has said, in one piece when it has ended, with what it
//! has cost; after the first failure the others are ended, and nothing else is begun.
//!
//! A step is this program again, called with a key. It is the first of a group of processes, with
//! a pipe for its input that nobody writes to: when the pipe closes, because the caller has failed
//! or is no more, it ends the whole group, with the compilers and servers in it. A row may give
//! way: its steps get what others leave of the processors, so tests that wait for a bus in real
//! time are not kept from it by those that compute.
//!
//! Left out: groups and giving way on systems other than Unix, where one step runs at a time.

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use std::{env, fs, process, thread};

use crate::built;
use crate::command::Tally;
use crate::cost::{self, Cost};
use crate::steps::Step;
use crate::workspace::Workspace;

/// The word before a step's key.
pub const WORD: &str = "step";

/// Begins the last line of such a process, which counts for its caller.
const REPORT: &str = "report of the step:";

/// The least that a process can ask for of the processors (nice(1)).
const LEAST: &str = "19";

/// Steps of which each waits for the one before.
pub struct Row {
    /// In their order.
    pub steps: &'static [&'static Step],
    /// Whether it gets what other rows leave.
    pub gives_way: bool,
}

/// How a step has gone.
struct Ended {
    said: String,
    succeeded: bool,
    took: Duration,
}

/// What the rows share.
struct Shared<'a> {
    /// The command for a step, and whether it gives way.
    command: &'a (dyn Fn(&Step, bool) -> Command + Sync),
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// One of them has failed.
    failed: bool,
    /// Inputs of those that run, by their keys.
    running: Vec<(&'static str, ChildStdin)>,
    /// What they have said, each with its heading.
    said: Vec<String>,
    tally: Tally,
    costs: Vec<Cost>,
}

/// Runs the rows side by side; whether all steps have succeeded.
///
/// Errors: this program cannot be copied.
pub fn run(
    workspace: &Workspace,
    rows: &[Row],
    tally: &mut Tally,
    costs: &mut Vec<Cost>,
) -> io::Result<bool> {
    let program = copy(workspace)?;
    let command = |step: &Step, gives_way: bool| command(workspace, &program, step.key, gives_way);
    let state = all(rows, &command);
    *tally = tally.plus(state.tally);
    costs.extend(state.costs);
    Ok(!state.failed)
}

/// This program under a name that no build replaces meanwhile.
fn copy(workspace: &Workspace) -> io::Result<PathBuf> {
    let name = format!("xtask-step{}", env::consts::EXE_SUFFIX);
    let path = workspace.target().join(name);
    let temporary = path.with_extension(process::id().to_string());
    fs::copy(env::current_exe()?, &temporary)?;
    fs::rename(&temporary, &path)?;
    Ok(path)
}

fn command(workspace: &Workspace, program: &Path, key: &str, gives_way: bool) -> Command {
    let program = program.to_string_lossy();
    let mut command = if gives_way && cfg!(unix) {
        workspace.program("nice", &["-n", LEAST, &program])
    } else {
        workspace.program(&program, &[])
    };
    command.args([WORD, key]).env(built::READY, "1");
    command
}

/// Runs the rows with these commands.
fn all(rows: &[Row], command: &(dyn Fn(&Step, bool) -> Command + Sync)) -> State {
    let shared = Shared {
        command,
        state: Mutex::default(),
    };
    if cfg!(unix) {
        thread::scope(|scope| {
            for row in rows {
                scope.spawn(|| shared.row(row));
            }
        });
    } else {
        rows.iter().for_each(|row| shared.row(row));
    }
    let state = shared.state.into_inner();
    state.unwrap_or_else(PoisonError::into_inner)
}

impl Shared<'_> {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn row(&self, row: &Row) {
        for step in row.steps {
            if self.state().failed {
                return;
            }
            let ended = self
                .step(step, row.gives_way)
                .unwrap_or_else(|error| Ended {
                    said: format!("it could not be run ({error})"),
                    succeeded: false,
                    took: Duration::ZERO,
                });
            self.tell(step, &ended);
        }
    }

    /// Runs one step to its end.
    fn step(&self, step: &Step, gives_way: bool) -> io::Result<Ended> {
        let start = Instant::now();
        let (mut child, mut said) = spawn((self.command)(step, gives_way))?;
        if let Some(input) = child.stdin.take() {
            let mut state = self.state();
            // One that has failed since has ended all it knew of: this one ends with its input.
            if !state.failed {
                state.running.push((step.key, input));
            }
        }
        let mut bytes = Vec::new();
        said.read_to_end(&mut bytes)?;
        let status = child.wait()?;
        self.state().running.retain(|(key, _)| *key != step.key);
        Ok(Ended {
            said: String::from_utf8_lossy(&bytes).into_owned(),
            succeeded: status.success(),
            took: start.elapsed(),
        })
    }

    /// Counts a step and prints what it has said; what was ended for another's failure is silent.
    fn tell(&self, step: &Step, ended: &Ended) {
        let mut state = self.state();
        if state.failed {
            return;
        }
        let (said, report) = parted(&ended.said);
        let mut said = format!("{}\n{}", step.name, said.trim_end());
        if report.is_none() && !ended.succeeded {
            said += &format!("\nfailed: {}\n        {}", step.name, step.advice);
        }
        println!("{said}");
        state.said.push(said);
        let (tally, processor_s) = report.unwrap_or_default();
        state.tally = state.tally.plus(tally);
        state.costs.push(Cost {
            name: step.name,
            took: ended.took,
            processor_s,
        });
        if !ended.succeeded {
            state.failed = true;
            // Their inputs close, and they end.
            state.running.clear();
        }
    }
}

/// Starts a process as the first of a group, and gives what it prints on both of its outputs.
fn spawn(mut command: Command) -> io::Result<(Child, io::PipeReader)> {
    let (reader, writer) = io::pipe()?;
    command
        .stdin(Stdio::piped())
        .stdout(writer.try_clone()?)
        .stderr(writer);
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    // The command goes at the end of this function, and our ends for writing with it.
    Ok((command.spawn()?, reader))
}

/// The last line of a step, for its caller.
pub fn report(tally: Tally) -> String {
    let Tally {
        passed,
        failed,
        skipped,
    } = tally;
    let processor = cost::processor_s().map_or_else(|| "?".to_owned(), |s| s.to_string());
    format!("{REPORT} {passed} {failed} {skipped} {processor}")
}

/// What a step has said without its report, and what that counts.
fn parted(said: &str) -> (&str, Option<(Tally, Option<f64>)>) {
    let Some((before, line)) = said.rsplit_once(REPORT) else {
        return (said, None);
    };
    let mut words = line.split_whitespace();
    let mut number = || words.next()?.parse().ok();
    let counted = (|| {
        Some(Tally {
            passed: number()?,
            failed: number()?,
            skipped: number()?,
        })
    })();
    let processor_s = words.next().and_then(|word| word.parse().ok());
    (before, counted.map(|tally| (tally, processor_s)))
}

/// From now on this process and all that it starts end when its input does.
pub fn end_with_caller() {
    thread::spawn(|| {
        // Nobody writes to it; an error is an end as well.
        let _ = io::stdin().read_to_end(&mut Vec::new());
        end_group();
    });
}

/// Ends the group of processes whose first one this is.
fn end_group() -> ! {
    if cfg!(unix) {
        let line = ending(&process::id().to_string());
        let _ = Command::new("sh").args(["-c", &line]).status();
    }
    process::exit(1)
}

/// A shell's line that ends a group.
fn ending(group: &str) -> String {
    format!("kill -s KILL -- -{group}")
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::failure::StepError;

    fn nothing(_: &Workspace, _: &mut Tally) -> Result<(), StepError> {
        Ok(())
    }

    /// A step whose key is a line for the shell.
    const fn step(key: &'static str) -> Step {
        Step {
            key,
            name: "a step",
            advice: "mend it",
            run: nothing,
        }
    }

    const fn row(steps: &'static [&'static Step]) -> Row {
        Row {
            steps,
            gives_way: false,
        }
    }

    fn shell(step: &Step, _: bool) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", step.key]);
        command
    }

    #[test]
    fn what_steps_side_by_side_had_to_print_was_mixed() {
        static ONE: Step = step("echo a; sleep 0.1; echo b >&2; sleep 0.1; echo c");
        static OTHER: Step = step("sleep 0.05; echo d >&2; sleep 0.1; echo e");
        static ROWS: [Row; 2] = [row(&[&ONE]), row(&[&OTHER])];
        let mut state = all(&ROWS, &shell);
        state.said.sort();
        assert_eq!(state.said, ["a step\na\nb\nc", "a step\nd\ne"]);
        assert!(!state.failed);
        assert_eq!(state.costs.len(), 2);
    }

    #[test]
    fn after_a_failure_the_others_end_with_all_that_they_have_started() {
        static FAILS: Step = step("sleep 0.2; echo why; exit 3");
        static LASTS: Step = step("sleep 100 & cat; kill -s KILL -- -$$");
        static NEVER: Step = step("echo never");
        assert!(LASTS.key.ends_with(&ending("$$")));
        let start = Instant::now();
        static ROWS: [Row; 2] = [row(&[&FAILS, &NEVER]), row(&[&LASTS, &NEVER])];
        let state = all(&ROWS, &shell);
        // The outputs are read to their ends, and the sleeper has one of them.
        assert!(start.elapsed() < Duration::from_secs(50));
        assert!(state.failed);
        assert_eq!(state.said, ["a step\nwhy\nfailed: a step\n        mend it"]);
    }

    #[test]
    fn a_step_that_cannot_be_started_has_failed() {
        static ONE: Step = step("none");
        static ROWS: [Row; 1] = [row(&[&ONE])];
        let missing = |_: &Step, _| Command::new("plumb-no-such-program");
        let state = all(&ROWS, &missing);
        assert!(state.failed);
        assert!(
            state.said[0].contains("could not be run"),
            "{:?}",
            state.said
        );
    }

    #[test]
    fn a_report_is_read_back_and_not_shown() {
        let tally = Tally {
            passed: 12,
            failed: 1,
            skipped: 3,
        };
        let said = format!("all is well\n{}\n", report(tally));
        let (shown, read) = parted(&said);
        assert_eq!(shown, "all is well\n");
        assert_eq!(read.map(|(tally, _)| tally), Some(tally));
        assert_eq!(parted("crashed\n"), ("crashed\n", None));
    }

    #[test]
    fn tests_that_compute_gave_no_way_to_those_that_wait() {
        let workspace = Workspace::locate();
        let program = |gives_way| {
            let command = command(&workspace, Path::new("/x"), "key", gives_way);
            command.get_program().to_owned()
        };
        assert_eq!(program(true), "nice");
        assert_eq!(program(false), "/x");
    }
}
