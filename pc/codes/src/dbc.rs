//! A DBC of what both nodes send with the mapping as delivered, for CAN tools without CANopen.
//!
//! In: the rows. Out: one message per TPDO that carries something, of channel A under node-id 1 and
//! channel B under node-id 2, with a signal per mapped object: scale, unit, range, receivers, names
//! of values, texts. A TPDO that is off as delivered is there under the identifier that it has once
//! it is switched on, and its comment states this. ASCII, CRLF.
//!
//! Left out: SDO, EMCY, heartbeat and SRDO (their content is not fixed signals, or is off as
//! delivered), and any mapping but the delivered one.

use std::fmt::Write as _;

use canopen::object::DataType;
use device::objects::row::Row;
use device::objects::table::Channel;

use super::dictionary;
use super::meaning::{self, Scale};

/// Whoever else listens.
const MASTER: &str = "Master";
/// Bit 31 of a COB-ID: the PDO is off (CiA 301).
const OFF: i64 = 1 << 31;
/// The identifier within a COB-ID.
const IDENTIFIER: i64 = 0x7FF;
/// PDO parameters that may exist (CiA 301).
const PDOS: u16 = 0x200;
/// Objects that a PDO may map.
const MAPPED: u8 = 64;

/// One TPDO.
struct Message<'a> {
    id: i64,
    /// It is sent as delivered.
    is_on: bool,
    name: String,
    sender: String,
    receivers: String,
    signals: Vec<Signal<'a>>,
}

/// One mapped object.
struct Signal<'a> {
    name: String,
    start: u32,
    bits: u32,
    scale: Scale,
    row: &'a Row,
    sub: u8,
}

/// The database of both nodes.
pub fn database(rows: &[Row]) -> String {
    let messages: Vec<_> = [Channel::A, Channel::B]
        .into_iter()
        .flat_map(|channel| (0..PDOS).filter_map(move |pdo| message(rows, channel, pdo)))
        .collect();
    let mut text = String::from("VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: ");
    let nodes = [MASTER, &node(Channel::A), &node(Channel::B)].join(" ");
    let _ = writeln!(text, "{nodes}\n");
    for message in &messages {
        text.push_str(&layout(message));
    }
    text.push_str("CM_ \"Made by plumb describe dbc: node-ids and mapping as delivered.\";\n");
    for message in &messages {
        text.push_str(&comments(message));
    }
    for message in &messages {
        text.push_str(&values(message));
    }
    text.replace('\n', "\r\n")
}

fn node(channel: Channel) -> String {
    format!("Plumb_{}", dictionary::letter(channel))
}

/// TPDO `pdo`, counted from 0; `None` when there is none or it carries nothing.
fn message(rows: &[Row], channel: Channel, pdo: u16) -> Option<Message<'_>> {
    let at = |index, sub| dictionary::delivered_at(rows, index, sub, channel, channel.node_id());
    dictionary::row(rows, 0x1800 + pdo, 1)?;
    let cob_id = at(0x1800 + pdo, 1);
    let count = at(0x1A00 + pdo, 0).clamp(0, i64::from(MAPPED)) as u8;
    if count == 0 {
        return None;
    }
    let id = cob_id & IDENTIFIER;
    let mapped = (1..=count).map(|sub| at(0x1A00 + pdo, sub));
    Some(Message {
        id,
        is_on: cob_id & OFF == 0,
        name: format!("{}_TPDO_{}", node(channel), pdo + 1),
        sender: node(channel),
        receivers: receivers(rows, channel, id),
        signals: signals(rows, mapped),
    })
}

/// The master, and the other channel where one of its RPDOs takes this identifier.
fn receivers(rows: &[Row], sender: Channel, id: i64) -> String {
    let other = match sender {
        Channel::A => Channel::B,
        Channel::B => Channel::A,
    };
    let mut rpdos = 0x1400..0x1400 + PDOS;
    let takes =
        rpdos.any(|index| dictionary::delivered_at(rows, index, 1, other, other.node_id()) == id);
    if takes {
        format!("{MASTER},{}", node(other))
    } else {
        MASTER.to_owned()
    }
}

fn signals(rows: &[Row], mapped: impl Iterator<Item = i64>) -> Vec<Signal<'_>> {
    let mut start = 0;
    let mut signals = Vec::new();
    for entry in mapped {
        let bits = (entry & 0xFF) as u32;
        let sub = (entry >> 8) as u8;
        if let Some(row) = dictionary::row(rows, (entry >> 16) as u16, sub) {
            signals.push(Signal {
                name: identifier(&dictionary::entry_name(rows, row, sub)),
                start,
                bits,
                scale: meaning::scale(rows, row),
                row,
                sub,
            });
        }
        start += bits;
    }
    signals
}

/// A name as C spells it, which is what the format asks for.
fn identifier(name: &str) -> String {
    let spelled = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    name.chars().map(spelled).collect()
}

fn layout(message: &Message<'_>) -> String {
    let bits: u32 = message.signals.iter().map(|signal| signal.bits).sum();
    let (id, name, sender) = (message.id, &message.name, &message.sender);
    let mut text = format!("BO_ {id} {name}: {} {sender}\n", bits.div_ceil(8));
    for signal in &message.signals {
        let sign = if signal.row.data_type.is_signed() {
            '-'
        } else {
            '+'
        };
        let Scale { factor, unit } = &signal.scale;
        let (low, high) = range(signal.row.data_type, *factor);
        let (name, start, bits) = (&signal.name, signal.start, signal.bits);
        let receivers = &message.receivers;
        let place = format!("{start}|{bits}@1{sign}");
        let meaning = format!("({factor},0) [{low}|{high}] \"{unit}\"");
        let _ = writeln!(text, " SG_ {name} : {place} {meaning} {receivers}");
    }
    text.push('\n');
    text
}

/// What the type can hold, scaled; nine decimals are more than any unit here has.
fn range(data_type: DataType, factor: f64) -> (f64, f64) {
    let (low, high) = dictionary::span(data_type).unwrap_or_default();
    let scaled = |number: i64| (number as f64 * factor * 1e9).round() / 1e9;
    (scaled(low), scaled(high))
}

fn comments(message: &Message<'_>) -> String {
    let mut text = String::new();
    if !message.is_on {
        let _ = writeln!(text, "CM_ BO_ {} \"Off as delivered.\";", message.id);
    }
    for signal in &message.signals {
        let place = format!("{:04X}h sub {}", signal.row.index, signal.sub);
        let doc = signal.row.doc.replace('"', "'");
        let (id, name) = (message.id, &signal.name);
        let _ = writeln!(text, "CM_ SG_ {id} {name} \"{place}: {doc}\";");
    }
    text
}

fn values(message: &Message<'_>) -> String {
    let mut text = String::new();
    for signal in &message.signals {
        let named = meaning::names(signal.row);
        if named.is_empty() {
            continue;
        }
        let _ = write!(text, "VAL_ {} {}", message.id, signal.name);
        for (number, name) in named {
            let _ = write!(text, " {number} \"{name}\"");
        }
        text.push_str(" ;\n");
    }
    text
}
