//! The one build of tests, examples and tools, and where its programs are.
//!
//! In: the workspace, the name of a program. Out: its path, built as the tests are: all packages at
//! once and with what the tests depend on, since cargo would choose other features of shared
//! dependencies for a package alone, and build them a second time. A process that was started side
//! by side with others ([`READY`]) builds nothing: all was built before, and cargo lets only one
//! build go on at a time. The emulator goes by the same variable and takes its images as they are.
//!
//! Left out: programs of the chip (`chip`), and the released `plumb` (`program`).

use std::env;
use std::path::PathBuf;

use crate::command::{self, CommandError};
use crate::workspace::Workspace;

/// The variable that tells a process that everything is built.
pub const READY: &str = "PLUMB_BUILT";

/// An example that is built with every other program: without one, cargo would leave out what
/// tests depend on when it chooses features. It is the smallest.
const WITH: [&str; 2] = ["--example", "sdo_upload"];

/// Whether everything is built.
pub fn is_ready() -> bool {
    env::var_os(READY).is_some()
}

/// The program `name` of a package.
///
/// Errors: it does not build.
pub fn binary(workspace: &Workspace, name: &str) -> Result<PathBuf, CommandError> {
    build(workspace, &["--bin", name])?;
    Ok(folder(workspace).join(file(name)))
}

/// The example `name` of a package.
///
/// Errors: it does not build.
pub fn example(workspace: &Workspace, name: &str) -> Result<PathBuf, CommandError> {
    build(workspace, &["--example", name])?;
    Ok(folder(workspace).join("examples").join(file(name)))
}

/// The library `name` that another program loads.
///
/// Errors: it does not build.
pub fn library(workspace: &Workspace, name: &str) -> Result<PathBuf, CommandError> {
    build(workspace, &["--lib"])?;
    let file = format!(
        "{}{name}{}",
        env::consts::DLL_PREFIX,
        env::consts::DLL_SUFFIX
    );
    Ok(folder(workspace).join(file))
}

fn build(workspace: &Workspace, wanted: &[&str]) -> Result<(), CommandError> {
    if is_ready() {
        return Ok(());
    }
    let mut cargo = workspace.cargo(&["build", "--quiet", "--workspace"]);
    cargo.args(wanted).args(WITH);
    command::pass(cargo)
}

/// Where cargo puts what it builds for tests.
pub fn folder(workspace: &Workspace) -> PathBuf {
    workspace.target().join("debug")
}

fn file(name: &str) -> String {
    format!("{name}{}", env::consts::EXE_SUFFIX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_was_built_apart_from_the_tests_and_shared_nothing_with_them() {
        let workspace = Workspace::locate();
        let manifest = std::fs::read_to_string(workspace.root().join("Cargo.toml"));
        let manifest = manifest.expect("the workspace");
        // Another profile for tests than for programs would build each crate twice.
        assert!(manifest.contains("\n[profile.dev]\n"));
        assert!(!manifest.contains("\n[profile.test]\n"));
        // It would hold for macros and build scripts, too, and optimise the compiler's helpers.
        assert!(!manifest.contains("[profile.dev.package.\"*\"]"));
    }
}
