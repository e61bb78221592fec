//! The virtual instruments, built and calibrated.
//!
//! In: the command line, and what the nodes have kept. Out: a network of them without power, and
//! their node-ids.

use device::objects::device_objects::stored_lss;
use output::progress::Progress;
use sim::bench::World;
use sim::memory;
use sim::network::Network;
use sim::network::instrument::{Delivered, Fitting, UNCONFIGURED};

use crate::console::complain;
use crate::error::ServeError;
use crate::options::Arguments;
use crate::words::reader::node_name;
use crate::world::keep::Keep;

/// Builds the instruments, calibrates them and puts them on a bus; the node-ids they have.
///
/// Errors: [`ServeError::Bench`].
pub fn build(
    arguments: &Arguments,
    node_ids: &[Option<u8>],
    keep: Option<&Keep>,
    progress: &Progress,
) -> Result<(Network, Vec<Option<u8>>), ServeError> {
    let task = progress.task("calibrating", u64::from(arguments.instruments));
    let mut network = Network::new(u32::from(arguments.bit_rate) * 1000, arguments.seed);
    let mut ids = Vec::new();
    for (unit, pair) in (0..).zip(node_ids.chunks_exact(2)) {
        let delivered = deliver(arguments, unit)?;
        let fittings = [0, 1].map(|side| {
            let (fitting, id) = fit(arguments, 2 * unit as usize + side, pair[side], keep);
            ids.push(id);
            fitting
        });
        delivered.join(&mut network, fittings);
        task.advance(1);
    }
    Ok((network, ids))
}

fn deliver(arguments: &Arguments, unit: u32) -> Result<Delivered, ServeError> {
    let (mode, seed) = (arguments.mode.into(), arguments.seed);
    if arguments.uncalibrated {
        return Ok(Delivered::bare(mode, &World::NOMINAL, seed, unit));
    }
    Delivered::calibrated(mode, &World::NOMINAL, seed, unit).map_err(ServeError::Bench)
}

/// What a node is fitted with, and the node-id that it has then: a stored one before a given one.
fn fit(
    arguments: &Arguments,
    node: usize,
    given: Option<u8>,
    keep: Option<&Keep>,
) -> (Fitting, Option<u8>) {
    let mut memory = keep.map_or_else(memory::blank, |keep| keep.memory(node));
    let (stored, rate) = stored_lss(&mut memory);
    if let Some(rate) = rate.filter(|rate| *rate != arguments.bit_rate) {
        let name = node_name(node);
        complain(&format!(
            "node {name} keeps {rate} kbit/s: start with --bit-rate {rate}"
        ));
    }
    let fitting = Fitting {
        node_id: given.unwrap_or(UNCONFIGURED),
        kbit_s: arguments.bit_rate,
        memory,
    };
    (fitting, stored.or(given).filter(|id| *id != UNCONFIGURED))
}
