//! CRC-32 as Ethernet and zip have it: polynomial 04C11DB7h reflected, start and end inverted.
//!
//! In: bytes, in pieces. Out: the check sum; "123456789" gives CBF43926h. A table of sixteen
//! words takes four bits at a time: the usual one of 1 kB is an eighth of the bootloader's room,
//! and without any a program that is looked through again and again takes a step for each bit.

/// What each value of four bits adds.
const NIBBLES: [u32; 16] = nibbles();

const fn nibbles() -> [u32; 16] {
    let mut table = [0; 16];
    let mut value = 0;
    while value < 16 {
        let mut rest = value as u32;
        let mut bit = 0;
        while bit < 4 {
            let feedback = if rest & 1 == 1 { 0xEDB8_8320 } else { 0 };
            rest = (rest >> 1) ^ feedback;
            bit += 1;
        }
        table[value] = rest;
        value += 1;
    }
    table
}

/// A check sum under way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Crc32(u32);

impl Default for Crc32 {
    fn default() -> Self {
        Self::new()
    }
}

impl Crc32 {
    /// Before the first byte.
    pub const fn new() -> Self {
        Self(u32::MAX)
    }

    /// Takes in the next bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 ^= u32::from(byte);
            for _ in 0..2 {
                let step = NIBBLES.get((self.0 & 15) as usize);
                self.0 = (self.0 >> 4) ^ step.copied().unwrap_or(0);
            }
        }
    }

    /// The check sum of what was taken in.
    pub const fn value(&self) -> u32 {
        !self.0
    }

    /// The check sum of `bytes`.
    pub fn of(bytes: &[u8]) -> u32 {
        let mut crc = Self::new();
        crc.add(bytes);
        crc.value()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_check_string_gives_cbf43926() {
        let mut crc = Crc32::new();
        crc.add(b"1234");
        crc.add(b"56789");
        assert_eq!(crc.value(), 0xCBF4_3926);
        assert_eq!(Crc32::of(b"123456789"), 0xCBF4_3926);
        assert_eq!(Crc32::new().value(), 0);
    }

    #[test]
    fn every_byte_goes_in_as_a_library_has_it() {
        let known = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
        let bytes: std::vec::Vec<u8> = (0..=255).cycle().take(1000).collect();
        for end in 0..bytes.len() {
            assert_eq!(Crc32::of(&bytes[..end]), known.checksum(&bytes[..end]));
        }
    }
}
