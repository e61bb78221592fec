//! The LIS2DW12 registers the driver touches: addresses, names and bits.
//!
//! Addresses and bit positions follow the register map of the data sheet (DS11811). Registers
//! of functions this instrument never uses (tap, free fall, activity) appear because a flipped
//! bit there must be seen: WAKE_UP_THS, for one, can put the part to sleep.

use core::fmt;

/// WHO_AM_I of every LIS2DW12 (data sheet, register 0Fh).
pub const PART_ID: u8 = 0x44;

/// CTRL2: reload the trimming values; clears itself.
pub const CTRL2_BOOT: u8 = 0x80;
/// CTRL2: reset all control registers; clears itself.
pub const CTRL2_SOFT_RESET: u8 = 0x40;
/// CTRL2: hold an output pair until both of its bytes have been read (block data update).
pub const CTRL2_BDU: u8 = 0x08;
/// CTRL2: the address counts up within a burst.
pub const CTRL2_IF_ADD_INC: u8 = 0x04;
/// CTRL2: the I2C side is off, so noise on an SPI line cannot be taken for a start condition.
pub const CTRL2_I2C_DISABLE: u8 = 0x02;

/// CTRL3: self-test deflects towards plus.
pub const CTRL3_ST_POSITIVE: u8 = 0x40;
/// CTRL3: self-test deflects towards minus.
pub const CTRL3_ST_NEGATIVE: u8 = 0x80;

/// CTRL4: data-ready on the INT1 pin.
pub const CTRL4_DRDY: u8 = 0x01;

/// CTRL6: low-noise configuration.
pub const CTRL6_LOW_NOISE: u8 = 0x04;

/// STATUS: a new set of samples is there.
pub const STATUS_DRDY: u8 = 0x01;
/// CTRL7: data-ready is a pulse of each sample, whether the one before was read or not.
///
/// A level would stay high while nobody reads, and the edge that came first would be taken for the
/// one of the sample that is read in the end.
pub const CTRL7_DRDY_PULSED: u8 = 0x80;

/// FIFO_SAMPLES: at least one sample was overwritten.
pub const FIFO_SAMPLES_OVR: u8 = 0x40;
/// FIFO_SAMPLES: number of unread samples, 0 to 32.
pub const FIFO_SAMPLES_DIFF: u8 = 0x3F;

/// A register by the data sheet's name; the value is its address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Register {
    /// Temperature, low byte: the four low bits in bits 7..4.
    OutTL = 0x0D,
    /// Identity of the part.
    WhoAmI = 0x0F,
    /// Output data rate and power mode.
    Ctrl1 = 0x20,
    /// Boot, reset, block data update, bus options.
    Ctrl2 = 0x21,
    /// Self-test and pin options.
    Ctrl3 = 0x22,
    /// What reaches the INT1 pin.
    Ctrl4Int1 = 0x23,
    /// What reaches the INT2 pin.
    Ctrl5Int2 = 0x24,
    /// Bandwidth, full scale, filter path, low noise.
    Ctrl6 = 0x25,
    /// Temperature in whole degrees; the first byte of the sample burst.
    OutT = 0x26,
    /// X axis, low byte; the first byte of a FIFO entry.
    OutXL = 0x28,
    /// FIFO mode and threshold.
    FifoCtrl = 0x2E,
    /// FIFO level and flags.
    FifoSamples = 0x2F,
    /// Tap threshold X, 4D and 6D.
    TapThsX = 0x30,
    /// Tap threshold Y and priority.
    TapThsY = 0x31,
    /// Tap threshold Z and enables.
    TapThsZ = 0x32,
    /// Tap timing.
    IntDur = 0x33,
    /// Wake-up threshold, and the bit that lets the part fall asleep.
    WakeUpThs = 0x34,
    /// Wake-up and sleep durations.
    WakeUpDur = 0x35,
    /// Free-fall threshold and duration.
    FreeFall = 0x36,
    /// User offset X.
    XOfsUsr = 0x3C,
    /// User offset Y.
    YOfsUsr = 0x3D,
    /// User offset Z.
    ZOfsUsr = 0x3E,
    /// Pulsed data-ready, interrupt enable, user-offset enables.
    Ctrl7 = 0x3F,
}

impl Register {
    /// Seven-bit address on the wire.
    pub const fn address(self) -> u8 {
        self as u8
    }

    /// The data sheet's name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OutTL => "OUT_T_L",
            Self::WhoAmI => "WHO_AM_I",
            Self::Ctrl1 => "CTRL1",
            Self::Ctrl2 => "CTRL2",
            Self::Ctrl3 => "CTRL3",
            Self::Ctrl4Int1 => "CTRL4_INT1",
            Self::Ctrl5Int2 => "CTRL5_INT2",
            Self::Ctrl6 => "CTRL6",
            Self::OutT => "OUT_T",
            Self::OutXL => "OUT_X_L",
            Self::FifoCtrl => "FIFO_CTRL",
            Self::FifoSamples => "FIFO_SAMPLES",
            Self::TapThsX => "TAP_THS_X",
            Self::TapThsY => "TAP_THS_Y",
            Self::TapThsZ => "TAP_THS_Z",
            Self::IntDur => "INT_DUR",
            Self::WakeUpThs => "WAKE_UP_THS",
            Self::WakeUpDur => "WAKE_UP_DUR",
            Self::FreeFall => "FREE_FALL",
            Self::XOfsUsr => "X_OFS_USR",
            Self::YOfsUsr => "Y_OFS_USR",
            Self::ZOfsUsr => "Z_OFS_USR",
            Self::Ctrl7 => "CTRL7",
        }
    }
}

impl fmt::Display for Register {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({:02X}h)", self.name(), self.address())
    }
}
