//! The communication profile, 1000h to 1FFFh without PDOs and SRDOs (CiA 301, 7.5.2).
//!
//! In: nothing. Out: the rows. Their meaning is the standard's; the texts describe what this
//! instrument does with them.
//!
//! Left out: 1400h to 1BFFh (`pdo`), 1300h to 13FFh (`safety`), and the behaviour (`canopen`).

use canopen::object::DataType::{Domain, Unsigned8, Unsigned16, Unsigned32, VisibleString};

use super::build::{array, member, record, var};
use super::row::Row;

/// 1000h: profile 410, and in the upper half class and mapping of a two-axis 32-bit instrument
/// with PDOs and SRDOs. The upper half is inferred from a one-axis device that reads 3001h.
pub const DEVICE_TYPE: u32 = 0x3004_019A;
/// 1008h.
pub const NAME: &str = "Plumb inclinometer";
/// 1009h.
pub const HARDWARE_VERSION: &str = "1.0";
/// 100Ah.
pub const SOFTWARE_VERSION: &str = env!("CARGO_PKG_VERSION");
/// 1018h sub 1. No number has been assigned by CiA: 0 means that, and clashes with nobody. Whoever
/// sells the instrument puts their own number here.
pub const VENDOR_ID: u32 = 0;
/// 1018h sub 2 of channel A: "PL" and the number of the channel.
pub const PRODUCT_CODE_A: u32 = 0x504C_0001;
/// 1018h sub 2 of channel B.
pub const PRODUCT_CODE_B: u32 = 0x504C_0002;
/// 1018h sub 3: major number in the upper half, minor number in the lower.
pub const REVISION: u32 = 0x0001_0000;
/// The heartbeat of each channel, in ms.
pub const HEARTBEAT_MS: u16 = 200;
/// How long one channel waits for the other's heartbeat, in ms: two may be lost.
pub const PEER_HEARTBEAT_MS: u16 = 500;

/// 1016h: node-id and time as the standard packs them.
const fn supervised(node_id: u8) -> i64 {
    ((node_id as i64) << 16) | PEER_HEARTBEAT_MS as i64
}

/// The rows.
pub const COMMUNICATION: &[Row] = &[
    var(
        0x1000,
        "Device type",
        Unsigned32,
        "Profile in the lower half: 019Ah is CiA 410, inclinometers. Upper half: two axes of \
         32 bit with PDOs and SRDOs (inferred from other devices).",
    )
    .constant()
    .value(DEVICE_TYPE as i64),
    var(
        0x1001,
        "Error register",
        Unsigned8,
        "Errors that are present now. Bit 0 any, 2 voltage, 3 temperature, 4 communication, \
         5 profile, 7 device-specific (CiA 301, 7.5.2.2).",
    )
    .tpdo()
    .value(0),
    array(
        0x1003,
        8,
        "Pre-defined error field",
        "Number of errors kept below. Writing 0 deletes them all (CiA 301, 7.5.2.4).",
    )
    .rw()
    .acts()
    .value(0),
    member(
        0x1003,
        1,
        "Standard error field",
        Unsigned32,
        "An error that was sent as EMCY, newest first: its code in the lower half, its first \
         two device-specific bytes above.",
    )
    .to(8),
    var(
        0x1005,
        "COB-ID SYNC message",
        Unsigned32,
        "Identifier of SYNC. Bit 30: this node produces it (CiA 301, 7.5.2.5).",
    )
    .rw()
    .stored()
    .value(0x80),
    var(
        0x1006,
        "Communication cycle period",
        Unsigned32,
        "Time between two SYNCs of this node; 0 produces none. Less than 1000 is refused.",
    )
    .rw()
    .stored()
    .unit("us")
    .value(0),
    var(
        0x1007,
        "Synchronous window length",
        Unsigned32,
        "A synchronous TPDO that could not be sent within this time after SYNC is dropped; 0 \
         sets no limit.",
    )
    .rw()
    .stored()
    .unit("us")
    .value(0),
    var(
        0x1008,
        "Manufacturer device name",
        VisibleString,
        "What this device is.",
    )
    .text(NAME),
    var(
        0x1009,
        "Manufacturer hardware version",
        VisibleString,
        "Version of the board.",
    )
    .text(HARDWARE_VERSION),
    var(
        0x100A,
        "Manufacturer software version",
        VisibleString,
        "Version of the program.",
    )
    .text(SOFTWARE_VERSION),
    var(
        0x100C,
        "Guard time",
        Unsigned16,
        "Time between two guarding requests of the master; 0 turns guarding off. Without effect \
         while a heartbeat is produced (1017h).",
    )
    .rw()
    .stored()
    .unit("ms")
    .value(0),
    var(
        0x100D,
        "Life time factor",
        Unsigned8,
        "Guard times after which a master that asks no more counts as lost; 0 turns it off.",
    )
    .rw()
    .stored()
    .value(0),
    array(
        0x1010,
        4,
        "Store parameters",
        "Puts parameters into memory that outlasts a power cut (CiA 301, 7.5.2.13).",
    ),
    memory(0x1010, 1, "Save all parameters", SAVE),
    memory(0x1010, 2, "Save communication parameters", SAVE),
    memory(0x1010, 3, "Save application parameters", SAVE),
    memory(0x1010, 4, "Save manufacturer parameters", SAVE),
    array(
        0x1011,
        4,
        "Restore default parameters",
        "Deletes the stored parameters; the defaults apply from the next reset on \
         (CiA 301, 7.5.2.14).",
    ),
    memory(0x1011, 1, "Restore all default parameters", LOAD),
    memory(0x1011, 2, "Restore communication default parameters", LOAD),
    memory(0x1011, 3, "Restore application default parameters", LOAD),
    memory(0x1011, 4, "Restore manufacturer default parameters", LOAD),
    var(
        0x1014,
        "COB-ID EMCY",
        Unsigned32,
        "Identifier of this node's EMCY. Bit 31: it sends none.",
    )
    .rw()
    .stored()
    .node_id(0x80),
    var(
        0x1015,
        "Inhibit time EMCY",
        Unsigned16,
        "Least time between two EMCYs of this node.",
    )
    .rw()
    .stored()
    .unit("100 us")
    .value(0),
    array(
        0x1016,
        4,
        "Consumer heartbeat time",
        "Nodes whose heartbeat this node supervises (CiA 301, 7.5.2.19).",
    ),
    member(0x1016, 1, "Consumer heartbeat time", Unsigned32, SUPERVISED)
        .rw()
        .stored()
        .channel(supervised(2), supervised(1)),
    member(0x1016, 2, "Consumer heartbeat time", Unsigned32, SUPERVISED)
        .to(4)
        .rw()
        .stored()
        .value(0),
    var(
        0x1017,
        "Producer heartbeat time",
        Unsigned16,
        "Time between two heartbeats of this node; 0 produces none.",
    )
    .rw()
    .stored()
    .unit("ms")
    .value(HEARTBEAT_MS as i64),
    record(
        0x1018,
        4,
        "Identity object",
        "Together these four numbers name one device in the world; LSS selects by them.",
    ),
    member(
        0x1018,
        1,
        "Vendor-ID",
        Unsigned32,
        "0: no number has been assigned by CiA to this open design.",
    )
    .constant()
    .value(VENDOR_ID as i64),
    member(
        0x1018,
        2,
        "Product code",
        Unsigned32,
        "\"PL\" and the channel.",
    )
    .constant()
    .channel(PRODUCT_CODE_A as i64, PRODUCT_CODE_B as i64),
    member(
        0x1018,
        3,
        "Revision number",
        Unsigned32,
        "Major number in the upper half: changes with the behaviour on the bus. Minor number in \
         the lower.",
    )
    .constant()
    .value(REVISION as i64),
    member(
        0x1018,
        4,
        "Serial number",
        Unsigned32,
        "Number of the piece; the two channels of one instrument have different ones.",
    ),
    var(
        0x1019,
        "Synchronous counter overflow value",
        Unsigned8,
        "Highest count that a SYNC carries; 0: SYNC carries none. 1 is not allowed.",
    )
    .rw()
    .stored()
    .limits(0, 240)
    .value(0),
    array(
        0x1020,
        2,
        "Verify configuration",
        "When a tool configured this node. Any later change of a stored parameter clears both.",
    ),
    member(
        0x1020,
        1,
        "Configuration date",
        Unsigned32,
        "Days since 1 January 1984.",
    )
    .rw()
    .stored()
    .unit("d")
    .value(0),
    member(
        0x1020,
        2,
        "Configuration time",
        Unsigned32,
        "Time since midnight.",
    )
    .rw()
    .stored()
    .unit("ms")
    .value(0),
    array(
        0x1029,
        2,
        "Error behaviour",
        "What a serious error does to the NMT state. 0: PRE-OPERATIONAL (only out of \
         OPERATIONAL), 1: nothing, 2: STOPPED.",
    ),
    member(
        0x1029,
        1,
        "Communication error",
        Unsigned8,
        "After bus-off, a lost heartbeat or lost guarding. The default stays, unlike the \
         standard's: the loss of one channel must not silence the other.",
    )
    .rw()
    .stored()
    .limits(0, 2)
    .value(1),
    member(
        0x1029,
        2,
        "Internal error",
        Unsigned8,
        "After a fault of the instrument itself. The default stays: validity and state show it, \
         and a machine that has lost its angle still receives the reason.",
    )
    .rw()
    .stored()
    .limits(0, 2)
    .value(1),
    record(
        0x1200,
        2,
        "SDO server parameter",
        "Identifiers of the SDO server, fixed by the node-id.",
    ),
    member(
        0x1200,
        1,
        "COB-ID client to server",
        Unsigned32,
        "Requests come with this identifier.",
    )
    .constant()
    .node_id(0x600),
    member(
        0x1200,
        2,
        "COB-ID server to client",
        Unsigned32,
        "Answers go out with this identifier.",
    )
    .constant()
    .node_id(0x580),
    var(
        0x1F80,
        "NMT startup",
        Unsigned32,
        "What this node does after boot-up: 0 waits for a master, 8 enters OPERATIONAL by itself \
         (CiA 302-2).",
    )
    .rw()
    .stored()
    .value(0),
];

/// 1F50h to 1F57h, program download (CiA 302-3).
pub const PROGRAM: &[Row] = &[
    array(
        0x1F50,
        1,
        "Program data",
        "Where a new program is written to (CiA 302-3).",
    ),
    member(
        0x1F50,
        1,
        "Program 1",
        Domain,
        "The image as it came out of the build. It counts once it is complete and its check sum \
         is right; a block transfer is the fastest way.",
    )
    .wo(),
    array(
        0x1F51,
        1,
        "Program control",
        "Starts, stops and clears programs (CiA 302-3).",
    ),
    member(
        0x1F51,
        1,
        "Program 1",
        Unsigned8,
        "Written: 0 stop, 1 start, 2 reset, 3 clear. Read: 0 stopped, 1 started, 3 no program.",
    )
    .rw()
    .limits(0, 3),
    array(
        0x1F56,
        1,
        "Program software identification",
        "Which program is in memory (CiA 302-3).",
    ),
    member(0x1F56, 1, "Program 1", Unsigned32, "CRC-32 of the program."),
    array(
        0x1F57,
        1,
        "Flash status identification",
        "How a download stands (CiA 302-3).",
    ),
    member(
        0x1F57,
        1,
        "Program 1",
        Unsigned32,
        "Bit 0: in progress. Bits 1 to 7: the last error, 0 for none.",
    ),
];

const SUPERVISED: &str = "Node-id in bits 16 to 23, time in ms in the lower half; a time of 0, and \
     a node-id of 0 or above 127, supervises no node. Supervision begins with the first heartbeat. \
     As delivered, each channel supervises the other.";
const SAVE: &str = "Write \"save\" (65766173h) to store. Reads 1: stores on command only.";
const LOAD: &str = "Write \"load\" (64616F6Ch) to restore. Reads 1: restores on command only.";

const fn memory(index: u16, sub: u8, name: &'static str, doc: &'static str) -> Row {
    member(index, sub, name, Unsigned32, doc).rw()
}
