//! The event log: entries of one size, one behind the other, until the oldest page is erased.
//!
//! In: a flash, its region, entries of `ENTRY` bytes. Out: the entries, newest first. An entry
//! whose writing was cut is passed over; those before it stay.
//!
//! Entries fill one page of a ring after the other, so all wear alike. Appending erases nothing:
//! [`Log::prepare`] makes the next page ready, which takes the oldest entries away, and does so
//! only when enough younger ones stay.
//!
//! # An entry in the flash
//!
//! | byte | content |
//! |---|---|
//! | 0, 1 | 4556h: an event; 434Ch: all before this is cleared |
//! | 2 to `ENTRY` + 1 | the entry |
//! | then 4 | CRC-32 of the page's sequence number and the bytes before, little-endian |
//!
//! Left out: what the entries mean, and their times.

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::Progress;
use crate::access::{AccessError, is_blank, program, read};
use crate::check_sum::Crc32;
use crate::layout::{PAGE, Region};

use super::pages::{HEAD, Pages};

/// "PLML" as a little-endian word: a page of the event log.
const MARK: u32 = u32::from_le_bytes(*b"PLML");

/// Marks an event, "VE".
const EVENT: [u8; 2] = *b"VE";

/// Marks a clearing, "LC".
const CLEARED: [u8; 2] = *b"LC";

/// Why an entry was not kept or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogError {
    /// The flash refused, or did not hold what was written to it.
    Access(AccessError),
    /// The page is full and the next one not ready: [`Log::prepare`] first.
    NeedsErase,
}

impl From<AccessError> for LogError {
    fn from(error: AccessError) -> Self {
        Self::Access(error)
    }
}

/// A place between entries; [`Log::before`] goes back from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cursor {
    sequence: u32,
    /// Entries of that page that lie before it.
    index: u32,
}

/// A log of entries of `ENTRY` bytes, an even number up to 256.
///
/// The flash is an argument of each call and has to be the same each time. 24 bytes.
#[derive(Clone, Debug)]
pub struct Log<const ENTRY: usize> {
    pages: Pages,
    /// The page that is written to, and how many places of it are used.
    end: Cursor,
    /// Whether there is such a page.
    open: bool,
    /// Whether the page after it is ready.
    next_ready: bool,
}

impl<const ENTRY: usize> Log<ENTRY> {
    /// Bytes of a place.
    const PLACE: u32 = ENTRY as u32 + 6;

    /// Entries that a page holds.
    pub const PER_PAGE: u32 = (PAGE - HEAD) / Self::PLACE;

    /// Finds the log in `region`. Nothing is written, whatever is there.
    ///
    /// A region of less than two pages keeps no events: it is never read or written, and appending
    /// answers [`LogError::NeedsErase`]. Errors: [`LogError::Access`].
    pub fn mount<F: ReadNorFlash>(flash: &mut F, region: Region) -> Result<Self, LogError> {
        const { assert!(ENTRY.is_multiple_of(2) && ENTRY > 0 && ENTRY <= 256) };
        let pages = Pages::new(region, MARK);
        let mut log = Self {
            pages,
            end: Cursor {
                sequence: pages.count() - 1,
                index: Self::PER_PAGE,
            },
            open: false,
            next_ready: false,
        };
        if pages.count() < 2 {
            return Ok(log);
        }
        let Some(newest) = pages.newest(flash)? else {
            return Ok(log);
        };
        let before = newest.saturating_sub(1);
        // A page that was made ready ahead is newer than the one in use.
        let in_use = pages.is_blank(flash, newest, HEAD)? && pages.has(flash, before)?;
        log.end.sequence = if in_use { before } else { newest };
        log.end.index = log.used(flash)?;
        log.open = true;
        log.next_ready = in_use;
        Ok(log)
    }

    /// Places of the end's page up to the last that isn't blank.
    fn used<F: ReadNorFlash>(&self, flash: &mut F) -> Result<u32, AccessError> {
        let mut used = Self::PER_PAGE;
        while let Some(index) = used.checked_sub(1) {
            let at = self.offset(Cursor { index, ..self.end });
            if !is_blank(flash, at, Self::PLACE)? {
                break;
            }
            used = index;
        }
        Ok(used)
    }

    /// Offset in the flash of the place behind `cursor`.
    fn offset(&self, cursor: Cursor) -> u32 {
        let page = self.pages.offset(cursor.sequence) + HEAD;
        page + cursor.index * Self::PLACE
    }

    fn check_sum(sequence: u32, mark: [u8; 2], entry: &[u8]) -> [u8; 4] {
        let mut crc = Crc32::new();
        crc.add(&sequence.to_le_bytes());
        crc.add(&mark);
        crc.add(entry);
        crc.value().to_le_bytes()
    }

    /// Entries that can be appended before [`Log::prepare`] has to make room.
    pub const fn free(&self) -> u32 {
        let here = Self::PER_PAGE.saturating_sub(self.end.index);
        match self.next_ready {
            true => here + Self::PER_PAGE,
            false => here,
        }
    }

    /// Whether [`Log::prepare`] could make room without losing the last `keep` entries.
    pub const fn needs_erase(&self, keep: u32) -> bool {
        let spare = self.pages.count().saturating_sub(2);
        let kept = self.end.index.saturating_add(spare * Self::PER_PAGE);
        let enough = !self.open || self.end.index >= Self::PER_PAGE || kept >= keep;
        self.pages.count() > 1 && !self.next_ready && enough
    }

    /// Makes the next page ready, if the last `keep` entries stay: one erase at most.
    ///
    /// A full page is followed by a new one whatever `keep` is; of two pages, `keep` is
    /// [`Log::PER_PAGE`] at most. The processor stands still while a page is erased, so call it
    /// outside of OPERATIONAL. Errors: [`LogError::Access`].
    pub fn prepare<F: NorFlash>(&mut self, flash: &mut F, keep: u32) -> Result<Progress, LogError> {
        if self.needs_erase(keep) {
            let next = self.end.sequence + 1;
            self.pages.renew(flash, next)?;
            self.next_ready = true;
        }
        Ok(Progress::Done)
    }

    /// Appends an entry; it is there whole or not at all.
    ///
    /// Errors: [`LogError::NeedsErase`], [`LogError::Access`].
    pub fn append<F: NorFlash>(
        &mut self,
        flash: &mut F,
        entry: &[u8; ENTRY],
    ) -> Result<(), LogError> {
        self.put(flash, EVENT, entry)
    }

    /// Clears the log: what was appended before is not read any more.
    ///
    /// This appends a mark, so it takes the place of an entry. Errors: those of [`Log::append`].
    pub fn clear<F: NorFlash>(&mut self, flash: &mut F) -> Result<(), LogError> {
        self.put(flash, CLEARED, &[0; ENTRY])
    }

    fn put<F: NorFlash>(
        &mut self,
        flash: &mut F,
        mark: [u8; 2],
        entry: &[u8; ENTRY],
    ) -> Result<(), LogError> {
        if self.end.index >= Self::PER_PAGE {
            if !self.next_ready {
                return Err(LogError::NeedsErase);
            }
            self.next_ready = false;
            self.open = true;
            self.end = Cursor {
                sequence: self.end.sequence + 1,
                index: 0,
            };
        }
        let at = self.offset(self.end);
        // Whatever comes of it, this place has been used.
        self.end.index += 1;
        let crc = Self::check_sum(self.end.sequence, mark, entry);
        program(flash, at, &mark)?;
        program(flash, at + 2, entry)?;
        program(flash, at + Self::PLACE - 4, &crc)?;
        Ok(())
    }

    /// The end of the log, from which [`Log::before`] goes back.
    pub const fn end(&self) -> Cursor {
        self.end
    }

    /// The newest entry before `cursor`, which then is before that entry.
    ///
    /// `None` where nothing older is left. Errors: [`LogError::Access`].
    pub fn before<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        cursor: &mut Cursor,
    ) -> Result<Option<[u8; ENTRY]>, LogError> {
        // Each round goes back by a place or a page, so this ends with the oldest page.
        while self.step_back(flash, cursor)? {
            let at = self.offset(*cursor);
            let (mut mark, mut entry, mut crc) = ([0; 2], [0; ENTRY], [0; 4]);
            read(flash, at, &mut mark)?;
            read(flash, at + 2, &mut entry)?;
            read(flash, at + Self::PLACE - 4, &mut crc)?;
            let whole = crc == Self::check_sum(cursor.sequence, mark, &entry);
            match mark {
                EVENT if whole => return Ok(Some(entry)),
                CLEARED if whole => {
                    // Nothing before it is read, by this cursor either.
                    cursor.sequence = 0;
                    cursor.index = 0;
                    return Ok(None);
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// Moves `cursor` back by one place, into the page before if need be.
    fn step_back<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        cursor: &mut Cursor,
    ) -> Result<bool, AccessError> {
        if let Some(index) = cursor.index.checked_sub(1) {
            cursor.index = index;
            return Ok(self.open);
        }
        let Some(sequence) = cursor.sequence.checked_sub(1) else {
            return Ok(false);
        };
        if !self.open || !self.pages.has(flash, sequence)? {
            return Ok(false);
        }
        *cursor = Cursor {
            sequence,
            index: Self::PER_PAGE - 1,
        };
        Ok(true)
    }
}

#[cfg(test)]
mod tests;
