//! From what the part feels to the bytes in its output registers.
//!
//! In: specific force in g and the die temperature in degC. Out: left-justified two's
//! complement, clipped at full scale.

use tilt::sample::Counts;

use super::registers::Mode;
use crate::spi_part::quantise;

/// Left-justified counts for a force in g.
///
/// 14 significant bits, 12 in low-power mode 1: 0.244 mg or 0.976 mg per step at +-2 g \[DS\].
/// `full_register` uses all 16 bits instead, a part finer than the real one: for studies with
/// the quantisation switched off.
pub fn counts(force_g: [f64; 3], mode: &Mode, full_register: bool) -> Counts {
    let bits = if full_register { 16 } else { mode.bits };
    let below = 16 - bits;
    let steps_per_g = f64::from(mode.full_scale.counts_per_g() >> below);
    let limit = 1 << (bits - 1);
    // A loop: `map` over an array is not always inlined, and this runs at every sample.
    let mut counts = [0; 3];
    for (count, force_g) in counts.iter_mut().zip(force_g) {
        *count = (quantise(force_g * steps_per_g, limit) << below) as i16;
    }
    Counts(counts)
}

/// OUT_T_L and OUT_T_H for a temperature in degC: 1/16 degC, zero at 25 degC, left-justified,
/// clipped at -103 and +152.9 degC.
pub fn temperature_bytes(die_c: f64) -> [u8; 2] {
    ((quantise((die_c - 25.0) * 16.0, 1 << 11) << 4) as i16).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_round_and_clip() {
        let product = Mode::decode(0x74, 0x04);
        let step = 1.0 / 4096.0;
        assert_eq!(
            counts([1.0, -1.0, 0.0], &product, false),
            Counts([16384, -16384, 0])
        );
        assert_eq!(
            counts([0.49 * step, 0.51 * step, -0.51 * step], &product, false).0,
            [0, 4, -4]
        );
        assert_eq!(
            counts([2.0, -2.0, 9.0], &product, false),
            Counts([32764, -32768, 32764])
        );
        let beyond = [f64::INFINITY, -1e300, f64::NAN];
        assert_eq!(counts(beyond, &product, false).0, [32764, -32768, -32768]);
    }

    #[test]
    fn range_and_resolution_follow_the_mode() {
        let coarse = Mode::decode(0x70, 0x00);
        assert_eq!(
            counts([0.001, 0.0006, -2.5], &coarse, false).0,
            [16, 16, -32768]
        );
        let wide = Mode::decode(0x74, 0x30);
        assert_eq!(
            counts([1.0, 15.0, -17.0], &wide, false).0,
            [2048, 30720, -32768]
        );
        let fine = Mode::decode(0x74, 0x04);
        assert_eq!(
            counts([1.0 / 16384.0, 2.0, -2.0], &fine, true).0,
            [1, 32767, -32768]
        );
    }

    #[test]
    fn temperature_is_twelve_bits_around_25_degrees() {
        assert_eq!(temperature_bytes(25.0), [0x00, 0x00]);
        assert_eq!(temperature_bytes(26.0), [0x00, 0x01]);
        assert_eq!(temperature_bytes(24.9375), [0xF0, 0xFF]);
        assert_eq!(temperature_bytes(1000.0), [0xF0, 0x7F]);
        assert_eq!(temperature_bytes(-1000.0), [0x00, 0x80]);
    }
}
