//! Records: values of which the last whole version outlives everything.
//!
//! In: a flash, its region, a kind (0 to `KINDS` - 1) and bytes, staged and then committed. Out:
//! the bytes of the version that was committed last. After a loss of supply in the middle of any
//! operation that is the old version or the new one, never a third (R8). [`log`] is the other
//! half: events, one behind the other.
//!
//! # How it is kept
//! All kinds share a ring of pages (`pages`), so a parameter that is stored daily wears the page
//! of a calibration no more than its own. A record lies in the ring in one stretch, one `chunk`
//! in each page that it touches, and counts from the moment when the header of its last chunk is
//! whole. At the other end of the ring the oldest page is freed: records in it that still count
//! are stored anew first, as any record is stored.
//!
//! Storing erases nothing. [`Records::prepare`] makes room ahead, in steps of one erase or one
//! record that is stored anew; [`Records::needs_erase`] returns whether it has to. Enough pages
//! stay in reserve for it, so a store that is admitted is never stuck later.
//!
//! A cut costs the room of what was cut; `prepare` gets it back. A step programs the longest
//! record at most: 3.1 kB take 0.11 s at 70 us for each half-word. An erase takes 40 ms at most
//! (STM32F103xC/xD/xE data sheet, 5.3.9), and twice that where a [`PAGE`] is two of the chip's.
//!
//! One page of the ring and the length of the longest record are always kept back, so a ring of
//! two pages takes nothing; [`layout`](crate::layout) lists what each part has room for.
//!
//! Where a bit of the last version has gone bad, [`Records::mount`] takes the version before if
//! that is still there, and reports it ([`Records::damaged`]); what lies behind it in its page is
//! found all the same.
//!
//! Chunks of an unknown kind, which a later program wrote, are passed over and lost when their page
//! is freed.
//!
//! Left out: what the bytes mean, and when to store.

pub(crate) mod chunk;
pub mod log;
pub(crate) mod pages;
mod ring;
mod staging;

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::access::{AccessError, read};
use crate::layout::{PAGE, Region};

use chunk::{CHUNK_HEAD, LONGEST, room};
use pages::{HEAD, Pages};
use staging::Staging;

/// "PLMR" as a little-endian word: a page of records.
const MARK: u32 = u32::from_le_bytes(*b"PLMR");

/// Why a record was not read or stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordError {
    /// The flash refused, or did not hold what was written to it.
    Access(AccessError),
    /// There is no such kind.
    Kind(u8),
    /// The pages that are ready are used up: [`Records::prepare`] first.
    NeedsErase,
    /// The records do not fit into the region.
    Full,
    /// Nothing is staged.
    NotBegun,
    /// A record is staged: commit or discard it first.
    Staged,
    /// This kind has lost a bit since it was mounted; what is left of it counts from now on.
    Damaged(u8),
}

impl From<AccessError> for RecordError {
    fn from(error: AccessError) -> Self {
        Self::Access(error)
    }
}

/// Where the valid version of a record lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Entry {
    /// Page of its first chunk.
    sequence: u32,
    /// Offset in that page of the first chunk's header.
    at: u32,
    /// Bytes of the record.
    length: u32,
    /// Its version; 0: there is none.
    version: u32,
}

impl Entry {
    /// There is none.
    const NONE: Self = Self {
        sequence: 0,
        at: 0,
        length: 0,
        version: 0,
    };

    /// Page and offset in it of the byte at `offset`, and how many bytes follow in that page.
    fn place(&self, offset: u32) -> (u32, u32, u32) {
        let first = room(self.at);
        let Some(behind) = offset.checked_sub(first) else {
            let at = self.at + CHUNK_HEAD + offset;
            return (self.sequence, at, first.saturating_sub(offset));
        };
        let at = behind % LONGEST;
        let page = self.sequence + 1 + behind / LONGEST;
        (page, HEAD + CHUNK_HEAD + at, LONGEST - at)
    }

    /// The last page that it has a chunk in.
    fn last_page(&self) -> u32 {
        self.place(self.length.saturating_sub(1)).0
    }
}

/// A store of `KINDS` kinds of records; 32 at most.
///
/// The flash is an argument of each call and has to be the same each time.
#[derive(Clone, Debug)]
pub struct Records<const KINDS: usize> {
    pages: Pages,
    index: [Entry; KINDS],
    /// The oldest page in use.
    tail: u32,
    /// The page that is written to; one below the tail when none is in use.
    head: u32,
    /// Behind the last page that is ready: those above `head` and below this are blank.
    ready: u32,
    /// Offset in the head page behind what was written; [`PAGE`] when nothing more goes there.
    at: u32,
    /// Offset in the head page of a chunk that was cut and has no gap chunk behind it.
    cut_at: Option<u32>,
    /// Pages made ready since a record was stored last.
    renewed: u32,
    /// The highest version.
    version: u32,
    /// What is staged, if something is.
    staging: Staging,
    is_staged: bool,
    torn: u32,
    /// Bit n: the last version of kind n was not whole at the mount.
    damaged: u32,
}

impl<const KINDS: usize> Records<KINDS> {
    /// Finds the records in `region`. Nothing is written, whatever is there.
    ///
    /// Reads what is in use once: some 42 instructions for each byte. Errors:
    /// [`RecordError::Access`].
    pub fn mount<F: ReadNorFlash>(flash: &mut F, region: Region) -> Result<Self, RecordError> {
        let mut records = Self::unmounted(region);
        records.scan(flash)?;
        Ok(records)
    }

    /// Before the records in `region` were looked for: it has none, and no page is ready.
    pub fn unmounted(region: Region) -> Self {
        const { assert!(KINDS <= u32::BITS as usize) };
        let pages = Pages::new(region, MARK);
        let count = pages.count();
        Self {
            pages,
            index: [Entry::NONE; KINDS],
            tail: count,
            head: count - 1,
            ready: count,
            at: PAGE,
            cut_at: None,
            renewed: 0,
            version: 0,
            staging: Staging::NONE,
            is_staged: false,
            torn: 0,
            damaged: 0,
        }
    }

    /// Bytes of the valid version of `kind`; 0 when there is none.
    pub fn length(&self, kind: u8) -> u32 {
        self.entry(kind).map_or(0, |entry| entry.length)
    }

    /// Reads the valid version of `kind` from `offset` into `into`.
    ///
    /// Returns how many bytes came: fewer than asked only at the end, and 0 when there is no such
    /// record. Errors: [`RecordError::Access`], [`RecordError::Kind`].
    pub fn read<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        kind: u8,
        offset: u32,
        into: &mut [u8],
    ) -> Result<usize, RecordError> {
        let entry = self.entry(kind).ok_or(RecordError::Kind(kind))?;
        self.copy(flash, entry, offset, into)
    }

    /// Whether the valid version of `kind` still is what was stored; `true` when there is none.
    ///
    /// Reads all of it. Errors: [`RecordError::Access`], [`RecordError::Kind`].
    pub fn check<F: ReadNorFlash>(&self, flash: &mut F, kind: u8) -> Result<bool, RecordError> {
        let entry = self.entry(kind).ok_or(RecordError::Kind(kind))?;
        if entry.version == 0 {
            return Ok(true);
        }
        self.holds(flash, kind, entry)
    }

    /// How many chunks were found at the mount that were not whole.
    ///
    /// Each cut while storing leaves one at most; so does a bit that goes bad.
    pub const fn torn(&self) -> u32 {
        self.torn
    }

    /// The kinds whose last version was stored whole and was not whole any more when it was looked
    /// for, bit n for kind n. What is left of such a kind is older, or nothing. One that is stored
    /// anew counts no more.
    pub const fn damaged(&self) -> u32 {
        self.damaged
    }

    /// How often each page has been erased by this store, about: the wear that is used up.
    pub fn rounds(&self) -> u32 {
        self.ready.checked_div(self.pages.count()).unwrap_or(0)
    }

    /// Whether a record of `length` bytes needs [`Records::prepare`] before it can be stored.
    pub fn needs_erase(&self, length: u32) -> bool {
        self.space() < length.saturating_add(self.reserve(length))
    }

    /// Makes room for a record of `length` bytes, one step for each call.
    ///
    /// A step erases one page or stores one record anew. Call it until it returns
    /// [`Progress::Done`](crate::Progress::Done), outside of OPERATIONAL, since the processor
    /// stands still while a page is erased. Errors: [`RecordError::Staged`], [`RecordError::Full`],
    /// [`RecordError::Damaged`] (once; then call again), [`RecordError::Access`].
    pub fn prepare<F: NorFlash>(
        &mut self,
        flash: &mut F,
        length: u32,
    ) -> Result<crate::Progress, RecordError> {
        if self.is_staged {
            return Err(RecordError::Staged);
        }
        if !self.needs_erase(length) {
            return Ok(crate::Progress::Done);
        }
        // The second is for a flash that loses as much as it gains, so that it is not worn out.
        if !self.fits(length) || self.renewed > 3 * self.pages.count() {
            return Err(RecordError::Full);
        }
        self.free_step(flash)?;
        Ok(if self.needs_erase(length) {
            crate::Progress::More
        } else {
            crate::Progress::Done
        })
    }

    /// Bytes of payload that can be stored without an erase, the reserve included.
    fn space(&self) -> u32 {
        let here = if ring::has_room(self.at) {
            room(self.at)
        } else {
            0
        };
        self.blank_pages() * LONGEST + here
    }

    fn entry(&self, kind: u8) -> Option<&Entry> {
        self.index.get(usize::from(kind))
    }

    fn copy<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        entry: &Entry,
        offset: u32,
        into: &mut [u8],
    ) -> Result<usize, RecordError> {
        let wanted = entry.length.saturating_sub(offset) as usize;
        let wanted = wanted.min(into.len());
        let mut rest = into.get_mut(..wanted).unwrap_or_default();
        let mut offset = offset;
        while !rest.is_empty() {
            let (page, at, follow) = entry.place(offset);
            let size = rest.len().min(follow as usize);
            let (now, later) = rest.split_at_mut_checked(size).unwrap_or_default();
            read(flash, self.pages.offset(page) + at, now)?;
            offset += size as u32;
            rest = later;
        }
        Ok(wanted)
    }
}

#[cfg(test)]
mod tests;
