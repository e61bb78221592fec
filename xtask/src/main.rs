//! The project's own commands: what cargo alone cannot do.
//!
//! `cargo xtask test` is the one test command; the others are its parts and conveniences. In: a
//! sub-command. Out: exit status 0 when all is well, 1 when something failed, 2 when the
//! sub-command is not known. Nothing here is shipped and nothing depends on it.

mod accuracy;
mod built;
mod campaign;
mod chip;
mod command;
mod cost;
mod difference;
mod environment;
mod failure;
mod faults;
mod harness;
mod image;
mod interop;
mod packages;
mod plan;
mod program;
mod pytest;
mod python;
mod side_by_side;
mod size;
mod steps;
mod tidy;
mod toolchain;
mod workspace;

use std::process::ExitCode;

use workspace::Workspace;

const HELP: &str = "\
usage: cargo xtask COMMAND

  test                everything CI runs, stopping at the first failure; what has cost most stands
                      at the end
  test --quick        formatting, house rules, clippy, the unit tests of tilt, canopen, flash and
                      device, and a few seeds; leaves out all other tests, tables, documentation,
                      images, sizes, python-canopen and the demo
  count               lines of code by crate, and how long functions are
  tidy                the house rules alone: imports, sizes, words, documents
  fmt                 format every crate
  accuracy            repeat the accuracy tables of a few units and compare them
  accuracy --full     write those anew and, of all units, docs/accuracy.md, which names the commit
                      that printed it; a quarter of an hour
  faults              repeat the last section of docs/faults.md and compare it
  faults --write      write that section anew; with --long the whole page, a quarter of an hour
  size                code, RAM and stack of each image by crate and by symbol, and the bus side's
                      beside their budgets
  size --instructions instructions of a sample and of a SYNC, function by function
  size --write        the same, written to docs/size.md
  image               bootloaders and applications of product and paper, to target/images
  program             length of the released plumb, and how soon it answers
  interop             plumb serve against python-canopen, in an environment made for it
  python              tests of the Python package, in an environment made for them
  fleet               speed, memory and findings of the fleet, written to docs/fleet.md; half an
                      hour and 12 GB of disk
  fleet-spark         the fleet as a Spark job; needs Java
  wheel               its wheel, built by maturin and installed; a build of its own
  fuzz-long           the property tests with 100 000 cases each
  help                this text";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let workspace = Workspace::locate();
    match words.as_slice() {
        ["test"] => plan::test(&workspace),
        ["test", "--quick"] => plan::quick(&workspace),
        [side_by_side::WORD, key] => plan::one_step(key, &workspace),
        ["count"] => count(&workspace),
        ["tidy"] => plan::alone(&steps::TIDY, &workspace),
        ["fmt"] => plan::alone(&steps::FORMAT, &workspace),
        ["accuracy"] => plan::equipped(&steps::ACCURACY, &workspace),
        ["accuracy", "--full"] => plan::equipped(&steps::ACCURACY_FULL, &workspace),
        ["faults"] => plan::equipped(&steps::FAULTS, &workspace),
        ["faults", "--write"] => plan::equipped(&steps::FAULTS_WRITE, &workspace),
        ["faults", "--write", "--long"] => plan::equipped(&steps::FAULTS_WRITE_LONG, &workspace),
        ["size"] => plan::equipped(&steps::SIZE_LISTED, &workspace),
        ["size", "--instructions"] => plan::equipped(&steps::SIZE_INSTRUCTIONS, &workspace),
        ["size", "--write"] => plan::equipped(&steps::SIZE_WRITE, &workspace),
        ["image"] => plan::equipped(&steps::IMAGE, &workspace),
        ["program"] => plan::alone(&steps::PROGRAM_RELEASED, &workspace),
        ["interop"] => plan::equipped(&steps::INTEROP, &workspace),
        ["python"] => plan::alone(&steps::PYTHON, &workspace),
        ["fleet"] => plan::alone(&steps::FLEET, &workspace),
        ["fleet-spark"] => plan::alone(&steps::FLEET_SPARK, &workspace),
        ["wheel"] => plan::alone(&steps::WHEEL, &workspace),
        ["fuzz-long"] => plan::equipped(&steps::FUZZ_LONG, &workspace),
        ["help" | "--help" | "-h"] => {
            println!("{HELP}");
            ExitCode::SUCCESS
        }
        _ => {
            eprintln!("no such command: {:?}\n\n{HELP}", words.join(" "));
            ExitCode::from(2)
        }
    }
}

/// Prints the lines of code by crate.
fn count(workspace: &Workspace) -> ExitCode {
    match tidy::count(workspace.root()) {
        Ok(table) => {
            print!("{table}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("the checkout cannot be read: {error}");
            ExitCode::FAILURE
        }
    }
}
