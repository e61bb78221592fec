//! The end of a bootloader: the image that it has found whole, or none.
//!
//! In: where the vectors of the image are, or why there is none. Out: nothing comes back.

use cortex_m::peripheral::SCB;
use flash::slots::NoStart;

use super::trap;
use crate::crash::Crash;

/// Starts the program whose vector table is at `vectors`, with that table in force.
///
/// # Safety
/// A whole image is linked to this place: its vector table stands at this address, aligned to 512.
/// No interrupt was switched on before.
pub unsafe fn start(vectors: u32) -> ! {
    // SAFETY: the caller's promise.
    unsafe {
        (*SCB::PTR).vtor.write(vectors);
        cortex_m::asm::bootload(vectors as *const u32)
    }
}

/// Leaves the chip to the watchdog, which resets it after a second: what reads wrongly once may
/// read right then, and a debug probe finds the processor standing still most of the time.
///
/// Why nothing was started is told by the first application that does start.
pub fn stay(why: NoStart) -> ! {
    trap::leave(Crash::Stay(why as u8));
    loop {
        cortex_m::asm::wfi();
    }
}
