//! The whole device, with its own dictionary, under sequences of things that masters, machines and
//! people do to it, in any order.
//!
//! After each of them: the NMT state is legal, output is bounded, no PDO is on with a mapping that
//! does not hold, and a safety configuration that calls itself valid is signed. A write that is
//! refused has changed nothing, one that is taken reads back, what is stored comes back, and a
//! restore gives back what the rows promise.

use std::cell::RefCell;
use std::collections::BTreeMap;

use canopen::Frame;
use canopen::nmt::State;
use canopen::node::UNCONFIGURED;
use canopen::object::{Access, Address, Value, at};
use canopen::srdo::SrdoState;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;

use crate::site::Site;
use device::device::BoardRequest;
use device::objects::row::{Default, Row};
use device::objects::table::{Channel, Models, rows};
use instant::Instant;

const SAVE: u32 = canopen::storage::SAVE;
const LOAD: u32 = canopen::storage::LOAD;

/// Something that happens to the device.
#[derive(Clone, Debug)]
enum Step {
    Write(usize, u8, Number),
    Nmt(u8),
    Sync,
    Exchange([u8; 8]),
    Lss(u8),
    Map(u16, Vec<u32>, u8),
    Sign,
    StoreAndCycle(u8),
    Restore(u8),
    Reset(u8),
    Controller(u8),
    FailSafe,
    Measure(u16),
    Pass(u32),
}

/// A number for a row: within its limits, just outside, or any.
#[derive(Clone, Copy, Debug)]
enum Number {
    Low(i64),
    High(i64),
    Between(u32),
    Any(u32),
    Default,
}

fn number() -> impl Strategy<Value = Number> {
    prop_oneof![
        (-1..=1_i64).prop_map(Number::Low),
        (-1..=1_i64).prop_map(Number::High),
        any::<u32>().prop_map(Number::Between),
        any::<u32>().prop_map(Number::Any),
        Just(Number::Default),
    ]
}

/// Objects that a PDO may, and some that it may not, carry.
fn mappable() -> impl Strategy<Value = u32> {
    let objects = [
        0x6010_0010_u32,
        0x6110_0020,
        0x2020_0008,
        0x2022_0310,
        0x2011_0118,
        0x2011_0308,
        0x1001_0008,
        0x6010_0008,
        0x1000_0020,
        0x7000_0010,
        0x2061_0000,
        0x2063_0000,
        0x0005_0008,
        0,
    ];
    prop::sample::select(objects.to_vec())
}

fn step() -> impl Strategy<Value = Step> {
    let writable = rows()
        .iter()
        .filter(|row| row.access.has(Access::WRITE))
        .count();
    let pdo = prop::sample::select(vec![0x1400_u16, 0x1401, 0x1800, 0x1801, 0x1803]);
    let entries = prop::collection::vec(mappable(), 0..4);
    let kind = prop::sample::select(vec![0_u8, 1, 2, 240, 250, 254, 255]);
    prop_oneof![
        12 => (0..writable, any::<u8>(), number()).prop_map(|(r, s, n)| Step::Write(r, s, n)),
        4 => prop::sample::select(vec![1_u8, 1, 2, 128, 128, 130]).prop_map(Step::Nmt),
        2 => Just(Step::Sync),
        2 => any::<[u8; 8]>().prop_map(Step::Exchange),
        1 => prop_oneof![any::<u8>(), Just(255), Just(253)].prop_map(Step::Lss),
        2 => (pdo, entries, kind).prop_map(|(p, e, k)| Step::Map(p, e, k)),
        1 => Just(Step::Sign),
        1 => (0..=5_u8).prop_map(Step::StoreAndCycle),
        1 => (0..=5_u8).prop_map(Step::Restore),
        1 => prop::sample::select(vec![129_u8, 130]).prop_map(Step::Reset),
        1 => (0..3_u8).prop_map(Step::Controller),
        1 => Just(Step::FailSafe),
        2 => (0..300_u16).prop_map(Step::Measure),
        2 => (0..20_000_u32).prop_map(Step::Pass),
    ]
}

fn run(site: &mut Site, step: Step) {
    match step {
        Step::Write(row, sub, number) => write_row(site, row, sub, number),
        Step::Nmt(specifier) => site.nmt(specifier),
        Step::Sync => site.hears(0x80, &[]),
        Step::Exchange(bytes) => {
            let id = if site.channel == Channel::A {
                0x382
            } else {
                0x381
            };
            let peer = if site.channel == Channel::A { 2 } else { 1 };
            site.hears(0x700 + peer, &[5]);
            site.hears(id, &bytes);
        }
        Step::Lss(choice) => configure_lss(site, choice),
        Step::Map(pdo, entries, kind) => map(site, pdo, &entries, kind),
        Step::Sign => sign(site),
        Step::StoreAndCycle(sub) => store_and_cycle(site, sub),
        Step::Restore(sub) => {
            site.write(at(0x1011, sub), Value::u32(LOAD));
        }
        Step::Reset(specifier) => site.nmt(specifier),
        Step::Controller(state) => site.controller(state),
        Step::FailSafe => {
            site.nmt(128);
            site.write(at(0x1300, 0), Value::u8(1));
            site.nmt(1);
            site.hears(1, &[]);
        }
        Step::Measure(samples) => site.measure(samples),
        Step::Pass(ms) => site.pass(ms),
    }
}

/// Every address of every row that has a size and all of `access`.
fn addresses(access: Access) -> Vec<(&'static Row, Address)> {
    let sized = |row: &&Row| row.access.has(access) && row.data_type.size().is_some();
    let spread = |row: &'static Row| (row.sub..=row.last).map(move |sub| (row, at(row.index, sub)));
    rows().iter().filter(sized).flat_map(spread).collect()
}

/// What all rows that can be written read now.
fn snapshot(site: &mut Site, access: Access) -> Vec<(Address, Result<Value, u32>)> {
    let all = addresses(access.and(Access::READ)).into_iter();
    all.map(|(_, at)| (at, site.read(at).unwrap())).collect()
}

fn pick(row: &Row, number: Number) -> Value {
    let size = row.data_type.size().unwrap();
    let bits = 8 * size as u32;
    let whole = if row.data_type.is_signed() {
        (-(1_i64 << (bits - 1)), (1_i64 << (bits - 1)) - 1)
    } else {
        (0, (1_i64 << bits) - 1)
    };
    let (low, high) = row.limits.unwrap_or(whole);
    let number = match number {
        Number::Low(beside) => low + beside,
        Number::High(beside) => high + beside,
        Number::Between(n) => low + i64::from(n) % (high - low + 1),
        Number::Any(n) => i64::from(n),
        Number::Default => match row.default {
            Default::Value(n) | Default::NodeId(n) | Default::Channel(n, _) => n,
            Default::None | Default::Text(_) => 0,
        },
    };
    Value::cut(number as u64, size)
}

/// Rows that do something at a write and read something else.
const fn acts(index: u16) -> bool {
    matches!(index, 0x1010 | 0x1011 | 0x1F51)
}

/// 13FEh and 63FEh have two states: A5h, and anything else, which reads 0.
const fn settled(index: u16, number: u64) -> u64 {
    if matches!(index, 0x13FE | 0x63FE) && number != 0xA5 {
        0
    } else {
        number
    }
}

fn write_row(site: &mut Site, row: usize, sub: u8, number: Number) {
    let writable = rows().iter().filter(|row| row.access.has(Access::WRITE));
    let row = writable.clone().nth(row).unwrap();
    if row.data_type.size().is_none() || site.read(at(0x1000, 0)).is_none() {
        return;
    }
    let at = at(row.index, row.sub + sub % (row.last - row.sub + 1));
    let value = pick(row, number);
    let before = snapshot(site, Access::WRITE);
    match site.write(at, value) {
        Some(Err(_)) => assert_eq!(snapshot(site, Access::WRITE), before, "{at:?} = {value:?}"),
        Some(Ok(())) if !acts(at.index) && row.access.has(Access::READ) => {
            let read = site.read(at).unwrap().unwrap();
            assert_eq!(
                read.unsigned(),
                settled(at.index, value.unsigned()),
                "{at:?}"
            );
        }
        Some(Ok(())) | None => {}
    }
}

fn configure_lss(site: &mut Site, choice: u8) {
    site.nmt(128);
    site.hears(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
    let node_id = if choice < 253 { choice >> 1 } else { 255 };
    site.hears(0x7E5, &[0x11, node_id, 0, 0, 0, 0, 0, 0]);
    site.hears(0x7E5, &[0x13, 0, choice % 11, 0, 0, 0, 0, 0]);
    let specifier = if choice & 2 == 0 { 0x15 } else { 0x17 };
    site.hears(0x7E5, &[specifier, 10, 0, 0, 0, 0, 0, 0]);
    site.hears(0x7E5, &[4, 0, 0, 0, 0, 0, 0, 0]);
}

fn map(site: &mut Site, index: u16, entries: &[u32], kind: u8) {
    let id = u32::from(site.device.bus().node_id());
    let mapping = index + 0x200;
    site.write(at(index, 1), Value::u32(0x8000_0000));
    site.write(at(mapping, 0), Value::u8(0));
    for (sub, entry) in (1..).zip(entries) {
        site.write(at(mapping, sub), Value::u32(*entry));
    }
    site.write(at(mapping, 0), Value::u8(entries.len() as u8));
    site.write(at(index, 2), Value::u8(kind));
    let cob_id = if index < 0x1800 { 0x382 } else { 0x180 + id };
    site.write(at(index, 1), Value::u32(cob_id));
}

/// A tool signs everything; what does not hold is refused.
fn sign(site: &mut Site) {
    for srdo in [0, 1] {
        let signature = site.device.bus().communication().safety.signature(srdo);
        site.write(at(0x13FF, srdo as u8 + 1), Value::u16(signature));
    }
    site.write(at(0x63FF, 1), Value::u16(application_signature(site)));
    site.write(at(0x63FE, 0), Value::u8(0xA5));
    site.write(at(0x13FE, 0), Value::u8(0xA5));
}

fn application_signature(site: &Site) -> u16 {
    let resolution = site.device.values().parameters.safety_resolution;
    canopen::crc::update(0, &resolution.to_le_bytes())
}

fn store_and_cycle(site: &mut Site, sub: u8) {
    site.nmt(128);
    let stored = site.write(at(0x1010, sub), Value::u32(SAVE));
    let before = (stored == Some(Ok(()))).then(|| snapshot(site, Access::STORED));
    site.power_cycle();
    // Only what was stored comes back, and a device without a node-id shows nothing.
    if let (Some(before), 1, Some(_)) = (before, sub, site.read(at(0x1000, 0))) {
        assert_eq!(snapshot(site, Access::STORED), before);
    }
}

fn check(site: &mut Site) {
    let node = site.device.bus();
    let unconfigured = node.node_id() == canopen::node::UNCONFIGURED;
    let initialising = node.state() == canopen::nmt::State::Initialising;
    assert_eq!(initialising, unconfigured);
    assert_eq!(node.state(), site.device.values().state);
    let services = node.communication();
    let read = |index, sub| {
        let pdo = services.pdo.clone().read(at(index, sub));
        let value = pdo
            .or_else(|| services.safety.read(at(index, sub)))
            .unwrap();
        value.unwrap().unsigned()
    };
    let dictionary = device::objects::table::dictionary(Models::WHOLE, site.channel);
    for (base, access) in [(0x1400, Access::RPDO), (0x1800, Access::TPDO)] {
        for index in (base..base + 4).filter(|index| read(*index, 1) >> 31 == 0) {
            let count = read(index + 0x200, 0) as u8;
            let entries = (1..=count).map(|sub| read(index + 0x200, sub) as u32);
            let bits: u32 = entries.clone().map(|entry| entry & 0xFF).sum();
            assert!(bits <= 64, "{index:04X}: {bits} bit");
            for entry in entries {
                assert_eq!(canopen::mapping::admits(&dictionary, entry, access), Ok(()));
            }
        }
    }
    if read(0x13FE, 0) == 0xA5 {
        for srdo in (0..2).filter(|n| read(0x1301 + n, 1) != 0) {
            let signature = u64::from(services.safety.signature(usize::from(srdo)));
            assert_eq!(read(0x13FF, srdo as u8 + 1), signature);
        }
    }
    let parameters = &site.device.values().parameters;
    for resolution in parameters.resolution {
        let largest = parameters.range.map(i32::abs).into_iter().max().unwrap();
        assert!(largest <= 32_768 * i32::from(resolution), "{parameters:?}");
    }
    if parameters.safety_valid == 0xA5 {
        assert_eq!(parameters.safety_signature, application_signature(site));
    }
}

/// Restores everything, starts anew, and reads what the rows promise.
fn restored(site: &mut Site) {
    site.nmt(128);
    assert_eq!(site.write(at(0x1011, 1), Value::u32(LOAD)), Some(Ok(())));
    site.nmt(129);
    site.give_node_id();
    let id = i64::from(site.device.bus().node_id());
    let second = site.channel == Channel::B;
    let mut compared = 0;
    // Errors that stand have no default to go back to.
    let settable = |index| !matches!(index, 0x1001 | 0x1003);
    let rows = addresses(Access::READ).into_iter();
    for (row, at) in rows.filter(|(_, at)| settable(at.index)) {
        let promised = match row.default {
            Default::Value(n) => n,
            Default::NodeId(n) => n + id,
            Default::Channel(a, b) => {
                if second {
                    b
                } else {
                    a
                }
            }
            Default::None | Default::Text(_) => continue,
        };
        let read = site.read(at).unwrap().unwrap();
        assert_eq!(read.number(row.data_type), promised, "{at:?}");
        compared += 1;
    }
    assert!(compared > 200, "{compared}");
}

/// What the run has seen, to be sure that it has been somewhere.
fn tally(site: &Site, seen: &mut BTreeMap<&'static str, u32>) {
    let node = site.device.bus();
    let valid = site.device.values().parameters.safety_valid == 0xA5;
    let armed = node
        .communication()
        .safety
        .read(at(0x13FE, 0))
        .unwrap()
        .map(Value::from)
        == Ok(Value::u8(0xA5));
    let measures = site.device.shown(site.now).validity() & 3 == 3;
    let facts = [
        ("OPERATIONAL", node.state() == State::Operational),
        ("STOPPED", node.state() == State::Stopped),
        ("PRE-OPERATIONAL", node.state() == State::PreOperational),
        ("no node-id", node.node_id() == UNCONFIGURED),
        ("slopes signed", valid),
        ("SRDOs signed", armed),
        (
            "SRDO runs",
            node.communication().safety.state(0) == SrdoState::Withheld,
        ),
        ("measures", measures),
        ("a fault stands", site.device.faults().bits() != 0),
        ("fail-safe", site.device.values().pending.fail_safe),
    ];
    for (name, _) in facts.into_iter().filter(|(_, holds)| *holds) {
        *seen.entry(name).or_default() += 1;
    }
    for (name, count) in [("write taken", site.taken), ("write refused", site.refused)] {
        *seen.entry(name).or_default() += count;
    }
}

#[test]
fn whatever_happens_the_device_keeps_its_word() {
    // A failure is printed whole; there is no source folder to keep it in.
    let config = ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::default()
    };
    let cases = config.cases;
    let seen = RefCell::new(BTreeMap::new());
    let sequences = (any::<bool>(), prop::collection::vec(step(), 1..40));
    let outcome = TestRunner::new(config).run(&sequences, |(second, steps)| {
        let mut site = Site::new(if second { Channel::B } else { Channel::A });
        for step in steps {
            run(&mut site, step);
            check(&mut site);
            tally(&site, &mut seen.borrow_mut());
            (site.taken, site.refused) = (0, 0);
        }
        site.give_node_id();
        restored(&mut site);
        Ok(())
    });
    outcome.unwrap_or_else(|error| panic!("{error}"));
    let seen = seen.into_inner();
    println!("{cases} sequences: {seen:#?}");
    // Fewer sequences need not have been everywhere.
    assert!(cases < 256 || seen.len() == 12 && seen.values().all(|n| *n >= 5));
}

/// Every row that can be read is, on both channels, before and after samples have come.
#[test]
fn every_row_can_be_read() {
    for channel in [Channel::A, Channel::B] {
        let mut site = Site::new(channel);
        for measured in [false, true] {
            if measured {
                site.measure(3000);
            }
            for (row, at) in addresses(Access::READ) {
                let no_data = Some(Err(0x0800_0024));
                let may_be_absent = match at.index {
                    0x1003 => at.sub > 0,
                    0x2060 => at.sub == 6,
                    0x6210..=0x6221 => !measured,
                    _ => false,
                };
                let read = site.read(at);
                let there = read.is_some_and(|r| r.is_ok()) || may_be_absent && read == no_data;
                assert!(there, "{:04X}.{}: {read:?}", row.index, at.sub);
            }
        }
    }
}

/// The sequences above reach what they are about: a device that measures takes a preset.
#[test]
fn a_device_that_measures_takes_a_preset() {
    let mut site = Site::new(Channel::A);
    let preset = at(0x6012, 0);
    assert_eq!(site.write(preset, Value::i16(250)), Some(Err(0x0800_0022)));
    site.measure(3000);
    assert_eq!(site.write(preset, Value::i16(250)), Some(Ok(())));
    assert_eq!(site.read(at(0x6010, 0)), Some(Ok(Value::i16(250))));
    store_and_cycle(&mut site, 1);
    assert_eq!(site.read(preset), Some(Ok(Value::i16(250))));
}

/// Resolution and range are stored apart: what is stored of one must not overflow with the other.
#[test]
fn a_stored_resolution_that_overflows_with_a_range_that_was_not_stored() {
    let mut site = Site::new(Channel::A);
    for (sub, degrees) in [(1, -30), (2, 30), (3, -30), (4, 30)] {
        let bound = Value::i32(degrees * 1000);
        assert_eq!(site.write(at(0x2040, sub), bound), Some(Ok(())));
    }
    assert_eq!(site.write(at(0x6000, 0), Value::u16(1)), Some(Ok(())));
    assert_eq!(site.write(at(0x1010, 3), Value::u32(SAVE)), Some(Ok(())));
    site.power_cycle();
    assert_eq!(site.read(at(0x2040, 2)), Some(Ok(Value::i32(90_000))));
    assert_eq!(site.read(at(0x6000, 0)), Some(Ok(Value::u16(10))));
    assert!(site.device.values().storage_failed);
}

/// A safe slope that 16 bit do not hold is not sent as one that they do.
#[test]
fn a_safe_slope_that_overflows_has_no_value() {
    let mut site = Site::upright(Channel::A);
    site.measure(3000);
    assert_eq!(site.read(at(0x6210, 0)), Some(Ok(Value::i16(9000))));
    assert_eq!(site.read(at(0x6211, 0)), Some(Ok(Value::i16(!9000))));
    assert_eq!(site.write(at(0x6200, 0), Value::u16(1)), Some(Ok(())));
    assert_eq!(site.read(at(0x6210, 0)), Some(Err(0x0800_0024)));
}

/// Outside a small measuring range at a fine unit the slope stopped at 32767 and looked valid.
#[test]
fn a_slope_that_overflows_16_bit_is_no_number() {
    let mut site = Site::upright(Channel::A);
    site.measure(3000);
    assert_eq!(site.read(at(0x6010, 0)), Some(Ok(Value::i16(9000))));
    for (sub, bound) in [(1, -30_000), (2, 30_000), (3, -30_000), (4, 30_000)] {
        let taken = site.write(at(0x2040, sub), Value::i32(bound));
        assert_eq!(taken, Some(Ok(())));
    }
    assert_eq!(site.write(at(0x6000, 0), Value::u16(1)), Some(Ok(())));
    let wide = site.read(at(0x6110, 0)).unwrap().unwrap().signed();
    assert!((89_900..=90_000).contains(&wide), "{wide}");
    assert_eq!(site.read(at(0x6010, 0)), Some(Ok(Value::i16(i16::MIN))));
}

/// A restart by 1F51h that came before its answer left the client with a time-out.
#[test]
fn a_program_reset_before_its_answer() {
    let mut site = Site::new(Channel::A);
    let (device, now) = (&mut site.device, Instant(2_000_000));
    let reset = Frame::data_frame(0x601, &[0x2F, 0x51, 0x1F, 1, 2, 0, 0, 0]);
    device.receive(&reset, now);
    assert_eq!(device.take_request(), None);
    let answer = loop {
        let frame = device.transmit(now).unwrap();
        if frame.cob_id() == Some(0x581) {
            break frame;
        }
        device.sent(&frame, now);
    };
    assert_eq!(answer.bytes(), [0x60, 0x51, 0x1F, 1, 0, 0, 0, 0]);
    assert_eq!(device.take_request(), None);
    device.sent(&answer, now);
    assert_eq!(device.take_request(), Some(BoardRequest::Reset));
}
