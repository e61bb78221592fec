//! The steps of the one test command, each a function that can also be called alone.
//!
//! In: the workspace. Out: a heading, the time taken and the count of what passed, for each step;
//! the first failure ends the run with a sentence that says what to do. All steps share one
//! target directory and the same compiler flags, so nothing is built twice.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;
use std::{env, fmt, fs, io, process};

use crate::accuracy::{self, AccuracyError};
use crate::campaign;
use crate::chip;
use crate::command::{self, CommandError, Tally};
use crate::faults::{self, FaultsError};
use crate::harness;
use crate::image::{self, ImageError};
use crate::interop::{self, InteropError};
use crate::packages;
use crate::program::{self, ProgramError};
use crate::size::{self, SizeError};
use crate::tidy;
use crate::workspace::Workspace;

/// Tests in documentation comments; what a test prints is wanted for the word of those that skip.
const DOCUMENTED_TESTS: [&str; 6] = [
    "test",
    "--quiet",
    "--workspace",
    "--doc",
    "--",
    "--show-output",
];

/// What to do when the page on faults doesn't belong to the code.
const FAULTS_ADVICE: &str = "if the change is meant, run `cargo xtask faults --write --long`, \
     which takes a quarter of an hour, and commit the file";

/// What to do when a test in Python fails.
const INTEROP_ADVICE: &str =
    "the failing tests stand above; `cargo xtask interop` repeats them without the other steps";

/// One thing to do.
pub struct Step {
    /// What it does, as the heading.
    name: &'static str,
    /// What to do when it fails.
    advice: &'static str,
    /// Does it, adding what passed to the tally.
    run: fn(&Workspace, &mut Tally) -> Result<(), StepError>,
}

/// Why a step failed.
#[derive(Debug)]
enum StepError {
    /// A command failed.
    Command(CommandError),
    /// A part of the toolchain is missing and could not be added; what to type.
    Toolchain(&'static str, String),
    /// No test ran at all, which means the run says nothing.
    NoTests,
    /// House rules are broken; how many times.
    Untidy(usize),
    /// The accuracy document.
    Accuracy(AccuracyError),
    /// The page on faults.
    Faults(FaultsError),
    /// The bus side on the part.
    Size(SizeError),
    /// The images of the part.
    Image(ImageError),
    /// The released program.
    Program(ProgramError),
    /// The master written by others.
    Interop(InteropError),
    /// A file or folder could not be handled.
    File(PathBuf, io::Error),
    /// The demo left a report out, or left it empty.
    NoReport(&'static str),
}

impl fmt::Display for StepError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Command(error) => write!(out, "{error}"),
            Self::Toolchain(part, typed) => {
                write!(
                    out,
                    "{part} is missing and could not be added; type `{typed}`"
                )
            }
            Self::NoTests => write!(out, "not one test ran"),
            Self::Untidy(count) => write!(out, "{count} breaches of the house rules"),
            Self::Accuracy(error) => write!(out, "{error}"),
            Self::Faults(error) => write!(out, "{error}"),
            Self::Size(error) => write!(out, "{error}"),
            Self::Image(error) => write!(out, "{error}"),
            Self::Program(error) => write!(out, "{error}"),
            Self::Interop(error) => write!(out, "{error}"),
            Self::File(path, error) => write!(out, "{}: {error}", path.display()),
            Self::NoReport(name) => write!(out, "the demo wrote no {name}"),
        }
    }
}

impl From<CommandError> for StepError {
    fn from(error: CommandError) -> Self {
        Self::Command(error)
    }
}

impl From<AccuracyError> for StepError {
    fn from(error: AccuracyError) -> Self {
        Self::Accuracy(error)
    }
}

impl From<FaultsError> for StepError {
    fn from(error: FaultsError) -> Self {
        Self::Faults(error)
    }
}

impl From<InteropError> for StepError {
    fn from(error: InteropError) -> Self {
        Self::Interop(error)
    }
}

impl From<ImageError> for StepError {
    fn from(error: ImageError) -> Self {
        Self::Image(error)
    }
}

impl From<ProgramError> for StepError {
    fn from(error: ProgramError) -> Self {
        Self::Program(error)
    }
}

impl From<SizeError> for StepError {
    fn from(error: SizeError) -> Self {
        Self::Size(error)
    }
}

const TEST: [Step; 14] = [
    Step {
        name: "toolchain: rustfmt, clippy, the chip's target and the emulator's packages",
        advice: "then start again",
        run: toolchain,
    },
    Step {
        name: "formatting",
        advice: "run `cargo xtask fmt`",
        run: check_format,
    },
    Step {
        name: "clippy, warnings denied",
        advice: "mend what it names above; nothing is allowed away without a reason beside it",
        run: clippy,
    },
    Step {
        name: "tilt, canopen, flash and device without std, for the chip",
        advice: "they run on the part: use core only",
        run: no_std,
    },
    Step {
        name: "tests: unit, property, golden vectors, documentation, tidy",
        advice: "the failing tests stand above; `cargo test -p CRATE NAME` repeats one",
        run: tests,
    },
    INTEROP,
    Step {
        name: "the world tries to break the instrument",
        advice: "the failing seed stands above; `cargo sim seed N --trace` shows it frame by frame",
        run: try_to_break,
    },
    Step {
        name: "documentation, warnings denied",
        advice: "mend the doc comment it names above",
        run: documentation,
    },
    ACCURACY,
    FAULTS,
    SIZE,
    IMAGE,
    Step {
        name: "demo of one day",
        advice: "repeat it with `cargo demo --days 1`",
        run: demo,
    },
    PROGRAM,
];

/// The house rules alone.
pub const TIDY: Step = Step {
    name: "house rules",
    advice: "each is listed above with its file and line",
    run: check_tidy,
};

/// The virtual instrument against an independent master.
pub const INTEROP: Step = Step {
    name: "plumb serve against python-canopen",
    advice: INTEROP_ADVICE,
    run: check_interop,
};

/// Formats every crate.
pub const FORMAT: Step = Step {
    name: "format",
    advice: "the file it names doesn't parse",
    run: format_all,
};

/// Compares the accuracy document.
pub const ACCURACY: Step = Step {
    name: "accuracy of few units against docs/accuracy-of-few-units.md",
    advice: "if the change is meant, run `cargo xtask accuracy --write`, which takes a quarter of \
             an hour, and commit both files",
    run: compare_accuracy,
};

/// Writes the accuracy document anew.
pub const ACCURACY_WRITE: Step = Step {
    name: "writing docs/accuracy.md and the page of few units, which takes a quarter of an hour",
    advice: "the generators are the examples `accuracy` of `sim` and `coverage` of `plumb`",
    run: write_accuracy,
};

/// Compares the page on faults.
pub const FAULTS: Step = Step {
    name: "faults: what is told of them, against docs/faults.md",
    advice: FAULTS_ADVICE,
    run: compare_faults,
};

/// Writes the last section of the page on faults anew.
pub const FAULTS_WRITE: Step = Step {
    name: "writing the last section of docs/faults.md",
    advice: "the generator is `cargo run --release -p sim --example faults`",
    run: write_faults,
};

/// Writes the whole page on faults anew.
pub const FAULTS_WRITE_LONG: Step = Step {
    name: "writing docs/faults.md, which takes a quarter of an hour",
    advice: "the generator is `cargo run --release -p sim --example faults -- --long`",
    run: write_all_faults,
};

/// Builds what is flashed.
pub const IMAGE: Step = Step {
    name: "images of bootloader and application, within their budgets",
    advice: "what the linker says stands above; a slot's size is in `flash::layout`",
    run: build_images,
};

/// Measures the released program.
pub const PROGRAM: Step = Step {
    name: "the released program: its length and how soon it answers",
    advice: "`cargo xtask program` repeats it; a dependency of `cli` may have grown",
    run: check_program,
};

/// Measures the bus side on the part.
pub const SIZE: Step = Step {
    name: "size of the bus side on the part, and no panic in it",
    advice: "`cargo xtask size --verbose` lists functions, constants and stack frames",
    run: check_size,
};

/// Measures the bus side, and lists where the bytes are.
pub const SIZE_VERBOSE: Step = Step {
    name: "size of the bus side on the part, in detail",
    advice: "the lists stand above",
    run: list_size,
};

/// Counts what the emulated chip executes, function by function.
pub const SIZE_INSTRUCTIONS: Step = Step {
    name: "instructions of a sample and of a SYNC on the emulated chip",
    advice: "what the emulator says stands above",
    run: list_instructions,
};

/// Writes the document of sizes anew.
pub const SIZE_WRITE: Step = Step {
    name: "writing docs/size.md",
    advice: "`cargo xtask size` tells the figures without writing them",
    run: write_size,
};

/// The property tests, for hours rather than seconds.
pub const FUZZ_LONG: Step = Step {
    name: "property tests, 100 000 cases each",
    advice: "the smallest failing case stands above; make it a test of its own",
    run: fuzz_long,
};

/// Runs everything, in order, up to the first failure.
pub fn test(workspace: &Workspace) -> ExitCode {
    let mut tally = Tally::default();
    for (at, step) in TEST.iter().enumerate() {
        println!("[{}/{}] {}", at + 1, TEST.len(), step.name);
        if !perform(step, workspace, &mut tally) {
            println!("{} passed, {} failed", tally.passed, tally.failed.max(1));
            return ExitCode::FAILURE;
        }
    }
    println!("{} passed, 0 failed", tally.passed);
    ExitCode::SUCCESS
}

/// Runs one step by itself.
pub fn alone(step: &Step, workspace: &Workspace) -> ExitCode {
    println!("{}", step.name);
    if perform(step, workspace, &mut Tally::default()) {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

fn perform(step: &Step, workspace: &Workspace, total: &mut Tally) -> bool {
    let start = Instant::now();
    let mut tally = Tally::default();
    let outcome = (step.run)(workspace, &mut tally);
    *total = total.plus(tally);
    match outcome {
        Ok(()) => {
            *total = total.plus(Tally::ONE);
            println!(
                "      ok, {:.1} s{}",
                start.elapsed().as_secs_f64(),
                words(tally)
            );
            true
        }
        Err(error) => {
            eprintln!("failed: {}: {error}\n        {}", step.name, step.advice);
            false
        }
    }
}

/// What the step's own tests came to, for the line that ends it.
fn words(tally: Tally) -> String {
    match (tally.passed, tally.skipped) {
        (0, _) => String::new(),
        (passed, 0) => format!(", {passed} tests"),
        (passed, skipped) => format!(", {passed} tests, {skipped} with something skipped"),
    }
}

fn toolchain(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
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

fn check_format(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(command::pass(
        workspace.cargo(&["fmt", "--all", "--check"]),
    )?)
}

fn format_all(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(command::pass(workspace.cargo(&["fmt", "--all"]))?)
}

fn clippy(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    let words = [
        "clippy",
        "--quiet",
        "--workspace",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ];
    Ok(command::pass(workspace.cargo(&words))?)
}

fn no_std(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    let words = [
        "build",
        "--quiet",
        "-p",
        "instant",
        "-p",
        "tilt",
        "-p",
        "canopen",
        "-p",
        "device",
        "-p",
        "flash",
        "--target",
        chip::TARGET,
        "--release",
    ];
    Ok(command::pass(workspace.cargo(&words))?)
}

fn tests(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    all_tests(workspace, &[], tally)
}

fn fuzz_long(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    all_tests(workspace, &[("PROPTEST_CASES", "100000")], tally)
}

/// Every test of every crate, and then those in documentation comments.
fn all_tests(
    workspace: &Workspace,
    variables: &[(&str, &str)],
    tally: &mut Tally,
) -> Result<(), StepError> {
    harness::run(workspace, variables, tally)?;
    if tally.passed == 0 {
        return Err(StepError::NoTests);
    }
    command::tests(workspace.cargo(&DOCUMENTED_TESTS), tally)?;
    Ok(())
}

fn documentation(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    let mut cargo = workspace.cargo(&["doc", "--quiet", "--workspace", "--no-deps"]);
    cargo.env("RUSTDOCFLAGS", "-D warnings");
    Ok(command::pass(cargo)?)
}

fn compare_accuracy(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(accuracy::compare(workspace)?)
}

fn write_accuracy(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(accuracy::write(workspace)?)
}

fn compare_faults(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(faults::compare(workspace)?)
}

fn write_faults(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(faults::write_short(workspace)?)
}

fn write_all_faults(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(faults::write_long(workspace)?)
}

fn try_to_break(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(campaign::run(workspace)?)
}

fn build_images(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(image::build(workspace)?)
}

fn check_program(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(program::check(workspace)?)
}

fn check_size(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(size::check(workspace)?)
}

fn list_size(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(size::verbose(workspace)?)
}

fn list_instructions(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(size::instructions(workspace)?)
}

fn write_size(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(size::write(workspace)?)
}

fn check_interop(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    Ok(interop::run(workspace, tally)?)
}

fn check_tidy(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    let root = workspace.root();
    let findings = tidy::check(root).map_err(|error| StepError::File(root.to_path_buf(), error))?;
    for finding in &findings {
        println!("{finding}");
    }
    if findings.is_empty() {
        Ok(())
    } else {
        Err(StepError::Untidy(findings.len()))
    }
}

/// Runs the main job for one day into a temporary folder, which is removed afterwards.
fn demo(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    let folder = Temporary(env::temp_dir().join(format!("plumb-smoke-{}", process::id())));
    let mut cargo = workspace.cargo(&["--quiet", "demo", "--days", "1", "--out"]);
    cargo.arg(&folder.0);
    command::capture(cargo)?;
    for name in ["report.json", "report.html"] {
        let length = fs::metadata(folder.0.join(name)).map_or(0, |about| about.len());
        if length == 0 {
            return Err(StepError::NoReport(name));
        }
    }
    Ok(())
}

/// A folder that goes when this does.
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        // It may never have been made, and a folder left behind is no reason to fail.
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fails(_: &Workspace, _: &mut Tally) -> Result<(), StepError> {
        Err(StepError::NoTests)
    }

    fn counts_two(_: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
        *tally = Tally {
            passed: 2,
            failed: 0,
            skipped: 1,
        };
        Ok(())
    }

    #[test]
    fn a_step_counts_itself_and_its_tests() {
        let mut total = Tally::default();
        let step = Step {
            name: "two tests",
            advice: "none",
            run: counts_two,
        };
        assert!(perform(&step, &Workspace::locate(), &mut total));
        assert_eq!(
            total,
            Tally {
                passed: 3,
                failed: 0,
                skipped: 1
            }
        );
    }

    #[test]
    fn a_failed_step_counts_nothing() {
        let mut total = Tally::default();
        let step = Step {
            name: "nothing",
            advice: "none",
            run: fails,
        };
        assert!(!perform(&step, &Workspace::locate(), &mut total));
        assert_eq!(total, Tally::default());
    }

    #[test]
    fn a_missing_part_that_cannot_be_added_says_what_to_type() {
        let error = provide("a part", Command::new("plumb-no-such-program"), || false);
        let sentence = error.expect_err("it is never present").to_string();
        assert!(
            sentence.ends_with("type `plumb-no-such-program`"),
            "{sentence}"
        );
    }
}
