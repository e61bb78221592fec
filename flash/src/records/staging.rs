//! Storing a record: bytes come in pieces, and nothing counts before the commit.
//!
//! In: a kind and bytes. Out: chunks in the pages that are ready.
//!
//! Left out: making pages ready ([`ring`](super::ring)).

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::access::{is_blank, program};
use crate::check_sum::Crc32;
use crate::layout::PAGE;

use super::chunk::{CHUNK_HEAD, Chunk, LONGEST, VOID, room};
use super::pages::HEAD;
use super::ring::{has_room, mask};
use super::{Entry, RecordError, Records};

/// A record that is being stored.
#[derive(Clone, Debug)]
pub(super) struct Staging {
    kind: u8,
    /// Where it began, and how many bytes have come.
    entry: Entry,
    /// Offset of the open chunk in the head page.
    at: u32,
    /// Bytes of the record before the open chunk.
    before: u32,
    crc: Crc32,
    /// A byte that waits for the other half of its half-word.
    odd: Option<u8>,
    /// Whether it may use the reserve.
    reserve: bool,
}

impl Staging {
    /// Bytes in the open chunk.
    const fn in_chunk(&self) -> u32 {
        self.entry.length.saturating_sub(self.before)
    }

    /// Offset in the page where the next half-word goes.
    fn next(&self) -> u32 {
        let written = self.in_chunk() & !1;
        self.at.saturating_add(CHUNK_HEAD).saturating_add(written)
    }

    fn chunk(&self, last: bool) -> Chunk {
        Chunk {
            kind: self.kind,
            last,
            length: self.in_chunk(),
            version: self.entry.version,
            offset: self.before,
        }
    }
}

impl<const KINDS: usize> Records<KINDS> {
    /// Starts a new version of `kind`; what was staged before is discarded.
    ///
    /// The old version counts until [`Records::commit`]. Errors: [`RecordError::Kind`],
    /// [`RecordError::NeedsErase`], [`RecordError::Access`].
    pub fn begin<F: NorFlash>(&mut self, flash: &mut F, kind: u8) -> Result<(), RecordError> {
        self.discard(flash)?;
        self.start(flash, kind, false)
    }

    /// Adds `bytes` to what is staged.
    ///
    /// Errors: [`RecordError::NotBegun`]; [`RecordError::NeedsErase`] and
    /// [`RecordError::Access`] discard what is staged.
    pub fn append<F: NorFlash>(&mut self, flash: &mut F, bytes: &[u8]) -> Result<(), RecordError> {
        let mut staging = self.staging.take().ok_or(RecordError::NotBegun)?;
        let more = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        let length = staging.entry.length.saturating_add(more);
        let left = self.space_behind(&staging);
        if !staging.reserve && left < more.saturating_add(self.reserve(length)) {
            self.staging = Some(staging);
            self.discard(flash)?;
            return Err(RecordError::NeedsErase);
        }
        for byte in bytes {
            if let Err(error) = self.push(flash, &mut staging, *byte) {
                self.abandon();
                return Err(error);
            }
        }
        self.staging = Some(staging);
        Ok(())
    }

    /// Reads back what is staged, as [`Records::read`] does; 0 when nothing is.
    ///
    /// Errors: [`RecordError::Access`].
    pub fn staged<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        offset: u32,
        into: &mut [u8],
    ) -> Result<usize, RecordError> {
        let Some(staging) = &self.staging else {
            return Ok(0);
        };
        let count = self.copy(flash, &staging.entry, offset, into)?;
        let last = staging.entry.length.saturating_sub(1);
        // The last byte is not in the flash as long as it waits for its other half.
        if let (Some(odd), Some(place)) = (staging.odd, last.checked_sub(offset))
            && let Some(byte) = into
                .get_mut(..count)
                .and_then(|b| b.get_mut(place as usize))
        {
            *byte = odd;
        }
        Ok(count)
    }

    /// Makes the staged version the valid one, whole or not at all.
    ///
    /// Errors: [`RecordError::NotBegun`], [`RecordError::Access`]; the old version then stays.
    pub fn commit<F: NorFlash>(&mut self, flash: &mut F) -> Result<(), RecordError> {
        let mut staging = self.staging.take().ok_or(RecordError::NotBegun)?;
        let chunk = staging.chunk(true);
        if let Err(error) = self.close(flash, &mut staging, &chunk) {
            self.abandon();
            return Err(error);
        }
        self.at = chunk.end(staging.at);
        if !staging.reserve {
            self.renewed = 0;
        }
        if let Some(entry) = self.index.get_mut(usize::from(staging.kind)) {
            *entry = staging.entry;
            self.damaged &= !mask::<KINDS>(staging.kind);
        }
        Ok(())
    }

    /// Forgets what is staged.
    ///
    /// Errors: [`RecordError::Access`]; it is forgotten all the same.
    pub fn discard<F: NorFlash>(&mut self, flash: &mut F) -> Result<(), RecordError> {
        let Some(mut staging) = self.staging.take() else {
            return Ok(());
        };
        let mut chunk = staging.chunk(true);
        if chunk.length == 0 {
            return Ok(());
        }
        // With a header that says how long it is, the rest of the page stays of use.
        chunk.kind = VOID;
        if let Err(error) = self.close(flash, &mut staging, &chunk) {
            self.abandon();
            return Err(error);
        }
        self.at = chunk.end(staging.at);
        Ok(())
    }

    /// Removes `kind`: from now on it reads as never stored.
    ///
    /// This stores an empty version, so it needs 16 bytes and is whole or did not happen. Errors:
    /// those of [`Records::begin`] and [`Records::commit`].
    pub fn erase<F: NorFlash>(&mut self, flash: &mut F, kind: u8) -> Result<(), RecordError> {
        self.begin(flash, kind)?;
        self.commit(flash)
    }

    /// Opens the first chunk of `kind`.
    pub(super) fn start<F: NorFlash>(
        &mut self,
        flash: &mut F,
        kind: u8,
        reserve: bool,
    ) -> Result<(), RecordError> {
        self.entry(kind).ok_or(RecordError::Kind(kind))?;
        self.close_gap(flash)?;
        if !has_room(self.at) {
            if !reserve && self.space() < self.reserve(0) {
                return Err(RecordError::NeedsErase);
            }
            self.open_page()?;
        }
        self.version = self.version.saturating_add(1);
        self.staging = Some(Staging {
            kind,
            entry: Entry {
                sequence: self.head,
                at: self.at,
                length: 0,
                version: self.version,
            },
            at: self.at,
            before: 0,
            crc: Crc32::new(),
            odd: None,
            reserve,
        });
        Ok(())
    }

    /// Makes what is behind a cut in the head page of use again.
    pub(super) fn close_gap<F: NorFlash>(&mut self, flash: &mut F) -> Result<(), RecordError> {
        let Some(cut) = self.cut_at.take() else {
            return Ok(());
        };
        let page = self.pages.offset(self.head);
        let mut end = PAGE;
        // Nothing of the chunk that was cut is written over, neither its header nor its payload,
        // which may look blank: they tell a cut from damage.
        let first = Chunk::cut_end(flash, page, cut)?;
        while end > first && is_blank(flash, page.saturating_add(end).saturating_sub(2), 2)? {
            end = end.saturating_sub(2);
        }
        if has_room(end.saturating_add(CHUNK_HEAD)) {
            self.put(flash, end, &Chunk::gap(cut))?;
            self.at = end.saturating_add(CHUNK_HEAD);
        }
        Ok(())
    }

    /// Takes the next page that is ready as the head.
    fn open_page(&mut self) -> Result<(), RecordError> {
        if self.blank_pages() == 0 {
            return Err(RecordError::NeedsErase);
        }
        self.head = self.head.saturating_add(1);
        self.at = HEAD;
        self.cut_at = None;
        Ok(())
    }

    /// Bytes of payload for which there is room behind what is staged, the reserve included.
    fn space_behind(&self, staging: &Staging) -> u32 {
        let here = room(staging.at).saturating_sub(staging.in_chunk());
        let pages = self.blank_pages().saturating_mul(LONGEST);
        pages.saturating_add(here)
    }

    fn push<F: NorFlash>(
        &mut self,
        flash: &mut F,
        staging: &mut Staging,
        byte: u8,
    ) -> Result<(), RecordError> {
        if staging.in_chunk() >= room(staging.at) {
            let chunk = staging.chunk(false);
            self.close(flash, staging, &chunk)?;
            self.open_page()?;
            staging.at = self.at;
            staging.before = staging.entry.length;
            staging.crc = Crc32::new();
        }
        staging.crc.add(&[byte]);
        match staging.odd.take() {
            None => staging.odd = Some(byte),
            Some(first) => self.put(flash, staging.next(), &[first, byte])?,
        }
        staging.entry.length = staging.entry.length.saturating_add(1);
        Ok(())
    }

    /// Writes the byte that waits, and the header.
    fn close<F: NorFlash>(
        &self,
        flash: &mut F,
        staging: &mut Staging,
        chunk: &Chunk,
    ) -> Result<(), RecordError> {
        if let Some(odd) = staging.odd.take() {
            self.put(flash, staging.next(), &[odd, u8::MAX])?;
        }
        let header = chunk.encode(staging.crc.clone());
        self.put(flash, staging.at, &header)
    }

    fn put<F: NorFlash>(&self, flash: &mut F, at: u32, bytes: &[u8]) -> Result<(), RecordError> {
        let offset = self.pages.offset(self.head).saturating_add(at);
        Ok(program(flash, offset, bytes)?)
    }

    /// Gives up what is staged, and the rest of the head page with it.
    pub(super) fn abandon(&mut self) {
        self.staging = None;
        self.at = PAGE;
    }
}
