//! What the nodes of an instrument with a gyroscope tell each other of it: 202Bh and 202Ch.
//!
//! In: how far this channel has turned, as it is told at a SYNC, and what the other one has told.
//! Out: the rows; TPDO 7 and RPDO 3 (`pdo`) carry them.
//!
//! Left out: the rest of the exchange, which every instrument has (2010h and 2011h).

use canopen::object::DataType::{Integer16, Unsigned8};
use canopen::object::{Address, Number, Value};

use super::build::{member, record};
use super::row::Row;
use crate::exchange::ToldTurn;

/// The rows of both objects.
pub const TURNED: &[Row] = &[
    record(
        0x202B,
        5,
        "Turn sent",
        "How far the gyroscope has turned, for the other channel, sent at each SYNC.",
    ),
    member(0x202B, 1, "Turned about X", Integer16, ANGLE)
        .to(3)
        .tpdo()
        .unit(STEP),
    member(0x202B, 4, "Capture time", Unsigned8, CAPTURED)
        .tpdo()
        .unit("2 ms"),
    member(0x202B, 5, "Activity", Unsigned8, ACTIVITY).tpdo(),
    record(
        0x202C,
        5,
        "Turn received",
        "The same, received from the other channel; mapped into RPDO 3 as delivered.",
    ),
    member(0x202C, 1, "Turned about X", Integer16, ANGLE)
        .to(3)
        .rpdo()
        .unit(STEP),
    member(0x202C, 4, "Capture time", Unsigned8, CAPTURED)
        .rpdo()
        .unit("2 ms"),
    member(0x202C, 5, "Activity", Unsigned8, ACTIVITY).rpdo(),
];

const STEP: &str = "2^-18 of a circle";

const ANGLE: &str = "About the housing's axes X, Y, Z since the start, by this channel's \
     calibration; wraps. All three at -32768: there is none.";

const CAPTURED: &str = "The instant of the SYNC, low byte.";

const ACTIVITY: &str = "Energy of the rate from sample to sample since the SYNC before, in eighths \
     of an octave: 64 is the part's own noise, 0 too few samples, 255 a gap.";

/// A row of either.
pub(super) fn read(told: &ToldTurn, sub: u8) -> Option<Number> {
    Some(match sub {
        4 => Number::u8(told.captured),
        5 => Number::u8(told.activity),
        _ => Number::i16(*told.angle.get(usize::from(sub).wrapping_sub(1))?),
    })
}

/// A row that an RPDO has brought.
pub(super) fn receive(told: &mut ToldTurn, at: Address, value: Value) {
    match at.sub {
        4 => told.captured = value.unsigned() as u8,
        5 => told.activity = value.unsigned() as u8,
        _ => {
            if let Some(axis) = told.angle.get_mut(usize::from(at.sub).wrapping_sub(1)) {
                *axis = value.signed_32() as i16;
            }
        }
    }
}
