//! A number of one to four bytes with its length, as nearly all objects have.
//!
//! In: numbers of the types that an object can have. Out: [`Value`]s. It fits, with an abort code
//! in its place or with nothing, into two registers, while a [`Value`] is passed through memory:
//! so what reads an object gives a number, and a value is made of it once, where the reads meet.
//!
//! Left out: objects of more than four bytes.

use super::Value;

/// Bytes of a number. That 0 is none of them leaves room for [`Option`] and [`Result`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Size {
    One = 1,
    Two = 2,
    Three = 3,
    Four = 4,
}

/// A number with its length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Number {
    /// Two's complement for types with a sign; 0 beyond the length.
    bits: u32,
    size: Size,
}

impl Number {
    const fn new(bits: u32, size: Size) -> Self {
        Self { bits, size }
    }

    /// An 8-bit number.
    pub const fn u8(number: u8) -> Self {
        Self::new(number as u32, Size::One)
    }

    /// A 16-bit number.
    pub const fn u16(number: u16) -> Self {
        Self::new(number as u32, Size::Two)
    }

    /// A 32-bit number.
    pub const fn u32(number: u32) -> Self {
        Self::new(number, Size::Four)
    }

    /// An 8-bit number with sign.
    pub const fn i8(number: i8) -> Self {
        Self::u8(number as u8)
    }

    /// A 16-bit number with sign.
    pub const fn i16(number: i16) -> Self {
        Self::u16(number as u16)
    }

    /// A 24-bit number with sign; upper bits are cut.
    pub const fn i24(number: i32) -> Self {
        Self::new(number as u32 & 0xFF_FFFF, Size::Three)
    }

    /// A 32-bit number with sign.
    pub const fn i32(number: i32) -> Self {
        Self::u32(number as u32)
    }

    /// The bits without sign.
    pub const fn bits(self) -> u32 {
        self.bits
    }

    /// As [`Value::unsigned`].
    pub fn unsigned(self) -> u64 {
        self.bits.into()
    }
}

impl From<Number> for Value {
    fn from(number: Number) -> Self {
        Self {
            bytes: number.unsigned().to_le_bytes(),
            length: number.size as u8,
        }
    }
}
