//! Records stored, read, cut at every operation, worn and damaged.

use std::format;
use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::Progress;
use crate::layout::{CB, RC};
use crate::nor::tests::{Bench, Seeded, bench};

/// Communication, profile, manufacturer, LSS, calibration: what the device keeps.
const KINDS: usize = 5;

const CALIBRATION: u8 = 4;

/// The longest of each kind: parameters of 1.5 kB together, and two full tables.
const LONGEST_OF: [u32; KINDS] = [600, 500, 400, 16, 3092];

/// The fewest pages in which every kind has room at its longest: nothing is to spare.
const PAGES: u32 = 8;

type Store = Records<KINDS>;
type Content = [Vec<u8>; KINDS];

fn region(pages: u32) -> Region {
    Region {
        start: PAGE,
        length: pages * PAGE,
    }
}

fn mounted(nor: &mut Bench, pages: u32) -> Store {
    Store::mount(nor, region(pages)).unwrap()
}

/// Mounts after a cut, which is no damage.
fn mounted_after_a_cut(nor: &mut Bench, pages: u32) -> Store {
    let store = mounted(nor, pages);
    assert_eq!(store.damaged(), 0);
    store
}

/// Bytes that differ from version to version; every sixteenth pair is FFFFh.
fn bytes(length: u32, version: u32) -> Vec<u8> {
    let byte = |n: u32| match n % 32 {
        0 | 1 => 0xFF,
        _ => (n * 31 + version * 17 + n / 256) as u8,
    };
    (0..length).map(byte).collect()
}

fn prepare(nor: &mut Bench, store: &mut Store, length: u32) -> Result<u32, RecordError> {
    for steps in 0..200 {
        if store.prepare(nor, length)? == Progress::Done {
            return Ok(steps);
        }
    }
    panic!("no end to the preparing");
}

fn write(nor: &mut Bench, store: &mut Store, kind: u8, content: &[u8]) -> Result<(), RecordError> {
    store.begin(nor, kind)?;
    // Pieces of several sizes, odd ones too.
    let (mut rest, mut size) = (content, 1);
    while !rest.is_empty() {
        let (piece, behind) = rest.split_at(rest.len().min(size));
        store.append(nor, piece)?;
        (rest, size) = (behind, size % 23 + 3);
    }
    store.commit(nor)
}

fn store_it(nor: &mut Bench, store: &mut Store, kind: u8, new: &[u8]) -> Result<(), RecordError> {
    prepare(nor, store, new.len() as u32)?;
    write(nor, store, kind, new)
}

fn content(nor: &mut Bench, store: &Store) -> Content {
    let read = |kind: usize| {
        let mut into = vec![0; 4096];
        let count = store.read(nor, kind as u8, 0, &mut into).unwrap();
        into.truncate(count);
        into
    };
    [0, 1, 2, 3, 4].map(read)
}

#[test]
fn what_is_committed_is_read_from_any_offset_also_after_a_reset() {
    let mut nor = bench(PAGES + 2, 1);
    let mut store = mounted(&mut nor, PAGES);
    let new = bytes(3075, 1);
    store_it(&mut nor, &mut store, CALIBRATION, &new).unwrap();
    for store in [store, mounted(&mut nor, PAGES)] {
        assert_eq!(store.length(CALIBRATION), 3075);
        for offset in (0..3080).step_by(7) {
            let mut into = [0; 61];
            let count = store
                .read(&mut nor, CALIBRATION, offset, &mut into)
                .unwrap();
            let rest = new.get(offset as usize..).unwrap_or(&[]);
            assert_eq!(into[..count], rest[..rest.len().min(61)]);
        }
        assert!(store.check(&mut nor, CALIBRATION).unwrap());
        assert_eq!(store.read(&mut nor, 0, 0, &mut [0; 4]), Ok(0));
        let unknown = store.read(&mut nor, 5, 0, &mut [0; 4]);
        assert_eq!(unknown, Err(RecordError::Kind(5)));
    }
    assert_eq!(nor.broken_rules(), 0);
}

#[test]
fn nothing_counts_before_the_commit_and_a_discard_forgets() {
    let mut nor = bench(PAGES + 2, 1);
    let mut store = mounted(&mut nor, PAGES);
    store_it(&mut nor, &mut store, 0, b"old").unwrap();
    let new = bytes(2001, 2);
    prepare(&mut nor, &mut store, 2001).unwrap();
    store.begin(&mut nor, 0).unwrap();
    store.append(&mut nor, &new).unwrap();
    let mut into = vec![0; 2100];
    for offset in [0, 1, 999, 1990, 2000, 2001, 3000] {
        let count = store.staged(&mut nor, offset, &mut into).unwrap();
        assert_eq!(&into[..count], new.get(offset as usize..).unwrap_or(&[]));
    }
    assert_eq!(content(&mut nor, &store)[0], b"old");
    assert_eq!(store.prepare(&mut nor, 9), Err(RecordError::Staged));
    store.discard(&mut nor).unwrap();
    assert_eq!(store.staged(&mut nor, 0, &mut into), Ok(0));
    assert_eq!(store.commit(&mut nor), Err(RecordError::NotBegun));
    assert_eq!(store.append(&mut nor, b"x"), Err(RecordError::NotBegun));
    store_it(&mut nor, &mut store, 1, b"other").unwrap();
    let store = mounted(&mut nor, PAGES);
    assert_eq!(
        content(&mut nor, &store)[..2],
        [b"old".to_vec(), b"other".to_vec()]
    );
    assert_eq!((store.torn(), nor.broken_rules()), (0, 0));
}

#[test]
fn an_erased_record_stays_away_although_older_versions_lie_about() {
    let mut nor = bench(PAGES + 2, 1);
    let mut store = mounted(&mut nor, PAGES);
    for version in 0..5 {
        store_it(&mut nor, &mut store, 2, &bytes(100, version)).unwrap();
    }
    store.erase(&mut nor, 2).unwrap();
    for version in 0..400 {
        store_it(&mut nor, &mut store, 1, &bytes(333, version)).unwrap();
        store = mounted(&mut nor, PAGES);
        assert_eq!(store.length(2), 0);
    }
}

#[test]
fn storing_erases_nothing_and_reports_when_it_has_to() {
    let mut nor = bench(PAGES + 2, 1);
    let mut store = mounted(&mut nor, PAGES);
    assert!(store.needs_erase(16));
    assert_eq!(store.begin(&mut nor, 3), Err(RecordError::NeedsErase));
    prepare(&mut nor, &mut store, 3092).unwrap();
    assert!(!store.needs_erase(3092));
    let erases = |nor: &Bench| nor.pages().iter().map(|page| page.erases()).sum::<u32>();
    let before = erases(&nor);
    let mut version = 0;
    while write(&mut nor, &mut store, 0, &bytes(600, version)).is_ok() {
        version += 1;
    }
    assert_eq!(erases(&nor), before);
    assert!(version >= 5);
    assert_eq!(content(&mut nor, &store)[0], bytes(600, version - 1));
    store_it(&mut nor, &mut store, 0, &bytes(600, version)).unwrap();
}

#[test]
fn chunks_that_do_not_follow_one_another_are_no_record() {
    let first = chunk::Chunk {
        kind: 1,
        last: false,
        length: 100,
        version: 7,
        offset: 0,
    };
    let second = chunk::Chunk {
        last: true,
        length: 20,
        offset: 100,
        ..first
    };
    let place = |sequence, at| Entry {
        sequence,
        at,
        length: 0,
        version: 7,
    };
    let joined = |second: chunk::Chunk, at| {
        let mut store = mounted(&mut bench(PAGES + 2, 1), PAGES);
        let mut open = None;
        store.join(&mut open, &first, place(20, 900));
        store.join(&mut open, &second, place(21, at));
        store.length(1)
    };
    assert_eq!(joined(second, 16), 120);
    for bad in [
        chunk::Chunk { kind: 2, ..second },
        chunk::Chunk {
            version: 8,
            ..second
        },
        chunk::Chunk {
            offset: 98,
            ..second
        },
    ] {
        assert_eq!(joined(bad, 16), 0, "{bad:?}");
    }
    assert_eq!(joined(second, 40), 0);
}

/// A store with every kind at its longest, after `rounds` of stores.
fn filled(rounds: u32) -> (Bench, Content) {
    let mut nor = bench(PAGES + 2, 2);
    let mut store = mounted(&mut nor, PAGES);
    for round in 0..rounds {
        for kind in 0..KINDS as u8 {
            let length = LONGEST_OF[usize::from(kind)];
            store_it(&mut nor, &mut store, kind, &bytes(length, round)).unwrap();
        }
    }
    let kept = content(&mut nor, &store);
    (nor, kept)
}

/// Cuts `store_it` at every operation; how many there were.
fn cut_everywhere(full: &Bench, kept: &Content, kind: u8, new: &[u8]) -> u64 {
    for cut in 0.. {
        let mut nor = full.clone();
        let mut store = mounted(&mut nor, PAGES);
        nor.cut_after(cut);
        let done = store_it(&mut nor, &mut store, kind, new).is_ok();
        nor.power_up();
        let mut store = mounted_after_a_cut(&mut nor, PAGES);
        let mut now = content(&mut nor, &store);
        let slot = usize::from(kind);
        let stored = now[slot] == new;
        assert!(
            stored || (!done && now[slot] == kept[slot]),
            "kind {kind}, cut {cut}"
        );
        now[slot] = kept[slot].clone();
        assert_eq!(now, *kept, "kind {kind}, cut {cut}");
        // Life goes on.
        store_it(&mut nor, &mut store, kind, b"again").unwrap();
        assert_eq!(content(&mut nor, &store)[slot], b"again");
        assert_eq!(nor.broken_rules(), 0);
        if done {
            return cut;
        }
    }
    0
}

#[test]
fn a_cut_at_any_operation_of_any_store_leaves_the_old_or_the_new() {
    let mut operations = 0;
    for rounds in [0, 1, 3] {
        let (full, kept) = filled(rounds);
        for kind in 0..KINDS as u8 {
            let new = bytes(LONGEST_OF[usize::from(kind)], 77);
            operations += cut_everywhere(&full, &kept, kind, &new);
        }
        operations += cut_everywhere(&full, &kept, 0, &[]);
    }
    // The calibration alone is 1500 half-words.
    assert!(operations > 3 * 1500, "{operations}");
}

/// Stores at random with cuts at random; what is there has to be what was stored.
fn storm(seed: u64, pages: u32, longest: [u32; KINDS], cuts: u32) -> Bench {
    let mut random = Seeded::new(seed);
    let mut nor = bench(pages + 2, seed + 1);
    nor.set_endurance(u32::MAX);
    let mut store = mounted(&mut nor, pages);
    let mut kept = content(&mut nor, &store);
    let mut done_cuts = 0;
    let mut version = 0;
    while done_cuts < cuts {
        version += 1;
        let kind = random.below(KINDS as u32);
        let slot = kind as usize;
        let length = match random.below(3) {
            0 => random.below(longest[slot] + 1),
            _ => longest[slot],
        };
        let new = bytes(length, version);
        if random.below(4) != 0 {
            // Soon, so that erases are hit too, or anywhere.
            let within = [8, 60, 400, 2 * length + 40];
            let within = within[random.below(4) as usize];
            nor.cut_after(u64::from(random.below(within)));
        }
        let result = store_it(&mut nor, &mut store, kind as u8, &new);
        if nor.is_cut() {
            done_cuts += 1;
            nor.power_up();
            store = mounted_after_a_cut(&mut nor, pages);
        } else {
            assert_eq!(result, Ok(()), "seed {seed}, version {version}");
            nor.power_up();
        }
        let now = content(&mut nor, &store);
        if now[slot] == new {
            kept[slot] = new;
        } else {
            assert!(result.is_err(), "seed {seed}, version {version}");
        }
        assert_eq!(now, kept, "seed {seed}, version {version}");
    }
    assert_eq!(nor.broken_rules(), 0);
    nor
}

#[test]
fn a_hundred_thousand_random_cuts_lose_nothing_and_the_store_never_gets_stuck() {
    assert!(RC.records.pages() > PAGES);
    storm(1, RC.records.pages(), LONGEST_OF, 100_000);
    storm(4, PAGES, LONGEST_OF, 10_000);
}

#[test]
fn four_pages_keep_a_calibration_by_harmonics_through_cuts() {
    storm(2, 4, [300, 250, 200, 16, 268], 2_000);
}

#[test]
fn a_part_of_128_kb_keeps_what_it_has_room_for_through_cuts() {
    assert_eq!(CB.records.pages(), 6);
    storm(3, 6, [600, 500, 400, 16, 1761], 2_000);
}

#[test]
fn pages_wear_alike() {
    let mut nor = bench(PAGES + 2, 3);
    let mut store = mounted(&mut nor, PAGES);
    for version in 0..2500 {
        let kind = if version % 50 == 0 { CALIBRATION } else { 0 };
        let length = LONGEST_OF[usize::from(kind)];
        store_it(&mut nor, &mut store, kind, &bytes(length, version)).unwrap();
    }
    let erases: Vec<u32> = nor.pages()[1..=PAGES as usize]
        .iter()
        .map(|page| page.erases())
        .collect();
    let (least, most) = (erases.iter().min(), erases.iter().max());
    assert!(most.unwrap() - least.unwrap() <= 1, "{erases:?}");
    assert!(store.rounds() - most.unwrap() <= 1);
    // 2500 stores of 0.6 kB and their share of calibrations are 1.7 MB: 100 rounds at least.
    assert!((100..200).contains(most.unwrap()), "{erases:?}");
    let (before, behind) = (&nor.pages()[0], &nor.pages()[PAGES as usize + 1]);
    assert_eq!((before.erases(), behind.erases()), (0, 0));
}

#[test]
fn any_flipped_bit_leaves_a_version_that_was_stored_and_the_other_kinds_alone() {
    let mut clean = bench(PAGES + 2, 4);
    let mut store = mounted(&mut clean, PAGES);
    let lengths = [60, 50, 40, 16, 1500];
    for version in 0..2 {
        for (kind, length) in lengths.into_iter().enumerate() {
            let new = bytes(length, version);
            store_it(&mut clean, &mut store, kind as u8, &new).unwrap();
        }
    }
    let mut old = 0;
    let mut random = Seeded::new(9);
    for at in PAGE..(PAGES + 1) * PAGE {
        let mut nor = clean.clone();
        nor.flip(at, 1 << random.below(8));
        let store = mounted(&mut nor, PAGES);
        let now = content(&mut nor, &store);
        let changed = (0..KINDS).filter(|kind| now[*kind] != bytes(lengths[*kind], 1));
        for kind in changed {
            let before = now[kind] == bytes(lengths[kind], 0);
            assert!(before || now[kind].is_empty(), "byte {at}, kind {kind}");
            old += u32::from(before);
        }
        // The store works on.
        let mut store = store;
        for _ in 0..3 {
            let result = store_it(&mut nor, &mut store, 0, b"next");
            if !matches!(result, Err(RecordError::Damaged(_))) {
                assert_eq!(result, Ok(()), "byte {at}");
                break;
            }
        }
        assert_eq!(content(&mut nor, &store)[0], b"next");
    }
    assert!(old > 1000, "{old}");
}

#[test]
fn a_bit_that_went_bad_took_along_what_was_behind_it_and_nobody_was_told() {
    let mut clean = bench(PAGES + 2, 4);
    let mut store = mounted(&mut clean, PAGES);
    for version in 1..3 {
        for kind in 0..4 {
            store_it(&mut clean, &mut store, kind, &bytes(100, version)).unwrap();
        }
    }
    // All eight lie in the first page, 16 bytes of chunk and 100 of record each.
    for (number, at) in (0..8_u32).zip((PAGE + 16..).step_by(116)) {
        for byte in 0..116 {
            let mut nor = clean.clone();
            nor.flip(at + byte, 1 << (byte % 8));
            let mut store = mounted(&mut nor, PAGES);
            let kind = number % 4;
            let expected = |of: u32| if number >= 4 && of == kind { 1 } else { 2 };
            for of in 0..4 {
                let held = &content(&mut nor, &store)[of as usize];
                assert_eq!(*held, bytes(100, expected(of)), "chunk {number}, kind {of}");
            }
            // What was stored again since is nothing to tell of. Of the last chunk of all the
            // header alone states where it ends.
            let case = format!("chunk {number}, byte {byte}: {}", store.damaged());
            match (number, byte) {
                (..4, _) => assert_eq!(store.damaged(), 0, "{case}"),
                // Nor is a kind what it was.
                (7, ..16) | (_, 0) => {}
                _ => assert_eq!(store.damaged(), 1 << kind, "{case}"),
            }
            store_it(&mut nor, &mut store, kind as u8, b"anew").unwrap();
            assert_eq!(store.damaged() & 1 << kind, 0);
            let again = mounted(&mut nor, PAGES).damaged();
            assert_eq!(again & 1 << kind, 0, "{case}");
        }
    }
}

#[test]
fn a_bit_that_goes_bad_after_the_mount_is_named_once_and_what_is_left_counts() {
    let mut nor = bench(PAGES + 2, 4);
    let mut store = mounted(&mut nor, PAGES);
    store_it(&mut nor, &mut store, 2, &bytes(100, 1)).unwrap();
    store_it(&mut nor, &mut store, 2, &bytes(100, 2)).unwrap();
    // Both lie in the first page: 16 of the page, 116 of version 1, 16 of the chunk.
    nor.flip(PAGE + 16 + 116 + 16 + 50, 4);
    assert!(!store.check(&mut nor, 2).unwrap());
    let mut damaged = 0;
    for version in 0..60 {
        let new = bytes(500, version);
        match store_it(&mut nor, &mut store, 1, &new) {
            Err(RecordError::Damaged(2)) => damaged += 1,
            result => assert_eq!(result, Ok(())),
        }
    }
    assert_eq!(damaged, 1);
    assert_eq!(content(&mut nor, &store)[2], bytes(100, 1));
    assert!(store.check(&mut nor, 2).unwrap());
}

#[test]
fn a_worn_page_is_reported_and_what_was_stored_stays() {
    let mut nor = bench(PAGES + 2, 4);
    nor.set_endurance(3);
    let mut store = mounted(&mut nor, PAGES);
    let mut kept = Vec::new();
    let error = loop {
        let new = bytes(900, kept.len() as u32);
        match store_it(&mut nor, &mut store, 0, &new) {
            Ok(()) => kept = new,
            Err(error) => break error,
        }
    };
    assert_eq!(error, RecordError::Access(AccessError::Worn));
    assert_eq!(content(&mut nor, &store)[0], kept);
    let store = mounted(&mut nor, PAGES);
    assert_eq!(content(&mut nor, &store)[0], kept);
}

#[test]
fn what_does_not_fit_is_refused_and_costs_nothing() {
    let mut nor = bench(PAGES + 2, 4);
    let mut store = mounted(&mut nor, 4);
    store_it(&mut nor, &mut store, 0, &bytes(600, 1)).unwrap();
    assert_eq!(store.prepare(&mut nor, 3092), Err(RecordError::Full));
    // Without asking before, the same ends in the middle and leaves the old.
    store_it(&mut nor, &mut store, CALIBRATION, &bytes(268, 1)).unwrap();
    let refused = write(&mut nor, &mut store, CALIBRATION, &bytes(3092, 2));
    assert_eq!(refused, Err(RecordError::NeedsErase));
    assert_eq!(content(&mut nor, &store)[4], bytes(268, 1));
    store_it(&mut nor, &mut store, CALIBRATION, &bytes(268, 3)).unwrap();
    assert_eq!(content(&mut nor, &store)[4], bytes(268, 3));
}

#[test]
fn the_large_part_has_room_for_every_record_at_its_longest() {
    for pages in [PAGES, RC.records.pages()] {
        assert_eq!(rounds_of(pages, LONGEST_OF), Ok(()));
    }
    assert_eq!(rounds_of(PAGES - 1, LONGEST_OF), Err(RecordError::Full));
}

#[test]
fn the_longest_calibration_beside_the_parameters_is_as_the_maps_have_it() {
    for (layout, parameters, longest) in [
        (RC, [600, 500, 400, 16], 5793),
        (CB, [600, 500, 400, 16], 1761),
    ] {
        let [a, b, c, d] = parameters;
        let of = |longest| rounds_of(layout.records.pages(), [a, b, c, d, longest]);
        assert_eq!(of(longest), Ok(()), "{}", layout.part);
        assert_eq!(of(longest + 1), Err(RecordError::Full), "{}", layout.part);
    }
    // A ring of two pages would take nothing.
    assert_eq!(rounds_of(2, [0; KINDS]), Err(RecordError::Full));
    assert!([RC, CB].iter().all(|layout| layout.records.pages() > 2));
}

/// Stores every kind at its length, several times over, on so many pages.
fn rounds_of(pages: u32, lengths: [u32; KINDS]) -> Result<(), RecordError> {
    let mut nor = bench(pages + 2, 5);
    let mut store = mounted(&mut nor, pages);
    for version in 0..8 {
        for (kind, length) in (0..).zip(lengths) {
            store_it(&mut nor, &mut store, kind, &bytes(length, version))?;
        }
    }
    Ok(())
}

#[test]
fn a_region_full_of_anything_is_empty_and_can_be_used() {
    let mut random = Seeded::new(3);
    let mut nor = bench(PAGES + 2, 4);
    for at in 0..(PAGES + 2) * PAGE {
        nor.flip(at, random.below(256) as u8);
    }
    let mut store = mounted(&mut nor, PAGES);
    assert_eq!(content(&mut nor, &store), Content::default());
    store_it(&mut nor, &mut store, 1, b"first").unwrap();
    let store = mounted(&mut nor, PAGES);
    assert_eq!(content(&mut nor, &store)[1], b"first");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_sizes_through_any_cuts_give_the_old_or_the_new(
        seed: u64,
        longest in prop::array::uniform5(0..900u32),
    ) {
        storm(seed >> 2, PAGES, longest, 160);
    }
}
