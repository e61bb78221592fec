//! The instrument on its chip, an STM32F103: what stands between `device` and the registers.
//!
//! In: interrupts. Out: what `device` wants done, at the time it wants it. Modules of the root
//! use no register and are tested on the host; `chip` is everything that does, and exists in the
//! linked images only, as what uses it does: `image`, `board_node`, `self_check`, `new_program`.
//! The binaries are `boot` and `app`, the product's, and `boot-paper` and `app-paper`, those of the
//! paper's instrument on the paper's part.
//!
//! Left out: every decision about angles, faults and the bus, which is the device's.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod bit_timing;
#[cfg(target_os = "none")]
pub mod board_node;
#[cfg(target_os = "none")]
pub mod chip;
pub mod crash;
pub mod driver;
pub mod factory;
pub mod guard;
#[cfg(target_os = "none")]
pub mod image;
pub mod inbox;
#[cfg(target_os = "none")]
pub mod new_program;
pub mod part;
#[cfg(target_os = "none")]
pub mod self_check;
mod shell;
pub mod ticks;
