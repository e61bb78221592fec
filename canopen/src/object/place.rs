//! A number where it is kept, of the type of its row.
//!
//! In and out: values. Whoever owns an object that is simply a number gives its place, and no
//! more: reading it, and putting a default or stored value in place, are the same for all of them.
//!
//! Left out: what a write is allowed to do.

use super::{Number, Value};

/// A number behind a row.
pub enum Place<'a> {
    /// UNSIGNED8.
    U8(&'a mut u8),
    /// UNSIGNED16.
    U16(&'a mut u16),
    /// INTEGER16.
    I16(&'a mut i16),
    /// UNSIGNED32.
    U32(&'a mut u32),
    /// INTEGER32.
    I32(&'a mut i32),
}

impl Place<'_> {
    /// The number as its row has it.
    pub fn get(&self) -> Number {
        match self {
            Self::U8(n) => Number::u8(**n),
            Self::U16(n) => Number::u16(**n),
            Self::I16(n) => Number::i16(**n),
            Self::U32(n) => Number::u32(**n),
            Self::I32(n) => Number::i32(**n),
        }
    }

    /// Puts a value of the row's length in place.
    pub fn set(&mut self, value: Value) {
        let number = value.unsigned();
        match self {
            Self::U8(n) => **n = number as u8,
            Self::U16(n) => **n = number as u16,
            Self::I16(n) => **n = number as i16,
            Self::U32(n) => **n = number as u32,
            Self::I32(n) => **n = number as i32,
        }
    }
}
