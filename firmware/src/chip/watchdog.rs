//! The independent watchdog: about a second without a sign of life resets the chip (RM0008 19).
//!
//! Its clock is 30 to 60 kHz (data sheet, LSI), so the nominal 1.2 s are 0.8 s to 1.6 s. The
//! longest time that the processor may stand still is the erase of a page, 40 ms (data sheet,
//! flash).

use stm32f1xx_hal::pac::IWDG;
use stm32f1xx_hal::pac::iwdg::RegisterBlock;

use super::register::write;

/// KR: start; reload the counter; let PR and RLR be written (RM0008 19.4.1).
const START: u16 = 0xCCCC;
/// See [`START`].
const RELOAD: u16 = 0xAAAA;
/// See [`START`].
const ACCESS: u16 = 0x5555;

/// PR: the clock divided by 16.
const BY_16: u16 = 2;
/// RLR: 3000 counts of 16 / 40 kHz are 1.2 s.
const COUNTS: u16 = 3000 - 1;

fn registers() -> &'static RegisterBlock {
    // SAFETY: the block of IWDG is at this address for ever, and its registers are cells that
    // allow shared access.
    unsafe { &*IWDG::ptr() }
}

/// Starts it; nothing but a reset ends it.
pub fn start(_: IWDG) {
    let watchdog = registers();
    write(watchdog.kr(), ACCESS);
    write(watchdog.pr(), BY_16);
    write(watchdog.rlr(), COUNTS);
    write(watchdog.kr(), START);
    // The first round is of the new length too only if it is loaded.
    write(watchdog.kr(), RELOAD);
}

/// A sign of life.
pub fn feed() {
    write(registers().kr(), RELOAD);
}
