//! Electronic data sheet of one channel (CiA 306; the safety keys are those of EN 50325-5).
//!
//! In: the rows and a channel. Out: the text of a `.eds` file: ASCII, CRLF, no line above 255
//! characters, nothing that changes from day to day. Values that depend on the node-id are
//! formulas of `$NODEID`.
//!
//! Left out: compact storage, modules, units (the format has no key for them).

use canopen::object::{Access, DataType};
use canopen::services::Services;
use device::instrument::PAPER_SERVICES;
use device::objects::row::{Row, Shape};
use device::objects::table::{Channel, Models, rows_of};

use super::dictionary::{self, Entry, Object};

/// Day that the files carry; moved by hand when the dictionary changes on purpose.
pub const DATE: &str = "11-22-2026";
/// Time of that day, in the format's own twelve hours.
pub const TIME: &str = "12:00AM";
/// Version of the files, counted up by hand together with [`DATE`].
pub const FILE_VERSION: u8 = 2;

/// Bit rates of CiA 301 in kbit/s, all of which LSS can set.
const BIT_RATES: [u16; 8] = [10, 20, 50, 125, 250, 500, 800, 1000];

/// Objects that every node has (CiA 301).
const MANDATORY: [u16; 3] = [0x1000, 0x1001, 0x1018];

/// Basic data types 0001h to 0007h that an RPDO may map to skip bytes. BOOLEAN is none of them,
/// since it fills no whole byte.
const DUMMIES: [bool; 7] = [false, true, true, true, true, true, true];

/// What a configuration adds to a data sheet.
pub trait Extra {
    /// More keys of `[FileInfo]`.
    fn file_info(&self, _file: &mut File) {}
    /// More keys of one entry.
    fn entry(&self, _file: &mut File, _row: &Row) {}
}

/// A data sheet as it is.
struct Nothing;

impl Extra for Nothing {}

/// The text of a file in sections of keys.
#[derive(Default)]
pub struct File {
    text: String,
}

impl File {
    /// A line, ended as the format asks.
    fn line(&mut self, line: &str) {
        self.text.push_str(line);
        self.text.push_str("\r\n");
    }

    /// Begins a section.
    pub fn section(&mut self, name: &str) {
        if !self.text.is_empty() {
            self.line("");
        }
        self.line(&format!("[{name}]"));
    }

    /// A key of the section.
    pub fn key(&mut self, key: &str, value: impl std::fmt::Display) {
        self.line(&format!("{key}={value}"));
    }

    /// Everything written.
    pub fn into_text(self) -> String {
        self.text
    }
}

/// The data sheet of a channel.
pub fn sheet(rows: &[Row], channel: Channel) -> String {
    let mut file = File::default();
    let name = file_name(rows, channel, "eds");
    write(&mut file, rows, channel, &name, &Nothing);
    file.into_text()
}

/// An instrument is known by its rows.
fn is(models: Models, rows: &[Row]) -> bool {
    // By what stands in it: the compiler may keep a constant in several places.
    let address = |row: &Row| (row.index, row.sub);
    rows.iter()
        .map(address)
        .eq(rows_of(models).iter().map(address))
}

/// What the instrument with these rows has of what the standards leave to the device.
fn services(rows: &[Row]) -> Services {
    if is(Models::PAPER, rows) {
        PAPER_SERVICES
    } else {
        Services::ALL
    }
}

/// The name under which a document of a channel is known.
pub fn file_name(rows: &[Row], channel: Channel, ending: &str) -> String {
    let instrument = if is(Models::PAPER, rows) {
        "plumb-paper"
    } else if is(Models::DYNAMIC, rows) {
        "plumb-dynamic"
    } else {
        "plumb"
    };
    let letter = dictionary::letter(channel).to_ascii_lowercase();
    format!("{instrument}-{letter}.{ending}")
}

/// Writes all sections that data sheet and configuration share.
pub fn write(file: &mut File, rows: &[Row], channel: Channel, name: &str, extra: &impl Extra) {
    file_info(file, channel, name);
    extra.file_info(file);
    device_info(file, rows, channel);
    file.section("DummyUsage");
    for (data_type, usable) in (1..).zip(DUMMIES) {
        file.key(&format!("Dummy{data_type:04X}"), u8::from(usable));
    }
    comments(file);
    let objects = dictionary::objects(rows);
    let mandatory = |index: u16| MANDATORY.contains(&index);
    let manufacturer = |index: u16| (0x2000..0x6000).contains(&index);
    let optional = |index: u16| !mandatory(index) && !manufacturer(index);
    list(
        file,
        "MandatoryObjects",
        &objects,
        mandatory,
        channel,
        extra,
    );
    list(file, "OptionalObjects", &objects, optional, channel, extra);
    list(
        file,
        "ManufacturerObjects",
        &objects,
        manufacturer,
        channel,
        extra,
    );
}

fn file_info(file: &mut File, channel: Channel, name: &str) {
    let letter = dictionary::letter(channel);
    file.section("FileInfo");
    file.key("FileName", name);
    file.key("FileVersion", FILE_VERSION);
    file.key("FileRevision", 0);
    file.key("EDSVersion", "4.0");
    file.key(
        "Description",
        format!("Plumb inclinometer, channel {letter}"),
    );
    for (what, by) in [("Creation", "CreatedBy"), ("Modification", "ModifiedBy")] {
        file.key(&format!("{what}Time"), TIME);
        file.key(&format!("{what}Date"), DATE);
        file.key(by, "plumb describe");
    }
}

fn device_info(file: &mut File, rows: &[Row], channel: Channel) {
    let letter = dictionary::letter(channel);
    let identity = |sub| {
        let number = dictionary::delivered_at(rows, 0x1018, sub, channel, channel.node_id());
        format!("0x{number:08X}")
    };
    file.section("DeviceInfo");
    file.key("VendorName", "Plumb");
    file.key("VendorNumber", identity(1));
    file.key(
        "ProductName",
        format!("Plumb inclinometer, channel {letter}"),
    );
    file.key("ProductNumber", identity(2));
    file.key("RevisionNumber", identity(3));
    file.key("OrderCode", format!("PLUMB-{letter}"));
    for rate in BIT_RATES {
        file.key(&format!("BaudRate_{rate}"), 1);
    }
    file.key("SimpleBootUpMaster", 0);
    file.key("SimpleBootUpSlave", 1);
    file.key("Granularity", 8);
    file.key("DynamicChannelsSupported", 0);
    file.key("CompactPDO", 0);
    file.key("GroupMessaging", 0);
    file.key("NrOfRXPDO", heads(rows, 0x1400, 0x15FF));
    file.key("NrOfTXPDO", heads(rows, 0x1800, 0x19FF));
    let services = services(rows);
    file.key("LSS_Supported", u8::from(services.lss));
    file.key("CANopenSafetySupported", u8::from(services.safety));
}

/// Number of objects between two indices, both included.
fn heads(rows: &[Row], first: u16, last: u16) -> usize {
    let heads = rows.iter().filter(|row| row.sub == 0);
    heads
        .filter(|row| (first..=last).contains(&row.index))
        .count()
}

fn comments(file: &mut File) {
    let lines = [
        "Made by plumb describe from the rows that the device itself is built from.",
        "Change the rows, never this file. What each object means: docs/objects.md.",
        "Units of slopes, presets and offsets are those of 6000h: 0.01 deg as delivered.",
        "The vendor number is 0 as long as no number has been assigned by CiA.",
    ];
    file.section("Comments");
    file.key("Lines", lines.len());
    for (number, line) in (1..).zip(lines) {
        file.key(&format!("Line{number}"), line);
    }
}

/// A list of objects, and the objects themselves behind it.
fn list(
    file: &mut File,
    name: &str,
    objects: &[Object<'_>],
    belongs: impl Fn(u16) -> bool,
    channel: Channel,
    extra: &impl Extra,
) {
    let listed = || objects.iter().filter(|object| belongs(object.head.index));
    file.section(name);
    file.key("SupportedObjects", listed().count());
    for (number, object) in (1..).zip(listed()) {
        file.key(&format!("{number}"), format!("0x{:04X}", object.head.index));
    }
    for object in listed() {
        write_object(file, object, channel, extra);
    }
}

fn write_object(file: &mut File, object: &Object<'_>, channel: Channel, extra: &impl Extra) {
    let index = format!("{:04X}", object.head.index);
    let object_type = match object.head.shape {
        Shape::Array => 8,
        Shape::Record => 9,
        Shape::Var | Shape::Member => 7,
    };
    if object_type != 7 {
        // Type, access and mapping of an array or record are those of its sub-indices.
        file.section(&index);
        file.key("ParameterName", object.head.name);
        file.key("ObjectType", format!("0x{object_type}"));
        file.key("SubNumber", object.entries.len());
    }
    for entry in &object.entries {
        match object_type {
            7 => file.section(&index),
            _ => file.section(&format!("{index}sub{:X}", entry.sub)),
        }
        write_entry(file, entry, channel);
        extra.entry(file, entry.row);
    }
}

/// Whether a value without a default has an empty key, which the format allows beside none at all.
///
/// Some masters take the size of a number from there, and fail at the first access where the key is
/// missing. They also refuse a whole file for the value of a type that they do not have, such as
/// numbers of 24 bit; and of a DOMAIN others take an empty value for its content.
fn has_empty_key(data_type: DataType) -> bool {
    use DataType::{Domain, Integer24, Unsigned24};
    !matches!(data_type, Domain | Integer24 | Unsigned24)
}

fn write_entry(file: &mut File, entry: &Entry<'_>, channel: Channel) {
    let row = entry.row;
    let mappable = row.access.has(Access::TPDO) || row.access.has(Access::RPDO);
    file.key("ParameterName", &entry.name);
    file.key("ObjectType", "0x7");
    file.key("DataType", format!("0x{:04X}", row.data_type as u8));
    file.key("AccessType", dictionary::access_name(row.access));
    match dictionary::default_text(row, channel) {
        Some(text) => file.key("DefaultValue", text),
        None if has_empty_key(row.data_type) => file.key("DefaultValue", ""),
        None => {}
    }
    file.key("PDOMapping", u8::from(mappable));
    if row.access.has(Access::SRDO) {
        file.key("SRDOMapping", 1);
    }
    if let Some((index, sub)) = entry.inverted {
        file.key("InvertedSRAD", format!("0x{index:04X}{sub:02X}"));
    }
    if let Some((low, high)) = row.limits {
        file.key("LowLimit", dictionary::number(row, low));
        file.key("HighLimit", dictionary::number(row, high));
    }
}
