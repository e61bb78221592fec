//! The Python package `plumb`: its tests, and its wheel.
//!
//! In: the library of the crate `python`, from the one build of tests and tools, and the package's
//! files. Out: the package in `target/python`, as pip would lay it out, and the number of tests
//! that passed on it. [`wheel`] lets maturin build the wheel that `pip install ./python` makes,
//! installs it into an environment without the checkout, and runs a script there: a build of its
//! own, since cargo chooses other features for a package alone.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs, io};

use crate::built;
use crate::command::{self, CommandError, Tally};
use crate::environment::{self, EnvironmentError};
use crate::pytest;
use crate::workspace::{Workspace, remove_folder};

/// The packages of the tests, each with its exact release.
const REQUIREMENTS: &str = "python/requirements.txt";

/// The same with Spark.
const SPARK_REQUIREMENTS: &str = "python/spark-requirements.txt";

/// The same for the wheel alone.
const WHEEL_REQUIREMENTS: &str = "python/wheel-requirements.txt";

/// What the package states of itself where it was laid out and not installed.
const METADATA: &str = "Metadata-Version: 2.1\nName: plumb\nVersion: 0.0.0\n";

/// By which python-can finds the virtual instrument, as `pyproject.toml` has it.
const ENTRY_POINTS: &str = "[can.interface]\nplumb = plumb.bus:TwinBus\n";

/// What has to work where nothing but the wheel is installed.
const SCRIPT: &str = "import importlib.resources, plumb; \
                      queries = importlib.resources.files('plumb') / 'fleet' / 'queries'; \
                      assert 'regr_slope' in (queries / 'drift.sql').read_text(); \
                      twin = plumb.Twin(calibrated=False); \
                      assert {0x701, 0x702} <= {frame.id for frame in twin.run(1.0)}; \
                      assert plumb.Chain().run([[0, 0, 16384]]).reason.tolist() == [[2, 2]]";

/// Why the tests did not run, or failed.
#[derive(Debug, thiserror::Error)]
pub enum PythonError {
    /// There is no environment to run them in.
    #[error("{0}")]
    Environment(#[from] EnvironmentError),
    /// A command failed: the build, a test, or the installation.
    #[error("{0}")]
    Command(#[from] CommandError),
    /// A file or folder could not be handled.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// No test ran at all, which means the run shows nothing.
    #[error("not one test ran")]
    NoTests,
    /// Maturin has left no wheel, or several.
    #[error("maturin has not left one wheel")]
    NoWheel,
}

/// Builds the package, makes the environment where it is missing, and runs every test.
///
/// The count stands in `tally` even when a test fails. Errors: see [`PythonError`].
pub fn run(workspace: &Workspace, tally: &mut Tally) -> Result<(), PythonError> {
    let python = environment::python(workspace, REQUIREMENTS, "python-venv")?;
    let tests = pytest::side_by_side(workspace, &python, "python/tests");
    pass(workspace, tests, tally)
}

/// Runs the tests of the fleet on Spark, which needs Java, in an environment of their own.
///
/// Errors: see [`PythonError`].
pub fn spark(workspace: &Workspace, tally: &mut Tally) -> Result<(), PythonError> {
    let python = environment::python(workspace, SPARK_REQUIREMENTS, "spark-venv")?;
    let tests = pytest::command(workspace, &python, "python/tests/spark_fleet.py");
    pass(workspace, tests, tally)
}

/// Measures the fleet and writes the last section of `docs/fleet.md`; logs and results stay in
/// `target/fleet` until all is done.
///
/// Errors: see [`PythonError`].
pub fn fleet(workspace: &Workspace) -> Result<(), PythonError> {
    let python = environment::python(workspace, REQUIREMENTS, "python-venv")?;
    let work = workspace.target().join("fleet");
    let words = ["python/tests/bench_fleet.py", "--write", "docs/fleet.md"];
    let mut bench = workspace.program(&python.to_string_lossy(), &words);
    bench.arg(&work);
    equip(workspace, &mut bench)?;
    command::pass(bench)?;
    remove_folder(&work).map_err(|error| PythonError::File(work, error))
}

/// Lays the package out for a command, and tells it where that and the program are.
fn equip(workspace: &Workspace, command: &mut Command) -> Result<(), PythonError> {
    let program = built::binary(workspace, "plumb")?;
    let library = built::library(workspace, "_plumb")?;
    let package = lay_out(workspace, &library)?;
    command.env("PYTHONPATH", package).env("PLUMB", program);
    command.env("PYTHONDONTWRITEBYTECODE", "1");
    Ok(())
}

/// Runs tests on the package.
fn pass(workspace: &Workspace, mut tests: Command, tally: &mut Tally) -> Result<(), PythonError> {
    equip(workspace, &mut tests)?;
    let (counted, last, outcome) = pytest::run(tests);
    println!("      {last}");
    *tally = tally.plus(counted);
    outcome?;
    match counted.passed {
        0 => Err(PythonError::NoTests),
        _ => Ok(()),
    }
}

/// Puts the package's files and the library side by side; the folder for `PYTHONPATH`.
fn lay_out(workspace: &Workspace, library: &Path) -> Result<PathBuf, PythonError> {
    let folder = workspace.target().join("python");
    let failed = |error| PythonError::File(folder.clone(), error);
    remove_folder(&folder).map_err(failed)?;
    let (package, about) = (folder.join("plumb"), folder.join("plumb-0.0.0.dist-info"));
    for folder in [&package, &about] {
        fs::create_dir_all(folder).map_err(|error| PythonError::File(folder.clone(), error))?;
    }
    copy_all(&workspace.root().join("python").join("plumb"), &package)?;
    copy(library, &package.join(native()))?;
    for (name, text) in [("METADATA", METADATA), ("entry_points.txt", ENTRY_POINTS)] {
        let path = about.join(name);
        fs::write(&path, text).map_err(|error| PythonError::File(path.clone(), error))?;
    }
    Ok(folder)
}

/// The library's name among the package's files.
const fn native() -> &'static str {
    if cfg!(windows) {
        "_plumb.pyd"
    } else {
        "_plumb.abi3.so"
    }
}

/// Copies the files of a folder, and of the folders in it but Python's own.
fn copy_all(from: &Path, to: &Path) -> Result<(), PythonError> {
    let failed = |error| PythonError::File(from.to_path_buf(), error);
    fs::create_dir_all(to).map_err(|error| PythonError::File(to.to_path_buf(), error))?;
    for entry in fs::read_dir(from).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_file() {
            copy(&path, &to.join(name))?;
        } else if name != "__pycache__" {
            copy_all(&path, &to.join(name))?;
        }
    }
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Result<(), PythonError> {
    let copied = fs::copy(from, to);
    let copied = copied.map_err(|error| PythonError::File(from.to_path_buf(), error));
    copied.map(drop)
}

/// Builds the wheel in the profile of the tests, installs it and runs [`SCRIPT`] on it.
///
/// Errors: see [`PythonError`].
pub fn wheel(workspace: &Workspace) -> Result<(), PythonError> {
    let python = environment::python(workspace, WHEEL_REQUIREMENTS, "wheel-venv")?;
    let folder = workspace.target().join("wheels");
    let failed = |error| PythonError::File(folder.clone(), error);
    remove_folder(&folder).map_err(failed)?;
    let words = [
        "-m",
        "maturin",
        "build",
        "--profile",
        "dev",
        "--manifest-path",
    ];
    let mut maturin = workspace.program(&python.to_string_lossy(), &words);
    maturin.arg("python/Cargo.toml").arg("--out").arg(&folder);
    command::pass(maturin)?;
    let found = fs::read_dir(&folder).map_err(failed)?;
    let found: Vec<_> = found.filter_map(|entry| Some(entry.ok()?.path())).collect();
    let [wheel] = &found[..] else {
        return Err(PythonError::NoWheel);
    };
    let words = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
    ];
    let mut pip = workspace.program(&python.to_string_lossy(), &words);
    pip.args(["--force-reinstall", "--no-deps"]).arg(wheel);
    command::pass(pip)?;
    let mut script = workspace.program(&python.to_string_lossy(), &["-c", SCRIPT]);
    script.current_dir(env::temp_dir());
    command::pass(script)?;
    let bytes = fs::metadata(wheel).map_or(0, |about| about.len());
    println!("      {}: {} kB", wheel.display(), bytes / 1000);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_package_that_was_laid_out_has_the_entry_points_of_the_wheel() {
        let path = Workspace::locate().root().join("python/pyproject.toml");
        let text = fs::read_to_string(path).expect("the package's description");
        let section = "[project.entry-points.\"can.interface\"]\nplumb = \"plumb.bus:TwinBus\"\n";
        assert!(text.contains(section));
        assert!(ENTRY_POINTS.ends_with("plumb = plumb.bus:TwinBus\n"));
    }
}
