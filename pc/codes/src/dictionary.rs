//! The rows as documents need them: objects with their sub-indices, names, values as text.
//!
//! In: rows, sorted. Out: one [`Object`] per index with one [`Entry`] per sub-index, runs spread
//! out. Names of entries are unique within their object, because tools look objects up by name.
//!
//! Left out: the syntax of any one document.

use std::num::NonZeroU8;

use canopen::object::{Access, DataType};
use device::objects::row::{Default, Row, Shape};
use device::objects::table::Channel;

/// One index.
#[derive(Clone, Debug)]
pub struct Object<'a> {
    /// The row at sub-index 0, which names the object.
    pub head: &'a Row,
    /// What is behind each sub-index, 0 included, ascending.
    pub entries: Vec<Entry<'a>>,
}

/// One sub-index.
#[derive(Clone, Debug)]
pub struct Entry<'a> {
    /// Sub-index.
    pub sub: u8,
    /// Name, unique within the object.
    pub name: String,
    /// Its row, which it may share with its neighbours.
    pub row: &'a Row,
    /// Index and sub-index of its bit-inverted twin, when it is the plain half of a pair that
    /// an SRDO carries.
    pub inverted: Option<(u16, u8)>,
}

/// All objects, in the order of the rows.
pub fn objects(rows: &[Row]) -> Vec<Object<'_>> {
    let same_index = |one: &Row, next: &Row| one.index == next.index;
    let groups = rows.chunk_by(same_index);
    groups
        .filter_map(|group| Some((group, group.first()?)))
        .map(|(group, head)| Object {
            head,
            entries: entries(rows, group),
        })
        .collect()
}

fn entries<'a>(rows: &'a [Row], group: &'a [Row]) -> Vec<Entry<'a>> {
    let subs = group
        .iter()
        .flat_map(|row| (row.sub..=row.last).map(move |sub| (sub, row)));
    subs.map(|(sub, row)| Entry {
        sub,
        name: name(group, row, sub),
        row,
        inverted: inverted_twin(rows, row),
    })
    .collect()
}

fn name(group: &[Row], row: &Row, sub: u8) -> String {
    match row.shape {
        Shape::Var => row.name.to_owned(),
        Shape::Array | Shape::Record if row.access.has(Access::WRITE) => {
            "Number of entries".to_owned()
        }
        Shape::Array | Shape::Record => "Highest sub-index supported".to_owned(),
        Shape::Member => {
            let namesakes = group
                .iter()
                .filter(|other| other.name == row.name && matches!(other.shape, Shape::Member));
            let taken: usize = namesakes.map(|r| usize::from(r.last - r.sub) + 1).sum();
            if taken > 1 {
                axis(row, sub).unwrap_or_else(|| format!("{} {sub}", row.name))
            } else {
                row.name.to_owned()
            }
        }
    }
}

/// A run that is called "... X" is one quantity along three axes.
fn axis(row: &Row, sub: u8) -> Option<String> {
    let stem = row.name.strip_suffix('X').filter(|_| row.last > row.sub)?;
    let letter = ['X', 'Y', 'Z'].get(usize::from(sub.checked_sub(row.sub)?))?;
    Some(format!("{stem}{letter}"))
}

/// The name of a sub-index of `row`, unique within its object.
pub fn entry_name(rows: &[Row], row: &Row, sub: u8) -> String {
    let first = rows.partition_point(|other| other.index < row.index);
    let end = rows.partition_point(|other| other.index <= row.index);
    name(rows.get(first..end).unwrap_or(&[]), row, sub)
}

/// The rows put the inverted twin right behind its plain half and call it inverted.
fn inverted_twin(rows: &[Row], row: &Row) -> Option<(u16, u8)> {
    let is_inverted = |row: &Row| row.name.to_lowercase().contains("inverted");
    let place = rows
        .iter()
        .position(|r| (r.index, r.sub) == (row.index, row.sub))?;
    let next = rows.get(place + 1)?;
    let pair = [row, next].iter().all(|r| r.access.has(Access::SRDO));
    (pair && !is_inverted(row) && is_inverted(next)).then_some((next.index, next.sub))
}

/// The row of a sub-index.
pub fn row(rows: &[Row], index: u16, sub: u8) -> Option<&Row> {
    rows.iter()
        .find(|row| row.index == index && (row.sub..=row.last).contains(&sub))
}

/// What a number is after delivery, on this channel with this node-id; `None` for what is
/// measured, for strings and for DOMAINs.
pub fn delivered(row: &Row, channel: Channel, node_id: u8) -> Option<i64> {
    match row.default {
        Default::None | Default::Text(_) => None,
        Default::Value(number) => Some(number),
        Default::NodeId(number) => Some(number + i64::from(node_id)),
        Default::Channel(a, b) => Some(match channel {
            Channel::A => a,
            Channel::B => b,
        }),
    }
}

/// What the object at `index` and `sub` is after delivery; 0 where nothing is.
pub fn delivered_at(rows: &[Row], index: u16, sub: u8, channel: Channel, node_id: u8) -> i64 {
    row(rows, index, sub)
        .and_then(|row| delivered(row, channel, node_id))
        .unwrap_or(0)
}

/// A number of this row: counted quantities decimal, bit patterns and identifiers hexadecimal.
pub fn number(row: &Row, number: i64) -> String {
    let wide = row.data_type.size().filter(|bytes| *bytes > 1);
    match wide {
        Some(bytes) if row.unit.is_empty() && !row.data_type.is_signed() => {
            format!("0x{number:0width$X}", width = 2 * bytes)
        }
        _ => number.to_string(),
    }
}

/// The default as an EDS has it; `None` where the row has none, or must not be written back.
pub fn default_text(row: &Row, channel: Channel) -> Option<String> {
    match row.default {
        _ if row.acts => None,
        Default::None => None,
        Default::Text(text) => Some(text.to_owned()),
        Default::NodeId(base) => Some(format!("$NODEID+0x{base:X}")),
        Default::Value(_) | Default::Channel(..) => {
            delivered(row, channel, channel.node_id()).map(|n| number(row, n))
        }
    }
}

/// Lowest and highest number that the type holds; `None` for strings and DOMAINs.
pub fn span(data_type: DataType) -> Option<(i64, i64)> {
    if data_type == DataType::Boolean {
        return Some((0, 1));
    }
    let bits = NonZeroU8::new(u8::try_from(8 * data_type.size()?).ok()?)?.get();
    Some(match (data_type.is_signed(), bits) {
        (false, 64..) => (0, i64::MAX),
        (true, _) => (-(1 << (bits - 1)), (1 << (bits - 1)) - 1),
        (false, _) => (0, (1 << bits) - 1),
    })
}

/// The type as CiA 301 spells it.
pub fn type_name(data_type: DataType) -> &'static str {
    match data_type {
        DataType::Boolean => "BOOLEAN",
        DataType::Integer8 => "INTEGER8",
        DataType::Integer16 => "INTEGER16",
        DataType::Integer24 => "INTEGER24",
        DataType::Integer32 => "INTEGER32",
        DataType::Unsigned8 => "UNSIGNED8",
        DataType::Unsigned16 => "UNSIGNED16",
        DataType::Unsigned24 => "UNSIGNED24",
        DataType::Unsigned32 => "UNSIGNED32",
        DataType::Unsigned64 => "UNSIGNED64",
        DataType::VisibleString => "VISIBLE_STRING",
        DataType::OctetString => "OCTET_STRING",
        DataType::Domain => "DOMAIN",
    }
}

/// The access as CiA 306 spells it: `rwr` is writable and goes into TPDOs, `rww` is writable and
/// comes from RPDOs.
pub fn access_name(access: Access) -> &'static str {
    let [read, write, constant] =
        [Access::READ, Access::WRITE, Access::CONST].map(|one| access.has(one));
    let [sent, received] = [Access::TPDO, Access::RPDO].map(|one| access.has(one));
    match (read, write) {
        _ if constant => "const",
        (true, false) => "ro",
        (false, _) => "wo",
        (true, true) if sent && !received => "rwr",
        (true, true) if received && !sent => "rww",
        (true, true) => "rw",
    }
}

/// The letter of a channel.
pub fn letter(channel: Channel) -> char {
    match channel {
        Channel::A => 'A',
        Channel::B => 'B',
    }
}
