//! Runs every test binary, two at a time.
//!
//! In: the binaries that `cargo test --no-run` has built. Out: the count of each as it ends, all
//! that a failing one has printed, and those that took longest. Many tests wait for a bus in real
//! time, and the cores are idle for most of it. Many compute: those run on a thread each, and give
//! way to those that wait (`side_by_side`). Beside others that did not give way, a test of a bus
//! failed in most runs, a different one each time.
//!
//! Left out: tests in documentation comments, which cargo runs by itself.

use std::cmp::Reverse;
use std::collections::VecDeque;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use std::{fs, thread};

use serde_json::Value;

use crate::built;
use crate::command::{self, CommandError, Tally};
use crate::workspace::Workspace;

/// Builds everything that is tested, and tells each program in a line of JSON.
const BUILD: [&str; 4] = [
    "test",
    "--workspace",
    "--no-run",
    "--message-format=json-render-diagnostics",
];

/// How the titles of those begin that wait for a bus in real time: all of `plumb`, both ends of a
/// bus, and the update of emulated nodes.
const WAITS: [&str; 5] = [
    "cli ",
    "bus-master ",
    "monitor ",
    "virtual-bus ",
    "emulator update",
];

/// Those of them that take minutes. They come first, so that none of them is left running alone.
const LONGEST: [&str; 2] = ["cli bench", "cli commission"];

/// How many run at a time.
const ROWS: usize = 2;

/// How many of the slowest are listed.
const SLOWEST: usize = 10;

/// The file in the target folder with cargo's messages about the last build.
const MESSAGES: &str = "tests.jsonl";

/// What a program with tests spends its time with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// It waits for a bus in real time.
    Waits,
    /// It computes.
    Computes,
}

/// One program with tests.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Binary {
    /// The folder of its crate, where it runs.
    folder: PathBuf,
    /// Its target: the crate's name, or that of the file with the tests.
    name: String,
    program: PathBuf,
}

/// How one of them has gone.
struct Ended {
    binary: Binary,
    took: Duration,
    tally: Tally,
    outcome: Result<(), CommandError>,
}

/// Runs all of these kinds, one kind after the other, whatever fails; the first failure is the
/// error.
///
/// The count stands in `tally` even then.
pub fn run(
    workspace: &Workspace,
    kinds: &[Kind],
    variables: &[(&str, &str)],
    tally: &mut Tally,
) -> Result<(), CommandError> {
    if !built::is_ready() {
        build(workspace)?;
    }
    let binaries = built(workspace)?;
    let mut ended = Vec::new();
    for wanted in kinds {
        let of_kind = binaries.iter().filter(|binary| kind(binary) == *wanted);
        let mut of_kind: Vec<_> = of_kind.cloned().collect();
        of_kind.sort_by_key(|binary| !LONGEST.contains(&&*title(binary)));
        ended.extend(rows(workspace, variables, of_kind.into()));
    }
    ended.sort_by_key(|one| Reverse(one.took));
    println!("      the slowest of {}:", ended.len());
    ended.iter().take(SLOWEST).for_each(print);
    for one in &ended {
        *tally = tally.plus(one.tally);
    }
    let mut failed = ended.into_iter().filter_map(|one| one.outcome.err());
    failed.next().map_or(Ok(()), Err)
}

/// Runs these, two at a time.
fn rows(
    workspace: &Workspace,
    variables: &[(&str, &str)],
    binaries: VecDeque<Binary>,
) -> Vec<Ended> {
    let binaries = Mutex::new(binaries);
    let next = || {
        let mut left = binaries.lock().unwrap_or_else(PoisonError::into_inner);
        left.pop_front()
    };
    let one_row = || -> Vec<Ended> {
        let binaries = std::iter::from_fn(next);
        binaries
            .map(|binary| test(workspace, variables, binary))
            .collect()
    };
    thread::scope(|scope| {
        let rows: Vec<_> = (0..ROWS).map(|_| scope.spawn(one_row)).collect();
        let ended = rows.into_iter().map(thread::ScopedJoinHandle::join);
        ended
            .flat_map(|row| row.unwrap_or_else(|panic| resume_unwind(panic)))
            .collect()
    })
}

/// Builds them, with the examples and tools, and keeps what cargo reports of them.
pub fn build(workspace: &Workspace) -> Result<(), CommandError> {
    let mut messages = String::new();
    command::watch(workspace.cargo(&BUILD), |line| {
        messages += line;
        messages.push('\n');
    })?;
    let path = workspace.target().join(MESSAGES);
    let failed = |error| CommandError::Output(BUILD.join(" "), error);
    fs::write(path, messages).map_err(failed)
}

/// Those of the last build, in the order of their folders.
fn built(workspace: &Workspace) -> Result<Vec<Binary>, CommandError> {
    let failed = |error| CommandError::Output(BUILD.join(" "), error);
    let messages = fs::read_to_string(workspace.target().join(MESSAGES)).map_err(failed)?;
    let mut binaries: Vec<_> = messages.lines().filter_map(binary).collect();
    binaries.sort();
    Ok(binaries)
}

/// The program that a message of cargo is about, when it has tests.
fn binary(message: &str) -> Option<Binary> {
    let message: Value = serde_json::from_str(message).ok()?;
    let is_test = message["profile"]["test"].as_bool()?;
    let manifest = Path::new(message["manifest_path"].as_str()?);
    is_test.then_some(Binary {
        folder: manifest.parent()?.to_path_buf(),
        name: message["target"]["name"].as_str()?.to_owned(),
        program: PathBuf::from(message["executable"].as_str()?),
    })
}

/// Runs one, and prints how it has gone.
fn test(workspace: &Workspace, variables: &[(&str, &str)], binary: Binary) -> Ended {
    let program = binary.program.to_string_lossy();
    let mut command = workspace.program(&program, &[]);
    if kind(&binary) == Kind::Computes {
        command.args(["--test-threads", "1"]);
    }
    command
        .arg("--show-output")
        .current_dir(&binary.folder)
        .env("CARGO_MANIFEST_DIR", &binary.folder)
        .envs(variables.iter().copied());
    let (start, mut tally) = (Instant::now(), Tally::default());
    let outcome = command::tests(command, &mut tally).map_err(|error| match error {
        CommandError::Status(_, status) => CommandError::Status(title(&binary), status),
        error => error,
    });
    let ended = Ended {
        took: start.elapsed(),
        binary,
        tally,
        outcome,
    };
    print(&ended);
    ended
}

/// What a person calls it: the folder of its crate and its target.
fn title(binary: &Binary) -> String {
    let folder = binary.folder.file_name().unwrap_or_default();
    format!("{} {}", folder.to_string_lossy(), binary.name)
}

fn kind(binary: &Binary) -> Kind {
    let title = title(binary);
    if WAITS.iter().any(|begin| title.starts_with(begin)) {
        Kind::Waits
    } else {
        Kind::Computes
    }
}

fn print(ended: &Ended) {
    let (title, took_s) = (title(&ended.binary), ended.took.as_secs_f64());
    let Tally { passed, failed, .. } = ended.tally;
    let verdict = if ended.outcome.is_ok() {
        ""
    } else {
        ": FAILED"
    };
    println!("      {took_s:6.1} s, {passed} passed, {failed} failed: {title}{verdict}");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(is_test: bool, executable: &str) -> String {
        format!(
            r#"{{"reason":"compiler-artifact","manifest_path":"/plumb/cli/Cargo.toml",
            "target":{{"kind":["test"],"name":"bench"}},"profile":{{"test":{is_test}}},
            "executable":{executable}}}"#
        )
    }

    /// Two nodes took an update in 3.14 times the time on the bus, where 3 is the limit.
    #[test]
    fn an_update_in_real_time_ran_beside_tests_that_compute() {
        let of = |folder: &str, name: &str| Binary {
            folder: PathBuf::from(folder),
            name: name.to_owned(),
            program: PathBuf::new(),
        };
        assert_eq!(kind(&of("/plumb/emulator", "update")), Kind::Waits);
        assert_eq!(kind(&of("/plumb/emulator", "product")), Kind::Computes);
        assert_eq!(kind(&of("/plumb/client", "bench")), Kind::Computes);
    }

    #[test]
    fn a_program_with_tests_is_told_from_what_else_is_built() {
        let found = binary(&message(true, r#""/plumb/target/debug/deps/bench-0""#));
        let found = found.expect("a program with tests");
        assert_eq!(title(&found), "cli bench");
        assert_eq!(kind(&found), Kind::Waits);
        assert_eq!(found.program, Path::new("/plumb/target/debug/deps/bench-0"));
        assert_eq!(
            binary(&message(false, r#""/plumb/target/debug/plumb""#)),
            None
        );
        assert_eq!(binary(&message(true, "null")), None);
        assert_eq!(
            binary(r#"{"reason":"build-finished","success":true}"#),
            None
        );
        assert_eq!(binary("no JSON"), None);
    }
}
