//! `cargo xtask size`: what the bus side takes on the part, and the proof that it cannot panic.
//!
//! In: the binaries of `firmware/bus_footprint`, linked for the part. Out: code, tables, state,
//! stack frames beside their budgets, `docs/size.md`, and a failure when a budget is exceeded, a
//! panic can be reached, or the document tells other figures. With `--verbose`, where the bytes of
//! these and of the firmware's programs are.
//!
//! The proof is the linker's: its script refuses a binary that holds the panic handler. That the
//! refusal works is shown each time by a binary that does panic and must not link.
//!
//! The document is out of date when a figure is off by more than [`TOLERANCE_PERCENT`], and is only
//! compared for the compiler that it was written with.
//!
//! Left out: budgets of the firmware's programs (`image`), and instructions on the part, which the
//! emulator counts: [`instructions`] runs it.

mod frames;
pub mod image;
mod report;
mod thumb;
mod uploads;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{fs, io};

use crate::chip;
use crate::command::{self, CommandError};
use crate::image::sets;
use crate::workspace::Workspace;
use flash::layout::Slot;
use image::Image;
use report::Figures;

/// The generated document, from the root.
const DOCUMENT: &str = "docs/size.md";
/// Where the binaries are linked, from the root.
const SCRIPT: &str = "firmware/bus_footprint/footprint.ld";
/// How far a figure of the document may be off.
const TOLERANCE_PERCENT: u64 = 2;

/// The stack with the dictionary, over a device of which nothing is there.
const STACK: &str = "footprint-stack";
/// The same with everything behind the rows.
const INSTRUMENT: &str = "footprint-instrument";
/// What must not link.
const CANARY: &str = "footprint-canary";

/// Why the bus side was not measured, or is not as it has to be.
#[derive(Debug, thiserror::Error)]
pub enum SizeError {
    /// A command failed.
    #[error("{0}")]
    Command(#[from] CommandError),
    /// A file could not be read or written.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// The linked file is not what it should be.
    #[error("{path}: {1}", path = .0.display())]
    Elf(PathBuf, object::Error),
    /// Panics can be reached; who calls them.
    #[error("panics can be reached:\n  {}", .0.join("\n  "))]
    Panics(Vec<String>),
    /// The binary that panics has linked, or its panic was not found: the proof proves nothing.
    #[error("{CANARY} panics, yet that was not found: mend {SCRIPT} or image.rs")]
    Canary,
    /// Budgets are exceeded.
    #[error("{}", .0.join("; "))]
    Over(Vec<String>),
    /// The committed document tells other figures; what it should be.
    #[error(
        "{DOCUMENT} is off by more than {TOLERANCE_PERCENT} %, run `cargo xtask size --write` \
         (- file, + code):\n{}",
        .0.trim_end()
    )]
    Stale(String),
}

/// Measures, prints, and fails on a panic, a budget that is exceeded or an old document.
pub fn check(workspace: &Workspace) -> Result<(), SizeError> {
    let figures = measure(workspace)?;
    print!("{}", indented(&figures.table()));
    uploads::print(workspace)?;
    figures.within_budgets().map_err(SizeError::Over)?;
    compare(&workspace.root().join(DOCUMENT), &figures)
}

/// Measures and prints, with crates, the largest functions, constants, statics and frames and the
/// deepest call; the same of the programs that are flashed.
pub fn listed(workspace: &Workspace) -> Result<(), SizeError> {
    list(workspace)?;
    println!("`cargo xtask size --instructions` lists what a sample and a SYNC execute");
    check(workspace)
}

fn list(workspace: &Workspace) -> Result<(), SizeError> {
    let _alone = chip::alone(workspace)?;
    for binary in [STACK, INSTRUMENT] {
        let image = linked(workspace, binary)?;
        println!("\n{binary}\n{}", report::details(&image));
    }
    for set in sets() {
        chip::firmware(workspace, &set.programs(), Slot::A)?;
        for program in set.programs() {
            let image = read(workspace, program)?;
            println!("\n{program}\n{}", report::details(&image));
        }
    }
    Ok(())
}

/// Prints the instructions of a sample and of a SYNC on the emulated chip. The emulator runs as a
/// program of its own: nothing may depend on it.
pub fn instructions(workspace: &Workspace) -> Result<(), SizeError> {
    println!("the images and the emulator are built, then run: some minutes");
    let words = ["run", "--quiet", "--package", "emulator", "--example"];
    let mut cargo = workspace.cargo(&words);
    cargo.arg("profile");
    Ok(command::pass(cargo)?)
}

/// Writes the document anew, by way of a temporary file so that it is never half written.
pub fn write(workspace: &Workspace) -> Result<(), SizeError> {
    let figures = measure(workspace)?;
    let path = workspace.root().join(DOCUMENT);
    let temporary = path.with_extension("md.new");
    fs::write(&temporary, figures.document())
        .and_then(|()| fs::rename(&temporary, &path))
        .map_err(|error| SizeError::File(path, error))
}

fn compare(path: &Path, figures: &Figures) -> Result<(), SizeError> {
    let committed =
        fs::read_to_string(path).map_err(|error| SizeError::File(path.to_path_buf(), error))?;
    report::compare(&committed, &figures.document()).map_err(SizeError::Stale)
}

fn measure(workspace: &Workspace) -> Result<Figures, SizeError> {
    let _alone = chip::alone(workspace)?;
    canary(workspace)?;
    let version = command::capture(workspace.rustc(&["--version"]))?;
    let stack = linked(workspace, STACK)?;
    let instrument = linked(workspace, INSTRUMENT)?;
    Ok(Figures::new(&version, &stack, &instrument))
}

/// The binary that panics must be refused, and must tell why when it is let through.
fn canary(workspace: &Workspace) -> Result<(), SizeError> {
    if command::succeeds(link(workspace, CANARY, false)?) {
        return Err(SizeError::Canary);
    }
    command::pass(link(workspace, CANARY, true)?)?;
    if read(workspace, CANARY)?.panics().is_empty() {
        return Err(SizeError::Canary);
    }
    Ok(())
}

/// Links and reads a binary that must not panic.
fn linked(workspace: &Workspace, binary: &str) -> Result<Image, SizeError> {
    if let Err(refused) = command::pass(link(workspace, binary, false)?) {
        // The linker reports that there is a panic; who calls it stands in the binary.
        command::pass(link(workspace, binary, true)?).map_err(|_| refused)?;
        return Err(SizeError::Panics(read(workspace, binary)?.panics()));
    }
    let image = read(workspace, binary)?;
    match image.panics() {
        none if none.is_empty() => Ok(image),
        calls => Err(SizeError::Panics(calls)),
    }
}

fn link(workspace: &Workspace, binary: &str, show_panics: bool) -> Result<Command, CommandError> {
    let mut cargo = chip::cargo(workspace, "rustc", &["bus-footprint"])?;
    cargo.args(["--bin", binary, "--"]);
    let script = workspace.root().join(SCRIPT);
    cargo.arg(format!("-Clink-arg=-T{}", script.display()));
    if show_panics {
        cargo.arg("-Clink-arg=--defsym=panics_shown=1");
    }
    Ok(cargo)
}

fn read(workspace: &Workspace, binary: &str) -> Result<Image, SizeError> {
    let path = chip::folder(workspace).join(binary);
    let bytes = fs::read(&path).map_err(|error| SizeError::File(path.clone(), error))?;
    Image::read(&bytes).map_err(|error| SizeError::Elf(path, error))
}

fn indented(text: &str) -> String {
    text.lines().map(|line| format!("      {line}\n")).collect()
}
