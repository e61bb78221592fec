//! Calibration and parameters of the paper's instrument through stores and cuts.

extern crate std;

use std::vec;
use std::vec::Vec;

use canopen::object::Access;
use flash::layout::{C8, PAGE, Slot};
use flash::nor::medium::Medium;
use flash::nor::{Draw, Nor, Page};

use super::*;
use crate::calibration::encoding::MAX_LENGTH;
use crate::objects::row::Row;
use crate::objects::table::{Models, rows_of};

#[derive(Clone, Debug)]
struct Noise(u32);

impl Draw for Noise {
    fn draw(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        self.0 ^ self.0 >> 16
    }
}

type Paper = RecordMemory<Medium<Vec<Page>, Noise>>;

fn blank() -> Paper {
    let pages = vec![Page::new(); (C8.flash / PAGE) as usize];
    let build = Build {
        layout: &C8,
        running: Slot::A,
        hardware: C8.hardware,
    };
    let mut memory = RecordMemory::new(Medium(Nor::new(pages, Noise(1))), build);
    RecordStore::start(&mut memory).unwrap();
    memory
}

fn store(memory: &mut Paper, record: Record, bytes: &[u8]) -> Result<(), StoreError> {
    RecordStore::begin(memory, record, bytes.len() as u32)?;
    let mut pieces = bytes.chunks(32);
    pieces.try_for_each(|piece| RecordStore::append(memory, piece))?;
    RecordStore::commit(memory)
}

fn held(memory: &mut Paper, record: Record) -> Vec<u8> {
    let mut bytes = vec![0; 4096];
    let length = memory.read(record, 0, &mut bytes);
    bytes.truncate(length);
    bytes
}

fn calibration(version: u8) -> Vec<u8> {
    (0..MAX_LENGTH).map(|n| (n % 251) as u8 ^ version).collect()
}

/// Bytes of each group's record when everything is stored that the paper's dictionary keeps.
fn parameters() -> [(Record, u32); 3] {
    let of = |indices: core::ops::RangeInclusive<u16>| {
        let rows = rows_of(Models::PAPER).iter();
        let kept =
            rows.filter(|row| indices.contains(&row.index) && row.access.has(Access::STORED));
        // Index, sub-index and length of each entry are 4 bytes.
        let bytes = |row: &Row| 4 + row.data_type.size().unwrap() as u32;
        kept.map(|row| u32::from(row.last - row.sub + 1) * bytes(row))
            .sum::<u32>()
    };
    [
        (Record::Communication, of(0x1000..=0x1FFF)),
        (Record::Profile, of(0x6000..=0x9FFF)),
        (Record::Manufacturer, of(0x2000..=0x5FFF)),
    ]
}

/// What the paper's part may have to keep at once: each record with its length.
fn everything() -> Vec<(Record, u32)> {
    let others = [Record::Lss, Record::Report, Record::Calibration];
    let others = others.map(|record| (record, record.longest()));
    parameters().into_iter().chain(others).collect()
}

#[test]
fn all_that_the_paper_s_dictionary_stores_fits_into_a_bank_beside_the_longest_calibration() {
    for (record, length) in parameters() {
        assert!(length <= record.longest(), "{record:?} {length}");
    }
    let together: u32 = everything()
        .iter()
        .map(|(_, length)| length.next_multiple_of(2))
        .sum();
    let room = banks::room(C8.records.length / 2);
    // The chip erases whole pages, and a page less would not do.
    assert!(together <= room, "{together} of {room}");
    assert!(together > room - C8.chip_page, "{together} of {room}");
}

#[test]
fn the_longest_calibration_is_kept_beside_parameters_again_and_again() {
    let mut memory = blank();
    for round in 0..6 {
        for (record, length) in everything() {
            let bytes = vec![round; length as usize];
            assert_eq!(store(&mut memory, record, &bytes), Ok(()));
        }
        assert_eq!(
            store(&mut memory, Record::Calibration, &calibration(round)),
            Ok(())
        );
        RecordStore::start(&mut memory).unwrap();
        assert_eq!(held(&mut memory, Record::Calibration), calibration(round));
        for (record, length) in parameters() {
            assert_eq!(held(&mut memory, record), vec![round; length as usize]);
        }
    }
    assert_eq!(memory.flash().0.broken_rules(), 0);
}

#[test]
fn what_does_not_fit_is_refused_and_the_old_stays() {
    let mut memory = blank();
    store(&mut memory, Record::Calibration, &calibration(1)).unwrap();
    let rest = banks::room(C8.records.length / 2) - MAX_LENGTH;
    let long = vec![7; rest as usize];
    assert_eq!(store(&mut memory, Record::Communication, &long), Ok(()));
    for record in [Record::Communication, Record::Delivered] {
        let longer = vec![8; rest as usize + 1];
        assert_eq!(store(&mut memory, record, &longer), Err(StoreError::Full));
    }
    RecordStore::start(&mut memory).unwrap();
    assert_eq!(held(&mut memory, Record::Communication), long);
    assert_eq!(held(&mut memory, Record::Calibration), calibration(1));
}

/// Cuts a store of a calibration over another one at operation `cut`: it is the old one or the new
/// one, and the rest is what it was. Whether the store came to its end.
fn cut_at(before: &Paper, cut: u64) -> bool {
    let mut memory = before.clone();
    memory.flash_mut().0.cut_after(cut);
    let done = store(&mut memory, Record::Calibration, &calibration(2)).is_ok();
    memory.flash_mut().0.power_up();
    RecordStore::start(&mut memory).unwrap();
    let found = held(&mut memory, Record::Calibration);
    let new = found == calibration(2);
    assert!(new || !done && found == calibration(1), "cut {cut}");
    assert_eq!(held(&mut memory, Record::Profile), [5; 99], "cut {cut}");
    assert_eq!(memory.damaged(), 0, "cut {cut}");
    // Life goes on.
    store(&mut memory, Record::Profile, &[6]).unwrap();
    assert_eq!(held(&mut memory, Record::Profile), [6], "cut {cut}");
    assert_eq!(memory.flash().0.broken_rules(), 0, "cut {cut}");
    done
}

#[test]
fn a_cut_at_any_operation_of_a_calibration_in_banks_leaves_the_old_or_the_new() {
    let mut before = blank();
    store(&mut before, Record::Profile, &[5; 99]).unwrap();
    store(&mut before, Record::Calibration, &calibration(1)).unwrap();
    // The first operations are the erases of the other bank.
    assert!(before.needs_erase(0));
    let cuts = (0..).take_while(|cut| !cut_at(&before, *cut)).count();
    assert!(cuts > 1500, "{cuts}");
}

#[test]
fn there_is_no_log_and_no_place_for_a_program() {
    let mut memory = blank();
    assert_eq!(memory.keep_event(&[0; ENTRY]), Err(StoreError::Full));
    assert_eq!(memory.clear_events(), Err(StoreError::Full));
    memory.recall_events(&mut |_| panic!("an event"));
    assert_eq!(memory.clear(), Err(ProgramError::Secured));
    assert_eq!(
        ProgramMemory::begin(&mut memory, None),
        Err(ProgramError::NotCleared)
    );
    assert_eq!(
        ProgramMemory::append(&mut memory, &[0]),
        Err(ProgramError::NotCleared)
    );
    assert_eq!(memory.activate(), Err(ProgramError::NoProgram));
    assert_eq!(memory.held(), None);
    assert_eq!(memory.running().confirmation, Confirmation::Confirmed);
}

#[test]
fn room_for_parameters_is_made_ahead_a_page_at_a_time() {
    let mut memory = blank();
    let mut steps = 0;
    while memory.needs_room() {
        let before = memory.flash().0.operations();
        memory.make_room().unwrap();
        let after = memory.flash().0.operations();
        // With the last page the bank is marked as ready.
        assert!(after - before <= if memory.needs_room() { 1 } else { 2 });
        steps += 1;
    }
    assert_eq!(steps, 4);
    assert!(!memory.needs_erase(Record::Communication.longest()));
}
