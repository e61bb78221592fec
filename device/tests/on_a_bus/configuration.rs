//! What tools write when they configure a node: everything back as delivered, and safety frames.

use crate::site::Site;
use canopen::object::{Access, Address, Value, at};
use device::fault::Fault;
use device::objects::row::Default;
use device::objects::safety::VALID;
use device::objects::table::{Channel, rows};

const WRONG_STATE: u32 = 0x0800_0022;
const OFF: u32 = 1 << 31;

/// What a data sheet names as default of what can be written, in ascending order.
fn defaults(channel: Channel) -> Vec<(Address, Value)> {
    let mut defaults = Vec::new();
    for row in rows().iter().filter(|row| row.access.has(Access::WRITE)) {
        let number = match row.default {
            Default::None | Default::Text(_) => continue,
            _ if row.acts => continue,
            Default::Value(number) => number,
            Default::NodeId(number) => number + i64::from(channel.node_id()),
            Default::Channel(a, b) => [a, b][channel as usize],
        };
        let value = Value::cut(number as u64, row.data_type.size().unwrap());
        defaults.extend((row.sub..=row.last).map(|sub| (at(row.index, sub), value)));
    }
    defaults
}

/// What is written last, first or in between where a tool goes by CiA 301, 7.5.2.36 and 7.5.2.38.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    CobId,
    Count,
    Signature,
    Other,
}

fn part(at: &Address) -> Part {
    match (at.index, at.sub) {
        (0x1400..=0x15FF | 0x1800..=0x19FF, 1) => Part::CobId,
        (0x1381..=0x13FD | 0x1600..=0x17FF | 0x1A00..=0x1BFF, 0) => Part::Count,
        (0x13FE | 0x13FF | 0x63FE | 0x63FF, _) => Part::Signature,
        _ => Part::Other,
    }
}

/// PDOs off, their counts 0, the entries, the counts, the PDOs on; signatures come last.
fn by_the_book(ascending: &[(Address, Value)]) -> Vec<(Address, Value)> {
    let of = |wanted| {
        ascending
            .iter()
            .filter(move |(at, _)| part(at) == wanted)
            .copied()
    };
    let off = |value: Value| Value::u32(value.unsigned() as u32 | OFF);
    let mut order: Vec<_> = of(Part::CobId)
        .map(|(at, value)| (at, off(value)))
        .collect();
    order.extend(of(Part::Count).map(|(at, _)| (at, Value::u8(0))));
    for part in [Part::Other, Part::Count, Part::CobId, Part::Signature] {
        order.extend(of(part));
    }
    order
}

#[test]
fn what_was_delivered_was_refused_when_a_tool_wrote_it_back() {
    for channel in [Channel::A, Channel::B] {
        let ascending = defaults(channel);
        assert!(ascending.len() > 200, "{}", ascending.len());
        for order in [ascending.clone(), by_the_book(&ascending)] {
            let mut site = Site::new(channel);
            site.measure(400);
            for (address, value) in order {
                let answer = site.write(address, value);
                assert_eq!(answer, Some(Ok(())), "{channel:?} {address:X?}");
            }
            for (address, value) in &ascending {
                let read = site.read(*address);
                assert_eq!(read, Some(Ok(*value)), "{channel:?} {address:X?}");
            }
        }
    }
}

#[test]
fn what_acts_when_it_is_written_and_what_takes_words_has_no_default_for_tools() {
    let ascending = defaults(Channel::A);
    for index in [
        0x1010, 0x1011, 0x2060, 0x2072, 0x6012, 0x6122, 0x6812, 0x6922,
    ] {
        assert!(
            !ascending
                .iter()
                .any(|(at, _)| at.index == index && at.sub != 0)
        );
        assert!(
            !ascending.contains(&(at(index, 0), Value::i16(0))),
            "{index:X}"
        );
    }
    // A tool that writes its default back would delete the errors.
    assert!(ascending.iter().all(|(at, _)| at.index != 0x1003));
}

#[test]
fn a_safety_configuration_was_made_valid_in_operational_and_frames_began_at_once() {
    let is_safety = |at: &Address| matches!(at.index, 0x1300..=0x13FF | 0x6200..=0x63FF);
    let objects: Vec<_> = defaults(Channel::A);
    let objects: Vec<_> = objects
        .into_iter()
        .filter(|(at, _)| is_safety(at))
        .collect();
    for needed in [
        0x1300, 0x1302, 0x1382, 0x13FE, 0x13FF, 0x6200, 0x63FE, 0x63FF,
    ] {
        assert!(
            objects.iter().any(|(at, _)| at.index == needed),
            "{needed:X}"
        );
    }
    let mut site = Site::new(Channel::A);
    site.nmt(1);
    for (address, value) in &objects {
        let answer = site.write(*address, *value);
        assert_eq!(answer, Some(Err(WRONG_STATE)), "{address:X?}");
    }
    let valid = Value::u8(VALID);
    for index in [0x13FE, 0x63FE] {
        assert_eq!(site.write(at(index, 0), valid), Some(Err(WRONG_STATE)));
        assert_eq!(site.read(at(index, 0)), Some(Ok(Value::u8(0))));
    }
    site.nmt(128);
    for (address, value) in objects {
        assert_eq!(site.write(address, value), Some(Ok(())), "{address:X?}");
    }
}

/// SRDO 2 takes 103h and 104h into 2012h, a pair within 200 ms.
fn consuming() -> Site {
    let mut site = Site::new(Channel::A);
    let entries = [0x2012_0110, 0x2012_0210];
    let mut write = |index, sub, value| assert_eq!(site.write(at(index, sub), value), Some(Ok(())));
    write(0x1302, 1, Value::u8(2));
    write(0x1302, 2, Value::u16(200));
    for (sub, entry) in (1..).zip(entries) {
        write(0x1382, sub, Value::u32(entry));
    }
    write(0x1382, 0, Value::u8(2));
    let signature = site.device.bus().communication().safety.signature(1);
    for (index, sub, value) in [
        (0x13FF, 2, Value::u16(signature)),
        (0x13FE, 0, Value::u8(VALID)),
    ] {
        assert_eq!(site.write(at(index, sub), value), Some(Ok(())));
    }
    site
}

#[test]
fn a_safety_frame_that_never_came_was_never_missed() {
    let missed = |site: &Site| site.device.faults().has(Fault::FailSafe);
    let mut site = consuming();
    site.pass(1000);
    assert!(!missed(&site));
    site.nmt(1);
    site.pass(180);
    assert!(!missed(&site));
    site.pass(30);
    assert!(missed(&site));
    // One that comes in time is not missed, and the next one is due from then on.
    let mut site = consuming();
    site.nmt(1);
    for _ in 0..10 {
        site.pass(150);
        site.hears(0x103, &[1, 2]);
        site.hears(0x104, &[0xFE, 0xFD]);
    }
    assert!(!missed(&site));
    site.pass(220);
    assert!(missed(&site));
}
