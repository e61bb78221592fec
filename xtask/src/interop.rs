//! The virtual instrument against a master that others have written: the tests in `interop/`.
//!
//! In: the programs `plumb` and `emulate`, built with the flags of the other tests, and Python.
//! Out: the number of tests that passed. The master's packages are pinned in
//! `interop/requirements.txt`; they go into a virtual environment in the target folder.
//!
//! Left out: the tests themselves, which are Python.

use std::cmp::Reverse;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::{env, fs, io, thread};

use crate::built;
use crate::command::{CommandError, Tally};
use crate::environment::{self, EnvironmentError};
use crate::image::{self, ImageError};
use crate::pytest;
use crate::workspace::Workspace;

/// The packages, each with its exact release.
const REQUIREMENTS: &str = "interop/requirements.txt";

/// Why the tests did not run, or failed.
#[derive(Debug, thiserror::Error)]
pub enum InteropError {
    /// There is no environment to run them in.
    #[error("{0}")]
    Environment(#[from] EnvironmentError),
    /// A command failed: the build, or a test.
    #[error("{0}")]
    Command(#[from] CommandError),
    /// There are no images to emulate.
    #[error("{0}")]
    Image(#[from] ImageError),
    /// A file or folder could not be handled.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// No test ran at all, which means the run shows nothing.
    #[error("not one test ran")]
    NoTests,
}

/// Files that the exact image on emulated boards is not asked to pass: they are about the program
/// `plumb`, or about another instrument than the image is. Single tests have a mark.
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
/// and its log, about the program `plumb`, or they name their mode. Single tests have a mark.
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
/// what only the product has have a mark.
const PAPER_IMAGE_PASSES: [&str; 7] = [
    "test_calibration.py",
    "test_eds.py",
    "test_heartbeat.py",
    "test_nmt.py",
    "test_pdo.py",
    "test_sdo.py",
    "test_sync.py",
];

/// Files that the variant with a gyroscope passes: a master that was written for the product uses
/// it unchanged, and its own data sheets are kept. What differs has a mark or names its mode.
const DYNAMIC_PASSES: [&str; 11] = [
    "test_eds.py",
    "test_emcy.py",
    "test_log.py",
    "test_nmt.py",
    "test_pair.py",
    "test_pdo.py",
    "test_policy.py",
    "test_profile.py",
    "test_safety.py",
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

/// The virtual instrument with a gyroscope.
const DYNAMIC: Served = Served {
    program: "plumb",
    mode: "dynamic",
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
    let python = environment::python(workspace, REQUIREMENTS, "interop-venv")?;
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
    let dynamic = DYNAMIC_PASSES.map(str::to_owned).to_vec();
    let virtual_ones = jobs(all, PRODUCT).chain(jobs(paper, PAPER));
    let virtual_ones = virtual_ones.chain(jobs(dynamic, DYNAMIC)).collect();
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
    let mut pytest = pytest::command(workspace, python, &format!("interop/{file}"));
    pytest
        .env("PLUMB", built::folder(workspace).join(name))
        .env("PLUMB_IMAGES", images)
        .env("PLUMB_MODE", mode);
    let (tally, last, outcome) = pytest::run(pytest);
    println!("      {program}, {mode}, {file}: {last}");
    (tally, outcome)
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
}
