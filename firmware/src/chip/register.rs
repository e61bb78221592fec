//! Writing a whole register at once, by the names that RM0008 gives its bits.
//!
//! The access crate has a method for each field, and calls every write of a whole register unsafe,
//! because it cannot check which of them may break what the compiler relies on.

use stm32f1::{Reg, RegisterSpec, Resettable, Writable};

/// Writes `bits` to a register of the timer, the CAN, SPI or flash controller, or the clocks.
pub fn write<R>(register: &Reg<R>, bits: R::Ux)
where
    R: RegisterSpec + Resettable + Writable,
{
    // SAFETY: none of these peripherals moves memory by itself (no DMA is used anywhere), so no
    // value of their registers can break what the compiler relies on. The flash controller alone
    // changes memory that the program reads; `nor` states why what it changes is no program.
    register.write(|w| unsafe { w.bits(bits) });
}
