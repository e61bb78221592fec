//! The object at the far end of a transfer, the same for every protocol.
//!
//! In: the dictionary row and bytes in order. Out: bytes, or an abort code. Objects of fixed size
//! are collected here and written whole; strings and DOMAINs go through as they come.
//!
//! Left out: how bytes are cut into frames.

use crate::object::packed::Form;
use crate::object::{Abort, Access, Address, Objects, Value, at};

/// Where the bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// In `bytes`: the object has a fixed size.
    Here,
    /// Behind [`Objects::read_at`].
    Source,
    /// Behind [`Objects::append`], and to be discarded unless they are committed.
    Sink,
}

/// What is being transferred.
#[derive(Clone, Debug)]
pub(super) struct Content {
    at: Address,
    place: Place,
    bytes: [u8; 8],
    /// Upload: the length. Download: the length that the client has announced.
    size: Option<u32>,
    /// Upload: bytes that the client has. Download: bytes that have come.
    done: u32,
}

/// The row of an object that is to be written.
///
/// Errors: the object does not exist, or cannot be written.
pub(super) fn writable<O: Objects>(objects: &O, at: Address) -> Result<&'static Form, Abort> {
    permitted(objects, at, Access::WRITE, Abort::ReadOnly)
}

fn permitted<O: Objects>(
    objects: &O,
    at: Address,
    wanted: Access,
    refusal: Abort,
) -> Result<&'static Form, Abort> {
    O::SERVICES.serve(at)?;
    let entry = objects.dictionary().form(at)?;
    if entry.access.has(wanted) {
        return Ok(entry);
    }
    let either = entry.access.has(Access::READ) || entry.access.has(Access::WRITE);
    Err(if either {
        refusal
    } else {
        Abort::UnsupportedAccess
    })
}

impl Content {
    /// No object: what stands here between transfers.
    pub const NONE: Self = Self::new(at(0, 0));

    /// An object of which nothing is known but its address.
    pub const fn new(at: Address) -> Self {
        Self {
            at,
            place: Place::Here,
            bytes: [0; 8],
            size: None,
            done: 0,
        }
    }

    /// The object's address.
    pub const fn at(&self) -> Address {
        self.at
    }

    /// Upload: the length in bytes.
    pub fn size(&self) -> u32 {
        self.size.unwrap_or(0)
    }

    /// Bytes that the other side has (upload) or that have come (download).
    pub const fn done(&self) -> u32 {
        self.done
    }

    /// Upload: the client has this many bytes more.
    pub fn advance(&mut self, bytes: u32) {
        self.done = self.done.saturating_add(bytes).min(self.size());
    }

    /// True when the client has announced that nothing will come.
    pub fn is_announced_empty(&self) -> bool {
        self.size == Some(0)
    }

    /// Opens the object for upload.
    ///
    /// Errors: it does not exist, cannot be read, or refuses.
    pub fn open<O: Objects>(&mut self, objects: &mut O) -> Result<(), Abort> {
        let entry = permitted(objects, self.at, Access::READ, Abort::WriteOnly)?;
        if entry.data_type.size().is_none() {
            self.size = Some(objects.open(self.at)?);
            self.place = Place::Source;
            return Ok(());
        }
        let value = objects.read(self.at)?;
        self.bytes = value.padded();
        self.size = Some(value.length().into());
        Ok(())
    }

    /// Copies from `offset` on; the number of bytes, fewer than asked only at the end.
    ///
    /// Errors: the object refuses, or has become shorter than it was when it was opened.
    pub fn read<O: Objects>(
        &self,
        objects: &mut O,
        offset: u32,
        into: &mut [u8],
    ) -> Result<usize, Abort> {
        let left = self.size().saturating_sub(offset) as usize;
        let wanted = left.min(into.len());
        let Some(into) = into.get_mut(..wanted).filter(|i| !i.is_empty()) else {
            return Ok(0);
        };
        if self.place != Place::Source {
            let from = self.bytes.iter().skip(offset as usize);
            into.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
        } else if objects.read_at(self.at, offset, into)? != wanted {
            return Err(Abort::CannotStore);
        }
        Ok(wanted)
    }

    /// Opens the object of a row for download; `size` in bytes when the client announces it.
    ///
    /// Errors: the size is not that of the type, or the object refuses.
    pub fn create<O: Objects>(
        &mut self,
        objects: &mut O,
        entry: &Form,
        size: Option<u32>,
    ) -> Result<(), Abort> {
        if let Some(fixed) = entry.data_type.size() {
            let size = size.map_or(fixed, |size| size as usize);
            if size > fixed {
                return Err(Abort::LengthTooHigh);
            }
            if size < fixed {
                return Err(Abort::LengthTooLow);
            }
        } else {
            objects.create(self.at, size)?;
            self.place = Place::Sink;
        }
        self.size = size;
        Ok(())
    }

    /// Takes the next bytes.
    ///
    /// Errors: more than announced, more than any object of fixed size has, or the object refuses.
    pub fn append<O: Objects>(&mut self, objects: &mut O, bytes: &[u8]) -> Result<(), Abort> {
        let done = self.done.saturating_add(bytes.len() as u32);
        if self.size.is_some_and(|size| done > size) {
            return Err(Abort::LengthMismatch);
        }
        if self.place == Place::Here {
            if done as usize > self.bytes.len() {
                return Err(Abort::LengthTooHigh);
            }
            let room = self.bytes.iter_mut().skip(self.done as usize);
            room.zip(bytes).for_each(|(to, from)| *to = *from);
        } else if !bytes.is_empty() {
            objects.append(self.at, bytes)?;
        }
        self.done = done;
        Ok(())
    }

    /// Everything has come: the object takes it, whole or not at all.
    ///
    /// Errors: fewer bytes than announced, a length or value that the row does not admit, or the
    /// object refuses.
    pub fn commit<O: Objects>(&mut self, objects: &mut O) -> Result<(), Abort> {
        if self.size.is_some_and(|size| size != self.done) {
            return Err(Abort::LengthMismatch);
        }
        if self.place == Place::Sink {
            return objects.commit(self.at);
        }
        let value = Value::cut(u64::from_le_bytes(self.bytes), self.done as usize);
        let dictionary = objects.dictionary();
        dictionary.admits(dictionary.form(self.at)?, &value)?;
        objects.write(self.at, value)
    }

    /// The transfer ended early: an open download is forgotten.
    pub fn discard<O: Objects>(&self, objects: &mut O) {
        if self.place == Place::Sink {
            objects.discard(self.at);
        }
    }
}
