//! Lines that a person pastes into another program to join the bus, and the same for programs.
//!
//! In: where the bus can be reached. Out: one block of text for each way, or one line of JSON. The
//! lines are those of python-can 4.6, python-canopen 2.4 and can-utils.
//!
//! Left out: the motion of the instrument, and anything about its nodes.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::Path;

use serde::Serialize;

/// Where the bus is, for `--json`.
#[derive(Clone, Debug, Serialize)]
pub struct Ready {
    /// "plumb-serve".
    pub format: &'static str,
    /// 1.
    pub version: u32,
    /// Node-ids in the order a, b, a2, b2, ...; `null` for a node without one.
    pub node_ids: Vec<Option<u8>>,
    /// Bit rate.
    pub bit_rate_kbit_s: u16,
    /// ADDRESS:PORT of the socketcand server.
    pub socketcand: String,
    /// The name by which its clients open the bus.
    pub bus_name: String,
    /// ADDRESS:PORT of the SLCAN server.
    pub slcan: Option<String>,
    /// Path of the pseudo-terminal.
    pub pty: Option<String>,
    /// Interface of the kernel.
    pub can_interface: Option<String>,
    /// ADDRESS:PORT of the virtual motor.
    pub motor: Option<String>,
    /// ADDRESS:PORT of the virtual climatic chamber.
    pub chamber: Option<String>,
    /// ADDRESS:PORT of the port for words, for `plumb twin --to`.
    pub twin: String,
}

/// What a typed word has told, for `--json`.
#[derive(Clone, Debug, Serialize)]
pub struct Told<'a> {
    /// "plumb-serve-told".
    pub format: &'static str,
    /// 1.
    pub version: u32,
    /// The text, in lines.
    pub lines: Vec<&'a str>,
}

impl<'a> Told<'a> {
    /// This text.
    pub fn new(text: &'a str) -> Self {
        Self {
            format: "plumb-serve-told",
            version: 1,
            lines: text.lines().collect(),
        }
    }
}

/// One line of JSON.
pub fn json(value: &impl Serialize) -> String {
    // Text, numbers and lists always have a form in JSON.
    serde_json::to_string(value).unwrap_or_default() + "\n"
}

/// One way to the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way<'a> {
    /// socketcand over TCP: where, and the name of the bus.
    Socketcand(SocketAddr, &'a str),
    /// SLCAN over TCP: where.
    SlcanTcp(SocketAddr),
    /// SLCAN on a pseudo-terminal: its path.
    SlcanPty(&'a Path),
    /// An interface of the kernel: its name.
    Kernel(&'a str),
}

/// The lines for one way to the bus, which end with a line feed each.
pub fn lines(way: Way) -> String {
    let (title, keywords, shell) = match way {
        Way::Socketcand(at, name) => {
            let at = reached(at);
            let (host, port) = (at.ip(), at.port());
            (
                format!("socketcand on {at}, bus {name}"),
                format!(
                    "interface=\"socketcand\", host=\"{host}\", port={port}, \
                     channel={name:?}"
                ),
                format!(
                    "python -m can.logger -i socketcand -c {name} --bus-kwargs host={host} \
                     port={port}"
                ),
            )
        }
        Way::SlcanTcp(at) => {
            let at = reached(at);
            let url = format!("socket://{at}");
            let shell = format!("python -m can.logger -i slcan -c {url}");
            (format!("SLCAN on {at}"), slcan_keywords(&url), shell)
        }
        Way::SlcanPty(path) => {
            let path = path.display().to_string();
            let shell = format!("sudo slcand -o -c {path} slcan0 && sudo ip link set slcan0 up");
            (format!("SLCAN on {path}"), slcan_keywords(&path), shell)
        }
        Way::Kernel(name) => (
            format!("SocketCAN interface {name}"),
            format!("interface=\"socketcan\", channel={name:?}"),
            format!("candump -L {name}"),
        ),
    };
    format!(
        "{title}\n  python-can:  can.Bus({keywords})\n  canopen:     \
         network.connect({keywords})\n  shell:       {shell}\n"
    )
}

fn slcan_keywords(channel: &str) -> String {
    // The pause of two seconds is for adapters that restart when opened.
    format!("interface=\"slcan\", channel={channel:?}, sleep_after_open=0")
}

/// An address that a client on this machine can connect to.
pub fn reached(mut at: SocketAddr) -> SocketAddr {
    if at.ip().is_unspecified() {
        at.set_ip(IpAddr::V4(Ipv4Addr::LOCALHOST));
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn python_can_gets_its_four_keywords() {
        let text = lines(Way::Socketcand(([127, 0, 0, 1], 29536).into(), "plumb"));
        assert!(text.contains(
            "can.Bus(interface=\"socketcand\", host=\"127.0.0.1\", port=29536, \
             channel=\"plumb\")"
        ));
        assert_eq!(text.lines().count(), 4);
    }

    #[test]
    fn an_address_for_everybody_is_reached_at_this_machine() {
        let text = lines(Way::SlcanTcp(([0, 0, 0, 0], 4000).into()));
        assert!(text.contains("\"socket://127.0.0.1:4000\""), "{text}");
    }

    #[test]
    fn a_terminal_and_an_interface_go_by_name() {
        let pty = lines(Way::SlcanPty(Path::new("/dev/pts/9")));
        assert!(
            pty.contains("interface=\"slcan\", channel=\"/dev/pts/9\""),
            "{pty}"
        );
        let kernel = lines(Way::Kernel("vcan0"));
        assert!(
            kernel.contains("interface=\"socketcan\", channel=\"vcan0\""),
            "{kernel}"
        );
    }
}
