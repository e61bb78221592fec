//! `plumb`: the person's side of the instrument.
//!
//! One verb per folder: `demo` builds and tests virtual instruments, `replay` takes recordings of
//! real ones, `describe` tells other tools about the nodes, `serve` puts virtual ones on a bus,
//! `image` builds a new program's file and `update` brings it to the nodes.
//! Errors are one sentence on stderr and exit status 2; exit status 1 means that the
//! work was done and the instrument is outside its specification.

mod blackbox;
mod bus;
mod calibrate;
mod commission;
mod demo;
mod describe;
mod image;
mod log;
mod monitor;
mod period;
mod playback;
mod progress;
mod replay;
mod report;
pub mod serve;
mod shell;
mod stdout;
mod text_table;
mod update;
mod watch;

use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};

pub use crate::progress::Progress;

/// Plumb, an open redundant inclinometer: its virtual bench and the replay of recordings.
///
/// Exit status: 0 when all is well, 1 when the instrument is outside its specification, 2 when the
/// command could not be carried out.
#[derive(Debug, Parser)]
#[command(name = "plumb", version, arg_required_else_help = true)]
struct CommandLine {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Read the bit rate of the nodes, or change it on all of them at once
    Bitrate(commission::bitrate::Arguments),
    /// Build, characterise, calibrate and test virtual instruments, and dig for a week
    Demo(demo::Arguments),
    /// Print a script that lets a shell complete verbs and options
    Completions(shell::Completions),
    /// Print what other tools know the nodes by: EDS, DCF, DBC, the list of objects
    Describe(describe::Arguments),
    /// Read objects of the nodes by name or address
    Get(commission::get::Arguments),
    /// Build and sign the file of a new program
    Image(image::Arguments),
    /// Tell what nodes are, how they are set up and how they do
    Info(commission::info::Arguments),
    /// Give one node its node-id, or both channels of an instrument theirs
    NodeId(commission::node_id::Arguments),
    /// Run real recordings through the signal chain
    Replay(replay::Arguments),
    /// Forget what nodes have saved, back to the values as delivered
    Restore(commission::restore::Arguments),
    /// Let what was written to the nodes outlast a power cut
    Save(commission::save::Arguments),
    /// Find out who is on the bus
    Scan(commission::scan::Arguments),
    /// Write an object of a node, with its unit, and read it back
    Set(commission::set::Arguments),
    /// Print the manual page of the program or of a verb, or write all of them
    Man(shell::ManualPages),
    /// Show what happens on a bus: angles, difference, verdict, faults, load; record it
    Monitor(monitor::Arguments),
    /// Put a period of an instrument on one page, from logs of the bus
    Report(period::Arguments),
    /// Put virtual instruments on a CAN bus that other programs can join
    Serve(serve::Arguments),
    /// Bring a new program to the nodes on a bus, one after the other
    Update(update::Arguments),
    /// Let the slopes read zero where the machine stands now
    Zero(commission::zero::Arguments),
}

/// What the program does; its exit status.
pub fn run() -> ExitCode {
    let line = CommandLine::parse();
    let progress = Progress::on_stderr();
    let ended = match &line.verb {
        Verb::Bitrate(arguments) => commission::bitrate::run(arguments).map_err(|e| e.to_string()),
        Verb::Demo(arguments) => demo::run(arguments, &progress).map_err(|e| e.to_string()),
        Verb::Completions(arguments) => {
            shell::completions(arguments, CommandLine::command()).map_err(|e| e.to_string())
        }
        Verb::Describe(arguments) => describe::run(arguments).map_err(|e| e.to_string()),
        Verb::Get(arguments) => commission::get::run(arguments).map_err(|e| e.to_string()),
        Verb::Image(arguments) => image::run(arguments).map_err(|e| e.to_string()),
        Verb::Info(arguments) => commission::info::run(arguments).map_err(|e| e.to_string()),
        Verb::NodeId(arguments) => commission::node_id::run(arguments).map_err(|e| e.to_string()),
        Verb::Replay(arguments) => replay::run(arguments, &progress).map_err(|e| e.to_string()),
        Verb::Restore(arguments) => commission::restore::run(arguments).map_err(|e| e.to_string()),
        Verb::Save(arguments) => commission::save::run(arguments).map_err(|e| e.to_string()),
        Verb::Scan(arguments) => commission::scan::run(arguments).map_err(|e| e.to_string()),
        Verb::Set(arguments) => commission::set::run(arguments).map_err(|e| e.to_string()),
        Verb::Man(arguments) => {
            shell::manual(arguments, CommandLine::command()).map_err(|e| e.to_string())
        }
        Verb::Monitor(arguments) => monitor::run(arguments).map_err(|e| e.to_string()),
        Verb::Report(arguments) => period::run(arguments, &progress).map_err(|e| e.to_string()),
        Verb::Serve(arguments) => serve::run(arguments, &progress).map_err(|e| e.to_string()),
        Verb::Update(arguments) => update::run(arguments, &progress).map_err(|e| e.to_string()),
        Verb::Zero(arguments) => commission::zero::run(arguments).map_err(|e| e.to_string()),
    };
    match ended {
        Ok(code) => code,
        Err(sentence) => {
            eprintln!("plumb: {sentence}");
            ExitCode::from(2)
        }
    }
}
