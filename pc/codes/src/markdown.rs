//! The page `docs/objects.md`: every object, for people.
//!
//! In: the rows. Out: how to read the page, and one table for each area of the dictionary.
//!
//! Left out: how services work; that is the standards' part.

use std::fmt::Write as _;

use canopen::object::Access;
use device::objects::row::{Default, Row, Shape};
use device::objects::table::{Channel, Models};

use super::dictionary;

const PRODUCT: &str = "\
# Objects

For those who read or write the objects of the product. This page is printed by
`plumb describe objects`; a test compares it with the output. The objects of the paper's instrument
are in [objects-paper.md](objects-paper.md).
";

const PAPER: &str = "\
# Objects of the paper's instrument

For those who read or write the objects of the paper's instrument. This page is printed by
`plumb describe objects --instrument paper`; a test compares it with the output. The objects of the
product are in [objects.md](objects.md).
";

const DYNAMIC: &str = "\
# Objects of the variant with a gyroscope

For those who read or write the objects of the dynamic variant, the product with a gyroscope. This
page is printed by `plumb describe objects --instrument dynamic`; a test compares it with the
output. All objects of the product ([objects.md](objects.md)) are there with the same meaning;
2029h, 202Ah to 202Ch, 2034h and TPDO 5 to 7 are there besides, and RPDO 3 is in use.
";

const OPENING: &str = "\
It comes from the same rows as the table inside the device, the data sheets (`eds/*.eds`),
the configurations (`eds/*.dcf`) and the CAN database (`eds/plumb.dbc`).

A CANopen device is a list of numbered objects. A tool reads and writes them one by one with SDO;
data that have to be fast are packed into PDOs, which a node sends by itself. An object is named by
its index and, where it has several parts, by a sub-index, both in hexadecimal. Plumb has two
channels, A and B. Each is a node of its own, with node-id 1 and 2 as delivered, and both have the
objects below. Where they are delivered with different values, the table shows both values.

- **index, sub**: the object. A range of sub-indices means that all of them are alike.
- **type**: the standard's name; the digits are the size in bit. INTEGER has a sign.
- **access**: `ro` can be read, `rw` read and written, `wo` written, `const` never changes. `rwr`
  is `rw` for an object that a TPDO may carry, `rww` for one that an RPDO may carry.
- **map**: T may be sent in a TPDO, R received in an RPDO, S carried by an SRDO (CANopen Safety).
- **kept**: yes if 1010h stores it, so that it is preserved through a loss of supply.
- **unit**: the meaning of 1. `6000h x 0.001 deg` is 0.01 deg as delivered, where 6000h is 10.
- **range**: the values that may be written; empty for the whole range of the type.
- **A, B**: the value as delivered; empty for objects that are measured or counted, and for those
  that act when written. `id` is the node-id.
";

/// An area of the dictionary.
struct Area {
    /// First index.
    first: u16,
    /// Last index.
    last: u16,
    /// Heading.
    title: &'static str,
    /// What is in it.
    about: &'static str,
}

const fn area(first: u16, last: u16, title: &'static str, about: &'static str) -> Area {
    Area {
        first,
        last,
        title,
        about,
    }
}

/// Every index belongs to one of them.
const AREAS: [Area; 8] = [
    area(
        0x0000,
        0x12FF,
        "Communication",
        "What every CANopen device has: identity, heartbeat, errors, storing (CiA 301).",
    ),
    area(
        0x1300,
        0x13FF,
        "Safety communication",
        "Pairs of frames that check each other (EN 50325-5). The protocol is implemented; no \
         performance level is claimed.",
    ),
    area(
        0x1400,
        0x17FF,
        "Received PDOs",
        "How each RPDO is received and where its bytes go (CiA 301).",
    ),
    area(
        0x1800,
        0x1BFF,
        "Sent PDOs",
        "How each TPDO is sent and what it carries (CiA 301).",
    ),
    area(
        0x1C00,
        0x1FFF,
        "Program and start",
        "New firmware over the bus, and what the node does after boot-up (CiA 302).",
    ),
    area(
        0x2000,
        0x5FFF,
        "Plumb's own objects",
        "Redundancy, measurement, bus and calibration.",
    ),
    area(
        0x6000,
        0x67FF,
        "Inclinometer: this channel",
        "Slopes as the profile has them, in 16 and in 32 bit (CiA 410).",
    ),
    area(
        0x6800,
        0xFFFF,
        "Inclinometer: the other channel",
        "The same 800h higher: the other channel as this one sees it (CiA 410).",
    ),
];

const HEADINGS: [&str; 12] = [
    "index", "sub", "name", "type", "access", "map", "kept", "unit", "range", "A", "B", "meaning",
];

/// The page.
pub fn page(models: Models, rows: &[Row]) -> String {
    let heading = match models {
        Models::PAPER => PAPER,
        Models::DYNAMIC => DYNAMIC,
        _ => PRODUCT,
    };
    let mut text = [heading, OPENING].concat();
    for area in &AREAS {
        let inside = |row: &&Row| (area.first..=area.last).contains(&row.index);
        let mut listed = rows.iter().filter(inside).peekable();
        if listed.peek().is_none() {
            continue;
        }
        let _ = write!(text, "\n## {}\n\n{}\n\n", area.title, area.about);
        line(&mut text, HEADINGS.map(str::to_owned));
        line(&mut text, HEADINGS.map(|_| "---".to_owned()));
        for row in listed {
            line(&mut text, cells(row));
        }
    }
    text
}

fn line(text: &mut String, cells: [String; 12]) {
    let cells = cells.map(|cell| cell.replace('|', "\\|"));
    let _ = writeln!(text, "| {} |", cells.join(" | "));
}

fn cells(row: &Row) -> [String; 12] {
    let member = row.shape == Shape::Member;
    let name = if member {
        row.name.to_owned()
    } else {
        format!("**{}**", row.name)
    };
    [
        format!("{:04X}", row.index),
        subs(row),
        name,
        dictionary::type_name(row.data_type).to_owned(),
        dictionary::access_name(row.access).to_owned(),
        mapping(row.access),
        kept(row.access),
        row.unit.to_owned(),
        range(row),
        default(row, Channel::A),
        default(row, Channel::B),
        row.doc.to_owned(),
    ]
}

fn subs(row: &Row) -> String {
    if row.sub == row.last {
        format!("{:X}", row.sub)
    } else {
        format!("{:X} to {:X}", row.sub, row.last)
    }
}

fn mapping(access: Access) -> String {
    let letters = [
        (Access::TPDO, 'T'),
        (Access::RPDO, 'R'),
        (Access::SRDO, 'S'),
    ];
    let held = letters.iter().filter(|(one, _)| access.has(*one));
    held.map(|(_, letter)| letter).collect()
}

fn kept(access: Access) -> String {
    if access.has(Access::STORED) {
        "yes".to_owned()
    } else {
        String::new()
    }
}

fn range(row: &Row) -> String {
    let number = |n| dictionary::number(row, n);
    row.limits.map_or_else(String::new, |(low, high)| {
        format!("{} to {}", number(low), number(high))
    })
}

fn default(row: &Row, channel: Channel) -> String {
    match row.default {
        Default::NodeId(base) => format!("0x{base:X} + id"),
        _ => dictionary::default_text(row, channel).unwrap_or_default(),
    }
}
