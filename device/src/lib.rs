//! The instrument: sensor driver, channel and node, without a board and without a bus.
//!
//! In: an `embedded-hal` SPI device and delay, data-ready edges with their capture time, and the
//! peer's reading. Out: readings and verdicts. The world is reached through those traits only, so
//! the same code runs on the chip, in emulation and in the simulation, bit for bit.
//!
//! This is the only crate in which the leaves meet: `tilt`, `canopen` and `flash`.
#![no_std]

pub mod bit_rate;
pub mod black_box;
pub mod calibration;
pub mod channel;
pub mod device;
pub mod exchange;
pub mod factory;
pub mod fault;
pub mod fault_log;
pub mod instrument;
pub mod mailboxes;
pub mod memory;
pub mod objects;
pub mod pair;
pub mod peer_clock;
pub mod presentation;
pub mod profile;
pub mod program;
pub mod records;
pub mod sensor;
