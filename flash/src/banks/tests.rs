//! Banks stored, read, cut at every operation and damaged.

use std::collections::BTreeMap;
use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::layout::{C8, HALF_PAGE, PAGE};
use crate::nor::medium::Medium;
use crate::nor::tests::{Bench, Seeded, bench};

type Chip = Medium<Vec<crate::nor::Page>, Seeded>;
/// Bytes by kind.
type Content = BTreeMap<u8, Vec<u8>>;

/// Two banks of two of the chip's pages, with as much before and behind.
const REGION: Region = Region {
    start: PAGE,
    length: 4 * HALF_PAGE,
};

fn chip(seed: u64) -> Chip {
    Medium(bench(4, seed))
}

fn mounted(chip: &mut Chip) -> Banks {
    mounted_in(chip, REGION)
}

fn mounted_in<F: NorFlash>(flash: &mut F, region: Region) -> Banks {
    let mut banks = Banks::unmounted(region);
    banks.mount(flash).unwrap();
    banks
}

/// Bytes that differ from version to version; the first pair and every sixteenth is FFFFh.
fn bytes(length: u32, version: u32) -> Vec<u8> {
    let byte = |n: u32| match n % 32 {
        0 | 1 => 0xFF,
        _ => (n * 31 + version * 17 + n / 256) as u8,
    };
    (0..length).map(byte).collect()
}

fn prepare<F: NorFlash>(flash: &mut F, banks: &mut Banks) -> Result<(), BankError> {
    while banks.prepare(flash)? == Progress::More {}
    Ok(())
}

fn stage<F: NorFlash>(
    flash: &mut F,
    banks: &mut Banks,
    kind: u8,
    new: &[u8],
) -> Result<(), BankError> {
    prepare(flash, banks)?;
    banks.begin(flash, kind)?;
    // Pieces of several sizes, odd ones too.
    let (mut rest, mut size) = (new, 1);
    while !rest.is_empty() {
        let (piece, behind) = rest.split_at(rest.len().min(size));
        banks.append(flash, piece)?;
        (rest, size) = (behind, size % 23 + 3);
    }
    Ok(())
}

fn store<F: NorFlash>(
    flash: &mut F,
    banks: &mut Banks,
    kind: u8,
    new: &[u8],
) -> Result<(), BankError> {
    stage(flash, banks, kind, new)?;
    banks.commit(flash)
}

fn content<F: NorFlash>(flash: &mut F, banks: &Banks) -> Content {
    let mut content = Content::new();
    for kind in 0..KINDS {
        let mut into = vec![0; 6000];
        let count = banks.read(flash, kind, 0, &mut into).unwrap();
        assert_eq!(banks.length(flash, kind) as usize, count);
        into.truncate(count);
        if count > 0 {
            content.insert(kind, into);
        }
    }
    content
}

#[test]
fn what_is_committed_is_read_from_any_offset_also_after_a_reset() {
    let mut chip = chip(1);
    let mut banks = mounted(&mut chip);
    let new = bytes(1001, 1);
    store(&mut chip, &mut banks, 3, b"before").unwrap();
    store(&mut chip, &mut banks, 4, &new).unwrap();
    store(&mut chip, &mut banks, 15, b"behind").unwrap();
    for banks in [banks, mounted(&mut chip)] {
        for offset in (0..1010).step_by(7) {
            let mut into = [0; 61];
            let count = banks.read(&mut chip, 4, offset, &mut into).unwrap();
            let rest = new.get(offset as usize..).unwrap_or(&[]);
            assert_eq!(into[..count], rest[..rest.len().min(61)]);
        }
        let held = content(&mut chip, &banks);
        assert_eq!(held.len(), 3);
        assert_eq!(
            (&held[&3][..], &held[&15][..]),
            (&b"before"[..], &b"behind"[..])
        );
        for kind in [0, KINDS, u8::MAX] {
            assert_eq!(banks.read(&mut chip, kind, 0, &mut [0; 4]), Ok(0));
        }
    }
    assert_eq!(chip.0.broken_rules(), 0);
}

#[test]
fn nothing_counts_before_the_commit_and_a_discard_forgets() {
    let mut chip = chip(1);
    let mut banks = mounted(&mut chip);
    store(&mut chip, &mut banks, 0, b"old").unwrap();
    assert_eq!(banks.begin(&mut chip, 0), Err(BankError::NeedsErase));
    prepare(&mut chip, &mut banks).unwrap();
    assert_eq!(banks.begin(&mut chip, KINDS), Err(BankError::Kind));
    let new = bytes(601, 2);
    stage(&mut chip, &mut banks, 0, &new).unwrap();
    let mut into = vec![0; 700];
    for offset in [0, 1, 599, 600, 601, 3000] {
        let count = banks.staged(&mut chip, offset, &mut into).unwrap();
        assert_eq!(&into[..count], new.get(offset as usize..).unwrap_or(&[]));
    }
    assert_eq!(content(&mut chip, &banks)[&0], b"old");
    banks.discard();
    assert_eq!(banks.staged(&mut chip, 0, &mut into), Ok(0));
    assert_eq!(banks.commit(&mut chip), Err(BankError::NotBegun));
    assert_eq!(banks.append(&mut chip, b"x"), Err(BankError::NotBegun));
    for mut banks in [banks.clone(), mounted(&mut chip)] {
        assert_eq!(content(&mut chip, &banks)[&0], b"old");
        store(&mut chip, &mut banks, 1, b"other").unwrap();
    }
    let banks = mounted(&mut chip);
    assert_eq!(content(&mut chip, &banks).len(), 2);
}

#[test]
fn what_does_not_fit_is_refused_to_the_byte_and_the_old_stays() {
    let mut chip = chip(1);
    let mut banks = mounted(&mut chip);
    let room = room(REGION.length / 2);
    store(&mut chip, &mut banks, 7, &bytes(99, 1)).unwrap();
    let longest = room - 100;
    for kind in [2, 9] {
        store(&mut chip, &mut banks, kind, &bytes(longest, 1)).unwrap();
        let longer = bytes(longest + 1, 2);
        let refused = store(&mut chip, &mut banks, kind, &longer);
        assert_eq!(refused, Err(BankError::Full));
        let mut again = mounted(&mut chip);
        assert_eq!(content(&mut chip, &again)[&kind], bytes(longest, 1));
        assert_eq!(content(&mut chip, &again)[&7], bytes(99, 1));
        store(&mut chip, &mut again, kind, &[]).unwrap();
        banks = again;
    }
    assert_eq!(content(&mut chip, &banks).len(), 1);
    assert_eq!(chip.0.broken_rules(), 0);
}

#[test]
fn a_bank_that_is_ready_stays_ready_over_a_reset_and_is_erased_once_for_each_store() {
    let mut chip = chip(1);
    let mut banks = mounted(&mut chip);
    for round in 1..=50_u32 {
        prepare(&mut chip, &mut banks).unwrap();
        banks = mounted(&mut chip);
        assert!(!banks.needs_erase());
        store(&mut chip, &mut banks, 1, &bytes(300, round)).unwrap();
        let erases: Vec<u32> = chip
            .0
            .pages()
            .iter()
            .map(crate::nor::Page::erases)
            .collect();
        let [first, second] = [round.div_ceil(2), round / 2];
        assert!(erases[0] == 0 && erases[3] == 0);
        assert!(erases[1..3] == [first, second] || erases[1..3] == [second, first]);
    }
}

/// A chip in which two kinds have been stored twice, and what it holds.
fn filled(seed: u64) -> (Chip, Content) {
    let mut chip = chip(seed);
    let mut banks = mounted(&mut chip);
    for version in 0..2 {
        store(&mut chip, &mut banks, 1, &bytes(301, version)).unwrap();
        store(&mut chip, &mut banks, 6, &bytes(260, version)).unwrap();
    }
    let kept = content(&mut chip, &banks);
    (chip, kept)
}

/// Cuts a store at operation `cut`; what was before, or what was meant to be, is held then.
/// Whether the store came to its end.
fn cut_once(chip: &mut Chip, kept: &mut Content, cut: u64, kind: u8, new: &[u8]) -> bool {
    let mut banks = mounted(chip);
    chip.0.cut_after(cut);
    let done = store(chip, &mut banks, kind, new).is_ok();
    chip.0.power_up();
    let mut after = kept.clone();
    after.insert(kind, new.to_vec());
    after.retain(|_, bytes| !bytes.is_empty());
    // What is found is found each time, whatever the cells of a torn page read as.
    for _ in 0..3 {
        let banks = mounted(chip);
        let now = content(chip, &banks);
        assert_eq!(banks.damaged(), 0, "cut {cut}");
        assert!(now == after || (!done && now == *kept), "cut {cut}");
        *kept = now;
    }
    assert_eq!(chip.0.broken_rules(), 0, "cut {cut}");
    done
}

#[test]
fn a_cut_at_any_operation_of_any_store_in_banks_leaves_the_old_or_the_new() {
    for seed in 0..4 {
        let (full, kept) = filled(seed);
        for (kind, length) in [(0, 77), (1, 301), (6, 500), (9, 30), (6, 0)] {
            for cut in 0.. {
                let (mut chip, mut kept) = (full.clone(), kept.clone());
                chip.0.reseed(seed ^ cut << 8);
                let new = bytes(length, 9);
                let done = cut_once(&mut chip, &mut kept, cut, kind, &new);
                // Life goes on.
                let mut more = kept.clone();
                assert!(cut_once(&mut chip, &mut more, 1 << 40, 3, b"more"));
                assert_eq!(more[&3], b"more");
                if done {
                    // Two pages, and the half-words of what is kept, FFFFh left out.
                    assert!(cut > 140, "{cut}");
                    break;
                }
            }
        }
    }
}

#[test]
fn a_second_cut_at_any_operation_of_the_repair_leaves_the_old_or_the_new() {
    let mut chip = chip(1);
    let mut banks = mounted(&mut chip);
    store(&mut chip, &mut banks, 1, &bytes(21, 0)).unwrap();
    store(&mut chip, &mut banks, 6, &bytes(40, 0)).unwrap();
    let full = chip;
    let kept = content(&mut full.clone(), &banks);
    for first in 0.. {
        let (mut once, mut held) = (full.clone(), kept.clone());
        once.0.reseed(first);
        let all = cut_once(&mut once, &mut held, first, 1, &bytes(23, 1));
        for second in 0.. {
            let (mut chip, mut held) = (once.clone(), held.clone());
            chip.0.reseed(first << 16 ^ second);
            if cut_once(&mut chip, &mut held, second, 6, &bytes(18, 2)) {
                break;
            }
        }
        if all {
            break;
        }
    }
}

#[test]
fn an_erase_that_is_cut_again_and_again_is_no_damage_and_no_readiness() {
    // Records reach into the last page, where the marks are.
    let (mut full, mut kept) = filled(1);
    for version in 0..2 {
        assert!(cut_once(
            &mut full,
            &mut kept,
            1 << 40,
            9,
            &bytes(1100, version)
        ));
    }
    for seed in 0..2000 {
        let (mut chip, mut kept) = (full.clone(), kept.clone());
        chip.0.reseed(seed);
        for again in 0..4 {
            let cut = (seed >> again) & 1;
            assert!(!cut_once(&mut chip, &mut kept, cut, 1, b"new"));
        }
        assert!(cut_once(&mut chip, &mut kept, 1 << 40, 1, b"new"));
    }
}

#[test]
fn the_banks_of_the_paper_s_part_and_pages_of_2_kb_do_as_well() {
    let mut chip = Medium(bench(C8.flash / PAGE, 1));
    let mut banks = mounted_in(&mut chip, C8.records);
    let mut large: Bench = bench(8, 1);
    let region = Region {
        start: 0,
        length: 8 * PAGE,
    };
    let mut wide = mounted_in(&mut large, region);
    for version in 0..6 {
        for (kind, length) in [(0, 760), (2, 83), (3, 32), (4, 3092), (8, 36)] {
            let new = bytes(length, version);
            store(&mut chip, &mut banks, kind, &new).unwrap();
            store(&mut large, &mut wide, kind, &new).unwrap();
        }
        let (a, b) = (
            mounted_in(&mut chip, C8.records),
            mounted_in(&mut large, region),
        );
        assert_eq!(content(&mut chip, &a), content(&mut large, &b));
        assert_eq!(content(&mut chip, &a)[&4], bytes(3092, version));
    }
    assert_eq!((chip.0.broken_rules(), large.broken_rules()), (0, 0));
}

#[test]
fn any_flipped_bit_is_told_of_until_its_kind_is_stored_anew_and_gives_the_bank_before() {
    let (full, kept) = filled(2);
    let start = {
        let banks = mounted(&mut full.clone());
        banks.force
    };
    let end = start + REGION.length / 2;
    let used = start + CONTENT + 302 + 260;
    let (mut older, mut random) = (0, Seeded::new(9));
    for at in (start..used).chain(end - MARKS..end) {
        let mut chip = full.clone();
        chip.0.flip(at, 1 << random.below(8));
        let mut banks = mounted(&mut chip);
        let now = content(&mut chip, &banks);
        if banks.damaged() == 0 {
            // The word that shows that the bank was ready has done its part; one mark is enough.
            assert!(at < start + 2 || at >= end - MARKS, "byte {at}");
            assert_eq!(now, kept);
        } else {
            assert_eq!(banks.damaged() & 0x42, 0x42, "byte {at}");
            assert_eq!(
                (&now[&1], &now[&6]),
                (&kept[&1], &bytes(260, 0)),
                "byte {at}"
            );
            older += 1;
            // It is told of again after the next store, of what that did not store.
            store(&mut chip, &mut banks, 6, b"anew").unwrap();
            let mut banks = mounted(&mut chip);
            assert_eq!(banks.damaged() & 0x42, 2);
            store(&mut chip, &mut banks, 1, b"anew").unwrap();
            assert_eq!(mounted(&mut chip).damaged() & 0x42, 0);
        }
    }
    assert!(older > 580, "{older}");
}

#[test]
fn the_only_bank_that_loses_a_bit_is_told_of_and_the_store_works_on() {
    let (mut full, _) = filled(2);
    let mut banks = mounted(&mut full);
    prepare(&mut full, &mut banks).unwrap();
    for bit in 0..8 {
        let mut chip = full.clone();
        chip.0.flip(banks.force + CONTENT + 40, 1 << bit);
        let mut banks = mounted(&mut chip);
        assert_eq!(banks.damaged(), 0x42);
        assert_eq!(content(&mut chip, &banks).len(), 0);
        store(&mut chip, &mut banks, 1, b"anew").unwrap();
        let banks = mounted(&mut chip);
        assert_eq!(banks.damaged(), 0x40);
        assert_eq!(content(&mut chip, &banks)[&1], b"anew");
    }
}

#[test]
fn a_bit_that_goes_bad_after_the_mount_is_not_copied_under_a_new_check_sum() {
    let (mut chip, _) = filled(2);
    let mut banks = mounted(&mut chip);
    chip.0.flip(banks.force + CONTENT + 40, 4);
    let refused = store(&mut chip, &mut banks, 6, b"new");
    assert_eq!(refused, Err(BankError::Damaged));
    assert_eq!(mounted(&mut chip).damaged(), 0x42);
}

#[test]
fn a_region_full_of_anything_is_empty_and_can_be_used() {
    let (mut random, mut chip) = (Seeded::new(3), chip(4));
    for at in 0..4 * PAGE {
        chip.0.flip(at, random.below(256) as u8);
    }
    let mut banks = mounted(&mut chip);
    assert_eq!(content(&mut chip, &banks), Content::new());
    store(&mut chip, &mut banks, 1, b"first").unwrap();
    let banks = mounted(&mut chip);
    assert_eq!(content(&mut chip, &banks)[&1], b"first");
}

#[test]
fn a_worn_page_is_reported_and_what_was_stored_stays() {
    let mut chip = chip(4);
    chip.0.set_endurance(3);
    let mut banks = mounted(&mut chip);
    let mut kept = Vec::new();
    let error = loop {
        let new = bytes(200, kept.len() as u32 + 1);
        match store(&mut chip, &mut banks, 0, &new) {
            Ok(()) => kept = new,
            Err(error) => break error,
        }
    };
    assert_eq!(error, BankError::Access(AccessError::Worn));
    for banks in [banks, mounted(&mut chip)] {
        assert_eq!(content(&mut chip, &banks)[&0], kept);
    }
}

#[test]
fn sequence_numbers_go_round() {
    assert!(is_before(1, 2) && is_before(u16::MAX, 0) && is_before(u16::MAX - 3, 5));
    assert!(!is_before(2, 1) && !is_before(0, u16::MAX) && !is_before(4, 4));
}

/// What happens to the banks.
#[derive(Clone, Debug)]
enum Event {
    /// A store of so many bytes, which a cut may end.
    Store(u8, u32, Option<u64>),
    /// Staged and forgotten.
    Discard(u8, u32),
    /// The supply fails between two operations.
    Reboot,
    /// A step of making room.
    Prepare,
}

fn events() -> impl Strategy<Value = Event> {
    let kind = 0..KINDS;
    let cut = prop::option::of(prop_oneof![0..6_u64, 0..1000_u64]);
    prop_oneof![
        4 => (kind.clone(), 0..200_u32, cut).prop_map(|(k, n, c)| Event::Store(k, n, c)),
        1 => (kind, 0..200_u32).prop_map(|(k, n)| Event::Discard(k, n)),
        1 => Just(Event::Reboot),
        2 => Just(Event::Prepare),
    ]
}

/// Goes through `events` on a chip and on a map, which have to agree.
fn run(seed: u64, events: &[Event]) {
    let mut chip = chip(seed);
    let (mut banks, mut kept) = (mounted(&mut chip), Content::new());
    for (version, event) in (0..).zip(events) {
        match *event {
            Event::Reboot => banks = mounted(&mut chip),
            Event::Prepare => drop(banks.prepare(&mut chip).unwrap()),
            Event::Discard(kind, length) => {
                let _ = stage(&mut chip, &mut banks, kind, &bytes(length, version));
                banks.discard();
            }
            Event::Store(kind, length, cut) => {
                let new = bytes(length, version);
                if let Some(cut) = cut {
                    chip.0.cut_after(cut);
                }
                let result = store(&mut chip, &mut banks, kind, &new);
                if chip.0.is_cut() {
                    chip.0.power_up();
                    banks = mounted(&mut chip);
                } else {
                    chip.0.power_up();
                    assert!(
                        matches!(result, Ok(()) | Err(BankError::Full)),
                        "{result:?}"
                    );
                }
                let mut after = kept.clone();
                after.insert(kind, new);
                after.retain(|_, bytes| !bytes.is_empty());
                let now = content(&mut chip, &banks);
                if now == after {
                    kept = after;
                } else {
                    assert!(result.is_err());
                }
            }
        }
        assert_eq!(content(&mut chip, &banks), kept);
        assert_eq!((banks.damaged(), chip.0.broken_rules()), (0, 0));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn stores_cuts_and_reboots_in_any_order_are_as_in_a_map(
        seed: u64,
        events in prop::collection::vec(events(), 1..40),
    ) {
        run(seed >> 2, &events);
    }
}
