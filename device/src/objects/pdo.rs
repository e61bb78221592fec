//! PDO parameters, 1400h to 1BFFh, and what the PDOs carry as delivered
//! (CiA 301, 7.5.2.35 to 7.5.2.38).
//!
//! In: nothing. Out: the rows of four RPDOs and four TPDOs, and of three TPDOs more that an
//! instrument with a gyroscope has.
//!
//! - TPDO 1: slopes X and Y in 16 bit with validity and state of the pair, every SYNC.
//! - TPDO 2: validity, state, uncertainty, latency, difference, temperature, every tenth SYNC.
//! - TPDO 3: the angles for the other channel, every SYNC. RPDO 1 takes the other's.
//! - TPDO 4: what is behind them, every SYNC. RPDO 2 takes the other's.
//! - TPDO 5 (gyroscope): angles of the SYNC itself, uncertainty and reasons; off.
//! - TPDO 6 (gyroscope): rates of turn and their reason; off.
//! - TPDO 7 (gyroscope): how far this channel has turned, every SYNC. RPDO 3 takes the other's.
//! - RPDO 3 (without a gyroscope) and 4 are off and empty.
//!
//! Left out: the inhibit time of RPDOs, which the standard gives no effect.

use canopen::object::DataType::{Unsigned8, Unsigned16, Unsigned32};

use super::build::{member, record};
use super::row::{Default, Row};

/// Bit 31 of a COB-ID: the PDO is off.
pub const OFF: i64 = 0x8000_0000;

/// Communication parameters of the RPDOs.
pub const RPDO: [[Row; 4]; 4] = [
    // The other channel's TPDO 3 and 4, with node-ids 1 and 2 as delivered.
    rpdo(
        0x1400,
        "RPDO 1 communication parameter",
        Default::Channel(0x382, 0x381),
    ),
    rpdo(
        0x1401,
        "RPDO 2 communication parameter",
        Default::Channel(0x482, 0x481),
    ),
    rpdo(
        0x1402,
        "RPDO 3 communication parameter",
        Default::NodeId(OFF + 0x400),
    ),
    rpdo(
        0x1403,
        "RPDO 4 communication parameter",
        Default::NodeId(OFF + 0x500),
    ),
];

/// Communication parameters of the TPDOs.
pub const TPDO: [[Row; 6]; 4] = [
    tpdo(0x1800, "TPDO 1 communication parameter", 0x180, 1),
    tpdo(0x1801, "TPDO 2 communication parameter", 0x280, 10),
    tpdo(0x1802, "TPDO 3 communication parameter", 0x380, 1),
    tpdo(0x1803, "TPDO 4 communication parameter", 0x480, 1),
];

/// Mapping of RPDO 1: the other channel's angles and what they are worth.
pub const RPDO_1_MAPPING: [Row; 6] = mapping(
    0x1600,
    "RPDO 1 mapping parameter",
    &[0x2011_0118, 0x2011_0218, 0x2011_0308, 0x2011_0408],
);
/// Mapping of RPDO 2: what is behind them.
pub const RPDO_2_MAPPING: [Row; 7] = mapping(
    0x1601,
    "RPDO 2 mapping parameter",
    &[
        0x2011_0510,
        0x2011_0610,
        0x2011_0710,
        0x2011_0808,
        0x2011_0908,
    ],
);
/// Mapping of RPDO 3: empty.
pub const RPDO_3_MAPPING: [Row; 2] = mapping(0x1602, "RPDO 3 mapping parameter", &[]);
/// Mapping of RPDO 4: empty.
pub const RPDO_4_MAPPING: [Row; 2] = mapping(0x1603, "RPDO 4 mapping parameter", &[]);
/// Mapping of TPDO 1: slope X, slope Y, validity, state.
pub const TPDO_1_MAPPING: [Row; 6] = mapping(
    0x1A00,
    "TPDO 1 mapping parameter",
    &[0x6010_0010, 0x6020_0010, 0x2020_0008, 0x2021_0008],
);
/// Mapping of TPDO 2: validity, state, larger uncertainty, latency, larger difference,
/// temperature.
pub const TPDO_2_MAPPING: [Row; 8] = mapping(
    0x1A01,
    "TPDO 2 mapping parameter",
    &[
        0x2020_0008,
        0x2021_0008,
        0x2022_0310,
        0x2023_0208,
        0x2024_0310,
        0x6511_0008,
    ],
);
/// Mapping of TPDO 3: this channel's angles and what they are worth.
pub const TPDO_3_MAPPING: [Row; 6] = mapping(
    0x1A02,
    "TPDO 3 mapping parameter",
    &[0x2010_0118, 0x2010_0218, 0x2010_0308, 0x2010_0408],
);
/// Mapping of TPDO 4: what is behind them.
pub const TPDO_4_MAPPING: [Row; 7] = mapping(
    0x1A03,
    "TPDO 4 mapping parameter",
    &[
        0x2010_0510,
        0x2010_0610,
        0x2010_0710,
        0x2010_0808,
        0x2010_0908,
    ],
);

/// Communication parameters of TPDO 5 and 6.
///
/// The predefined connection set has identifiers for four TPDOs only. These two are off, so that
/// nothing is sent that a master has not asked for; their identifiers are those that the set has
/// for RPDO 1 and 2, which are free here, since those take the other channel's TPDO 3 and 4.
pub const DYNAMIC_TPDO: [[Row; 6]; 2] = [
    tpdo(0x1804, "TPDO 5 communication parameter", OFF + 0x200, 1),
    tpdo(0x1805, "TPDO 6 communication parameter", OFF + 0x300, 1),
];

/// Communication parameters of TPDO 7, whose identifier is that of RPDO 3, which takes the other
/// channel's TPDO 7.
pub const TPDO_7: [Row; 6] = tpdo(0x1806, "TPDO 7 communication parameter", 0x400, 1);

/// The same of a device that is any instrument: off, since most of them have no gyroscope.
pub const TPDO_7_OFF: [Row; 6] = tpdo(0x1806, "TPDO 7 communication parameter", OFF + 0x400, 1);

/// Communication parameters of RPDO 3 where there is a gyroscope: the other channel's TPDO 7, with
/// node-ids 1 and 2 as delivered.
pub const DYNAMIC_RPDO_3: [Row; 4] = rpdo(
    0x1402,
    "RPDO 3 communication parameter",
    Default::Channel(0x402, 0x401),
);

/// Its mapping: how far the other channel has turned.
pub const DYNAMIC_RPDO_3_MAPPING: [Row; 7] = mapping(
    0x1602,
    "RPDO 3 mapping parameter",
    &[
        0x202C_0110,
        0x202C_0210,
        0x202C_0310,
        0x202C_0408,
        0x202C_0508,
    ],
);

/// Mapping of TPDO 7: how far this channel has turned.
pub const TPDO_7_MAPPING: [Row; 7] = mapping(
    0x1A06,
    "TPDO 7 mapping parameter",
    &[
        0x202B_0110,
        0x202B_0210,
        0x202B_0310,
        0x202B_0408,
        0x202B_0508,
    ],
);

/// Mapping of TPDO 5: angles now, their uncertainty and reasons.
pub const TPDO_5_MAPPING: [Row; 7] = mapping(
    0x1A04,
    "TPDO 5 mapping parameter",
    &[
        0x2029_0110,
        0x2029_0210,
        0x2029_0310,
        0x2029_0408,
        0x2029_0508,
    ],
);

/// Mapping of TPDO 6: three rates and their reason.
pub const TPDO_6_MAPPING: [Row; 6] = mapping(
    0x1A05,
    "TPDO 6 mapping parameter",
    &[0x202A_0110, 0x202A_0210, 0x202A_0310, 0x202A_0408],
);

const fn rpdo(index: u16, name: &'static str, cob_id: Default) -> [Row; 4] {
    let mut first = member(index, 1, "COB-ID used by RPDO", Unsigned32, COB_ID)
        .rw()
        .stored();
    first.default = cob_id;
    [
        record(index, 5, name, "How this RPDO is received."),
        first,
        member(index, 2, "Transmission type", Unsigned8, RPDO_TYPE)
            .rw()
            .stored()
            .value(255),
        member(index, 5, "Event timer", Unsigned16, RPDO_TIMER)
            .rw()
            .stored()
            .unit("ms")
            .value(0),
    ]
}

const fn tpdo(index: u16, name: &'static str, cob_id: i64, transmission: i64) -> [Row; 6] {
    [
        record(index, 6, name, "How this TPDO is sent."),
        member(index, 1, "COB-ID used by TPDO", Unsigned32, COB_ID)
            .rw()
            .stored()
            .node_id(cob_id),
        member(index, 2, "Transmission type", Unsigned8, TPDO_TYPE)
            .rw()
            .stored()
            .value(transmission),
        member(index, 3, "Inhibit time", Unsigned16, INHIBIT)
            .rw()
            .stored()
            .unit("100 us")
            .value(0),
        member(index, 5, "Event timer", Unsigned16, TPDO_TIMER)
            .rw()
            .stored()
            .unit("ms")
            .value(0),
        member(index, 6, "SYNC start value", Unsigned8, START_VALUE)
            .rw()
            .stored()
            .limits(0, 240)
            .value(0),
    ]
}

/// The count, one row per object that is mapped as delivered, and one for the empty places. The
/// count has no limits here, since too high a one has an abort code of its own (0604 0042h).
const fn mapping<const ROWS: usize>(index: u16, name: &'static str, mapped: &[u32]) -> [Row; ROWS] {
    let empty = member(index, 1, "Mapped object", Unsigned32, MAPPED)
        .to(8)
        .rw()
        .stored()
        .value(0);
    let mut rows = [empty; ROWS];
    rows[0] = record(index, 8, name, COUNT)
        .rw()
        .stored()
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

const COB_ID: &str = "Identifier in bits 0 to 10. Bit 31: off. Bit 30 (TPDO): no remote requests. \
     While the PDO is on, only bit 31 may be changed.";
const RPDO_TYPE: &str = "0 to 240: takes effect at the next SYNC. 254 and 255: at once.";
const RPDO_TIMER: &str = "Longest time between two RPDOs; a longer one is reported as EMCY. 0: \
     not supervised.";
const TPDO_TYPE: &str = "0: at the SYNC after a change. 1 to 240: at every n-th SYNC. 254 and \
     255: at a change and by the event timer.";
const INHIBIT: &str = "Least time between two TPDOs of type 254 or 255; 0: no limit. Can be \
     changed only while the TPDO is off.";
const TPDO_TIMER: &str = "Types 254 and 255: longest time between two TPDOs; 0: no limit.";
const START_VALUE: &str = "SYNC count at which a TPDO of type 1 to 240 begins; 0: at any. Can be \
     changed only while the TPDO is off.";
const COUNT: &str = "Number of mapped objects, 0 to 8. Write 0 before changing them, while the PDO \
     is off.";
const MAPPED: &str = "Index in the upper half, then sub-index, then length in bit.";
