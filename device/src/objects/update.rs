//! 2080h: the program that runs, and what has come of another one.
//!
//! In: nothing. Out: the rows. Together with 1F50h to 1F57h they are all that an update needs.
//!
//! Left out: what stands behind them (`program`).

use canopen::object::DataType::{Unsigned8, Unsigned32};

use super::build::{member, record};
use super::row::Row;

/// The rows.
pub const UPDATE: [Row; 7] = [
    record(
        0x2080,
        6,
        "Program",
        "The program that runs, and what has come of another one (1F50h).",
    ),
    member(
        0x2080,
        1,
        "Hardware",
        Unsigned32,
        "Id of the hardware; an image has to name the same.",
    ),
    member(
        0x2080,
        2,
        "Version",
        Unsigned32,
        "Version that runs: major number in the highest byte, minor in the next, then the patch.",
    ),
    member(
        0x2080,
        3,
        "Slot",
        Unsigned8,
        "Slot that it runs in, 0 A or 1 B; an image has to be made for the other one.",
    ),
    member(
        0x2080,
        4,
        "Standing",
        Unsigned8,
        "0: confirmed. 1: on trial. 2: confirmed, and runs because a newer one was not.",
    ),
    member(
        0x2080,
        5,
        "Image under way",
        Unsigned32,
        "CRC-32 over header and signature, bytes 0 to 27 and 32 to 95, of the image of which \
         something has come; 0 for none.",
    ),
    member(
        0x2080,
        6,
        "Bytes held",
        Unsigned32,
        "Bytes of it that are here. Written with the same number after a download was broken off: \
         the next one brings the rest.",
    )
    .rw(),
];
