//! SDO abort codes (CiA 301, 7.2.4.3.17, table 22).
//!
//! Left out: codes that this server has no occasion to send.

/// Why a transfer was refused or ended; the number is what stands on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Abort {
    /// The toggle bit did not alternate.
    ToggleBit = 0x0503_0000,
    /// The transfer took too long.
    TimedOut = 0x0504_0000,
    /// The command specifier is not valid or not known.
    InvalidCommand = 0x0504_0001,
    /// The block size is not 1 to 127.
    InvalidBlockSize = 0x0504_0002,
    /// A sequence number is not valid.
    InvalidSequence = 0x0504_0003,
    /// The check sum of a block transfer is wrong.
    CrcError = 0x0504_0004,
    /// Out of memory.
    OutOfMemory = 0x0504_0005,
    /// The object does not support this kind of access.
    UnsupportedAccess = 0x0601_0000,
    /// Attempt to read what can only be written.
    WriteOnly = 0x0601_0001,
    /// Attempt to write what can only be read.
    ReadOnly = 0x0601_0002,
    /// The object is not in the dictionary.
    NoSuchObject = 0x0602_0000,
    /// The object cannot be mapped into a PDO.
    NotMappable = 0x0604_0041,
    /// What is to be mapped is longer than a PDO.
    PdoTooLong = 0x0604_0042,
    /// The value does not go together with another parameter.
    ParameterIncompatible = 0x0604_0043,
    /// The device's own state is incompatible.
    InternalIncompatible = 0x0604_0047,
    /// A hardware error.
    Hardware = 0x0606_0000,
    /// The length does not match the type.
    LengthMismatch = 0x0607_0010,
    /// The value is longer than the type.
    LengthTooHigh = 0x0607_0012,
    /// The value is shorter than the type.
    LengthTooLow = 0x0607_0013,
    /// The sub-index does not exist.
    NoSuchSubIndex = 0x0609_0011,
    /// The value is not one that the object can have.
    InvalidValue = 0x0609_0030,
    /// The value is above the object's range.
    ValueTooHigh = 0x0609_0031,
    /// The value is below the object's range.
    ValueTooLow = 0x0609_0032,
    /// The highest value would be below the lowest.
    MaximumBelowMinimum = 0x0609_0036,
    /// A resource is not there.
    NoResource = 0x060A_0023,
    /// A general error.
    General = 0x0800_0000,
    /// The data cannot be transferred or stored.
    CannotStore = 0x0800_0020,
    /// The data cannot be stored because the device controls it itself.
    LocalControl = 0x0800_0021,
    /// The data cannot be stored in the state that the device is in.
    WrongState = 0x0800_0022,
    /// There is no data.
    NoData = 0x0800_0024,
}

impl Abort {
    /// The number on the bus.
    pub const fn code(self) -> u32 {
        self as u32
    }
}
