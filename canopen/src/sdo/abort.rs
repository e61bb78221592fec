//! SDO abort codes (CiA 301, 7.2.4.3.17, table 22).
//!
//! Left out: codes that this server has no occasion to send.

/// Why a transfer was refused or ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
// A word with a small number in it. With the standard's numbers each use would hold a literal; in
// a byte, values beside it would lose their alignment and be copied by the library.
#[repr(u32)]
pub enum Abort {
    /// The toggle bit did not alternate.
    ToggleBit,
    /// The transfer took too long.
    TimedOut,
    /// The command specifier is not valid or not known.
    InvalidCommand,
    /// The block size is not 1 to 127.
    InvalidBlockSize,
    /// A sequence number is not valid.
    InvalidSequence,
    /// The check sum of a block transfer is wrong.
    CrcError,
    /// Out of memory.
    OutOfMemory,
    /// The object does not support this kind of access.
    UnsupportedAccess,
    /// Attempt to read what can only be written.
    WriteOnly,
    /// Attempt to write what can only be read.
    ReadOnly,
    /// The object is not in the dictionary.
    NoSuchObject,
    /// The object cannot be mapped into a PDO.
    NotMappable,
    /// What is to be mapped is longer than a PDO.
    PdoTooLong,
    /// The value does not go together with another parameter.
    ParameterIncompatible,
    /// The device's own state is incompatible.
    InternalIncompatible,
    /// A hardware error.
    Hardware,
    /// The length does not match the type.
    LengthMismatch,
    /// The value is longer than the type.
    LengthTooHigh,
    /// The value is shorter than the type.
    LengthTooLow,
    /// The sub-index does not exist.
    NoSuchSubIndex,
    /// The value is not one that the object can have.
    InvalidValue,
    /// The value is above the object's range.
    ValueTooHigh,
    /// The value is below the object's range.
    ValueTooLow,
    /// The highest value would be below the lowest.
    MaximumBelowMinimum,
    /// A resource is not there.
    NoResource,
    /// A general error.
    General,
    /// The data cannot be transferred or stored.
    CannotStore,
    /// The data cannot be stored because the device controls it itself.
    LocalControl,
    /// The data cannot be stored in the state that the device is in.
    WrongState,
    /// There is no data.
    NoData,
}

impl Abort {
    /// The number on the bus.
    // The table stands in the program once.
    #[inline(never)]
    pub const fn code(self) -> u32 {
        match self {
            Self::ToggleBit => 0x0503_0000,
            Self::TimedOut => 0x0504_0000,
            Self::InvalidCommand => 0x0504_0001,
            Self::InvalidBlockSize => 0x0504_0002,
            Self::InvalidSequence => 0x0504_0003,
            Self::CrcError => 0x0504_0004,
            Self::OutOfMemory => 0x0504_0005,
            Self::UnsupportedAccess => 0x0601_0000,
            Self::WriteOnly => 0x0601_0001,
            Self::ReadOnly => 0x0601_0002,
            Self::NoSuchObject => 0x0602_0000,
            Self::NotMappable => 0x0604_0041,
            Self::PdoTooLong => 0x0604_0042,
            Self::ParameterIncompatible => 0x0604_0043,
            Self::InternalIncompatible => 0x0604_0047,
            Self::Hardware => 0x0606_0000,
            Self::LengthMismatch => 0x0607_0010,
            Self::LengthTooHigh => 0x0607_0012,
            Self::LengthTooLow => 0x0607_0013,
            Self::NoSuchSubIndex => 0x0609_0011,
            Self::InvalidValue => 0x0609_0030,
            Self::ValueTooHigh => 0x0609_0031,
            Self::ValueTooLow => 0x0609_0032,
            Self::MaximumBelowMinimum => 0x0609_0036,
            Self::NoResource => 0x060A_0023,
            Self::General => 0x0800_0000,
            Self::CannotStore => 0x0800_0020,
            Self::LocalControl => 0x0800_0021,
            Self::WrongState => 0x0800_0022,
            Self::NoData => 0x0800_0024,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Abort;

    #[test]
    fn the_numbers_are_those_of_table_22() {
        let numbers = [
            (Abort::ToggleBit, 0x0503_0000),
            (Abort::TimedOut, 0x0504_0000),
            (Abort::InvalidCommand, 0x0504_0001),
            (Abort::ReadOnly, 0x0601_0002),
            (Abort::NoSuchObject, 0x0602_0000),
            (Abort::NoSuchSubIndex, 0x0609_0011),
            (Abort::ValueTooLow, 0x0609_0032),
            (Abort::NoResource, 0x060A_0023),
            (Abort::NoData, 0x0800_0024),
        ];
        for (abort, number) in numbers {
            assert_eq!(abort.code(), number, "{abort:?}");
        }
    }
}
