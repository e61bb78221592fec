//! Real recordings in, clean samples, standstill poses and a calibration out.
//!
//! In: one CSV file per channel (plain or gzip). Out: a [`recording::Recording`] of checked
//! samples with every skipped row counted, the [`segments::Segment`]s in which the sensor stood
//! still, a [`calibrate::Fit`] from them, and the [`calibration_file::CalibrationFile`] that keeps
//! it. Turning the samples through the signal chain and writing the report is left to the verb.
#![allow(dead_code, reason = "the verb `replay` uses these")]

pub mod calibrate;
pub mod calibration_file;
pub mod columns;
pub mod lines;
pub mod recording;
pub mod recording_error;
pub mod reference;
pub mod rotation;
pub mod scale;
pub mod segments;
pub mod skips;
pub mod windows;

#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod real;
