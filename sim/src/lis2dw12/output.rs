//! From what the part feels to the bytes in its output registers.
//!
//! In: specific force in g and the die temperature in degC. Out: left-justified two's
//! complement, clipped at full scale; and the rule that keeps the two bytes of a pair together
//! (block data update).

use tilt::sample::Counts;

use super::registers::Mode;

/// One axis or the temperature: the pair the bus sees, and the pair that waits behind it.
///
/// With block data update on, a pair of which only one byte has been read does not change until
/// the other byte is read too; the newest value waits. The rule holds per pair: X can come from
/// one sample and Z from the next when the host is too slow.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pair {
    /// Low byte, high byte as the bus reads them.
    pub bytes: [u8; 2],
    waiting: Option<[u8; 2]>,
    low_read: bool,
    high_read: bool,
}

impl Pair {
    /// A new value arrives.
    pub fn update(&mut self, bytes: [u8; 2], block_data_update: bool) {
        if block_data_update && self.is_half_read() {
            self.waiting = Some(bytes);
        } else {
            self.bytes = bytes;
        }
    }

    /// One of its bytes has been read and the other not.
    pub fn is_half_read(&self) -> bool {
        self.low_read != self.high_read
    }

    /// A byte is read: 0 is the low one, anything else the high one.
    pub fn read(&mut self, which: u8) {
        if which == 0 {
            self.low_read = true;
        } else {
            self.high_read = true;
        }
        if self.low_read && self.high_read {
            self.low_read = false;
            self.high_read = false;
            if let Some(bytes) = self.waiting.take() {
                self.bytes = bytes;
            }
        }
    }

    /// Replaces everything, as a FIFO level does when it is taken.
    pub fn load(&mut self, bytes: [u8; 2]) {
        *self = Self {
            bytes,
            ..Self::default()
        };
    }
}

/// Rounds to the nearest step and clips to `-limit..limit`.
///
/// The offset keeps the cast on the positive side, where cutting off is rounding down; the
/// library's `round` would cost a call per axis. A limit is at most `OFFSET`, so what falls below
/// zero here is clipped anyway. Not-a-number comes out as the lower end.
fn quantise(value: f64, limit: i32) -> i32 {
    const OFFSET: i32 = 1 << 15;
    let shifted = (value + (f64::from(OFFSET) + 0.5)) as i32;
    shifted.saturating_sub(OFFSET).clamp(-limit, limit - 1)
}

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

    #[test]
    fn a_half_read_pair_waits_only_with_block_data_update() {
        let mut pair = Pair::default();
        pair.update([1, 1], true);
        pair.read(0);
        pair.update([2, 2], true);
        assert_eq!(pair.bytes, [1, 1]);
        pair.read(1);
        assert_eq!(pair.bytes, [2, 2]);
        pair.read(0);
        pair.update([3, 3], false);
        assert_eq!(pair.bytes, [3, 3]);
    }
}
