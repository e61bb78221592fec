//! Entries appended, cleared, overtaken, and cut at every operation.

use std::vec::Vec;

use super::*;
use crate::nor::tests::{Bench, Seeded, bench};

const REGION: Region = Region {
    start: PAGE,
    length: 2 * PAGE,
};

/// What the fault log of the device asks for.
const KEEP: u32 = 16;

type EventLog = Log<20>;

fn entry(number: u32) -> [u8; 20] {
    let mut bytes = [0xFF; 20];
    bytes[..4].copy_from_slice(&number.to_le_bytes());
    bytes[19] = number as u8;
    bytes
}

/// The numbers of the entries, newest first; a wrong one fails.
fn numbers(nor: &mut Bench, log: &EventLog) -> Vec<u32> {
    let mut cursor = log.end();
    let mut numbers = Vec::new();
    while let Some(bytes) = log.before(nor, &mut cursor).unwrap() {
        let number = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        assert_eq!(bytes, entry(number));
        numbers.push(number);
    }
    numbers
}

fn mounted(nor: &mut Bench) -> EventLog {
    EventLog::mount(nor, REGION).unwrap()
}

fn store(nor: &mut Bench, log: &mut EventLog, number: u32) -> Result<(), LogError> {
    log.prepare(nor, KEEP)?;
    log.append(nor, &entry(number))
}

#[test]
fn the_last_16_are_always_there_newest_first() {
    let mut nor = bench(4, 1);
    let mut log = mounted(&mut nor);
    assert_eq!(numbers(&mut nor, &log), []);
    for number in 0..600 {
        store(&mut nor, &mut log, number).unwrap();
        let read = numbers(&mut nor, &log);
        let expected: Vec<u32> = (0..=number).rev().take(read.len()).collect();
        assert_eq!(read, expected);
        assert!(read.len() as u32 >= KEEP.min(number + 1));
        log = mounted(&mut nor);
        assert_eq!(numbers(&mut nor, &log), expected);
    }
    assert_eq!(nor.broken_rules(), 0);
    // 78 to a page: 600 entries are 8 pages, and the next is erased ahead.
    assert_eq!(EventLog::PER_PAGE, 78);
    let erases: Vec<u32> = nor.pages().iter().map(|page| page.erases()).collect();
    assert_eq!(erases, [0, 5, 4, 0]);
}

#[test]
fn without_an_erase_ahead_appending_reports_it_and_loses_nothing() {
    let mut nor = bench(4, 1);
    let mut log = mounted(&mut nor);
    assert_eq!(log.append(&mut nor, &entry(0)), Err(LogError::NeedsErase));
    assert!(log.needs_erase(KEEP));
    log.prepare(&mut nor, KEEP).unwrap();
    let free = log.free();
    for number in 0..free {
        log.append(&mut nor, &entry(number)).unwrap();
    }
    let refused = log.append(&mut nor, &entry(99));
    assert_eq!((log.free(), refused), (0, Err(LogError::NeedsErase)));
    assert_eq!(numbers(&mut nor, &log).len() as u32, free);
}

#[test]
fn a_cleared_log_is_empty_and_goes_on() {
    let mut nor = bench(4, 1);
    let mut log = mounted(&mut nor);
    // More than a page, so that older entries lie in the page before.
    for number in 0..100 {
        store(&mut nor, &mut log, number).unwrap();
    }
    log.clear(&mut nor).unwrap();
    assert_eq!(numbers(&mut nor, &log), []);
    let mut log = mounted(&mut nor);
    assert_eq!(numbers(&mut nor, &log), []);
    store(&mut nor, &mut log, 7).unwrap();
    assert_eq!(numbers(&mut nor, &log), [7]);
    let mut cursor = log.end();
    log.before(&mut nor, &mut cursor).unwrap();
    for _ in 0..3 {
        assert_eq!(log.before(&mut nor, &mut cursor), Ok(None));
    }
}

#[test]
fn a_cut_at_any_operation_leaves_the_entry_whole_or_absent() {
    for filled in [0, 1, 15, 16, 77, 78, 79, 110, 156, 157] {
        let mut full = bench(4, 5);
        let mut log = mounted(&mut full);
        for number in 0..filled {
            store(&mut full, &mut log, number).unwrap();
        }
        for cut in 0.. {
            let mut nor = full.clone();
            let mut log = mounted(&mut nor);
            let before = numbers(&mut nor, &log);
            nor.cut_after(cut);
            let done = store(&mut nor, &mut log, filled).is_ok();
            nor.power_up();
            log = mounted(&mut nor);
            let read = numbers(&mut nor, &log);
            let fresh = read.first() == Some(&filled);
            let old = if fresh { &read[1..] } else { &read[..] };
            assert_eq!(old, &before[..old.len()], "{filled} filled, cut {cut}");
            assert!(
                old.len() as u32 >= (KEEP - 1).min(filled),
                "{filled} filled, cut {cut}"
            );
            assert!(fresh || !done);
            store(&mut nor, &mut log, 1000).unwrap();
            assert_eq!(numbers(&mut nor, &log)[0], 1000);
            assert_eq!(nor.broken_rules(), 0);
            if done {
                assert!(cut > 5);
                break;
            }
        }
    }
}

#[test]
fn a_storm_of_cuts_never_shows_an_entry_that_was_not_written() {
    let mut random = Seeded::new(11);
    let mut nor = bench(4, 6);
    // What is there for sure, and what may be.
    let mut certain: Vec<u32> = Vec::new();
    for number in 0..6000 {
        let mut log = mounted(&mut nor);
        if random.below(2) == 0 {
            nor.cut_after(u64::from(random.below(20)));
        }
        let done = store(&mut nor, &mut log, number).is_ok();
        nor.power_up();
        log = mounted(&mut nor);
        let read = numbers(&mut nor, &log);
        if done || read.first() == Some(&number) {
            certain.push(number);
        }
        let expected: Vec<u32> = certain.iter().rev().copied().take(read.len()).collect();
        assert_eq!(read, expected);
    }
    assert_eq!(nor.broken_rules(), 0);
}

#[test]
fn a_flipped_bit_costs_its_own_entry_only() {
    let mut clean = bench(4, 1);
    let mut log = mounted(&mut clean);
    for number in 0..10 {
        store(&mut clean, &mut log, number).unwrap();
    }
    for at in 0..10 * 26 {
        let mut nor = clean.clone();
        // The first page in use is the one with number 2, the first of the region.
        nor.flip(PAGE + HEAD + at, 0x10);
        let log = mounted(&mut nor);
        let read = numbers(&mut nor, &log);
        let hit = at / 26;
        let expected: Vec<u32> = (0..10).rev().filter(|number| *number != hit).collect();
        assert_eq!(read, expected, "byte {at}");
    }
}

#[test]
fn a_worn_page_is_reported() {
    let mut nor = bench(4, 1);
    nor.set_endurance(0);
    let mut log = mounted(&mut nor);
    let worn = LogError::Access(AccessError::Worn);
    assert_eq!(log.prepare(&mut nor, KEEP), Err(worn));
}

#[test]
fn without_two_pages_no_event_is_kept_and_the_flash_is_left_alone() {
    for pages in [0, 1] {
        // Behind the end, where a read or an erase would be refused.
        let region = Region {
            start: 4 * PAGE,
            length: pages * PAGE,
        };
        let mut nor = bench(4, 1);
        let mut log = EventLog::mount(&mut nor, region).unwrap();
        assert!(!log.needs_erase(0));
        assert_eq!(log.prepare(&mut nor, 0), Ok(Progress::Done));
        assert_eq!(log.append(&mut nor, &entry(0)), Err(LogError::NeedsErase));
        assert_eq!(log.clear(&mut nor), Err(LogError::NeedsErase));
        assert_eq!((log.free(), numbers(&mut nor, &log)), (0, Vec::new()));
        assert_eq!((nor.operations(), nor.broken_rules()), (0, 0));
    }
}
