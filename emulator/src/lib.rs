//! The exact images of boot and application on a register-level STM32F103, in the simulated world.
//!
//! In: ELF files. Out: boards that are nodes of a [`sim::network::Network`], beside host builds of
//! the same device or instead of them; counts of instructions; the flash as cuts have left it.
//!
//! A [`board::Board`] has a chip, a sensor and a port on the bus. Its [`machine::Machine`] runs a
//! core ([`cpu`], [`cortex_m3`]) with a [`chip`] around it and takes exceptions ([`exceptions`]).
//! One instruction is one cycle: budgets of time cannot be proved so, instructions are counted
//! exactly.

pub mod board;
pub mod build;
pub mod chip;
pub mod code;
pub mod cortex_m3;
pub mod cost;
pub mod cpu;
pub mod cuts;
pub mod download;
pub mod exceptions;
pub mod image;
pub mod machine;
pub mod pair;
pub mod stopwatch;
