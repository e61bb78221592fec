//! Tests in Python, counted as those in Rust are.
//!
//! In: a Python with pytest, and a file or folder of tests. Out: the count, the last line, and
//! everything that a failing run has printed.

use std::path::Path;
use std::process::Command;
use std::thread;

use crate::command::{self, CommandError, Tally};
use crate::workspace::Workspace;

/// Processes beyond which a run gets no shorter: its longest file takes more than a quarter of it.
const MOST_PROCESSES: usize = 4;

/// Pytest on a file or a folder of tests, which leaves nothing in the checkout.
pub fn command(workspace: &Workspace, python: &Path, tests: &str) -> Command {
    let words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", tests];
    let mut pytest = workspace.program(&python.to_string_lossy(), &words);
    pytest.env("PYTHONDONTWRITEBYTECODE", "1");
    pytest
}

/// The same with the files of a folder side by side, for which pytest-xdist has to be installed.
pub fn side_by_side(workspace: &Workspace, python: &Path, tests: &str) -> Command {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let mut pytest = command(workspace, python, tests);
    let processes = cores.min(MOST_PROCESSES).to_string();
    pytest.args(["-n", &processes, "--dist", "loadfile"]);
    pytest
}

/// Runs it: its count, its last line, and how it went; a failing run is printed.
pub fn run(pytest: Command) -> (Tally, String, Result<(), CommandError>) {
    let (mut tally, mut said, mut last) = (Tally::default(), String::new(), String::new());
    let outcome = command::watch(pytest, |line| {
        tally = tally.plus(summary(line));
        said += line;
        said.push('\n');
        last.clear();
        last += line;
    });
    if outcome.is_err() {
        print!("{said}");
    }
    (tally, last, outcome)
}

/// What pytest's last line counts; nothing for any other line.
fn summary(line: &str) -> Tally {
    if !line.contains(" in ") || !line.ends_with('s') && !line.ends_with(')') {
        return Tally::default();
    }
    Tally {
        passed: command::count(line, " passed"),
        failed: command::count(line, " failed") + command::count(line, " error"),
        skipped: command::count(line, " skipped"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_line_of_pytest_is_counted() {
        let counted = |line| {
            let tally = summary(line);
            [tally.passed, tally.failed, tally.skipped]
        };
        assert_eq!(counted("148 passed in 99.20s"), [148, 0, 0]);
        assert_eq!(
            counted("61 passed, 1 skipped in 134.50s (0:02:14)"),
            [61, 0, 1]
        );
        let bad = "2 failed, 16 passed, 3 errors in 28.82s";
        assert_eq!(counted(bad), [16, 5, 0]);
    }

    #[test]
    fn other_lines_of_pytest_count_nothing() {
        for line in [
            ".F.....                                 [ 61%]",
            "E   assert 1 passed",
            "FAILED test_lss.py::test_two - AssertionError: 3 passed",
            "",
        ] {
            assert_eq!(summary(line), Tally::default(), "{line}");
        }
    }
}
