//! Programs in the slot that does not run.
//!
//! In: the calls of [`ProgramMemory`]. Out: an image in the free slot, activated when asked.
//!
//! Left out: the check of the signature.

use embedded_storage::nor_flash::NorFlash;
use flash::Progress;
use flash::image::{ImageError, Version, header};
use flash::install::{Install, InstallError, Rules};
use flash::slots::activate;

use super::FlashMemory;
use crate::program::{ProgramError, ProgramMemory};

impl From<InstallError> for ProgramError {
    fn from(error: InstallError) -> Self {
        match error {
            InstallError::NoSlot | InstallError::Unconfirmed | InstallError::Unsigned => {
                Self::Secured
            }
            InstallError::NotErased => Self::NotCleared,
            InstallError::Image(ImageError::Access(_)) | InstallError::Access(_) => Self::Write,
            InstallError::Image(ImageError::Length(_)) => Self::Address,
            InstallError::Image(ImageError::Body) => Self::Damaged,
            InstallError::Image(_) | InstallError::Downgrade(_) => Self::UnknownFormat,
            InstallError::TooLong | InstallError::Incomplete => Self::Damaged,
        }
    }
}

impl<F: NorFlash> FlashMemory<F> {
    fn rules(&mut self) -> Rules {
        let (layout, hardware) = (self.build.layout, self.build.hardware);
        let running = layout.slot(self.build.running);
        let running = running.and_then(|slot| header(&mut self.flash, slot, hardware).ok());
        Rules {
            hardware,
            running: running.map_or(Version(0), |header| header.version),
            downgrade: false,
            unsigned: true,
        }
    }
}

impl<F: NorFlash> ProgramMemory for FlashMemory<F> {
    fn erase(&mut self) -> Result<(), ProgramError> {
        let rules = self.rules();
        let (layout, running) = (self.build.layout, self.build.running);
        let mut install = Install::new(&mut self.flash, layout, running, rules)?;
        while install.erase(&mut self.flash)? == Progress::More {}
        self.install = Some(install);
        Ok(())
    }

    fn begin(&mut self, size: Option<u32>) -> Result<(), ProgramError> {
        let install = self.install.as_ref().ok_or(ProgramError::NotCleared)?;
        if size.is_some_and(|size| size > install.slot().length) {
            return Err(ProgramError::Address);
        }
        Ok(())
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), ProgramError> {
        let install = self.install.as_mut().ok_or(ProgramError::NotCleared)?;
        Ok(install.append(&mut self.flash, bytes)?)
    }

    fn commit(&mut self) -> Result<(), ProgramError> {
        let install = self.install.as_mut().ok_or(ProgramError::NotCleared)?;
        install.finish(&mut self.flash)?;
        Ok(())
    }

    fn discard(&mut self) {
        self.install = None;
    }

    fn activate(&mut self) -> Result<(), ProgramError> {
        let build = self.build;
        let free = build.running.other();
        let activated = activate(&mut self.flash, build.layout, free, build.hardware);
        activated.map(drop).map_err(|_| ProgramError::Write)
    }

    fn crc(&mut self) -> u32 {
        let installed = self.install.as_ref().and_then(|install| install.header());
        if let Some(header) = installed {
            return header.crc;
        }
        let slot = self.build.layout.slot(self.build.running);
        let running = slot.map(|slot| header(&mut self.flash, slot, self.build.hardware));
        running.map_or(0, |running| running.map_or(0, |header| header.crc))
    }
}
