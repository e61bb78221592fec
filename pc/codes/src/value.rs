//! Values as people read and write them: with a unit, by a name, or raw.
//!
//! In: a row, the bytes of an SDO, the resolution that the node has; or the text of a value. Out:
//! what to show, or the bytes to write. What the object cannot hold is refused here, before
//! anything goes out: a number outside its range, one between two of its steps, a unit of another
//! quantity.
//!
//! Left out: contents without a type (DOMAIN), which are files.

use std::borrow::Cow;

use canopen::object::DataType;
use device::objects::row::Row;
use device::objects::table::{self, Channel};

use super::name::{self, Named};
use crate::meaning::{self, Scale};
use crate::{dictionary, supervised, words};
use output::printable;

/// Units that may be written, the unit that they are counted in, and how much of it they are.
const UNITS: [(&str, &str, f64); 14] = [
    ("deg", "deg", 1.0),
    ("mdeg", "deg", 1e-3),
    ("°", "deg", 1.0),
    ("rad", "deg", 180.0 / std::f64::consts::PI),
    ("s", "s", 1.0),
    ("ms", "s", 1e-3),
    ("us", "s", 1e-6),
    ("min", "s", 60.0),
    ("g", "g", 1.0),
    ("mg", "g", 1e-3),
    ("degC", "degC", 1.0),
    ("%", "%", 1.0),
    ("kbit/s", "kbit/s", 1.0),
    ("d", "d", 1.0),
];

/// How near to a step a number has to be to be meant as that step.
const NEAR: f64 = 1e-6;

/// The object whose number a row's unit is multiplied with: 6000h, 6200h, 6800h.
pub fn depends_on(row: &Row) -> Option<u16> {
    let (index, _) = row.unit.split_once("h x ")?;
    u16::from_str_radix(index, 16).ok()
}

/// The scale of a row; `resolution` is what the object of [`depends_on`] holds.
pub fn scale(row: &Row, resolution: Option<u32>) -> Scale {
    let delivered = meaning::scale(table::rows(), row);
    let mut factor = delivered.factor;
    if let (Some(index), Some(now)) = (depends_on(row), resolution) {
        let rows = table::rows();
        let then = dictionary::delivered_at(rows, index, 0, Channel::A, 1);
        factor *= f64::from(now) / then as f64;
    }
    let unit = delivered.unit;
    Scale { factor, unit }
}

/// What an object holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// The number as it stands in the object.
    pub raw: Option<i64>,
    /// The number in its unit.
    pub value: Option<f64>,
    /// The unit, empty for none.
    pub unit: String,
    /// What is printed, unit included.
    pub text: String,
    /// Why there is no value.
    pub reason: Option<String>,
}

/// The number in bytes of a type, lowest byte first; `None` when they have another length.
fn number(data_type: DataType, bytes: &[u8]) -> Option<i64> {
    let size = data_type.size().filter(|size| *size == bytes.len())?;
    let mut wide = [0; 8];
    wide.get_mut(..size)?.copy_from_slice(bytes);
    let number = i64::from_le_bytes(wide);
    let unused = 64 - 8 * size as u32;
    Some(match data_type.is_signed() {
        true => number << unused >> unused,
        false => number,
    })
}

/// The bytes of a number that the type holds.
pub fn bytes(data_type: DataType, number: i64) -> Vec<u8> {
    let size = data_type.size().unwrap_or(0);
    number.to_le_bytes()[..size.min(8)].to_vec()
}

/// What is to be shown of these bytes.
pub fn show(named: &Named, bytes: &[u8], resolution: Option<u32>) -> Shown {
    let Some(row) = named.row else {
        return text_only(hex(bytes));
    };
    match row.data_type {
        DataType::VisibleString => text_only(printable(&String::from_utf8_lossy(bytes))),
        DataType::Domain | DataType::OctetString => text_only(format!("{} bytes", bytes.len())),
        data_type => match number(data_type, bytes) {
            Some(raw) => {
                let mut shown = show_number(row, raw, resolution);
                if supervised::is_one(row) {
                    (shown.value, shown.text) = (None, supervised::text(raw));
                } else if let Some(words) =
                    u8::try_from(raw).ok().and_then(|raw| in_words(named, raw))
                {
                    shown.text = format!("{raw} ({words})");
                }
                shown
            }
            None => text_only(format!("{} (not of the type)", hex(bytes))),
        },
    }
}

/// Numbers whose words are longer than the names in their row.
fn in_words(named: &Named, raw: u8) -> Option<Cow<'static, str>> {
    match (named.index, named.sub) {
        (0x2021, 0) => Some(words::state(raw, words::CHANNELS)),
        (0x2025, 1 | 2) | (0x2027, 2) => Some(words::reason(raw).unwrap_or("none".into())),
        _ => None,
    }
}

fn text_only(text: String) -> Shown {
    Shown {
        raw: None,
        value: None,
        unit: String::new(),
        text,
        reason: None,
    }
}

fn hex(bytes: &[u8]) -> String {
    let pairs: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    pairs.join(" ")
}

fn show_number(row: &Row, raw: i64, resolution: Option<u32>) -> Shown {
    let Scale { factor, unit } = scale(row, resolution);
    let name = meaning::name(row, raw).map(|name| name.trim_end_matches('.'));
    let none = no_value(row, raw, name);
    let (value, text) = match (&none, unit.is_empty()) {
        (Some(reason), _) => (None, reason.clone()),
        (None, true) => {
            let number = plain(row, raw);
            let text = name.map_or(number.clone(), |name| format!("{number} ({name})"));
            (Some(raw as f64), text)
        }
        (None, false) => {
            let value = raw as f64 * factor;
            (Some(value), format!("{} {unit}", decimal(value, factor)))
        }
    };
    Shown {
        raw: Some(raw),
        value,
        unit,
        text,
        reason: none,
    }
}

/// Objects of more than a byte and without a unit that count something: serial number, SYNCs,
/// samples, overruns, bus-offs, bytes of a program.
const COUNTS: [(u16, u8); 7] = [
    (0x1018, 4),
    (0x2026, 1),
    (0x2026, 2),
    (0x2032, 0),
    (0x2052, 5),
    (0x2052, 6),
    (0x2080, 6),
];

/// A number without a unit: counts are decimal, patterns and identifiers hexadecimal.
fn plain(row: &Row, raw: i64) -> String {
    match COUNTS.contains(&(row.index, row.sub)) {
        true => raw.to_string(),
        false => dictionary::number(row, raw),
    }
}

/// Why this number stands for no quantity, if it does.
fn no_value(row: &Row, raw: i64, name: Option<&str>) -> Option<String> {
    let lowest = dictionary::span(row.data_type)?.0;
    // A measured slope: the parameters of a slope may have any number.
    let is_slope = row.name.to_ascii_lowercase().starts_with("slope")
        && !row.name.contains("value")
        && !row.name.contains("offset");
    if is_slope && row.data_type.is_signed() && raw == lowest {
        return Some("no valid angle".to_owned());
    }
    name.filter(|_| !row.unit.is_empty() && raw != 0)
        .map(str::to_owned)
}

/// A value with as many digits as its steps have.
pub fn decimal(value: f64, step: f64) -> String {
    let digits = (-step.log10()).ceil().clamp(0.0, 6.0);
    let text = format!("{value:.*}", digits as usize);
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
        _ => text,
    }
}

/// Why a text is no value of an object. Each has the object's name first.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ValueError {
    /// Not a number, nor one of the names that it has.
    #[error("{0}: {1:?} is {a}", a = no_number(.2))]
    NoNumber(String, String, Vec<String>),
    /// A unit that is not known, or of another quantity; the object's own.
    #[error("{0} {a}", a = wrong_unit(.1, .2))]
    Unit(String, String, String),
    /// A number without a unit, where it may be steps or a quantity; the step and the unit.
    #[error("{0}: does {1} mean {1}{2}, or so many steps? Write the unit, or use --raw")]
    Which(String, String, String),
    /// Between two steps.
    #[error("{0} cannot hold {1}: its nearest steps are {2} and {3}")]
    Between(String, String, String, String),
    /// Outside the range; lowest and highest.
    #[error("{0} cannot be {1}: it has to be {2} to {3}")]
    Range(String, String, String, String),
    /// Not a node and a time, where both are in one number.
    #[error(
        "{0} is a node and a time, and {1:?} is not: write 2:500ms, the number as stored \
         (0x000201F4), or 0 for no node"
    )]
    NodeAndTime(String, String),
    /// No number can be written there.
    #[error("{0} is no number and cannot be set so")]
    NotANumber(String),
}

fn no_number(names: &[String]) -> String {
    match names {
        [] => "no number".to_owned(),
        names => format!("neither a number nor one of {}", names.join(", ")),
    }
}

fn wrong_unit(text: &str, unit: &str) -> String {
    match unit {
        "" => format!("has no unit: leave {text:?} away"),
        unit => format!("is counted in {unit}: {text:?} is no unit of that quantity"),
    }
}

/// A whole number, decimal or hexadecimal.
fn whole(text: &str) -> Option<i64> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, text.strip_prefix('+').unwrap_or(text)),
    };
    let hex = name::hex(digits);
    let hex = hex.or_else(|| digits.strip_suffix('h').filter(|d| !d.is_empty()));
    let magnitude = match hex {
        Some(digits) if digits.starts_with(['+', '-']) => None,
        Some(digits) => i64::from_str_radix(digits, 16).ok(),
        None if digits.starts_with(['+', '-']) => None,
        None => digits.parse().ok(),
    };
    magnitude.map(|magnitude| sign * magnitude)
}

/// A number that is marked as hexadecimal: as it stands in the object, whatever that is counted
/// in.
fn hexadecimal(text: &str) -> Option<i64> {
    let digits = text.strip_prefix(['+', '-']).unwrap_or(text);
    name::hex(digits).and_then(|_| whole(text))
}

/// The number that a text means for an object, as it stands there.
///
/// Errors: see [`ValueError`].
pub fn parse(
    named: &Named,
    row: &Row,
    text: &str,
    raw: bool,
    resolution: Option<u32>,
) -> Result<i64, ValueError> {
    let text = text.trim();
    let name = || named.name.clone();
    if row.data_type.size().is_none() {
        return Err(ValueError::NotANumber(name()));
    }
    let scale = scale(row, resolution);
    let number = match hexadecimal(text) {
        Some(number) => number,
        None if raw => named_or_whole(named, row, text, raw)?,
        None if supervised::is_one(row) => node_and_time(named, text)?,
        None if scale.unit.is_empty() => named_or_whole(named, row, text, raw)?,
        None => quantity(named, &scale, text)?,
    };
    let (low, high) = limits(row);
    if (low..=high).contains(&number) {
        return Ok(number);
    }
    let with_unit = |number: i64| match scale.unit.is_empty() || raw {
        true => dictionary::number(row, number),
        false => {
            let value = decimal(number as f64 * scale.factor, scale.factor);
            format!("{value} {}", scale.unit)
        }
    };
    Err(ValueError::Range(
        name(),
        printable(text),
        with_unit(low),
        with_unit(high),
    ))
}

/// Lowest and highest number that may be written.
pub fn limits(row: &Row) -> (i64, i64) {
    let whole = dictionary::span(row.data_type).unwrap_or((0, 0));
    row.limits.unwrap_or(whole)
}

fn named_or_whole(named: &Named, row: &Row, text: &str, raw: bool) -> Result<i64, ValueError> {
    let names = if raw { Vec::new() } else { meaning::names(row) };
    let same = |name: &str| name.trim_end_matches('.').eq_ignore_ascii_case(text);
    let by_name = names.iter().find(|(_, name)| same(name));
    let number = by_name.map(|(number, _)| *number).or_else(|| whole(text));
    let names = names.iter().map(|(_, name)| (*name).to_owned()).collect();
    number.ok_or_else(|| ValueError::NoNumber(named.name.clone(), printable(text), names))
}

/// A node, and a time with its unit, in one number.
fn node_and_time(named: &Named, text: &str) -> Result<i64, ValueError> {
    let name = || named.name.clone();
    let split = supervised::split(text);
    let (node, time) = split.ok_or_else(|| ValueError::NodeAndTime(name(), printable(text)))?;
    if (node, time) == (0, "") {
        return Ok(0);
    }
    let scale = Scale {
        factor: 1.0,
        unit: "ms".to_owned(),
    };
    let time = quantity(named, &scale, time)?;
    let [low, high] = ["1:1ms", "127:65535ms"].map(str::to_owned);
    let range = || ValueError::Range(name(), printable(text), low, high);
    supervised::number(node, time).ok_or_else(range)
}

/// A number with its unit, in steps of the object.
fn quantity(named: &Named, scale: &Scale, text: &str) -> Result<i64, ValueError> {
    let name = || named.name.clone();
    let end = text.find(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c)));
    // "5e" would swallow the unit of "5eggs"; no unit begins with an e.
    let (digits, unit) = text.split_at(end.unwrap_or(text.len()));
    let value: Option<f64> = digits.trim().parse().ok().filter(|v: &f64| v.is_finite());
    let wrong = || ValueError::NoNumber(name(), printable(text), Vec::new());
    let value = value.ok_or_else(wrong)?;
    let unit = unit.trim();
    let in_unit = match unit {
        "" if value == 0.0 || scale.factor == 1.0 => value,
        "" => {
            return Err(ValueError::Which(
                name(),
                printable(text),
                scale.unit.clone(),
            ));
        }
        unit => {
            let other = || ValueError::Unit(name(), printable(unit), scale.unit.clone());
            let given = UNITS.iter().find(|(known, ..)| *known == unit);
            let own = UNITS.iter().find(|(known, ..)| *known == scale.unit);
            let (given, own) = given.zip(own).ok_or_else(other)?;
            if given.1 != own.1 {
                return Err(other());
            }
            value * given.2 / own.2
        }
    };
    let steps = in_unit / scale.factor;
    let nearest = steps.round();
    if (steps - nearest).abs() > NEAR * steps.abs().max(1.0) {
        let at = |steps: f64| {
            let value = decimal(steps * scale.factor, scale.factor);
            format!("{value} {}", scale.unit)
        };
        let (low, high) = (at(steps.floor()), at(steps.ceil()));
        return Err(ValueError::Between(name(), printable(text), low, high));
    }
    Ok(nearest as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::name;
    use proptest::prelude::*;

    fn steps(name: &str, text: &str) -> Result<i64, ValueError> {
        let named = name::one(name).unwrap();
        parse(&named, named.row.unwrap(), text, false, Some(10))
    }

    fn told(name: &str, text: &str) -> String {
        steps(name, text).unwrap_err().to_string()
    }

    fn shown(name: &str, raw: i64, resolution: u32) -> String {
        let named = name::one(name).unwrap();
        let bytes = bytes(named.row.unwrap().data_type, raw);
        show(&named, &bytes, Some(resolution)).text
    }

    #[test]
    fn units_of_one_quantity_come_to_the_same_steps() {
        assert_eq!(steps("slope-long.preset", "0deg"), Ok(0));
        assert_eq!(steps("slope-long.preset", "-12.5 deg"), Ok(-1250));
        assert_eq!(steps("slope-long.preset", "500mdeg"), Ok(50));
        assert_eq!(steps("heartbeat", "500ms"), Ok(500));
        assert_eq!(steps("heartbeat", "0.5 s"), Ok(500));
        assert_eq!(steps("heartbeat", "500"), Ok(500));
        assert_eq!(steps("inhibit-time-emcy", "1ms"), Ok(10));
        assert_eq!(steps("2040:1", "-45deg"), Ok(-45_000));
        assert_eq!(steps("cross-check", "2"), Ok(2));
        assert_eq!(steps("1014", "0x81"), Ok(0x81));
        assert_eq!(steps("13FE", "A5h"), Ok(0xA5));
    }

    #[test]
    fn what_an_object_cannot_hold_is_refused_with_its_range() {
        assert_eq!(
            told("cross-check", "3"),
            "cross-check cannot be 3: it has to be 0 to 2"
        );
        assert_eq!(
            told("sync-fallback.period", "500us"),
            "sync-fallback.period cannot be 500us: it has to be 1000 us to 1000000 us"
        );
        let between = told("slope-long.preset", "0.005deg");
        assert!(between.contains("0.00 deg and 0.01 deg"), "{between}");
        let which = told("slope-long.preset", "5");
        assert!(which.contains("--raw"), "{which}");
        let unit = told("heartbeat", "5deg");
        assert!(unit.contains("counted in ms"), "{unit}");
        assert!(told("peer", "5deg").contains("no number"));
        assert!(told("heartbeat", "soon").contains("is no number"));
        assert!(told("heartbeat", "70s").contains("0 ms to 65535 ms"));
    }

    #[test]
    fn values_are_shown_with_their_unit_or_their_name() {
        assert_eq!(shown("slope-long", -1234, 10), "-12.34 deg");
        assert_eq!(shown("slope-long", -1234, 1), "-1.234 deg");
        assert_eq!(
            shown("slope-long", i64::from(i32::MIN), 10),
            "no valid angle"
        );
        assert_eq!(shown("heartbeat", 200, 10), "200 ms");
        assert_eq!(shown("state-of-the-pair", 1, 10), "1 (both agree)");
        assert_eq!(
            shown("uncertainty.x", 65535, 10),
            "not known, or 65.535 deg and more"
        );
        assert_eq!(shown("1014", 0x81, 10), "0x00000081");
        assert_eq!(shown("temperature", -5, 10), "-5 degC");
        assert_eq!(shown("2052:5", 300, 10), "300");
        assert_eq!(shown("serial-number", 12, 10), "12");
        assert_eq!(shown("1F56:1", 0xABC, 10), "0x00000ABC");
        let foreign = name::one("2F00:1").unwrap();
        assert_eq!(show(&foreign, &[1, 0xAB], None).text, "01 AB");
    }

    proptest! {
        #[test]
        fn any_text_is_a_value_or_none(text in ".{0,30}", raw: bool) {
            for object in ["slope-long.preset", "heartbeat", "cross-check", "1014"] {
                let named = name::one(object).unwrap();
                let row = named.row.unwrap();
                if let Ok(number) = parse(&named, row, &text, raw, Some(10)) {
                    let (low, high) = limits(row);
                    prop_assert!((low..=high).contains(&number));
                }
            }
        }

        #[test]
        fn what_is_shown_can_be_written_back(raw in -9_000_i64..9_000, places in 0_u32..4) {
            let named = name::one("slope-long.preset").unwrap();
            let row = named.row.unwrap();
            let resolution = Some(10_u32.pow(places));
            let text = show(&named, &bytes(row.data_type, raw), resolution).text;
            prop_assert_eq!(parse(&named, row, &text, false, resolution), Ok(raw));
        }

        #[test]
        fn bytes_are_read_back(raw: i32) {
            let number = i64::from(raw);
            let there = bytes(DataType::Integer32, number);
            prop_assert_eq!(super::number(DataType::Integer32, &there), Some(number));
        }
    }

    fn heartbeat(text: &str) -> Result<i64, ValueError> {
        steps("1016:1", text)
    }

    #[test]
    fn a_node_and_a_time_were_one_number_of_milliseconds() {
        let named = name::one("1016:1").unwrap();
        let shown = show(&named, &0x0002_01F4_u32.to_le_bytes(), None);
        assert_eq!(shown.text, "node 2, 500 ms");
        assert_eq!((shown.raw, shown.value), (Some(0x0002_01F4), None));
        assert_eq!(shown.unit, "");
        for text in [
            "2:500ms",
            "2:0.5s",
            "node 2, 500 ms",
            "0x201F4",
            "0x000201F4",
        ] {
            assert_eq!(heartbeat(text), Ok(0x0002_01F4), "{text}");
        }
        assert_eq!(heartbeat("0"), Ok(0));
        assert_eq!(heartbeat("0x100"), Ok(0x100));
        assert_eq!(supervised::text(0), "no node");
        assert_eq!(supervised::text(0x1F4), "no node (0x000001F4)");
        assert_eq!(supervised::text(0x80_0001), "no node (0x00800001)");
    }

    #[test]
    fn a_bare_time_switched_the_supervision_off() {
        for text in ["500ms", "500", "131572", "two:500ms", ""] {
            let told = heartbeat(text).unwrap_err().to_string();
            assert!(told.contains("write 2:500ms"), "{told}");
        }
        for text in ["0:500ms", "128:500ms", "2:0ms", "2:70s"] {
            let told = heartbeat(text).unwrap_err().to_string();
            assert!(told.ends_with("has to be 1:1ms to 127:65535ms"), "{told}");
        }
        assert!(heartbeat("2:5deg").is_err());
    }
}
