//! Running a child process, and counting the tests it reports.
//!
//! In: a command. Out: its standard output where asked for, or the error that names the command.
//! Standard error always goes through, so cargo's own progress and messages stay visible.

use std::io::{self, BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// Why a child process did not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// It could not be started: usually not installed.
    #[error("`{0}` could not be started ({1})")]
    Start(String, io::Error),
    /// Its output broke off.
    #[error("the output of `{0}` broke off ({1})")]
    Output(String, io::Error),
    /// It ended with a status other than zero.
    #[error("`{0}` failed ({1})")]
    Status(String, String),
}

/// Runs a command with its output going straight through.
pub fn pass(mut command: Command) -> Result<(), CommandError> {
    let child = start(&mut command)?;
    finish(&command, child)
}

/// Runs a command and returns what it wrote on standard output.
pub fn capture(mut command: Command) -> Result<String, CommandError> {
    command.stdout(Stdio::piped());
    let child = start(&mut command)?;
    let output = child
        .wait_with_output()
        .map_err(|error| CommandError::Output(name(&command), error))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    if output.status.success() {
        return Ok(text);
    }
    print!("{text}");
    Err(CommandError::Status(
        name(&command),
        output.status.to_string(),
    ))
}

/// Whether a command runs and succeeds; prints nothing of its own.
pub fn succeeds(mut command: Command) -> bool {
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// What a run of tests came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Tests and checks that passed.
    pub passed: u64,
    /// Those that failed.
    pub failed: u64,
    /// Tests that ran but had nothing to look at, such as a recording that isn't there.
    pub skipped: u64,
}

impl Tally {
    /// One check that passed.
    pub const ONE: Self = Self {
        passed: 1,
        failed: 0,
        skipped: 0,
    };

    /// Both together.
    pub fn plus(self, other: Self) -> Self {
        Self {
            passed: self.passed + other.passed,
            failed: self.failed + other.failed,
            skipped: self.skipped + other.skipped,
        }
    }
}

/// Runs tests, showing what was skipped and, of a binary that failed, everything.
///
/// The command has to pass `--show-output` on to the tests, or the word of those that skip
/// something would be swallowed. The count stands in `tally` even when the command fails.
pub fn tests(command: Command, tally: &mut Tally) -> Result<(), CommandError> {
    let mut reader = TestOutput::default();
    let outcome = watch(command, |line| {
        // At once, since the lines of another binary may come between.
        let shown = reader.line(line).join("\n");
        if !shown.is_empty() {
            println!("{shown}");
        }
    });
    for shown in reader.pending {
        println!("{shown}");
    }
    *tally = tally.plus(reader.tally);
    outcome
}

/// Runs a command and hands over each line of its standard output as soon as it is there.
pub fn watch(mut command: Command, mut each: impl FnMut(&str)) -> Result<(), CommandError> {
    command.stdout(Stdio::piped());
    let mut child = start(&mut command)?;
    for line in child
        .stdout
        .take()
        .into_iter()
        .flat_map(|out| BufReader::new(out).split(b'\n'))
    {
        let line = line.map_err(|error| CommandError::Output(name(&command), error))?;
        each(&String::from_utf8_lossy(&line));
    }
    finish(&command, child)
}

/// Sorts the lines of the test harness into those worth showing and those held back.
#[derive(Default)]
struct TestOutput {
    pending: Vec<String>,
    tally: Tally,
}

impl TestOutput {
    /// Takes a line in, gives those to show now.
    fn line(&mut self, line: &str) -> Vec<String> {
        let text = line.trim();
        if text.starts_with("skipped") {
            self.tally.skipped += 1;
            return vec![line.to_string()];
        }
        if text.contains("has been running for over") {
            return vec![line.to_string()];
        }
        let Some(counts) = text.strip_prefix("test result:") else {
            if !text.is_empty() {
                self.pending.push(line.to_string());
            }
            return Vec::new();
        };
        let failed = count(counts, " failed");
        self.tally.passed += count(counts, " passed");
        self.tally.failed += failed;
        let said = std::mem::take(&mut self.pending);
        if counts.contains("FAILED") {
            failures(said)
        } else {
            Vec::new()
        }
    }
}

/// Of what a failing binary said, the section on its failures; all of it when there is none.
fn failures(mut said: Vec<String>) -> Vec<String> {
    let section = said
        .iter()
        .position(|line| line.trim() == "failures:")
        .unwrap_or(0);
    said.split_off(section)
}

/// The number that stands before `label` in a summary line; 0 when there is none.
pub fn count(line: &str, label: &str) -> u64 {
    let before = line
        .split(label)
        .next()
        .filter(|before| before.len() < line.len());
    let digits = before.and_then(|text| text.rsplit(' ').next());
    digits.and_then(|text| text.parse().ok()).unwrap_or(0)
}

fn start(command: &mut Command) -> Result<Child, CommandError> {
    command
        .stdin(Stdio::null())
        .spawn()
        .map_err(|error| CommandError::Start(name(command), error))
}

fn finish(command: &Command, mut child: Child) -> Result<(), CommandError> {
    let status = child
        .wait()
        .map_err(|error| CommandError::Output(name(command), error))?;
    if status.success() {
        return Ok(());
    }
    Err(CommandError::Status(name(command), status.to_string()))
}

/// The command as a person would type it: the program's file name and its arguments.
pub fn name(command: &Command) -> String {
    let program = std::path::Path::new(command.get_program());
    let mut words = vec![
        program
            .file_name()
            .unwrap_or(program.as_os_str())
            .to_string_lossy(),
    ];
    words.extend(command.get_args().map(|word| word.to_string_lossy()));
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const PASSED: &str = "test result: ok. 12 passed; 0 failed; 3 ignored; 0 measured";
    const FAILED: &str = "test result: FAILED. 4 passed; 2 failed; 0 ignored; 0 measured";

    #[test]
    fn a_passing_binary_shows_nothing() {
        let mut output = TestOutput::default();
        assert!(output.line("test chain::tests::one ... ok").is_empty());
        assert!(output.line(PASSED).is_empty());
        assert_eq!(
            output.tally,
            Tally {
                passed: 12,
                failed: 0,
                skipped: 0
            }
        );
    }

    #[test]
    fn a_failing_binary_shows_its_failures_only() {
        let mut output = TestOutput::default();
        for line in [
            "of an earlier binary",
            PASSED,
            "test one ... ok",
            "successes:",
            "    one",
        ] {
            output.line(line);
        }
        for line in ["failures:", "---- two stdout ----", "why"] {
            assert!(output.line(line).is_empty());
        }
        assert_eq!(
            output.line(FAILED),
            ["failures:", "---- two stdout ----", "why"]
        );
        assert_eq!(
            output.tally,
            Tally {
                passed: 16,
                failed: 2,
                skipped: 0
            }
        );
    }

    #[test]
    fn skipped_recordings_are_shown_and_counted() {
        let mut output = TestOutput::default();
        assert_eq!(output.line("skipped: recording not present").len(), 1);
        assert_eq!(output.tally.skipped, 1);
    }

    #[test]
    fn what_a_crashed_binary_said_is_kept() {
        let mut output = TestOutput::default();
        output.line("thread 'main' has overflowed its stack");
        assert_eq!(output.pending.len(), 1);
    }

    #[test]
    fn a_failing_command_is_named_in_full() {
        let missing = Command::new("plumb-no-such-program");
        let error = pass(missing).expect_err("it doesn't exist");
        assert!(
            error
                .to_string()
                .starts_with("`plumb-no-such-program` could not be started")
        );
    }
}
