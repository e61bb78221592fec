//! `plumb`: the person's side of the instrument.
//!
//! One verb per file or folder. `commission/` finds nodes, reads and writes objects, zeroes, saves,
//! gives node-ids; `update/` brings a new program, which `image` makes; `describe` prints data
//! sheets; `twin` moves and breaks the virtual instrument. The other verbs are crates of their own:
//! `monitor`, `calibrate`, `bus-report`, `virtual-bus` and `bench`. `bus-master` talks on a bus,
//! `codes` names what is on it, `listen` decodes frames, by data sheets where there are some,
//! `bus-logs` reads and writes logs, `output` draws and prints.
//! Errors are one sentence on stderr and exit status 2; exit status 1 means that the
//! work was done and the answer is no (docs/command-line.md).

mod commission;
mod describe;
mod image;
mod replay;
mod shell;
mod twin;
mod update;

use std::io::Write as _;
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};

use bench::demo;
use bus_report::{blackbox, period};
use calibrate::{characterise, verify};
use output::progress::Progress;

/// Plumb, an open redundant inclinometer: commission it, calibrate it, monitor it, and try it out
/// on a virtual bus.
///
/// Exit status: 0 when all is well, 1 when the work was done and the answer is no (the instrument
/// is outside its specification, or does not match), 2 when the command could not be carried out.
#[derive(Debug, Parser)]
#[command(name = "plumb", version, arg_required_else_help = true)]
struct CommandLine {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// List the nodes on the bus
    Scan(commission::scan::Arguments),
    /// Show the identity, set-up and state of nodes
    Info(commission::info::Arguments),
    /// Read objects of the nodes by name or address
    Get(commission::get::Arguments),
    /// Write an object of a node, with its unit, and read it back
    Set(commission::set::Arguments),
    /// Set the slopes to zero at the present position of the machine
    Zero(commission::zero::Arguments),
    /// Save what was written to the nodes, so that it is preserved through a loss of supply
    Save(commission::save::Arguments),
    /// Discard what nodes have saved and return to the values as delivered
    Restore(commission::restore::Arguments),
    /// Give one node its node-id, or both channels of an instrument theirs
    NodeId(commission::node_id::Arguments),
    /// Read the bit rate of the nodes, or change it on all of them at once
    Bitrate(commission::bitrate::Arguments),
    /// Show the state of a bus: angles, difference, verdict, faults, load; record it
    Monitor(monitor::Arguments),
    /// List the fault logs of nodes, and save the samples around the faults
    Faults(blackbox::Arguments),
    /// Calibrate both channels over the bus, by a motor or by hand, with a report
    Calibrate(Box<calibrate::Arguments>),
    /// Take both channels through temperatures in a chamber, for their temperature model
    Characterise(Box<characterise::Arguments>),
    /// Compare a calibration report with its nodes
    Verify(verify::Arguments),
    /// Transfer a new program to the nodes on a bus, one after the other
    Update(update::Arguments),
    /// Build and sign the file of a new program
    Image(image::Arguments),
    /// Sum up logs of a bus or play them, or run recordings of sensors through the signal chain
    Replay(replay::Arguments),
    /// Report a period of an instrument on one page, from logs of the bus
    Report(period::Arguments),
    /// Put virtual instruments on a CAN bus that other programs can join
    Serve(virtual_bus::Arguments),
    /// Move and break the virtual instrument of a running `plumb serve`
    Twin(twin::Arguments),
    /// Build, characterise, calibrate and test virtual instruments, and dig for a week
    Demo(demo::Arguments),
    /// Print the descriptions of the nodes for other tools: EDS, DCF, DBC, the list of objects
    Describe(describe::Arguments),
    /// Print a script that lets a shell complete verbs and options
    Completions(shell::Completions),
    /// Print the manual page of the program or of a verb, or write all of them
    Man(shell::ManualPages),
}

/// What the program does; its exit status.
pub fn run() -> ExitCode {
    let line = CommandLine::parse();
    match carry_out(&line.verb, &Progress::on_stderr()) {
        Ok(code) => code,
        Err(sentence) => {
            // Of a terminal that was closed nobody reads it: no reason to end otherwise.
            let _ = writeln!(std::io::stderr(), "plumb: {sentence}");
            ExitCode::from(2)
        }
    }
}

/// Carries a verb out; an error is a sentence.
fn carry_out(verb: &Verb, progress: &Progress) -> Result<ExitCode, String> {
    match verb {
        Verb::Scan(arguments) => commission::scan::run(arguments).map_err(said),
        Verb::Info(arguments) => commission::info::run(arguments).map_err(said),
        Verb::Get(arguments) => commission::get::run(arguments).map_err(said),
        Verb::Set(arguments) => commission::set::run(arguments).map_err(said),
        Verb::Zero(arguments) => commission::zero::run(arguments).map_err(said),
        Verb::Save(arguments) => commission::save::run(arguments).map_err(said),
        Verb::Restore(arguments) => commission::restore::run(arguments).map_err(said),
        Verb::NodeId(arguments) => commission::node_id::run(arguments).map_err(said),
        Verb::Bitrate(arguments) => commission::bitrate::run(arguments).map_err(said),
        Verb::Monitor(arguments) => monitor::run(arguments).map_err(said),
        Verb::Faults(arguments) => blackbox::run(arguments).map_err(said),
        Verb::Calibrate(arguments) => calibrate::run(arguments).map_err(said),
        Verb::Characterise(arguments) => characterise::run(arguments, progress).map_err(said),
        Verb::Verify(arguments) => verify::run(arguments).map_err(said),
        Verb::Update(arguments) => update::run(arguments, progress).map_err(said),
        Verb::Image(arguments) => image::run(arguments).map_err(said),
        Verb::Replay(arguments) => replay::run(arguments, progress).map_err(said),
        Verb::Report(arguments) => period::run(arguments, progress).map_err(said),
        Verb::Serve(arguments) => virtual_bus::run(arguments, progress).map_err(said),
        Verb::Twin(arguments) => twin::run(arguments).map_err(said),
        Verb::Demo(arguments) => demo::run(arguments, progress).map_err(said),
        Verb::Describe(arguments) => describe::run(arguments).map_err(said),
        Verb::Completions(shell) => shell::completions(shell, CommandLine::command()).map_err(said),
        Verb::Man(pages) => shell::manual(pages, CommandLine::command()).map_err(said),
    }
}

fn said(error: impl std::fmt::Display) -> String {
    error.to_string()
}
