//! The documents against the rows they come from.

use canopen::object::{Access, DataType};
use device::exchange::{reason, reason_code};
use device::objects::row::{Default, Row, Shape};
use device::objects::table::{Channel, Models, rows_of};
use device::profile::state::state_code;
use tilt::chain::Invalid;
use tilt::cross_check::{Judgement, Member};

use super::dictionary::{access_name, delivered_at, objects};
use super::meaning::{self, named_values, scale};
use super::{dbc, dcf, eds, markdown};

const CHANNELS: [Channel; 2] = [Channel::A, Channel::B];

/// The lines of one section, without its heading; `None` when it is not there.
fn section<'a>(text: &'a str, name: &str) -> Option<Vec<&'a str>> {
    let mut lines = text.lines();
    lines.find(|line| *line == format!("[{name}]"))?;
    Some(lines.take_while(|line| !line.is_empty()).collect())
}

fn value<'a>(text: &'a str, name: &str, key: &str) -> Option<&'a str> {
    let lines = section(text, name)?;
    let pairs = lines.iter().filter_map(|line| line.split_once('='));
    pairs.filter(|pair| pair.0 == key).map(|pair| pair.1).next()
}

/// The section that describes a sub-index.
fn place(row: &Row, sub: u8) -> String {
    match row.shape {
        Shape::Var => format!("{:04X}", row.index),
        _ => format!("{:04X}sub{sub:X}", row.index),
    }
}

fn member(sub: u8, last: u8, access: Access) -> Row {
    Row {
        index: 0x2000,
        sub,
        last,
        shape: Shape::Member,
        name: "Value",
        data_type: DataType::Integer16,
        access,
        unit: "0.001 deg",
        limits: Some((-5, 5)),
        acts: false,
        default: Default::Value(-1),
        doc: "A value.",
    }
}

fn record(last: u8) -> Row {
    Row {
        shape: Shape::Record,
        name: "Values",
        data_type: DataType::Unsigned8,
        limits: None,
        default: Default::Value(i64::from(last)),
        ..member(0, 0, Access::READ.and(Access::CONST))
    }
}

fn rows() -> &'static [Row] {
    rows_of(Models::PRODUCT)
}

#[test]
fn every_sub_index_of_every_row_stands_in_the_sheet_with_its_type_and_access() {
    for channel in CHANNELS {
        let text = eds::sheet(rows(), channel);
        for row in rows() {
            for sub in row.sub..=row.last {
                let place = place(row, sub);
                let data_type = format!("0x{:04X}", row.data_type as u8);
                assert_eq!(value(&text, &place, "DataType"), Some(data_type.as_str()));
                let access = Some(access_name(row.access));
                assert_eq!(value(&text, &place, "AccessType"), access, "{place}");
                let heading = format!("[{place}]\r\n");
                assert_eq!(text.matches(&heading).count(), 1, "{place}");
            }
        }
    }
}

#[test]
fn every_object_is_listed_once_and_counts_its_sub_indices() {
    let text = eds::sheet(rows(), Channel::A);
    let mut listed = Vec::new();
    for list in ["MandatoryObjects", "OptionalObjects", "ManufacturerObjects"] {
        let count = value(&text, list, "SupportedObjects").unwrap();
        let lines = section(&text, list).unwrap();
        assert_eq!(count, (lines.len() - 1).to_string(), "{list}");
        let indices = lines.iter().filter_map(|line| line.split_once("=0x"));
        listed.extend(indices.map(|(_, index)| index.to_owned()));
    }
    listed.sort();
    let objects = objects(rows());
    let indices = objects.iter().map(|o| format!("{:04X}", o.head.index));
    assert_eq!(listed, indices.collect::<Vec<_>>());
    for object in objects.iter().filter(|o| o.head.shape != Shape::Var) {
        let index = format!("{:04X}", object.head.index);
        let sections = text.matches(&format!("\n[{index}sub")).count();
        let count = value(&text, &index, "SubNumber").unwrap();
        assert_eq!(count, sections.to_string(), "{index}");
    }
}

#[test]
fn sheets_and_configurations_are_plain_ascii_lines_that_end_as_the_format_asks() {
    let of = |channel| {
        let node_id = 127;
        [
            eds::sheet(rows(), channel),
            dcf::configuration(rows(), channel, node_id),
        ]
    };
    let mut texts: Vec<String> = CHANNELS.into_iter().flat_map(of).collect();
    texts.push(dbc::database(rows()));
    for text in &texts {
        assert!(text.is_ascii());
        assert!(text.ends_with("\r\n"));
        assert_eq!(text.matches('\n').count(), text.matches("\r\n").count());
    }
    texts.pop();
    // Some readers take what follows a semicolon for a comment.
    let lines = texts.iter().flat_map(|text| text.lines());
    for line in lines {
        assert!(line.len() <= 255 && !line.contains(';'), "{line}");
    }
}

#[test]
fn names_are_unique_within_their_object() {
    for object in objects(rows()) {
        let mut names: Vec<_> = object.entries.iter().map(|entry| &entry.name).collect();
        names.sort();
        names.dedup();
        assert_eq!(
            names.len(),
            object.entries.len(),
            "{:04X}",
            object.head.index
        );
    }
}

#[test]
fn a_run_of_sub_indices_is_spread_out_and_numbered() {
    let rw = Access::READ.and(Access::WRITE);
    let rows = [record(3), member(1, 1, rw), member(2, 3, rw)];
    let text = eds::sheet(&rows, Channel::A);
    assert_eq!(value(&text, "2000", "ObjectType"), Some("0x9"));
    assert_eq!(value(&text, "2000", "SubNumber"), Some("4"));
    for sub in 1..=3 {
        let name = format!("Value {sub}");
        let place = format!("2000sub{sub}");
        assert_eq!(value(&text, &place, "ParameterName"), Some(name.as_str()));
        assert_eq!(value(&text, &place, "DefaultValue"), Some("-1"));
        assert_eq!(value(&text, &place, "LowLimit"), Some("-5"));
        assert_eq!(value(&text, &place, "HighLimit"), Some("5"));
    }
}

#[test]
fn the_access_states_which_pdo_may_carry_a_writable_object() {
    let (read, write) = (Access::READ, Access::WRITE);
    let both = read.and(write);
    let (sent, received) = (Access::TPDO, Access::RPDO);
    for (access, name) in [
        (read.and(Access::CONST), "const"),
        (read.and(sent), "ro"),
        (write.and(received), "wo"),
        (both, "rw"),
        (both.and(sent), "rwr"),
        (both.and(received), "rww"),
        (both.and(sent).and(received), "rw"),
    ] {
        assert_eq!(access_name(access), name);
    }
}

#[test]
fn what_a_pdo_carries_is_marked_and_nothing_else() {
    let text = eds::sheet(rows(), Channel::A);
    assert_eq!(value(&text, "6010", "PDOMapping"), Some("1"));
    assert_eq!(value(&text, "2011sub1", "PDOMapping"), Some("1"));
    assert_eq!(value(&text, "6012", "PDOMapping"), Some("0"));
    assert_eq!(value(&text, "6210", "PDOMapping"), Some("0"));
}

#[test]
fn the_inverted_twin_is_the_one_that_the_srdo_maps_behind_its_plain_half() {
    let text = eds::sheet(rows(), Channel::A);
    let mapped = |sub| delivered_at(rows(), 0x1381, sub, Channel::A, 1) >> 8;
    for sub in [1, 3] {
        let (plain, inverted) = (mapped(sub), mapped(sub + 1));
        let places = [plain, inverted].map(|address| format!("{:04X}", address >> 8));
        let twin = format!("0x{inverted:06X}");
        assert_eq!(
            value(&text, &places[0], "InvertedSRAD"),
            Some(twin.as_str())
        );
        assert_eq!(value(&text, &places[1], "InvertedSRAD"), None);
        for place in &places {
            assert_eq!(value(&text, place, "SRDOMapping"), Some("1"));
        }
    }
    assert_eq!(value(&text, "6010", "SRDOMapping"), None);
    let device = value(&text, "DeviceInfo", "CANopenSafetySupported");
    assert_eq!(device, Some("1"));
}

#[test]
fn a_sheet_holds_formulas_and_a_configuration_their_values() {
    let sheet = eds::sheet(rows(), Channel::B);
    let file = dcf::configuration(rows(), Channel::B, 5);
    for text in [&sheet, &file] {
        let formula = Some("$NODEID+0x180");
        assert_eq!(value(text, "1800sub1", "DefaultValue"), formula);
    }
    assert!(!sheet.contains("ParameterValue") && !sheet.contains("DeviceComissioning"));
    let configured = |place| value(&file, place, "ParameterValue");
    assert_eq!(configured("1800sub1"), Some("0x00000185"));
    assert_eq!(configured("1014"), Some("0x00000085"));
    assert_eq!(configured("2001"), Some("1"));
    assert_eq!(value(&file, "DeviceComissioning", "NodeID"), Some("5"));
    // Nobody can write the product code, though it depends on the channel.
    assert_eq!(configured("1018sub2"), None);
    assert_eq!(
        value(&sheet, "DeviceInfo", "ProductNumber"),
        Some("0x504C0002")
    );
}

#[test]
fn every_row_has_its_line_on_the_page() {
    let page = markdown::page(Models::PRODUCT, rows());
    assert!(page.is_ascii() && !page.contains('\r'));
    let lines: Vec<&str> = page.lines().filter(|line| line.ends_with(". |")).collect();
    for row in rows() {
        let begins = match (row.sub, row.last) {
            (sub, last) if sub == last => format!("| {:04X} | {sub:X} |", row.index),
            (sub, last) => format!("| {:04X} | {sub:X} to {last:X} |", row.index),
        };
        let found = lines.iter().filter(|line| line.starts_with(&begins));
        let found: Vec<_> = found.collect();
        assert_eq!(found.len(), 1, "{begins}");
        assert!(found[0].contains(row.name) && found[0].contains(row.doc));
    }
    assert_eq!(lines.len(), rows().len());
}

#[test]
fn units_become_factors() {
    let of = |unit| {
        let row = Row {
            unit,
            ..member(1, 1, Access::READ)
        };
        let scale = scale(rows(), &row);
        (scale.factor, scale.unit)
    };
    let is = |factor, unit: &str| (factor, unit.to_owned());
    assert_eq!(of("6000h x 0.001 deg"), is(0.01, "deg"));
    assert_eq!(of("0.001 deg"), is(0.001, "deg"));
    assert_eq!(of("360 deg / 2^24"), is(360.0 / 16_777_216.0, "deg"));
    assert_eq!(of("2^-26 g"), is(1.0 / 67_108_864.0, "g"));
    assert_eq!(of("1/256 us"), is(1.0 / 256.0, "us"));
    assert_eq!(of("degC"), is(1.0, "degC"));
    assert_eq!(of(""), is(1.0, ""));
}

#[test]
fn no_unit_of_a_row_is_left_with_a_number_in_it() {
    for row in rows() {
        let unit = scale(rows(), row).unit;
        assert!(!unit.contains(|c: char| c.is_ascii_digit()), "{unit}");
    }
}

#[test]
fn texts_name_single_values() {
    let listed = named_values("Where from. 0 none, 1 the bus, 2 this node.");
    assert_eq!(listed, [(0, "none"), (1, "the bus"), (2, "this node")]);
    assert_eq!(
        named_values("-32768: there is none. More."),
        [(-32768, "there is none")]
    );
    let bits = "Bit 0: X is valid, 1: Y is valid. 1 to 31: reasons. 32 and up: more.";
    assert_eq!(named_values(bits), []);
}

/// What the text of an object calls a number.
fn called(index: u16, number: u8) -> &'static str {
    let row = rows().iter().find(|row| row.index == index).unwrap();
    let names = named_values(row.doc);
    let found = names.iter().find(|name| name.0 == i64::from(number));
    found.map_or("", |name| name.1)
}

#[test]
fn states_and_reasons_are_called_what_the_device_means() {
    let faulty = |faulty| Judgement::OneChannel {
        faulty,
        reason: Invalid::Bus,
    };
    for (judgement, name) in [
        (Judgement::Waiting(Invalid::Settling), "waiting"),
        (Judgement::Agree, "agree"),
        (Judgement::Disagree, "disagree"),
        (faulty(Member::Own), "this channel is faulty"),
        (faulty(Member::Peer), "the other channel is faulty"),
        (Judgement::NoChannel(Invalid::Bus), "no channel measures"),
    ] {
        assert_eq!(called(0x2021, state_code(judgement)), name);
    }
    for (invalid, name) in [
        (Invalid::NoSample, "no sample yet"),
        (Invalid::Settling, "settling"),
        (Invalid::OverRange, "over range"),
        (Invalid::Bus, "the part does not answer"),
        (Invalid::Stuck, "codes stand still"),
        (
            Invalid::Biased,
            "moved alone or gravity of the wrong length",
        ),
        (Invalid::Silent, "silent"),
        (Invalid::Refused, "the channels differ"),
        (Invalid::Alone, "degraded operation is forbidden"),
    ] {
        assert_eq!(called(0x2025, reason_code(invalid)), name);
    }
    for code in 1..=31 {
        let named = !called(0x2025, code).is_empty();
        assert_eq!(named, reason(code).is_some(), "{code}");
    }
}

/// The lines of a message, its own first.
fn message<'a>(text: &'a str, name: &str) -> Vec<&'a str> {
    let mut lines = text.lines();
    let own = lines.find(|line| line.contains(&format!(" {name}: ")));
    let signals = lines.take_while(|line| line.starts_with(" SG_"));
    own.into_iter().chain(signals).collect()
}

#[test]
fn the_database_holds_the_delivered_tpdos_of_both_nodes() {
    let text = dbc::database(rows());
    let slopes = message(&text, "Plumb_B_TPDO_1");
    assert_eq!(slopes[0], "BO_ 386 Plumb_B_TPDO_1: 6 Plumb_B");
    assert_eq!(
        slopes[1],
        " SG_ Slope_long16 : 0|16@1- (0.01,0) [-327.68|327.67] \"deg\" Master"
    );
    assert_eq!(
        slopes[4],
        " SG_ State_of_the_pair : 40|8@1+ (1,0) [0|255] \"\" Master"
    );
    assert_eq!(slopes.len(), 5);
    assert_eq!(text.matches("\nBO_ ").count(), 8);
}

#[test]
fn three_axes_under_one_row_are_three_names() {
    let sheet = eds::sheet(rows(), Channel::A);
    let text = dbc::database(rows());
    let backing = message(&text, "Plumb_A_TPDO_4");
    for (n, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
        let name = value(&sheet, &format!("2010sub{}", n + 5), "ParameterName");
        assert_eq!(name, Some(format!("Acceleration {axis}").as_str()));
        let signal = format!(" SG_ Acceleration_{axis} : {}|16@1- ", 16 * n);
        assert!(backing[n + 1].starts_with(&signal), "{}", backing[n + 1]);
        let comment = format!("CM_ SG_ 1153 Acceleration_{axis} \"2010h sub {}: ", n + 5);
        assert!(text.contains(&comment), "{comment}");
    }
}

#[test]
fn names_of_signals_are_unique_within_their_message() {
    let text = dbc::database(rows());
    for message in text.split("\nBO_ ").skip(1) {
        let signals = message
            .lines()
            .filter_map(|line| line.strip_prefix(" SG_ "));
        let mut names: Vec<_> = signals.filter_map(|line| line.split(' ').next()).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count, "{message}");
    }
}

#[test]
fn the_exchange_is_heard_by_the_other_node_only() {
    let text = dbc::database(rows());
    for (sender, other) in [("A", "B"), ("B", "A")] {
        for (pdo, length) in [(3, 5), (4, 6)] {
            let exchange = message(&text, &format!("Plumb_{sender}_TPDO_{pdo}"));
            assert_eq!(exchange.len(), length);
            for signal in exchange.iter().skip(1) {
                let heard_by = format!(" Master,Plumb_{other}");
                assert!(signal.ends_with(&heard_by), "{signal}");
            }
        }
    }
}

#[test]
fn signal_names_fit_the_format() {
    let text = dbc::database(rows());
    for line in text.lines().filter_map(|line| line.strip_prefix(" SG_ ")) {
        let name = line.split(' ').next().unwrap();
        assert!(name.len() <= 32, "{name}");
        let first = name.chars().next().unwrap();
        assert!(first.is_ascii_alphabetic(), "{name}");
    }
}

#[test]
fn the_variant_with_a_gyroscope_has_three_more_messages_and_files_of_its_own() {
    let rows = rows_of(Models::DYNAMIC);
    assert_eq!(
        eds::file_name(rows, Channel::B, "eds"),
        "plumb-dynamic-b.eds"
    );
    let sheet = eds::sheet(rows, Channel::A);
    assert_eq!(value(&sheet, "DeviceInfo", "NrOfTXPDO"), Some("7"));
    let off = Some("$NODEID+0x80000200");
    assert_eq!(value(&sheet, "1804sub1", "DefaultValue"), off);
    let text = dbc::database(rows);
    assert_eq!(text.matches("\nBO_ ").count(), 14);
    let angle = message(&text, "Plumb_A_TPDO_5");
    assert_eq!(angle[0], "BO_ 513 Plumb_A_TPDO_5: 8 Plumb_A");
    let slope = " SG_ Slope_X_now : 0|16@1- (0.01,0) [-327.68|327.67] \"deg\" Master";
    assert_eq!(angle[1], slope);
    let rates = message(&text, "Plumb_B_TPDO_6");
    assert_eq!(rates[0], "BO_ 770 Plumb_B_TPDO_6: 7 Plumb_B");
    let rate = " SG_ Rate_of_turn_Z : 32|16@1- (0.01,0) [-327.68|327.67] \"deg/s\" Master";
    assert_eq!(rates[3], rate);
    assert_eq!(text.matches("\"Off as delivered.\";").count(), 4);
}

#[test]
fn counts_are_shown_in_decimal_and_patterns_in_hexadecimal() {
    let shown = |address: &str| {
        let named = crate::name::one(address).unwrap();
        let size = named.row.unwrap().data_type.size().unwrap();
        let bytes = 1000_u64.to_le_bytes()[..size].to_vec();
        crate::value::show(&named, &bytes, None).text
    };
    for count in [
        "1018:4", "2026:1", "2026:2", "2032", "2052:5", "2052:6", "2080:6",
    ] {
        assert_eq!(shown(count), "1000", "{count}");
    }
    assert_eq!(shown("1018:1"), "0x000003E8");
}

#[test]
fn half_a_sentence_was_the_name_of_a_value() {
    let of = |index| rows().iter().find(|row| row.index == index).unwrap();
    let [forbidden, allowed] = [(0, "forbidden"), (1, "allowed")];
    assert_eq!(meaning::names(of(0x2005)), [forbidden, allowed]);
    let models = [
        Models::WHOLE,
        Models::PRODUCT,
        Models::PAPER,
        Models::DYNAMIC,
    ];
    for row in models.into_iter().flat_map(rows_of) {
        for (number, name) in meaning::names(row) {
            // What is written has a name that can be typed; what is read may be longer.
            let longest = if row.access.has(Access::WRITE) {
                28
            } else {
                55
            };
            let at = format!("{:04X}h sub {}, {number}: {name}", row.index, row.sub);
            assert!(name.len() <= longest, "{at}");
        }
    }
    // Sub-index 0 of an array counts its members, whatever its text calls theirs.
    assert_eq!(meaning::name(of(0x2025), 2), None);
}
