//! Sensor counts in, angle or a reason out: the inclinometer's signal chain in integers.
//!
//! Data flows one way, and each stage has its own type with its unit in the documentation:
//!
//! ```text
//! Counts -> Filtered -> Compensated -> Corrected -> Angle -> Reading -> Verdict
//!  sample    filter     temperature     vector      angle     chain    cross_check
//!                            \--------- table ------/
//! ```
//!
//! Beside it stands `motion`: the vertical while the machine moves, from a gyroscope and the
//! corrected acceleration. `rate` corrects what its gyroscope measures.
//!
//! No I/O, no clock, no statics, no allocation: samples and times are arguments, configuration is
//! an immutable value, state is handed in. The same samples give the same bits on the host and on
//! a Cortex-M3. Floating point appears only where calibrations are fitted (`calibration`) and at
//! the edges (`Angle::degrees`), never in the path of a sample.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod angle;
pub mod calibration;
pub mod chain;
pub mod composition;
pub mod cross_check;
pub mod filter;
pub mod fusion;
pub mod health;
pub mod motion;
pub mod observation;
pub mod rate;
mod root;
pub mod sample;
mod saturate;
pub mod table;
pub mod temperature;
pub mod turned;
pub mod uncertainty;
pub mod vector;

/// One g in the chain's unit of acceleration: 2^-26 g per step.
pub const ONE_G: i32 = 1 << 26;
