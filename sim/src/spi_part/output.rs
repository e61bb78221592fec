//! The bytes of an output register pair, and rounding to them.
//!
//! In: values in steps, bytes as they arrive and are read. Out: clipped whole steps; and the rule
//! that keeps the two bytes of a pair together (block data update).

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
pub fn quantise(value: f64, limit: i32) -> i32 {
    const OFFSET: i32 = 1 << 15;
    let shifted = (value + (f64::from(OFFSET) + 0.5)) as i32;
    shifted.saturating_sub(OFFSET).clamp(-limit, limit - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

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
