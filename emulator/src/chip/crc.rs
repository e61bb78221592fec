//! The CRC unit: CRC-32 with 04C1 1DB7h over words, the highest bit first.
//!
//! In: words stored. Out: the sum. Source: RM0008 4.3 and 4.4. Left out: nothing.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 00h | DR | RM0008 4.4.1 |
//! | 04h | IDR | 4.4.2 |
//! | 08h | CR | 4.4.3 |

/// The registers.
#[derive(Clone, Copy, Debug)]
pub struct Crc {
    sum: u32,
    idr: u32,
}

impl Default for Crc {
    fn default() -> Self {
        Self {
            sum: u32::MAX,
            idr: 0,
        }
    }
}

impl Crc {
    /// A load; `offset` from 4002 3000h.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.sum,
            0x04 => self.idr,
            _ => 0,
        }
    }

    /// A store.
    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x00 => {
                self.sum ^= value;
                for _ in 0..32 {
                    let carry = self.sum >> 31;
                    self.sum = self.sum << 1 ^ (carry * 0x04C1_1DB7);
                }
            }
            0x04 => self.idr = value & 0xFF,
            // 4.4.3: RESET.
            0x08 if value & 1 != 0 => self.sum = u32::MAX,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_check_value_of_the_polynomial() {
        let mut crc = Crc::default();
        // CRC-32/MPEG-2 of "12345678" as two big-endian words.
        crc.write(0, 0x3132_3334);
        crc.write(0, 0x3536_3738);
        let bytewise = b"12345678".iter().fold(u32::MAX, |sum, byte| {
            (0..8).fold(sum ^ u32::from(*byte) << 24, |sum, _| {
                sum << 1 ^ if sum >> 31 != 0 { 0x04C1_1DB7 } else { 0 }
            })
        });
        assert_eq!(crc.read(0), bytewise);
        crc.write(8, 1);
        assert_eq!(crc.read(0), u32::MAX);
    }
}
