//! An image: its header, and whether header and body are whole.
//!
//! In: a slot of the flash, or bytes. Out: a [`Header`], or an [`ImageError`] that names what is
//! wrong. [`Check`] takes the body's check sum in pieces, so that a running application checks
//! itself all the time without ever taking long (R9).
//!
//! # Format, version 1
//! Numbers are little-endian and without sign. The header has 512 bytes, so that the vector table
//! behind it is aligned for VTOR ([`layout::HEADER`](crate::layout::HEADER)).
//!
//! | byte | content |
//! |---|---|
//! | 0 to 3 | "PLMI" |
//! | 4, 5 | format, 1 |
//! | 6, 7 | what the signature is: 0 none, 1 Ed25519 |
//! | 8 to 11 | hardware id |
//! | 12 to 15 | version: patch (2 bytes), minor, major |
//! | 16 to 19 | address of the vector table: the image runs in that slot only |
//! | 20 to 23 | length of the body in bytes, a multiple of 4 |
//! | 24 to 27 | CRC-32 ([`check_sum`](crate::check_sum)) of the body |
//! | 28 to 31 | CRC-32 of bytes 0 to 27 |
//! | 32 to 95 | signature; FFh without one |
//! | 96 to 255 | FFh |
//! | 256 to 511 | marks of the slot ([`slots`](crate::slots)); FFh in a file |
//! | 512 on | body: vector table, code, constants |
//!
//! The signature is over bytes 0 to 31 and the body, in this order ([`Header::signed`]). No check
//! sum covers the signature, since whoever checks it finds it wrong.
//!
//! Left out: the check of the signature, and which of two images runs.

use embedded_storage::nor_flash::ReadNorFlash;

use crate::access::{AccessError, for_each, read};
use crate::check_sum::Crc32;
use crate::layout::{HEADER, Region};

/// "PLMI" as a little-endian word.
pub const MAGIC: u32 = u32::from_le_bytes(*b"PLMI");

/// The format written, and the only one read.
pub const FORMAT: u16 = 1;

/// Bytes of the header that have a meaning and come from the image's file.
pub const FIELDS: usize = 96;

/// Bytes that the header's check sum covers.
const CHECKED: usize = 28;

/// Bytes of a signature.
pub const SIGNATURE: usize = 64;

/// Offset of the signature in the header.
pub const SIGNATURE_AT: u32 = 32;

/// A program's version; a later one compares as greater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version(pub u32);

impl Version {
    /// Version `major.minor.patch`.
    pub const fn new(major: u8, minor: u8, patch: u16) -> Self {
        Self((major as u32) << 24 | (minor as u32) << 16 | patch as u32)
    }
}

/// How an image is signed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Signature {
    /// Not at all.
    None = 0,
    /// Ed25519, 64 bytes.
    Ed25519 = 1,
}

/// Why bytes are no image that can run here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageError {
    /// The slot is empty, or something else is in it: it does not begin with [`MAGIC`].
    Magic,
    /// The header is of another format than [`FORMAT`], or signed in an unknown way.
    Format,
    /// The header's check sum is wrong.
    Header,
    /// The image was made for other hardware.
    Hardware,
    /// The image is linked to another address than the slot's.
    Address,
    /// The body's length is zero, no multiple of 4, or more than the slot has room for.
    Length,
    /// The body's check sum is wrong.
    Body,
    /// The flash could not be read.
    Access(AccessError),
}

impl From<AccessError> for ImageError {
    fn from(error: AccessError) -> Self {
        Self::Access(error)
    }
}

/// What an image states of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// How it is signed.
    pub signature: Signature,
    /// The hardware that it was made for.
    pub hardware: u32,
    /// Its version.
    pub version: Version,
    /// Address of its vector table.
    pub address: u32,
    /// Bytes of its body.
    pub length: u32,
    /// CRC-32 of its body, made when it was linked.
    pub crc: u32,
}

impl Header {
    /// The header's first [`FIELDS`] bytes, with a blank signature: what the image tool writes.
    pub fn encode(&self) -> [u8; FIELDS] {
        let kind = u32::from(self.signature as u16) << 16 | u32::from(FORMAT);
        let words = [
            MAGIC,
            kind,
            self.hardware,
            self.version.0,
            self.address,
            self.length,
            self.crc,
        ];
        let mut bytes = [u8::MAX; FIELDS];
        let (places, _) = bytes.as_chunks_mut::<4>();
        for (place, word) in places.iter_mut().zip(words) {
            *place = word.to_le_bytes();
        }
        let crc = Crc32::of(bytes.get(..CHECKED).unwrap_or(&[]));
        if let Some(place) = check_sum_of(&mut bytes) {
            *place = crc.to_le_bytes();
        }
        bytes
    }

    /// Reads a header from its first 32 bytes or more.
    ///
    /// Errors: [`ImageError::Magic`] (also for fewer bytes), [`ImageError::Format`],
    /// [`ImageError::Header`].
    pub fn parse(bytes: &[u8]) -> Result<Self, ImageError> {
        let (words, _) = bytes.as_chunks::<4>();
        let [
            magic,
            kind,
            hardware,
            version,
            address,
            length,
            crc,
            check,
            ..,
        ] = words
        else {
            return Err(ImageError::Magic);
        };
        if u32::from_le_bytes(*magic) != MAGIC {
            return Err(ImageError::Magic);
        }
        let checked = bytes.get(..CHECKED).unwrap_or(&[]);
        if u32::from_le_bytes(*check) != Crc32::of(checked) {
            return Err(ImageError::Header);
        }
        let [format_low, format_high, signed_low, signed_high] = *kind;
        let format = u16::from_le_bytes([format_low, format_high]);
        let signature = match u16::from_le_bytes([signed_low, signed_high]) {
            0 => Signature::None,
            1 => Signature::Ed25519,
            _ => return Err(ImageError::Format),
        };
        if format != FORMAT {
            return Err(ImageError::Format);
        }
        Ok(Self {
            signature,
            hardware: u32::from_le_bytes(*hardware),
            version: Version(u32::from_le_bytes(*version)),
            address: u32::from_le_bytes(*address),
            length: u32::from_le_bytes(*length),
            crc: u32::from_le_bytes(*crc),
        })
    }

    /// Whether this image can run in `slot` on the hardware with the id `hardware`.
    ///
    /// Errors: [`ImageError::Hardware`], [`ImageError::Address`], [`ImageError::Length`].
    pub fn suits(&self, slot: Region, hardware: u32) -> Result<(), ImageError> {
        if self.hardware != hardware {
            return Err(ImageError::Hardware);
        }
        if self.address != slot.address() + HEADER {
            return Err(ImageError::Address);
        }
        let room = slot.length.saturating_sub(HEADER);
        if self.length == 0 || !self.length.is_multiple_of(4) || self.length > room {
            return Err(ImageError::Length);
        }
        Ok(())
    }

    /// What the signature is over: two pieces as offset in the slot and length, in this order.
    pub const fn signed(&self) -> [(u32, u32); 2] {
        [(0, SIGNATURE_AT), (HEADER, self.length)]
    }
}

/// The place of the header's check sum.
fn check_sum_of(bytes: &mut [u8; FIELDS]) -> Option<&mut [u8; 4]> {
    bytes.get_mut(CHECKED..)?.first_chunk_mut()
}

/// The header in `slot`, found fit for it; the body is not looked at.
///
/// Errors: those of [`Header::parse`] and [`Header::suits`], and [`ImageError::Access`].
pub fn header<F: ReadNorFlash>(
    flash: &mut F,
    slot: Region,
    hardware: u32,
) -> Result<Header, ImageError> {
    let mut bytes = [0; SIGNATURE_AT as usize];
    read(flash, slot.start, &mut bytes)?;
    fitting(&bytes, slot, hardware)
}

/// The header that these bytes are, found fit for `slot`: the same for every kind of flash.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn fitting(bytes: &[u8], slot: Region, hardware: u32) -> Result<Header, ImageError> {
    let header = Header::parse(bytes)?;
    header.suits(slot, hardware)?;
    Ok(header)
}

/// The header in `slot` of an image that is whole, body included.
///
/// Reads all of the body: 48 kB are some 2 million instructions. Errors: any of [`ImageError`].
pub fn verify<F: ReadNorFlash>(
    flash: &mut F,
    slot: Region,
    hardware: u32,
) -> Result<Header, ImageError> {
    let header = header(flash, slot, hardware)?;
    let mut check = Check::new(&header);
    match check.step(flash, slot, header.length)? {
        Verdict::Good => Ok(header),
        Verdict::Bad | Verdict::Running => Err(ImageError::Body),
    }
}

/// What a [`Check`] has found after a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Not all of the body has been seen.
    Running,
    /// The body is what was linked. The next step begins anew.
    Good,
    /// The body is not what was linked. The next step begins anew.
    Bad,
}

/// The check sum of an image's body under way; it goes round without end.
#[derive(Clone, Debug)]
pub struct Check {
    length: u32,
    expected: u32,
    done: u32,
    crc: Crc32,
}

impl Check {
    /// Before the first byte of the body that `header` describes.
    pub fn new(header: &Header) -> Self {
        Self {
            length: header.length,
            expected: header.crc,
            done: 0,
            crc: Crc32::new(),
        }
    }

    /// Bytes of the body that this round has seen.
    pub const fn done(&self) -> u32 {
        self.done
    }

    /// Takes in the next bytes of the body. What goes beyond its end is not looked at.
    pub fn add(&mut self, bytes: &[u8]) -> Verdict {
        let wanted = (self.length.saturating_sub(self.done)) as usize;
        let bytes = bytes.get(..wanted).unwrap_or(bytes);
        self.crc.add(bytes);
        self.done = self.done.saturating_add(bytes.len() as u32);
        if self.done < self.length {
            return Verdict::Running;
        }
        let good = self.crc.value() == self.expected;
        self.done = 0;
        self.crc = Crc32::new();
        if good { Verdict::Good } else { Verdict::Bad }
    }

    /// Reads the next `count` bytes, at most to the body's end, from the image in `slot`.
    ///
    /// Errors: [`AccessError::Refused`]; the round then has to begin anew with [`Check::new`].
    pub fn step<F: ReadNorFlash>(
        &mut self,
        flash: &mut F,
        slot: Region,
        count: u32,
    ) -> Result<Verdict, AccessError> {
        let count = count.min(self.length.saturating_sub(self.done));
        let at = slot.start + HEADER + self.done;
        let mut verdict = Verdict::Running;
        for_each(flash, at, count, &mut |bytes| verdict = self.add(bytes))?;
        Ok(verdict)
    }
}

#[cfg(test)]
pub(crate) mod tests;
