//! The instrument's own objects, 2000h to 20FFh: redundancy, measurement and bus.
//!
//! In: nothing. Out: the rows. A record that a tool may want as one line in a log is mappable
//! into a TPDO.
//!
//! Left out: what stands behind the rows (`values`), calibration (`calibration`), limits and cams,
//! for which no index of CiA 410 is known.

use canopen::object::DataType::{
    Domain, Integer16, Integer24, Integer32, Unsigned8, Unsigned16, Unsigned32,
};

use super::build::{array, member, record, var};
use super::row::Row;

/// 2022h where the uncertainty is not known or does not fit.
pub const UNKNOWN_UNCERTAINTY: u16 = u16::MAX;
/// 2024h where there is no difference.
pub const NO_DIFFERENCE: i16 = i16::MIN;
/// 2040h as delivered: this much to either side, in 0.001 deg.
pub const RANGE: i32 = 90_000;
/// 2050h sub 1 as delivered, in ms.
pub const FALLBACK_MS: u16 = 500;
/// 2050h sub 2 as delivered, in us.
pub const FALLBACK_PERIOD_US: u32 = 20_000;
/// 2051h as delivered, in ms.
pub const RECOVERY_MS: u16 = 1000;

pub(super) const MILLIDEGREE: &str = "0.001 deg";
const CIRCLE: &str = "360 deg / 2^24";
pub(super) const HALF_TURN: i64 = 180_000;

/// The rows.
pub const MANUFACTURER: &[Row] = &[
    var(
        0x2001,
        "Peer node-ID",
        Unsigned8,
        "Node-id of the other channel. Its heartbeat (1016h) and its exchange (1400h, 1401h, \
         with a gyroscope 1402h) are set up apart from this.",
    )
    .rw()
    .stored()
    .limits(1, 127)
    .channel(2, 1),
    var(
        0x2002,
        "Channel",
        Unsigned8,
        "Which channel of the instrument this is: 0 is A, 1 is B.",
    )
    .constant()
    .channel(0, 1),
    var(
        0x2004,
        "Latch time",
        Unsigned16,
        "How long a channel that was found faulty, or a disagreement, must be over before it \
         counts as over. 0: until a reset. A channel that was only late or silent counts again \
         after 1 s.",
    )
    .rw()
    .stored()
    .unit("s")
    .limits(0, 3600)
    .value(0),
    var(
        0x2005,
        "Degraded operation",
        Unsigned8,
        "Whether this channel's angles stay valid, and 2021h shows 8, while the other one is \
         faulty. 0 forbidden, 1 allowed.",
    )
    .rw()
    .stored()
    .limits(0, 1)
    .value(1),
    record(
        0x2010,
        9,
        "Exchange sent",
        "Data for the other channel, sent at each SYNC.",
    ),
    member(0x2010, 1, "Angle X", Integer24, ANGLE)
        .tpdo()
        .unit(CIRCLE),
    member(0x2010, 2, "Angle Y", Integer24, ANGLE)
        .tpdo()
        .unit(CIRCLE),
    member(0x2010, 3, "Quality X", Unsigned8, QUALITY).tpdo(),
    member(0x2010, 4, "Quality Y", Unsigned8, QUALITY).tpdo(),
    member(0x2010, 5, "Acceleration X", Integer16, VECTOR)
        .to(7)
        .tpdo()
        .unit(COARSE),
    member(0x2010, 8, "Capture time", Unsigned8, CAPTURED)
        .tpdo()
        .unit("2 ms"),
    member(0x2010, 9, "Activity", Unsigned8, ACTIVITY).tpdo(),
    record(
        0x2011,
        9,
        "Exchange received",
        "Data received from the other channel; mapped into RPDO 1 and 2 as delivered.",
    ),
    member(0x2011, 1, "Angle X", Integer24, ANGLE)
        .rpdo()
        .unit(CIRCLE),
    member(0x2011, 2, "Angle Y", Integer24, ANGLE)
        .rpdo()
        .unit(CIRCLE),
    member(0x2011, 3, "Quality X", Unsigned8, QUALITY).rpdo(),
    member(0x2011, 4, "Quality Y", Unsigned8, QUALITY).rpdo(),
    member(0x2011, 5, "Acceleration X", Integer16, VECTOR)
        .to(7)
        .rpdo()
        .unit(COARSE),
    member(0x2011, 8, "Capture time", Unsigned8, CAPTURED)
        .rpdo()
        .unit("2 ms"),
    member(0x2011, 9, "Activity", Unsigned8, ACTIVITY).rpdo(),
    var(
        0x2020,
        "Validity",
        Unsigned8,
        "Bit 0: X is valid, 1: Y is valid, 2: the other channel's X is valid, 3: its Y, 4: the \
         two X were compared, 5: the two Y, 6: calibrated, 7: a fault is latched.",
    )
    .tpdo(),
    var(
        0x2021,
        "State of the pair",
        Unsigned8,
        "Judgement on both channels. 0 waiting, 1 agree, 2 warning, 3 stop the motion, 4 data \
         were delayed, 5 physical fault, 6 disagree, 7 this channel is faulty, 8 the other channel \
         is faulty, 9 no channel measures.",
    )
    .tpdo(),
    array(
        0x2022,
        3,
        "Uncertainty",
        "Standard uncertainty (k = 1) of this channel's angles.",
    ),
    member(0x2022, 1, "Uncertainty X", Unsigned16, UNKNOWN)
        .tpdo()
        .unit(MILLIDEGREE),
    member(0x2022, 2, "Uncertainty Y", Unsigned16, UNKNOWN)
        .tpdo()
        .unit(MILLIDEGREE),
    member(0x2022, 3, "Larger uncertainty", Unsigned16, UNKNOWN)
        .tpdo()
        .unit(MILLIDEGREE),
    record(
        0x2023,
        2,
        "Latency",
        "Age of the angle: it is that of the instant so long before the SYNC.",
    ),
    member(0x2023, 1, "Latency in microseconds", Unsigned32, "In full.")
        .tpdo()
        .unit("us"),
    member(
        0x2023,
        2,
        "Latency in milliseconds",
        Unsigned8,
        "Rounded; 255 is 255 or more.",
    )
    .tpdo()
    .unit("ms"),
    array(
        0x2024,
        3,
        "Difference",
        "This channel's angle minus the other's, for the same SYNC.",
    ),
    member(0x2024, 1, "Difference X", Integer16, NONE)
        .tpdo()
        .unit(MILLIDEGREE),
    member(0x2024, 2, "Difference Y", Integer16, NONE)
        .tpdo()
        .unit(MILLIDEGREE),
    member(0x2024, 3, "Larger difference", Integer16, NONE)
        .tpdo()
        .unit(MILLIDEGREE),
    array(
        0x2025,
        2,
        "Reason",
        "Why there is no angle. 0: there is one. 1 no sample yet, 2 settling, 3 samples have \
         stopped, 4 over range, 5 temperature not known, 6 axis not measured, 7 the part has \
         lost its set-up, 8 the part does not answer, 9 codes stand still, 10 noise, 11 spikes, 12 \
         the temperature jumps, 13 moved alone or gravity of the wrong length, 14 the \
         calibration is damaged, 15 silent, 16 late, 17 the channels differ, 18 the other channel \
         has not been heard, 19 degraded operation is forbidden, 20 presets or offsets or \
         inversion differ, 21 the uncertainty is above 2007h.",
    ),
    member(0x2025, 1, "Reason X", Unsigned8, "See sub-index 0.").tpdo(),
    member(0x2025, 2, "Reason Y", Unsigned8, "See sub-index 0.").tpdo(),
    record(0x2026, 3, "SYNC", "What this node has seen of SYNC."),
    member(
        0x2026,
        1,
        "SYNC count",
        Unsigned32,
        "SYNCs since the reset; wraps.",
    )
    .tpdo(),
    member(
        0x2026,
        2,
        "Missed exchanges",
        Unsigned16,
        "SYNCs after which the other channel's exchange did not come, or not the whole of it for \
         the fifth time in a row; stops at 65535.",
    )
    .tpdo(),
    member(
        0x2026,
        3,
        "SYNC source",
        Unsigned8,
        "0 none, 1 the bus, 2 this node.",
    )
    .tpdo(),
    record(
        0x2027,
        3,
        "Verdict",
        "Which channel the state of the pair (2021h) blames, and why.",
    ),
    member(
        0x2027,
        1,
        "Blamed channel",
        Unsigned8,
        "0 none, 1 this channel, 2 the other, 3 both.",
    )
    .tpdo(),
    member(
        0x2027,
        2,
        "Reason of the blame",
        Unsigned8,
        "A reason as in 2025h; 0 for none.",
    )
    .tpdo(),
    member(
        0x2027,
        3,
        "Time of the verdict",
        Unsigned32,
        "When the state of the pair became what it is, since the start.",
    )
    .unit("ms"),
    var(
        0x2030,
        "Mode of measurement",
        Unsigned8,
        "0: two slopes of +-90 deg. 1: one angle of 360 deg about Y, as X.",
    ),
    array(
        0x2031,
        3,
        "Filtered acceleration",
        "The vector behind the angles, in the axes of the sensor.",
    ),
    member(0x2031, 1, "Acceleration X", Integer32, "Filtered.")
        .tpdo()
        .unit("2^-26 g"),
    member(0x2031, 2, "Acceleration Y", Integer32, "Filtered.")
        .tpdo()
        .unit("2^-26 g"),
    member(0x2031, 3, "Acceleration Z", Integer32, "Filtered.")
        .tpdo()
        .unit("2^-26 g"),
    var(
        0x2032,
        "Samples",
        Unsigned32,
        "Samples taken since the reset; wraps.",
    ),
    var(
        0x2033,
        "Sample period",
        Unsigned32,
        "Time between two samples, by this device's clock.",
    )
    .unit("1/256 us"),
    record(
        0x2050,
        2,
        "SYNC fallback",
        "With no SYNC on the bus the channel with the lower node-id makes it.",
    ),
    member(
        0x2050,
        1,
        "Time-out",
        Unsigned16,
        "Silence before it begins; 0: never.",
    )
    .rw()
    .stored()
    .unit("ms")
    .value(FALLBACK_MS as i64),
    member(
        0x2050,
        2,
        "Period",
        Unsigned32,
        "Time between two SYNCs of its own.",
    )
    .rw()
    .stored()
    .unit("us")
    .limits(1000, 1_000_000)
    .value(FALLBACK_PERIOD_US as i64),
    var(
        0x2051,
        "Bus-off recovery",
        Unsigned16,
        "Time from bus-off to the attempt to return; 0: never without a reset.",
    )
    .rw()
    .stored()
    .unit("ms")
    .value(RECOVERY_MS as i64),
    record(
        0x2052,
        6,
        "Bus",
        "What the CAN controller reports (ISO 11898-1).",
    ),
    member(
        0x2052,
        1,
        "Bus state",
        Unsigned8,
        "0 error active, 1 error passive, 2 bus-off.",
    )
    .tpdo(),
    member(
        0x2052,
        2,
        "Transmit errors",
        Unsigned8,
        "Transmit error counter.",
    )
    .tpdo(),
    member(
        0x2052,
        3,
        "Receive errors",
        Unsigned8,
        "Receive error counter.",
    )
    .tpdo(),
    member(
        0x2052,
        4,
        "Bus load",
        Unsigned8,
        "Share of the last second that was taken.",
    )
    .tpdo()
    .unit("%"),
    member(
        0x2052,
        5,
        "Overruns",
        Unsigned16,
        "Frames lost before they were read, and samples replaced before they were sent; stops \
         at 65535.",
    )
    .tpdo(),
    member(
        0x2052,
        6,
        "Bus-offs",
        Unsigned16,
        "Since the reset; stops at 65535.",
    )
    .tpdo(),
    record(0x2053, 2, "Bit rate", "Changed by LSS (CiA 305)."),
    member(
        0x2053,
        1,
        "Bit rate in force",
        Unsigned16,
        "0 while it is being looked for.",
    )
    .unit("kbit/s"),
    member(
        0x2053,
        2,
        "Automatic detection",
        Unsigned8,
        "Whether it listens for the bit rate of the bus at start, in place of the stored one. 0 \
         off, 1 on.",
    )
    .rw()
    .stored()
    .limits(0, 1)
    .value(0),
];

/// 2003h where it can be chosen.
pub const CHECK: &[Row] = &[var(
    0x2003,
    "Cross-check",
    Unsigned8,
    "How the two channels are judged. 0 as built, 1 the paper's rule, 2 the product's. \
         Counts from the next reset.",
)
.rw()
.stored()
.limits(0, 2)
.value(0)];

/// 2006h, where both channels can be set to show different angles.
pub const PRESENTATION_CHECK: &[Row] = &[var(
    0x2006,
    "Presentation check",
    Unsigned8,
    "Whether neither channel is valid where presets, offsets or inversion make the two show \
         different angles. 0 off, 1 on.",
)
.rw()
.stored()
.limits(0, 1)
.value(1)];

/// 2007h, where there is an uncertainty: as delivered there is no limit.
pub const UNCERTAINTY_LIMIT: &[Row] = &[uncertainty_limit(0)];

/// The same where there is a gyroscope. After a start in motion, or beside a gyroscope that is
/// wrong from power-on, the vertical is uncertain by degrees, however well the channel is
/// calibrated.
pub const DYNAMIC_UNCERTAINTY_LIMIT: &[Row] = &[uncertainty_limit(2000)];

const fn uncertainty_limit(default: i64) -> Row {
    var(
        0x2007,
        "Uncertainty limit",
        Unsigned16,
        "Largest standard uncertainty (k = 1) of a valid angle. 0: no limit.",
    )
    .rw()
    .stored()
    .unit(MILLIDEGREE)
    .limits(0, UNKNOWN_UNCERTAINTY as i64 - 1)
    .value(default)
}

/// 2040h.
pub const RANGES: &[Row] = &[
    record(
        0x2040,
        4,
        "Measuring range",
        "Outside it EMCY 5010h (X) or 5020h (Y) is sent. Refused where it would not fit into 16 \
         bit at the resolution of 6000h.",
    ),
    range(1, "Lowest X", -RANGE),
    range(2, "Highest X", RANGE),
    range(3, "Lowest Y", -RANGE),
    range(4, "Highest Y", RANGE),
];

/// 2012h, which a received SRDO writes.
pub const SAFE_SLOPES: &[Row] = &[
    record(
        0x2012,
        4,
        "Safe slopes received",
        "What a received SRDO carries, in the sender's unit; for a machine in which this node has \
         to take the other channel's SRDO 1.",
    ),
    member(0x2012, 1, "Slope X", Integer16, "Plain.")
        .rw()
        .srdo(),
    member(
        0x2012,
        2,
        "Inverted slope X",
        Integer16,
        "Every bit inverted.",
    )
    .rw()
    .srdo(),
    member(0x2012, 3, "Slope Y", Integer16, "Plain.")
        .rw()
        .srdo(),
    member(
        0x2012,
        4,
        "Inverted slope Y",
        Integer16,
        "Every bit inverted.",
    )
    .rw()
    .srdo(),
];

/// 2028h, where the accelerations of both channels are compared.
pub const VECTORS: &[Row] = &[
    array(
        0x2028,
        3,
        "Residual",
        "This channel's calibrated acceleration minus the other's, low-passed with 0.5 s.",
    ),
    member(
        0x2028,
        1,
        "Residual X",
        Integer16,
        "Along the housing's axes X, Y, Z.",
    )
    .to(3)
    .tpdo()
    .unit("0.1 mg"),
];

/// 2070h to 2072h, what has happened.
pub const HISTORY: &[Row] = &[
    var(
        0x2070,
        "Fault log",
        Domain,
        "The last 16 events, newest first; the format is in docs/canopen.md. Resets and losses \
         of the supply leave it; 2072h empties it.",
    ),
    array(
        0x2071,
        2,
        "Black box",
        "Both channels' samples around an event; the format is in docs/canopen.md. 1: the first \
         event, 2: the latest.",
    ),
    member(
        0x2071,
        1,
        "Box",
        Domain,
        "Empty while there was no event: 0800 0024h.",
    )
    .to(2),
    var(
        0x2072,
        "Clear fault log and black box",
        Unsigned32,
        "61656C63h, \"clea\", empties both for good. Not in OPERATIONAL.",
    )
    .wo(),
];

const fn range(sub: u8, name: &'static str, default: i32) -> Row {
    member(
        0x2040,
        sub,
        name,
        Integer32,
        "Bound of the measuring range.",
    )
    .rw()
    .stored()
    .unit(MILLIDEGREE)
    .limits(-HALF_TURN, HALF_TURN)
    .value(default as i64)
}

const ANGLE: &str = "Without preset and offsets. Counts only where the quality is 32 or more.";
const QUALITY: &str = "0: no value yet. 1 to 31: no angle, for the reason of 2025h. 32 and up: \
     standard uncertainty of the angle on a logarithmic scale.";
const COARSE: &str = "2^-13 g";
const VECTOR: &str = "Along the housing's axes X, Y, Z; -32768: there is none.";
const CAPTURED: &str = "Instant of the SYNC on the sender's clock, the low byte.";
const ACTIVITY: &str = "Energy above 150 Hz since the SYNC before, 8 steps per doubling; 64 is \
     white noise as large as the channel's own, 0: too few samples, 255: samples are missing.";
pub(super) const UNKNOWN: &str = "65535: not known, or 65.535 deg and more.";
const NONE: &str = "-32768: there is none. Larger ones stop at 32767.";

/// 2003h of an instrument that has one check.
pub const CHECK_AS_BUILT: &[Row] = &[var(
    0x2003,
    "Cross-check",
    Unsigned8,
    "How the two channels are judged. 0: as built.",
)
.constant()
.value(0)];
