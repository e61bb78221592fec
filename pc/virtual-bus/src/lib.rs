//! `plumb serve`: the virtual instrument on a bus that other programs can join.
//!
//! In: frames of CAN clients that come over TCP, over a pseudo-terminal or from a CAN interface
//! of the kernel; motion and faults as words from a script, typed, or sent by `plumb twin`. Out:
//! every frame of the bus to each client, paced to real time or as fast as the machine can.
//! [`Twin`] is the same for one program that holds it, in virtual time alone.
//!
//! Left out: real nodes. A virtual node has the device's code, but not its processor.

mod addresses;
mod clients;
mod console;
mod doors;
mod error;
mod instruments;
mod options;
mod pace;
mod ports;
mod ready;
mod server;
mod threads;
mod twin;
mod words;
mod world;

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use output::progress::Progress;
use sim::network::Network;
use sim::network::guest::Switch;

use doors::Doors;
use server::Server;
use words::script;
use world::keep::Keep;
use world::stage::Stage;

pub use addresses::TWIN_AT;
pub use error::{Complaint, ServeError};
pub use options::Arguments;
pub use ports::twin::Answer;
pub use twin::{Heard, Said, Twin};
pub use words::line::{candidates, help, read};
pub use words::reader::WordError;

/// Serves until it is interrupted, a word ends it, or the script ends.
///
/// Errors: see [`ServeError`].
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, ServeError> {
    let node_ids = arguments.node_ids()?;
    serve(arguments, node_ids.len(), |keep| {
        instruments::build(arguments, &node_ids, keep, progress)
    })
}

/// Serves a network that is made already, such as one of emulated nodes; gives all of it power.
/// `ids` are what is printed as its node-ids.
///
/// Errors: see [`ServeError`].
pub fn run_network(
    arguments: &Arguments,
    network: Network,
    ids: &[Option<u8>],
) -> Result<ExitCode, ServeError> {
    serve(arguments, network.node_count(), |_| {
        Ok((network, ids.to_vec()))
    })
}

/// Opens all that was asked for, builds a network of so many nodes, gives it power and serves it.
fn serve(
    arguments: &Arguments,
    nodes: usize,
    build: impl FnOnce(Option<&Keep>) -> Result<(Network, Vec<Option<u8>>), ServeError>,
) -> Result<ExitCode, ServeError> {
    let script = arguments.script.as_ref();
    let script = script.map(|path| script::open(path, nodes)).transpose()?;
    let keep = arguments.state.as_ref();
    let keep = keep.map(|folder| Keep::open(folder, nodes)).transpose()?;
    let mut doors = Doors::open(arguments)?;
    let interrupted = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&interrupted);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).map_err(ServeError::Signal)?;
    let (network, ids) = build(keep.as_ref())?;
    let mut stage = Stage::new(network, arguments.seed);
    stage.one_axis = arguments.mode == options::Mode::OneAxis;
    stage.chamber_speed = arguments.chamber_speed;
    (0..nodes).for_each(|number| stage.switch(number, Switch::On));
    doors.ready.node_ids = ids;
    match arguments.json {
        true => console::say_json(&doors.ready),
        false => console::say(&doors.ready.text()),
    }
    let server = Server::new(arguments, doors, stage, script, keep, interrupted);
    server.run().map(|()| ExitCode::SUCCESS)
}
