//! The model of a part of medium density, whose pages are half of a
//! [`PAGE`](crate::layout::PAGE).
//!
//! In and out: as [`Nor`], but for the size of what is erased.

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use super::{Draw, Nor, NorError, Page};
use crate::layout::HALF_PAGE;

/// A flash that erases pages of [`HALF_PAGE`].
#[derive(Clone, Debug)]
pub struct Medium<P, D>(pub Nor<P, D>);

impl<P, D> ErrorType for Medium<P, D> {
    type Error = NorError;
}

impl<P: AsRef<[Page]> + AsMut<[Page]>, D: Draw> ReadNorFlash for Medium<P, D> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorError> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<P: AsRef<[Page]> + AsMut<[Page]>, D: Draw> NorFlash for Medium<P, D> {
    const WRITE_SIZE: usize = 2;
    const ERASE_SIZE: usize = HALF_PAGE as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorError> {
        let mut pages = (from..to).step_by(Self::ERASE_SIZE);
        pages.try_for_each(|page| self.0.erase_half(page))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorError> {
        self.0.write(offset, bytes)
    }
}
