//! Why the bus could not be opened to clients: one sentence that says where and what to do.

use std::io;
use std::net::SocketAddr;

/// A way for clients that could not be opened. Nothing is left open when one is returned.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Another program listens there already; the option that asks for it.
    #[error(
        "port {a} of {b} is in use: end the program that has it (another `plumb serve`?) or \
         choose another one with {1} {c}",
        a = .0.port(),
        b = .0.ip(),
        c = SocketAddr::new(.0.ip(), .0.port().wrapping_add(1).max(1024))
    )]
    PortInUse(SocketAddr, &'static str),
    /// The address can't be listened on; the option that asks for it.
    #[error(
        "cannot listen on {0}: {2}; choose an address of this machine with {1} ADDRESS:PORT, for \
         instance 127.0.0.1:{a}",
        a = super::tcp::SOCKETCAND_PORT
    )]
    Listen(SocketAddr, &'static str, io::Error),
    /// A name that can't stand in a socketcand command.
    #[error("{0:?} can't name a bus: take 1 to 15 letters, digits, `-`, `_` or `.`")]
    BusName(String),
    /// No pseudo-terminal could be made.
    #[error("cannot make a pseudo-terminal: {0}; serve SLCAN over TCP instead")]
    Pty(io::Error),
    /// The kernel has no CAN at all; the interface that was asked for.
    #[error(
        "cannot open the CAN interface {0}: this system has no SocketCAN (on Linux: modprobe \
         can_raw); serve over TCP instead"
    )]
    NoKernelCan(String),
    /// There is no such interface.
    #[error(
        "there is no CAN interface {0}: see `ip link`, or make a virtual one with `ip link add \
         {0} type vcan` and `ip link set {0} up`"
    )]
    NoInterface(String),
    /// The interface is there but can't be used.
    #[error("cannot use the CAN interface {0}: {1}; is it up (`ip link show {0}`)?")]
    Interface(String, io::Error),
    /// A thread could not be started.
    #[error("cannot start a thread: {0}")]
    Thread(io::Error),
}
