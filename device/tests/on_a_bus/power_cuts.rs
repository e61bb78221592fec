//! The supply fails at every single flash operation of a store, and the device starts again.
//!
//! In: a device with something stored, and a master that stores something else over the bus. Out:
//! after the restart the device shows the old or the new, never a third, measures with it at once
//! (R8), and stores again when asked.

use canopen::object::{Value, at};
use device::calibration::encoding::{MAX_LENGTH, identity, length, read_at};
use device::fault::Fault;
use device::objects::table::Channel;
use device::records::{EventStore, Record, RecordStore};
use tilt::angle::{Angle, Axes};
use tilt::chain::{Calibration, Correction};
use tilt::rate::RateCorrection;
use tilt::sample::Temperature;
use tilt::table::{Point, Rule, Table};
use tilt::temperature::{Piecewise, TemperatureModel};
use tilt::uncertainty::{Budget, Span, Uncertainty};

use crate::site::{self, Memory, Seeded, Site, along, blank};

/// "save", 1010h.
const SAVE: u32 = u32::from_le_bytes(*b"save");

fn powered(memory: Memory) -> Site {
    Site::with(Channel::A, along(0x2D), memory)
}

/// Cuts each operation of `store` on a device with this memory; `shows` returns what it shows after
/// the restart: whether that is the new. How many operations there were.
fn cut_each(
    memory: &Memory,
    store: impl Fn(&mut Site),
    mut shows: impl FnMut(&mut Site) -> bool,
) -> u64 {
    let mut whole = powered(memory.clone());
    let before = whole.device.memory().flash().operations();
    store(&mut whole);
    let operations = whole.device.memory().flash().operations() - before;
    assert_eq!(whole.device.memory().flash().broken_rules(), 0);
    whole.power_cycle();
    assert!(shows(&mut whole), "stored without a cut");
    let mut renewed = 0;
    for cut in 0..operations {
        let mut memory = memory.clone();
        memory
            .flash_mut()
            .set_draw(Seeded(cut.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1));
        let mut site = powered(memory);
        site.device.memory().flash_mut().cut_after(cut);
        store(&mut site);
        assert!(site.device.memory().flash().is_cut(), "operation {cut}");
        site.power_cycle();
        renewed += u64::from(shows(&mut site));
        store(&mut site);
        site.power_cycle();
        assert!(shows(&mut site), "stored again after a cut at {cut}");
        assert_eq!(site.device.memory().flash().broken_rules(), 0, "{cut}");
    }
    // Nothing new counts before the last operation of all, whose bits may all be done by chance.
    assert!(renewed <= 1, "{renewed} of {operations}");
    operations
}

/// Two parameters of each group that belongs to the application, and the value that all get.
fn parameters() -> [(u16, [Value; 2]); 4] {
    [
        (0x2004, [Value::u16(1), Value::u16(2)]),
        (0x2005, [Value::u8(0), Value::u8(1)]),
        (0x6000, [Value::u16(10), Value::u16(100)]),
        (0x6200, [Value::u16(10), Value::u16(100)]),
    ]
}

fn set(site: &mut Site, which: usize) {
    for (index, values) in parameters() {
        assert_eq!(site.write(at(index, 0), values[which]), Some(Ok(())));
    }
}

#[test]
fn a_cut_at_any_operation_of_a_parameter_store_leaves_each_group_old_or_new() {
    let mut site = powered(blank());
    set(&mut site, 0);
    assert_eq!(site.write(at(0x1010, 1), Value::u32(SAVE)), Some(Ok(())));
    let memory = site.device.memory().clone();
    let store = |site: &mut Site| {
        set(site, 1);
        let _ = site.write(at(0x1010, 1), Value::u32(SAVE));
    };
    let operations = cut_each(&memory, store, |site| {
        let shown = parameters().map(|(index, values)| {
            let read = site.read(at(index, 0)).unwrap().unwrap();
            let which = values.iter().position(|value| *value == read);
            which.unwrap_or_else(|| panic!("{index:04X}: {read:?}"))
        });
        let [latch, alone, resolution, safe] = shown;
        assert_eq!((latch, resolution), (alone, safe), "{shown:?}");
        shown == [1; 4]
    });
    assert!(operations > 600, "{operations}");
}

#[test]
fn a_box_that_another_event_took_over_was_left_staged_and_storing_failed() {
    let mut site = powered(blank());
    let memory = site.device.memory();
    for _ in 0..100 {
        let begun = RecordStore::begin(memory, Record::Box1, Record::Box1.longest());
        assert_eq!(begun, Ok(()));
        assert_eq!(RecordStore::append(memory, &[7; 1600]), Ok(()));
        if memory.needs_room() {
            break;
        }
        assert_eq!(RecordStore::commit(memory), Ok(()));
    }
    assert!(memory.needs_room());
    site.pass(100);
    assert!(!site.device.memory().needs_room());
    assert!(!site.device.faults().has(Fault::Storage));
}

/// The longest calibration: tables of as many points as there are, and a gyroscope.
/// They turn every angle by `turn` units.
fn tables(turn: i32) -> Calibration {
    let points: Vec<_> = (-90..=90)
        .map(|degrees: i32| Point {
            accel: degrees * 700_000,
            angle: Angle(degrees * 11_930_465 + turn),
        })
        .collect();
    let table = Table::new(&points).unwrap();
    let mut piecewise = Piecewise::default();
    for (knot, value) in piecewise.knots.iter_mut().zip(0..) {
        *knot = Temperature(25 * 256 + value);
    }
    Calibration {
        temperature: TemperatureModel::Piecewise(piecewise),
        correction: Correction::Tables {
            tables: Axes {
                x: table.clone(),
                y: table,
            },
            rule: Rule::Linear,
        },
        budget: Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::REFERENCE),
        rates: Some(RateCorrection::IDENTITY),
    }
}

fn bytes(calibration: &Calibration) -> Vec<u8> {
    let mut bytes = vec![0; length(calibration) as usize];
    assert_eq!(read_at(calibration, 0, &mut bytes), bytes.len());
    bytes
}

#[test]
fn a_cut_at_any_operation_of_a_calibration_leaves_the_old_or_the_new_which_measures_at_once() {
    let [old, new] = [tables(0), tables(10_000_000)];
    assert_eq!(length(&new), MAX_LENGTH);
    let mut site = powered(blank());
    let whole = site.download(at(0x2061, 0), &bytes(&old));
    assert_eq!(whole, Some(Ok(())));
    let memory = site.device.memory().clone();
    let sent = bytes(&new);
    let store = |site: &mut Site| {
        let _ = site.download(at(0x2061, 0), &sent);
    };
    let operations = cut_each(&memory, store, |site| {
        let shown = site.read(at(0x2062, 1)).unwrap().unwrap().unsigned();
        let which = [identity(&old), identity(&new)].map(|identity| u64::from(identity) == shown);
        assert!(which[0] != which[1], "{shown:08X}");
        assert_eq!(site.device.faults().bits(), 0);
        which[1]
    });
    assert!(operations > 1538, "{operations}");
    // The angle is there within a second, and is that of the table.
    let mut site = powered(memory);
    let angle = |site: &mut Site| site.read(at(0x6010, 0)).unwrap().unwrap().signed();
    store(&mut site);
    site.power_cycle();
    site.measure(400);
    assert_eq!(site.device.shown(site.now).validity() & 3, 3);
    assert_eq!(angle(&mut site), 84);
}

/// A calibration counts as a whole: without a gyroscope's correction there is none.
#[test]
fn a_download_takes_or_removes_the_gyroscopes_correction_and_a_power_cycle_keeps_that() {
    let mut site = powered(blank());
    let rates = |site: &Site| site.device.settings().chain.calibration.rates;
    let with = tables(0);
    let without = Calibration {
        rates: None,
        ..tables(1)
    };
    let mut implausible = tables(2);
    let turned = implausible.rates.as_mut().unwrap();
    turned.bias_q30[2] = i32::MAX;
    for calibration in [&with, &without, &with] {
        let told = site.download(at(0x2061, 0), &bytes(calibration));
        assert_eq!(told, Some(Ok(())));
        assert_eq!(rates(&site), calibration.rates);
        site.power_cycle();
        assert_eq!(rates(&site), calibration.rates);
    }
    let told = site.download(at(0x2061, 0), &bytes(&implausible));
    assert_eq!(told, Some(Err(0x0800_0020)));
    assert_eq!(site.device.settings().chain.calibration, with);
}

#[test]
fn a_cut_at_any_operation_of_a_reports_hash_leaves_the_old_or_the_new() {
    let mut site = powered(blank());
    assert_eq!(
        site.download(at(0x2061, 0), &bytes(&tables(0))),
        Some(Ok(()))
    );
    assert_eq!(site.download(at(0x2063, 0), &[0x0D; 32]), Some(Ok(())));
    let memory = site.device.memory().clone();
    let store = |site: &mut Site| {
        let _ = site.download(at(0x2063, 0), &[0x4E; 32]);
    };
    let operations = cut_each(&memory, store, |site| {
        let mut record = [0; 40];
        let memory = site.device.memory();
        let length = RecordStore::read(memory, Record::Report, 0, &mut record);
        let (head, hash) = record[..length].split_at(4);
        assert_eq!(head, identity(&tables(0)).to_le_bytes());
        assert!(hash == [0x0D; 32] || hash == [0x4E; 32], "{hash:?}");
        assert_eq!(site.device.faults().bits(), 0);
        hash == [0x4E; 32]
    });
    assert!(operations > 18, "{operations}");
}

#[test]
fn what_one_bad_bit_had_destroyed_was_replaced_by_older_things_without_a_word() {
    let own = identity(&tables(10_000_000));
    let delivered = identity(&site::delivered());
    let mut site = powered(blank());
    let stored = bytes(&tables(10_000_000));
    assert_eq!(site.download(at(0x2061, 0), &stored), Some(Ok(())));
    for which in [0, 1] {
        set(&mut site, which);
        assert_eq!(site.write(at(0x1010, 1), Value::u32(SAVE)), Some(Ok(())));
    }
    let memory = site.device.memory().clone();
    let pages = memory.flash().pages().iter();
    let held: Vec<u8> = pages.flat_map(|page| *page.bytes()).collect();
    // What it shows after a bit in the last place with these bytes has gone bad, and its faults.
    let shows = |bytes: Option<&[u8]>| {
        let mut memory = memory.clone();
        if let Some(bytes) = bytes {
            let place = held.windows(bytes.len()).rposition(|held| held == bytes);
            memory.flash_mut().flip(place.expect("stored") as u32, 4);
        }
        let mut site = powered(memory);
        site.power_cycle();
        site.pass(100);
        let calibration = site.read(at(0x2062, 1)).unwrap().unwrap().unsigned();
        let latch = site.read(at(0x2004, 0)).unwrap().unwrap().unsigned();
        (calibration, latch, site.device.faults().bits() & 0x380)
    };
    assert_eq!(shows(None), (own.into(), 2, 0));
    let lost = shows(Some(&stored[..40]));
    assert_eq!(lost, (delivered.into(), 2, 1 << 8));
    // 2004h as it is stored: index, sub-index, length, value.
    let lost = shows(Some(&[0x04, 0x20, 0, 2, 2, 0]));
    assert_eq!(lost, (own.into(), 1, 1 << 9));
}
