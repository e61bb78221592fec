//! The 32-deep FIFO: three output pairs per level.
//!
//! In: FIFO_CTRL. Out: what it asks for, and the ring that it is asked of.

pub(super) use crate::spi_part::FifoMode;

/// Levels of the FIFO (data sheet).
pub const DEPTH: usize = 32;

/// The FIFO: six output bytes a level, X low to Z high.
pub(super) type Fifo = crate::spi_part::Fifo<[u8; 6], DEPTH>;

/// Decodes FMODE, bits 7..5 of FIFO_CTRL.
///
/// The two modes that wait for an event stay in the state before it, since the model has no
/// events: continuous-to-FIFO is continuous and bypass-to-continuous is bypass.
pub(super) fn decode(fifo_ctrl: u8) -> FifoMode {
    match fifo_ctrl >> 5 {
        0b001 => FifoMode::StopWhenFull,
        0b011 | 0b110 => FifoMode::Continuous,
        _ => FifoMode::Bypass,
    }
}
