//! What the parts have in common on the wire: one command byte, then data from there on.
//!
//! In: a `SpiDevice`, a seven-bit address, bytes. Out: the same transaction for every part whose
//! command byte is a read bit and an address (LIS2DW12: DS11811, SPI bus interface; ISM330DHCX:
//! DS13012 rev 7, 5.1.2), and the three axes of an output burst. How registers are named and
//! checked is each part's own.

use embedded_hal::spi::{Operation, SpiDevice};

/// Bit 7 of the command byte: set for a read.
const READ: u8 = 0x80;

/// Writes one register.
#[inline]
pub fn write<SPI: SpiDevice>(spi: &mut SPI, address: u8, value: u8) -> Result<(), SPI::Error> {
    spi.write(&[address, value])
}

/// Fills `bytes` from `first` on, in one transaction.
#[inline]
pub fn read<SPI: SpiDevice>(spi: &mut SPI, first: u8, bytes: &mut [u8]) -> Result<(), SPI::Error> {
    let command = [first | READ];
    spi.transaction(&mut [Operation::Write(&command), Operation::Read(bytes)])
}

/// Three axes of two bytes each, X first, low byte first.
#[inline]
pub const fn axes(bytes: [u8; 6]) -> [i16; 3] {
    let [xl, xh, yl, yh, zl, zh] = bytes;
    [
        i16::from_le_bytes([xl, xh]),
        i16::from_le_bytes([yl, yh]),
        i16::from_le_bytes([zl, zh]),
    ]
}
