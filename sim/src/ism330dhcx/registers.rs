//! The part's register map as the model sees it: addresses, writable bits, reset values.
//!
//! Written from the data sheet (DS13012) and ST's open driver apart from the instrument driver's
//! own table, so that a slip in one of the two shows up in the tests that run them against each
//! other. Reset values that are not zero are \[RECALL\] but for WHO_AM_I and CTRL3_C.

use tilt::sample::{FullScale, RateRange};

use crate::spi_part::{ADDRESSES, Registers};

/// Bank of registers: user, sensor hub or embedded functions.
pub const FUNC_CFG_ACCESS: u8 = 0x01;
/// Pull-ups of the pins.
pub const PIN_CTRL: u8 = 0x02;
/// FIFO threshold, low byte.
pub const FIFO_CTRL1: u8 = 0x07;
/// FIFO threshold, high bit.
pub const FIFO_CTRL2: u8 = 0x08;
/// Batch rates: gyroscope in the upper half, accelerometer in the lower.
pub const FIFO_CTRL3: u8 = 0x09;
/// FIFO mode.
pub const FIFO_CTRL4: u8 = 0x0A;
/// Pulsed data-ready.
pub const COUNTER_BDR_REG1: u8 = 0x0B;
/// Routing to the INT1 pin.
pub const INT1_CTRL: u8 = 0x0D;
/// Identity, always 6Bh.
pub const WHO_AM_I: u8 = 0x0F;
/// Accelerometer: rate, range, LPF2.
pub const CTRL1_XL: u8 = 0x10;
/// Gyroscope: rate, range.
pub const CTRL2_G: u8 = 0x11;
/// Boot, reset, block data update, bus options.
pub const CTRL3_C: u8 = 0x12;
/// LPF1, I2C, sleep of the gyroscope.
pub const CTRL4_C: u8 = 0x13;
/// Self-tests.
pub const CTRL5_C: u8 = 0x14;
/// FTYPE.
pub const CTRL6_C: u8 = 0x15;
/// Corner of the accelerometer's LPF2.
pub const CTRL8_XL: u8 = 0x17;
/// Data-enable function, DEVICE_CONF.
pub const CTRL9_XL: u8 = 0x18;
/// Data-ready flags.
pub const STATUS_REG: u8 = 0x1E;
/// Temperature, low byte; the rates follow it, and the accelerations those.
pub const OUT_TEMP_L: u8 = 0x20;
/// Z of the accelerometer, high byte: the last output byte.
pub const OUTZ_H_A: u8 = 0x2D;
/// FIFO level, low byte.
pub const FIFO_STATUS1: u8 = 0x3A;
/// FIFO level, high bits, and flags.
pub const FIFO_STATUS2: u8 = 0x3B;
/// Tag of the FIFO word; its six bytes follow.
pub const FIFO_DATA_OUT_TAG: u8 = 0x78;
/// The last byte of the FIFO word.
pub const FIFO_DATA_OUT_Z_H: u8 = 0x7E;

/// Bits that a write can change; all others keep what they hold.
pub const WRITABLE: Registers = {
    let mut mask = [0; ADDRESSES];
    mask[FUNC_CFG_ACCESS as usize] = 0xC0;
    mask[PIN_CTRL as usize] = 0xC0;
    mask[FIFO_CTRL1 as usize] = 0xFF;
    mask[FIFO_CTRL2 as usize] = 0xD7;
    mask[FIFO_CTRL3 as usize] = 0xFF;
    mask[FIFO_CTRL4 as usize] = 0xF7;
    mask[COUNTER_BDR_REG1 as usize] = 0xE7;
    mask[0x0C] = 0xFF;
    mask[INT1_CTRL as usize] = 0xFF;
    mask[0x0E] = 0x7F;
    mask[CTRL1_XL as usize] = 0xFE;
    mask[CTRL2_G as usize] = 0xFF;
    mask[CTRL3_C as usize] = 0xFD;
    mask[CTRL4_C as usize] = 0x6E;
    mask[CTRL5_C as usize] = 0x6F;
    mask[CTRL6_C as usize] = 0xFF;
    mask[0x16] = 0xF7;
    mask[CTRL8_XL as usize] = 0xFD;
    mask[CTRL9_XL as usize] = 0xFE;
    mask[0x19] = 0x20;
    // The event engine and the user offsets.
    let mut address = 0x56;
    while address <= 0x5F {
        mask[address] = 0xFF;
        address += 1;
    }
    let mut address = 0x73;
    while address <= 0x75 {
        mask[address] = 0xFF;
        address += 1;
    }
    mask
};

/// What the registers hold after power-up and after SW_RESET.
pub const RESET: Registers = {
    let mut registers = [0; ADDRESSES];
    registers[PIN_CTRL as usize] = 0x3F;
    registers[WHO_AM_I as usize] = 0x6B;
    registers[CTRL3_C as usize] = ctrl3::IF_INC;
    registers[CTRL9_XL as usize] = 0xE0;
    registers
};

/// Bits of CTRL3_C.
pub mod ctrl3 {
    /// Reload the trimming values.
    pub const BOOT: u8 = 0x80;
    /// Block data update.
    pub const BDU: u8 = 0x40;
    /// The INT pins are low when they are active.
    pub const H_LACTIVE: u8 = 0x20;
    /// Three-wire SPI: the separate data-out line is not driven.
    pub const SIM: u8 = 0x08;
    /// Address counts up in a burst.
    pub const IF_INC: u8 = 0x04;
    /// Reset the registers.
    pub const SW_RESET: u8 = 0x01;
}

/// Bits of STATUS_REG, FIFO_STATUS2 and INT1_CTRL.
pub mod flag {
    /// STATUS_REG, INT1_CTRL: new acceleration.
    pub const XLDA: u8 = 0x01;
    /// STATUS_REG, INT1_CTRL: new rate.
    pub const GDA: u8 = 0x02;
    /// STATUS_REG: new temperature.
    pub const TDA: u8 = 0x04;
    /// FIFO_STATUS2: level at or above the threshold.
    pub const FIFO_WTM: u8 = 0x80;
    /// FIFO_STATUS2: a word was lost and none taken since.
    pub const FIFO_OVR: u8 = 0x40;
    /// FIFO_STATUS2: full.
    pub const FIFO_FULL: u8 = 0x20;
    /// FIFO_STATUS2: a word was lost since this register was read.
    pub const FIFO_OVR_LATCHED: u8 = 0x08;
    /// INT1_CTRL: FIFO threshold.
    pub const INT1_FIFO_TH: u8 = 0x08;
    /// INT1_CTRL: FIFO overrun.
    pub const INT1_FIFO_OVR: u8 = 0x10;
    /// INT1_CTRL: FIFO full.
    pub const INT1_FIFO_FULL: u8 = 0x20;
}

/// How the part measures, decoded from CTRL1_XL, CTRL2_G, CTRL4_C, CTRL6_C and CTRL8_XL.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// ODR field of the accelerometer, 1 to 10; 0 in power-down and reserved modes.
    pub accelerometer_odr: u32,
    /// ODR field of the gyroscope, likewise.
    pub gyroscope_odr: u32,
    /// Range of the accelerometer.
    pub full_scale: FullScale,
    /// Range of the gyroscope.
    pub range: RateRange,
    /// Bandwidth of the accelerometer's path, Hz; 0 in power-down.
    pub accelerometer_bandwidth_hz: f64,
    /// Bandwidth of the gyroscope's path, Hz; 0 in power-down.
    pub gyroscope_bandwidth_hz: f64,
}

impl Mode {
    /// Decodes the registers.
    pub fn decode(registers: &Registers) -> Self {
        let at = |address: u8| registers[usize::from(address)];
        let (ctrl1_xl, ctrl2_g) = (at(CTRL1_XL), at(CTRL2_G));
        // The gyroscope's sleep keeps it from converting.
        let asleep = at(CTRL4_C) & 0x40 != 0;
        let accelerometer_odr = odr_field(ctrl1_xl);
        let gyroscope_odr = if asleep { 0 } else { odr_field(ctrl2_g) };
        let lpf2_xl = (ctrl1_xl & 0x02 != 0).then_some(at(CTRL8_XL) >> 5);
        let lpf1_g = (at(CTRL4_C) & 0x02 != 0).then_some(at(CTRL6_C) & 0x07);
        Self {
            accelerometer_odr,
            gyroscope_odr,
            full_scale: match (ctrl1_xl >> 2) & 3 {
                0 => FullScale::G2,
                1 => FullScale::G16,
                2 => FullScale::G4,
                _ => FullScale::G8,
            },
            range: range(ctrl2_g),
            accelerometer_bandwidth_hz: accelerometer_bandwidth_hz(accelerometer_odr, lpf2_xl),
            gyroscope_bandwidth_hz: gyroscope_bandwidth_hz(gyroscope_odr, lpf1_g),
        }
    }

    /// The faster sensor's ODR field, 0 when both rest: the part's sampling clock.
    pub fn odr(&self) -> u32 {
        self.accelerometer_odr.max(self.gyroscope_odr)
    }
}

/// The ODR field, bits 7..4; the accelerometer's low-power mode of 1.6 Hz is not modelled.
fn odr_field(control: u8) -> u32 {
    match control >> 4 {
        field @ 1..=10 => u32::from(field),
        _ => 0,
    }
}

/// Nominal rate of an ODR field, Hz: 6667 Hz halved with each step below 10.
pub fn odr_hz(field: u32) -> Option<f64> {
    let doublings = i32::try_from(field).unwrap_or(0) - 1;
    (1..=10)
        .contains(&field)
        .then(|| 2f64.powi(doublings) / 0.0768)
}

/// FS_G, FS_125 and FS_4000; +-4000 deg/s is not modelled and measures as +-2000.
fn range(ctrl2_g: u8) -> RateRange {
    match (ctrl2_g & 0x02 != 0, (ctrl2_g >> 2) & 3) {
        (true, _) => RateRange::Dps125,
        (_, 0) => RateRange::Dps250,
        (_, 1) => RateRange::Dps500,
        (_, 2) => RateRange::Dps1000,
        _ => RateRange::Dps2000,
    }
}

/// Half the rate without LPF2, a share by HPCF_XL with it (data sheet, accelerometer bandwidth
/// configurations).
fn accelerometer_bandwidth_hz(odr: u32, lpf2: Option<u8>) -> f64 {
    let Some(odr_hz) = odr_hz(odr) else {
        return 0.0;
    };
    let divisor = match lpf2 {
        None => 2.0,
        Some(0) => 4.0,
        Some(1) => 10.0,
        Some(2) => 20.0,
        Some(3) => 45.0,
        Some(4) => 100.0,
        Some(5) => 200.0,
        Some(6) => 400.0,
        Some(_) => 800.0,
    };
    odr_hz / divisor
}

/// LPF2 alone by the data rate, Hz, for ODR fields 1 to 10 \[RECALL\].
const LPF2_HZ: [f64; 10] = [
    4.3, 8.3, 16.7, 33.0, 66.8, 135.9, 295.5, 1108.1, 1320.7, 1441.8,
];

/// LPF1 and LPF2 together, Hz, by FTYPE and ODR field (ASM330LHH, DocID031239, table 53; the
/// ISM330DHCX's own table was not compared). Where it has none, the last one stands.
const LPF1_HZ: [[f64; 10]; 8] = [
    [
        4.3, 8.3, 16.7, 33.0, 67.0, 133.0, 222.0, 274.0, 292.0, 297.0,
    ],
    [
        4.3, 8.3, 16.7, 33.0, 67.0, 128.0, 186.0, 212.0, 220.0, 223.0,
    ],
    [
        4.3, 8.3, 16.7, 33.0, 67.0, 112.0, 140.0, 150.0, 153.0, 154.0,
    ],
    [
        4.3, 8.3, 16.7, 33.0, 67.0, 134.0, 260.0, 390.0, 451.0, 470.0,
    ],
    [4.3, 8.3, 16.7, 34.0, 62.0, 86.0, 96.0, 99.0, 99.0, 99.0],
    [4.3, 8.3, 16.9, 31.0, 43.0, 48.0, 49.0, 50.0, 50.0, 50.0],
    [4.3, 8.3, 13.4, 19.0, 23.0, 24.6, 25.0, 25.0, 25.0, 25.0],
    [4.3, 8.3, 9.8, 11.6, 12.2, 12.4, 12.6, 12.6, 12.6, 12.6],
];

fn gyroscope_bandwidth_hz(odr: u32, ftype: Option<u8>) -> f64 {
    let Some(column) = (odr as usize).checked_sub(1) else {
        return 0.0;
    };
    match ftype {
        None => LPF2_HZ[column],
        Some(ftype) => LPF1_HZ[usize::from(ftype & 7)][column],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(bytes: &[(u8, u8)]) -> Mode {
        let mut registers = RESET;
        for (address, value) in bytes {
            registers[usize::from(*address)] = *value;
        }
        Mode::decode(&registers)
    }

    #[test]
    fn product_mode() {
        let product = mode(&[(CTRL1_XL, 0x68), (CTRL2_G, 0x64)]);
        assert_eq!((product.accelerometer_odr, product.gyroscope_odr), (6, 6));
        assert_eq!(product.full_scale, FullScale::G4);
        assert_eq!(product.range, RateRange::Dps500);
        assert!((product.accelerometer_bandwidth_hz - 208.33).abs() < 0.01);
        assert_eq!(product.gyroscope_bandwidth_hz, 135.9);
    }

    #[test]
    fn after_reset_both_sensors_rest() {
        let reset = mode(&[]);
        assert_eq!((reset.odr(), odr_hz(reset.odr())), (0, None));
        assert_eq!(reset.gyroscope_bandwidth_hz, 0.0);
        let asleep = mode(&[(CTRL2_G, 0x60), (CTRL4_C, 0x40)]);
        assert_eq!(asleep.gyroscope_odr, 0);
    }

    #[test]
    fn rates_at_the_ends() {
        let rates = [1, 6, 10, 11].map(odr_hz);
        let want = [Some(13.02), Some(416.67), Some(6666.7), None];
        for (rate, want) in rates.into_iter().zip(want) {
            let wrong = rate.unwrap_or(-1.0) / want.unwrap_or(-1.0) - 1.0;
            assert!(wrong.abs() < 1e-3, "{rate:?} {want:?}");
        }
    }

    #[test]
    fn filters_narrow_by_their_fields() {
        let narrow = mode(&[
            (CTRL1_XL, 0x62),
            (CTRL2_G, 0x60),
            (CTRL4_C, 0x02),
            (CTRL6_C, 0x05),
            (CTRL8_XL, 0x40),
        ]);
        assert!((narrow.accelerometer_bandwidth_hz - 20.833).abs() < 0.001);
        assert_eq!(narrow.gyroscope_bandwidth_hz, 48.0);
    }

    #[test]
    fn status_and_outputs_are_read_only() {
        for address in [WHO_AM_I, STATUS_REG, OUT_TEMP_L, OUTZ_H_A, FIFO_STATUS1] {
            assert_eq!(WRITABLE[usize::from(address)], 0, "{address:02X}h");
        }
    }
}
