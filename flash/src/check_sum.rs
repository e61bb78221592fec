//! CRC-32 as Ethernet and zip have it: polynomial 04C11DB7h reflected, start and end inverted.
//!
//! In: bytes, in pieces. Out: the check sum; "123456789" gives CBF43926h. Without a table, bit by
//! bit, because a table of 1 kB is an eighth of the bootloader.

use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc, Digest, NoTable};

const CRC32: &Crc<u32, NoTable> = &Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// A check sum under way.
#[derive(Clone)]
pub struct Crc32(Digest<'static, u32, NoTable>);

impl Default for Crc32 {
    fn default() -> Self {
        Self::new()
    }
}

impl fmt::Debug for Crc32 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Crc32").field(&self.value()).finish()
    }
}

impl Crc32 {
    /// Before the first byte.
    pub fn new() -> Self {
        Self(CRC32.digest())
    }

    /// Takes in the next bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// The check sum of what was taken in.
    pub fn value(&self) -> u32 {
        self.0.clone().finalize()
    }

    /// The check sum of `bytes`.
    pub fn of(bytes: &[u8]) -> u32 {
        CRC32.checksum(bytes)
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
}
