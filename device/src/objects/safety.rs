//! CANopen Safety: GFC, SRDO parameters and signatures (EN 50325-5), and the safe slopes of
//! CiA 410.
//!
//! In: nothing. Out: the rows. The claim is the protocol, never a performance level.
//!
//! As delivered SRDO 1 is set up to send slopes X and Y with their inverted twins, and SRDO 2 is
//! off. Neither is sent before somebody has checked the signature and written A5h to 13FEh.
//!
//! Left out: how pairs are sent and checked (`canopen::srdo`).

use canopen::object::DataType::{Integer16, Unsigned8, Unsigned16, Unsigned32};

use super::build::{array, member, record, var};
use super::row::Row;

/// 13FEh and 63FEh: the configuration has been checked and is in force.
pub const VALID: u8 = 0xA5;
/// Default of the safeguard cycle time, sub 2 of 1301h and 1302h, in ms.
pub const SCT_MS: u16 = 25;
/// Default of the safety-related validation time, sub 3 of 1301h and 1302h, in ms.
pub const SRVT_MS: u8 = 20;
/// Signatures of SRDO 1 and of SRDO 2 as delivered, each for channel A and channel B.
pub const SIGNATURES: [[u16; 2]; 2] = [[0x93A3, 0xEFD7], [0x830B, 0x88E9]];
/// Signature over 6200h as delivered.
pub const APPLICATION_SIGNATURE: u16 = 0xEFCB;

/// 1300h and 1301h to 13FFh.
pub const SAFETY: &[Row] = &[
    var(
        0x1300,
        "Global fail-safe command parameter",
        Unsigned8,
        "Whether a GFC (identifier 001h) puts this node into its safe state (EN 50325-5). 0 \
         ignored, 1 obeyed.",
    )
    .rw()
    .stored()
    .limits(0, 1)
    .value(0),
    var(
        0x13FE,
        "Configuration valid",
        Unsigned8,
        "A5h once the SRDO configuration has been checked. Refused while a signature in 13FFh \
         does not fit; any write to 1300h or to an SRDO's parameters makes it invalid \
         (EN 50325-5).",
    )
    .rw()
    .stored()
    .value(0),
    array(
        0x13FF,
        2,
        "Safety configuration signature",
        "Check sums by which a tool confirms what it has configured (EN 50325-5).",
    ),
    member(0x13FF, 1, "SRDO 1 signature", Unsigned16, SIGNATURE)
        .rw()
        .stored()
        .channel(SIGNATURES[0][0] as i64, SIGNATURES[0][1] as i64),
    member(0x13FF, 2, "SRDO 2 signature", Unsigned16, SIGNATURE)
        .rw()
        .stored()
        .channel(SIGNATURES[1][0] as i64, SIGNATURES[1][1] as i64),
    // The index follows the numbering of 6000h; the type is inferred.
    var(
        0x6200,
        "Safety resolution",
        Unsigned16,
        "Unit of the safe slopes: 1, 10, 100 or 1000 (index as in CiA 410, version 2; content \
         inferred).",
    )
    .safety()
    .unit("0.001 deg")
    .limits(1, 1000)
    .value(10),
    slope(0x6210, "Safety slope long16", SLOPE_X),
    slope(
        0x6211,
        "Safety inverted slope long16",
        "6210h with every bit inverted.",
    ),
    slope(0x6220, "Safety slope lateral16", SLOPE_Y),
    slope(
        0x6221,
        "Safety inverted slope lateral16",
        "6220h with every bit inverted.",
    ),
    var(
        0x63FE,
        "Safety application configuration",
        Unsigned8,
        "A5h once 6200h has been checked. Refused while 63FFh does not fit; any change of 6200h \
         makes it invalid.",
    )
    .rw()
    .stored()
    .value(0),
    array(
        0x63FF,
        1,
        "Safety application configuration signature",
        "Check sum by which a tool confirms the parameters of the safe slopes.",
    ),
    member(
        0x63FF,
        1,
        "Signature",
        Unsigned16,
        "CRC-16-CCITT (start 0) over the two bytes of 6200h, lowest first. Only the right value \
         can be written.",
    )
    .rw()
    .stored()
    .value(APPLICATION_SIGNATURE as i64),
];

/// Communication parameters of the SRDOs. The second one stands ready to take the other
/// channel's first.
pub const SRDO: [[Row; 7]; 2] = [
    parameter(
        0x1301,
        "SRDO 1 communication parameter",
        1,
        [(0x101, 0x103), (0x102, 0x104)],
    ),
    parameter(
        0x1302,
        "SRDO 2 communication parameter",
        0,
        [(0x103, 0x101), (0x104, 0x102)],
    ),
];

/// Mapping of SRDO 1: safe slopes X and Y, each followed by its inverted twin.
pub const SRDO_1_MAPPING: [Row; 6] = mapping(
    0x1381,
    "SRDO 1 mapping parameter",
    &[0x6210_0010, 0x6211_0010, 0x6220_0010, 0x6221_0010],
);
/// Mapping of SRDO 2: empty.
pub const SRDO_2_MAPPING: [Row; 2] = mapping(0x1382, "SRDO 2 mapping parameter", &[]);

const fn slope(index: u16, name: &'static str, doc: &'static str) -> Row {
    var(index, name, Integer16, doc)
        .srdo()
        .unit("6200h x 0.001 deg")
}

/// Identifiers as (channel A, channel B): plain, then inverted.
const fn parameter(
    index: u16,
    name: &'static str,
    direction: i64,
    identifiers: [(i64, i64); 2],
) -> [Row; 7] {
    let [plain, inverted] = identifiers;
    [
        record(
            index,
            6,
            name,
            "How this SRDO is sent or checked (EN 50325-5).",
        ),
        member(index, 1, "Information direction", Unsigned8, DIRECTION)
            .safety()
            .limits(0, 2)
            .value(direction),
        member(index, 2, "Refresh time or SCT", Unsigned16, REFRESH)
            .safety()
            .unit("ms")
            .limits(1, 0xFFFF)
            .value(SCT_MS as i64),
        member(index, 3, "SRVT", Unsigned8, VALIDATION)
            .safety()
            .unit("ms")
            .limits(1, 0xFF)
            .value(SRVT_MS as i64),
        member(
            index,
            4,
            "Transmission type",
            Unsigned8,
            "254 is the only one.",
        )
        .safety()
        .limits(254, 254)
        .value(254),
        member(
            index,
            5,
            "COB-ID 1",
            Unsigned32,
            "Identifier of the plain half, odd.",
        )
        .safety()
        .limits(0x101, 0x17F)
        .channel(plain.0, plain.1),
        member(
            index,
            6,
            "COB-ID 2",
            Unsigned32,
            "Identifier of the inverted half: one more.",
        )
        .safety()
        .limits(0x102, 0x180)
        .channel(inverted.0, inverted.1),
    ]
}

/// The count, one row per object that is mapped as delivered, and one for the empty places. The
/// count has no limits here, since too high a one has an abort code of its own (0604 0042h).
const fn mapping<const ROWS: usize>(index: u16, name: &'static str, mapped: &[u32]) -> [Row; ROWS] {
    let empty = member(index, 1, "Mapped object", Unsigned32, MAPPED)
        .to(16)
        .safety()
        .value(0);
    let mut rows = [empty; ROWS];
    rows[0] = record(index, 16, name, COUNT)
        .safety()
        .value(mapped.len() as i64);
    let mut i = 0;
    while i < mapped.len() {
        rows[i + 1] = empty.value(mapped[i] as i64);
        rows[i + 1].sub = i as u8 + 1;
        rows[i + 1].last = i as u8 + 1;
        i += 1;
    }
    rows[ROWS - 1].sub = mapped.len() as u8 + 1;
    rows
}

const SIGNATURE: &str = "CRC-16-CCITT (start 0) over the SRDO's parameters. Only the right value \
     can be written.";
const SLOPE_X: &str = "Slope X for SRDOs: as measured, without preset and offsets.";
const SLOPE_Y: &str = "Slope Y for SRDOs: as measured, without preset and offsets.";
const DIRECTION: &str = "0: off. 1: this node sends it. 2: this node receives it.";
const REFRESH: &str = "Sending: time between two pairs. Receiving: longest time between two \
     pairs, and from entering OPERATIONAL to the first one.";
const VALIDATION: &str = "Receiving: longest time between the two halves of a pair.";
const COUNT: &str = "Number of mapped objects, plain ones and inverted ones together: 0 to 16, \
     even. Write 0 before changing them.";
const MAPPED: &str = "Odd sub-index: plain, even: its inverted twin. Index in the upper half, then \
     sub-index, then length in bit.";
