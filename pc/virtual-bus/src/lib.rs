//! `plumb serve`: the virtual instrument on a bus that other programs can join.
//!
//! In: frames of CAN clients that come over TCP, over a pseudo-terminal or from a CAN interface
//! of the kernel; motion and faults as words from a script, typed, or sent by `plumb twin`. Out:
//! every frame of the bus to each client, paced to real time or as fast as the machine can.
//!
//! Left out: real nodes. A virtual node has the device's code, but not its processor.

mod climate;
mod error;
mod hub;
mod keep;
mod line_port;
mod line_server;
mod motor;
mod options;
mod outlet;
mod pace;
mod pty;
mod ready;
mod round_robin;
mod script;
mod server;
mod slcan;
mod socketcan;
mod socketcand;
mod stage;
mod status;
mod stop;
mod tcp;
mod trouble;
pub mod twin;
mod typed;
pub mod words;

#[cfg(test)]
mod stage_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod trouble_tests;

use std::io::Write as _;
use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use device::objects::device_objects::stored_lss;
use sim::bench::World;
use sim::memory;
use sim::network::Network;
use sim::network::instrument::{Delivered, Fitting, UNCONFIGURED};

use climate::Climate;
use hub::Hub;
use keep::Keep;
use line_port::{LineDevice, LinePort};
use motor::Table;
use output::progress::Progress;
use ready::Way;
use server::Server;
use stage::Stage;
use twin::TwinPort;

pub use options::Arguments;
pub use stop::Stopped;

/// Serves until it is interrupted, a word ends it, or the script ends.
///
/// Errors: see [`Stopped`].
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, Stopped> {
    let node_ids = arguments.node_ids()?;
    let script = match &arguments.script {
        Some(path) => Some((path.clone(), script::open(path, node_ids.len())?)),
        None => None,
    };
    let keep = match &arguments.state {
        Some(folder) => Some(Keep::open(folder, node_ids.len())?),
        None => None,
    };
    let mut hub = Hub::new();
    let doors = Doors::open(arguments, &mut hub)?;
    let interrupted = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&interrupted);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).map_err(Stopped::Signal)?;
    let (stage, ids) = build(arguments, &node_ids, keep.as_ref(), progress)?;
    doors.say_ready(arguments, &ids);
    let (twin, devices) = doors.ports();
    let server = Server::new(arguments, hub, stage, script, keep, interrupted);
    server
        .with_ports(twin, devices)
        .run()
        .map(|()| ExitCode::SUCCESS)
}

/// Serves a network that is made already, such as one of emulated nodes; gives all of it power.
/// `ids` are what is printed as its node-ids.
///
/// Errors: see [`Stopped`].
pub fn run_network(
    arguments: &Arguments,
    network: Network,
    ids: &[Option<u8>],
) -> Result<ExitCode, Stopped> {
    let nodes = network.node_count();
    let script = match &arguments.script {
        Some(path) => Some((path.clone(), script::open(path, nodes)?)),
        None => None,
    };
    let mut hub = Hub::new();
    let doors = Doors::open(arguments, &mut hub)?;
    let interrupted = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&interrupted);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).map_err(Stopped::Signal)?;
    let mut stage = Stage::new(network, arguments.seed);
    stage.chamber_speed = arguments.chamber_speed;
    (0..nodes).for_each(|number| stage.power_on(number));
    doors.say_ready(arguments, ids);
    let (twin, devices) = doors.ports();
    let server = Server::new(arguments, hub, stage, script, None, interrupted);
    server
        .with_ports(twin, devices)
        .run()
        .map(|()| ExitCode::SUCCESS)
}

/// Prints. A reader that has gone is no reason to end the bus for all others.
fn say(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Calibrates the instruments, puts them on a bus and gives them power; the node-ids they have.
fn build(
    arguments: &Arguments,
    node_ids: &[Option<u8>],
    keep: Option<&Keep>,
    progress: &Progress,
) -> Result<(Stage, Vec<Option<u8>>), Stopped> {
    let task = progress.task("calibrating", u64::from(arguments.instruments));
    let mut network = Network::new(u32::from(arguments.bit_rate) * 1000, arguments.seed);
    let mut ids = Vec::new();
    for (unit, pair) in (0..).zip(node_ids.chunks_exact(2)) {
        let (mode, seed) = (arguments.mode.into(), arguments.seed);
        let delivered = if arguments.uncalibrated {
            Delivered::bare(mode, &World::NOMINAL, seed, unit)
        } else {
            Delivered::calibrated(mode, &World::NOMINAL, seed, unit).map_err(Stopped::Bench)?
        };
        let fittings = [0, 1].map(|side| {
            let node = 2 * unit as usize + side;
            let mut memory = keep.map_or_else(memory::blank, |keep| keep.memory(node));
            let (stored, rate) = stored_lss(&mut memory);
            if let Some(rate) = rate.filter(|rate| *rate != arguments.bit_rate) {
                let name = words::node_name(node);
                eprintln!("plumb: node {name} keeps {rate} kbit/s: start with --bit-rate {rate}");
            }
            ids.push(stored.or(pair[side]).filter(|id| *id != UNCONFIGURED));
            Fitting {
                node_id: pair[side].unwrap_or(UNCONFIGURED),
                kbit_s: arguments.bit_rate,
                memory,
            }
        });
        delivered.join(&mut network, fittings);
        task.advance(1);
    }
    let mut stage = Stage::new(network, arguments.seed);
    stage.one_axis = arguments.mode == options::Mode::OneAxis;
    stage.chamber_speed = arguments.chamber_speed;
    (0..node_ids.len()).for_each(|number| stage.power_on(number));
    Ok((stage, ids))
}

/// The ways in that are open.
struct Doors {
    socketcand: SocketAddr,
    slcan: Option<SocketAddr>,
    pty: Option<std::path::PathBuf>,
    motor: Option<LinePort>,
    chamber: Option<LinePort>,
    twin: TwinPort,
}

impl Doors {
    fn open(arguments: &Arguments, hub: &mut Hub) -> Result<Self, Stopped> {
        let socketcand = hub.listen_socketcand(arguments.listen, &arguments.bus_name)?;
        let slcan = arguments.slcan.map(|at| hub.listen_slcan(at)).transpose()?;
        let pty = arguments.pty.then(|| hub.open_pty()).transpose()?;
        if let Some(name) = &arguments.can {
            hub.open_kernel(name)?;
        }
        let seed = arguments.seed;
        let listen = |at: Option<SocketAddr>, option, device: Box<dyn LineDevice>| {
            at.map(|at| LinePort::listen(at, option, device))
                .transpose()
        };
        Ok(Self {
            socketcand,
            slcan,
            pty,
            motor: listen(arguments.motor, "--motor", Box::new(Table::new(seed)))?,
            chamber: listen(arguments.chamber, "--chamber", Box::new(Climate { seed }))?,
            // Last, so that it takes no port that somebody has asked for.
            twin: match arguments.twin {
                Some(at) => TwinPort::listen(at)?,
                None => TwinPort::beside(arguments.listen)?,
            },
        })
    }

    /// Where words come in, and the devices that are spoken to in lines.
    fn ports(self) -> (TwinPort, Vec<LinePort>) {
        let devices = self.motor.into_iter().chain(self.chamber).collect();
        (self.twin, devices)
    }

    fn say_ready(&self, arguments: &Arguments, ids: &[Option<u8>]) {
        if arguments.json {
            say(&ready::json(&self.as_json(arguments, ids)));
        } else {
            say(&self.ready(arguments, ids));
        }
    }

    fn as_json(&self, arguments: &Arguments, ids: &[Option<u8>]) -> ready::Ready {
        ready::Ready {
            format: "plumb-serve",
            version: 1,
            node_ids: ids.to_vec(),
            bit_rate_kbit_s: arguments.bit_rate,
            socketcand: self.socketcand.to_string(),
            bus_name: arguments.bus_name.clone(),
            slcan: self.slcan.map(|at| at.to_string()),
            pty: self.pty.as_ref().map(|path| path.display().to_string()),
            can_interface: arguments.can.clone(),
            motor: self.motor.as_ref().map(|motor| motor.at.to_string()),
            chamber: self.chamber.as_ref().map(|chamber| chamber.at.to_string()),
            twin: self.twin.at.to_string(),
        }
    }

    /// What is printed once all is ready: one line to wait for, then the lines to paste.
    fn ready(&self, arguments: &Arguments, ids: &[Option<u8>]) -> String {
        let mut ways = vec![Way::Socketcand(self.socketcand, &arguments.bus_name)];
        let mut places = format!("socketcand {}", self.socketcand);
        if let Some(at) = self.slcan {
            ways.push(Way::SlcanTcp(at));
            places += &format!(", SLCAN {at}");
        }
        if let Some(path) = &self.pty {
            ways.push(Way::SlcanPty(path));
            places += &format!(", SLCAN {}", path.display());
        }
        if let Some(name) = &arguments.can {
            ways.push(Way::Kernel(name));
            places += &format!(", CAN interface {name}");
        }
        let mut bench = format!("plumb twin --to {} WORD\n", ready::reached(self.twin.at));
        if let Some(motor) = &self.motor {
            bench += &format!("plumb calibrate --motor tcp://{}\n", motor.at);
        }
        if let Some(chamber) = &self.chamber {
            bench += &format!("plumb characterise --chamber tcp://{}\n", chamber.at);
        }
        let id = |id: &Option<u8>| id.map_or("none".to_owned(), |id| id.to_string());
        let names: Vec<_> = ids.iter().map(id).collect();
        let lines: String = ways.into_iter().map(ready::lines).collect();
        format!(
            "serving {} nodes ({}) at {} kbit/s on {places}\n{lines}{bench}",
            ids.len(),
            names.join(", "),
            arguments.bit_rate
        )
    }
}
