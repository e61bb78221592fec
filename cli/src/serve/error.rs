//! Why the bus could not be opened to clients: one sentence that says where and what to do.

use std::fmt;
use std::io;
use std::net::SocketAddr;

/// A way for clients that could not be opened. Nothing is left open when one is returned.
#[derive(Debug)]
pub enum ServeError {
    /// Another program listens there already; the option that asks for it.
    PortInUse(SocketAddr, &'static str),
    /// The address can't be listened on; the option that asks for it.
    Listen(SocketAddr, &'static str, io::Error),
    /// A name that can't stand in a socketcand command.
    BusName(String),
    /// No pseudo-terminal could be made.
    Pty(io::Error),
    /// The kernel has no CAN at all; the interface that was asked for.
    NoKernelCan(String),
    /// There is no such interface.
    NoInterface(String),
    /// The interface is there but can't be used.
    Interface(String, io::Error),
    /// A thread could not be started.
    Thread(io::Error),
}

impl std::error::Error for ServeError {}

impl fmt::Display for ServeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PortInUse(at, option) => write!(
                f,
                "port {} of {} is in use: end the program that has it (another `plumb serve`?) \
                 or choose another one with {option} {}",
                at.port(),
                at.ip(),
                SocketAddr::new(at.ip(), at.port().wrapping_add(1).max(1024)),
            ),
            Self::Listen(at, option, error) => write!(
                f,
                "cannot listen on {at}: {error}; choose an address of this machine with \
                 {option} ADDRESS:PORT, for instance 127.0.0.1:{}",
                super::tcp::SOCKETCAND_PORT
            ),
            Self::BusName(name) => write!(
                f,
                "{name:?} can't name a bus: take 1 to 15 letters, digits, `-`, `_` or `.`"
            ),
            Self::Pty(error) => write!(
                f,
                "cannot make a pseudo-terminal: {error}; serve SLCAN over TCP instead"
            ),
            Self::NoKernelCan(name) => write!(
                f,
                "cannot open the CAN interface {name}: this system has no SocketCAN (on Linux: \
                 modprobe can_raw); serve over TCP instead"
            ),
            Self::NoInterface(name) => write!(
                f,
                "there is no CAN interface {name}: see `ip link`, or make a virtual one with `ip \
                 link add {name} type vcan` and `ip link set {name} up`"
            ),
            Self::Interface(name, error) => write!(
                f,
                "cannot use the CAN interface {name}: {error}; is it up (`ip link show {name}`)?"
            ),
            Self::Thread(error) => write!(f, "cannot start a thread: {error}"),
        }
    }
}
