//! The world tries to break the instrument: a fixed set of seeds, with and without a gyroscope, a
//! device that is broken on purpose, and one seed that nobody has seen before, taken from the
//! commit.
//!
//! In: the workspace. Out: success, or the first command that failed, with what repeats it on its
//! own output. Left out: the trials themselves, which are `sim`'s (`cargo sim`).

use std::process::Command;

use crate::built;
use crate::command::{self, CommandError};
use crate::workspace::Workspace;

/// Seeds of the fixed set.
const FIXED: &str = "400";

/// Those of it that are run between two changes.
const FEW: &str = "20";

/// Runs the fixed set, the canary, and the commit's own seed.
pub fn run(workspace: &Workspace) -> Result<(), CommandError> {
    let sim = sim(workspace)?;
    command::pass(sim(&["fixed", "--seeds", FIXED]))?;
    command::pass(sim(&["fixed", "--gyroscope", "--seeds", FIXED]))?;
    command::pass(sim(&["canary"]))?;
    let seed = commit_seed(workspace).to_string();
    command::pass(sim(&["seed", &seed]))
}

/// Runs the first seeds of the fixed set.
pub fn run_few(workspace: &Workspace) -> Result<(), CommandError> {
    command::pass(sim(workspace)?(&["fixed", "--seeds", FEW]))
}

/// Builds the program, and makes commands of it.
fn sim(workspace: &Workspace) -> Result<impl Fn(&[&str]) -> Command, CommandError> {
    let program = built::binary(workspace, "sim")?;
    Ok(move |words: &[&str]| workspace.program(&program.to_string_lossy(), words))
}

/// The commit's hash as a seed; 1 where there is no repository.
fn commit_seed(workspace: &Workspace) -> u64 {
    let git = workspace.program("git", &["rev-parse", "HEAD"]);
    command::capture(git).map_or(1, |hash| seed_of(&hash))
}

/// Twelve digits of the hash, which are more than anybody runs.
fn seed_of(hash: &str) -> u64 {
    let digits: String = hash.chars().take(12).collect();
    u64::from_str_radix(&digits, 16).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_commit_gives_another_seed_and_no_commit_gives_one() {
        assert_eq!(seed_of("0000000000ff1234"), 0xFF);
        assert_ne!(seed_of("553f3a9aaaaaaaaa"), seed_of("b83cb72aaaaaaaaa"));
        assert_eq!(seed_of(""), 1);
        assert_eq!(seed_of("not a hash"), 1);
    }
}
