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
    /// Nothing is staged.
    pub const NONE: Self = Self {
        kind: 0,
        entry: Entry::NONE,
        at: 0,
        before: 0,
        crc: Crc32::new(),
        odd: None,
        reserve: false,
    };

    /// Bytes in the open chunk.
    const fn in_chunk(&self) -> u32 {
        self.entry.length.saturating_sub(self.before)
    }

    /// Offset in the page where the next half-word goes.
    fn next(&self) -> u32 {
        let written = self.in_chunk() & !1;
        self.at + CHUNK_HEAD + written
    }

    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
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
        self.must_be_staged()?;
        let more = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        let length = self.staging.entry.length.saturating_add(more);
        let needed = more.saturating_add(self.reserve(length));
        if !self.staging.reserve && self.space_behind() < needed {
            self.discard(flash)?;
            return Err(RecordError::NeedsErase);
        }
        for byte in bytes {
            if let Err(error) = self.push(flash, *byte) {
                self.abandon();
                return Err(error);
            }
        }
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
        if !self.is_staged {
            return Ok(0);
        }
        let staging = &self.staging;
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
        self.must_be_staged()?;
        self.end(flash, &self.staging.chunk(true))?;
        let staging = &self.staging;
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
        if !self.is_staged {
            return Ok(());
        }
        let mut chunk = self.staging.chunk(true);
        if chunk.length == 0 {
            self.is_staged = false;
            return Ok(());
        }
        // With a header that states how long it is, the rest of the page stays of use.
        chunk.kind = VOID;
        self.end(flash, &chunk)
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
        self.is_staged = true;
        self.staging = Staging {
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
        };
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
        while end > first && is_blank(flash, page + end - 2, 2)? {
            end -= 2;
        }
        if has_room(end + CHUNK_HEAD) {
            self.put(flash, end, &Chunk::gap(cut))?;
            self.at = end + CHUNK_HEAD;
        }
        Ok(())
    }

    /// Takes the next page that is ready as the head.
    fn open_page(&mut self) -> Result<(), RecordError> {
        if self.blank_pages() == 0 {
            return Err(RecordError::NeedsErase);
        }
        self.head += 1;
        self.at = HEAD;
        self.cut_at = None;
        Ok(())
    }

    /// Bytes of payload for which there is room behind what is staged, the reserve included.
    fn space_behind(&self) -> u32 {
        let here = room(self.staging.at).saturating_sub(self.staging.in_chunk());
        self.blank_pages() * LONGEST + here
    }

    fn push<F: NorFlash>(&mut self, flash: &mut F, byte: u8) -> Result<(), RecordError> {
        if self.staging.in_chunk() >= room(self.staging.at) {
            self.close(flash, &self.staging.chunk(false))?;
            self.open_page()?;
            let staging = &mut self.staging;
            staging.at = self.at;
            staging.before = staging.entry.length;
            staging.crc = Crc32::new();
        }
        let staging = &mut self.staging;
        staging.crc.add(&[byte]);
        match staging.odd.take() {
            None => staging.odd = Some(byte),
            Some(first) => {
                let next = staging.next();
                self.put(flash, next, &[first, byte])?;
            }
        }
        let staging = &mut self.staging;
        staging.entry.length += 1;
        Ok(())
    }

    const fn must_be_staged(&self) -> Result<(), RecordError> {
        if self.is_staged {
            Ok(())
        } else {
            Err(RecordError::NotBegun)
        }
    }

    /// Ends what is staged with its last `chunk`, and goes on behind it.
    fn end<F: NorFlash>(&mut self, flash: &mut F, chunk: &Chunk) -> Result<(), RecordError> {
        let closed = self.close(flash, chunk);
        if closed.is_ok() {
            self.is_staged = false;
            self.at = chunk.end(self.staging.at);
        } else {
            self.abandon();
        }
        closed
    }

    /// Writes the byte that waits, and the header.
    fn close<F: NorFlash>(&mut self, flash: &mut F, chunk: &Chunk) -> Result<(), RecordError> {
        if let Some(odd) = self.staging.odd.take() {
            let next = self.staging.next();
            self.put(flash, next, &[odd, u8::MAX])?;
        }
        let header = chunk.encode(self.staging.crc.clone());
        self.put(flash, self.staging.at, &header)
    }

    fn put<F: NorFlash>(&self, flash: &mut F, at: u32, bytes: &[u8]) -> Result<(), RecordError> {
        let offset = self.pages.offset(self.head) + at;
        Ok(program(flash, offset, bytes)?)
    }

    /// Gives up what is staged, and the rest of the head page with it.
    pub(super) fn abandon(&mut self) {
        self.is_staged = false;
        self.at = PAGE;
    }
}
