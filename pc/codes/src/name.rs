//! Names of objects for the command line, made from the dictionary's rows.
//!
//! In: `slope-long.preset`, `heartbeat`, `uncertainty`, `6012h`, `0x1018:1`. Out: the objects
//! meant, or the names that are nearest. The rule:
//!
//! - An object's name is its row's in small letters with hyphens: `producer-heartbeat-time`.
//! - A member stands behind a point, without what it shares with its object: `uncertainty.x`, or
//!   by its sub-index: `uncertainty.1`.
//! - The 32-bit slopes are `slope-long` and `slope-lateral`, the 16-bit ones `slope-long16` and
//!   `slope-lateral16`; their parameters are members: `slope-long.preset`.
//! - What 6800h and above tell of the other channel begins with `other.`.
//! - An object with members means all of them where it is read.
//! - A few objects have a short name besides ([`SHORT`]).
//! - An address is an index in hexadecimal, and a sub-index behind `.` or `:`.
//!
//! Left out: names of bits, and guesses: a name that is not known is never taken for another.

use device::objects::row::{Row, Shape};
use device::objects::table;

use crate::dictionary::{self, Object};
use output::printable;

/// Short names for what is used daily.
pub const SHORT: [(&str, u16, u8); 11] = [
    ("device-name", 0x1008, 0),
    ("hardware-version", 0x1009, 0),
    ("software-version", 0x100A, 0),
    ("heartbeat", 0x1017, 0),
    ("vendor-id", 0x1018, 1),
    ("product-code", 0x1018, 2),
    ("revision-number", 0x1018, 3),
    ("serial-number", 0x1018, 4),
    ("startup", 0x1F80, 0),
    ("peer", 0x2001, 0),
    ("temperature", 0x6511, 0),
];

/// First index of what is told of the other channel, and the index behind the last one.
const OTHER: std::ops::Range<u16> = 0x6800..0x7000;

/// How many near names an error lists.
const NEAR: usize = 4;

/// One sub-index and its name.
#[derive(Clone, Debug)]
pub struct Named {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// The name, or the address where our dictionary has no such object.
    pub name: String,
    /// Its row; `None` where our dictionary has no such object.
    pub row: Option<&'static Row>,
}

impl Named {
    /// "6112h" or "1018h:1".
    pub fn address(&self) -> String {
        address(self.index, self.sub)
    }
}

/// "6112h" or "1018h:1".
pub fn address(index: u16, sub: u8) -> String {
    match sub {
        0 => format!("{index:04X}h"),
        _ => format!("{index:04X}h:{sub}"),
    }
}

/// Why a name means nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// Nothing has this name; those that are near.
    #[error("no object is called {0:?}{a} `plumb get --list` prints all names", a = nearest(.1))]
    Unknown(String, Vec<String>),
    /// It has members, of which one has to be named.
    #[error("{0} has several members: name one of {a}", a = .1.join(", "))]
    Members(String, Vec<String>),
}

fn nearest(names: &[String]) -> String {
    match names {
        [] => ":".to_owned(),
        names => format!("; near are {};", names.join(", ")),
    }
}

/// Small letters, digits, and hyphens between words.
fn kebab(text: &str) -> String {
    let words = text.split(|c: char| !c.is_ascii_alphanumeric());
    let words: Vec<_> = words.filter(|word| !word.is_empty()).collect();
    words.join("-").to_ascii_lowercase()
}

/// A slope and its parameter: "Slope long32 preset value" is `slope-long.preset`.
fn slope(name: &str) -> Option<String> {
    let (differential, rest) = match name.strip_prefix("Differential slope ") {
        Some(rest) => (true, rest),
        None => (false, name.strip_prefix("Slope ")?),
    };
    let (axis, parameter) = rest.split_once(' ').unwrap_or((rest, ""));
    let axis = axis.strip_suffix("32").unwrap_or(axis);
    let parameter = kebab(parameter.trim_end_matches(" value"));
    Some(match (differential, parameter.as_str()) {
        (_, "") => format!("slope-{axis}"),
        (true, parameter) => format!("slope-{axis}.differential-{parameter}"),
        (false, parameter) => format!("slope-{axis}.{parameter}"),
    })
}

/// The name of a whole object.
fn object_name(object: &Object) -> String {
    let name = object.head.name;
    let name = slope(name).unwrap_or_else(|| kebab(name));
    match OTHER.contains(&object.head.index) {
        true => format!("other.{name}"),
        false => name,
    }
}

/// The name of a member behind the point.
fn member_name(object: &str, member: &str) -> String {
    let member = kebab(member);
    let shared = member.strip_prefix(object);
    let rest = shared.and_then(|rest| rest.strip_prefix('-'));
    rest.map_or(member.clone(), str::to_owned)
}

/// Every sub-index of the dictionary with its name, ascending.
pub fn all() -> Vec<Named> {
    let objects = dictionary::objects(table::rows());
    objects.iter().flat_map(members).collect()
}

/// The sub-indices of one object.
fn members(object: &Object<'static>) -> Vec<Named> {
    let whole = object_name(object);
    let entries = object.entries.iter();
    entries
        .map(|entry| Named {
            index: object.head.index,
            sub: entry.sub,
            name: match entry.row.shape {
                Shape::Var => whole.clone(),
                _ => format!("{whole}.{}", member_name(&whole, &entry.name)),
            },
            row: Some(entry.row),
        })
        .collect()
}

/// The objects that a name or an address means: one, or all members of an object.
///
/// Errors: [`NameError::Unknown`].
pub fn find(text: &str) -> Result<Vec<Named>, NameError> {
    let text = text.trim();
    let wanted = text.to_ascii_lowercase();
    let objects = dictionary::objects(table::rows());
    if let Some((_, index, sub)) = SHORT.iter().find(|(short, ..)| *short == wanted) {
        return Ok(at(&objects, *index, Some(*sub)));
    }
    for object in &objects {
        let whole = object_name(object);
        let Some(rest) = wanted.strip_prefix(whole.as_str()) else {
            continue;
        };
        let named = members(object);
        if rest.is_empty() {
            return Ok(shown(object, named));
        }
        let sub = rest
            .strip_prefix('.')
            .and_then(|rest| rest.parse::<u8>().ok());
        let found = named
            .into_iter()
            .find(|one| one.name == wanted || sub == Some(one.sub));
        if let Some(found) = found {
            return Ok(vec![found]);
        }
    }
    match parse_address(text) {
        Some((index, sub)) => Ok(at(&objects, index, sub)),
        None => Err(NameError::Unknown(printable(text), near(&wanted))),
    }
}

/// The one object that a name means.
///
/// Errors: see [`NameError`].
pub fn one(text: &str) -> Result<Named, NameError> {
    let mut found = find(text)?;
    if found.len() > 1 {
        let members = found.iter().map(|one| one.name.clone()).collect();
        return Err(NameError::Members(printable(text), members));
    }
    let unknown = || NameError::Unknown(printable(text), Vec::new());
    found.pop().ok_or_else(unknown)
}

/// What of an object is shown when it is named as a whole: its count means nothing.
fn shown(object: &Object, mut named: Vec<Named>) -> Vec<Named> {
    if !matches!(object.head.shape, Shape::Var) {
        named.retain(|one| one.sub > 0);
    }
    named
}

/// What stands at an address.
fn at(objects: &[Object<'static>], index: u16, sub: Option<u8>) -> Vec<Named> {
    let object = objects.iter().find(|object| object.head.index == index);
    let named = object.map(members).unwrap_or_default();
    match (object, sub) {
        (Some(object), None) => shown(object, named),
        _ => {
            let sub = sub.unwrap_or(0);
            let known = named.into_iter().find(|one| one.sub == sub);
            vec![known.unwrap_or_else(|| Named {
                index,
                sub,
                name: address(index, sub),
                row: None,
            })]
        }
    }
}

/// The digits behind "0x".
pub(crate) fn hex(text: &str) -> Option<&str> {
    text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"))
}

/// `6012`, `6012h`, `0x6012`, each with `.1`, `:1`, `.0x1` or nothing behind it.
fn parse_address(text: &str) -> Option<(u16, Option<u8>)> {
    let (index, sub) = match text.split_once([':', '.']) {
        Some((index, sub)) => (index, Some(sub)),
        None => (text, None),
    };
    let index = hex(index).map_or_else(
        || index.trim_end_matches(['h', 'H']).to_owned(),
        str::to_owned,
    );
    let digits = index.len() == 4 && index.chars().all(|c| c.is_ascii_hexdigit());
    let index = u16::from_str_radix(&index, 16).ok().filter(|_| digits)?;
    let sub = match sub {
        None => None,
        Some(sub) => Some(match (hex(sub), sub.strip_suffix(['h', 'H'])) {
            (Some(digits), _) | (None, Some(digits)) => u8::from_str_radix(digits, 16).ok()?,
            (None, None) => sub.parse().ok()?,
        }),
    };
    Some((index, sub))
}

/// Names near to what was written: those with all of its words, then those that are alike.
fn near(wanted: &str) -> Vec<String> {
    let words: Vec<&str> = wanted.split(['-', '.', '_', ' ']).collect();
    let objects = dictionary::objects(table::rows());
    let mut names: Vec<String> = SHORT
        .iter()
        .map(|(short, ..)| (*short).to_owned())
        .collect();
    for object in &objects {
        names.push(object_name(object));
        names.extend(members(object).into_iter().map(|one| one.name));
    }
    names.dedup();
    let score = |name: &String| {
        let has_all = words.iter().all(|word| name.contains(word));
        let parts = name.split('.').chain([name.as_str()]);
        let alike = parts.map(|part| strsim::jaro_winkler(wanted, part));
        let alike = alike.fold(0.0, f64::max);
        // Whoever leaves that away means this channel, and its slopes in full.
        let aside = name.starts_with("other.") || name.contains("16");
        alike + if has_all { 1.0 } else { 0.0 } - if aside { 0.1 } else { 0.0 }
    };
    let mut scored: Vec<_> = names.into_iter().map(|name| (score(&name), name)).collect();
    scored.retain(|(score, _)| *score > 0.8);
    scored.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
    scored.dedup_by(|one, other| one.1 == other.1);
    let best = scored.into_iter().take(NEAR);
    best.map(|(_, name)| name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    fn addresses(text: &str) -> Vec<(u16, u8)> {
        let found = find(text).unwrap_or_default();
        found.iter().map(|one| (one.index, one.sub)).collect()
    }

    #[test]
    fn every_sub_index_has_a_name_of_its_own_that_finds_it() {
        let mut seen = BTreeMap::new();
        for one in all() {
            let before = seen.insert(one.name.clone(), one.address());
            assert_eq!(before, None, "{} is also {}", one.name, one.address());
            assert_eq!(addresses(&one.name), [(one.index, one.sub)], "{}", one.name);
            let legal = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-.".contains(c);
            assert!(one.name.chars().all(legal), "{}", one.name);
        }
        assert!(seen.len() > 350, "{}", seen.len());
    }

    #[test]
    fn every_address_finds_itself_however_it_is_written() {
        for one in all() {
            let (index, sub) = (one.index, one.sub);
            for text in [
                format!("{index:04X}.{sub}"),
                format!("{index:04x}h:{sub}"),
                format!("0x{index:04X}:0x{sub:X}"),
            ] {
                assert_eq!(addresses(&text), [(index, sub)], "{text}");
            }
        }
    }

    #[test]
    fn short_names_mean_what_is_there_and_hide_nothing() {
        let names: Vec<String> = all().into_iter().map(|one| one.name).collect();
        for (short, index, sub) in SHORT {
            let found = find(short).unwrap();
            assert!(found[0].row.is_some(), "{short}");
            assert_eq!(addresses(short), [(index, sub)]);
            assert!(!names.contains(&short.to_owned()), "{short}");
        }
    }

    #[test]
    fn the_names_that_people_use() {
        for (name, at) in [
            ("slope-long", (0x6110, 0)),
            ("slope-long.preset", (0x6112, 0)),
            ("slope-lateral16.preset", (0x6022, 0)),
            ("slope-long.differential-offset", (0x6114, 0)),
            ("slope-lateral.operating-parameter", (0x6121, 0)),
            ("other.slope-long.offset", (0x6913, 0)),
            ("other.resolution", (0x6800, 0)),
            ("resolution", (0x6000, 0)),
            ("heartbeat", (0x1017, 0)),
            ("consumer-heartbeat-time.1", (0x1016, 1)),
            ("uncertainty.x", (0x2022, 1)),
            ("uncertainty.2", (0x2022, 2)),
            ("sync-fallback.time-out", (0x2050, 1)),
            ("fault-log", (0x2070, 0)),
            ("black-box.1", (0x2071, 1)),
            ("residual.y", (0x2028, 2)),
            ("1F51:1", (0x1F51, 1)),
        ] {
            assert_eq!(addresses(name), [at], "{name}");
        }
        assert_eq!(
            addresses("verdict"),
            [(0x2027, 1), (0x2027, 2), (0x2027, 3)]
        );
        assert_eq!(addresses("2F00:3"), [(0x2F00, 3)]);
    }

    #[test]
    fn an_unknown_name_is_answered_with_the_nearest() {
        let near = |text: &str| match find(text).unwrap_err() {
            NameError::Unknown(_, near) => near,
            other => panic!("{other:?}"),
        };
        assert!(near("preset").contains(&"slope-long.preset".to_owned()));
        assert!(near("prest").contains(&"slope-long.preset".to_owned()));
        assert!(near("heartbaet").contains(&"heartbeat".to_owned()));
        assert!(near("slope-lomg.preset").contains(&"slope-long.preset".to_owned()));
        assert!(near("zzzzqqq").is_empty());
    }

    #[test]
    fn an_object_with_members_is_none_to_write() {
        let told = one("uncertainty").unwrap_err().to_string();
        assert!(told.contains("uncertainty.x, uncertainty.y"), "{told}");
        assert_eq!(one("heartbeat").unwrap().address(), "1017h");
    }

    proptest! {
        #[test]
        fn any_text_is_a_name_or_none(text in ".{0,40}") {
            if let Err(error) = find(&text) {
                let line = error.to_string();
                prop_assert_eq!(line.lines().count(), 1);
            }
        }
    }
}
