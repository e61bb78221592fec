//! What the steps need besides cargo: parts of the toolchain and packages of the distribution.
//!
//! In: the workspace. Out: they are there, or a sentence with what to type. Left out: Python's
//! packages, which `interop` installs.

use std::path::Path;
use std::process::Command;

use crate::chip;
use crate::command;
use crate::failure::StepError;
use crate::packages;
use crate::workspace::Workspace;

/// Sees to it that all is there.
///
/// Errors: [`StepError::Toolchain`].
pub fn provide_all(workspace: &Workspace) -> Result<(), StepError> {
    let runs = |tool: &str| command::succeeds(workspace.cargo(&[tool, "--version"]));
    let rustup = |words: &[&str]| workspace.program("rustup", words);
    provide("rustfmt", rustup(&["component", "add", "rustfmt"]), || {
        runs("fmt")
    })?;
    provide("clippy", rustup(&["component", "add", "clippy"]), || {
        runs("clippy")
    })?;
    provide(
        "the target of the chip",
        rustup(&["target", "add", chip::TARGET]),
        || {
            let query = workspace.rustc(&["--print", "target-libdir", "--target", chip::TARGET]);
            command::capture(query).is_ok_and(|folder| Path::new(folder.trim()).is_dir())
        },
    )?;
    if !packages::provide_browser(workspace) {
        let typed = packages::TYPED_BROWSER;
        println!("      no browser: its tests are skipped; for them type `{typed}`");
    }
    if packages::provide(workspace) {
        return Ok(());
    }
    let reference = "what the core beside the emulator's is built with";
    Err(StepError::Toolchain(reference, packages::TYPED.to_owned()))
}

/// Adds a part of the toolchain unless it is there.
fn provide(part: &'static str, add: Command, present: impl Fn() -> bool) -> Result<(), StepError> {
    if present() {
        return Ok(());
    }
    println!("      adding {part}");
    let typed = command::name(&add);
    if command::pass(add).is_ok() && present() {
        return Ok(());
    }
    Err(StepError::Toolchain(part, typed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_part_that_cannot_be_added_gives_what_to_type() {
        let error = provide("a part", Command::new("plumb-no-such-program"), || false);
        let sentence = error.expect_err("it is never present").to_string();
        assert!(
            sentence.ends_with("type `plumb-no-such-program`"),
            "{sentence}"
        );
    }
}
