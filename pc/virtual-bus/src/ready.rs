//! Where the bus can be reached, as lines that a person pastes into another program, or as JSON.
//!
//! In: every way in. Out: one block of text for each way, or a value for one line of JSON. The
//! lines are those of python-can 4.6, python-canopen 2.4 and can-utils.
//!
//! Left out: the motion of the instrument, and anything about its nodes but their node-ids.

use std::net::SocketAddr;

use serde::Serialize;

use crate::addresses::reached;

/// Every way in, as `--json` prints them.
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
    pub socketcand: SocketAddr,
    /// The name by which its clients open the bus.
    pub bus_name: String,
    /// ADDRESS:PORT of the SLCAN server.
    pub slcan: Option<SocketAddr>,
    /// Path of the pseudo-terminal.
    pub pty: Option<String>,
    /// Interface of the kernel.
    pub can_interface: Option<String>,
    /// ADDRESS:PORT of the virtual motor.
    pub motor: Option<SocketAddr>,
    /// ADDRESS:PORT of the virtual climatic chamber.
    pub chamber: Option<SocketAddr>,
    /// ADDRESS:PORT of the port for words, for `plumb twin --to`.
    pub twin: SocketAddr,
}

/// One way for CAN clients.
struct Way {
    /// In the list of all ways.
    place: String,
    title: String,
    /// What python-can wants.
    keywords: String,
    /// A line for a shell.
    shell: String,
}

impl Ready {
    /// What is printed once all is ready: one line to wait for, then the lines to paste.
    pub fn text(&self) -> String {
        let id = |id: &Option<u8>| id.map_or("none".to_owned(), |id| id.to_string());
        let ids: Vec<_> = self.node_ids.iter().map(id).collect();
        let ways = self.ways();
        let places: Vec<_> = ways.iter().map(|way| way.place.as_str()).collect();
        let mut text = format!(
            "serving {} nodes ({}) at {} kbit/s on {}\n",
            ids.len(),
            ids.join(", "),
            self.bit_rate_kbit_s,
            places.join(", ")
        );
        text.extend(ways.iter().map(Way::lines));
        text += &format!("plumb twin --to {} WORD\n", reached(self.twin));
        if let Some(at) = self.motor {
            text += &format!("plumb calibrate --motor tcp://{at}\n");
        }
        if let Some(at) = self.chamber {
            text += &format!("plumb characterise --chamber tcp://{at}\n");
        }
        text
    }

    fn ways(&self) -> Vec<Way> {
        let mut ways = vec![Way::socketcand(self.socketcand, &self.bus_name)];
        ways.extend(self.slcan.map(Way::slcan));
        ways.extend(self.pty.as_deref().map(Way::pty));
        ways.extend(self.can_interface.as_deref().map(Way::kernel));
        ways
    }
}

impl Way {
    fn socketcand(at: SocketAddr, name: &str) -> Self {
        let place = format!("socketcand {at}");
        let at = reached(at);
        let (host, port) = (at.ip(), at.port());
        Self {
            place,
            title: format!("socketcand on {at}, bus {name}"),
            keywords: format!(
                "interface=\"socketcand\", host=\"{host}\", port={port}, channel={name:?}"
            ),
            shell: format!(
                "python -m can.logger -i socketcand -c {name} --bus-kwargs host={host} port={port}"
            ),
        }
    }

    fn slcan(at: SocketAddr) -> Self {
        let url = format!("socket://{}", reached(at));
        Self {
            place: format!("SLCAN {at}"),
            title: format!("SLCAN on {}", reached(at)),
            keywords: slcan_keywords(&url),
            shell: format!("python -m can.logger -i slcan -c {url}"),
        }
    }

    fn pty(path: &str) -> Self {
        Self {
            place: format!("SLCAN {path}"),
            title: format!("SLCAN on {path}"),
            keywords: slcan_keywords(path),
            shell: format!("sudo slcand -o -c {path} slcan0 && sudo ip link set slcan0 up"),
        }
    }

    fn kernel(name: &str) -> Self {
        Self {
            place: format!("CAN interface {name}"),
            title: format!("SocketCAN interface {name}"),
            keywords: format!("interface=\"socketcan\", channel={name:?}"),
            shell: format!("candump -L {name}"),
        }
    }

    /// The lines to paste, which end with a line feed each.
    fn lines(&self) -> String {
        let Self {
            title,
            keywords,
            shell,
            ..
        } = self;
        format!(
            "{title}\n  python-can:  can.Bus({keywords})\n  canopen:     \
             network.connect({keywords})\n  shell:       {shell}\n"
        )
    }
}

fn slcan_keywords(channel: &str) -> String {
    // The pause of two seconds is for adapters that restart when opened.
    format!("interface=\"slcan\", channel={channel:?}, sleep_after_open=0")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn python_can_gets_its_four_keywords() {
        let text = Way::socketcand(([127, 0, 0, 1], 29536).into(), "plumb").lines();
        assert!(text.contains(
            "can.Bus(interface=\"socketcand\", host=\"127.0.0.1\", port=29536, \
             channel=\"plumb\")"
        ));
        assert_eq!(text.lines().count(), 4);
    }

    #[test]
    fn an_address_for_everybody_is_reached_at_this_machine() {
        let text = Way::slcan(([0, 0, 0, 0], 4000).into()).lines();
        assert!(text.contains("\"socket://127.0.0.1:4000\""), "{text}");
    }

    #[test]
    fn a_terminal_and_an_interface_go_by_name() {
        let pty = Way::pty("/dev/pts/9").lines();
        assert!(
            pty.contains("interface=\"slcan\", channel=\"/dev/pts/9\""),
            "{pty}"
        );
        let kernel = Way::kernel("vcan0").lines();
        assert!(
            kernel.contains("interface=\"socketcan\", channel=\"vcan0\""),
            "{kernel}"
        );
    }
}
