//! Parameters in a record: a row of objects, each with its address and its bytes.
//!
//! In and out: values under their addresses. Each entry is index (2 bytes, little-endian),
//! sub-index (1), length (1) and that many bytes. An entry that an older or newer program wrote
//! for an object that is unknown here is passed over, so records survive an update.
//!
//! Left out: which objects are stored, and whether a stored value is still allowed.

use canopen::object::{Address, Value, at};

use super::{Record, RecordStore, StoreError};

/// Bytes before an entry's value.
const HEAD: usize = 4;

/// The longest value that is taken back: eight bytes ([`Value`]).
const LONGEST: usize = 8;

/// Stages one parameter, behind [`RecordStore::begin`].
///
/// Errors: those of [`RecordStore::append`].
pub fn put<S: RecordStore + ?Sized>(
    store: &mut S,
    address: Address,
    value: &Value,
) -> Result<(), StoreError> {
    let [low, high] = address.index.to_le_bytes();
    let length = value.bytes().len() as u8;
    store.append(&[low, high, address.sub, length])?;
    store.append(value.bytes())
}

/// The committed parameter at `address`; `None` when the record has none.
///
/// Of several entries the first counts.
pub fn get<S: RecordStore + ?Sized>(
    store: &mut S,
    record: Record,
    address: Address,
) -> Option<Value> {
    let mut all = Entries::new(store, record);
    all.find(|(found, _)| *found == address)
        .map(|(_, value)| value)
}

/// The entries of a committed record in the order of their storing: what a start goes through.
///
/// Ends at the end of the record, and at an entry that is cut off. Entries longer than eight
/// bytes are passed over.
#[derive(Debug)]
pub struct Entries<'a, S: ?Sized> {
    store: &'a mut S,
    record: Record,
    offset: u32,
}

impl<'a, S: RecordStore + ?Sized> Entries<'a, S> {
    /// From the beginning of `record`.
    pub fn new(store: &'a mut S, record: Record) -> Self {
        Self {
            store,
            record,
            offset: 0,
        }
    }

    /// The next entry with its value, if it is short enough to be one.
    fn step(&mut self) -> Option<(Address, Option<Value>)> {
        let mut bytes = [0; HEAD + LONGEST];
        let got = self.store.read(self.record, self.offset, &mut bytes);
        let [low, high, sub, length, value @ ..] = bytes;
        let length = usize::from(length);
        let there = got.min(bytes.len()).checked_sub(HEAD)?;
        if there < length.min(LONGEST) {
            return None;
        }
        self.offset = self.offset.checked_add((HEAD + length) as u32)?;
        let is_short = length <= LONGEST;
        let value = is_short.then(|| Value::cut(u64::from_le_bytes(value), length));
        Some((at(u16::from_le_bytes([low, high]), sub), value))
    }
}

impl<S: RecordStore + ?Sized> Iterator for Entries<'_, S> {
    type Item = (Address, Value);

    fn next(&mut self) -> Option<Self::Item> {
        // Every step moves on by four bytes at least, so this ends with the record.
        loop {
            if let (address, Some(value)) = self.step()? {
                return Some((address, value));
            }
        }
    }
}
