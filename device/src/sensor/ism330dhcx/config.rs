//! What the part is told to do: ranges, rate, filters and FIFO.
//!
//! In: a [`Config`], an immutable value. Out: the bytes of the configuration registers (data sheet
//! DS13012, CTRL1_XL to CTRL10_C and FIFO_CTRL1 to 4). Both sensors run at one rate in
//! high-performance mode, so that a sample is a pair. Left out: the low-power modes, the
//! gyroscope's sleep and both high-pass filters, which would take gravity and slow turns away.

use tilt::sample::{FullScale, RateRange};

use super::registers::{
    CTRL1_LPF2, CTRL3_BDU, CTRL3_IF_INC, CTRL4_I2C_DISABLE, CTRL4_LPF1_SEL_G, CTRL9_DEVICE_CONF,
};

/// How late a rate is in [`Config::PRODUCT`], in thousandths of a sample: 0.690, which is 1.66 ms.
///
/// That of a second-order low-pass of 135.9 Hz, 1 / (sqrt(2) pi f). The bandwidth of LPF2 at
/// 417 Hz is \[RECALL\] from the application note; with LPF1 at its widest the data sheet of the
/// ASM330LHH has 134 Hz (table 53), so LPF2 cannot be lower. The order is \[ASSUME\].
pub const GYROSCOPE_DELAY_MILLISAMPLES: u32 = 690;

/// How late an acceleration is in [`Config::PRODUCT`], in thousandths of a sample: 0.450, which is
/// 1.08 ms.
///
/// That of a second-order low-pass of half the rate, 208.3 Hz. The bandwidth is the data sheet's
/// (accelerometer bandwidth configurations, LPF2 off), the order \[ASSUME\].
pub const ACCELEROMETER_DELAY_MILLISAMPLES: u32 = 450;

/// Output data rate of both sensors (data sheet, CTRL1_XL and CTRL2_G, bits ODR).
///
/// The names are rounded: each rate is 6667 Hz divided by a power of two, 150 us times that power,
/// while the data sheet's names (416 Hz) are up to 4 % off. The part's own clock makes the rate;
/// its tolerance was not checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataRate {
    /// 13.02 Hz (12.5 Hz by name).
    Hz13,
    /// 26.04 Hz.
    Hz26,
    /// 52.08 Hz: the accelerometer's self-test.
    Hz52,
    /// 104.2 Hz.
    Hz104,
    /// 208.3 Hz: the gyroscope's self-test.
    Hz208,
    /// 416.7 Hz: the product's rate.
    Hz417,
    /// 833.3 Hz.
    Hz833,
    /// 1667 Hz.
    Hz1667,
}

impl DataRate {
    /// Nominal time between two samples in microseconds, 600 to 76 800.
    pub const fn period_us(self) -> u32 {
        76_800 >> (self.odr().saturating_sub(1))
    }

    /// Nominal rate in millihertz, rounded down.
    pub const fn millihertz(self) -> u32 {
        1_000_000_000 / self.period_us()
    }

    /// The ODR field, bits 7..4 of CTRL1_XL and CTRL2_G: 1 to 8.
    pub(super) const fn odr(self) -> u8 {
        match self {
            Self::Hz13 => 1,
            Self::Hz26 => 2,
            Self::Hz52 => 3,
            Self::Hz104 => 4,
            Self::Hz208 => 5,
            Self::Hz417 => 6,
            Self::Hz833 => 7,
            Self::Hz1667 => 8,
        }
    }
}

/// Corner of the accelerometer's low-pass as a share of the data rate (data sheet, accelerometer
/// bandwidth configurations).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bandwidth {
    /// Rate / 2: LPF2 is not in the path. The least delay.
    #[default]
    Half,
    /// Rate / 4.
    Quarter,
    /// Rate / 10.
    Tenth,
    /// Rate / 20.
    Twentieth,
    /// Rate / 45.
    FortyFifth,
}

impl Bandwidth {
    /// LPF2_XL_EN of CTRL1_XL and HPCF_XL, bits 7..5 of CTRL8_XL.
    const fn fields(self) -> (u8, u8) {
        match self {
            Self::Half => (0, 0),
            Self::Quarter => (CTRL1_LPF2, 0),
            Self::Tenth => (CTRL1_LPF2, 1 << 5),
            Self::Twentieth => (CTRL1_LPF2, 2 << 5),
            Self::FortyFifth => (CTRL1_LPF2, 3 << 5),
        }
    }
}

/// The gyroscope's low-passes: LPF2 always, by the data rate, and LPF1 before it if wanted.
///
/// The bandwidths of both together at 417 Hz are those of the ASM330LHH's data sheet (DocID031239,
/// table 53), which the ISM330DHCX's was not compared with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RateFilter {
    /// LPF2 alone, 135.9 Hz at 417 Hz \[RECALL\]. The least delay.
    #[default]
    Lpf2,
    /// With FTYPE 0: 133 Hz.
    Wide,
    /// With FTYPE 4: 86 Hz.
    Medium,
    /// With FTYPE 5: 48 Hz.
    Narrow,
    /// With FTYPE 6: 24.6 Hz.
    Narrowest,
}

impl RateFilter {
    /// LPF1_SEL_G of CTRL4_C and FTYPE, bits 2..0 of CTRL6_C.
    const fn fields(self) -> (u8, u8) {
        match self {
            Self::Lpf2 => (0, 0),
            Self::Wide => (CTRL4_LPF1_SEL_G, 0),
            Self::Medium => (CTRL4_LPF1_SEL_G, 4),
            Self::Narrow => (CTRL4_LPF1_SEL_G, 5),
            Self::Narrowest => (CTRL4_LPF1_SEL_G, 6),
        }
    }
}

/// What the FIFO does with both sensors' samples. A threshold above 511 words is cut to 511.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fifo {
    /// Off and empty.
    #[default]
    Bypass,
    /// Collects until it is full, then stops.
    StopWhenFull {
        /// Level in words at which the threshold flag rises, 1 to 511.
        threshold: u16,
    },
    /// Collects without end; the oldest word gives way to the newest.
    Continuous {
        /// Level in words at which the threshold flag rises, 1 to 511.
        threshold: u16,
    },
}

impl Fifo {
    /// FIFO_CTRL1 to 4 (07h to 0Ah): threshold, both batch rates, mode.
    pub(super) const fn control(self, rate: DataRate) -> [u8; 4] {
        let (threshold, mode) = match self {
            Self::Bypass => return [0; 4],
            Self::StopWhenFull { threshold } => (threshold, 0x01),
            Self::Continuous { threshold } => (threshold, 0x06),
        };
        let limited = if threshold > 511 { 511 } else { threshold };
        let [low, high] = limited.to_le_bytes();
        [low, high, (rate.odr() << 4) | rate.odr(), mode]
    }
}

/// The bytes that a configuration comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Setup {
    /// CTRL1_XL to CTRL10_C (10h to 19h).
    pub control: [u8; 10],
    /// FIFO_CTRL1 to FIFO_CTRL4 (07h to 0Ah).
    pub fifo: [u8; 4],
}

/// Everything the driver sets; the rest keeps its reset value and is checked to have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Measuring range of the accelerometer.
    pub full_scale: FullScale,
    /// Measuring range of the gyroscope.
    pub range: RateRange,
    /// Output data rate of both sensors, high-performance mode.
    pub rate: DataRate,
    /// Corner of the accelerometer's low-pass.
    pub bandwidth: Bandwidth,
    /// The gyroscope's low-passes.
    pub rate_filter: RateFilter,
    /// FIFO mode.
    pub fifo: Fifo,
}

impl Config {
    /// Product mode: 417 Hz, +-4 g, +-500 deg/s, the widest filters (CTRL1_XL 68h, CTRL2_G 64h).
    ///
    /// An excavator turns with at most 60 deg/s and the test swing with 80, but a bucket that
    /// strikes makes short rates several times as large, and a clipped rate loses the vertical.
    /// +-500 deg/s costs nothing: rounding to 17.5 mdps is 5 mdps rms, beside 58 mdps of white
    /// noise in a sample. +-4 g for the same reason. Both filters are the widest ones, since each
    /// narrower one only adds delay, which the estimator would have to undo.
    pub const PRODUCT: Self = Self {
        full_scale: FullScale::G4,
        range: RateRange::Dps500,
        rate: DataRate::Hz417,
        bandwidth: Bandwidth::Half,
        rate_filter: RateFilter::Lpf2,
        fifo: Fifo::Bypass,
    };

    /// The bytes of CTRL1_XL to CTRL10_C (10h to 19h), in that order.
    pub const fn control(&self) -> [u8; 10] {
        let (lpf2_xl, cutoff) = self.bandwidth.fields();
        let (lpf1_g, ftype) = self.rate_filter.fields();
        let odr = self.rate.odr() << 4;
        [
            odr | (full_scale_field(self.full_scale) << 2) | lpf2_xl,
            odr | range_field(self.range),
            CTRL3_BDU | CTRL3_IF_INC,
            CTRL4_I2C_DISABLE | lpf1_g,
            0x00,
            ftype,
            0x00,
            cutoff,
            CTRL9_DEVICE_CONF,
            0x00,
        ]
    }

    /// All bytes of this configuration.
    pub(super) const fn setup(&self) -> Setup {
        Setup {
            control: self.control(),
            fifo: self.fifo.control(self.rate),
        }
    }
}

impl Default for Config {
    /// [`Config::PRODUCT`].
    fn default() -> Self {
        Self::PRODUCT
    }
}

/// FS_XL, bits 3..2 of CTRL1_XL: not in the order of the ranges.
const fn full_scale_field(full_scale: FullScale) -> u8 {
    match full_scale {
        FullScale::G2 => 0,
        FullScale::G16 => 1,
        FullScale::G4 => 2,
        FullScale::G8 => 3,
    }
}

/// FS_G and FS_125, bits 3..1 of CTRL2_G.
const fn range_field(range: RateRange) -> u8 {
    match range {
        RateRange::Dps125 => 0x02,
        RateRange::Dps250 => 0x00,
        RateRange::Dps500 => 0x04,
        RateRange::Dps1000 => 0x08,
        RateRange::Dps2000 => 0x0C,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn product_mode_gives_its_bytes() {
        let want = [0x68, 0x64, 0x44, 0x04, 0, 0, 0, 0, 0xE2, 0];
        assert_eq!(Config::PRODUCT.control(), want);
        assert_eq!(Config::PRODUCT.setup().fifo, [0; 4]);
    }

    #[test]
    fn every_field_has_its_place() {
        let config = Config {
            full_scale: FullScale::G16,
            range: RateRange::Dps125,
            rate: DataRate::Hz1667,
            bandwidth: Bandwidth::FortyFifth,
            rate_filter: RateFilter::Narrowest,
            fifo: Fifo::Continuous { threshold: 900 },
        };
        let want = [0x86, 0x82, 0x44, 0x06, 0, 0x06, 0, 0x60, 0xE2, 0];
        assert_eq!(config.control(), want);
        assert_eq!(config.setup().fifo, [0xFF, 0x01, 0x88, 0x06]);
        let stop = Fifo::StopWhenFull { threshold: 32 }.control(DataRate::Hz52);
        assert_eq!(stop, [32, 0, 0x33, 0x01]);
    }

    #[test]
    fn periods_and_rates_agree() {
        assert_eq!(DataRate::Hz13.period_us(), 76_800);
        assert_eq!(DataRate::Hz417.period_us(), 2_400);
        assert_eq!(DataRate::Hz417.millihertz(), 416_666);
        assert_eq!(DataRate::Hz1667.period_us(), 600);
    }
}
