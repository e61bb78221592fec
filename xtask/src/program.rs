//! The program: how large it is, and how soon it answers.
//!
//! In: the workspace. Out: the length of `plumb`, as the tests are built or as
//! `cargo build --release` makes it, and the time from its call to the end of `plumb --help`, each
//! beside its limit. The time is the best of many, since a machine that is busy makes single calls
//! longer and none shorter.
//!
//! Left out: what it does once it runs; docs/decoding.md and docs/monitor.md have that.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use std::{env, fmt, fs, io};

use crate::built;
use crate::command::{self, CommandError};
use crate::workspace::Workspace;

/// The longest that the released program may be, in bytes.
const LENGTH_LIMIT: u64 = 12_000_000;

/// The longest that it may be as the tests are built, without optimisation of the whole: as far
/// above what it is.
const LENGTH_LIMIT_OF_TESTS: u64 = 20_000_000;

/// The longest that the help may take.
const HELP_LIMIT: Duration = Duration::from_millis(10);

/// Calls of which the best counts.
const CALLS: usize = 50;

/// Why the program is not as it should be.
#[derive(Debug)]
pub enum ProgramError {
    /// It could not be built.
    Command(CommandError),
    /// It could not be measured.
    File(PathBuf, io::Error),
    /// It is too long, and the limit.
    Length(u64, u64),
    /// It is too slow.
    Help(Duration),
}

impl fmt::Display for ProgramError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Command(error) => write!(out, "{error}"),
            Self::File(path, error) => write!(out, "{}: {error}", path.display()),
            Self::Length(bytes, limit) => {
                write!(out, "it has {bytes} bytes, and {limit} are the limit")
            }
            Self::Help(time) => write!(
                out,
                "its help takes {:.1} ms at best, and {:.0} ms are the limit",
                milliseconds(*time),
                milliseconds(HELP_LIMIT)
            ),
        }
    }
}

impl From<CommandError> for ProgramError {
    fn from(error: CommandError) -> Self {
        Self::Command(error)
    }
}

/// Builds the program as it is released, measures it, and prints what came out.
///
/// Errors: see [`ProgramError`].
pub fn check_released(workspace: &Workspace) -> Result<(), ProgramError> {
    command::pass(workspace.cargo(&["build", "--quiet", "--release", "--package", "plumb"]))?;
    let name = format!("plumb{}", env::consts::EXE_SUFFIX);
    let path = workspace.target().join("release").join(name);
    measure(workspace, &path, LENGTH_LIMIT)
}

/// Measures the program as the tests are built, and prints what came out.
///
/// Errors: see [`ProgramError`].
pub fn check(workspace: &Workspace) -> Result<(), ProgramError> {
    measure(
        workspace,
        &built::binary(workspace, "plumb")?,
        LENGTH_LIMIT_OF_TESTS,
    )
}

fn measure(workspace: &Workspace, path: &Path, limit: u64) -> Result<(), ProgramError> {
    let about = fs::metadata(path).map_err(|error| ProgramError::File(path.to_owned(), error))?;
    let help = best_help(workspace, path)?;
    println!(
        "      {:.1} MB of {:.0}, `plumb --help` in {:.1} ms of {:.0}",
        about.len() as f64 / 1e6,
        limit as f64 / 1e6,
        milliseconds(help),
        milliseconds(HELP_LIMIT)
    );
    judge(about.len(), limit, help)
}

fn judge(length: u64, limit: u64, help: Duration) -> Result<(), ProgramError> {
    if length > limit {
        return Err(ProgramError::Length(length, limit));
    }
    if help > HELP_LIMIT {
        return Err(ProgramError::Help(help));
    }
    Ok(())
}

/// The shortest time of many calls.
fn best_help(workspace: &Workspace, path: &Path) -> Result<Duration, ProgramError> {
    let mut best = Duration::MAX;
    for _ in 0..CALLS {
        let mut help = workspace.program(&path.to_string_lossy(), &["--help"]);
        help.stdout(Stdio::null());
        let from = Instant::now();
        let ended = help.status();
        best = best.min(from.elapsed());
        ended.map_err(|error| ProgramError::File(path.to_owned(), error))?;
    }
    Ok(best)
}

fn milliseconds(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_is_too_long_or_too_slow_is_refused() {
        let soon = Duration::from_millis(3);
        assert!(judge(12, 12, HELP_LIMIT).is_ok());
        let long = judge(13, 12, soon).unwrap_err().to_string();
        assert!(long.contains("it has 13 bytes, and 12 are"), "{long}");
        let slow = judge(1, 12, Duration::from_millis(11))
            .unwrap_err()
            .to_string();
        assert!(slow.contains("11.0 ms"), "{slow}");
    }
}
