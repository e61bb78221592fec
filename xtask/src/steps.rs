//! The steps of the test command, each a function that can also be called alone.
//!
//! In: the workspace. Out: what a step has to print, and the count of what passed. All steps share
//! one target directory and the same compiler flags, and what runs on the host is built once, by
//! [`BUILD`], for all of them.
//!
//! Left out: which of them make up the test command, and in what order (`plan`).

use std::path::PathBuf;
use std::{env, fs, process};

use crate::accuracy;
use crate::built;
use crate::campaign;
use crate::chip;
use crate::command::{self, Tally};
use crate::failure::StepError;
use crate::faults;
use crate::harness::{self, Kind};
use crate::image;
use crate::interop;
use crate::program;
use crate::python;
use crate::size;
use crate::tidy;
use crate::toolchain;
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

/// What is documented: what cargo would take by itself, with an example for the features that
/// clippy has checked the dependencies with. Without one cargo checks them all a second time, which
/// is half of the step.
const DOCUMENTED: [&str; 17] = [
    "doc",
    "--quiet",
    "--workspace",
    "--no-deps",
    "--lib",
    "--bin",
    "emulate",
    "--bin",
    "footprint-canary",
    "--bin",
    "footprint-instrument",
    "--bin",
    "footprint-stack",
    "--bin",
    "xtask",
    "--example",
    "sdo_upload",
];

/// Crates that run on the part.
const PARTS_CRATES: [&str; 5] = ["instant", "tilt", "canopen", "flash", "device"];

/// What to do when the page on faults doesn't belong to the code.
const FAULTS_ADVICE: &str = "if the change is meant, run `cargo xtask faults --write --long`, \
     which takes a quarter of an hour, and commit the file";

/// What to do when a test in Python fails.
const INTEROP_ADVICE: &str =
    "the failing tests stand above; `cargo xtask interop` repeats them without the other steps";

/// What to do when a test of the Python package fails.
const PYTHON_ADVICE: &str =
    "the failing tests stand above; `cargo xtask python` repeats them without the other steps";

/// What to do when a test fails.
const TESTS_ADVICE: &str = "the failing tests stand above; `cargo test -p CRATE NAME` repeats one";

/// One thing to do.
pub struct Step {
    /// By which a process of its own is told to do it (`side_by_side`); no two have the same.
    pub key: &'static str,
    /// What it does, as the heading.
    pub name: &'static str,
    /// What to do when it fails.
    pub advice: &'static str,
    /// Does it, adding what passed to the tally.
    pub run: fn(&Workspace, &mut Tally) -> Result<(), StepError>,
}

/// What the other steps need.
pub const TOOLCHAIN: Step = Step {
    key: "toolchain",
    name: "toolchain: rustfmt, clippy, the chip's target and the emulator's packages",
    advice: "then start again",
    run: provide_toolchain,
};

/// Compares the form of every file.
pub const CHECK_FORMAT: Step = Step {
    key: "check-format",
    name: "formatting",
    advice: "run `cargo xtask fmt`",
    run: check_format,
};

/// The compiler's critic.
pub const CLIPPY: Step = Step {
    key: "clippy",
    name: "clippy, warnings denied",
    advice: "mend what it names above; an exception needs its reason in the same place",
    run: clippy,
};

/// Builds what all others use.
pub const BUILD: Step = Step {
    key: "build",
    name: "one build of tests, examples and tools",
    advice: "the messages of the compiler stand above",
    run: build,
};

/// Builds what tests on emulated boards run.
pub const EMULATED_IMAGES: Step = Step {
    key: "emulated-images",
    name: "images for emulated boards, once for all tests",
    advice: "the messages of the linker stand above; `cargo xtask image` builds the same",
    run: build_emulated_images,
};

/// The crates of the part, for the part.
pub const NO_STD: Step = Step {
    key: "no-std",
    name: "tilt, canopen, flash and device without std, for the chip",
    advice: "they run on the part: use core only",
    run: no_std,
};

/// Tests that wait for a bus in real time.
pub const WAITING_TESTS: Step = Step {
    key: "waiting-tests",
    name: "tests that wait for a bus in real time",
    advice: TESTS_ADVICE,
    run: waiting_tests,
};

/// All other tests.
pub const COMPUTING_TESTS: Step = Step {
    key: "computing-tests",
    name: "tests that compute: unit, property, golden vectors, emulation, tidy",
    advice: TESTS_ADVICE,
    run: computing_tests,
};

/// Tests in documentation comments.
pub const EXAMPLES_OF_COMMENTS: Step = Step {
    key: "documented-tests",
    name: "tests in documentation comments",
    advice: TESTS_ADVICE,
    run: documented_tests,
};

/// Unit tests of what runs on the part.
pub const QUICK_TESTS: Step = Step {
    key: "quick-tests",
    name: "unit tests of tilt, canopen, flash and device",
    advice: TESTS_ADVICE,
    run: quick_tests,
};

/// All seeds of the fixed set.
pub const SEEDS: Step = Step {
    key: "seeds",
    name: "trials of the instrument with drawn faults",
    advice: "the failing seed stands above; `cargo sim seed N --trace` shows it frame by frame",
    run: try_to_break,
};

/// A handful of them.
pub const FEW_SEEDS: Step = Step {
    key: "few-seeds",
    name: "trials of the instrument with drawn faults, a few",
    run: try_a_few_times,
    ..SEEDS
};

/// What rustdoc reports.
pub const DOCUMENTATION: Step = Step {
    key: "documentation",
    name: "documentation, warnings denied",
    advice: "mend the doc comment it names above",
    run: documentation,
};

/// The main job.
pub const DEMO: Step = Step {
    key: "demo",
    name: "demo of one day",
    advice: "repeat it with `cargo demo --days 1`",
    run: demo,
};

/// The house rules alone.
pub const TIDY: Step = Step {
    key: "tidy",
    name: "house rules",
    advice: "each is listed above with its file and line",
    run: check_tidy,
};

/// The virtual instrument against an independent master.
pub const INTEROP: Step = Step {
    key: "interop",
    name: "plumb serve against python-canopen",
    advice: INTEROP_ADVICE,
    run: check_interop,
};

/// The Python package.
pub const PYTHON: Step = Step {
    key: "python",
    name: "the Python package: chain, logs, twin, and the tour of docs/python.md",
    advice: PYTHON_ADVICE,
    run: check_python,
};

/// The fleet as a Spark job.
pub const FLEET_SPARK: Step = Step {
    key: "fleet-spark",
    name: "the fleet of the Python package as a Spark job",
    advice: "Spark needs Java 17 or newer; the failing tests stand above",
    run: check_spark,
};

/// What the fleet takes, measured.
pub const FLEET: Step = Step {
    key: "fleet",
    name: "the fleet measured: speed, memory, and what it finds",
    advice: "what stands above; logs and results are in target/fleet",
    run: measure_fleet,
};

/// The wheel of the Python package, which maturin builds by itself.
pub const WHEEL: Step = Step {
    key: "wheel",
    name: "the wheel of the Python package, built, installed and called",
    advice: "the messages of maturin or pip stand above",
    run: check_wheel,
};

/// Formats every crate.
pub const FORMAT: Step = Step {
    key: "format",
    name: "format",
    advice: "the file it names doesn't parse",
    run: format_all,
};

/// Compares the accuracy document.
pub const ACCURACY: Step = Step {
    key: "accuracy",
    name: "accuracy of few units against docs/accuracy-of-few-units.md",
    advice: "if the change is meant, run `cargo xtask accuracy --full`, which takes a quarter of \
             an hour, and commit both files",
    run: compare_accuracy,
};

/// Writes the accuracy document anew.
pub const ACCURACY_FULL: Step = Step {
    key: "accuracy-full",
    name: "writing docs/accuracy.md and the page of few units, which takes a quarter of an hour",
    advice: "the generators are the examples `accuracy` of `sim` and `coverage` of `calibrate`",
    run: write_accuracy,
};

/// Compares the page on faults.
pub const FAULTS: Step = Step {
    key: "faults",
    name: "detection of faults against docs/faults.md",
    advice: FAULTS_ADVICE,
    run: compare_faults,
};

/// Writes the last section of the page on faults anew.
pub const FAULTS_WRITE: Step = Step {
    key: "faults-write",
    name: "writing the last section of docs/faults.md",
    advice: "the generator is `cargo run --release -p sim --example faults`",
    run: write_faults,
};

/// Writes the whole page on faults anew.
pub const FAULTS_WRITE_LONG: Step = Step {
    key: "faults-write-long",
    name: "writing docs/faults.md, which takes a quarter of an hour",
    advice: "the generator is `cargo run --release -p sim --example faults -- --long`",
    run: write_all_faults,
};

/// Builds what is flashed.
pub const IMAGE: Step = Step {
    key: "image",
    name: "images of bootloader and application, within their budgets",
    advice: "the messages of the linker stand above; a slot's size is in `flash::layout`",
    run: build_images,
};

/// The same, and from another folder.
pub const IMAGE_OF_TWO_FOLDERS: Step = Step {
    key: "image-of-two-folders",
    name: "images within their budgets, the same bytes from two folders",
    advice: "the messages of the linker stand above; a path in an image is mapped in `chip`",
    run: build_images_twice,
};

/// Measures the released program.
pub const PROGRAM: Step = Step {
    key: "program",
    name: "the program: its length and how soon it answers",
    advice: "`cargo xtask program` measures the released one; a dependency of `cli` may have grown",
    run: check_program,
};

/// The same of the released program, whose build takes minutes.
pub const PROGRAM_RELEASED: Step = Step {
    key: "program-released",
    name: "the released program: its length and how soon it answers",
    advice: "a dependency of `cli` may have grown",
    run: check_released_program,
};

/// Measures the bus side on the part.
pub const SIZE: Step = Step {
    key: "size",
    name: "size of the bus side on the part, and no panic in it",
    advice: "`cargo xtask size` lists functions, constants and stack frames",
    run: check_size,
};

/// Measures the bus side, and lists where the bytes are.
pub const SIZE_LISTED: Step = Step {
    key: "size-listed",
    name: "size of the bus side on the part, in detail",
    advice: "the lists stand above",
    run: list_size,
};

/// Counts what the emulated chip executes, function by function.
pub const SIZE_INSTRUCTIONS: Step = Step {
    key: "size-instructions",
    name: "instructions of a sample and of a SYNC on the emulated chip",
    advice: "the messages of the emulator stand above",
    run: list_instructions,
};

/// Writes the document of sizes anew.
pub const SIZE_WRITE: Step = Step {
    key: "size-write",
    name: "writing docs/size.md",
    advice: "`cargo xtask size` prints the figures without writing them",
    run: write_size,
};

/// The property tests, for hours rather than seconds.
pub const FUZZ_LONG: Step = Step {
    key: "fuzz-long",
    name: "property tests, 100 000 cases each",
    advice: "the smallest failing case stands above; make it a test of its own",
    run: fuzz_long,
};

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
    Ok(command::pass(chip::cargo(
        workspace,
        "build",
        &PARTS_CRATES,
    )?)?)
}

fn provide_toolchain(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    toolchain::provide_all(workspace)
}

fn build(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    harness::build(workspace)?;
    // No test asks for it, since no crate links it.
    built::library(workspace, "_plumb")?;
    Ok(())
}

/// Calls the function that each test would call (`emulator::build`), before they run.
fn build_emulated_images(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    let program = built::example(workspace, "images")?;
    Ok(command::pass(
        workspace.program(&program.to_string_lossy(), &[]),
    )?)
}

fn waiting_tests(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    tests_of(workspace, &[Kind::Waits], &[], tally)
}

fn computing_tests(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    tests_of(workspace, &[Kind::Computes], &[], tally)
}

fn tests_of(
    workspace: &Workspace,
    kinds: &[Kind],
    variables: &[(&str, &str)],
    tally: &mut Tally,
) -> Result<(), StepError> {
    harness::run(workspace, kinds, variables, tally)?;
    if tally.passed == 0 {
        return Err(StepError::NoTests);
    }
    Ok(())
}

fn documented_tests(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    Ok(command::tests(workspace.cargo(&DOCUMENTED_TESTS), tally)?)
}

fn quick_tests(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    let packages = PARTS_CRATES.iter().flat_map(|name| ["-p", name]);
    let mut cargo = workspace.cargo(&["test", "--quiet", "--lib"]);
    cargo.args(packages).args(["--", "--show-output"]);
    Ok(command::tests(cargo, tally)?)
}

fn fuzz_long(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    let variables = [("PROPTEST_CASES", "100000")];
    tests_of(workspace, &[Kind::Waits, Kind::Computes], &variables, tally)?;
    documented_tests(workspace, tally)
}

fn documentation(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    let mut cargo = workspace.cargo(&DOCUMENTED);
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

fn try_a_few_times(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(campaign::run_few(workspace)?)
}

fn build_images(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(image::build(workspace)?)
}

fn build_images_twice(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(image::build_reproducibly(workspace)?)
}

fn check_program(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(program::check(workspace)?)
}

fn check_released_program(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(program::check_released(workspace)?)
}

fn check_size(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(size::check(workspace)?)
}

fn list_size(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(size::listed(workspace)?)
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

fn check_spark(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    Ok(python::spark(workspace, tally)?)
}

fn measure_fleet(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(python::fleet(workspace)?)
}

fn check_python(workspace: &Workspace, tally: &mut Tally) -> Result<(), StepError> {
    Ok(python::run(workspace, tally)?)
}

fn check_wheel(workspace: &Workspace, _: &mut Tally) -> Result<(), StepError> {
    Ok(python::wheel(workspace)?)
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
    let program = built::binary(workspace, "plumb")?;
    let words = ["demo", "--days", "1", "--out"];
    let mut demo = workspace.program(&program.to_string_lossy(), &words);
    demo.arg(&folder.0);
    command::capture(demo)?;
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
    use std::collections::BTreeSet;

    use serde_json::Value;

    use super::*;

    /// The names of a package's targets of a kind that cargo documents by itself.
    fn documented(package: &Value, kind: &str) -> BTreeSet<String> {
        let targets = package["targets"].as_array().into_iter().flatten();
        let wanted = targets.filter(|target| {
            let kinds = target["kind"].as_array().into_iter().flatten();
            let of_kind = kinds.filter_map(Value::as_str).any(|other| other == kind);
            of_kind && target["doc"] == Value::Bool(true)
        });
        let names = wanted.filter_map(|target| target["name"].as_str());
        names.map(str::to_owned).collect()
    }

    /// A program of its own name is in the documentation; one of its library's name is not.
    #[test]
    fn every_program_that_cargo_documents_by_itself_is_documented() {
        let words = [
            "metadata",
            "--no-deps",
            "--format-version",
            "1",
            "--offline",
        ];
        let said = command::capture(Workspace::locate().cargo(&words)).expect("the workspace");
        let said: Value = serde_json::from_str(&said).expect("JSON");
        let mut programs = BTreeSet::new();
        for package in said["packages"].as_array().expect("packages") {
            let libraries = documented(package, "lib");
            programs.extend(&documented(package, "bin") - &libraries);
        }
        let named = DOCUMENTED.windows(2).filter(|words| words[0] == "--bin");
        let named: BTreeSet<_> = named.map(|words| words[1].to_owned()).collect();
        assert_eq!(named, programs);
    }
}
