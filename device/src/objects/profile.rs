//! The device profile for inclinometers, 6000h to 69FFh (CiA 410).
//!
//! In: nothing. Out: the rows of two logical devices. The first is this channel; the second, 800h
//! higher, is the other channel as this one sees it.
//!
//! Of the 16-bit and 32-bit twins only the 32-bit one is stored: they are two views of one value.
//! Scaling (bit 1 of the operating parameter) is on as delivered. With both offsets 0 that
//! changes nothing, and a preset then works without a second write; where it is off from the
//! factory, people report that "zeroing does not work".
//!
//! Left out: the formulas (`profile` of this crate), and the safe slopes (`safety`).

use canopen::object::DataType::{self, Integer8, Integer16, Integer32, Unsigned8, Unsigned16};

use super::build::var;
use super::row::Row;

/// Distance between logical devices.
pub const LOGICAL_DEVICE: u16 = 0x800;
/// 6000h as delivered: 0.01 deg.
pub const RESOLUTION: u16 = 10;
/// Operating parameter as delivered: not inverted, scaled.
pub const OPERATING: u8 = 2;

/// The temperature, which belongs to the device as a whole.
pub const PROFILE: &[Row] = &[var(
    0x6511,
    "Device temperature",
    Integer8,
    "Temperature of the sensor (CiA 410).",
)
.tpdo()
.unit("degC")];

/// The two logical devices: resolution and four slopes each.
pub const LOGICAL: [[[Row; 5]; 4]; 2] = [
    [
        slope(0x6010, Integer16, SLOPE_16[0], "This channel: angle X."),
        slope(0x6020, Integer16, SLOPE_16[1], "This channel: angle Y."),
        slope(0x6110, Integer32, SLOPE_32[0], "This channel: angle X."),
        slope(0x6120, Integer32, SLOPE_32[1], "This channel: angle Y."),
    ],
    [
        slope(0x6810, Integer16, SLOPE_16[0], "Other channel: angle X."),
        slope(0x6820, Integer16, SLOPE_16[1], "Other channel: angle Y."),
        slope(0x6910, Integer32, SLOPE_32[0], "Other channel: angle X."),
        slope(0x6920, Integer32, SLOPE_32[1], "Other channel: angle Y."),
    ],
];

/// 6000h and 6800h.
pub const RESOLUTIONS: [Row; 2] = [resolution(0x6000), resolution(0x6000 + LOGICAL_DEVICE)];

/// Unit and slopes of an instrument on which none of it can be set.
pub const AS_MEASURED: [Row; 5] = [
    var(
        0x6000,
        "Resolution",
        Unsigned16,
        "Unit of the slopes (CiA 410).",
    )
    .constant()
    .unit("0.001 deg")
    .value(RESOLUTION as i64),
    LOGICAL[0][0][0],
    LOGICAL[0][1][0],
    LOGICAL[0][2][0],
    LOGICAL[0][3][0],
];

const fn resolution(index: u16) -> Row {
    var(
        index,
        "Resolution",
        Unsigned16,
        "Unit of slopes, presets and offsets: 1, 10, 100 or 1000. Refused where the measuring \
         range would not fit into 16 bit (CiA 410).",
    )
    .rw()
    .stored()
    .tpdo()
    .unit("0.001 deg")
    .limits(1, 1000)
    .value(RESOLUTION as i64)
}

/// Names of the five objects of a slope: value, operating parameter, preset, offset, differential.
type Names = [&'static str; 5];

const SLOPE_16: [Names; 2] = [
    [
        "Slope long16",
        "Slope long16 operating parameter",
        "Slope long16 preset value",
        "Slope long16 offset",
        "Differential slope long16 offset",
    ],
    [
        "Slope lateral16",
        "Slope lateral16 operating parameter",
        "Slope lateral16 preset value",
        "Slope lateral16 offset",
        "Differential slope lateral16 offset",
    ],
];

const SLOPE_32: [Names; 2] = [
    [
        "Slope long32",
        "Slope long32 operating parameter",
        "Slope long32 preset value",
        "Slope long32 offset",
        "Differential slope long32 offset",
    ],
    [
        "Slope lateral32",
        "Slope lateral32 operating parameter",
        "Slope lateral32 preset value",
        "Slope lateral32 offset",
        "Differential slope lateral32 offset",
    ],
];

const fn slope(index: u16, width: DataType, names: Names, which: &'static str) -> [Row; 5] {
    let [value, operating, preset, offset, differential] = names;
    let mut rows = [
        var(index, value, width, which).tpdo(),
        var(index + 1, operating, Unsigned8, OPERATION)
            .rw()
            .limits(0, 3)
            .value(OPERATING as i64),
        var(index + 2, preset, width, PRESET).rw().acts().value(0),
        var(index + 3, offset, width, OFFSET).value(0),
        var(index + 4, differential, width, DIFFERENTIAL)
            .rw()
            .value(0),
    ];
    let mut i = 0;
    while i < rows.len() {
        // The operating parameter is a set of bits and has no unit.
        if i != 1 {
            rows[i] = rows[i].unit(unit(index));
        }
        if i != 0 && matches!(width, Integer32) {
            rows[i] = rows[i].stored();
        }
        i += 1;
    }
    rows
}

const fn unit(index: u16) -> &'static str {
    if index < 0x6000 + LOGICAL_DEVICE {
        "6000h x 0.001 deg"
    } else {
        "6800h x 0.001 deg"
    }
}

const OPERATION: &str = "Bit 0: inverted. Bit 1: preset and offsets count. Shared by the 16-bit \
     and the 32-bit slope (CiA 410).";
const PRESET: &str = "Writing it makes the slope read this from now on, by way of the offset. \
     Refused while there is no valid angle (CiA 410).";
const OFFSET: &str = "What the preset came to: preset - slope as measured - differential offset \
     (CiA 410).";
const DIFFERENTIAL: &str = "A shift of its own, added to the slope (CiA 410).";
