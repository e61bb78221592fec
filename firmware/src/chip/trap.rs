//! Where a program ends that must not go on: it records why, and resets the chip.
//!
//! In: panics, hard faults, interrupts without a handler. Out: a [`Crash`] in the last bytes of the
//! RAM. They are outside every stack and every static of bootloader and application, so that what
//! one program leaves there the next one finds, whichever it is.

use core::panic::PanicInfo;
use core::ptr::{read_volatile, write_volatile};

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};

use crate::crash::{Crash, WORDS, hash};

unsafe extern "C" {
    /// The end of the stack. The 32 bytes behind it are the last of the RAM and nobody's; see
    /// `build.rs`.
    static _stack_start: u32;
}

/// Where the words stand.
fn cell() -> *mut [u32; WORDS] {
    (&raw const _stack_start).cast_mut().cast()
}

/// Keeps the reason and resets the chip.
pub fn end(crash: Crash) -> ! {
    leave(crash);
    SCB::sys_reset()
}

/// Keeps the reason for the next program.
pub fn leave(crash: Crash) {
    // SAFETY: these bytes are RAM of the part, aligned, and nothing else is placed there.
    unsafe { write_volatile(cell(), crash.encode()) };
}

/// Takes out why the program before has ended; `None` when it was not by itself.
pub fn take() -> Option<Crash> {
    // SAFETY: as above; any bits are words.
    let words = unsafe { read_volatile(cell()) };
    // SAFETY: as above.
    unsafe { write_volatile(cell(), [0; WORDS]) };
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
