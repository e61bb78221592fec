//! Opens every way in that was asked for.
//!
//! In: the command line. Out: the clients of the bus, the ports for words and devices, and where
//! all of them are.

use std::net::SocketAddr;

use crate::clients::hub::Hub;
use crate::error::ServeError;
use crate::options::Arguments;
use crate::ports::chamber::Climate;
use crate::ports::line_port::{LineDevice, LinePort};
use crate::ports::motor::Table;
use crate::ports::twin::TwinPort;
use crate::ready::Ready;

/// The ways in that are open.
#[derive(Debug)]
pub struct Doors {
    /// CAN clients.
    pub hub: Hub,
    /// Where words come in.
    pub twin: TwinPort,
    /// Devices that are spoken to in lines.
    pub devices: Vec<LinePort>,
    /// Where all of these are.
    pub ready: Ready,
}

impl Doors {
    /// Opens them; nothing stays open when one of them can't be.
    ///
    /// Errors: see [`ServeError`].
    pub fn open(arguments: &Arguments) -> Result<Self, ServeError> {
        let mut hub = Hub::new();
        let socketcand = hub.listen_socketcand(arguments.listen, &arguments.bus_name)?;
        let slcan = arguments.slcan.map(|at| hub.listen_slcan(at)).transpose()?;
        let pty = arguments.pty.then(|| hub.open_pty()).transpose()?;
        if let Some(name) = &arguments.can {
            hub.open_kernel(name)?;
        }
        let (seed, mut devices) = (arguments.seed, Vec::new());
        let mut listen = |at: Option<SocketAddr>, option, device: Box<dyn LineDevice>| {
            let Some(at) = at else { return Ok(None) };
            let port = LinePort::listen(at, option, (device, seed))?;
            let at = port.at;
            devices.push(port);
            Ok::<_, ServeError>(Some(at))
        };
        let motor = listen(arguments.motor, "--motor", Box::new(Table::new(seed)))?;
        let chamber = listen(arguments.chamber, "--chamber", Box::new(Climate))?;
        // Last, so that it takes no port that somebody has asked for.
        let twin = match arguments.twin {
            Some(at) => TwinPort::listen(at)?,
            None => TwinPort::beside(arguments.listen)?,
        };
        let ready = Ready {
            format: "plumb-serve",
            version: 1,
            node_ids: Vec::new(),
            bit_rate_kbit_s: arguments.bit_rate,
            socketcand,
            bus_name: arguments.bus_name.clone(),
            slcan,
            pty: pty.map(|path| path.display().to_string()),
            can_interface: arguments.can.clone(),
            motor,
            chamber,
            twin: twin.at,
        };
        Ok(Self {
            hub,
            twin,
            devices,
            ready,
        })
    }
}
