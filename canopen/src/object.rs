//! The object dictionary: addresses, types, access, limits, and the values that pass through
//! (CiA 301, 7.4).
//!
//! In: a table of [`Entry`] rows made by the device, which is the only source of what exists, how
//! it may be used and what it starts with. Out: lookups that answer with the abort code the
//! standard asks for. What stands behind a row is reached through [`Objects`].
//!
//! Left out: the rows themselves, and where values are kept.

pub use crate::sdo::abort::Abort;

/// Index and sub-index of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Address {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
}

/// Shorthand for an [`Address`].
pub const fn at(index: u16, sub: u8) -> Address {
    Address { index, sub }
}

/// Data types by their index in the dictionary (CiA 301, table 44).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[expect(missing_docs, reason = "the standard's own names")]
pub enum DataType {
    Boolean = 0x01,
    Integer8 = 0x02,
    Integer16 = 0x03,
    Integer32 = 0x04,
    Unsigned8 = 0x05,
    Unsigned16 = 0x06,
    Unsigned32 = 0x07,
    VisibleString = 0x09,
    OctetString = 0x0A,
    Domain = 0x0F,
    Integer24 = 0x10,
    Unsigned24 = 0x16,
    Unsigned64 = 0x1B,
}

impl DataType {
    /// Bytes of a value; `None` where the length is the value's own (strings, DOMAIN).
    pub const fn size(self) -> Option<usize> {
        Some(match self {
            Self::Boolean | Self::Integer8 | Self::Unsigned8 => 1,
            Self::Integer16 | Self::Unsigned16 => 2,
            Self::Integer24 | Self::Unsigned24 => 3,
            Self::Integer32 | Self::Unsigned32 => 4,
            Self::Unsigned64 => 8,
            Self::VisibleString | Self::OctetString | Self::Domain => return None,
        })
    }

    /// True for the types with a sign.
    pub const fn is_signed(self) -> bool {
        matches!(
            self,
            Self::Integer8 | Self::Integer16 | Self::Integer24 | Self::Integer32
        )
    }
}

/// What may be done with an object: a set of the constants below.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access(pub u8);

impl Access {
    /// Readable by SDO.
    pub const READ: Self = Self(1);
    /// Writable by SDO.
    pub const WRITE: Self = Self(2);
    /// Mappable into a TPDO.
    pub const TPDO: Self = Self(4);
    /// Mappable into an RPDO.
    pub const RPDO: Self = Self(8);
    /// Mappable into an SRDO.
    pub const SRDO: Self = Self(16);
    /// Kept by 1010h, brought back at start.
    pub const STORED: Self = Self(32);
    /// Never changes while the device runs (`const` in an EDS); served from the row itself.
    pub const CONST: Self = Self(64);
    /// A write makes the safety configuration invalid (13FEh or 63FEh leaves A5h).
    pub const SAFETY: Self = Self(128);

    /// The union of two sets.
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// True when every member of `other` is in `self`.
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// Where a row's default comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum DefaultKind {
    /// The number as it stands (two's complement for signed types).
    Plain,
    /// The number plus the node-id (`$NODEID+...` in an EDS).
    PlusNodeId,
    /// The number picks a row of [`Dictionary::variants`]: it depends on which device this is.
    Variant,
}

/// A row of the table as the device holds it: one object, or a run of sub-objects that are alike.
///
/// 12 bytes on the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Index.
    pub index: u16,
    /// First sub-index of the run.
    pub sub: u8,
    /// Last sub-index of the run; the same as `sub` for a single object.
    pub last: u8,
    /// Data type.
    pub data_type: DataType,
    /// Access.
    pub access: Access,
    /// Row of [`Dictionary::limits`]; 255 for the whole range of the type.
    pub limits: u8,
    /// Where the default comes from.
    pub default_kind: DefaultKind,
    /// The default or what it is made from.
    pub default: u32,
}

/// The table, sorted by index and sub-index.
#[derive(Clone, Copy, Debug)]
pub struct Dictionary {
    /// The rows, in ascending order.
    pub entries: &'static [Entry],
    /// Lowest and highest value allowed, both inclusive.
    pub limits: &'static [(i64, i64)],
    /// Defaults that depend on the device.
    pub variants: &'static [[u32; 2]],
    /// Which device this is: a column of `variants`.
    pub variant: u8,
}

impl Dictionary {
    /// The row of an object.
    ///
    /// Errors: [`Abort::NoSuchObject`] or [`Abort::NoSuchSubIndex`].
    pub fn entry(&self, at: Address) -> Result<&'static Entry, Abort> {
        let after = self
            .entries
            .partition_point(|e| (e.index, e.sub) <= (at.index, at.sub));
        let found = self.entries.get(after.wrapping_sub(1));
        match found {
            Some(e) if e.index == at.index && at.sub <= e.last => Ok(e),
            Some(e) if e.index == at.index => Err(Abort::NoSuchSubIndex),
            _ if self.entries.get(after).is_some_and(|e| e.index == at.index) => {
                Err(Abort::NoSuchSubIndex)
            }
            _ => Err(Abort::NoSuchObject),
        }
    }

    /// The value a row starts with, for a device with this node-id; `None` for strings, DOMAINs.
    pub fn default(&self, entry: &Entry, node_id: u8) -> Option<Value> {
        let number = match entry.default_kind {
            DefaultKind::Plain => entry.default,
            DefaultKind::PlusNodeId => entry.default.wrapping_add(u32::from(node_id)),
            DefaultKind::Variant => {
                let row = self.variants.get(entry.default as usize)?;
                *row.get(usize::from(self.variant))?
            }
        };
        Some(Value::cut(u64::from(number), entry.data_type.size()?))
    }

    /// Whether `value` may be written to `entry`: length and limits, not access.
    ///
    /// Errors: [`Abort::LengthTooHigh`], [`Abort::LengthTooLow`], [`Abort::ValueTooHigh`],
    /// [`Abort::ValueTooLow`].
    pub fn admits(&self, entry: &Entry, value: &Value) -> Result<(), Abort> {
        let Some(size) = entry.data_type.size() else {
            return Ok(());
        };
        if value.bytes().len() > size {
            return Err(Abort::LengthTooHigh);
        }
        if value.bytes().len() < size {
            return Err(Abort::LengthTooLow);
        }
        if entry.data_type == DataType::Boolean && value.unsigned() > 1 {
            return Err(Abort::ValueTooHigh);
        }
        let Some(&(low, high)) = self.limits.get(usize::from(entry.limits)) else {
            return Ok(());
        };
        let number = value.number(entry.data_type);
        if number > high {
            return Err(Abort::ValueTooHigh);
        }
        if number < low {
            return Err(Abort::ValueTooLow);
        }
        Ok(())
    }
}

/// A value of up to eight bytes, little-endian as on the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Value {
    bytes: [u8; 8],
    length: u8,
}

impl Value {
    /// From bytes; `None` above eight.
    pub fn new(bytes: &[u8]) -> Option<Self> {
        let length = u8::try_from(bytes.len()).ok().filter(|l| *l <= 8)?;
        let mut value = Self {
            bytes: [0; 8],
            length,
        };
        for (to, from) in value.bytes.iter_mut().zip(bytes) {
            *to = *from;
        }
        Some(value)
    }

    /// The lowest `size` bytes of a number; more than eight count as eight.
    pub fn cut(number: u64, size: usize) -> Self {
        let mut value = Self {
            bytes: [0; 8],
            length: size.min(8) as u8,
        };
        for (to, from) in value.bytes.iter_mut().zip(number.to_le_bytes()).take(size) {
            *to = from;
        }
        value
    }

    /// An 8-bit value.
    pub fn u8(number: u8) -> Self {
        Self::cut(u64::from(number), 1)
    }

    /// A 16-bit value.
    pub fn u16(number: u16) -> Self {
        Self::cut(u64::from(number), 2)
    }

    /// A 32-bit value.
    pub fn u32(number: u32) -> Self {
        Self::cut(u64::from(number), 4)
    }

    /// An 8-bit value with sign.
    pub fn i8(number: i8) -> Self {
        Self::cut(number as u64, 1)
    }

    /// A 16-bit value with sign.
    pub fn i16(number: i16) -> Self {
        Self::cut(number as u64, 2)
    }

    /// A 24-bit value with sign; upper bits are cut.
    pub fn i24(number: i32) -> Self {
        Self::cut(number as u64, 3)
    }

    /// A 32-bit value with sign.
    pub fn i32(number: i32) -> Self {
        Self::cut(number as u64, 4)
    }

    /// The bytes, as many as the value has.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or(&[])
    }

    /// The value without sign.
    pub fn unsigned(&self) -> u64 {
        u64::from_le_bytes(self.bytes)
    }

    /// The value with the sign of its own length.
    pub fn signed(&self) -> i64 {
        let shift = 64 - 8 * u32::from(self.length.clamp(1, 8));
        ((self.unsigned() << shift) as i64) >> shift
    }

    /// The value as its type reads it. 64-bit values without sign stop at `i64::MAX`.
    pub fn number(&self, data_type: DataType) -> i64 {
        if data_type.is_signed() {
            self.signed()
        } else {
            i64::try_from(self.unsigned()).unwrap_or(i64::MAX)
        }
    }
}

/// What stands behind the dictionary's rows.
///
/// The caller has looked the row up and has checked access, length and limits; an implementation
/// checks what only it can know (dependencies between objects, the state of the device) and
/// changes nothing when it refuses. Addresses that it does not serve answer
/// [`Abort::NoSuchObject`].
pub trait Objects {
    /// The table.
    fn dictionary(&self) -> Dictionary;

    /// The value of an object of fixed size.
    fn read(&mut self, at: Address) -> Result<Value, Abort>;

    /// Takes a new value of an object of fixed size, whole or not at all.
    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort>;

    /// Opens a string or DOMAIN for reading; its length in bytes.
    fn open(&mut self, _at: Address) -> Result<u32, Abort> {
        Err(Abort::NoSuchObject)
    }

    /// Reads from `offset` on into `into`; the number of bytes, fewer than asked only at the end.
    ///
    /// May be called again for an earlier offset (a block is sent again).
    fn read_at(&mut self, _at: Address, _offset: u32, _into: &mut [u8]) -> Result<usize, Abort> {
        Err(Abort::NoSuchObject)
    }

    /// Opens a string or DOMAIN for writing. `size` is what the client announced, if it did.
    fn create(&mut self, _at: Address, _size: Option<u32>) -> Result<(), Abort> {
        Err(Abort::NoSuchObject)
    }

    /// Takes the next bytes, in order, each once. Nothing of it counts before [`Objects::commit`].
    fn append(&mut self, _at: Address, _bytes: &[u8]) -> Result<(), Abort> {
        Err(Abort::NoSuchObject)
    }

    /// All bytes have come and their check sum is right: the new content counts from now on.
    fn commit(&mut self, _at: Address) -> Result<(), Abort> {
        Err(Abort::NoSuchObject)
    }

    /// The transfer ended early: what was appended is forgotten.
    fn discard(&mut self, _at: Address) {}
}
