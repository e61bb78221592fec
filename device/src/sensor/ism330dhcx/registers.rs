//! The ISM330DHCX registers the driver touches: addresses, names and bits.
//!
//! Addresses and bit positions follow the register map of the data sheet (DS13012) and were
//! compared with ST's open driver (ism330dhcx-pid, `ism330dhcx_reg.h`). Registers of functions
//! this instrument never uses (tap, 6D, wake-up, free fall, user offsets) appear because a flipped
//! bit there must be seen: TAP_CFG2, for one, can put the gyroscope to sleep.

use core::fmt;

/// WHO_AM_I of every ISM330DHCX (data sheet, register 0Fh). Other parts of the family have it too.
pub const PART_ID: u8 = 0x6B;

/// COUNTER_BDR_REG1: data-ready is a pulse of each sample, whether the one before was read or not.
pub const COUNTER_DRDY_PULSED: u8 = 0x80;

/// INT1_CTRL: the gyroscope's data-ready on the INT1 pin.
pub const INT1_DRDY_G: u8 = 0x02;

/// CTRL1_XL: the output comes from LPF2.
pub const CTRL1_LPF2: u8 = 0x02;

/// CTRL3_C: reload the trimming values; clears itself.
pub const CTRL3_BOOT: u8 = 0x80;
/// CTRL3_C: hold an output pair until both of its bytes have been read (block data update).
pub const CTRL3_BDU: u8 = 0x40;
/// CTRL3_C: the address counts up within a burst.
pub const CTRL3_IF_INC: u8 = 0x04;
/// CTRL3_C: reset all control registers; clears itself.
pub const CTRL3_SW_RESET: u8 = 0x01;

/// CTRL4_C: the I2C side is off, so noise on an SPI line cannot be taken for a start condition.
pub const CTRL4_I2C_DISABLE: u8 = 0x04;
/// CTRL4_C: the gyroscope's LPF1 is in the path.
pub const CTRL4_LPF1_SEL_G: u8 = 0x02;

/// CTRL5_C: the accelerometer's self-test deflects towards plus.
pub const CTRL5_ST_XL_POSITIVE: u8 = 0x01;
/// CTRL5_C: the accelerometer's self-test deflects towards minus.
pub const CTRL5_ST_XL_NEGATIVE: u8 = 0x02;
/// CTRL5_C: the gyroscope's self-test deflects towards plus.
pub const CTRL5_ST_G_POSITIVE: u8 = 0x04;
/// CTRL5_C: the gyroscope's self-test deflects towards minus.
pub const CTRL5_ST_G_NEGATIVE: u8 = 0x0C;

/// CTRL9_XL: the three axis bits of the DEN function as after reset, and DEVICE_CONF, which the
/// data sheet asks for in every set-up.
pub const CTRL9_DEVICE_CONF: u8 = 0xE2;

/// STATUS_REG: a new acceleration is there.
pub const STATUS_XLDA: u8 = 0x01;
/// STATUS_REG: a new rate is there.
pub const STATUS_GDA: u8 = 0x02;

/// FIFO_STATUS2: the two high bits of the level.
pub const FIFO_LEVEL_HIGH: u8 = 0x03;
/// FIFO_STATUS2: a word was overwritten, now (bit 6) or since the last look (bit 3).
pub const FIFO_OVERRUN: u8 = 0x48;

/// PIN_CTRL: the bits with a meaning; the others hold what they please.
pub const PIN_CTRL_MASK: u8 = 0xC0;

/// A register by the data sheet's name; the value is its address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Register {
    /// Which bank of registers the addresses mean.
    FuncCfgAccess = 0x01,
    /// Pull-ups of the pins.
    PinCtrl = 0x02,
    /// FIFO threshold, low byte.
    FifoCtrl1 = 0x07,
    /// FIFO threshold, high bit; compression.
    FifoCtrl2 = 0x08,
    /// Rates at which both sensors go to the FIFO.
    FifoCtrl3 = 0x09,
    /// FIFO mode; temperature and time stamps in the FIFO.
    FifoCtrl4 = 0x0A,
    /// Pulsed data-ready; batch counter.
    CounterBdrReg1 = 0x0B,
    /// Threshold of the batch counter.
    CounterBdrReg2 = 0x0C,
    /// What reaches the INT1 pin.
    Int1Ctrl = 0x0D,
    /// What reaches the INT2 pin.
    Int2Ctrl = 0x0E,
    /// Identity of the part.
    WhoAmI = 0x0F,
    /// Accelerometer: data rate, range, LPF2.
    Ctrl1Xl = 0x10,
    /// Gyroscope: data rate, range.
    Ctrl2G = 0x11,
    /// Boot, reset, block data update, bus options.
    Ctrl3C = 0x12,
    /// I2C off, LPF1 of the gyroscope, its sleep.
    Ctrl4C = 0x13,
    /// Self-tests, rounding.
    Ctrl5C = 0x14,
    /// Bandwidth of LPF1, the accelerometer's power mode.
    Ctrl6C = 0x15,
    /// High-pass and power mode of the gyroscope.
    Ctrl7G = 0x16,
    /// Bandwidth of the accelerometer's LPF2, its high-pass.
    Ctrl8Xl = 0x17,
    /// Data-enable function, DEVICE_CONF.
    Ctrl9Xl = 0x18,
    /// Time stamps.
    Ctrl10C = 0x19,
    /// Data-ready flags; the first byte of the sample burst.
    StatusReg = 0x1E,
    /// FIFO level, low byte.
    FifoStatus1 = 0x3A,
    /// Tap: axes, latching.
    TapCfg0 = 0x56,
    /// Tap: priority, threshold X.
    TapCfg1 = 0x57,
    /// Interrupt enable, inactivity, threshold Y.
    TapCfg2 = 0x58,
    /// 4D, 6D and threshold Z.
    TapThs6d = 0x59,
    /// Tap: durations.
    IntDur2 = 0x5A,
    /// Wake-up threshold.
    WakeUpThs = 0x5B,
    /// Wake-up and sleep durations.
    WakeUpDur = 0x5C,
    /// Free fall.
    FreeFall = 0x5D,
    /// Events on INT1.
    Md1Cfg = 0x5E,
    /// Events on INT2.
    Md2Cfg = 0x5F,
    /// User offset X.
    XOfsUsr = 0x73,
    /// User offset Y.
    YOfsUsr = 0x74,
    /// User offset Z.
    ZOfsUsr = 0x75,
    /// Tag of the oldest FIFO word; its six bytes follow.
    FifoDataOutTag = 0x78,
}

impl Register {
    /// Seven-bit address on the wire.
    pub const fn address(self) -> u8 {
        self as u8
    }

    /// The data sheet's name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::FuncCfgAccess => "FUNC_CFG_ACCESS",
            Self::PinCtrl => "PIN_CTRL",
            Self::FifoCtrl1 => "FIFO_CTRL1",
            Self::FifoCtrl2 => "FIFO_CTRL2",
            Self::FifoCtrl3 => "FIFO_CTRL3",
            Self::FifoCtrl4 => "FIFO_CTRL4",
            Self::CounterBdrReg1 => "COUNTER_BDR_REG1",
            Self::CounterBdrReg2 => "COUNTER_BDR_REG2",
            Self::Int1Ctrl => "INT1_CTRL",
            Self::Int2Ctrl => "INT2_CTRL",
            Self::WhoAmI => "WHO_AM_I",
            Self::Ctrl1Xl => "CTRL1_XL",
            Self::Ctrl2G => "CTRL2_G",
            Self::Ctrl3C => "CTRL3_C",
            Self::Ctrl4C => "CTRL4_C",
            Self::Ctrl5C => "CTRL5_C",
            Self::Ctrl6C => "CTRL6_C",
            Self::Ctrl7G => "CTRL7_G",
            Self::Ctrl8Xl => "CTRL8_XL",
            Self::Ctrl9Xl => "CTRL9_XL",
            Self::Ctrl10C => "CTRL10_C",
            Self::StatusReg => "STATUS_REG",
            Self::FifoStatus1 => "FIFO_STATUS1",
            Self::TapCfg0 => "TAP_CFG0",
            Self::TapCfg1 => "TAP_CFG1",
            Self::TapCfg2 => "TAP_CFG2",
            Self::TapThs6d => "TAP_THS_6D",
            Self::IntDur2 => "INT_DUR2",
            Self::WakeUpThs => "WAKE_UP_THS",
            Self::WakeUpDur => "WAKE_UP_DUR",
            Self::FreeFall => "FREE_FALL",
            Self::Md1Cfg => "MD1_CFG",
            Self::Md2Cfg => "MD2_CFG",
            Self::XOfsUsr => "X_OFS_USR",
            Self::YOfsUsr => "Y_OFS_USR",
            Self::ZOfsUsr => "Z_OFS_USR",
            Self::FifoDataOutTag => "FIFO_DATA_OUT_TAG",
        }
    }
}

impl fmt::Display for Register {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({:02X}h)", self.name(), self.address())
    }
}
