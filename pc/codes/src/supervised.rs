//! 1016h: which node is supervised, and how long its heartbeat may stay away, in one number.
//!
//! In: the number, or a text as "2:500ms" or "node 2, 500 ms". Out: the text, or node and time.
//!
//! Left out: units of time, and numbers in hexadecimal, which every object takes (`value`).

use device::objects::row::{Row, Shape};

/// Node-ids and milliseconds that supervise a node; any other number supervises none.
const NODES: std::ops::RangeInclusive<i64> = 1..=127;
const TIMES: std::ops::RangeInclusive<i64> = 1..=0xFFFF;

/// Whether a row is of this kind.
pub fn is_one(row: &Row) -> bool {
    row.index == 0x1016 && matches!(row.shape, Shape::Member)
}

/// What the number means.
pub fn text(raw: i64) -> String {
    let (node, time) = (raw >> 16 & 0xFF, raw & 0xFFFF);
    match (NODES.contains(&node) && TIMES.contains(&time), raw) {
        (true, _) => format!("node {node}, {time} ms"),
        (false, 0) => "no node".to_owned(),
        (false, _) => format!("no node (0x{raw:08X})"),
    }
}

/// The node of a text, and the text of its time, empty for no node; `None` where it is not both.
pub fn split(text: &str) -> Option<(i64, &str)> {
    if ["0", "no node"].contains(&text) {
        return Some((0, ""));
    }
    let (node, time) = text.split_once([':', ','])?;
    let node = node.trim();
    let node = node.strip_prefix("node").unwrap_or(node).trim();
    Some((node.parse().ok()?, time.trim()))
}

/// The number of a node and a time, ms; `None` where one of them is out of range.
pub fn number(node: i64, time_ms: i64) -> Option<i64> {
    let fit = NODES.contains(&node) && TIMES.contains(&time_ms);
    fit.then_some(node << 16 | time_ms)
}
