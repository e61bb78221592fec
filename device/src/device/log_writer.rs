//! What has happened goes into the memory: events one by one, boxes piece by piece.
//!
//! In: the fault log and the black box. Out: the same in the memory, from where a start takes them
//! back, since a reset empties the chip's RAM. Writing goes on beside measuring, a millisecond at
//! a time, and never erases in OPERATIONAL: room is made ahead, outside of it, a page at a time
//! with a pause behind each. What finds no room waits in the RAM, the latest box alone.
//!
//! A contact that is loose for weeks must not wear the flash out: after [`ALLOWANCE`] events at
//! once there is one more each [`PAUSE_US`]; others stay in the RAM, where the newest are. At that
//! rate the log's two pages of 78 entries last 11 years (10 000 erases, STM32F103 data sheet).
//!
//! Left out: what is an event, and the formats.

use canopen::nmt::State;
use instant::Instant;

use super::trial::PAUSE_US as PAGE_PAUSE_US;
use super::{Device, Memory};
use crate::black_box::BOXES;
use crate::fault_log::Entry;
use crate::instrument::Instrument;
use crate::records::{Record, RecordStore, StoreError};
use crate::sensor::Part;

/// Events that may be written at once.
const ALLOWANCE: u8 = 16;

/// Time after which one more may be written, us.
const PAUSE_US: i64 = 225_000_000;

/// A box wears the flash as much as so many events.
const BOX_COST: u8 = 4;

/// Bytes of a box that are written at a time: about 1 ms on the chip.
const PIECE: usize = 32;

/// Time between two pieces of a box, us: all of it is in the memory a quarter of a second after it
/// is full.
pub(super) const PIECE_US: i64 = 5_000;

/// Pieces in all that a reset waits for, and some events.
const MOST_STEPS: u16 = 256;

/// State of the writing.
#[derive(Clone, Copy, Debug)]
pub(super) struct LogWriter {
    allowance: u8,
    next_allowance: Instant,
    /// Where in the box that is on its way into the memory the next piece begins.
    copying: Option<u32>,
    /// Room could not be made, which another try would only wear the flash for.
    cramped: bool,
}

impl LogWriter {
    pub(super) const fn new() -> Self {
        Self {
            allowance: ALLOWANCE,
            next_allowance: Instant(0),
            copying: None,
            cramped: false,
        }
    }

    /// A box is on its way into the memory.
    pub(super) const fn is_copying(&self) -> bool {
        self.copying.is_some()
    }

    fn refill(&mut self, now: Instant) {
        if self.allowance >= ALLOWANCE {
            self.next_allowance = now.offset(PAUSE_US);
        } else if self.next_allowance <= now {
            self.allowance += 1;
            self.next_allowance = now.offset(PAUSE_US);
        }
    }
}

impl<P: Part, M: Memory, I: Instrument> Device<P, M, I> {
    /// Takes events and boxes back from the memory, as every start does.
    pub(super) fn recall_events(&mut self) {
        self.log_writer = LogWriter::new();
        if !I::HISTORY {
            return;
        }
        self.parts.log.clear();
        self.parts.black_box.clear();
        let log = &mut self.parts.log;
        self.parts
            .memory
            .recall_events(&mut |event| log.restore(Entry::decode(event)));
        for number in 1..=BOXES as u8 {
            let memory = &mut self.parts.memory;
            self.parts.black_box.restore(number, &mut |offset, into| {
                memory.read(Record::of_box(number), offset, into)
            });
        }
    }

    /// Writes the next piece of what is not in the memory yet; true when there was something.
    pub(super) fn keep(&mut self, now: Instant) -> bool {
        if I::HISTORY {
            self.log_writer.refill(now);
        }
        if self.parts.values.receiving {
            // A calibration is staged, and there is one place for that: the box begins anew.
            self.log_writer.copying = None;
            return false;
        }
        let may_erase = self.parts.values.state != State::Operational && !self.log_writer.cramped;
        let may_erase = may_erase && now >= self.next_erase && self.log_writer.copying.is_none();
        if may_erase && self.parts.memory.needs_room() {
            self.next_erase = now.offset(PAGE_PAUSE_US);
            // Nobody stages anything now: a box was left when another event took its place.
            RecordStore::discard(&mut self.parts.memory);
            let made = self.parts.memory.make_room();
            self.parts.values.storage_failed |= made == Err(StoreError::Hardware);
            self.log_writer.cramped = made.is_err();
            return made.is_ok();
        }
        I::HISTORY && (self.keep_event() || self.keep_box(now))
    }

    /// Writes all of it, because the RAM is about to be emptied.
    pub(super) fn keep_all(&mut self, now: Instant) {
        for _ in 0..MOST_STEPS {
            // Nobody is to be heard between two pages any more.
            self.next_erase = now;
            if !self.keep(now) {
                return;
            }
        }
    }

    fn keep_event(&mut self) -> bool {
        let Some(entry) = self.parts.log.next_unsaved() else {
            return false;
        };
        if self.log_writer.allowance == 0 {
            return false;
        }
        let kept = self.parts.memory.keep_event(&entry.encode());
        if kept == Err(StoreError::Full) {
            return false;
        }
        self.log_writer.allowance -= 1;
        self.parts.log.saved();
        self.parts.values.storage_failed |= kept.is_err();
        true
    }

    fn keep_box(&mut self, now: Instant) -> bool {
        let Some(offset) = self.log_writer.copying.or_else(|| self.begin_box(now)) else {
            return false;
        };
        self.log_writer.copying = None;
        let mut piece = [0; PIECE];
        let copied = self.parts.black_box.save_at(offset, &mut piece);
        // Another event has taken the box, or another record the place where one is staged.
        let Some(bytes) = copied.and_then(|count| piece.get(..count)) else {
            return true;
        };
        if RecordStore::append(&mut self.parts.memory, bytes).is_err() {
            return true;
        }
        if bytes.len() == PIECE {
            self.log_writer.copying = Some(offset.saturating_add(PIECE as u32));
            return true;
        }
        let kept = RecordStore::commit(&mut self.parts.memory);
        self.parts.values.storage_failed |= kept.is_err();
        self.parts.black_box.saved(kept.is_ok());
        true
    }

    /// Begins to write a box; the offset of its first piece.
    fn begin_box(&mut self, now: Instant) -> Option<u32> {
        let number = self.parts.black_box.next_unsaved(now)?;
        let allowance = match number {
            // It is written once until somebody clears it, and the next event waits for it.
            1 => self.log_writer.allowance.saturating_sub(BOX_COST),
            _ => self.log_writer.allowance.checked_sub(BOX_COST)?,
        };
        let record = Record::of_box(number);
        let length = record.longest();
        // Room is made page by page, or later, unless there is none to be had.
        let may_erase = self.parts.values.state != State::Operational && self.log_writer.cramped;
        if !may_erase && self.parts.memory.needs_erase(length) {
            return None;
        }
        self.log_writer.allowance = allowance;
        if RecordStore::begin(&mut self.parts.memory, record, length).is_err() {
            self.parts.values.storage_failed = true;
            self.parts.black_box.saved(false);
            return None;
        }
        Some(0)
    }
}
