//! The record store: what outlives a reset, whole or not at all.
//!
//! In: bytes, staged under the name of a record and then committed. Out: the bytes of the last
//! record that was committed whole: a loss of supply at any moment leaves either the old content
//! or the new (R8). [`memory`](crate::memory) keeps them in the chip's flash.
//!
//! Left out: the flash behind it, and what the bytes of a calibration mean.

pub mod parameters;

use crate::black_box::BOX_LENGTH;
use crate::calibration::encoding::MAX_LENGTH;
use crate::calibration::report::LENGTH as REPORT_LENGTH;
use crate::fault_log::ENTRY;

/// What is kept, each on its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Record {
    /// Objects 1000h to 1FFFh (1010h and 1011h, sub-index 2).
    Communication,
    /// Objects 6000h to 9FFFh (sub-index 3).
    Profile,
    /// Objects 2000h to 5FFFh (sub-index 4).
    Manufacturer,
    /// Node-id and bit rate by LSS.
    Lss,
    /// The sensor's calibration.
    Calibration,
    /// The calibration that the part was delivered with; written in the factory, and never by
    /// the device.
    Delivered,
    /// The first box of the black box; written by the device when it is full.
    Box1,
    /// The second one.
    Box2,
    /// The hash of the calibration report, with the check sum of the calibration it belongs to.
    Report,
}

impl Record {
    /// How many records there are.
    pub const COUNT: usize = 9;

    /// Every record that holds what somebody has set.
    pub const ALL: [Self; 6] = [
        Self::Communication,
        Self::Profile,
        Self::Manufacturer,
        Self::Lss,
        Self::Calibration,
        Self::Report,
    ];

    /// That of the black box's box `number`, from 1.
    pub const fn of_box(number: u8) -> Self {
        match number {
            1 => Self::Box1,
            _ => Self::Box2,
        }
    }

    /// Bytes that it takes at most.
    pub const fn longest(self) -> u32 {
        match self {
            Self::Communication => 1536,
            Self::Profile | Self::Manufacturer => 256,
            Self::Lss => 32,
            Self::Calibration | Self::Delivered => MAX_LENGTH,
            Self::Box1 | Self::Box2 => BOX_LENGTH,
            Self::Report => REPORT_LENGTH,
        }
    }
}

/// Why a record was not stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError {
    /// The memory did not erase, or does not hold what was written to it.
    Hardware,
    /// The record is longer than the room kept for it.
    Full,
    /// [`RecordStore::append`] or [`RecordStore::commit`] without [`RecordStore::begin`].
    NotBegun,
}

/// Where records live.
///
/// One record is staged at a time. Offsets beyond the end read as the end.
pub trait RecordStore {
    /// Finds what is kept, as every start of the device has to. Nothing is written.
    ///
    /// Errors: [`StoreError::Hardware`]; nothing is found then.
    fn start(&mut self) -> Result<(), StoreError>;

    /// Reads the committed `record` from `offset` into `into`.
    ///
    /// Returns how many bytes came: fewer than asked only at the end, and 0 when there is no such
    /// record or none that is whole.
    fn read(&mut self, record: Record, offset: u32, into: &mut [u8]) -> usize;

    /// The records whose last version was whole once and was not when [`RecordStore::start`]
    /// looked, bit n for the record with number n. An older version is read of them, or none.
    fn damaged(&self) -> u32 {
        0
    }

    /// Whether [`RecordStore::begin`] would have to erase first, which makes the processor stand
    /// still: not to be done in OPERATIONAL.
    fn needs_erase(&self, length: u32) -> bool;

    /// Starts a new version of `record`, of `length` bytes at most; what was staged before is
    /// discarded.
    ///
    /// The committed version stays valid until [`RecordStore::commit`]. Errors:
    /// [`StoreError::Hardware`], [`StoreError::Full`].
    fn begin(&mut self, record: Record, length: u32) -> Result<(), StoreError>;

    /// Adds `bytes` to what is staged.
    ///
    /// Errors: any of [`StoreError`]; the staged version is then worth nothing.
    fn append(&mut self, bytes: &[u8]) -> Result<(), StoreError>;

    /// Reads back what is staged, as [`RecordStore::read`] does; 0 when nothing is.
    fn staged(&mut self, offset: u32, into: &mut [u8]) -> usize;

    /// Makes the staged version the valid one, whole or not at all.
    ///
    /// Errors: [`StoreError::Hardware`], [`StoreError::NotBegun`]; the old version then stays.
    fn commit(&mut self) -> Result<(), StoreError>;

    /// Forgets what is staged.
    fn discard(&mut self);

    /// Removes the committed `record`: defaults hold after the next start.
    ///
    /// Errors: [`StoreError::Hardware`], [`StoreError::Full`].
    fn erase(&mut self, record: Record) -> Result<(), StoreError>;
}

/// Where events are kept as they happen, each whole or not at all, until newer ones take their
/// place.
pub trait EventStore {
    /// Hands out the events that are kept, newest first.
    fn recall_events(&mut self, each: &mut dyn FnMut(&[u8; ENTRY]));

    /// Keeps one more. About 1 ms on the chip.
    ///
    /// Errors: [`StoreError::Full`]: not before [`EventStore::make_room`];
    /// [`StoreError::Hardware`].
    fn keep_event(&mut self, event: &[u8; ENTRY]) -> Result<(), StoreError>;

    /// Forgets every event. Errors: those of [`EventStore::keep_event`].
    fn clear_events(&mut self) -> Result<(), StoreError>;

    /// Whether [`EventStore::make_room`] has something to do.
    fn needs_room(&self) -> bool;

    /// The next step of making room ahead for events and for a box, which erases a page at most:
    /// not in OPERATIONAL.
    ///
    /// The last 16 events stay. Errors: [`StoreError::Hardware`], [`StoreError::Full`].
    fn make_room(&mut self) -> Result<(), StoreError>;
}

#[cfg(test)]
pub(crate) mod tests;
