//! A chunk: the part of a record that lies in one page.
//!
//! In and out: bytes. The header stands before the payload and is written behind it, so a chunk
//! without a header that fits was cut.
//!
//! # Header, 16 bytes
//! Numbers are little-endian.
//!
//! | byte | content |
//! |---|---|
//! | 0 | kind of the record; FEh: thrown away; FDh: closes a gap |
//! | 1 | 80h: the last of its record; 0: another one follows |
//! | 2, 3 | bytes of payload; one more follows if that is odd |
//! | 4 to 7 | version: every record that is stored has a higher one |
//! | 8 to 11 | offset of the payload in the record |
//! | 12 to 15 | CRC-32 of the payload and bytes 0 to 11 |
//!
//! What is behind a chunk that was cut would be lost for use, since nothing shows how long that
//! chunk is. A chunk without payload that closes the gap stands behind it, with the cut chunk's
//! offset in the page as its offset.
//!
//! Left out: where chunks lie ([`Records`](super::Records)).

use embedded_storage::nor_flash::ReadNorFlash;

use crate::access::{AccessError, add_to, read};
use crate::check_sum::Crc32;
use crate::layout::PAGE;

use super::pages::HEAD;

/// Bytes of a chunk's header.
pub(crate) const CHUNK_HEAD: u32 = 16;

/// The longest payload: that of a chunk that has its page for itself.
pub(crate) const LONGEST: u32 = PAGE - HEAD - CHUNK_HEAD;

/// The kind of a chunk that was thrown away.
pub(crate) const VOID: u8 = 0xFE;

/// The kind of a chunk that closes the gap that a cut has left; kinds of records are below.
pub(crate) const GAP: u8 = 0xFD;

/// Marks the last part.
const LAST: u8 = 0x80;

/// What a chunk's header contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Chunk {
    pub kind: u8,
    pub last: bool,
    pub length: u32,
    pub version: u32,
    pub offset: u32,
}

/// What stands where a chunk may be.
pub(crate) enum Look {
    /// A chunk that is whole.
    Whole(Chunk),
    /// A chunk that was whole, and of which bits have gone bad: perhaps those of these fields.
    Damaged(Chunk),
    /// A chunk that was never whole.
    Cut,
}

/// Payload bytes that fit behind a chunk header at offset `at` of a page; even.
pub(crate) const fn room(at: u32) -> u32 {
    (PAGE - CHUNK_HEAD).saturating_sub(at)
}

impl Chunk {
    /// The header of a chunk whose payload is in `crc`, already.
    pub(crate) fn encode(&self, mut crc: Crc32) -> [u8; CHUNK_HEAD as usize] {
        let mut bytes = [0; CHUNK_HEAD as usize];
        let last = if self.last { LAST } else { 0 };
        let [low, high, ..] = self.length.to_le_bytes();
        let (words, _) = bytes.as_chunks_mut::<4>();
        if let [what, version, offset, check] = words {
            *what = [self.kind, last, low, high];
            *version = self.version.to_le_bytes();
            *offset = self.offset.to_le_bytes();
            crc.add(what);
            crc.add(version);
            crc.add(offset);
            *check = crc.value().to_le_bytes();
        }
        bytes
    }

    /// The header that closes the gap from a chunk that was cut at offset `at` of its page.
    pub(crate) fn gap(at: u32) -> [u8; CHUNK_HEAD as usize] {
        let chunk = Self {
            kind: GAP,
            last: true,
            length: 0,
            version: 0,
            offset: at,
        };
        chunk.encode(Crc32::new())
    }

    /// Reads the chunk whose header is at offset `at` of the page at `page`; `None` if it isn't
    /// whole.
    pub(crate) fn read<F: ReadNorFlash>(
        flash: &mut F,
        page: u32,
        at: u32,
    ) -> Result<Option<Self>, AccessError> {
        Ok(match Self::look(flash, page, at)? {
            Look::Whole(chunk) => Some(chunk),
            Look::Damaged(_) | Look::Cut => None,
        })
    }

    /// What is at offset `at` of the page at `page`.
    pub(crate) fn look<F: ReadNorFlash>(
        flash: &mut F,
        page: u32,
        at: u32,
    ) -> Result<Look, AccessError> {
        let mut bytes = [0; CHUNK_HEAD as usize];
        let offset = page + at;
        read(flash, offset, &mut bytes)?;
        let (words, _) = bytes.as_chunks::<4>();
        let [[kind, last, low, high], version, offset_in_record, _] = words else {
            return Ok(Look::Cut);
        };
        let chunk = Self {
            kind: *kind,
            last: *last == LAST,
            length: u32::from(u16::from_le_bytes([*low, *high])),
            version: u32::from_le_bytes(*version),
            offset: u32::from_le_bytes(*offset_in_record),
        };
        if chunk.length > room(at) {
            return Ok(Look::Cut);
        }
        let mut crc = Crc32::new();
        let payload = offset + CHUNK_HEAD;
        add_to(&mut crc, flash, payload, chunk.length)?;
        let fitting = chunk.encode(crc);
        if fitting == bytes {
            return Ok(Look::Whole(chunk));
        }
        let check = |header: [u8; CHUNK_HEAD as usize]| {
            let [.., a, b, c, d] = header;
            u32::from_le_bytes([a, b, c, d])
        };
        // The check sum is programmed last. A cut leaves it blank, or with ones that should not be
        // there any more; all others came to their end once.
        let (held, fits) = (check(bytes), check(fitting));
        let is_cut = held >> 16 == 0xFFFF || held & fits == fits;
        Ok(if is_cut {
            Look::Cut
        } else {
            Look::Damaged(chunk)
        })
    }

    /// Offset in the page at `page` behind a chunk that was cut at `at`, as far as its header goes.
    pub(crate) fn cut_end<F: ReadNorFlash>(
        flash: &mut F,
        page: u32,
        at: u32,
    ) -> Result<u32, AccessError> {
        let mut length = [0; 2];
        read(flash, page + at + 2, &mut length)?;
        let length = u32::from(u16::from_le_bytes(length)).next_multiple_of(2);
        let head = at + CHUNK_HEAD;
        Ok(if length > room(at) {
            head
        } else {
            head + length
        })
    }

    /// Offset in its page behind a chunk that begins at `at`.
    pub(crate) const fn end(&self, at: u32) -> u32 {
        let padded = self.length.next_multiple_of(2);
        at + CHUNK_HEAD + padded
    }
}
