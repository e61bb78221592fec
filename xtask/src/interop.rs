//! The virtual instrument against a master that others have written: the tests in `interop/`.
//!
//! In: the programs `plumb` and `emulate`, built with the flags of the other tests, and Python.
//! Out: the number of tests that passed. The master's packages are pinned in
//! `interop/requirements.txt`; they go into a virtual environment in the target folder, which is
//! made anew whenever the list or Python changes. Nothing is installed anywhere else, and the
//! network is needed that once only.
//!
//! Left out: the tests themselves, which are Python.

use std::cmp::Reverse;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};
use std::{env, fmt, fs, io, thread};

use crate::built;
use crate::command::{self, CommandError, Tally};
use crate::image::{self, ImageError};
use crate::workspace::Workspace;

/// The packages, each with its exact release.
const REQUIREMENTS: &str = "interop/requirements.txt";

/// Names under which Python is called, the usual one first.
const PYTHONS: [&str; 2] = ["python3", "python"];

/// Ends with status 0 for a Python that is new enough, and prints which one it is.
const VERSION: &str = "import sys; print(sys.version); sys.exit(sys.version_info < (3, 10))";

/// Why the tests did not run, or failed.
#[derive(Debug)]
pub enum InteropError {
    /// There is no Python, or an old one.
    NoPython,
    /// Python cannot make a virtual environment.
    NoEnvironment,
    /// The packages could not be installed.
    Packages,
    /// A command failed: the build, or a test.
    Command(CommandError),
    /// There are no images to emulate.
    Image(ImageError),
    /// A file or folder could not be handled.
    File(PathBuf, io::Error),
    /// No test ran at all, which means the run says nothing.
    NoTests,
}

impl fmt::Display for InteropError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPython => write!(
                out,
                "there is no Python 3.10 or newer under the name python3 or python: install one"
            ),
            Self::NoEnvironment => write!(
                out,
                "Python cannot make a virtual environment here; on Debian and Ubuntu type \
                 `sudo apt install python3-venv`, elsewhere `pip install virtualenv`"
            ),
            Self::Packages => write!(
                out,
                "the packages of {REQUIREMENTS} could not be installed (what pip says stands \
                 above); the network is needed once, then never again"
            ),
            Self::Command(error) => write!(out, "{error}"),
            Self::Image(error) => write!(out, "{error}"),
            Self::File(path, error) => write!(out, "{}: {error}", path.display()),
            Self::NoTests => write!(out, "not one test ran"),
        }
    }
}

impl From<CommandError> for InteropError {
    fn from(error: CommandError) -> Self {
        Self::Command(error)
    }
}

impl From<ImageError> for InteropError {
    fn from(error: ImageError) -> Self {
        Self::Image(error)
    }
}

/// Files that the exact image on emulated boards is not asked to pass: they are about the program
/// `plumb`, or about another instrument than the image is. Single tests say so by a mark.
const NOT_EMULATED: [&str; 8] = [
    "test_calibration.py",
    "test_load.py",
    "test_logs.py",
    "test_paper.py",
    "test_report.py",
    "test_transports.py",
    "test_update.py",
    "test_web.py",
];

/// Files that the paper's instrument is not asked to pass: they are about the product's judgement
/// and its log, about the program `plumb`, or they name their mode. Single tests say so by a mark.
const NOT_PAPER: [&str; 11] = [
    "test_calibration.py",
    "test_load.py",
    "test_log.py",
    "test_logs.py",
    "test_pair.py",
    "test_paper.py",
    "test_policy.py",
    "test_report.py",
    "test_transports.py",
    "test_update.py",
    "test_web.py",
];

/// Files that the exact image of the paper's instrument is asked to pass; single tests that need
/// what only the product has say so by a mark.
const PAPER_IMAGE_PASSES: [&str; 7] = [
    "test_calibration.py",
    "test_eds.py",
    "test_heartbeat.py",
    "test_nmt.py",
    "test_pdo.py",
    "test_sdo.py",
    "test_sync.py",
];

/// What is tested: the program that serves the bus, and the mode of its instrument.
#[derive(Clone, Copy, Debug)]
struct Served {
    program: &'static str,
    mode: &'static str,
}

/// The virtual instrument of the product.
const PRODUCT: Served = Served {
    program: "plumb",
    mode: "product",
};

/// The virtual instrument of the paper.
const PAPER: Served = Served {
    program: "plumb",
    mode: "paper",
};

/// The exact image on emulated boards.
const IMAGE: Served = Served {
    program: "emulate",
    mode: "product",
};

/// The exact image of the paper's instrument.
const PAPER_IMAGE: Served = Served {
    program: "emulate",
    mode: "paper",
};

/// Files of tests that run at the same time. They wait for the bus most of their time.
const AT_ONCE: usize = 3;

/// The same of emulated nodes, which take a good part of a processor.
const EMULATED_AT_ONCE: usize = 2;

/// Builds the program, makes the environment where it is missing, and runs every test.
///
/// The count stands in `tally` even when a test fails.
pub fn run(workspace: &Workspace, tally: &mut Tally) -> Result<(), InteropError> {
    let python = environment(workspace)?;
    for program in [PRODUCT, IMAGE].map(|served| served.program) {
        built::binary(workspace, program)?;
    }
    let all = files(workspace)?;
    let without = |left_out: &[&str]| -> Vec<String> {
        let kept = all.iter().filter(|file| !left_out.contains(&&***file));
        kept.cloned().collect()
    };
    let (emulated, paper) = (without(&NOT_EMULATED), without(&NOT_PAPER));
    let images = images(workspace)?;
    let test = |job: Job| test(workspace, &python, &images, job);
    let passes = PAPER_IMAGE_PASSES.map(str::to_owned).to_vec();
    let virtual_ones = jobs(all, PRODUCT).chain(jobs(paper, PAPER)).collect();
    let emulated_ones = jobs(emulated, IMAGE).chain(jobs(passes, PAPER_IMAGE));
    let emulated_ones = emulated_ones.collect();
    let outcomes: Vec<_> = thread::scope(|scope| {
        let emulated = scope.spawn(|| side_by_side(EMULATED_AT_ONCE, emulated_ones, test));
        let mut outcomes = side_by_side(AT_ONCE, virtual_ones, test);
        outcomes.extend(emulated.join().unwrap_or_else(|panic| resume_unwind(panic)));
        outcomes
    });
    let mut failed = None;
    for (counted, outcome) in outcomes {
        *tally = tally.plus(counted);
        failed = failed.or(outcome.err());
    }
    match failed {
        Some(error) => Err(error.into()),
        None if tally.passed == 0 => Err(InteropError::NoTests),
        None => Ok(()),
    }
}

/// A file of tests, and what it is run against.
type Job = (String, Served);

fn jobs(files: Vec<String>, served: Served) -> impl Iterator<Item = Job> {
    files.into_iter().map(move |file| (file, served))
}

/// How one file has gone.
type Outcome = (Tally, Result<(), CommandError>);

/// Does `work` for each job, so many of them at a time.
fn side_by_side(
    at_once: usize,
    jobs: Vec<Job>,
    work: impl Fn(Job) -> Outcome + Copy + Sync,
) -> Vec<Outcome> {
    let waiting = Mutex::new(jobs.into_iter());
    let next = || {
        let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.next()
    };
    let worker = || std::iter::from_fn(next).map(work).collect();
    thread::scope(|scope| {
        let workers: Vec<_> = (0..at_once).map(|_| scope.spawn(worker)).collect();
        let done = workers.into_iter().map(|worker| worker.join());
        let done: Vec<Vec<_>> = done
            .map(|outcomes| outcomes.unwrap_or_else(|panic| resume_unwind(panic)))
            .collect();
        done.into_iter().flatten().collect()
    })
}

/// Every file of tests, the largest first, so that none of them is left running alone for long.
fn files(workspace: &Workspace) -> Result<Vec<String>, InteropError> {
    let folder = workspace.root().join("interop");
    let failed = |error| InteropError::File(folder.clone(), error);
    let mut files = Vec::new();
    for entry in fs::read_dir(&folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with("test_") && name.ends_with(".py") {
            let length = entry.metadata().map_err(failed)?.len();
            files.push((Reverse(length), name));
        }
    }
    files.sort();
    Ok(files.into_iter().map(|(_, name)| name).collect())
}

/// The folder with the images for emulated boards: once for all, since every bus would build them
/// anew. Beside other steps they are those that the emulator's tests use, made before.
fn images(workspace: &Workspace) -> Result<PathBuf, ImageError> {
    let emulated = workspace.target().join("emulated");
    if built::is_ready() {
        return Ok(emulated.join("images"));
    }
    let images = emulated.join("interop");
    image::build_into(workspace, images.clone())?;
    Ok(images)
}

/// Runs one file of tests against what is served: its summary is printed, and everything
/// where a test fails.
fn test(workspace: &Workspace, python: &Path, images: &Path, (file, served): Job) -> Outcome {
    let Served { program, mode } = served;
    let name = format!("{program}{}", env::consts::EXE_SUFFIX);
    let mut pytest = workspace.program(
        &python.to_string_lossy(),
        &["-m", "pytest", "-q", "-p", "no:cacheprovider"],
    );
    pytest
        .arg(format!("interop/{file}"))
        .env("PLUMB", built::folder(workspace).join(name))
        .env("PLUMB_IMAGES", images)
        .env("PLUMB_MODE", mode)
        .env("PYTHONDONTWRITEBYTECODE", "1");
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
    println!("      {program}, {mode}, {file}: {last}");
    (tally, outcome)
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

/// The Python of an environment that has the packages; made now unless it is there already.
fn environment(workspace: &Workspace) -> Result<PathBuf, InteropError> {
    let (system, version) = system(workspace)?;
    let folder = workspace.target().join("interop-venv");
    let list = workspace.root().join(REQUIREMENTS);
    let wanted = fs::read_to_string(&list).map_err(|error| InteropError::File(list, error))?;
    let wanted = format!("# {}\n{wanted}", version.trim());
    let stamp = folder.join("installed.txt");
    let python = interpreter(&folder);
    let installed = fs::read_to_string(&stamp).is_ok_and(|text| text == wanted);
    if installed && command::succeeds(query(workspace, &python)) {
        return Ok(python);
    }
    println!("      installing the packages of {REQUIREMENTS}");
    make(workspace, system, &folder)?;
    let mut pip = workspace.program(&python.to_string_lossy(), &["-m", "pip", "install"]);
    pip.args(["--quiet", "--disable-pip-version-check", "-r", REQUIREMENTS]);
    command::pass(pip).map_err(|_| InteropError::Packages)?;
    fs::write(&stamp, wanted).map_err(|error| InteropError::File(stamp, error))?;
    Ok(python)
}

/// The Python of this machine: how to call it, and what it says it is.
fn system(workspace: &Workspace) -> Result<(&'static str, String), InteropError> {
    let answers = PYTHONS.into_iter().filter_map(|name| {
        let found = command::succeeds(query(workspace, Path::new(name)));
        let version = || command::capture(query(workspace, Path::new(name))).ok();
        found.then(version).flatten().map(|version| (name, version))
    });
    answers.take(1).next().ok_or(InteropError::NoPython)
}

/// Asks a Python for its version.
fn query(workspace: &Workspace, python: &Path) -> Command {
    workspace.program(&python.to_string_lossy(), &["-c", VERSION])
}

/// Makes an empty environment in place of what is there.
fn make(workspace: &Workspace, python: &str, folder: &Path) -> Result<(), InteropError> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            return Err(InteropError::File(folder.to_path_buf(), error));
        }
        _ => {}
    }
    // Debian ships `venv` without what it needs to work; `virtualenv` brings its own.
    let made = ["venv", "virtualenv"].into_iter().any(|module| {
        let mut command = workspace.program(python, &["-m", module]);
        command.arg(folder);
        command::succeeds(command) && interpreter(folder).exists()
    });
    if made {
        Ok(())
    } else {
        Err(InteropError::NoEnvironment)
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

    /// Pytest fails where every test of a file is left out.
    #[test]
    fn a_file_for_the_host_s_build_only_was_asked_of_the_emulated_boards() {
        let workspace = Workspace::locate();
        let folder = workspace.root().join("interop");
        let whole = |file: &String| {
            let text = fs::read_to_string(folder.join(file)).expect("a file of the listing");
            text.contains("\npytestmark = pytest.mark.virtual(")
        };
        let files = files(&workspace).expect("the folder of the project");
        let left_out: Vec<_> = files.into_iter().filter(whole).collect();
        assert!(left_out.len() > 3, "{left_out:?}");
        for file in left_out {
            assert!(NOT_EMULATED.contains(&file.as_str()), "{file}");
        }
    }

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

    #[test]
    fn what_is_missing_is_named_with_what_to_do() {
        let said = |error: InteropError| error.to_string();
        assert!(said(InteropError::NoPython).ends_with("install one"));
        assert!(said(InteropError::NoEnvironment).contains("python3-venv"));
        assert!(said(InteropError::Packages).contains(REQUIREMENTS));
    }
}
