//! The bench without a bus: virtual instruments tested, recordings of sensors replayed.
//!
//! In: what to build and test, or files with samples of real sensors. Out: tables, and a report as
//! a page and as JSON. [`demo`] repeats the paper's tests on virtual instruments, [`recordings`]
//! puts samples through the instrument's own chain, `report` is what both show.
//!
//! Left out: anything on a bus.

pub mod demo;
mod error;
pub mod recordings;
mod report;

pub use error::Error;
