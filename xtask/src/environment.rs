//! Python in a virtual environment with the packages of a list.
//!
//! In: a list of packages with their releases, and a name in the target folder. Out: the Python of
//! the environment of that name, which is made anew whenever the list or Python changes. Nothing is
//! installed anywhere else, and the network is needed that once only.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{fs, io};

use crate::command;
use crate::workspace::{Workspace, remove_folder};

/// Names under which Python is called, the usual one first.
const PYTHONS: [&str; 2] = ["python3", "python"];

/// Ends with status 0 for a Python that is new enough, and prints which one it is.
const VERSION: &str = "import sys; print(sys.version); sys.exit(sys.version_info < (3, 10))";

/// Why there is no environment.
#[derive(Debug, thiserror::Error)]
pub enum EnvironmentError {
    /// There is no Python, or an old one.
    #[error("there is no Python 3.10 or newer under the name python3 or python: install one")]
    NoPython,
    /// Python cannot make a virtual environment.
    #[error(
        "Python cannot make a virtual environment here; on Debian and Ubuntu type \
         `sudo apt install python3-venv`, elsewhere `pip install virtualenv`"
    )]
    NoEnvironment,
    /// The packages of this list could not be installed.
    #[error(
        "the packages of {0} could not be installed (pip's message stands above); the network is \
         needed once, then never again"
    )]
    Packages(&'static str),
    /// A file or folder could not be handled.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
}

/// The Python of an environment that has the packages; made now unless it is there already.
///
/// Errors: see [`EnvironmentError`].
pub fn python(
    workspace: &Workspace,
    requirements: &'static str,
    name: &str,
) -> Result<PathBuf, EnvironmentError> {
    let (system, version) = system(workspace)?;
    let folder = workspace.target().join(name);
    let list = workspace.root().join(requirements);
    let wanted = fs::read_to_string(&list).map_err(|error| EnvironmentError::File(list, error))?;
    let wanted = format!("# {}\n{wanted}", version.trim());
    let stamp = folder.join("installed.txt");
    let python = interpreter(&folder);
    let installed = fs::read_to_string(&stamp).is_ok_and(|text| text == wanted);
    if installed && command::succeeds(query(workspace, &python)) {
        return Ok(python);
    }
    println!("      installing the packages of {requirements}");
    make(workspace, system, &folder)?;
    let mut pip = workspace.program(&python.to_string_lossy(), &["-m", "pip", "install"]);
    pip.args(["--quiet", "--disable-pip-version-check", "-r", requirements]);
    command::pass(pip).map_err(|_| EnvironmentError::Packages(requirements))?;
    fs::write(&stamp, wanted).map_err(|error| EnvironmentError::File(stamp, error))?;
    Ok(python)
}

/// The Python of this machine: how to call it, and the version that it reports.
fn system(workspace: &Workspace) -> Result<(&'static str, String), EnvironmentError> {
    let answers = PYTHONS.into_iter().filter_map(|name| {
        let found = command::succeeds(query(workspace, Path::new(name)));
        let version = || command::capture(query(workspace, Path::new(name))).ok();
        found.then(version).flatten().map(|version| (name, version))
    });
    answers.take(1).next().ok_or(EnvironmentError::NoPython)
}

/// Asks a Python for its version.
fn query(workspace: &Workspace, python: &Path) -> Command {
    workspace.program(&python.to_string_lossy(), &["-c", VERSION])
}

/// Makes an empty environment in place of what is there.
fn make(workspace: &Workspace, python: &str, folder: &Path) -> Result<(), EnvironmentError> {
    let failed = |error| EnvironmentError::File(folder.to_path_buf(), error);
    remove_folder(folder).map_err(failed)?;
    // Debian ships `venv` without what it needs to work; `virtualenv` brings its own.
    let made = ["venv", "virtualenv"].into_iter().any(|module| {
        let mut command = workspace.program(python, &["-m", module]);
        command.arg(folder);
        command::succeeds(command) && interpreter(folder).exists()
    });
    if made {
        Ok(())
    } else {
        Err(EnvironmentError::NoEnvironment)
    }
}

/// Where an environment keeps its Python.
fn interpreter(folder: &Path) -> PathBuf {
    if cfg!(windows) {
        folder.join("Scripts").join("python.exe")
    } else {
        folder.join("bin").join("python")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_named_with_what_to_do() {
        let said = |error: EnvironmentError| error.to_string();
        assert!(said(EnvironmentError::NoPython).ends_with("install one"));
        assert!(said(EnvironmentError::NoEnvironment).contains("python3-venv"));
        assert!(said(EnvironmentError::Packages("a/list.txt")).contains("a/list.txt"));
    }
}
