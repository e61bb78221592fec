//! Where a program ends that must not go on: it says why, and resets the chip.
//!
//! In: panics, hard faults, interrupts without a handler. Out: a [`Crash`] in the last bytes of the
//! RAM. They are outside every stack and every static of bootloader and application, so that what
//! one program leaves there the next one finds, whichever it is.

use core::panic::PanicInfo;
use core::ptr::{read_volatile, write_volatile};

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use flash::layout::RAM;

use crate::crash::{Crash, WORDS, hash};
use crate::part::LAYOUT;

/// Bytes at the end of the RAM that the linker scripts leave free; see `build.rs`.
const CORNER: u32 = 32;

/// Where the words stand.
const CELL: *mut [u32; WORDS] = (RAM + LAYOUT.ram - CORNER) as *mut [u32; WORDS];

/// Keeps the reason and resets the chip.
pub fn end(crash: Crash) -> ! {
    leave(crash);
    SCB::sys_reset()
}

/// Keeps the reason for the next program.
pub fn leave(crash: Crash) {
    // SAFETY: these bytes are RAM of the part, aligned, and nothing else is placed there.
    unsafe { write_volatile(CELL, crash.encode()) };
}

/// Takes out why the program before has ended; `None` when it was not by itself.
pub fn take() -> Option<Crash> {
    // SAFETY: as above; any bits are words.
    let words = unsafe { read_volatile(CELL) };
    // SAFETY: as above.
    unsafe { write_volatile(CELL, [0; WORDS]) };
    Crash::decode(words)
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    let (file, line) = info
        .location()
        .map_or((0, 0), |at| (hash(at.file()), at.line()));
    end(Crash::Panic { file, line })
}

// SAFETY: the handler reads the stacked frame and a status register, and never returns.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    // SAFETY: SCB is at this address for ever; reading CFSR changes nothing.
    let status = unsafe { (*SCB::PTR).cfsr.read() };
    end(Crash::Fault {
        pc: frame.pc(),
        status,
    })
}

// SAFETY: the handler never returns, so that nothing it interrupts goes on.
#[exception]
unsafe fn DefaultHandler(number: i16) -> ! {
    end(Crash::Interrupt(number))
}
