//! The memory of a part that keeps records and nothing else: no second slot, no event log.
//!
//! In: a flash as [`NorFlash`], and its map. Out: [`RecordStore`] over two banks
//! ([`flash::banks`]); an [`EventStore`] that keeps no event; a [`ProgramMemory`] that takes no
//! program in and tells of the one that runs.
//!
//! A store writes all records anew, into a bank that was erased before. Where that was not done
//! ahead ([`EventStore::make_room`]), [`RecordStore::begin`] does it: five pages of the paper's
//! part, 40 ms each at most (DS5319 5.3.9).
//!
//! Left out: the flash controller.

use embedded_storage::nor_flash::NorFlash;
use flash::Progress;
use flash::banks::{self, BankError, Banks};
use flash::image::header;

use super::Build;
use crate::fault_log::ENTRY;
use crate::program::{Confirmation, Held, ProgramError, ProgramMemory, Running};
use crate::records::{EventStore, Record, RecordStore, StoreError};

const _: () = assert!(Record::COUNT <= banks::KINDS as usize);

/// Records in the flash `F`.
#[derive(Clone, Debug)]
pub struct RecordMemory<F> {
    flash: F,
    build: Build,
    records: Banks,
}

impl From<BankError> for StoreError {
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn from(error: BankError) -> Self {
        match error {
            BankError::NeedsErase | BankError::Full => Self::Full,
            BankError::NotBegun => Self::NotBegun,
            BankError::Access(_) | BankError::Kind | BankError::Damaged => Self::Hardware,
        }
    }
}

impl<F: NorFlash> RecordMemory<F> {
    /// A memory in which nothing was looked for ([`RecordStore::start`]).
    pub fn new(flash: F, build: Build) -> Self {
        Self {
            flash,
            build,
            records: Banks::unmounted(build.layout.records),
        }
    }

    /// The flash.
    pub const fn flash(&self) -> &F {
        &self.flash
    }

    /// The flash, for whoever breaks it or looks after it.
    pub const fn flash_mut(&mut self) -> &mut F {
        &mut self.flash
    }
}

impl<F: NorFlash> RecordStore for RecordMemory<F> {
    fn start(&mut self) -> Result<(), StoreError> {
        Ok(self.records.mount(&mut self.flash)?)
    }

    fn read(&mut self, record: Record, offset: u32, into: &mut [u8]) -> usize {
        let read = self
            .records
            .read(&mut self.flash, record as u8, offset, into);
        read.unwrap_or(0)
    }

    fn damaged(&self) -> u32 {
        self.records.damaged()
    }

    fn needs_erase(&self, _: u32) -> bool {
        self.records.needs_erase()
    }

    fn begin(&mut self, record: Record, _: u32) -> Result<(), StoreError> {
        while self.records.prepare(&mut self.flash)? == Progress::More {}
        Ok(self.records.begin(&mut self.flash, record as u8)?)
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        Ok(self.records.append(&mut self.flash, bytes)?)
    }

    fn staged(&mut self, offset: u32, into: &mut [u8]) -> usize {
        let staged = self.records.staged(&mut self.flash, offset, into);
        staged.unwrap_or(0)
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        Ok(self.records.commit(&mut self.flash)?)
    }

    fn discard(&mut self) {
        self.records.discard();
    }

    fn erase(&mut self, record: Record) -> Result<(), StoreError> {
        let lost = self.records.damaged() & (1 << record as u32);
        if lost == 0 && self.records.length(&mut self.flash, record as u8) == 0 {
            return Ok(());
        }
        RecordStore::begin(self, record, 0)?;
        RecordStore::commit(self)
    }
}

/// There is no log: nothing is recalled, and an event finds no room.
impl<F: NorFlash> EventStore for RecordMemory<F> {
    fn recall_events(&mut self, _: &mut dyn FnMut(&[u8; ENTRY])) {}

    fn keep_event(&mut self, _: &[u8; ENTRY]) -> Result<(), StoreError> {
        Err(StoreError::Full)
    }

    fn clear_events(&mut self) -> Result<(), StoreError> {
        Err(StoreError::Full)
    }

    fn needs_room(&self) -> bool {
        self.records.needs_erase()
    }

    fn make_room(&mut self) -> Result<(), StoreError> {
        self.records.prepare(&mut self.flash)?;
        Ok(())
    }
}

/// There is no place for a second program.
impl<F: NorFlash> ProgramMemory for RecordMemory<F> {
    fn clear(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::Secured)
    }

    fn erase(&mut self) -> Result<Progress, ProgramError> {
        Err(ProgramError::NotCleared)
    }

    fn begin(&mut self, _: Option<u32>) -> Result<(), ProgramError> {
        Err(ProgramError::NotCleared)
    }

    fn append(&mut self, _: &[u8]) -> Result<(), ProgramError> {
        Err(ProgramError::NotCleared)
    }

    fn commit(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::NotCleared)
    }

    fn discard(&mut self) {}

    fn held(&self) -> Option<Held> {
        None
    }

    fn activate(&mut self) -> Result<Progress, ProgramError> {
        Err(ProgramError::NoProgram)
    }

    fn running(&mut self) -> Running {
        let Build {
            layout, hardware, ..
        } = self.build;
        let header = header(&mut self.flash, layout.a, hardware).ok();
        Running {
            hardware,
            version: header.map_or(0, |header| header.version.0),
            crc: header.map_or(0, |header| header.crc),
            slot: self.build.running as u8,
            confirmation: Confirmation::Confirmed,
        }
    }

    fn confirm(&mut self) -> Result<(), ProgramError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests;
