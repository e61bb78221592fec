//! Programs: the one that runs, and the one that comes into the other slot.
//!
//! In: the calls of [`ProgramMemory`]. Out: an image in the free slot, judged by its header as soon
//! as that has come, checked whole, signed as [`Verification`] wants it, and activated when asked.
//!
//! The check of a whole image and its signature takes some 20 million instructions for 90 kB
//! (`docs/cost.md` counts them), so it must not be done between two samples. On the chip it runs
//! where everything else interrupts it; elsewhere it takes no time. For the same frames in both,
//! its outcome is asked for after a time that depends on the image's length alone.
//!
//! Left out: which image starts, which is the bootloader's decision ([`flash::slots`]).

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};
use flash::Progress;
use flash::access::{AccessError, for_each, read};
use flash::image::{
    Header, ImageError, SIGNATURE, SIGNATURE_AT, Signature, Version, header, verify,
};
use flash::install::{Install, InstallError, Rules};
use flash::layout::Region;
use flash::slots::{SlotError, confirm, marks, put_on_trial};

use super::FlashMemory;
use crate::program::{Confirmation, Held, ProgramError, ProgramMemory, Running};

/// How the image in the slot that does not run is checked before it is started.
///
/// Whoever has [`Signatures`] does it at once.
pub trait Verification {
    /// Whether an image without a signature is let in.
    fn unsigned(&self) -> bool;

    /// A check begins; the one before has ended.
    fn begin(&mut self);

    /// Whether the image in `slot` is whole, made for `hardware` and signed as it has to be;
    /// `None` while that is being found out.
    fn outcome<F: ReadNorFlash>(
        &mut self,
        flash: &mut F,
        slot: Region,
        hardware: u32,
    ) -> Option<bool>;
}

impl<S: Signatures> Verification for S {
    fn unsigned(&self) -> bool {
        Signatures::unsigned(self)
    }

    fn begin(&mut self) {}

    fn outcome<F: ReadNorFlash>(
        &mut self,
        flash: &mut F,
        slot: Region,
        hardware: u32,
    ) -> Option<bool> {
        Some(is_sound(flash, slot, hardware, self))
    }
}

/// Whether the image in `slot` is whole, made for `hardware` and signed as `signatures` wants it.
/// Reads all of it twice; what cannot be read is not sound.
///
/// Out of line: the state of the check is large, and its callers do other work.
#[inline(never)]
pub fn is_sound<F: ReadNorFlash, S: Signatures>(
    flash: &mut F,
    slot: Region,
    hardware: u32,
    signatures: &S,
) -> bool {
    let Ok(header) = verify(flash, slot, hardware) else {
        return false;
    };
    match header.signature {
        Signature::None => signatures.unsigned(),
        Signature::Ed25519 => is_signed(flash, slot, &header, signatures).unwrap_or(false),
    }
}

fn is_signed<F: ReadNorFlash, S: Signatures>(
    flash: &mut F,
    slot: Region,
    header: &Header,
    signatures: &S,
) -> Result<bool, AccessError> {
    let mut signature = [0; SIGNATURE];
    let at = slot.start.saturating_add(SIGNATURE_AT);
    read(flash, at, &mut signature)?;
    let mut check = signatures.place();
    if !signatures.begin(&mut check, &signature) {
        return Ok(false);
    }
    for (offset, length) in header.signed() {
        let at = slot.start.saturating_add(offset);
        for_each(flash, at, length, &mut |bytes| {
            signatures.add(&mut check, bytes);
        })?;
    }
    Ok(signatures.is_good(&check))
}

/// The arithmetic of signatures.
pub trait Signatures {
    /// The check of one signature under way. It is large, so it stays in its place.
    type Check;

    /// Whether an image without a signature is let in.
    fn unsigned(&self) -> bool;

    /// The place of a check, which [`Signatures::begin`] fills in.
    fn place(&self) -> Self::Check;

    /// Before the first byte; false: this signature can't be good for any, and the check is over.
    fn begin(&self, check: &mut Self::Check, signature: &[u8; SIGNATURE]) -> bool;

    /// Takes in the next bytes of what is signed.
    fn add(&self, check: &mut Self::Check, bytes: &[u8]);

    /// Whether the signature was made of the bytes taken in, by whom it has to be.
    fn is_good(&self, check: &Self::Check) -> bool;
}

/// Lets every image in, signed or not: for a program that was built to do that.
#[derive(Clone, Copy, Debug)]
pub struct Anybody;

impl Signatures for Anybody {
    type Check = ();

    fn unsigned(&self) -> bool {
        true
    }

    fn place(&self) {}

    fn begin(&self, (): &mut (), _signature: &[u8; SIGNATURE]) -> bool {
        true
    }

    fn add(&self, (): &mut (), _bytes: &[u8]) {}

    fn is_good(&self, (): &()) -> bool {
        true
    }
}

impl From<InstallError> for ProgramError {
    fn from(error: InstallError) -> Self {
        match error {
            InstallError::NoSlot | InstallError::Unconfirmed => Self::Secured,
            InstallError::Unsigned => Self::Unsigned,
            InstallError::NotErased => Self::NotCleared,
            InstallError::Downgrade => Self::Older,
            InstallError::TooLong | InstallError::Incomplete => Self::Damaged,
            InstallError::Access(_) => Self::Write,
            InstallError::Image(error) => error.into(),
        }
    }
}

impl From<ImageError> for ProgramError {
    fn from(error: ImageError) -> Self {
        match error {
            ImageError::Access(_) => Self::Write,
            ImageError::Length => Self::Address,
            ImageError::Body | ImageError::Header => Self::Damaged,
            ImageError::Hardware => Self::Hardware,
            ImageError::Address => Self::Slot,
            ImageError::Magic | ImageError::Format => Self::UnknownFormat,
        }
    }
}

impl From<AccessError> for ProgramError {
    fn from(_: AccessError) -> Self {
        Self::Write
    }
}

impl From<SlotError> for ProgramError {
    fn from(error: SlotError) -> Self {
        match error {
            SlotError::Image(error) => error.into(),
            SlotError::Absent => Self::Secured,
            SlotError::Idle | SlotError::Spent | SlotError::Access(_) => Self::Write,
        }
    }
}

/// Bytes of an image that a step of its check is the time for; the steps are 20 ms apart.
///
/// The chip takes some 200 instructions for each byte, beside everything else, so 2 kB are less
/// than a third of that time.
const STEP: u32 = 2048;

/// Steps for the signature's curve, which is the same for any image: 1.8 million instructions.
const CURVE: u32 = 5;

/// What the place of a new image is at.
#[derive(Clone, Debug)]
pub(super) struct Place {
    install: Install,
    /// All of it was there.
    whole: bool,
    /// Steps of its check to come; 0: none is under way.
    steps: u32,
}

impl<F: NorFlash, V> FlashMemory<F, V> {
    fn running_header(&mut self) -> Option<Header> {
        let slot = self.kept.build.layout.slot(self.kept.build.running)?;
        header(&mut self.kept.flash, slot, self.kept.build.hardware).ok()
    }

    /// How the program in the running slot came to run.
    fn confirmation(&mut self) -> Result<Confirmation, AccessError> {
        let (layout, running) = (self.kept.build.layout, self.kept.build.running);
        let [Some(runs), Some(other)] = [layout.slot(running), layout.slot(running.other())] else {
            return Ok(Confirmation::Confirmed);
        };
        let (runs, other) = (
            marks(&mut self.kept.flash, runs)?,
            marks(&mut self.kept.flash, other)?,
        );
        let failed = other.generation > runs.generation && !other.confirmed && other.left == 0;
        Ok(match runs.confirmed {
            // What runs without ever having been activated was put there by a debugger.
            false if runs.generation.is_some() => Confirmation::Trial,
            _ if failed => Confirmation::RolledBack,
            _ => Confirmation::Confirmed,
        })
    }
}

impl<F: NorFlash, V: Verification> ProgramMemory for FlashMemory<F, V> {
    fn clear(&mut self) -> Result<(), ProgramError> {
        let running = self.running_header();
        let rules = Rules {
            hardware: self.kept.build.hardware,
            running: running.map_or(Version(0), |header| header.version),
            downgrade: false,
            unsigned: self.verification.unsigned(),
        };
        let build = self.kept.build;
        let install = Install::new(&mut self.kept.flash, build.layout, build.running, rules)?;
        self.place = Some(Place {
            install,
            whole: false,
            steps: 0,
        });
        Ok(())
    }

    fn erase(&mut self) -> Result<Progress, ProgramError> {
        let place = self.place.as_mut().ok_or(ProgramError::NotCleared)?;
        Ok(place.install.erase(&mut self.kept.flash)?)
    }

    fn begin(&mut self, size: Option<u32>) -> Result<(), ProgramError> {
        let place = self.place.as_ref().ok_or(ProgramError::NotCleared)?;
        let room = place.install.slot().length;
        let left = room.saturating_sub(place.install.received());
        if size.is_some_and(|size| size > left) {
            return Err(ProgramError::Address);
        }
        Ok(())
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), ProgramError> {
        let place = self.place.as_mut().ok_or(ProgramError::NotCleared)?;
        Ok(place.install.append(&mut self.kept.flash, bytes)?)
    }

    fn commit(&mut self) -> Result<(), ProgramError> {
        let place = self.place.as_mut().ok_or(ProgramError::NotCleared)?;
        place.install.finish()?;
        place.whole = true;
        Ok(())
    }

    fn discard(&mut self) {
        self.place = None;
    }

    fn held(&self) -> Option<Held> {
        let install = &self.place.as_ref()?.install;
        Some(Held {
            crc: install.header()?.crc,
            identity: install.identity()?,
            bytes: install.received(),
        })
    }

    fn activate(&mut self) -> Result<Progress, ProgramError> {
        let place = self.place.as_mut().filter(|place| place.whole);
        let place = place.ok_or(ProgramError::NoProgram)?;
        let header = place.install.header().ok_or(ProgramError::NoProgram)?;
        match place.steps {
            0 => {
                place.steps = header.length.div_ceil(STEP).saturating_add(CURVE);
                self.verification.begin();
                return Ok(Progress::More);
            }
            1 => {}
            more => {
                place.steps = more - 1;
                return Ok(Progress::More);
            }
        }
        let (build, slot) = (self.kept.build, place.install.slot());
        let found = self
            .verification
            .outcome(&mut self.kept.flash, slot, build.hardware);
        let Some(sound) = found else {
            return Ok(Progress::More);
        };
        place.steps = 0;
        if !sound {
            return Err(match header.signature {
                Signature::None => ProgramError::Damaged,
                Signature::Ed25519 => ProgramError::Signature,
            });
        }
        put_on_trial(&mut self.kept.flash, build.layout, build.running.other())?;
        Ok(Progress::Done)
    }

    fn running(&mut self) -> Running {
        let header = self.running_header();
        Running {
            hardware: self.kept.build.hardware,
            version: header.map_or(0, |header| header.version.0),
            crc: header.map_or(0, |header| header.crc),
            slot: self.kept.build.running as u8,
            // Who can't read the marks can't confirm either.
            confirmation: self.confirmation().unwrap_or(Confirmation::Trial),
        }
    }

    fn confirm(&mut self) -> Result<(), ProgramError> {
        let build = self.kept.build;
        confirm(&mut self.kept.flash, build.layout, build.running)?;
        Ok(())
    }
}
