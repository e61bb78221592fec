//! The chip's own flash as a `NorFlash`: pages, half-words (RM0008 3.3, PM0075 2.3 and 3).
//!
//! In: offsets from the start of the flash, bytes. Out: nothing, or a [`NorError`]. What was
//! written is not read back here; `flash::access` does that.
//!
//! The code runs from the same flash, so the processor stands still from the start of an erase
//! (20 to 40 ms, data sheet) or of a half-word (40 to 70 us) to its end, interrupts included; the
//! timer goes on and edges of data-ready keep their time, but of frames on the bus only three stay.
//! The watchdog is fed after each page, so that the erase of a slot, two seconds in all, is no end;
//! a single page that took longer than a second would be.
//!
//! What is erased at once is a page of the chip ([`Layout::chip_page`]).
//!
//! What may be written at all is [`Guard`]'s to check; what erases is [`Erase`]'s.

use core::marker::PhantomData;
use core::ptr::{read_volatile, write_volatile};

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use flash::layout::{BASE, Layout, Region};
use stm32f1xx_hal::pac::FLASH;
use stm32f1xx_hal::pac::flash::RegisterBlock;

use super::register::write;
use super::watchdog;
use crate::guard::{Guard, NorError, inside};
use crate::part::LAYOUT;

/// KEYR, in this order (PM0075 2.3.1).
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];
/// CR: program; erase a page; start; locked.
const PG: u32 = 1;
/// See [`PG`].
const PER: u32 = 1 << 1;
/// See [`PG`].
const STRT: u32 = 1 << 6;
/// See [`PG`].
const LOCK: u32 = 1 << 7;
/// SR: busy; the place was not blank; it is write-protected; end of operation.
const BSY: u32 = 1;
/// See [`BSY`].
const PGERR: u32 = 1 << 2;
/// See [`BSY`].
const WRPRTERR: u32 = 1 << 4;
/// See [`BSY`].
const EOP: u32 = 1 << 5;

/// Looks at BSY before an operation counts as lost: more than 100 ms.
const PATIENCE: u32 = 1_000_000;

/// What erases.
pub trait Erase {
    /// The map of the part.
    const LAYOUT: &'static Layout;

    /// Erases the pages of the chip from `from` to `to`, which the guard has let through.
    ///
    /// Errors: see [`NorError`].
    fn erase(from: u32, to: u32) -> Result<(), NorError>;
}

/// Erases by itself, with the flash controller: the product's part.
pub struct Controller;

impl Erase for Controller {
    const LAYOUT: &'static Layout = &LAYOUT;

    fn erase(from: u32, to: u32) -> Result<(), NorError> {
        erase(&LAYOUT, from, to)
    }
}

/// Erases with the flash controller of the part with this map.
pub(super) fn erase(layout: &Layout, from: u32, to: u32) -> Result<(), NorError> {
    let mut pages = (from..to).step_by(layout.chip_page as usize);
    unlocked(|| pages.try_for_each(erase_page))
}

/// The flash. To write it one needs the controller; a [`Reader`] needs nothing.
pub struct Nor<E = Controller> {
    guard: Guard,
    eraser: PhantomData<E>,
}

impl<E: Erase> Nor<E> {
    /// The flash, to read and write, of the program that runs in this slot. There is one: nobody
    /// else may have it.
    pub(super) const fn new(running: Option<Region>) -> Self {
        let layout = E::LAYOUT;
        Self {
            guard: Guard { layout, running },
            eraser: PhantomData,
        }
    }
}

/// The flash of a part with this map, to read only.
pub struct Reader(pub &'static Layout);

fn registers() -> &'static RegisterBlock {
    // SAFETY: the block of FLASH is at this address for ever, and its registers are cells that
    // allow shared access; only the owner of `Nor` writes them.
    unsafe { &*FLASH::ptr() }
}

/// Waits for the end of an operation and returns how it ended.
fn finish() -> Result<(), NorError> {
    let flash = registers();
    for _ in 0..PATIENCE {
        let flags = flash.sr().read().bits();
        if flags & BSY != 0 {
            continue;
        }
        write(flash.sr(), flags & (PGERR | WRPRTERR | EOP));
        return match flags {
            flags if flags & WRPRTERR != 0 => Err(NorError::Protected),
            flags if flags & PGERR != 0 => Err(NorError::NotBlank),
            flags if flags & EOP == 0 => Err(NorError::Stuck),
            _ => Ok(()),
        };
    }
    Err(NorError::Stuck)
}

/// Runs `operation` with the controller unlocked, and locks it again whatever comes of it.
fn unlocked(operation: impl FnOnce() -> Result<(), NorError>) -> Result<(), NorError> {
    let flash = registers();
    if flash.cr().read().bits() & LOCK != 0 {
        for key in KEYS {
            write(flash.keyr(), key);
        }
    }
    let done = if flash.cr().read().bits() & LOCK != 0 {
        Err(NorError::Protected)
    } else {
        // What an operation before has left must not be taken for this one's end.
        write(flash.sr(), PGERR | WRPRTERR | EOP);
        operation()
    };
    write(flash.cr(), LOCK);
    done
}

fn program(offset: u32, half_word: u16) -> Result<(), NorError> {
    write(registers().cr(), PG);
    // SAFETY: the guard has let this through: an even address in the flash, and no part of the
    // running program.
    unsafe { write_volatile((BASE + offset) as *mut u16, half_word) };
    finish()
}

// Out of line, so that an image without it can be told from one with it.
#[inline(never)]
fn erase_page(offset: u32) -> Result<(), NorError> {
    let flash = registers();
    write(flash.cr(), PER);
    write(flash.ar(), BASE + offset);
    write(flash.cr(), PER | STRT);
    // BSY rises a cycle after STRT, so a look at once would find the erase over. ST's errata for
    // the medium-density line (ES096 2.2.8), and those for the low-density and the connectivity
    // line, want an access in between; the high-density line is treated alike.
    let _ = flash.cr().read().bits();
    let done = finish();
    watchdog::feed();
    done
}

fn read(layout: &Layout, offset: u32, into: &mut [u8]) -> Result<(), NorError> {
    inside(layout, offset, into.len(), 1)?;
    for (at, byte) in (BASE + offset..).zip(into) {
        // SAFETY: the address was checked to be in the flash, which can be read byte by byte.
        // Volatile, because the controller changes it behind the compiler's back.
        *byte = unsafe { read_volatile(at as *const u8) };
    }
    Ok(())
}

impl<E> ErrorType for Nor<E> {
    type Error = NorError;
}

impl ErrorType for Reader {
    type Error = NorError;
}

impl ReadNorFlash for Reader {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorError> {
        read(self.0, offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.flash as usize
    }
}

impl<E: Erase> ReadNorFlash for Nor<E> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorError> {
        read(E::LAYOUT, offset, bytes)
    }

    fn capacity(&self) -> usize {
        E::LAYOUT.flash as usize
    }
}

impl<E: Erase> NorFlash for Nor<E> {
    const WRITE_SIZE: usize = 2;
    const ERASE_SIZE: usize = E::LAYOUT.chip_page as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorError> {
        self.guard.erase(from, to, Self::ERASE_SIZE as u32)?;
        E::erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorError> {
        self.guard.program(offset, bytes.len())?;
        let (half_words, _) = bytes.as_chunks::<2>();
        let mut places = (offset..).step_by(2).zip(half_words);
        unlocked(|| places.try_for_each(|(at, bytes)| program(at, u16::from_le_bytes(*bytes))))
    }
}
