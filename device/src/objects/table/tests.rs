//! The table as a whole: what the compiler cannot check, and what a master finds in it.

extern crate std;

use canopen::object::packed::{Form, Row as PackedRow};
use canopen::object::{Abort, Address, Value, at};
use std::collections::BTreeMap;
use std::vec::Vec;

use super::*;

fn default(channel: Channel, address: Address) -> i64 {
    let dictionary = dictionary(Models::WHOLE, channel);
    let entry = dictionary.entry(address).unwrap();
    let value = dictionary.default(&entry, channel.node_id()).unwrap();
    value.number(entry.data_type)
}

fn mapped(channel: Channel, index: u16) -> Vec<u32> {
    let count = default(channel, at(index, 0)) as u8;
    let entry = |sub| default(channel, at(index, sub)) as u32;
    (1..=count).map(entry).collect()
}

#[test]
fn every_row_is_found_at_each_of_its_addresses() {
    let dictionary = dictionary(Models::WHOLE, Channel::A);
    for row in rows() {
        for sub in row.sub..=row.last {
            let entry = dictionary.entry(at(row.index, sub)).unwrap();
            assert_eq!((entry.index, entry.sub), (row.index, row.sub));
            assert_eq!((entry.data_type, entry.access), (row.data_type, row.access));
        }
    }
}

#[test]
fn sub_index_0_of_a_constant_size_is_the_highest_sub_index() {
    let mut highest = BTreeMap::new();
    for row in rows() {
        highest.insert(row.index, row.last);
    }
    for row in rows()
        .iter()
        .filter(|row| !matches!(row.shape, Shape::Member))
    {
        let last = highest[&row.index];
        assert_eq!(
            matches!(row.shape, Shape::Var),
            last == 0,
            "{:04X}",
            row.index
        );
        if row.access.has(Access::CONST) && last > 0 {
            assert_eq!(
                row.default,
                Default::Value(i64::from(last)),
                "{:04X}",
                row.index
            );
        }
    }
}

#[test]
fn gaps_answer_with_the_right_abort_code() {
    let dictionary = dictionary(Models::WHOLE, Channel::B);
    let missing = |address| dictionary.entry(address).unwrap_err();
    assert_eq!(missing(at(0x1002, 0)), Abort::NoSuchObject);
    assert_eq!(missing(at(0x1800, 4)), Abort::NoSuchSubIndex);
    assert_eq!(missing(at(0x1A00, 9)), Abort::NoSuchSubIndex);
    assert_eq!(missing(at(0x6000, 1)), Abort::NoSuchSubIndex);
    assert_eq!(missing(at(0x1304, 0)), Abort::NoSuchObject);
}

#[test]
fn texts_are_plain_and_short_enough_for_an_eds() {
    for row in rows() {
        assert!(row.name.len() <= 60, "{}", row.name);
        for text in [row.name, row.unit, row.doc] {
            let plain = text.bytes().all(|b| (0x20..0x7F).contains(&b));
            assert!(plain && !text.contains("  "), "{:04X}: {text}", row.index);
        }
        assert!(row.doc.ends_with('.'), "{:04X}: {}", row.index, row.doc);
    }
}

#[test]
fn pdos_as_delivered_map_what_exists_and_fit_into_a_frame() {
    let received = [0x1600, 0x1601].map(|index| (index, 64, Access::RPDO));
    let full = [0x1A01, 0x1A02, 0x1A03, 0x1A06].map(|index| (index, 64, Access::TPDO));
    let partly = [(0x1A00, 48), (0x1A04, 64), (0x1A05, 56)];
    let partly = partly.map(|(index, bits)| (index, bits, Access::TPDO));
    let pdos = full.into_iter().chain(partly);
    let empty = [0x1602, 0x1603].map(|index| (index, 0, Access::RPDO));
    for channel in [Channel::A, Channel::B] {
        let dictionary = dictionary(Models::WHOLE, channel);
        for (index, bits, access) in pdos.clone().chain(received).chain(empty) {
            let mut sum = 0;
            for object in mapped(channel, index) {
                let address = at((object >> 16) as u16, (object >> 8) as u8);
                let entry = dictionary.entry(address).unwrap();
                assert!(entry.access.has(access), "{object:08X}");
                assert_eq!(entry.data_type.size(), Some((object & 0xFF) as usize / 8));
                sum += object & 0xFF;
            }
            assert_eq!(sum, bits, "{index:04X}");
        }
    }
}

#[test]
fn each_channel_takes_the_exchange_and_the_heartbeat_of_the_other() {
    for (own, other) in [(Channel::A, Channel::B), (Channel::B, Channel::A)] {
        assert_eq!(default(own, at(0x1400, 1)), default(other, at(0x1802, 1)));
        assert_eq!(default(own, at(0x2001, 0)), i64::from(other.node_id()));
        assert_eq!(
            default(own, at(0x1016, 1)) >> 16,
            i64::from(other.node_id())
        );
        assert!(default(own, at(0x1016, 1)) & 0xFFFF > 2 * default(other, at(0x1017, 0)));
        assert_eq!(default(own, at(0x1302, 5)), default(other, at(0x1301, 5)));
        assert_eq!(default(own, at(0x1302, 6)), default(other, at(0x1301, 6)));
        assert_eq!(default(own, at(0x1401, 1)), default(other, at(0x1803, 1)));
        let dynamic = |channel: Channel, index| {
            let dictionary = dictionary(Models::DYNAMIC, channel);
            let entry = dictionary.entry(at(index, 1)).unwrap();
            let value = dictionary.default(&entry, channel.node_id());
            value.map(|value| value.number(entry.data_type)).unwrap()
        };
        assert_eq!(dynamic(own, 0x1402), dynamic(other, 0x1806));
        for (into, from) in [(0x1600, 0x1A02), (0x1601, 0x1A03)] {
            let sent = mapped(other, from);
            let moved: Vec<u32> = sent.iter().map(|object| object + 0x0001_0000).collect();
            assert_eq!(mapped(own, into), moved);
        }
    }
}

#[test]
fn identifiers_follow_the_predefined_connection_set() {
    assert_eq!(default(Channel::A, at(0x1800, 1)), 0x181);
    assert_eq!(default(Channel::B, at(0x1801, 1)), 0x282);
    assert_eq!(default(Channel::B, at(0x1803, 1)), 0x482);
    assert_eq!(default(Channel::A, at(0x1014, 0)), 0x81);
    assert_eq!(default(Channel::A, at(0x1200, 1)), 0x601);
    // EN 50325-5: FFh + 2 id and 100h + 2 id.
    for channel in [Channel::A, Channel::B] {
        let twice = 2 * i64::from(channel.node_id());
        assert_eq!(default(channel, at(0x1301, 5)), 0xFF + twice);
        assert_eq!(default(channel, at(0x1301, 6)), 0x100 + twice);
    }
}

fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc: u16, _| {
            (crc << 1) ^ if crc >> 15 == 1 { 0x1021 } else { 0 }
        })
    })
}

/// EN 50325-5: parameters, count, and each entry with its sub-index, little-endian.
fn signature(channel: Channel) -> u16 {
    let mut bytes = Vec::new();
    for (sub, size) in [(1, 1), (2, 2), (3, 1), (5, 4), (6, 4)] {
        let number = default(channel, at(0x1301, sub)) as u64;
        bytes.extend_from_slice(Value::cut(number, size).bytes());
    }
    let mapped = mapped(channel, 0x1381);
    bytes.push(mapped.len() as u8);
    for (object, sub) in mapped.iter().zip(1..) {
        bytes.push(sub);
        bytes.extend_from_slice(&object.to_le_bytes());
    }
    crc(&bytes)
}

#[test]
fn signatures_as_delivered_are_the_computed_ones() {
    assert_eq!(crc(b"123456789"), 0x31C3);
    assert_eq!(signature(Channel::A), 0x93A3);
    for channel in [Channel::A, Channel::B] {
        let stored = default(channel, at(0x13FF, 1));
        assert_eq!(i64::from(signature(channel)), stored);
    }
    let resolution = default(Channel::A, at(0x6200, 0)) as u16;
    let stored = default(Channel::A, at(0x63FF, 1));
    assert_eq!(i64::from(crc(&resolution.to_le_bytes())), stored);
}

#[test]
fn limits_refuse_at_the_write() {
    let dictionary = dictionary(Models::WHOLE, Channel::A);
    let admits = |address, value| dictionary.admits(dictionary.form(address).unwrap(), &value);
    assert_eq!(admits(at(0x2001, 0), Value::u8(0)), Err(Abort::ValueTooLow));
    assert_eq!(
        admits(at(0x2001, 0), Value::u8(128)),
        Err(Abort::ValueTooHigh)
    );
    assert_eq!(admits(at(0x2001, 0), Value::u8(127)), Ok(()));
    // Too many mapped objects have a code of their own, which the PDO gives.
    assert_eq!(admits(at(0x1A00, 0), Value::u8(200)), Ok(()));
    assert_eq!(
        admits(at(0x6011, 0), Value::u8(4)),
        Err(Abort::ValueTooHigh)
    );
    assert_eq!(
        admits(at(0x2040, 1), Value::i32(-180_001)),
        Err(Abort::ValueTooLow)
    );
    assert_eq!(
        admits(at(0x2040, 1), Value::u16(0)),
        Err(Abort::LengthTooLow)
    );
}

#[test]
fn every_twin_of_32_bit_is_stored_and_none_of_16_bit() {
    for base in [0x6010, 0x6020, 0x6810, 0x6820] {
        let dictionary = dictionary(Models::WHOLE, Channel::A);
        for offset in 1..=4 {
            let stored = |index| dictionary.entry(at(index, 0)).unwrap().access;
            assert!(!stored(base + offset).has(Access::STORED));
            assert!(stored(base + 0x100 + offset).has(Access::STORED));
        }
    }
}

#[test]
fn the_tables_that_a_chip_holds_are_small() {
    for models in [Models::PRODUCT, Models::PAPER, Models::DYNAMIC] {
        let dictionary = dictionary(models, Channel::A);
        let table = dictionary.table;
        let bytes = size_of_val(table.rows)
            + size_of_val(table.kinds)
            + size_of_val(table.forms)
            + size_of_val(table.defaults)
            + size_of_val(table.limits)
            + size_of_val(table.variants);
        // A gyroscope adds five PDOs' worth of rows.
        let most = if models == Models::DYNAMIC {
            2816
        } else {
            2560
        };
        assert!(bytes < most, "{bytes} bytes in {} rows", table.rows.len());
        let texts = dictionary
            .entries()
            .filter(|e| e.data_type == DataType::VisibleString);
        assert_eq!(texts.count(), 3);
    }
    assert_eq!((size_of::<PackedRow>(), size_of::<Form>()), (4, 4));
}

#[test]
fn the_variant_with_a_gyroscope_has_the_product_s_rows_and_its_own() {
    let key = |row: &Row| (row.index, row.sub, row.last, row.access, row.default);
    let [product, dynamic] = [Models::PRODUCT, Models::DYNAMIC].map(rows_of);
    let mut own = dynamic.iter().filter(|row| {
        let twin = |other: &&Row| key(other) == key(row);
        product.iter().find(twin).is_none()
    });
    let added = [
        0x1804, 0x1805, 0x1806, 0x1A04, 0x1A05, 0x1A06, 0x2029, 0x202A, 0x202B, 0x202C, 0x2034,
    ];
    // RPDO 3, which is free in the product, takes how far the other channel has turned.
    let taken = [0x1402, 0x1602];
    // The uncertainty of the vertical has a limit as delivered.
    let other_default = [0x2007];
    let known = [added.as_slice(), &taken, &other_default].concat();
    assert!(own.all(|row| known.contains(&row.index)));
    let rows =
        |table: &[Row], of: &[u16]| table.iter().filter(|row| of.contains(&row.index)).count();
    let new = rows(dynamic, &added) + rows(dynamic, &taken) - rows(product, &taken);
    assert_eq!(dynamic.len(), product.len() + new);
    assert!(!product.iter().any(|row| added.contains(&row.index)));
}

#[test]
fn the_two_tpdos_beyond_the_predefined_set_are_off_and_as_long_as_stated() {
    for (pdo, cob_id, bits) in [(4, 0x201, 64), (5, 0x301, 56)] {
        assert_eq!(
            default(Channel::A, at(0x1800 + pdo, 1)),
            0x8000_0000 + cob_id
        );
        assert_eq!(default(Channel::A, at(0x1800 + pdo, 2)), 1);
        let objects = mapped(Channel::A, 0x1A00 + pdo);
        assert_eq!(
            objects.iter().map(|object| object & 0xFF).sum::<u32>(),
            bits
        );
    }
}

/// Whoever gives a channel another node-id knows from this all that the other one has stored of
/// it: its node-id (2001h), its heartbeat (1016h) and its exchange.
#[test]
fn what_a_channel_stores_of_the_other_one_is_its_node_id_heartbeat_and_exchange() {
    for (models, rpdos) in [
        (Models::WHOLE, 2),
        (Models::PRODUCT, 2),
        (Models::PAPER, 2),
        (Models::DYNAMIC, 3),
    ] {
        let exchange = exchange(models).map(|(index, _)| (index, 1));
        let mut known: Vec<_> = [(0x1016, 1), (0x2001, 0)]
            .into_iter()
            .chain(exchange)
            .collect();
        assert_eq!(known.len(), 2 + rpdos);
        // Safety frames do not follow the node-ids.
        let is_safety = |row: &Row| (0x1301..=0x13FF).contains(&row.index);
        let of_the_other = |row: &&Row| {
            let differs = matches!(row.default, Default::Channel(..));
            differs && row.access.has(Access::STORED) && !is_safety(row)
        };
        let mut stored: Vec<_> = rows_of(models)
            .iter()
            .filter(of_the_other)
            .map(|row| (row.index, row.sub))
            .collect();
        stored.sort();
        known.sort();
        assert_eq!(stored, known);
    }
}
