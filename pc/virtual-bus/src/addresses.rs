//! Where the virtual bus is found.
//!
//! In: nothing. Out: the usual addresses, and how a client on this machine reaches an address.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};

use can_text::socketcand::PORT;

/// Where socketcand clients find the bus unless told otherwise.
pub const SOCKETCAND_AT: SocketAddr = here(PORT);

/// Where `plumb twin` finds a `plumb serve` that was started without options.
pub const TWIN_AT: SocketAddr = here(PORT + 1);

/// A port of this machine alone.
pub const fn here(port: u16) -> SocketAddr {
    SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, port))
}

/// An address that a client on this machine can connect to.
pub fn reached(mut at: SocketAddr) -> SocketAddr {
    if at.ip().is_unspecified() {
        at.set_ip(Ipv4Addr::LOCALHOST.into());
    }
    at
}
