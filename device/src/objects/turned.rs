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
pub const TURNED: [[Row; 4]; 2] = [
    told(
        0x202B,
        "Turn sent",
        "How far the gyroscope has turned, for the other channel, sent at each SYNC.",
        true,
    ),
    told(
        0x202C,
        "Turn received",
        "The same, received from the other channel; mapped into RPDO 3 as delivered.",
        false,
    ),
];

/// One object: sent, and so for a TPDO, or else received.
const fn told(index: u16, name: &'static str, doc: &'static str, is_sent: bool) -> [Row; 4] {
    [
        record(index, 5, name, doc),
        mapped(
            member(index, 1, "Turned about X", Integer16, ANGLE),
            is_sent,
        )
        .to(3)
        .unit(STEP),
        mapped(
            member(index, 4, "Capture time", Unsigned8, CAPTURED),
            is_sent,
        )
        .unit("2 ms"),
        mapped(member(index, 5, "Activity", Unsigned8, ACTIVITY), is_sent),
    ]
}

const fn mapped(row: Row, is_sent: bool) -> Row {
    if is_sent { row.tpdo() } else { row.rpdo() }
}

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
