//! `plumb scan`: who is on the bus.
//!
//! In: a bus. Out: a line for each node with its state, kind, name and identity, which of them
//! are the two channels of one instrument, and nodes that have no node-id yet, found by LSS
//! fastscan. Or one JSON object. Nothing is changed.
//!
//! Left out: what the nodes measure (`info`, `monitor`).

use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use serde::Serialize;

use super::answer::Answer;
use super::error::CommissionError;
use bus_master::fault::Fault;
use bus_master::lss::{Identity, Master};
use bus_master::node::Node;
use bus_master::nodes;
use bus_master::survey::{Survey, survey};
use bus_master::{Bus, BusOptions};
use codes::words;
use output::table::{Cell, Column, Table};
use output::{object, printable};

/// More nodes without a node-id than this are not looked for.
const MOST_FRESH: usize = 16;

/// Where to look, and for how long.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// How long to listen for heartbeats, in seconds
    #[arg(long, default_value_t = 1.0, value_parser = seconds, value_name = "SECONDS")]
    pub time: f64,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
    /// The bus
    #[command(flatten)]
    pub bus: BusOptions,
}

fn seconds(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|s| (0.1..=60.0).contains(s));
    number.ok_or_else(|| "take 0.1 to 60 seconds".to_owned())
}

/// One node.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
struct Found {
    node: u8,
    state: Option<String>,
    device_type: Option<u32>,
    profile: Option<u32>,
    name: Option<String>,
    vendor_id: Option<u32>,
    product_code: Option<u32>,
    revision_number: Option<u32>,
    serial_number: Option<u32>,
    channel: Option<char>,
    /// Node-id that it takes for the other channel's.
    peer: Option<u8>,
    /// The other channel, where both name each other.
    pair: Option<u8>,
    reason: Option<String>,
}

/// Looks and prints.
///
/// Errors: see [`CommissionError`]; nobody at all is one that states why.
pub fn run(arguments: &Arguments) -> Result<ExitCode, CommissionError> {
    let mut bus = arguments.bus.join().map_err(Fault::from)?;
    let time = Duration::from_secs_f64(arguments.time);
    let heard = survey(&mut bus, time).map_err(Fault::bus)?;
    let mut nodes = Vec::new();
    for node in heard.nodes() {
        nodes.push(found(&mut bus, &heard, node)?);
    }
    pair(&mut nodes);
    let fresh = match heard.unconfigured {
        true => Master::new(&mut bus).fastscan_all(MOST_FRESH),
        false => Ok(Vec::new()),
    };
    let fresh = fresh.map_err(Fault::from)?;
    if nodes.is_empty() && fresh.is_empty() {
        return Err(Fault::nobody(&mut bus).into());
    }
    let more = fresh.len() >= MOST_FRESH;
    let answer = Answer {
        format: "plumb-scan",
        json: arguments.json,
    };
    let content = content(&nodes, &fresh, more);
    answer.show(&bus, content, || text(&nodes, &fresh))?;
    Ok(ExitCode::SUCCESS)
}

/// What one node reports of itself.
fn found(bus: &mut Bus, heard: &Survey, id: u8) -> Result<Found, Fault> {
    let mut found = Found {
        node: id,
        state: heard
            .heartbeats
            .get(&id)
            .map(|told| words::told(*told).into_owned()),
        ..Found::default()
    };
    let Some(device_type) = heard.answers.get(&id) else {
        found.reason = Some("its SDO server does not answer".to_owned());
        return Ok(found);
    };
    found.device_type = *device_type;
    found.profile = device_type.map(|kind| kind & 0xFFFF);
    let mut node = Node::new(bus, id);
    found.name = node
        .try_read(0x1008, 0)?
        .ok()
        .map(|bytes| printable(&String::from_utf8_lossy(&bytes)));
    found.vendor_id = node.number(0x1018, 1)?;
    found.product_code = node.number(0x1018, 2)?;
    found.revision_number = node.number(0x1018, 3)?;
    found.serial_number = node.number(0x1018, 4)?;
    let channel = found.product_code.and_then(nodes::channel_of);
    found.channel = channel.map(codes::dictionary::letter);
    if found.channel.is_some() {
        found.peer = node.peer()?;
    }
    Ok(found)
}

/// Two channels, A and B, that name each other are one instrument.
fn pair(nodes: &mut [Found]) {
    let named: Vec<_> = nodes.iter().map(|n| (n.node, n.channel, n.peer)).collect();
    for node in nodes {
        let mutual = named.iter().find(|(other, channel, peer)| {
            node.peer == Some(*other)
                && *peer == Some(node.node)
                && channel.is_some()
                && *channel != node.channel
        });
        node.pair = mutual.map(|(other, ..)| *other);
    }
}

fn content(nodes: &[Found], fresh: &[Identity], more: bool) -> impl Serialize {
    let fresh = fresh.iter().map(|identity| {
        object! {
            vendor_id: identity[0],
            product_code: identity[1],
            revision_number: identity[2],
            serial_number: identity[3],
        }
    });
    object! {
        nodes: nodes,
        unconfigured: fresh.collect::<Vec<_>>(),
        // There may be more of them.
        unconfigured_more: more,
    }
}

fn text(nodes: &[Found], fresh: &[Identity]) -> String {
    let columns = [
        "node", "state", "profile", "name", "vendor", "product", "revision", "serial",
    ];
    let mut columns: Vec<_> = columns.into_iter().map(Column::text).collect();
    columns.push(Column::text("pair"));
    let mut table = Table::new("", columns);
    for node in nodes {
        table.rows.push(row(node));
    }
    for [vendor, product, revision, serial] in fresh {
        let mut row = vec![Cell::text("-"), Cell::text("no node-id")];
        row.extend([Cell::text(""), Cell::text("")]);
        let numbers = [vendor, product, revision, serial];
        row.extend(numbers.map(|number| Cell::text(format!("{number:08X}"))));
        table.rows.push(row);
    }
    if !fresh.is_empty() {
        let sentence = "Give nodes without a node-id one with `plumb node-id`.";
        table.notes.push(sentence.to_owned());
    }
    table.to_text()
}

fn row(node: &Found) -> Vec<Cell> {
    let hex = |number: Option<u32>| number.map_or("-".to_owned(), |n| format!("{n:08X}"));
    let pair = match (node.pair, node.peer) {
        (Some(other), _) => format!("with node {other}"),
        (None, Some(peer)) => format!("looks for node {peer}"),
        (None, None) => node.reason.clone().unwrap_or_default(),
    };
    let profile = node
        .profile
        .map_or("-".to_owned(), |number| number.to_string());
    let mut name = node.name.clone().unwrap_or_else(|| "-".to_owned());
    if let Some(channel) = node.channel {
        name.push_str(&format!(", channel {channel}"));
    }
    vec![
        Cell::text(node.node.to_string()),
        Cell::text(node.state.as_deref().unwrap_or("no heartbeat")),
        Cell::text(profile),
        Cell::text(name),
        Cell::text(hex(node.vendor_id)),
        Cell::text(hex(node.product_code)),
        Cell::text(hex(node.revision_number)),
        Cell::text(hex(node.serial_number)),
        Cell::text(pair),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(node: u8, channel: Option<char>, peer: u8) -> Found {
        Found {
            node,
            channel,
            peer: Some(peer),
            ..Found::default()
        }
    }

    #[test]
    fn two_channels_that_name_each_other_are_a_pair() {
        let mut nodes = [
            node(1, Some('A'), 2),
            node(2, Some('B'), 1),
            node(3, Some('A'), 1),
            node(4, Some('A'), 5),
            node(5, Some('A'), 4),
        ];
        pair(&mut nodes);
        let pairs = nodes.map(|node| node.pair);
        assert_eq!(pairs, [Some(2), Some(1), None, None, None]);
    }
}
