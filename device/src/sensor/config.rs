//! What the part is told to do: range, rate, bandwidth, noise setting and FIFO.
//!
//! In: a [`Config`], an immutable value. Out: the bytes of the configuration registers
//! (data sheet DS11811, CTRL1, CTRL6 and FIFO_CTRL). Only high-performance mode is offered:
//! the low-power modes have a fixed bandwidth of 180 to 3200 Hz, so vibration would alias into
//! the angle.

use tilt::sample::FullScale;

use super::registers::{
    CTRL2_BDU, CTRL2_I2C_DISABLE, CTRL2_IF_ADD_INC, CTRL4_DRDY, CTRL6_LOW_NOISE,
};

/// Output data rate in high-performance mode (data sheet, CTRL1 bits ODR).
///
/// The names are nominal. The part's own clock makes the rate, and the data sheet gives it no
/// tolerance: the error model allows +-10 % \[ASSUME\].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// 12.5 Hz.
    Hz12_5,
    /// 25 Hz.
    Hz25,
    /// 50 Hz: the paper's rate (R1).
    Hz50,
    /// 100 Hz.
    Hz100,
    /// 200 Hz.
    Hz200,
    /// 400 Hz: the product's rate.
    Hz400,
    /// 800 Hz.
    Hz800,
    /// 1600 Hz.
    Hz1600,
}

impl Rate {
    /// Nominal time between two samples in microseconds, 625 to 80 000, exact.
    pub const fn period_us(self) -> u32 {
        match self {
            Self::Hz12_5 => 80_000,
            Self::Hz25 => 40_000,
            Self::Hz50 => 20_000,
            Self::Hz100 => 10_000,
            Self::Hz200 => 5_000,
            Self::Hz400 => 2_500,
            Self::Hz800 => 1_250,
            Self::Hz1600 => 625,
        }
    }

    /// Nominal rate in millihertz, exact: a whole number also for 12.5 Hz.
    pub const fn millihertz(self) -> u32 {
        1_000_000_000 / self.period_us()
    }

    /// The ODR field, bits 7..4 of CTRL1.
    const fn odr(self) -> u8 {
        match self {
            Self::Hz12_5 => 0x2,
            Self::Hz25 => 0x3,
            Self::Hz50 => 0x4,
            Self::Hz100 => 0x5,
            Self::Hz200 => 0x6,
            Self::Hz400 => 0x7,
            Self::Hz800 => 0x8,
            Self::Hz1600 => 0x9,
        }
    }
}

/// Corner of the part's digital low-pass as a share of the data rate (CTRL6 bits BW_FILT).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bandwidth {
    /// Rate / 2, but 400 Hz at 1600 Hz.
    #[default]
    Half,
    /// Rate / 4.
    Quarter,
    /// Rate / 10.
    Tenth,
    /// Rate / 20.
    Twentieth,
}

impl Bandwidth {
    /// The BW_FILT field, bits 7..6 of CTRL6.
    const fn field(self) -> u8 {
        match self {
            Self::Half => 0,
            Self::Quarter => 1,
            Self::Tenth => 2,
            Self::Twentieth => 3,
        }
    }
}

/// What the 32-deep FIFO does (FIFO_CTRL). A threshold above 31 is cut to 31.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fifo {
    /// Off and empty: the output registers hold the newest sample.
    #[default]
    Bypass,
    /// Collects 32 samples, then stops.
    StopWhenFull {
        /// Level at which the threshold flag rises, 1 to 31.
        threshold: u8,
    },
    /// Collects without end; the oldest sample gives way to the newest.
    Continuous {
        /// Level at which the threshold flag rises, 1 to 31.
        threshold: u8,
    },
}

impl Fifo {
    /// The byte for FIFO_CTRL: FMODE in bits 7..5, FTH in bits 4..0.
    pub(super) const fn control(self) -> u8 {
        match self {
            Self::Bypass => 0x00,
            Self::StopWhenFull { threshold } => 0x20 | limit_threshold(threshold),
            Self::Continuous { threshold } => 0xC0 | limit_threshold(threshold),
        }
    }
}

/// The threshold as the five bits of FTH.
const fn limit_threshold(threshold: u8) -> u8 {
    if threshold > 31 { 31 } else { threshold }
}

/// Everything the driver sets; the rest keeps its reset value and is checked to have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Measuring range.
    pub full_scale: FullScale,
    /// Output data rate, high-performance mode.
    pub rate: Rate,
    /// Corner of the part's low-pass.
    pub bandwidth: Bandwidth,
    /// Low-noise configuration: 90 instead of 110 ug/rtHz at +-2 g \[DS\].
    pub low_noise: bool,
    /// FIFO mode.
    pub fifo: Fifo,
}

impl Config {
    /// Product mode: 400 Hz, +-2 g, bandwidth 200 Hz, low noise (CTRL1 74h, CTRL6 04h).
    pub const PRODUCT: Self = Self {
        full_scale: FullScale::G2,
        rate: Rate::Hz400,
        bandwidth: Bandwidth::Half,
        low_noise: true,
        fifo: Fifo::Bypass,
    };

    /// Paper mode (R1): 50 Hz, +-2 g, bandwidth 25 Hz, low noise (CTRL1 44h, CTRL6 04h).
    pub const PAPER: Self = Self {
        rate: Rate::Hz50,
        ..Self::PRODUCT
    };

    /// What the self-test procedure asks for: 50 Hz, +-4 g, FIFO off.
    pub(super) const SELF_TEST: Self = Self {
        full_scale: FullScale::G4,
        rate: Rate::Hz50,
        bandwidth: Bandwidth::Half,
        low_noise: false,
        fifo: Fifo::Bypass,
    };

    /// The bytes of CTRL1 to CTRL6 (20h to 25h), in that order.
    pub const fn control(&self) -> [u8; 6] {
        [
            (self.rate.odr() << 4) | 0x04,
            CTRL2_BDU | CTRL2_IF_ADD_INC | CTRL2_I2C_DISABLE,
            0x00,
            CTRL4_DRDY,
            0x00,
            (self.bandwidth.field() << 6)
                | ((self.full_scale.log2() as u8) << 4)
                | (if self.low_noise { CTRL6_LOW_NOISE } else { 0 }),
        ]
    }
}

impl Default for Config {
    /// [`Config::PRODUCT`].
    fn default() -> Self {
        Self::PRODUCT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_modes_give_the_bytes_of_the_set_up_that_works() {
        assert_eq!(
            Config::PRODUCT.control(),
            [0x74, 0x0E, 0x00, 0x01, 0x00, 0x04]
        );
        assert_eq!(
            Config::PAPER.control(),
            [0x44, 0x0E, 0x00, 0x01, 0x00, 0x04]
        );
        assert_eq!(Config::PRODUCT.fifo.control(), 0x00);
    }

    #[test]
    fn every_field_has_its_place() {
        let config = Config {
            full_scale: FullScale::G16,
            rate: Rate::Hz1600,
            bandwidth: Bandwidth::Twentieth,
            low_noise: false,
            fifo: Fifo::Continuous { threshold: 200 },
        };
        assert_eq!(config.control(), [0x94, 0x0E, 0x00, 0x01, 0x00, 0xF0]);
        assert_eq!(config.fifo.control(), 0xDF);
        assert_eq!(Fifo::StopWhenFull { threshold: 16 }.control(), 0x30);
        assert_eq!(
            Config::SELF_TEST.control(),
            [0x44, 0x0E, 0x00, 0x01, 0x00, 0x10]
        );
    }

    #[test]
    fn periods_and_rates_agree() {
        assert_eq!(Rate::Hz12_5.millihertz(), 12_500);
        assert_eq!(Rate::Hz50.period_us(), 20_000);
        assert_eq!(Rate::Hz400.period_us(), 2_500);
        assert_eq!(Rate::Hz1600.millihertz(), 1_600_000);
    }
}
