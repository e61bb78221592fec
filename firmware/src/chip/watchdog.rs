//! The independent watchdog: about a second without a sign of life resets the chip (RM0008 19).
//!
//! Its clock is 30 to 60 kHz (data sheet, LSI), so the nominal 1.2 s are 0.8 s to 1.6 s. The
//! longest time that the processor may stand still is the erase of a page, 40 ms (data sheet,
//! flash).

use stm32f1xx_hal::pac::IWDG;
use stm32f1xx_hal::prelude::*;
use stm32f1xx_hal::watchdog::IndependentWatchdog;

/// Nominal time, at 40 kHz.
const PERIOD_MS: u32 = 1_200;

/// KR: reload the counter (RM0008 19.4.1).
const RELOAD: u16 = 0xAAAA;

/// Starts it; nothing but a reset ends it.
pub fn start(watchdog: IWDG) {
    IndependentWatchdog::new(watchdog).start(PERIOD_MS.millis());
}

/// A sign of life.
pub fn feed() {
    // SAFETY: the block of IWDG is at this address for ever, and its registers are cells that
    // allow shared access.
    let registers = unsafe { &*IWDG::ptr() };
    super::register::write(registers.kr(), RELOAD);
}
