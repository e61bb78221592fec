//! A store in memory, and parameters put into it and taken out again.

extern crate std;

use std::vec::Vec;

use canopen::object::{Value, at};
use proptest::prelude::*;

use super::parameters::{Entries, get, put};
use super::{Record, RecordStore, StoreError};

/// A record store without a flash, with room for `room` bytes in each record.
#[derive(Debug, Default)]
pub(crate) struct Memory {
    pub committed: [Vec<u8>; Record::COUNT],
    pub staged: Option<(Record, Vec<u8>)>,
    pub room: usize,
}

impl Memory {
    /// An empty store.
    pub(crate) fn with_room(room: usize) -> Self {
        Self {
            room,
            ..Self::default()
        }
    }
}

fn copy(from: &[u8], offset: u32, into: &mut [u8]) -> usize {
    let rest = from.get(offset as usize..).unwrap_or(&[]);
    let pairs = into.iter_mut().zip(rest);
    pairs.map(|(to, from)| *to = *from).count()
}

impl RecordStore for Memory {
    fn start(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn needs_erase(&self, _length: u32) -> bool {
        false
    }

    fn read(&mut self, record: Record, offset: u32, into: &mut [u8]) -> usize {
        copy(&self.committed[record as usize], offset, into)
    }

    fn begin(&mut self, record: Record, _length: u32) -> Result<(), StoreError> {
        self.staged = Some((record, Vec::new()));
        Ok(())
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        let (_, staged) = self.staged.as_mut().ok_or(StoreError::NotBegun)?;
        if staged.len() + bytes.len() > self.room {
            return Err(StoreError::Full);
        }
        staged.extend_from_slice(bytes);
        Ok(())
    }

    fn staged(&mut self, offset: u32, into: &mut [u8]) -> usize {
        let staged = self.staged.as_ref();
        staged.map_or(0, |(_, bytes)| copy(bytes, offset, into))
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        let (record, bytes) = self.staged.take().ok_or(StoreError::NotBegun)?;
        self.committed[record as usize] = bytes;
        Ok(())
    }

    fn discard(&mut self) {
        self.staged = None;
    }

    fn erase(&mut self, record: Record) -> Result<(), StoreError> {
        self.committed[record as usize].clear();
        Ok(())
    }
}

#[test]
fn a_parameter_counts_from_its_commit_on() {
    let mut store = Memory::with_room(64);
    store.begin(Record::Profile, 64).unwrap();
    put(&mut store, at(0x6000, 0), &Value::u16(100)).unwrap();
    put(&mut store, at(0x6114, 0), &Value::i32(-7)).unwrap();
    assert_eq!(get(&mut store, Record::Profile, at(0x6000, 0)), None);
    store.commit().unwrap();
    let stored = get(&mut store, Record::Profile, at(0x6114, 0));
    assert_eq!(stored, Some(Value::i32(-7)));
    assert_eq!(get(&mut store, Record::Profile, at(0x6114, 1)), None);
    assert_eq!(get(&mut store, Record::Manufacturer, at(0x6114, 0)), None);
}

#[test]
fn the_bytes_of_an_entry_are_as_documented() {
    let mut store = Memory::with_room(64);
    store.begin(Record::Communication, 64).unwrap();
    put(&mut store, at(0x1017, 0), &Value::u16(0x03E8)).unwrap();
    store.commit().unwrap();
    assert_eq!(store.committed[0], [0x17, 0x10, 0, 2, 0xE8, 0x03]);
}

#[test]
fn a_full_store_is_reported() {
    let mut store = Memory::with_room(7);
    store.begin(Record::Lss, 64).unwrap();
    let error = put(&mut store, at(0x2000, 1), &Value::u32(1));
    assert_eq!(error, Err(StoreError::Full));
}

#[test]
fn an_entry_of_another_program_is_passed_over() {
    let mut store = Memory::default();
    store.committed[0] = [&[1, 0x20, 0, 9][..], &[7; 9], &[0x17, 0x10, 0, 2, 5, 0]].concat();
    let found = get(&mut store, Record::Communication, at(0x1017, 0));
    assert_eq!(found, Some(Value::u16(5)));
    assert_eq!(get(&mut store, Record::Communication, at(0x2001, 0)), None);
}

proptest! {
    #[test]
    fn what_is_put_comes_back_in_order(
        values in prop::collection::vec(any::<(u16, u8, u64, usize)>(), 0..40)
    ) {
        let mut store = Memory::with_room(4096);
        store.begin(Record::Profile, 64).unwrap();
        let all: Vec<_> = values
            .iter()
            .map(|&(index, sub, number, size)| (at(index, sub), Value::cut(number, size % 9)))
            .collect();
        for (address, value) in &all {
            put(&mut store, *address, value).unwrap();
        }
        store.commit().unwrap();
        prop_assert_eq!(Entries::new(&mut store, Record::Profile).collect::<Vec<_>>(), all);
    }

    #[test]
    fn any_bytes_come_to_an_end(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut store = Memory::default();
        let longest = bytes.len() / 4;
        store.committed[0] = bytes;
        prop_assert!(Entries::new(&mut store, Record::Communication).count() <= longest);
    }

    #[test]
    fn a_record_cut_off_loses_only_its_last_entries(cut in 0..60usize) {
        let mut store = Memory::with_room(100);
        store.begin(Record::Profile, 64).unwrap();
        for index in 0..10 {
            put(&mut store, at(index, 0), &Value::u16(index)).unwrap();
        }
        store.commit().unwrap();
        store.committed[1].truncate(cut);
        prop_assert_eq!(Entries::new(&mut store, Record::Profile).count(), cut / 6);
    }
}
