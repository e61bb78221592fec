//! The names of buses: URLs, and the short forms that people know.
//!
//! In: `socketcand://host:port/name`, `slcan://host:port`, `slcan:///dev/ttyACM0@115200`,
//! `socketcan://can0`, a bare `host:port[/name]` (socketcand) or a bare interface name. Out: a
//! [`BusAddress`], which prints as its URL.
//!
//! Left out: whether anybody is there.

use std::fmt;

use can_text::socketcand::{PORT, is_bus_name};

use super::error::JoinError;

/// The name of the bus that `plumb serve` has.
pub const BUS_NAME: &str = "plumb";

/// The rate of a serial line when none is given; adapters on USB don't look at it.
pub const BAUD: u32 = 115_200;

/// One way to a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// A socketcand server and the name of its bus.
    Socketcand {
        /// Host and port.
        at: String,
        /// The bus.
        bus: String,
    },
    /// An SLCAN adapter behind TCP.
    SlcanTcp {
        /// Host and port.
        at: String,
    },
    /// An SLCAN adapter at a serial port or pseudo-terminal.
    SlcanSerial {
        /// The port.
        path: String,
        /// Its rate, bit/s.
        baud: u32,
    },
    /// An interface of the kernel.
    Kernel {
        /// Its name.
        interface: String,
    },
}

/// A way to a bus, and the rate that an adapter has to be told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BusAddress {
    /// The way.
    pub at: Address,
    /// The bit rate in kbit/s, when it was given.
    pub kbit_s: Option<u32>,
}

impl From<Address> for BusAddress {
    fn from(at: Address) -> Self {
        Self { at, kbit_s: None }
    }
}

impl fmt::Display for BusAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.at {
            Address::Socketcand { at, bus } => write!(f, "socketcand://{at}/{bus}"),
            Address::SlcanTcp { at } => write!(f, "slcan://{at}"),
            Address::SlcanSerial { path, .. } if path.starts_with('/') => {
                write!(f, "slcan://{path}")
            }
            Address::SlcanSerial { path, .. } => write!(f, "slcan:///{path}"),
            Address::Kernel { interface } => write!(f, "socketcan://{interface}"),
        }
    }
}

/// `host:port`, the port added where it is missing.
fn host_and_port(text: &str) -> Option<String> {
    let legal = |host: &str| !host.is_empty() && !host.contains(['/', ' ', '@']);
    // The colons of a bare IPv6 address are not those of a port.
    let bare = text.ends_with(']') || !text.contains(':');
    if bare {
        return legal(text).then(|| format!("{text}:{PORT}"));
    }
    let (host, port) = text.rsplit_once(':')?;
    let known = port.parse::<u16>().is_ok_and(|port| port > 0);
    (legal(host) && known).then(|| text.to_owned())
}

/// `host:port[/name]`.
pub fn socketcand(text: &str) -> Result<Address, JoinError> {
    let wrong = || JoinError::Address(text.to_owned());
    let (at, bus) = text.split_once('/').unwrap_or((text, BUS_NAME));
    let bus = if bus.is_empty() { BUS_NAME } else { bus };
    let at = host_and_port(at).ok_or_else(wrong)?;
    match is_bus_name(bus) {
        true => Ok(Address::Socketcand {
            at,
            bus: bus.to_owned(),
        }),
        false => Err(wrong()),
    }
}

/// `host:port`, `socket://host:port` (pyserial's form), or a serial port with `@RATE` or without.
pub fn slcan(text: &str) -> Result<Address, JoinError> {
    let wrong = || JoinError::Address(text.to_owned());
    if let Some(at) = text.strip_prefix("socket://") {
        let at = Some(at)
            .filter(|at| at.contains(':'))
            .and_then(host_and_port);
        return at.map(|at| Address::SlcanTcp { at }).ok_or_else(wrong);
    }
    let (path, baud) = match text.rsplit_once('@') {
        Some((path, rate)) => (path, rate.parse().map_err(|_| wrong())?),
        None => (text, BAUD),
    };
    // A port of Windows comes as "/COM3" out of a URL.
    let path = match path.strip_prefix('/') {
        Some(name) if name.starts_with("COM") => name,
        _ => path,
    };
    if path.starts_with('/') || path.starts_with("COM") || path.starts_with('.') {
        let path = path.to_owned();
        return Ok(Address::SlcanSerial { path, baud });
    }
    let at = Some(path)
        .filter(|at| at.contains(':'))
        .and_then(host_and_port);
    at.map(|at| Address::SlcanTcp { at }).ok_or_else(wrong)
}

/// An interface of the kernel; Linux allows names of 15 bytes.
pub fn kernel(text: &str) -> Result<Address, JoinError> {
    let legal = |c: char| c.is_ascii_graphic() && !"/:".contains(c);
    match (1..=15).contains(&text.len()) && text.chars().all(legal) {
        true => Ok(Address::Kernel {
            interface: text.to_owned(),
        }),
        false => Err(JoinError::Address(text.to_owned())),
    }
}

/// What `--bus` was given: a URL, `host:port[/name]`, or an interface's name.
///
/// Errors: [`JoinError::Address`].
pub fn parse(text: &str) -> Result<Address, JoinError> {
    let parsed = match text.split_once("://") {
        Some(("socketcand", rest)) => socketcand(rest),
        Some(("slcan", rest)) => slcan(rest),
        Some(("socketcan", rest)) => kernel(rest),
        Some(_) => return Err(JoinError::Address(text.to_owned())),
        None if text.starts_with("/dev/") => slcan(text),
        None if text.split('/').next().is_some_and(|at| at.contains(':')) => socketcand(text),
        None => kernel(text),
    };
    // The sentence is to show what the user has written.
    parsed.map_err(|_| JoinError::Address(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shown(text: &str) -> String {
        parse(text).map_or_else(
            |_| "wrong".to_owned(),
            |at| BusAddress::from(at).to_string(),
        )
    }

    #[test]
    fn every_form_comes_to_its_url() {
        for (text, url) in [
            ("127.0.0.1:29536", "socketcand://127.0.0.1:29536/plumb"),
            ("pi:7/can1", "socketcand://pi:7/can1"),
            ("socketcand://pi", "socketcand://pi:29536/plumb"),
            ("socketcand://[::1]:5/x", "socketcand://[::1]:5/x"),
            ("slcan://pi:4000", "slcan://pi:4000"),
            ("slcan:///dev/ttyACM0", "slcan:///dev/ttyACM0"),
            ("/dev/ttyACM0@1000000", "slcan:///dev/ttyACM0"),
            ("slcan:///COM3", "slcan:///COM3"),
            ("socketcan://can0", "socketcan://can0"),
            ("vcan1", "socketcan://vcan1"),
        ] {
            assert_eq!(shown(text), url, "{text}");
        }
    }

    #[test]
    fn what_is_no_address_is_refused() {
        for text in [
            "",
            "pi:",
            "pi:0",
            "pi:70000",
            "socketcand://",
            "socketcand://pi:1/a name",
            "slcan://pi",
            "slcan:///dev/ttyACM0@fast",
            "http://pi:80",
            "socketcan://an-interface-of-more",
        ] {
            assert_eq!(shown(text), "wrong", "{text:?}");
        }
    }

    proptest! {
        #[test]
        fn an_address_prints_as_what_is_read_back(text in "[a-z0-9:/@.\\[\\]]{0,24}") {
            if let Ok(at) = parse(&text)
                && !matches!(at, Address::SlcanSerial { .. })
            {
                prop_assert_eq!(parse(&BusAddress::from(at.clone()).to_string()).unwrap(), at);
            }
        }
    }
}
