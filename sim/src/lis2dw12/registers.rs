//! The part's register map as the model sees it: addresses, writable bits, reset values.
//!
//! Written from the data sheet (DS11811) apart from the driver's own table, so that a slip in
//! one of the two shows up in the tests that run them against each other.

use tilt::sample::FullScale;

use crate::spi_part::{ADDRESSES, Registers};

/// Temperature, low byte.
pub const OUT_T_L: u8 = 0x0D;
/// Temperature, high byte.
pub const OUT_T_H: u8 = 0x0E;
/// Identity, always 44h.
pub const WHO_AM_I: u8 = 0x0F;
/// Data rate and power mode.
pub const CTRL1: u8 = 0x20;
/// Boot, reset, block data update, bus options.
pub const CTRL2: u8 = 0x21;
/// Self-test, pin options.
pub const CTRL3: u8 = 0x22;
/// Routing to the INT1 pin.
pub const CTRL4_INT1: u8 = 0x23;
/// Bandwidth, full scale, low noise.
pub const CTRL6: u8 = 0x25;
/// Temperature in whole degrees.
pub const OUT_T: u8 = 0x26;
/// Data-ready and event flags.
pub const STATUS: u8 = 0x27;
/// X axis, low byte: the first of the six output bytes.
pub const OUT_X_L: u8 = 0x28;
/// Z axis, high byte: the last of the six output bytes.
pub const OUT_Z_H: u8 = 0x2D;
/// FIFO mode and threshold.
pub const FIFO_CTRL: u8 = 0x2E;
/// FIFO level and flags.
pub const FIFO_SAMPLES: u8 = 0x2F;
/// Data-ready, temperature-ready and overrun.
pub const STATUS_DUP: u8 = 0x37;
/// Pulsed data-ready, interrupt options.
pub const CTRL7: u8 = 0x3F;

/// Bits that a write can change; all others keep what they hold.
pub const WRITABLE: Registers = {
    let mut mask = [0; ADDRESSES];
    mask[CTRL1 as usize] = 0xFF;
    mask[CTRL2 as usize] = 0xDF;
    mask[CTRL3 as usize] = 0xFB;
    mask[CTRL4_INT1 as usize] = 0xFF;
    mask[0x24] = 0xFF;
    mask[CTRL6 as usize] = 0xFC;
    // FIFO_CTRL, then the tap, sleep and free-fall registers.
    mask[FIFO_CTRL as usize] = 0xFF;
    let mut address = 0x30;
    while address <= 0x36 {
        mask[address] = 0xFF;
        address += 1;
    }
    // The user offsets and CTRL7.
    let mut address = 0x3C;
    while address <= 0x3F {
        mask[address] = 0xFF;
        address += 1;
    }
    mask
};

/// What the registers hold after power-up and after SOFT_RESET.
pub const RESET: Registers = {
    let mut registers = [0; ADDRESSES];
    registers[WHO_AM_I as usize] = 0x44;
    registers[CTRL2 as usize] = ctrl2::IF_ADD_INC;
    registers
};

/// Bits of CTRL2.
pub mod ctrl2 {
    /// Reload the trimming values.
    pub const BOOT: u8 = 0x80;
    /// Reset the registers.
    pub const SOFT_RESET: u8 = 0x40;
    /// Block data update.
    pub const BDU: u8 = 0x08;
    /// Address counts up in a burst.
    pub const IF_ADD_INC: u8 = 0x04;
    /// Three-wire SPI: the separate data-out line is not driven.
    pub const SIM: u8 = 0x01;
}

/// Bits of STATUS, STATUS_DUP and FIFO_SAMPLES.
pub mod flag {
    /// STATUS and STATUS_DUP: new sample.
    pub const DRDY: u8 = 0x01;
    /// STATUS: FIFO level at or above the threshold.
    pub const FIFO_THS: u8 = 0x80;
    /// STATUS_DUP: new temperature.
    pub const DRDY_T: u8 = 0x40;
    /// STATUS_DUP: FIFO overrun.
    pub const OVR: u8 = 0x80;
    /// FIFO_SAMPLES: level at or above the threshold.
    pub const FIFO_FTH: u8 = 0x80;
    /// FIFO_SAMPLES: at least one sample was lost.
    pub const FIFO_OVR: u8 = 0x40;
}

/// How the part measures, decoded from CTRL1 and CTRL6.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Nominal data rate in Hz; `None` in power-down, on-demand and reserved modes.
    pub odr_hz: Option<f64>,
    /// Corner of the internal low-pass in Hz; `None` when there is no data rate.
    pub bandwidth_hz: Option<f64>,
    /// White noise density in ug/rtHz at +-2 g \[DS\].
    pub noise_density_ug: f64,
    /// Measuring range.
    pub full_scale: FullScale,
    /// Significant bits of a sample: 14, or 12 in low-power mode 1.
    pub bits: u32,
}

impl Mode {
    /// Decodes CTRL1 and CTRL6.
    pub fn decode(ctrl1: u8, ctrl6: u8) -> Self {
        let power = Power::decode(ctrl1);
        let odr_hz = power.odr_hz(ctrl1 >> 4);
        Self {
            odr_hz,
            bandwidth_hz: odr_hz.map(|odr_hz| power.bandwidth_hz(odr_hz, ctrl6 >> 6)),
            noise_density_ug: power.noise_density_ug(ctrl6 & 0x04 != 0),
            full_scale: match (ctrl6 >> 4) & 3 {
                0 => FullScale::G2,
                1 => FullScale::G4,
                2 => FullScale::G8,
                _ => FullScale::G16,
            },
            bits: if power == Power::Low(1) { 12 } else { 14 },
        }
    }
}

/// CTRL1, MODE and LP_MODE.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Power {
    /// High-performance mode.
    High,
    /// Low-power mode 1 to 4.
    Low(u8),
    /// Conversion on demand (not modelled: never converts) or reserved.
    OnDemand,
}

impl Power {
    fn decode(ctrl1: u8) -> Self {
        match (ctrl1 >> 2) & 3 {
            0 => Self::Low((ctrl1 & 3) + 1),
            1 => Self::High,
            _ => Self::OnDemand,
        }
    }

    /// Low-power modes end at 200 Hz and alone have 1.6 Hz.
    fn odr_hz(self, field: u8) -> Option<f64> {
        let high_hz = match field {
            1 | 2 => 12.5,
            3 => 25.0,
            4 => 50.0,
            5 => 100.0,
            6 => 200.0,
            7 => 400.0,
            8 => 800.0,
            9 => 1600.0,
            _ => return None,
        };
        match (self, field) {
            (Self::High, _) => Some(high_hz),
            (Self::Low(_), 1) => Some(1.6),
            (Self::Low(_), _) => Some(f64::min(high_hz, 200.0)),
            (Self::OnDemand, _) => None,
        }
    }

    /// High performance: a share of the rate. Low power: fixed \[DS\], the order of the four
    /// figures over the modes is \[RECALL\]; a smaller digital corner goes before it.
    fn bandwidth_hz(self, odr_hz: f64, field: u8) -> f64 {
        let low_power_hz = match self {
            Self::Low(1) => 3200.0,
            Self::Low(2) => 720.0,
            Self::Low(3) => 360.0,
            Self::Low(_) => 180.0,
            Self::High | Self::OnDemand => f64::INFINITY,
        };
        let share_hz = match (field, self) {
            (0, Self::Low(_)) => f64::INFINITY,
            (0, _) => f64::min(odr_hz / 2.0, 400.0),
            (1, _) => odr_hz / 4.0,
            (2, _) => odr_hz / 10.0,
            _ => odr_hz / 20.0,
        };
        f64::min(low_power_hz, share_hz)
    }

    /// Noise density at +-2 g \[DS\]. The one figure per low-power mode stands for both settings
    /// of LOW_NOISE.
    fn noise_density_ug(self, low_noise: bool) -> f64 {
        match self {
            Self::Low(1) => 450.0,
            Self::Low(2) => 240.0,
            Self::Low(3) => 180.0,
            Self::Low(_) => 130.0,
            Self::High | Self::OnDemand if low_noise => 90.0,
            Self::High | Self::OnDemand => 110.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn product_and_paper_modes() {
        let product = Mode::decode(0x74, 0x04);
        assert_eq!(product.odr_hz, Some(400.0));
        assert_eq!(product.bandwidth_hz, Some(200.0));
        assert_eq!(product.noise_density_ug, 90.0);
        assert_eq!((product.full_scale, product.bits), (FullScale::G2, 14));
        let paper = Mode::decode(0x44, 0x00);
        assert_eq!((paper.odr_hz, paper.bandwidth_hz), (Some(50.0), Some(25.0)));
        assert_eq!(paper.noise_density_ug, 110.0);
    }

    #[test]
    fn rates_and_bandwidths_at_the_ends() {
        assert_eq!(Mode::decode(0x04, 0).odr_hz, None);
        assert_eq!(Mode::decode(0xA4, 0).odr_hz, None);
        assert_eq!(Mode::decode(0x78, 0).odr_hz, None);
        assert_eq!(Mode::decode(0x94, 0x00).bandwidth_hz, Some(400.0));
        assert_eq!(Mode::decode(0x94, 0xC0).bandwidth_hz, Some(80.0));
        assert_eq!(Mode::decode(0x14, 0x40).bandwidth_hz, Some(3.125));
    }

    #[test]
    fn low_power_modes_are_noisy_wide_and_slow() {
        let first = Mode::decode(0x70, 0x30);
        assert_eq!(
            (first.odr_hz, first.bandwidth_hz),
            (Some(200.0), Some(3200.0))
        );
        assert_eq!((first.noise_density_ug, first.bits), (450.0, 12));
        assert_eq!(first.full_scale, FullScale::G16);
        let fourth = Mode::decode(0x13, 0);
        assert_eq!(
            (fourth.odr_hz, fourth.bandwidth_hz),
            (Some(1.6), Some(180.0))
        );
        assert_eq!((fourth.noise_density_ug, fourth.bits), (130.0, 14));
    }

    #[test]
    fn status_and_outputs_are_read_only() {
        for address in [
            OUT_T_L,
            WHO_AM_I,
            OUT_T,
            STATUS,
            OUT_X_L,
            OUT_Z_H,
            FIFO_SAMPLES,
            0x40,
        ] {
            assert_eq!(WRITABLE[usize::from(address)], 0, "{address:02X}h");
        }
    }
}
