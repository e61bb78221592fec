//! Calibration over the bus, 2060h to 2063h.
//!
//! In: nothing. Out: the rows.
//!
//! Left out: what stands behind them (`streams`).

use canopen::object::DataType::{Domain, Integer32, Unsigned8, Unsigned32};

use super::build::{member, record, var};
use super::manufacturer::{HALF_TURN, MILLIDEGREE};
use super::row::Row;

/// The rows.
pub const CALIBRATION: &[Row] = &[
    var(
        0x2061,
        "Calibration data",
        Domain,
        "The calibration in force, to be kept by a tool or carried to another piece. A new one \
         counts once it is complete, and is refused when its check sum is wrong.",
    )
    .rw(),
    record(
        0x2062,
        2,
        "Calibration identity",
        "Which calibration is in force.",
    ),
    member(
        0x2062,
        1,
        "Check sum",
        Unsigned32,
        "CRC-32 of 2061h without its last \
         four bytes, which hold the same number.",
    ),
    member(
        0x2062,
        2,
        "Kind",
        Unsigned8,
        "0: a table per axis. 1: two slopes by vector. 2: one angle of 360 deg by vector.",
    ),
    var(
        0x2063,
        "Calibration report hash",
        Domain,
        "SHA-256 of the report of the calibration in force, 32 bytes that a tool writes behind \
         2061h. Without one, or with one of another calibration, it reads as no data.",
    )
    .rw(),
];

/// 2060h, the run that makes tables.
pub const MOTOR_RUN: &[Row] = &[
    record(
        0x2060,
        8,
        "Calibration by motor",
        "A motor turns the instrument to known angles, stands still, and the angle is written to \
         sub-index 2; each one becomes a point of the table.",
    ),
    member(
        0x2060,
        1,
        "Command",
        Unsigned8,
        "1 starts X, 2 starts Y, 3 finishes and puts the new table into force, 4 abandons. Reads \
         the last command, 0 for none.",
    )
    .rw()
    .limits(0, 4),
    member(
        0x2060,
        2,
        "Reference angle",
        Integer32,
        "Writing the angle of the motor memorises a point. Refused while the signal has not \
         settled, and for an angle that has a point already.",
    )
    .rw()
    .unit(MILLIDEGREE)
    .limits(-HALF_TURN, HALF_TURN),
    member(
        0x2060,
        3,
        "Calibration state",
        Unsigned8,
        "0 idle, 1 taking X, 2 taking Y.",
    ),
    member(0x2060, 4, "Points X", Unsigned8, "Points memorised."),
    member(0x2060, 5, "Points Y", Unsigned8, "Points memorised."),
    member(
        0x2060,
        6,
        "Last residual",
        Integer32,
        "What the table in force read at the last point, minus the reference.",
    )
    .unit(MILLIDEGREE),
    member(
        0x2060,
        7,
        "Worst residual",
        Unsigned32,
        "The largest residual of this run, without sign.",
    )
    .unit(MILLIDEGREE),
    member(
        0x2060,
        8,
        "Result",
        Unsigned8,
        "0: the last command or point was taken. 1 to 31: no angle, for the reason of 2025h. 32 no \
         run is open, 33 reference beyond +-90 deg, 34 this angle has a point already, 35 too many \
         points, 36 and 37 no table of X or Y, from 40 (X) and 48 (Y): the points make no table.",
    ),
];
