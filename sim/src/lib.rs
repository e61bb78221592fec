//! The virtual bench: sensors, motor, chamber, excavator and supply, in virtual time.
//!
//! In: one seed. Out: what the device code, run as it will be flashed, makes of the world. There
//! is no wall clock and no thread in a world, so the same seed gives the same bits; many worlds
//! may run side by side.
//!
//! The world moves in ticks of 1 ms. On each tick a [`motion::Mover`] gives what the housing feels,
//! each part filters that with its own analogue low-pass, samples it by its own clock, adds its
//! errors ([`error_model`]), and raises data-ready; then the device code reads it over SPI from a
//! register-level model ([`lis2dw12`]; [`ism330dhcx`] is the part with a gyroscope). [`instrument`]
//! puts that together, [`mod@bench`] works with it.

pub mod bench;
pub mod bench_node;
pub mod campaign;
pub mod can_bus;
pub mod chamber;
pub mod electronics;
pub mod error_model;
pub mod excavator;
pub mod fault;
pub mod instrument;
pub mod ism330dhcx;
pub mod lis2dw12;
pub mod low_pass;
pub mod memory;
pub mod motion;
pub mod motor;
pub mod network;
pub mod rig;
pub mod rng;
pub mod spi_part;
pub mod supply;
pub mod trial;

/// Length of one tick of the world, s.
pub const TICK_S: f64 = 0.001;
