//! Calibrations as Python has them: bytes as a node stores them, files of `plumb replay`, or none.
//!
//! In: what was given as a calibration. Out: a [`Calibration`] of the chain, or one sentence on why
//! it is none. Bytes are those of object 2061h, which `docs/calibration-report.md` has as well.

use std::path::{Path, PathBuf};

use bench::recordings::load_calibrations;
use device::calibration::encoding::{self, DecodeError};
use pyo3::prelude::*;
use tilt::chain::Calibration;

use crate::error::said;

/// What a chain may be calibrated by.
#[derive(FromPyObject)]
pub enum Given {
    /// As a node stores it.
    Bytes(Vec<u8>),
    /// A file of `plumb replay --save-calibration`.
    File(PathBuf),
}

/// The calibration of this channel, counted from 0; bytes have one channel.
///
/// Errors: the file can't be read or has fewer channels, or the bytes are no calibration.
pub fn of(given: &Given, channel: usize) -> PyResult<Calibration> {
    match given {
        Given::Bytes(bytes) => from_bytes(bytes).map_err(said),
        Given::File(path) => from_file(path, channel),
    }
}

fn from_file(path: &Path, channel: usize) -> PyResult<Calibration> {
    let mut all = load_calibrations(path).map_err(said)?;
    let has = all.len();
    if channel >= has {
        let file = path.display();
        return Err(said(format!(
            "{file} has {has} channels, counted from 0: there is no {channel}"
        )));
    }
    Ok(all.swap_remove(channel))
}

fn from_bytes(bytes: &[u8]) -> Result<Calibration, String> {
    let mut calibration = Calibration::NOMINAL;
    let mut read = |offset: u32, into: &mut [u8]| {
        let rest = bytes.get(offset as usize..).unwrap_or_default();
        let size = rest.len().min(into.len());
        into.iter_mut()
            .zip(rest)
            .for_each(|(into, byte)| *into = *byte);
        size
    };
    let decoded = encoding::decode_into(&mut calibration, &mut read);
    decoded.map_err(|why| format!("these bytes are no calibration of a node: {}", words(why)))?;
    Ok(calibration)
}

const fn words(why: DecodeError) -> &'static str {
    match why {
        DecodeError::Truncated => "they end early",
        DecodeError::Magic => "they do not begin with PLMC",
        DecodeError::Version => "they are of a later version than this program reads",
        DecodeError::Length => "their length is not the one that they state",
        DecodeError::CheckSum => "their check sum is wrong",
        DecodeError::Kind => "they have a stage that is unknown to this program",
        DecodeError::Knots => "the temperatures of their model do not rise",
        DecodeError::Table(..) => "the points of an axis are no table",
        DecodeError::Matrix => "their matrix confuses two directions",
        DecodeError::Offset => "they have an offset of 2 g or more",
        DecodeError::Harmonics => "they have a harmonic of more than 5 deg",
        DecodeError::NoGyroscope => "they are of an instrument with a gyroscope",
        DecodeError::Rates => "no gyroscope has the errors that they state",
    }
}

/// The bytes of a calibration, as a node stores them.
pub fn bytes_of(calibration: &Calibration) -> Vec<u8> {
    let mut bytes = vec![0; encoding::length(calibration) as usize];
    encoding::read_at(calibration, 0, &mut bytes);
    bytes
}
