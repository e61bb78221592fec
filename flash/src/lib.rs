//! What survives a power cut: the flash map, the image header, the slots and the records.
//!
//! In: the chip's flash as `embedded_storage::nor_flash::NorFlash`, the bytes to keep, and the
//! content of both slots. Out: what was kept, whole or not at all, which image to start, and a
//! typed reason where there is nothing to give.
//!
//! Everything is written by one rule: a half-word is programmed once after its page was erased,
//! and what counts is written last. A loss of supply in the middle of any operation therefore
//! leaves the old state or the new one. Every write is read back.
//!
//! No I/O but through that trait, no clock, no heap, no statics, no `unsafe`, no panicking path.
//! [`nor`] is a model of the chip's flash for tests and for the simulation.
//!
//! Left out: the flash controller, what the bytes mean, and the check of the signature.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod access;
pub mod banks;
pub mod check_sum;
pub mod image;
pub mod install;
pub mod layout;
pub mod nor;
pub mod records;
pub mod seal;
pub mod slots;

/// Whether a job that is done in steps is finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// There is more to do: call again.
    More,
    /// Nothing is left to do.
    Done,
}
