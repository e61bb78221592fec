//! The objects of a data sheet.
//!
//! In: the bytes of an EDS or DCF. Out: [`Sheet`]. Object lists and counts are not believed: an
//! object is there when its section is. What stands twice counts as it stands first.

use std::collections::BTreeMap;

use serde::{Serialize, Serializer};

use super::ini::{self, Line};
use super::number::{self, Form, Number};

/// Warnings that are kept; of more only the number.
const MOST_WARNINGS: usize = 100;

/// An object, or a member of one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Object {
    /// `ParameterName`.
    pub name: String,
    /// `DataType` (CiA 301, table 44); 0 where it is missing.
    pub data_type: u16,
    /// `DefaultValue`.
    pub default: Option<Number>,
    /// `ParameterValue`, which a DCF has.
    pub value: Option<Number>,
    /// The line of its section.
    pub line: u32,
}

impl Object {
    /// What it is configured to be, else what it is delivered with.
    pub fn number(&self) -> Option<Number> {
        self.value.or(self.default)
    }
}

/// Something that is not as it should be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Its line, counted from 1.
    pub line: u32,
    /// What; a sentence in JSON.
    #[serde(rename = "text", serialize_with = "in_words")]
    pub what: Oddity,
}

fn in_words<S: Serializer>(what: &Oddity, into: S) -> Result<S::Ok, S::Error> {
    into.collect_str(what)
}

/// What can be odd about a sheet.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Oddity {
    /// Neither section nor key.
    #[error("neither a section nor a key")]
    NoKey,
    /// A key in front of the first section.
    #[error("a key before the first section")]
    NoSection,
    /// Characters that are no UTF-8, taken as Latin-1.
    #[error("is no UTF-8, and was taken as Latin-1")]
    Latin1,
    /// The section stands there a second time.
    #[error("section [{0}] a second time, added to it")]
    SectionTwice(String),
    /// The key stands there a second time.
    #[error("key {0} a second time; the first counts")]
    KeyTwice(String),
    /// A value that is no number.
    #[error("`{0}` is no number")]
    NoNumber(String),
    /// A number in a form that the standard doesn't have.
    #[error("`{0}` has a form that no standard defines")]
    OddNumber(String),
    /// A list names an object that has no section, or leaves one out.
    #[error("{0:04X}h is listed and has no section")]
    List(u16),
    /// A list counts other than it lists.
    #[error("{0} objects are announced and {1} listed")]
    ListCount(i64, usize),
    /// An index that can't be read.
    #[error("section [{0}] belongs to no object")]
    NoIndex(String),
    /// An object that is mapped and has no section.
    #[error("{0:04X}h sub {1} is mapped and has no section")]
    NotThere(u16, u8),
    /// A mapping count that the mapped objects don't bear out.
    #[error("{0:04X}h maps {1} objects and names {2}")]
    MappingCount(u16, i64, usize),
    /// A PDO without a COB-ID.
    #[error("{0:04X}h has no COB-ID; its PDO is left out")]
    NoCobId(u16),
    /// A PDO of more than 64 bit, or of none.
    #[error("{0:04X}h maps more than 64 bit, cut there")]
    TooLong(u16),
    /// A PDO with a 29-bit identifier, which is left out.
    #[error("{0:04X}h has a 29-bit COB-ID; its PDO is left out")]
    Extended(u16),
}

/// A data sheet or configuration.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sheet {
    /// Index and sub-index, and what stands there.
    pub objects: BTreeMap<(u16, u8), Object>,
    /// `ProductName`.
    pub product: String,
    /// The node-id of a DCF.
    pub node_id: Option<u8>,
    /// What was odd, the first hundred.
    pub warnings: Vec<Warning>,
    /// How much was odd.
    pub warning_count: u64,
}

/// What the keys that follow belong to.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Section {
    None,
    Object(u16, u8),
    DeviceInfo,
    Commissioning,
    List,
    Other,
}

/// A sheet under way.
#[derive(Default)]
struct Reading {
    sheet: Sheet,
    /// Sections and keys that were there, with the number of their section.
    seen: BTreeMap<String, u32>,
    keys: BTreeMap<(u32, String), ()>,
    listed: Vec<(u32, u16)>,
    announced: Option<(u32, i64, usize)>,
}

impl Sheet {
    /// Reads what there is; a file of something else gives no object.
    pub fn parse(bytes: &[u8]) -> Self {
        let (text, is_latin1) = ini::text(bytes);
        let mut reading = Reading::default();
        if is_latin1 {
            let line = bytes
                .split(|byte| *byte == b'\n')
                .position(|l| !l.is_ascii());
            reading.warn(line.map_or(1, |line| line as u32 + 1), Oddity::Latin1);
        }
        let mut section = Section::None;
        let mut place = 0;
        for (number, line) in ini::lines(&text) {
            match line {
                Line::Section(name) => {
                    reading.end_list();
                    section = reading.section(&name, number);
                    place = *reading.seen.entry(name).or_insert(number);
                }
                Line::Key(key, value) => reading.key(&section, place, number, &key, &value),
                Line::Neither => reading.warn(number, Oddity::NoKey),
            }
        }
        reading.end_list();
        reading.check_lists();
        reading.sheet
    }

    /// Notes something that is odd.
    pub fn warn(&mut self, line: u32, what: Oddity) {
        self.warning_count += 1;
        if self.warnings.len() < MOST_WARNINGS {
            self.warnings.push(Warning { line, what });
        }
    }

    /// The number of an object, for a node.
    pub fn number(&self, index: u16, sub: u8, node_id: u8) -> Option<i64> {
        let object = self.objects.get(&(index, sub))?;
        object.number().map(|number| number.of(node_id))
    }
}

impl Reading {
    fn warn(&mut self, line: u32, what: Oddity) {
        self.sheet.warn(line, what);
    }

    fn section(&mut self, name: &str, line: u32) -> Section {
        if self.seen.contains_key(name) {
            self.warn(line, Oddity::SectionTwice(name.to_owned()));
        }
        match name {
            "deviceinfo" => return Section::DeviceInfo,
            // With one m in the standard, and with two in many files.
            "devicecomissioning" | "devicecommissioning" => return Section::Commissioning,
            "mandatoryobjects" | "optionalobjects" | "manufacturerobjects" => {
                return Section::List;
            }
            _ => {}
        }
        match place_of(name) {
            Some(Ok((index, sub))) => {
                let object = self.sheet.objects.entry((index, sub)).or_default();
                if object.line == 0 {
                    object.line = line;
                }
                Section::Object(index, sub)
            }
            Some(Err(())) => {
                self.warn(line, Oddity::NoIndex(name.to_owned()));
                Section::Other
            }
            None => Section::Other,
        }
    }

    fn key(&mut self, section: &Section, place: u32, line: u32, key: &str, value: &str) {
        if *section == Section::None {
            self.warn(line, Oddity::NoSection);
            return;
        }
        // Comments and the like may have the same key twice; nobody reads them.
        if *section == Section::Other {
            return;
        }
        if self.keys.insert((place, key.to_owned()), ()).is_some() {
            self.warn(line, Oddity::KeyTwice(key.to_owned()));
            return;
        }
        match section {
            Section::Object(index, sub) => self.object(*index, *sub, line, key, value),
            Section::DeviceInfo if key == "productname" => {
                value.clone_into(&mut self.sheet.product)
            }
            Section::Commissioning if key == "nodeid" => {
                let id = self.number(line, value).map(|number| number.plain);
                let id = id.and_then(|id| u8::try_from(id).ok());
                self.sheet.node_id = id.filter(|id| (1..=127).contains(id));
            }
            Section::List => self.list(line, key, value),
            _ => {}
        }
    }

    fn object(&mut self, index: u16, sub: u8, line: u32, key: &str, value: &str) {
        let number = match key {
            "datatype" | "defaultvalue" | "parametervalue" if !value.is_empty() => {
                self.value(index, sub, key, line, value)
            }
            _ => None,
        };
        let Some(object) = self.sheet.objects.get_mut(&(index, sub)) else {
            return;
        };
        match key {
            "parametername" => value.clone_into(&mut object.name),
            "datatype" => {
                let data_type = number.and_then(|number| u16::try_from(number.plain).ok());
                object.data_type = data_type.unwrap_or(0);
            }
            "defaultvalue" => object.default = number,
            "parametervalue" => object.value = number,
            _ => {}
        }
    }

    /// The number of a key; texts, floats and domains have values that are none.
    fn value(&mut self, index: u16, sub: u8, key: &str, line: u32, value: &str) -> Option<Number> {
        let data_type = self
            .sheet
            .objects
            .get(&(index, sub))
            .map_or(0, |o| o.data_type);
        let is_no_number = matches!(data_type, 0x08..=0x0F | 0x11);
        if key != "datatype" && is_no_number {
            return None;
        }
        self.number(line, value)
    }

    fn number(&mut self, line: u32, value: &str) -> Option<Number> {
        match number::parse(value) {
            Some((number, form)) => {
                if form == Form::Understood {
                    self.warn(line, Oddity::OddNumber(value.to_owned()));
                }
                Some(number)
            }
            None => {
                self.warn(line, Oddity::NoNumber(value.to_owned()));
                None
            }
        }
    }

    fn list(&mut self, line: u32, key: &str, value: &str) {
        let Some(number) = self.number(line, value).map(|number| number.plain) else {
            return;
        };
        let (at, announced, listed) = self.announced.get_or_insert((line, 0, 0));
        if key == "supportedobjects" {
            (*at, *announced) = (line, number);
        } else {
            *listed += 1;
            if let Ok(index) = u16::try_from(number) {
                self.listed.push((line, index));
            }
        }
    }

    fn end_list(&mut self) {
        if let Some((line, announced, listed)) = self.announced.take()
            && i64::try_from(listed) != Ok(announced)
        {
            self.warn(line, Oddity::ListCount(announced, listed));
        }
    }

    fn check_lists(&mut self) {
        for (line, index) in std::mem::take(&mut self.listed) {
            let mut there = self.sheet.objects.range((index, 0)..=(index, u8::MAX));
            if there.next().is_none() {
                self.warn(line, Oddity::List(index));
            }
        }
    }
}

/// Index and sub-index of `1018` and `1018sub1`; `None` for a section that is no object, an error
/// for one that looks like one and is none.
fn place_of(name: &str) -> Option<Result<(u16, u8), ()>> {
    let (index, rest) = name.split_at_checked(4)?;
    if !index.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return None;
    }
    let Ok(index) = u16::from_str_radix(index, 16) else {
        return Some(Err(()));
    };
    if rest.is_empty() {
        return Some(Ok((index, 0)));
    }
    match rest.strip_prefix("sub").map(str::trim) {
        Some(sub) if sub.bytes().all(|byte| byte.is_ascii_hexdigit()) => Some(
            u8::from_str_radix(sub, 16)
                .map(|sub| (index, sub))
                .map_err(|_| ()),
        ),
        Some(_) => Some(Err(())),
        // `1a00value`, `1a00name`, `1a00denotation`: compact storage, and words.
        None => None,
    }
}
