//! Where the checkout is, and how to call cargo in it.
//!
//! Every step calls cargo from the root of the workspace with the environment this process was
//! given, so all steps share one target directory and one set of compiler flags.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs, io};

/// The checkout this command belongs to.
pub struct Workspace {
    root: PathBuf,
    /// Where cargo puts what it builds, absolute.
    target: PathBuf,
    /// Cargo's home, where it is not that of the environment.
    home: Option<PathBuf>,
}

impl Workspace {
    /// Finds the root from the manifest directory that cargo states at run time, so that the
    /// answer doesn't depend on the directory the command was typed in.
    pub fn locate() -> Self {
        let manifest = env::var_os("CARGO_MANIFEST_DIR")
            .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
        let root = manifest.parent().unwrap_or(&manifest).to_path_buf();
        // A relative directory was meant from where the person stands, not from the root.
        let target = match (env::var_os("CARGO_TARGET_DIR"), env::current_dir()) {
            (Some(folder), Ok(here)) => here.join(folder),
            _ => root.join("target"),
        };
        Self {
            root,
            target,
            home: None,
        }
    }

    /// Another checkout, with a target directory and a home of cargo that are its own.
    #[cfg(unix)]
    pub fn elsewhere(root: PathBuf, target: PathBuf, home: PathBuf) -> Self {
        Self {
            root,
            target,
            home: Some(home),
        }
    }

    /// The root folder, absolute.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Where cargo puts what it builds.
    pub fn target(&self) -> PathBuf {
        self.target.clone()
    }

    /// A cargo command that will run in the root.
    pub fn cargo(&self, arguments: &[&str]) -> Command {
        self.command(&from_environment("CARGO", "cargo"), arguments)
    }

    /// A rustc command of the same toolchain.
    pub fn rustc(&self, arguments: &[&str]) -> Command {
        self.command(&from_environment("RUSTC", "rustc"), arguments)
    }

    /// Any other program, run in the root.
    pub fn program(&self, program: &str, arguments: &[&str]) -> Command {
        self.command(&OsString::from(program), arguments)
    }

    fn command(&self, program: &OsString, arguments: &[&str]) -> Command {
        let mut command = Command::new(program);
        command.args(arguments).current_dir(&self.root);
        command.env("CARGO_TARGET_DIR", &self.target);
        if let Some(home) = &self.home {
            command.env("CARGO_HOME", home);
        }
        command
    }
}

fn from_environment(variable: &str, otherwise: &str) -> OsString {
    env::var_os(variable).unwrap_or_else(|| OsString::from(otherwise))
}

/// Removes a folder with all that is in it; where there is none, nothing is left to do.
///
/// Errors: it could not be removed.
pub fn remove_folder(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_holds_the_workspace_manifest() {
        let manifest = std::fs::read_to_string(Workspace::locate().root().join("Cargo.toml"));
        assert!(
            manifest
                .expect("a manifest in the root")
                .contains("[workspace]")
        );
    }

    #[test]
    fn commands_run_in_the_root_whatever_the_current_directory() {
        let workspace = Workspace::locate();
        let command = workspace.cargo(&["--version"]);
        assert_eq!(command.get_current_dir(), Some(workspace.root()));
    }
}
