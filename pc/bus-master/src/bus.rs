//! A bus that was joined, whatever leads to it: socketcand, SLCAN, or the kernel's CAN.
//!
//! In: frames to send, and how long to wait for one. Out: all frames of the bus (11 and 29 bit,
//! data and remote) with the time at which they came.
//!
//! Left out: frames of one's own, which no transport shows to who has sent them.

use std::io;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use canopen::Frame;

use super::address::{Address, BusAddress};
use super::error::JoinError;
#[cfg(target_os = "linux")]
use super::kernel;
use super::received::{Received, Trouble};
use super::{slcan, socketcand};

/// How long the wait for a frame goes on before it is looked whether the user has enough.
const GLANCE: Duration = Duration::from_millis(50);

/// Whether the user has asked for the end, by a signal.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// From now on a signal to end lets [`Bus::receive`] fail once, with
/// [`io::ErrorKind::Interrupted`]. Asking again changes nothing.
///
/// Errors: what the system reports.
fn watch_signals() -> Result<(), JoinError> {
    static WATCHED: OnceLock<Result<(), String>> = OnceLock::new();
    let watched = WATCHED.get_or_init(|| {
        let set = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed));
        set.map_err(|error| error.to_string())
    });
    watched.clone().map_err(JoinError::Signal)
}

/// Whether a signal to end has come since this or [`Bus::receive`] told so last; for who waits
/// without a bus.
pub fn interrupted() -> bool {
    INTERRUPTED.swap(false, Ordering::Relaxed)
}

/// What leads to the bus.
#[derive(Debug)]
enum Link {
    Socketcand(socketcand::Client),
    Slcan(slcan::Client),
    #[cfg(target_os = "linux")]
    Kernel(kernel::Client),
}

/// Why a bus can be used no longer.
#[derive(Debug, thiserror::Error)]
pub enum BusEnd {
    /// It was lost.
    #[error("the bus is lost: {0}")]
    Lost(io::Error),
    /// The user has ended it.
    #[error("interrupted")]
    Interrupted,
}

/// What it means that the bus could not be read or written.
impl From<io::Error> for BusEnd {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::Interrupted => Self::Interrupted,
            _ => Self::Lost(error),
        }
    }
}

/// A bus that was joined.
#[derive(Debug)]
pub struct Bus {
    link: Link,
    name: String,
    /// Why the connection is closed, once it is: it takes a frame all the same.
    closed: Option<(io::ErrorKind, String)>,
}

impl Bus {
    /// Joins the bus at this address.
    ///
    /// Errors: see [`JoinError`].
    pub fn join(address: &BusAddress) -> Result<Self, JoinError> {
        watch_signals()?;
        let name = address.to_string();
        let link = match &address.at {
            Address::Socketcand { at, bus } => {
                let joined = socketcand::Client::join(at, bus);
                Link::Socketcand(joined.map_err(|error| JoinError::at(&name, at, error))?)
            }
            Address::SlcanTcp { at } => {
                let joined = slcan::Client::join_tcp(at, address.kbit_s);
                Link::Slcan(joined.map_err(|error| JoinError::at(&name, at, error))?)
            }
            Address::SlcanSerial { path, baud } => {
                let joined = slcan::Client::join_serial(path, *baud, address.kbit_s);
                Link::Slcan(joined.map_err(|error| JoinError::port(path, error))?)
            }
            Address::Kernel { interface } => join_kernel(interface)?,
        };
        let closed = None;
        Ok(Self { link, name, closed })
    }

    /// How the bus is named in an error or a report.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Sends a frame.
    ///
    /// Errors: the bus is lost; the error states why. Remote frames cannot pass socketcand,
    /// which is [`io::ErrorKind::Unsupported`].
    pub fn send(&mut self, frame: &Frame) -> io::Result<()> {
        if let Some((kind, sentence)) = &self.closed {
            return Err(io::Error::new(*kind, sentence.clone()));
        }
        let sent = match &mut self.link {
            Link::Socketcand(server) => server.send(frame),
            Link::Slcan(adapter) => adapter.send(frame),
            #[cfg(target_os = "linux")]
            Link::Kernel(socket) => socket.send(frame),
        };
        sent.map_err(|error| self.lost(error))
    }

    /// The next frame; `None` when none has come until `until`, and always from then on: on a bus
    /// that is never still a wait ends in time all the same.
    ///
    /// Errors: the bus is lost; the error states why. [`io::ErrorKind::Interrupted`] after a
    /// signal to end.
    pub fn receive(&mut self, until: Instant) -> io::Result<Option<Received>> {
        loop {
            if INTERRUPTED.swap(false, Ordering::Relaxed) {
                return Err(io::ErrorKind::Interrupted.into());
            }
            let now = Instant::now();
            if now >= until {
                return Ok(None);
            }
            let glance = until.min(now + GLANCE);
            let received = match &mut self.link {
                Link::Socketcand(server) => server.receive(glance),
                Link::Slcan(adapter) => adapter.receive(glance),
                #[cfg(target_os = "linux")]
                Link::Kernel(socket) => socket.receive(glance),
            };
            let received = received.map_err(|error| self.lost(error))?;
            if received.is_some() {
                return Ok(received);
            }
        }
    }

    /// Lines of the adapter, or frames of the server, that can't be read, since the bus was joined:
    /// what was in them is missing.
    pub const fn unreadable(&self) -> u64 {
        match &self.link {
            Link::Socketcand(server) => server.unreadable(),
            Link::Slcan(adapter) => adapter.unreadable(),
            // Its frames are no text.
            #[cfg(target_os = "linux")]
            Link::Kernel(_) => 0,
        }
    }

    /// What the adapter has told of the wires since the bus was joined; one that can be asked is.
    ///
    /// Errors: as [`Bus::receive`].
    pub fn trouble(&mut self) -> io::Result<Trouble> {
        let told = match &mut self.link {
            Link::Socketcand(server) => Ok(server.trouble()),
            Link::Slcan(adapter) => adapter.trouble(),
            #[cfg(target_os = "linux")]
            Link::Kernel(socket) => Ok(socket.trouble()),
        };
        told.map_err(|error| self.lost(error))
    }

    /// Tells the adapter another bit rate, kbit/s; false where that is not the client's to set.
    ///
    /// Errors: as [`Bus::receive`], and a refusal of the adapter.
    pub fn set_bit_rate(&mut self, kbit_s: u32) -> io::Result<bool> {
        let told = match &mut self.link {
            Link::Slcan(adapter) => adapter.set_bit_rate(kbit_s).map(|()| true),
            _ => Ok(false),
        };
        told.map_err(|error| self.lost(error))
    }

    /// Adds to an error of which bus it is, and what its number means for who looks at a cable.
    fn lost(&mut self, error: io::Error) -> io::Error {
        use io::ErrorKind::{BrokenPipe, ConnectionAborted, ConnectionReset, UnexpectedEof};
        let kind = error.kind();
        if matches!(
            kind,
            io::ErrorKind::Interrupted | io::ErrorKind::Unsupported
        ) {
            return error;
        }
        let name = &self.name;
        let gone = matches!(
            kind,
            BrokenPipe | ConnectionAborted | ConnectionReset | UnexpectedEof
        );
        let sentence = match (&self.link, gone) {
            (Link::Slcan(adapter), _) if adapter.is_serial() => {
                format!("{name}: the adapter is gone ({error}); was it unplugged?")
            }
            (_, true) => format!("{name}: the server has closed the connection"),
            _ => format!("{name}: {error}"),
        };
        if gone {
            self.closed = Some((kind, sentence.clone()));
        }
        io::Error::new(kind, sentence)
    }
}

#[cfg(target_os = "linux")]
fn join_kernel(interface: &str) -> Result<Link, JoinError> {
    let joined = kernel::Client::join(interface);
    let joined = joined.map_err(|error| JoinError::interface(interface, error));
    joined.map(Link::Kernel)
}

#[cfg(not(target_os = "linux"))]
fn join_kernel(interface: &str) -> Result<Link, JoinError> {
    Err(JoinError::NoKernelCan(interface.to_owned()))
}
