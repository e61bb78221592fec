//! The black box and its memory: what of two events is there after a cut, without room, and when
//! one follows the other at once.
//!
//! In: a pair at work, whose other channel goes off by two degrees now and then. Out: both boxes as
//! the bus shows them, and as the memory has them.

use crate::played::{Pair, level, tilted};
use crate::site::{self, Memory};
use canopen::object::{Value, at};
use device::fault::Fault;
use device::records::{EventStore, Record, RecordStore};
use tilt::chain::Invalid;

/// A pair at work with this memory. What is found ends after a second.
fn at_work(memory: &Memory) -> Pair {
    let mut pair = Pair::new();
    *pair.device.memory() = memory.clone();
    pair.boot();
    pair.syncs(40);
    pair.set_policy(1, 1).at_work()
}

/// The other channel goes off, and comes back when the box is full.
fn incident(pair: &mut Pair) {
    pair.peer.sends = tilted(2.0);
    pair.seconds(1.0);
    pair.peer.sends = level();
    pair.seconds(3.5);
}

/// Out of OPERATIONAL, where there is room for one box, for long enough to make it for another.
fn rest(mut pair: Pair) -> Pair {
    pair.hears(0, &[128, 1]);
    pair.seconds(1.0);
    pair
}

/// Box `number` as the bus shows it; `None` when it is empty.
fn shown(pair: &mut Pair, number: u8) -> Option<Vec<u8>> {
    let answer = pair.ask([0x40, 0x71, 0x20, number, 0, 0, 0, 0]).pop();
    if answer.unwrap()[0] == 0x80 {
        return None;
    }
    pair.ask([0x80, 0x71, 0x20, number, 0, 0, 0, 0]);
    Some(pair.upload(at(0x2071, number)))
}

/// Box `number` as the memory has it; empty when it has none.
fn stored(pair: &mut Pair, number: u8) -> Vec<u8> {
    let mut bytes = vec![0; 2000];
    let memory = pair.device.memory();
    let count = RecordStore::read(memory, Record::of_box(number), 0, &mut bytes);
    bytes.truncate(count);
    bytes
}

/// Frames before and after, when the clock in them goes on by a SYNC from each to the next.
fn frames(bytes: &[u8]) -> (u8, u8) {
    let frames: Vec<&[u8]> = bytes[28..].chunks(34).collect();
    assert_eq!(frames.len(), usize::from(bytes[2] + bytes[3]));
    for two in frames.windows(2) {
        assert_eq!(two[1][14].wrapping_sub(two[0][14]), 10, "2 ms a step");
    }
    (bytes[2], bytes[3])
}

/// A memory with two boxes, and these.
fn with_two() -> (Memory, [Vec<u8>; 2]) {
    let mut pair = at_work(&site::blank());
    incident(&mut pair);
    let mut pair = rest(pair).at_work();
    incident(&mut pair);
    let boxes = [1, 2].map(|number| shown(&mut pair, number).unwrap());
    assert_eq!(boxes.each_ref().map(|bytes| frames(bytes)), [(32, 16); 2]);
    assert!([1, 2].map(|number| stored(&mut pair, number)) == boxes);
    (pair.device.memory().clone(), boxes)
}

#[test]
fn a_cut_at_any_operation_of_a_box_leaves_the_first_as_it_was_and_the_second_old_or_new() {
    let (memory, [first, old]) = with_two();
    let third = |cut: Option<u64>| {
        let mut pair = at_work(&memory);
        let before = pair.device.memory().flash().operations();
        if let Some(cut) = cut {
            pair.device.memory().flash_mut().cut_after(cut);
        }
        pair.peer.sends = tilted(2.0);
        pair.seconds(0.8);
        let operations = pair.device.memory().flash().operations() - before;
        pair.device.memory().flash_mut().power_up();
        pair.boot();
        (pair, operations)
    };
    let (mut whole, operations) = third(None);
    let new = shown(&mut whole, 2).unwrap();
    assert_eq!((frames(&new), new == old), ((32, 16), false));
    assert!(operations > 830, "{operations}");
    let mut renewed = 0;
    for cut in 0..operations {
        let (mut pair, _) = third(Some(cut));
        assert!(stored(&mut pair, 1) == first, "{cut}");
        let second = stored(&mut pair, 2);
        assert!(second == old || second == new, "{cut}");
        renewed += u64::from(second == new);
        assert_eq!(pair.device.memory().flash().broken_rules(), 0, "{cut}");
        if cut % 50 == 0 {
            // What was cut does not stand in the way of the next one.
            pair.peer.sends = level();
            pair.syncs(40);
            let mut pair = pair.set_policy(1, 1).at_work();
            incident(&mut pair);
            let next = stored(&mut pair, 2);
            assert!(next != old && next != new, "{cut}");
            assert_eq!(frames(&next), (32, 16));
            assert!(!pair.has(Fault::Storage));
        }
    }
    // Nothing new counts before the last operation of all, whose bits may all be done by chance.
    assert!(renewed <= 1, "{renewed} of {operations}");
}

#[test]
fn without_room_the_latest_event_is_held_until_a_page_may_be_erased() {
    let (memory, [first, old]) = with_two();
    let mut pair = at_work(&memory);
    let memory = pair.device.memory();
    while !memory.needs_room() {
        assert_eq!(RecordStore::begin(memory, Record::Report, 36), Ok(()));
        assert_eq!(RecordStore::append(memory, &[7; 36]), Ok(()));
        assert_eq!(RecordStore::commit(memory), Ok(()));
    }
    let erases = |pair: &mut Pair| -> u32 {
        let pages = pair.device.memory().flash().pages().iter();
        pages.map(|page| page.erases()).sum()
    };
    let before = erases(&mut pair);
    let mut held = old.clone();
    for _ in 0..3 {
        incident(&mut pair);
        let latest = shown(&mut pair, 2).unwrap();
        assert_eq!((frames(&latest), latest == held), ((32, 16), false));
        assert_eq!(
            [1, 2].map(|n| stored(&mut pair, n)),
            [first.clone(), old.clone()]
        );
        assert_eq!(shown(&mut pair, 1).as_ref(), Some(&first));
        // A box is its reader's for three seconds.
        pair.seconds(3.5);
        held = latest;
    }
    assert_eq!(erases(&mut pair), before, "no erase in OPERATIONAL");
    let mut pair = rest(rest(pair));
    assert!(erases(&mut pair) > before);
    assert!(stored(&mut pair, 2) == held);
    pair.boot();
    assert!(shown(&mut pair, 2) == Some(held));
}

#[test]
fn of_two_events_in_a_row_both_are_kept_whenever_the_second_comes() {
    for syncs in 0..60 {
        let mut pair = at_work(&site::blank());
        pair.peer.sends = tilted(2.0);
        pair.seconds(0.2);
        pair.syncs(syncs);
        pair.peer.sends = level().refused(Invalid::Noise);
        pair.seconds(2.0);
        let first = shown(&mut pair, 1).unwrap();
        assert_eq!(frames(&first), (32, 16), "{syncs}");
        let Some(second) = shown(&mut pair, 2) else {
            assert!(syncs < 16, "in the first box: {syncs}");
            continue;
        };
        let (before, after) = frames(&second);
        assert!((16..=32).contains(&before), "{before}: {syncs}");
        assert_eq!((after, second[8..28] == first[8..28]), (16, false));
        if syncs > 40 {
            assert_eq!(before, 32, "box 1 was stored: {syncs}");
        }
        let mut pair = rest(pair);
        pair.boot();
        let kept = [1, 2].map(|n| shown(&mut pair, n));
        assert!(kept == [Some(first), Some(second)], "{syncs}");
    }
}

#[test]
fn the_first_box_is_stored_however_many_events_came_before_it() {
    let mut pair = at_work(&site::blank());
    // A slope outside the range keeps no samples.
    for n in 0..20 {
        let inside = Value::i32(if n % 2 == 0 { 10_000 } else { -90_000 });
        pair.write(at(0x2040, 1), inside);
        pair.seconds(1.2);
    }
    assert_eq!(shown(&mut pair, 1), None);
    incident(&mut pair);
    let first = shown(&mut pair, 1).unwrap();
    assert!(stored(&mut pair, 1) == first);
}
