//! The registers of the STM32F103: one module for each thing that the board uses.
//!
//! The timer, the CAN controller, the SPI port, the flash controller and the watchdog are driven
//! through the peripheral access crate, because the ready-made drivers do here what they must not:
//! - `bxcan` waits without bound for the bus when it changes the mode or takes a frame back, so a
//!   bus that is shorted would hold the processor; it switches automatic return from bus-off on,
//!   which is CANopen's policy; and it touches 28 filter banks where this part has 14.
//! - the HAL's SPI reports that it has flushed while the last byte is still on its way, so the
//!   select line would rise too early.
//! - the HAL has no timer that captures and compares at once, and no `NorFlash`; its watchdog
//!   looks for a divider with a panic behind the last one.
//!
//! Clock and pins are the HAL's.

pub mod board;
pub mod can;
pub mod clock;
mod division;
pub mod eraser;
pub mod handover;
mod memory_functions;
pub mod nor;
mod register;
pub mod spi;
pub mod stack;
pub mod trap;
pub mod verifier;
pub mod watchdog;
