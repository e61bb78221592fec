//! The ring of records: finding them at a start, and freeing pages at its end.
//!
//! In: the flash. Out: the state of a [`Records`], and pages that are ready.
//!
//! Left out: storing ([`staging`](super::staging)).

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::access::{AccessError, read};
use crate::layout::PAGE;

use super::chunk::{CHUNK_HEAD, Chunk, GAP, LONGEST, Look, VOID, room};
use super::pages::HEAD;
use super::{Entry, RecordError, Records};

/// Payload for which the rest of a page is worth a chunk.
const WORTH: u32 = 8;

/// Bytes that one page of a record takes more than its payload, at most: header, unused rest.
const OVERHEAD: u32 = CHUNK_HEAD + WORTH;

/// Bytes copied at a time when a record is stored anew.
const PIECE: usize = 32;

/// Whether a chunk may begin at offset `at` of a page.
pub(super) const fn has_room(at: u32) -> bool {
    room(at) >= WORTH
}

/// A record whose last chunk has not been met, and its kind.
pub(super) type Open = Option<(u8, Entry)>;

impl<const KINDS: usize> Records<KINDS> {
    /// Goes through all pages in their order.
    pub(super) fn scan<F: ReadNorFlash>(&mut self, flash: &mut F) -> Result<(), AccessError> {
        let Some(newest) = self.pages.newest(flash)? else {
            return Ok(());
        };
        let end = newest + 1;
        self.damaged = 0;
        let mut open = None;
        let mut met = false;
        for sequence in end.saturating_sub(self.pages.count())..end {
            if !self.pages.has(flash, sequence)? {
                open = None;
                continue;
            }
            if !met {
                (self.tail, self.head) = (sequence, sequence.saturating_sub(1));
                met = true;
            }
            if !self.pages.is_blank(flash, sequence, HEAD)? {
                self.head = sequence;
                self.cut_at = None;
                self.at = self.walk(flash, sequence, &mut open)?;
            }
        }
        self.ready = self.head + 1;
        while self.ready < end && self.pages.has(flash, self.ready)? {
            self.ready += 1;
        }
        Ok(())
    }

    /// Goes through the chunks of a page; the offset behind the last, or the page's end where
    /// what follows is neither a chunk nor blank.
    fn walk<F: ReadNorFlash>(
        &mut self,
        flash: &mut F,
        sequence: u32,
        open: &mut Open,
    ) -> Result<u32, AccessError> {
        let mut at = HEAD;
        while has_room(at) && !self.pages.is_blank(flash, sequence, at)? {
            let page = self.pages.offset(sequence);
            let look = Chunk::look(flash, page, at)?;
            let Look::Whole(chunk) = look else {
                self.torn += 1;
                *open = None;
                if let Some(end) = self.gap_end(flash, sequence, at)? {
                    at = end;
                    continue;
                }
                let Some(next) = self.behind_damage(flash, sequence, at, &look)? else {
                    self.cut_at = Some(at);
                    return Ok(PAGE);
                };
                let mut kind = [0];
                read(flash, page + at, &mut kind)?;
                self.damaged |= mask::<KINDS>(kind[0]);
                at = next;
                continue;
            };
            let here = Entry {
                sequence,
                at,
                length: 0,
                version: chunk.version,
            };
            self.join(open, &chunk, here);
            at = chunk.end(at);
        }
        Ok(at)
    }

    /// Where to go on behind the chunk at offset `at` of page `sequence`, if it was whole once.
    ///
    /// Nothing but a gap follows one that was cut, so another whole one behind it tells; and the
    /// last of all is followed by nothing.
    fn behind_damage<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        sequence: u32,
        at: u32,
        look: &Look,
    ) -> Result<Option<u32>, AccessError> {
        let page = self.pages.offset(sequence);
        let mut place = at + CHUNK_HEAD;
        while room(place) > 0 {
            if Chunk::read(flash, page, place)?.is_some() {
                return Ok(Some(place));
            }
            place += 2;
        }
        if let Look::Damaged(chunk) = look
            && self.pages.is_blank(flash, sequence, chunk.end(at))?
        {
            return Ok(Some(chunk.end(at)));
        }
        Ok(None)
    }

    /// The offset in page `sequence` behind the gap that begins at `at`, if it was closed.
    fn gap_end<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        sequence: u32,
        at: u32,
    ) -> Result<Option<u32>, AccessError> {
        let wanted = Chunk::gap(at);
        let mut place = at + 2;
        while room(place) > 0 {
            let mut bytes = [0; CHUNK_HEAD as usize];
            read(flash, self.pages.offset(sequence) + place, &mut bytes)?;
            if bytes == wanted {
                return Ok(Some(place + CHUNK_HEAD));
            }
            place += 2;
        }
        Ok(None)
    }

    /// Adds `chunk`, which is at `here`, to the record that is open.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub(super) fn join(&mut self, open: &mut Open, chunk: &Chunk, here: Entry) {
        self.version = self.version.max(chunk.version);
        let follows = |kind: u8, entry: &Entry| {
            chunk.kind == kind
                && chunk.version == entry.version
                && chunk.offset == entry.length
                && here.at == HEAD
        };
        let mut entry = match open.take() {
            _ if chunk.offset == 0 => here,
            Some((kind, entry)) if follows(kind, &entry) => entry,
            _ => return,
        };
        entry.length += chunk.length;
        if !chunk.last {
            *open = Some((chunk.kind, entry));
        } else if let Some(known) = self.index.get_mut(usize::from(chunk.kind))
            && known.version < entry.version
        {
            *known = entry;
            self.damaged &= !mask::<KINDS>(chunk.kind);
        }
    }

    /// Whether all chunks of `entry` are whole.
    pub(super) fn holds<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        kind: u8,
        entry: &Entry,
    ) -> Result<bool, RecordError> {
        let (mut sequence, mut at, mut seen) = (entry.sequence, entry.at, 0);
        loop {
            let chunk = Chunk::read(flash, self.pages.offset(sequence), at)?;
            let fits = |chunk: &Chunk| {
                let same = chunk.kind == kind && chunk.version == entry.version;
                same && chunk.offset == seen
            };
            let Some(chunk) = chunk.filter(fits) else {
                return Ok(false);
            };
            seen += chunk.length;
            if chunk.last {
                return Ok(seen == entry.length);
            }
            if chunk.length == 0 {
                return Ok(false);
            }
            (sequence, at) = (sequence + 1, HEAD);
        }
    }

    /// Pages that are ready and unused.
    pub(super) fn blank_pages(&self) -> u32 {
        self.ready.saturating_sub(self.head).saturating_sub(1)
    }

    /// Bytes that have to stay free once a record of `length` bytes is stored.
    ///
    /// Freeing the oldest page stores anew what begins in it: a page of small ones and one of the
    /// longest, before it gives a page back. The half page is for the rests that stay unused.
    pub(super) fn reserve(&self, length: u32) -> u32 {
        let lengths = self.index.iter().map(|entry| entry.length);
        lengths
            .fold(length, u32::max)
            .saturating_add(PAGE + PAGE / 2)
    }

    /// Whether one more record of `length` bytes has a place when all that is old is freed.
    pub(super) fn fits(&self, length: u32) -> bool {
        let valid = self.index.iter().filter(|entry| entry.version != 0);
        let valid = valid.map(|entry| size(entry.length));
        let bytes = valid.fold(size(length), u32::saturating_add);
        let needed = bytes.saturating_add(self.reserve(length));
        needed <= (self.pages.count() - 1) * (PAGE - HEAD)
    }

    /// Makes a page ready, or one record less stand in its way.
    pub(super) fn free_step<F: NorFlash>(&mut self, flash: &mut F) -> Result<(), RecordError> {
        // First, since behind a record that is stored next it would stay until the ring is round.
        if self.head_is_waste() {
            return self.take_back(flash);
        }
        let in_use = self.ready.saturating_sub(self.tail);
        if in_use >= self.pages.count() {
            // The longest first: what a cut of it leaves is pages of their own, easy to free.
            let mut longest = None;
            for (kind, entry) in (0..).zip(&self.index) {
                let waits = entry.version != 0 && entry.sequence == self.tail;
                if waits && longest.is_none_or(|(_, length)| length <= entry.length) {
                    longest = Some((kind, entry.length));
                }
            }
            if let Some((kind, _)) = longest {
                return self.store_anew(flash, kind);
            }
            self.tail += 1;
        }
        self.pages.renew(flash, self.ready)?;
        self.ready += 1;
        self.renewed += 1;
        Ok(())
    }

    /// Stores the valid version of `kind` once more, at the head.
    fn store_anew<F: NorFlash>(&mut self, flash: &mut F, kind: u8) -> Result<(), RecordError> {
        let Some(entry) = self.entry(kind).copied() else {
            return Err(RecordError::Kind(kind));
        };
        if !self.holds(flash, kind, &entry)? {
            return self.take_what_is_left(flash, kind);
        }
        self.close_gap(flash)?;
        if self.space() < entry.length.max(1) {
            return Err(RecordError::Full);
        }
        self.start(flash, kind, true)?;
        let mut piece = [0; PIECE];
        let mut offset = 0;
        while offset < entry.length {
            let count = self.copy(flash, &entry, offset, &mut piece)?;
            self.append(flash, piece.get(..count).unwrap_or(&[]))?;
            offset += count as u32;
        }
        self.commit(flash)
    }

    /// Whether the head page holds nothing but what was cut or discarded.
    fn head_is_waste(&self) -> bool {
        let before = |entry: &Entry| entry.version == 0 || entry.last_page() < self.head;
        self.head >= self.tail && self.index.iter().all(before)
    }

    /// Makes the head page ready anew, and goes on in the page before it.
    fn take_back<F: NorFlash>(&mut self, flash: &mut F) -> Result<(), RecordError> {
        let page = self.head;
        self.head = page.saturating_sub(1);
        self.at = PAGE;
        self.cut_at = None;
        self.renewed += 1;
        self.pages.renew(flash, page)?;
        if self.head >= self.tail && self.pages.has(flash, self.head)? {
            self.at = self.walk(flash, self.head, &mut None)?;
        }
        Ok(())
    }

    /// `kind` is no longer what was stored: finds what is left.
    fn take_what_is_left<F: NorFlash>(
        &mut self,
        flash: &mut F,
        kind: u8,
    ) -> Result<(), RecordError> {
        let lost = self.entry(kind).copied();
        self.index = [Entry::NONE; KINDS];
        self.scan(flash)?;
        // Cells that read differently each time could keep this going for ever.
        if self.entry(kind).copied() == lost
            && let Some(entry) = self.index.get_mut(usize::from(kind))
        {
            *entry = Entry::NONE;
        }
        Err(RecordError::Damaged(kind))
    }
}

/// The bit of a kind in [`Records::damaged`]; every bit for what is no kind, as a kind of which
/// bits have gone bad may have been any.
pub(super) const fn mask<const KINDS: usize>(kind: u8) -> u32 {
    match kind {
        VOID | GAP => 0,
        _ if (kind as usize) < KINDS => 1 << kind,
        _ => u32::MAX >> (u32::BITS - KINDS as u32),
    }
}

/// Bytes in the ring that a record of `length` bytes takes at most.
fn size(length: u32) -> u32 {
    let pages = length.div_ceil(LONGEST).saturating_add(1);
    length.saturating_add(pages.saturating_mul(OVERHEAD))
}
