//! Units and texts of a row as numbers: scale, and names of single values.
//!
//! In: a row. Out: the factor and unit that turn its number into a quantity, and the numbers
//! that its text gives a name to. The text of a row names numbers in one of two ways: a list
//! ("0 waiting, 1 agree.") that counts up from 0 or 1, or a sentence ("65535: not known.").
//!
//! Left out: names of bits.

use device::objects::row::{Row, Shape};
use device::objects::table::Channel;

use super::dictionary;

/// What one step of a number is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    /// Multiplied with the number.
    pub factor: f64,
    /// Unit of the product, empty for none.
    pub unit: String,
}

/// The scale of a row; factors that another object gives ("6000h x 0.001 deg") as delivered.
pub fn scale(rows: &[Row], row: &Row) -> Scale {
    let (steps, unit) = match row.unit.split_once("h x ") {
        Some((index, rest)) => (delivered(rows, index), rest),
        None => (1.0, row.unit),
    };
    let (factor, unit) = factor(unit);
    Scale {
        factor: steps * factor,
        unit: unit.to_owned(),
    }
}

fn delivered(rows: &[Row], index: &str) -> f64 {
    let index = u16::from_str_radix(index, 16).unwrap_or(0);
    dictionary::delivered_at(rows, index, 0, Channel::A, Channel::A.node_id()) as f64
}

/// "0.001 deg", "360 deg / 2^24", "2^-26 g", "1/256 us" or a unit alone.
fn factor(unit: &str) -> (f64, &str) {
    if let Some((whole, parts)) = unit.split_once(" / ") {
        let (factor, unit) = factor(whole);
        return (factor / number(parts).unwrap_or(1.0), unit);
    }
    match unit.split_once(' ') {
        Some((first, rest)) => number(first).map_or((1.0, unit), |factor| (factor, rest)),
        None => (1.0, unit),
    }
}

/// "0.001", "2^24" or "1/256".
fn number(text: &str) -> Option<f64> {
    if let Some((base, exponent)) = text.split_once('^') {
        let (base, exponent): (f64, i32) = (base.parse().ok()?, exponent.parse().ok()?);
        return Some(base.powi(exponent));
    }
    if let Some((over, under)) = text.split_once('/') {
        return Some(over.parse::<f64>().ok()? / under.parse::<f64>().ok()?);
    }
    text.parse().ok()
}

/// The names of the numbers of a row. The text of an array or a record is on its members, while
/// its own number counts them.
pub fn names(row: &Row) -> Vec<(i64, &'static str)> {
    match row.shape {
        Shape::Array | Shape::Record => Vec::new(),
        Shape::Var | Shape::Member => named_values(row.doc),
    }
}

/// What a row calls one number.
pub fn name(row: &Row, number: i64) -> Option<&'static str> {
    let names = names(row);
    names
        .iter()
        .find(|named| named.0 == number)
        .map(|named| named.1)
}

/// Numbers that the text of a row gives a name to, in its order.
pub fn named_values(doc: &str) -> Vec<(i64, &str)> {
    let sentences = || doc.split(". ").map(|s| s.trim_end_matches('.'));
    let listed: Vec<_> = sentences().flat_map(list).collect();
    let counts_up = listed.len() > 1
        && matches!(listed.first(), Some((0 | 1, _)))
        && listed.is_sorted_by(|one, next| one.0 + 1 == next.0);
    if counts_up {
        return listed;
    }
    sentences().filter_map(|s| named(s, ": ")).collect()
}

fn list(sentence: &str) -> impl Iterator<Item = (i64, &str)> {
    sentence.split(", ").filter_map(|item| named(item, " "))
}

/// The number before `separator`, and what follows.
fn named<'a>(text: &'a str, separator: &str) -> Option<(i64, &'a str)> {
    let (number, name) = text.split_once(separator)?;
    Some((number.parse().ok()?, name))
}
