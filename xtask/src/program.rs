//! The program: how large it is, and how soon it answers.
//!
//! In: the workspace. Out: the length of `plumb`, as the tests are built or as
//! `cargo build --release` makes it, and the time from its call to the end of `plumb --help`, each
//! beside its limit. The time is the best of many, since a machine that is busy makes single calls
//! longer and none shorter. Steps run side by side, so even the best may have waited for others:
//! calls of this program alternate with it, and a slow machine makes both longer.
//!
//! Left out: what it does once it runs; docs/decoding.md and docs/monitor.md have that.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use std::{env, fs, io};

use crate::built;
use crate::command::{self, CommandError};
use crate::workspace::Workspace;

/// The longest that the released program may be, in bytes.
const LENGTH_LIMIT: u64 = 12_000_000;

/// The longest that it may be as the tests are built, without optimisation of the whole: as far
/// above what it is.
const LENGTH_LIMIT_OF_TESTS: u64 = 20_000_000;

/// The longest that the help may take where the machine has nothing else to do.
const HELP_LIMIT: Duration = Duration::from_millis(10);

/// Calls of a small program that the help may last where the machine is slower than that: 3.2 were
/// measured, and 7 are 10 ms on the same machine.
const HELP_LIMIT_IN_STARTS: u32 = 6;

/// Calls of which the best counts.
const CALLS: usize = 50;

/// Why the program is not as it should be.
#[derive(Debug, thiserror::Error)]
pub enum ProgramError {
    /// It could not be built.
    #[error("{0}")]
    Command(#[from] CommandError),
    /// It could not be measured.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// It is too long, and the limit.
    #[error("it has {0} bytes, and {1} are the limit")]
    Length(u64, u64),
    /// It is too slow.
    #[error(
        "its help takes {:.1} ms at best, and {:.1} ms are the limit",
        milliseconds(.0.help),
        milliseconds(.0.limit())
    )]
    Help(Answer),
}

/// How soon it answers, beside a program that has nothing to do.
#[derive(Debug, Clone, Copy)]
pub struct Answer {
    /// From the call of `plumb --help` to its end, the best of many.
    help: Duration,
    /// The same of this program's own help, which is text and nothing else.
    start: Duration,
}

impl Answer {
    /// The longest that the help may take on this machine, as busy as it is.
    fn limit(self) -> Duration {
        HELP_LIMIT.max(HELP_LIMIT_IN_STARTS * self.start)
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
    let answer = best_answer(workspace, path)?;
    println!(
        "      {:.1} MB of {:.0}, `plumb --help` in {:.1} ms of {:.1}, a small program in {:.1} ms",
        about.len() as f64 / 1e6,
        limit as f64 / 1e6,
        milliseconds(answer.help),
        milliseconds(answer.limit()),
        milliseconds(answer.start)
    );
    judge(about.len(), limit, answer)
}

fn judge(length: u64, limit: u64, answer: Answer) -> Result<(), ProgramError> {
    if length > limit {
        return Err(ProgramError::Length(length, limit));
    }
    if answer.help > answer.limit() {
        return Err(ProgramError::Help(answer));
    }
    Ok(())
}

/// The shortest times of many calls, of both programs in turn.
fn best_answer(workspace: &Workspace, path: &Path) -> Result<Answer, ProgramError> {
    let own = env::current_exe().map_err(|error| ProgramError::File("xtask".into(), error))?;
    let mut best = Answer {
        help: Duration::MAX,
        start: Duration::MAX,
    };
    for _ in 0..CALLS {
        best.help = best.help.min(help_of(workspace, path)?);
        best.start = best.start.min(help_of(workspace, &own)?);
    }
    Ok(best)
}

/// The time of one call.
fn help_of(workspace: &Workspace, path: &Path) -> Result<Duration, ProgramError> {
    let mut help = workspace.program(&path.to_string_lossy(), &["--help"]);
    help.stdout(Stdio::null());
    let from = Instant::now();
    let ended = help.status();
    let lasted = from.elapsed();
    match ended {
        Ok(_) => Ok(lasted),
        Err(error) => Err(ProgramError::File(path.to_owned(), error)),
    }
}

fn milliseconds(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_is_too_long_or_too_slow_is_refused() {
        let answer = |help, start| Answer {
            help: Duration::from_millis(help),
            start: Duration::from_millis(start),
        };
        assert!(judge(12, 12, answer(10, 1)).is_ok());
        let long = judge(13, 12, answer(3, 1)).unwrap_err().to_string();
        assert!(long.contains("it has 13 bytes, and 12 are"), "{long}");
        let slow = judge(1, 12, answer(11, 1)).unwrap_err().to_string();
        assert!(slow.contains("11.0 ms"), "{slow}");
        // Where everything takes three times as long.
        assert!(judge(12, 12, answer(18, 3)).is_ok());
        let slow = judge(1, 12, answer(19, 3)).unwrap_err().to_string();
        assert!(slow.contains("18.0 ms are the limit"), "{slow}");
    }
}
