//! Installing an image: into the slot that does not run, while the other goes on.
//!
//! In: the bytes of an image's file, in pieces, in order. Out: a slot with a whole image that is
//! not activated, or an [`InstallError`].
//!
//! The slot is erased first, one page for each call. The header is judged as soon as it is there,
//! so what can't run here is refused before the rest comes. Marks in the file are left out: they
//! are [`slots`](crate::slots)' own. Nothing that was cut can pass for an image, since its check
//! sum would have to be right. That sum is taken of each half-word once it has been read back, so
//! the last byte costs no more time than any other.
//!
//! Left out: the check of the whole image as it then stands in the flash, of its signature, and
//! the activation.

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::Progress;
use crate::access::{AccessError, add_to, erase, program};
use crate::check_sum::Crc32;
use crate::image::{FIELDS, Header, ImageError, SIGNATURE_AT, Signature, Version, header};
use crate::layout::{HEADER, Layout, PAGE, Region, Slot};
use crate::slots::{MARKS, marks};

/// What an image has to be to be let in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rules {
    /// The hardware it has to be made for.
    pub hardware: u32,
    /// The version that runs.
    pub running: Version,
    /// Whether a lower version is let in; the same one always is.
    pub downgrade: bool,
    /// Whether one without a signature is let in.
    pub unsigned: bool,
}

/// Why an image was not installed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstallError {
    /// The part has one slot only.
    NoSlot,
    /// The running image is on trial: the other one is still needed.
    Unconfirmed,
    /// Bytes came before the slot was erased.
    NotErased,
    /// It is no image, or none that can run here.
    Image(ImageError),
    /// It is older than the one that runs, and that is not permitted.
    Downgrade,
    /// It has no signature, and that is not permitted.
    Unsigned,
    /// More bytes came than header and body have.
    TooLong,
    /// Fewer bytes came than header and body have.
    Incomplete,
    /// The flash refused, or did not hold what was written to it.
    Access(AccessError),
}

impl From<AccessError> for InstallError {
    fn from(error: AccessError) -> Self {
        Self::Access(error)
    }
}

impl Rules {
    /// Whether an image with `header` may be installed in `slot`.
    ///
    /// Errors: [`InstallError::Image`], [`InstallError::Downgrade`], [`InstallError::Unsigned`].
    pub fn admit(&self, header: &Header, slot: Region) -> Result<(), InstallError> {
        header
            .suits(slot, self.hardware)
            .map_err(InstallError::Image)?;
        if header.version < self.running && !self.downgrade {
            return Err(InstallError::Downgrade);
        }
        if header.signature == Signature::None && !self.unsigned {
            return Err(InstallError::Unsigned);
        }
        Ok(())
    }
}

/// An image on its way into a slot.
///
/// After an error it goes no further: begin with a new one.
#[derive(Clone, Debug)]
pub struct Install {
    slot: Region,
    rules: Rules,
    /// Pages erased.
    erased: u32,
    /// Bytes of the file that have come.
    received: u32,
    odd: Option<u8>,
    header: Option<Header>,
    identity: Option<u32>,
    /// Of the body, as far as it has come.
    crc: Crc32,
}

impl Install {
    /// Prepares an update while the image in `running` runs. Nothing is written.
    ///
    /// Errors: [`InstallError::NoSlot`], [`InstallError::Unconfirmed`], [`InstallError::Access`].
    pub fn new<F: ReadNorFlash>(
        flash: &mut F,
        layout: &Layout,
        running: Slot,
        rules: Rules,
    ) -> Result<Self, InstallError> {
        let free = layout.slot(running.other()).ok_or(InstallError::NoSlot)?;
        let runs = layout.slot(running).ok_or(InstallError::NoSlot)?;
        let marks = marks(flash, runs)?;
        if !marks.confirmed || marks.generation.is_none() {
            return Err(InstallError::Unconfirmed);
        }
        Ok(Self {
            slot: free,
            rules,
            erased: 0,
            received: 0,
            odd: None,
            header: None,
            identity: None,
            crc: Crc32::new(),
        })
    }

    /// The slot that is written to.
    pub const fn slot(&self) -> Region {
        self.slot
    }

    /// Bytes of the file that have come.
    pub const fn received(&self) -> u32 {
        self.received
    }

    /// The header, once it has come and was let in.
    pub const fn header(&self) -> Option<&Header> {
        self.header.as_ref()
    }

    /// CRC-32 over header and signature as the flash has them ([`FIELDS`] bytes without the
    /// header's own check sum), once both have come: another version or signature of the same body
    /// is another image.
    pub const fn identity(&self) -> Option<u32> {
        self.identity
    }

    /// Erases the next page of the slot, the header's first.
    ///
    /// The processor stands still for 40 ms at most; twice where a [`PAGE`] is two pages of the
    /// chip. Errors: [`InstallError::Access`].
    pub fn erase<F: NorFlash>(&mut self, flash: &mut F) -> Result<Progress, InstallError> {
        if self.erased < self.slot.pages() {
            let page = self.erased * PAGE;
            erase(flash, self.slot.start + page)?;
            self.erased += 1;
        }
        Ok(if self.erased < self.slot.pages() {
            Progress::More
        } else {
            Progress::Done
        })
    }

    /// Writes the next bytes of the file.
    ///
    /// Errors: [`InstallError::NotErased`], [`InstallError::TooLong`], those of [`Rules::admit`]
    /// with the header's last byte, [`InstallError::Access`].
    pub fn append<F: NorFlash>(&mut self, flash: &mut F, bytes: &[u8]) -> Result<(), InstallError> {
        if self.erased < self.slot.pages() {
            return Err(InstallError::NotErased);
        }
        bytes.iter().try_for_each(|byte| self.push(flash, *byte))
    }

    fn push<F: NorFlash>(&mut self, flash: &mut F, byte: u8) -> Result<(), InstallError> {
        let at = self.received;
        if at >= self.expected() {
            return Err(InstallError::TooLong);
        }
        self.received = at + 1;
        let Some(first) = self.odd.take() else {
            self.odd = Some(byte);
            return Ok(());
        };
        // The half-word began with the byte before.
        let place = self.slot.start + at - 1;
        if !(MARKS..HEADER).contains(&at) {
            program(flash, place, &[first, byte])?;
        }
        if at >= HEADER {
            self.crc.add(&[first, byte]);
        }
        if self.received == SIGNATURE_AT {
            let hardware = self.rules.hardware;
            let header = header(flash, self.slot, hardware).map_err(InstallError::Image)?;
            self.rules.admit(&header, self.slot)?;
            self.header = Some(header);
        } else if self.received == FIELDS as u32 {
            // Behind the header's own check sum the sum over it would be the same for any header.
            let (checked, signature) = (SIGNATURE_AT - 4, self.slot.start + SIGNATURE_AT);
            let mut crc = Crc32::new();
            add_to(&mut crc, flash, self.slot.start, checked)?;
            add_to(&mut crc, flash, signature, FIELDS as u32 - SIGNATURE_AT)?;
            self.identity = Some(crc.value());
        }
        Ok(())
    }

    /// Bytes of the whole file, as far as is known.
    fn expected(&self) -> u32 {
        let body = self.header.map_or(0, |header| header.length);
        HEADER + body
    }

    /// All bytes have come: whether they are what the header states.
    ///
    /// Each was read back when it was programmed. Whether all of it still stands in the flash is
    /// for [`verify`](crate::image::verify) to find out, which takes its time.
    /// Errors: [`InstallError::Incomplete`], [`InstallError::Image`].
    pub fn finish(&self) -> Result<(), InstallError> {
        let header = self.header.ok_or(InstallError::Incomplete)?;
        if self.received < self.expected() {
            return Err(InstallError::Incomplete);
        }
        if self.crc.value() != header.crc {
            return Err(InstallError::Image(ImageError::Body));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
