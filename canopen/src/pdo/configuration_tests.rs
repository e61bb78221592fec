//! Conversations about the configuration: what is written by SDO, and what is refused.

use super::tests::{Bench, KNOB, OFF, PERCENT, X, Y, ms};
use super::*;
use crate::mapping::shelf::Shelf;
use crate::object::{Access, at};
use proptest::prelude::*;

#[test]
fn an_index_of_somebody_else_is_left_alone() {
    let mut bench = Bench::new();
    let dictionary = bench.shelf.dictionary();
    for index in [0x13FF, 0x1404, 0x1604, 0x1804, 0x1A04, 0x1C00, 0x2000] {
        let address = at(index, 1);
        assert_eq!(bench.pdo.read(address), None);
        assert_eq!(
            bench
                .pdo
                .write::<Shelf>(&dictionary, address, Value::u32(0)),
            None
        );
        assert!(!bench.pdo.load(address, Value::u32(0)));
    }
}

#[test]
fn sub_indices_are_those_of_the_standard() {
    let bench = Bench::new();
    assert_eq!((bench.read(0x1400, 0), bench.read(0x1803, 0)), (5, 6));
    for (index, sub) in [
        (0x1400, 4),
        (0x1400, 6),
        (0x1800, 4),
        (0x1800, 7),
        (0x1A00, 9),
    ] {
        let read = bench.pdo.clone().read(at(index, sub));
        assert_eq!(read, Some(Err(Abort::NoSuchSubIndex)));
    }
}

#[test]
fn a_configuration_reads_back() {
    let mut bench = Bench::new();
    bench.set_up(0x1801, 0x4000_0281, 1, &[X, Y]);
    assert_eq!(bench.read(0x1801, 1), 0x4000_0281);
    assert_eq!(bench.read(0x1801, 2), 1);
    assert_eq!(bench.read(0x1A01, 0), 2);
    assert_eq!(bench.read(0x1A01, 2), u64::from(Y));
}

#[test]
fn mapping_count_200_is_refused() {
    let mut bench = Bench::new();
    for count in [9, 200, 254, 255] {
        assert_eq!(bench.write(0x1A00, 0, count), Err(Abort::PdoTooLong));
    }
    assert_eq!(bench.read(0x1A00, 0), 0);
}

#[test]
fn a_non_mappable_object_is_not_mapped() {
    let mut bench = Bench::new();
    assert_eq!(bench.write(0x1A00, 1, 0x6011_0008), Err(Abort::NotMappable));
    assert_eq!(bench.write(0x1A00, 1, KNOB), Err(Abort::NotMappable));
    assert_eq!(bench.write(0x1600, 1, X), Err(Abort::NotMappable));
    assert_eq!(bench.write(0x1A00, 1, 0x6010_0020), Err(Abort::NotMappable));
    assert_eq!(
        bench.write(0x1A00, 1, 0x7000_0010),
        Err(Abort::NoSuchObject)
    );
    assert_eq!(
        bench.write(0x1A00, 1, 0x6010_0510),
        Err(Abort::NoSuchSubIndex)
    );
    assert_eq!(bench.read(0x1A00, 1), 0);
}

#[test]
fn a_mapping_with_a_hole_is_refused() {
    let mut bench = Bench::new();
    bench.write(0x1A00, 1, X).unwrap();
    bench.write(0x1A00, 3, Y).unwrap();
    assert_eq!(bench.write(0x1A00, 0, 3), Err(Abort::NoSuchObject));
    assert_eq!(bench.read(0x1A00, 0), 0);
}

#[test]
fn more_than_64_bits_are_refused() {
    let mut bench = Bench::new();
    let result = bench.map(0x1A00, &[0x2040_0040, X]);
    assert_eq!(result, Err(Abort::PdoTooLong));
    assert_eq!(bench.read(0x1A00, 0), 0);
}

#[test]
fn a_mapping_stays_while_the_pdo_exists() {
    let mut bench = Bench::with_tpdo(1);
    assert_eq!(bench.write(0x1A00, 0, 0), Err(Abort::UnsupportedAccess));
    assert_eq!(bench.write(0x1A00, 1, Y), Err(Abort::UnsupportedAccess));
    bench.write(0x1800, 1, 0x181 | OFF).unwrap();
    assert_eq!(bench.write(0x1A00, 1, Y), Err(Abort::UnsupportedAccess));
    assert_eq!(bench.map(0x1A00, &[Y]), Ok(()));
}

#[test]
fn a_cob_id_changes_only_while_the_pdo_does_not_exist() {
    let mut bench = Bench::with_tpdo(1);
    assert_eq!(bench.write(0x1800, 1, 0x182), Err(Abort::InvalidValue));
    assert_eq!(bench.write(0x1800, 1, 0x4000_0181), Ok(()));
    assert_eq!(bench.write(0x1800, 1, OFF), Ok(()));
    assert_eq!(bench.write(0x1800, 1, 0x182), Ok(()));
}

#[test]
fn restricted_and_long_identifiers_are_refused() {
    let mut bench = Bench::new();
    let edges = [0, 1, 0x7F, 0x101, 0x180, 0x581, 0x5FF, 0x601, 0x67F];
    for id in edges.into_iter().chain([0x6E0, 0x6FF, 0x701, 0x7FF]) {
        assert_eq!(
            bench.write(0x1800, 1, id),
            Err(Abort::InvalidValue),
            "{id:X}"
        );
    }
    for long in [
        0x2000_0181,
        0x2000_0181 | OFF,
        0x0000_0981,
        0x1000_0000 | OFF,
    ] {
        assert_eq!(bench.write(0x1800, 1, long), Err(Abort::InvalidValue));
    }
    for id in [0x080, 0x100, 0x181, 0x580, 0x600, 0x680, 0x6DF, 0x700] {
        assert_eq!(bench.write(0x1800, 1, OFF), Ok(()));
        assert_eq!(bench.write(0x1800, 1, id), Ok(()), "{id:X}");
    }
}

#[test]
fn transmission_types_that_are_not_served_are_refused() {
    let mut bench = Bench::new();
    for kind in 0..=255 {
        let good = matches!(kind, 0..=240 | 254 | 255);
        let expected = if good {
            Ok(())
        } else {
            Err(Abort::InvalidValue)
        };
        assert_eq!(bench.write(0x1800, 2, kind), expected, "{kind}");
        assert_eq!(bench.write(0x1400, 2, kind), expected, "{kind}");
    }
}

#[test]
fn inhibit_time_and_sync_start_stay_while_the_pdo_exists() {
    let mut bench = Bench::with_tpdo(1);
    for sub in [3, 6] {
        assert_eq!(bench.write(0x1800, sub, 5), Err(Abort::UnsupportedAccess));
        assert_eq!(bench.write(0x1800, sub, 0), Ok(()));
    }
    assert_eq!(bench.write(0x1800, 5, 100), Ok(()));
    bench.write(0x1800, 1, OFF).unwrap();
    assert_eq!(bench.write(0x1800, 6, 241), Err(Abort::InvalidValue));
    assert_eq!(bench.write(0x1800, 6, 240), Ok(()));
    assert_eq!(bench.write(0x1800, 3, 65535), Ok(()));
}

#[test]
fn what_was_loaded_and_does_not_hold_is_switched_off() {
    let mut bench = Bench::new();
    let dictionary = bench.shelf.dictionary();
    let load = |bench: &mut Bench, index, sub, number| {
        assert!(bench.pdo.load(at(index, sub), Value::u32(number)));
    };
    load(&mut bench, 0x1A00, 0, 1);
    load(&mut bench, 0x1A00, 1, X);
    load(&mut bench, 0x1800, 1, 0x181);
    assert_eq!(bench.pdo.check(&dictionary), Ok(()));
    load(&mut bench, 0x1801, 1, 0x281);
    load(&mut bench, 0x1A01, 0, 1);
    load(&mut bench, 0x1A01, 1, 0x6011_0008);
    load(&mut bench, 0x1402, 1, 0x601);
    assert_eq!(bench.pdo.check(&dictionary), Err(Abort::InvalidValue));
    assert_eq!(
        (bench.read(0x1801, 1), bench.read(0x1A01, 0)),
        (0x8000_0000, 0)
    );
    assert_eq!(bench.read(0x1402, 1), 0x8000_0000);
    assert_eq!((bench.read(0x1800, 1), bench.read(0x1A00, 0)), (0x181, 1));
    assert_eq!(bench.pdo.check(&dictionary), Ok(()));
}

/// Numbers that come near to making sense, and any other.
fn number() -> impl Strategy<Value = u32> {
    prop_oneof![
        prop::sample::select(&[X, Y, KNOB, PERCENT, 0x2040_0040, 0x2030_0020, 0x0005_0008][..]),
        prop::sample::select(&[0, 1, 2, 8, 200, 255, OFF, 0x181, 0x201, 0x8000_0181][..]),
        any::<u32>(),
    ]
}

fn active_mappings_hold(bench: &Bench) -> bool {
    let dictionary = bench.shelf.dictionary();
    let sound = |base: u16, access: Access| {
        (base..base + 4).all(|index| {
            let exists = bench.read(index, 1) & u64::from(OFF) == 0;
            let count = bench.read(index + 0x200, 0) as u8;
            let entries = (1..=count.min(8)).map(|sub| bench.read(index + 0x200, sub) as u32);
            let bits: u32 = entries.clone().map(|entry| entry & 0xFF).sum();
            let mut rows = entries.map(|entry| {
                let dummy = access == Access::RPDO && entry >> 16 < 8;
                let row = dictionary.entry(at((entry >> 16) as u16, (entry >> 8) as u8));
                dummy || row.is_ok_and(|row| row.access.has(access))
            });
            !exists || count <= 8 && bits <= 64 && rows.all(|sound| sound)
        })
    };
    sound(0x1400, Access::RPDO) && sound(0x1800, Access::TPDO)
}

proptest! {
    #[test]
    fn no_way_of_writing_leaves_an_active_pdo_with_a_mapping_that_does_not_hold(
        loads in prop::collection::vec((0_u16..16, 0_u8..10, number()), 0..20),
        writes in prop::collection::vec((0_u16..16, 0_u8..10, number()), 0..80),
    ) {
        let index = |n: u16| 0x1400 + 0x200 * (n >> 2) + (n & 3);
        let mut bench = Bench::new();
        for (n, sub, number) in loads {
            bench.pdo.load(at(index(n), sub), Value::u32(number));
        }
        let _ = bench.pdo.check(&bench.shelf.dictionary());
        prop_assert!(active_mappings_hold(&bench));
        bench.pdo.start(ms(0));
        for (now, (n, sub, number)) in (1..).zip(writes) {
            let before = bench.pdo.read(at(index(n), sub));
            if bench.write(index(n), sub, number).is_err() {
                prop_assert_eq!(bench.pdo.read(at(index(n), sub)), before);
            }
            prop_assert!(active_mappings_hold(&bench));
            bench.sync(ms(now));
            bench.event(ms(now));
            bench.poll(ms(now));
            bench.hear(number as u16 & 0x7FF, &number.to_le_bytes(), ms(now));
            let sent = (0..9).filter(|_| bench.pdo.transmit(ms(now)).is_some()).count();
            prop_assert!(sent <= PDOS);
        }
    }
}
