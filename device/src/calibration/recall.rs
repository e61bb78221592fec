//! The calibration after a start: the user's own, or else the one that the part was delivered with.
//!
//! In: the record store. Out: the calibration, made in its place, and which one it is. Reads no
//! clock and takes no other room, so it is also the way back when a new calibration came to
//! nothing.
//!
//! Left out: when a calibration may change, and what follows for the readings.

use tilt::chain::Calibration;
use tilt::composition::Composition;

use super::encoding::{decode_into, length, read_at};
use crate::records::{Record, RecordStore, StoreError};

/// Bytes handed to the memory at a time.
const PIECE: usize = 32;

/// What came back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recalled {
    /// It is this part's own; otherwise [`Calibration::NOMINAL`].
    pub calibrated: bool,
    /// One is stored and cannot be read, so that the one delivered had to take its place.
    pub damaged: bool,
}

/// Reads the calibration of this part into `calibration`.
///
/// Takes the place of what was there; errors are all in the answer.
pub fn recall<M: RecordStore, C: Composition>(
    memory: &mut M,
    calibration: &mut Calibration<C>,
) -> Recalled {
    let stored = memory.read(Record::Calibration, 0, &mut [0]) != 0;
    let whole = stored && decode(memory, Record::Calibration, calibration);
    let calibrated = whole || decode(memory, Record::Delivered, calibration);
    if !calibrated {
        calibration.reset();
    }
    Recalled {
        calibrated,
        damaged: stored && !whole,
    }
}

fn decode<M: RecordStore, C: Composition>(
    memory: &mut M,
    record: Record,
    calibration: &mut Calibration<C>,
) -> bool {
    decode_into(calibration, &mut |offset, into| {
        memory.read(record, offset, into)
    })
    .is_ok()
}

/// Stages `calibration` for `record`; [`RecordStore::commit`] makes it count.
///
/// Errors: those of the store.
pub fn stage<M: RecordStore, C: Composition>(
    memory: &mut M,
    record: Record,
    calibration: &Calibration<C>,
) -> Result<(), StoreError> {
    memory.begin(record, length(calibration))?;
    let mut offset = 0;
    let mut piece = [0; PIECE];
    loop {
        let count = read_at(calibration, offset, &mut piece);
        let Some(bytes) = piece.get(..count).filter(|bytes| !bytes.is_empty()) else {
            return Ok(());
        };
        memory.append(bytes)?;
        offset = offset.saturating_add(count as u32);
    }
}

/// Stores `calibration` as the one that the part is delivered with: what a factory does once.
///
/// Errors: those of the store.
pub fn deliver<M: RecordStore, C: Composition>(
    memory: &mut M,
    calibration: &Calibration<C>,
) -> Result<(), StoreError> {
    stage(memory, Record::Delivered, calibration)?;
    memory.commit()
}
