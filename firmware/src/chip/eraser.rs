//! What erases records in the paper's image: the bootloader, and nothing else (R10).
//!
//! In: the seal at the end of the bootloader's region ([`flash::seal`]). Out: for the bootloader,
//! the function and [`SEAL`]; for the application, [`Lent`], by which a
//! [`Nor`](super::nor::Nor) asks for an erase. The function has no statics, and its stack is the
//! caller's. It erases a page of the records and refuses every other, whoever asks.
//!
//! An eraser that is missing, damaged or of another version erases nothing: the store is refused,
//! and the device tells of it as of any memory that does not do its part.

use flash::layout::Layout;
use flash::seal::{self, CALLS};

use super::nor::{self, Erase, Reader};
use crate::guard::{NorError, is_of_records};
use crate::part::PAPER;

/// Erases the page of the chip at this offset of the flash; whether it was done.
type Call = extern "C" fn(u32) -> bool;

/// What stands at the end of the bootloader's region; the check sum comes behind it.
#[repr(C)]
pub struct Seal {
    magic: u32,
    calls: [Call; CALLS],
    state: u32,
}

/// The bootloader's seal.
pub const SEAL: Seal = Seal {
    magic: seal::ERASER,
    calls: [erase; CALLS],
    state: 0,
};

extern "C" fn erase(offset: u32) -> bool {
    let end = offset.saturating_add(PAPER.chip_page);
    is_of_records(&PAPER, offset) && nor::erase(&PAPER, offset, end).is_ok()
}

/// Erases by the bootloader's function.
pub struct Lent;

impl Erase for Lent {
    const LAYOUT: &'static Layout = &PAPER;

    fn erase(from: u32, to: u32) -> Result<(), NorError> {
        let found = seal::Seal::find(&mut Reader(&PAPER), PAPER.boot, seal::ERASER);
        let [at, ..] = found.map_err(|_| NorError::Eraser)?.calls;
        // SAFETY: the region's check sum is right, so this is the function that was linked into
        // the seal, of the type that its version stands for.
        let erase = unsafe { core::mem::transmute::<usize, Call>(at as usize) };
        let mut pages = (from..to).step_by(PAPER.chip_page as usize);
        match pages.all(|page| erase(page)) {
            true => Ok(()),
            false => Err(NorError::Eraser),
        }
    }
}
