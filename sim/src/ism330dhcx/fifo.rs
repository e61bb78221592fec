//! The FIFO of 512 tagged words, one for each sensor's three axes.
//!
//! In: samples of either sensor at the same time slot. Out: seven bytes a word, tag first. Left
//! out: compression, temperature, time stamps and sensor hub in the FIFO, and stopping at the
//! threshold.

use crate::spi_part::{Fifo, FifoMode};

/// Words of the FIFO, without compression: 3 kB \[RECALL\].
pub const WORDS: usize = 512;

/// FIFO_DATA_OUT_TAG to FIFO_DATA_OUT_Z_H.
pub type Word = [u8; 7];

/// Which sensor a word is of: TAG_SENSOR (ST's open driver).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tag {
    /// Gyroscope without compression.
    Rate = 0x01,
    /// Accelerometer without compression.
    Acceleration = 0x02,
}

/// The words with the number of the present time slot.
#[derive(Clone, Debug, Default)]
pub struct Words {
    ring: Fifo<Word, WORDS>,
    slot: u8,
    lost: bool,
}

impl Words {
    /// Words waiting, 0 to 512.
    pub fn count(&self) -> usize {
        self.ring.count()
    }

    /// A word was lost and none taken since.
    pub fn overrun(&self) -> bool {
        self.ring.overrun()
    }

    /// A word was lost since this was asked last.
    pub fn take_lost(&mut self) -> bool {
        std::mem::take(&mut self.lost)
    }

    /// A word was lost, without forgetting it.
    pub fn lost(&self) -> bool {
        self.lost
    }

    /// Empties it.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// The next time slot.
    pub fn next_slot(&mut self) {
        self.slot = (self.slot + 1) & 3;
    }

    /// Adds a word of the present time slot. The tag's parity is even \[ASSUME\].
    pub fn push(&mut self, mode: FifoMode, tag: Tag, axes: [[u8; 2]; 3]) {
        let [[xl, xh], [yl, yh], [zl, zh]] = axes;
        let field = ((tag as u8) << 3) | (self.slot << 1);
        let parity = (field.count_ones() & 1) as u8;
        self.ring
            .push(mode, [field | parity, xl, xh, yl, yh, zl, zh]);
        self.lost |= self.ring.overrun();
    }

    /// Takes the oldest word.
    pub fn pop(&mut self) -> Option<Word> {
        self.ring.pop()
    }
}

/// Decodes FIFO_MODE, bits 2..0 of FIFO_CTRL4. The modes that wait for an event stay in the state
/// before it, since the model has no events.
pub fn decode(fifo_ctrl4: u8) -> FifoMode {
    match fifo_ctrl4 & 0x07 {
        0b001 => FifoMode::StopWhenFull,
        0b011 | 0b110 => FifoMode::Continuous,
        _ => FifoMode::Bypass,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_carry_sensor_slot_and_even_parity() {
        let mut words = Words::default();
        words.next_slot();
        words.push(FifoMode::Continuous, Tag::Rate, [[1, 2], [3, 4], [5, 6]]);
        words.push(FifoMode::Continuous, Tag::Acceleration, [[0; 2]; 3]);
        assert_eq!(words.count(), 2);
        assert_eq!(words.pop(), Some([0x0A, 1, 2, 3, 4, 5, 6]));
        assert_eq!(words.pop(), Some([0x12, 0, 0, 0, 0, 0, 0]));
        assert_eq!(words.pop(), None);
    }

    #[test]
    fn a_lost_word_is_reported_once() {
        let mut words = Words::default();
        (0..=WORDS).for_each(|_| words.push(FifoMode::Continuous, Tag::Rate, [[0; 2]; 3]));
        assert!(words.overrun() && words.lost());
        assert!(words.take_lost() && !words.take_lost());
        words.pop();
        assert!(!words.overrun());
    }
}
