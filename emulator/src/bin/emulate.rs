//! `cargo emulate`: the exact images, the product's or the paper's, run on emulated boards.
//!
//! In: a verb and its arguments; images, unless they are to be built. Out: `serve` puts two
//! emulated nodes on a bus that other programs can join, exactly as `plumb serve` does with
//! virtual ones. Errors are one sentence on stderr and exit status 2.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Command, CommandFactory, FromArgMatches, Parser, Subcommand};
use emulator::build::{BuildError, Paper, Product};
use emulator::pair::{Outfit, deliver};
use sim::bench::{Mode, World};
use sim::network::Network;
use sim::network::instrument::{Delivered, UNCONFIGURED};
use virtual_bus as serve;

/// Runs the exact images of bootloader and application on emulated boards.
#[derive(Debug, Parser)]
#[command(name = "emulate", version, arg_required_else_help = true)]
struct CommandLine {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Put two emulated nodes on a CAN bus that other programs can join
    Serve(Serve),
}

#[derive(Debug, Args)]
struct Serve {
    #[command(flatten)]
    bus: serve::Arguments,
    /// Run what `cargo xtask image` has left in this folder, instead of building it anew
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
}

fn main() -> ExitCode {
    let line = CommandLine::from_arg_matches(&command().get_matches());
    let Verb::Serve(serve) = line.unwrap_or_else(|error| error.exit()).verb;
    match run(&serve) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("emulate: {error}");
            ExitCode::from(2)
        }
    }
}

/// The command line, whose help leaves out what [`refuse`] refuses whatever its value.
fn command() -> Command {
    let hide = |serve: Command, name| serve.mut_arg(name, |option| option.hide(true));
    CommandLine::command().mut_subcommand("serve", |serve| {
        ["instruments", "state"].into_iter().fold(serve, hide)
    })
}

/// Builds the images, puts them on two boards, and serves them.
fn run(serve: &Serve) -> Result<ExitCode, Box<dyn Error>> {
    let arguments = &serve.bus;
    refuse(arguments)?;
    let named = arguments.node_ids()?;
    let mode = Mode::from(arguments.mode);
    let pieces = pieces(mode, serve.images.as_deref())?;
    let outfit = match mode {
        Mode::Paper => Outfit::paper(&pieces),
        Mode::Product | Mode::Dynamic | Mode::OneAxis => Outfit::from(&pieces),
    };
    let bit_rate = u32::from(arguments.bit_rate) * 1000;
    let mut network = Network::new(bit_rate, arguments.seed);
    let (world, seed) = (&World::NOMINAL, arguments.seed);
    let delivered = if arguments.uncalibrated {
        Delivered::bare(mode, world, seed, 0)
    } else {
        Delivered::calibrated(mode, world, seed, 0)?
    };
    let ids = [0, 1].map(|number| named[number].unwrap_or(UNCONFIGURED));
    let fitting = (ids, arguments.bit_rate);
    deliver(&mut network, &delivered, fitting, seed, outfit)?;
    Ok(serve::run_network(arguments, network, &named)?)
}

/// What is flashed into an instrument of this mode: built anew, or found in a folder.
fn pieces(mode: Mode, found: Option<&Path>) -> Result<Vec<(u32, Vec<u8>)>, BuildError> {
    Ok(match mode {
        Mode::Paper => found.map_or_else(Paper::build, Paper::read)?.pieces(),
        Mode::Product | Mode::OneAxis => found.map_or_else(Product::build, Product::read)?.pieces(),
        Mode::Dynamic => {
            let found = found.map_or_else(Product::dynamic, Product::read_dynamic);
            found?.pieces()
        }
    })
}

/// What the image decides by itself cannot be asked for.
fn refuse(arguments: &serve::Arguments) -> Result<(), &'static str> {
    match arguments {
        serve::Arguments {
            instruments: 2.., ..
        } => Err("one instrument is emulated, not several"),
        serve::Arguments { state: Some(_), .. } => {
            Err("emulated nodes keep what they store in their flash, which is not kept in files")
        }
        arguments if Mode::from(arguments.mode) == Mode::OneAxis => {
            Err("no image is for one axis; use `plumb serve`")
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_does_not_offer_what_is_refused() {
        let mut command = command();
        let serve = command.find_subcommand_mut("serve").unwrap();
        let help = serve.render_long_help().to_string();
        assert!(
            help.contains("--images") && help.contains("--mode"),
            "{help}"
        );
        assert!(
            !help.contains("--instruments") && !help.contains("--state"),
            "{help}"
        );
        assert!(
            command
                .try_get_matches_from(["emulate", "serve", "--instruments", "2"])
                .is_ok()
        );
    }
}
