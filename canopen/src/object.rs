//! The object dictionary: addresses, types, access, limits, and the values that pass through
//! (CiA 301, 7.4).
//!
//! In: a table of [`Entry`] rows made by the device, which is the only source of what exists, how
//! it may be used and what it starts with. Out: lookups that answer with the abort code the
//! standard asks for. What stands behind a row is reached through [`Objects`].
//!
//! Left out: the rows themselves, and where values are kept.

mod number;
pub mod packed;
mod place;

pub use crate::sdo::abort::Abort;
use crate::services::Services;
pub use number::Number;
use packed::{Form, Kind, Row};
pub use place::Place;

/// Index and sub-index of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
// In one register, not in two parts: half a percent of the code.
#[repr(align(4))]
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
    /// The number picks a row of [`Table::variants`]: it depends on which device this is.
    Variant,
}

/// A row of the table: one object, or a run of sub-objects that are alike.
///
/// The chip holds it [`packed`].
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
    /// Row of [`Table::limits`]; 255 for the whole range of the type.
    pub limits: u8,
    /// Where the default comes from.
    pub default_kind: DefaultKind,
    /// The default or what it is made from.
    pub default: u32,
}

/// What the devices of one kind have in common: rows, sorted by index and sub-index, and the
/// lists that they pick from.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// The rows, in ascending order.
    pub rows: &'static [Row],
    /// Kinds of rows.
    pub kinds: &'static [Kind],
    /// Forms of kinds.
    pub forms: &'static [Form],
    /// Defaults, or what they are made from.
    pub defaults: &'static [u32],
    /// Lowest and highest value allowed, both inclusive.
    pub limits: &'static [(i32, u32)],
    /// Defaults that depend on the device.
    pub variants: &'static [[u32; 2]],
}

/// The dictionary of one device.
#[derive(Clone, Copy, Debug)]
pub struct Dictionary {
    /// What exists.
    pub table: &'static Table,
    /// Which device this is: a column of [`Table::variants`].
    pub variant: u8,
}

impl Table {
    /// How many rows have this key or a lower one.
    // As `partition_point`, which takes twice the instructions where size comes first.
    fn after(&self, wanted: u32) -> usize {
        let (mut low, mut high) = (0, self.rows.len());
        while low < high {
            let middle = (low + high) / 2;
            match self.rows.get(middle) {
                Some(row) if key(row.index, row.sub) <= wanted => low = middle + 1,
                _ => high = middle,
            }
        }
        low
    }

    fn kind(&self, row: &Row) -> Option<&'static Kind> {
        self.kinds.get(usize::from(row.kind))
    }

    fn form(&self, kind: &Kind) -> Option<&'static Form> {
        self.forms.get(usize::from(kind.form))
    }

    /// A row with what it picks; `None` only for one that is not of this table.
    fn entry(&self, row: &Row) -> Option<Entry> {
        let kind = self.kind(row)?;
        let form = self.form(kind)?;
        Some(Entry {
            index: row.index,
            sub: row.sub,
            last: row.sub.wrapping_add(kind.more),
            data_type: form.data_type,
            access: form.access,
            limits: form.limits,
            default_kind: form.default_kind,
            default: *self.defaults.get(usize::from(kind.default))?,
        })
    }
}

/// What [`Dictionary::entries`] goes through.
#[derive(Clone, Debug)]
pub struct Entries {
    table: &'static Table,
    left: core::slice::Iter<'static, Row>,
}

impl Iterator for Entries {
    type Item = Entry;

    fn next(&mut self) -> Option<Entry> {
        self.table.entry(self.left.next()?)
    }
}

/// Position of a sub-object in the order of the table.
const fn key(index: u16, sub: u8) -> u32 {
    (index as u32) << 8 | sub as u32
}

impl Dictionary {
    /// Every row, in ascending order.
    pub fn entries(&self) -> Entries {
        Entries {
            table: self.table,
            left: self.table.rows.iter(),
        }
    }

    /// The row of an object.
    ///
    /// Errors: [`Abort::NoSuchObject`] or [`Abort::NoSuchSubIndex`].
    pub fn entry(&self, at: Address) -> Result<Entry, Abort> {
        let entry = self.table.entry(self.find(at)?);
        entry.ok_or(Abort::NoSuchSubIndex)
    }

    /// What the row of an object is like: all that most callers ask for, in one register.
    ///
    /// Errors: as [`Dictionary::entry`].
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn form(&self, at: Address) -> Result<&'static Form, Abort> {
        let kind = self.table.kind(self.find(at)?);
        let form = kind.and_then(|kind| self.table.form(kind));
        form.ok_or(Abort::NoSuchSubIndex)
    }

    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn find(&self, at: Address) -> Result<&'static Row, Abort> {
        let rows = self.table.rows;
        let after = self.table.after(key(at.index, at.sub));
        let found = rows.get(after.wrapping_sub(1));
        if let Some(row) = found.filter(|r| r.index == at.index) {
            let more = self.table.kind(row).map_or(0, |kind| kind.more);
            let is_of_run = at.sub.wrapping_sub(row.sub) <= more;
            return is_of_run.then_some(row).ok_or(Abort::NoSuchSubIndex);
        }
        Err(match rows.get(after) {
            Some(r) if r.index == at.index => Abort::NoSuchSubIndex,
            _ => Abort::NoSuchObject,
        })
    }

    /// The value a row starts with, for a device with this node-id; `None` for strings, DOMAINs.
    pub fn default(&self, entry: &Entry, node_id: u8) -> Option<Value> {
        let number = match entry.default_kind {
            DefaultKind::Plain => entry.default,
            DefaultKind::PlusNodeId => entry.default.wrapping_add(u32::from(node_id)),
            DefaultKind::Variant => {
                let row = self.table.variants.get(entry.default as usize)?;
                *row.get(usize::from(self.variant))?
            }
        };
        Some(Value::cut(u64::from(number), entry.data_type.size()?))
    }

    /// True when not every value of the row's length may be written.
    pub fn limits(&self, form: &Form) -> bool {
        let narrow = usize::from(form.limits) < self.table.limits.len();
        narrow || form.data_type == DataType::Boolean
    }

    /// Whether `value` may be written to a row of this form: length and limits, not access.
    ///
    /// Errors: [`Abort::LengthTooHigh`], [`Abort::LengthTooLow`], [`Abort::ValueTooHigh`],
    /// [`Abort::ValueTooLow`].
    pub fn admits(&self, form: &Form, value: &Value) -> Result<(), Abort> {
        let Some(size) = form.data_type.size() else {
            return Ok(());
        };
        if value.bytes().len() > size {
            return Err(Abort::LengthTooHigh);
        }
        if value.bytes().len() < size {
            return Err(Abort::LengthTooLow);
        }
        if form.data_type == DataType::Boolean && value.unsigned() > 1 {
            return Err(Abort::ValueTooHigh);
        }
        let Some(&(low, high)) = self.table.limits.get(usize::from(form.limits)) else {
            return Ok(());
        };
        // With the sign turned over, numbers with a sign are in the order of those without.
        let (number, turned) = if form.data_type.is_signed() {
            (value.signed_32() as u32, 1 << 31)
        } else {
            (u32::try_from(value.unsigned()).unwrap_or(u32::MAX), 0)
        };
        if number ^ turned > high ^ turned {
            return Err(Abort::ValueTooHigh);
        }
        if number ^ turned < low as u32 ^ turned {
            return Err(Abort::ValueTooLow);
        }
        Ok(())
    }
}

/// A value of up to eight bytes, little-endian as on the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
// Copied by words, not by bytes: more than a percent of the code.
#[repr(align(4))]
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

    /// All eight bytes.
    pub const fn whole(bytes: [u8; 8]) -> Self {
        Self { bytes, length: 8 }
    }

    /// The lowest `size` bytes of a number; more than eight count as eight.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn cut(number: u64, size: usize) -> Self {
        let length = size.min(8) as u8;
        let beyond = 64 - 8 * u32::from(length);
        let kept = u64::MAX.checked_shr(beyond).unwrap_or(0);
        Self {
            bytes: (number & kept).to_le_bytes(),
            length,
        }
    }

    /// An 8-bit value.
    pub fn u8(number: u8) -> Self {
        Number::u8(number).into()
    }

    /// A 16-bit value.
    pub fn u16(number: u16) -> Self {
        Number::u16(number).into()
    }

    /// A 32-bit value.
    pub fn u32(number: u32) -> Self {
        Number::u32(number).into()
    }

    /// An 8-bit value with sign.
    pub fn i8(number: i8) -> Self {
        Number::i8(number).into()
    }

    /// A 16-bit value with sign.
    pub fn i16(number: i16) -> Self {
        Number::i16(number).into()
    }

    /// A 24-bit value with sign; upper bits are cut.
    pub fn i24(number: i32) -> Self {
        Number::i24(number).into()
    }

    /// A 32-bit value with sign.
    pub fn i32(number: i32) -> Self {
        Number::i32(number).into()
    }

    /// The bytes, as many as the value has.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.length)).unwrap_or(&[])
    }

    /// All eight bytes, 0 beyond the length.
    pub(crate) const fn padded(&self) -> [u8; 8] {
        self.bytes
    }

    /// How many bytes the value has.
    pub(crate) const fn length(&self) -> u8 {
        self.length
    }

    /// The value without sign.
    pub fn unsigned(&self) -> u64 {
        u64::from_le_bytes(self.bytes)
    }

    /// The value with the sign of its own length.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn signed(&self) -> i64 {
        let shift = 64 - 8 * u32::from(self.length.clamp(1, 8));
        ((self.unsigned() << shift) as i64) >> shift
    }

    /// The lowest four bytes with the sign of the value's own length, up to four.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn signed_32(&self) -> i32 {
        let shift = 32 - 8 * u32::from(self.length.clamp(1, 4));
        ((self.unsigned() as u32 as i32) << shift) >> shift
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
/// checks what only it can check (dependencies between objects, the state of the device) and
/// changes nothing when it refuses. Addresses that it does not serve answer
/// [`Abort::NoSuchObject`].
pub trait Objects {
    /// The optional services that the device has. What it leaves out is not linked.
    const SERVICES: Services = Services::ALL;

    /// The table.
    fn dictionary(&self) -> Dictionary;

    /// The value of an object of fixed size.
    fn read(&mut self, at: Address) -> Result<Value, Abort>;

    /// Takes a new value of an object of fixed size, whole or not at all.
    fn write(&mut self, at: Address, value: Value) -> Result<(), Abort>;

    /// The values of consecutive sub-indices from `first` on, `length` bytes in all, as
    /// [`Objects::read`] would give them one by one; `None` where only that will do.
    ///
    /// For PDOs whose objects stand side by side.
    fn read_adjacent(&mut self, _first: Address, _length: usize) -> Option<Value> {
        None
    }

    /// Takes the values of consecutive sub-indices from `first` on at once, as
    /// [`Objects::write`] would one by one; false where only that will do, with nothing taken.
    fn write_adjacent(&mut self, _first: Address, _values: &Value) -> bool {
        false
    }

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
