//! Records in the ring: the half of [`FlashMemory`](super::FlashMemory) that keeps records.
//!
//! In: a flash as [`NorFlash`], and its map. Out: [`RecordStore`] over [`Records`].

use embedded_storage::nor_flash::NorFlash;
use flash::Progress;
use flash::records::{RecordError, Records};

use super::{Build, KINDS};
use crate::records::{Record, RecordStore, StoreError};

/// Records in the flash `F`.
#[derive(Clone, Debug)]
pub(super) struct RingMemory<F> {
    pub(super) flash: F,
    pub(super) build: Build,
    pub(super) records: Records<KINDS>,
}

impl<F: NorFlash> RingMemory<F> {
    /// A memory in which nothing was looked for ([`RecordStore::start`]).
    pub(super) fn new(flash: F, build: Build) -> Self {
        Self {
            flash,
            build,
            records: Records::unmounted(build.layout.records),
        }
    }

    /// Makes room for a record of `length` bytes.
    fn prepare(&mut self, length: u32) -> Result<(), StoreError> {
        while self.prepare_step(length)? == Progress::More {}
        Ok(())
    }

    /// A step of making that room: one page at most is erased.
    pub(super) fn prepare_step(&mut self, length: u32) -> Result<Progress, StoreError> {
        match self.records.prepare(&mut self.flash, length) {
            // A record that has lost a bit is reported once; what is left of it counts then.
            Err(RecordError::Damaged(_)) => Ok(Progress::More),
            prepared => Ok(prepared?),
        }
    }
}

impl<F: NorFlash> RecordStore for RingMemory<F> {
    fn start(&mut self) -> Result<(), StoreError> {
        let region = self.build.layout.records;
        self.records = Records::unmounted(region);
        self.records = Records::mount(&mut self.flash, region)?;
        Ok(())
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

    fn needs_erase(&self, length: u32) -> bool {
        self.records.needs_erase(length)
    }

    fn begin(&mut self, record: Record, length: u32) -> Result<(), StoreError> {
        self.records.discard(&mut self.flash)?;
        self.prepare(length)?;
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
        // What is staged is forgotten whatever becomes of its place.
        let _ = self.records.discard(&mut self.flash);
    }

    fn erase(&mut self, record: Record) -> Result<(), StoreError> {
        if self.records.length(record as u8) == 0 {
            return Ok(());
        }
        RecordStore::begin(self, record, 0)?;
        RecordStore::commit(self)
    }
}
