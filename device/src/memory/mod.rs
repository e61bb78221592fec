//! The device's memory: records and programs in one flash.
//!
//! In: a flash as [`NorFlash`], which begins with the bootloader, and its map. Out: [`RecordStore`]
//! over the records' ring, [`EventStore`] over the log's pages and
//! [`ProgramMemory`](crate::program::ProgramMemory) over the slot that does not run (`update`).
//! A part that keeps nothing but records has a [`RecordMemory`](records_only::RecordMemory), over
//! two banks.
//!
//! Room for a record is made when its storing begins: each page that has to be erased for it makes
//! the processor stand still for 40 ms at most (STM32F103x8/xB data sheet, 5.3.9), and all of them
//! together for 12 pages' time. Most stores need none, since [`EventStore::make_room`] makes room
//! ahead, a page at a time. Who must not stand still asks [`RecordStore::needs_erase`] first.
//!
//! Left out: the flash controller.

pub mod ed25519;
pub mod records_only;
mod ring;
pub mod update;

use embedded_storage::nor_flash::NorFlash;
use flash::access::AccessError;
use flash::layout::{Layout, Slot};
use flash::records::RecordError;
use flash::records::log::{Log, LogError};

use crate::black_box::BOX_LENGTH;
use crate::fault_log::{ENTRIES, ENTRY};
use crate::records::{EventStore, Record, RecordStore, StoreError};
use ring::RingMemory;
use update::{Anybody, Place};

/// Kinds of records: those of [`Record`].
const KINDS: usize = Record::COUNT;

/// What whoever built the program says of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Build {
    /// The map of the part.
    pub layout: &'static Layout,
    /// The slot that it runs in.
    pub running: Slot,
    /// The hardware that it runs on, as images name it.
    pub hardware: u32,
}

/// Records and programs in the flash `F`; `V` checks new programs.
#[derive(Clone, Debug)]
pub struct FlashMemory<F, V = Anybody> {
    kept: RingMemory<F>,
    /// The events; `None` until they are looked for, and where they cannot be read.
    events: Option<Log<ENTRY>>,
    verification: V,
    place: Option<Place>,
}

impl From<RecordError> for StoreError {
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn from(error: RecordError) -> Self {
        match error {
            RecordError::NeedsErase | RecordError::Full => Self::Full,
            RecordError::NotBegun => Self::NotBegun,
            // The others are bits that went bad, in the flash or in here.
            RecordError::Access(_)
            | RecordError::Kind(_)
            | RecordError::Staged
            | RecordError::Damaged(_) => Self::Hardware,
        }
    }
}

impl From<AccessError> for StoreError {
    fn from(_: AccessError) -> Self {
        Self::Hardware
    }
}

impl<F: NorFlash, V> FlashMemory<F, V> {
    /// A memory in which nothing was looked for ([`RecordStore::start`]).
    pub fn new(flash: F, build: Build, verification: V) -> Self {
        Self {
            kept: RingMemory::new(flash, build),
            events: None,
            verification,
            place: None,
        }
    }

    /// The flash.
    pub const fn flash(&self) -> &F {
        &self.kept.flash
    }

    /// The flash, for whoever breaks it or looks after it.
    pub const fn flash_mut(&mut self) -> &mut F {
        &mut self.kept.flash
    }

    /// What the program was told of itself.
    pub const fn build(&self) -> Build {
        self.kept.build
    }

    /// Another program was chosen at the last start.
    pub const fn set_running(&mut self, slot: Slot) {
        self.kept.build.running = slot;
    }
}

impl From<LogError> for StoreError {
    fn from(error: LogError) -> Self {
        match error {
            LogError::NeedsErase => Self::Full,
            LogError::Access(_) => Self::Hardware,
        }
    }
}

impl<F: NorFlash, V> EventStore for FlashMemory<F, V> {
    fn recall_events(&mut self, each: &mut dyn FnMut(&[u8; ENTRY])) {
        let Some(log) = &self.events else {
            return;
        };
        let mut cursor = log.end();
        while let Ok(Some(event)) = log.before(&mut self.kept.flash, &mut cursor) {
            each(&event);
        }
    }

    fn keep_event(&mut self, event: &[u8; ENTRY]) -> Result<(), StoreError> {
        let log = self.events.as_mut().ok_or(StoreError::Hardware)?;
        Ok(log.append(&mut self.kept.flash, event)?)
    }

    fn clear_events(&mut self) -> Result<(), StoreError> {
        let log = self.events.as_mut().ok_or(StoreError::Hardware)?;
        Ok(log.clear(&mut self.kept.flash)?)
    }

    fn needs_room(&self) -> bool {
        let log = self.events.as_ref();
        log.is_some_and(|log| log.needs_erase(ENTRIES as u32)) || self.kept.needs_erase(BOX_LENGTH)
    }

    fn make_room(&mut self) -> Result<(), StoreError> {
        let keep = ENTRIES as u32;
        match &mut self.events {
            Some(log) if log.needs_erase(keep) => {
                log.prepare(&mut self.kept.flash, keep).map(drop)?
            }
            _ => self.kept.prepare_step(BOX_LENGTH).map(drop)?,
        }
        Ok(())
    }
}

impl<F: NorFlash, V> RecordStore for FlashMemory<F, V> {
    fn start(&mut self) -> Result<(), StoreError> {
        self.place = None;
        let log = self.kept.build.layout.log;
        self.events = Log::mount(&mut self.kept.flash, log).ok();
        self.kept.start()
    }

    fn read(&mut self, record: Record, offset: u32, into: &mut [u8]) -> usize {
        self.kept.read(record, offset, into)
    }

    fn damaged(&self) -> u32 {
        self.kept.damaged()
    }

    fn needs_erase(&self, length: u32) -> bool {
        self.kept.needs_erase(length)
    }

    fn begin(&mut self, record: Record, length: u32) -> Result<(), StoreError> {
        RecordStore::begin(&mut self.kept, record, length)
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        RecordStore::append(&mut self.kept, bytes)
    }

    fn staged(&mut self, offset: u32, into: &mut [u8]) -> usize {
        self.kept.staged(offset, into)
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        RecordStore::commit(&mut self.kept)
    }

    fn discard(&mut self) {
        RecordStore::discard(&mut self.kept);
    }

    fn erase(&mut self, record: Record) -> Result<(), StoreError> {
        RecordStore::erase(&mut self.kept, record)
    }
}
