//! Banks: a few records in two banks of flash, of which one is in force.
//!
//! In: a flash, its region, a kind (0 to [`KINDS`] - 1) and bytes, staged and then committed. Out:
//! the bytes that were committed last. After a loss of supply in the middle of any operation these
//! are the old ones or the new ones, never a third (R8), and no other record is touched. It does
//! what [`records`](crate::records) does, in a fraction of the code, for a part that stores
//! seldom.
//!
//! # How it is kept
//! A store writes every record anew into the other bank: those before it when it begins, its own
//! bytes as they come, those behind it at the commit. A bank counts from the moment when its mark
//! is programmed, which is the last thing that is done. Numbers are little-endian.
//!
//! | byte | content |
//! |---|---|
//! | 0 | 0000h: every page was erased whole, this one last |
//! | 2 | CRC-32 of what follows, up to the end of the last record |
//! | 6 | sequence number: the higher one counts, modulo 65 536 |
//! | 8 | its complement, so that no single bit makes it another number |
//! | 10 | bit n: the last version of kind n was lost before, and not stored anew since |
//! | 12 | lengths less 1, two bytes for each kind; FFFFh: there is none |
//! | 44 | the records in the order of their kinds, each from an even offset |
//! | the last 4 | two marks of 0000h, of which one is enough |
//!
//! [`Banks::prepare`] erases the bank that is not in force, page by page from the last to the
//! first, so a bank whose erase was cut has no mark any more or is known to be the older one. A
//! page whose erase was cut may read as blank; hence the word at offset 0.
//!
//! Each store erases each page of one bank once: the 10 000 erases of a page (DS5319 5.3.9) are
//! 20 000 stores. A store programs what all records take, 4.2 kB where there is a full
//! calibration: 0.15 s at 70 us for each half-word.
//!
//! Where a bit has gone bad in the bank in force, [`Banks::mount`] takes the bank before if that is
//! still there, and reports it ([`Banks::damaged`]). A bit that goes bad later stops the next
//! commit, so damage is not copied under a check sum that fits.
//!
//! Left out: what the bytes mean, and when to store.

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::Progress;
use crate::access::{AccessError, add_to, erase_unit, is_blank, program, read};
use crate::check_sum::Crc32;
use crate::layout::Region;

/// How many kinds there are.
pub const KINDS: u8 = 16;

/// Bytes of the records in a bank of so many bytes, each rounded up to an even number.
pub const fn room(bank: u32) -> u32 {
    bank.saturating_sub(CONTENT + MARKS)
}

/// Offsets in a bank.
const CHECK: u32 = 2;
/// See [`CHECK`].
const SEQUENCE: u32 = 6;
/// See [`CHECK`].
const LOST: u32 = 10;
/// See [`CHECK`].
const LENGTHS: u32 = 12;
/// See [`CHECK`].
const CONTENT: u32 = LENGTHS + 2 * KINDS as u32;

/// Bytes of the marks at the end.
const MARKS: u32 = 4;

/// Bytes that are copied at a time; even.
const PIECE: u32 = 32;

/// Why a record was not read or stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BankError {
    /// The flash refused, or did not hold what was written to it.
    Access(AccessError),
    /// There is no such kind.
    Kind,
    /// The other bank is not blank: [`Banks::prepare`] first.
    NeedsErase,
    /// The records do not fit into a bank.
    Full,
    /// Nothing is staged.
    NotBegun,
    /// The bank in force has lost a bit since it was mounted.
    Damaged,
}

impl From<AccessError> for BankError {
    fn from(error: AccessError) -> Self {
        Self::Access(error)
    }
}

/// A record that is being stored. Offsets are from the start of the flash.
#[derive(Clone, Debug)]
struct Staging {
    kind: u8,
    /// Where its first byte is.
    start: u32,
    /// Where its next byte goes.
    at: u32,
    /// Where it has to end, so that those behind it have room; even.
    limit: u32,
    /// The byte that waits for the other half of its half-word, while `at` is odd.
    odd: u8,
}

impl Staging {
    /// Adds a byte.
    fn add<F: NorFlash>(&mut self, flash: &mut F, byte: u8) -> Result<(), BankError> {
        if self.at >= self.limit {
            return Err(BankError::Full);
        }
        if self.at & 1 != 0 {
            program(flash, self.at - 1, &[self.odd, byte])?;
        }
        self.odd = byte;
        self.at += 1;
        Ok(())
    }
}

/// A store of [`KINDS`] kinds of records.
///
/// The flash is an argument of each call and has to be the same each time.
#[derive(Clone, Debug)]
pub struct Banks {
    region: Region,
    /// Offset of the bank in force; where none is, of the one that is not written next.
    force: u32,
    /// Whether one is in force.
    whole: bool,
    /// Its sequence number.
    sequence: u16,
    /// Bytes of the other bank that are to be erased before it is written.
    left: u32,
    /// Bit n: the last version of kind n was not whole at the mount.
    damaged: u16,
    staging: Option<Staging>,
}

impl Banks {
    /// Before the banks in `region` were looked at: there is no record.
    ///
    /// Each half of `region` is a bank. It has to be two of the flash's pages at least.
    pub const fn unmounted(region: Region) -> Self {
        Self {
            region,
            force: region.start,
            whole: false,
            sequence: 0,
            left: region.length / 2,
            damaged: 0,
            staging: None,
        }
    }

    /// Finds the records. Nothing is written, whatever is there.
    ///
    /// Reads both banks once. Errors: any of [`AccessError`]; there is no record then.
    pub fn mount<F: ReadNorFlash>(&mut self, flash: &mut F) -> Result<(), AccessError> {
        *self = Self::unmounted(self.region);
        let mut found = self.clone();
        found.look(flash)?;
        *self = found;
        Ok(())
    }

    fn look<F: ReadNorFlash>(&mut self, flash: &mut F) -> Result<(), AccessError> {
        let mut bad = None;
        for bank in [self.region.start, self.region.start + self.bank()] {
            if !self.is_committed(flash, bank) {
                continue;
            }
            let sequence = word(flash, bank + SEQUENCE);
            if !self.is_whole(flash, bank)? {
                bad = Some(bank);
            } else if !self.whole || is_before(self.sequence, sequence) {
                (self.force, self.whole, self.sequence) = (bank, true, sequence);
                self.damaged = word(flash, bank + LOST);
            }
        }
        if let Some(bank) = bad {
            self.take_damage(flash, bank);
        }
        let other = self.other();
        if is_blank(flash, other + CHECK, self.bank() - CHECK)? && word(flash, other) == 0 {
            self.left = 0;
        }
        Ok(())
    }

    /// The marks of `bank` are there, and it is not whole.
    fn take_damage<F: ReadNorFlash>(&mut self, flash: &mut F, bank: u32) {
        let sequence = word(flash, bank + SEQUENCE);
        let is_number = word(flash, bank + SEQUENCE + 2) == !sequence;
        if self.whole && is_number && is_before(sequence, self.sequence) {
            // Its erase was cut.
            return;
        }
        for kind in 0..KINDS {
            if length(flash, bank, kind) != 0 {
                self.damaged |= 1 << kind;
            }
        }
        if !self.whole {
            self.force = bank;
            self.force = self.other();
        }
    }

    /// The kinds whose last version was stored whole and was not whole any more at the mount, bit n
    /// for kind n. What is left of such a kind is older, or nothing. One that is stored anew counts
    /// no more.
    pub const fn damaged(&self) -> u32 {
        self.damaged as u32
    }

    /// Bytes of the record of `kind`; 0 when there is none.
    pub fn length<F: ReadNorFlash>(&self, flash: &mut F, kind: u8) -> u32 {
        if self.whole && kind < KINDS {
            length(flash, self.force, kind)
        } else {
            0
        }
    }

    /// Reads the record of `kind` from `offset` into `into`.
    ///
    /// Returns how many bytes came: fewer than asked only at the end, and 0 when there is no such
    /// record. Errors: [`AccessError::Refused`].
    pub fn read<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        kind: u8,
        offset: u32,
        into: &mut [u8],
    ) -> Result<usize, AccessError> {
        let length = self.length(flash, kind);
        let start = self.force + CONTENT + self.before(flash, kind.min(KINDS));
        part(flash, start, length, offset, into)
    }

    /// Whether [`Banks::prepare`] has something to do before a record can be stored.
    pub const fn needs_erase(&self) -> bool {
        self.left != 0
    }

    /// Makes the bank that is not in force ready for a store, one step for each call: a page of
    /// the flash is erased. What is staged is forgotten.
    ///
    /// Call it until it returns [`Progress::Done`], outside of OPERATIONAL, since the processor
    /// stands still while a page is erased. Errors: any of [`AccessError`].
    pub fn prepare<F: NorFlash>(&mut self, flash: &mut F) -> Result<Progress, AccessError> {
        if self.left == 0 {
            return Ok(Progress::Done);
        }
        self.staging = None;
        let left = self.left.saturating_sub(F::ERASE_SIZE as u32);
        let other = self.other();
        erase_unit(flash, other + left)?;
        if left == 0 {
            program(flash, other, &[0; 2])?;
        }
        self.left = left;
        Ok(match left {
            0 => Progress::Done,
            _ => Progress::More,
        })
    }

    /// Starts a new version of `kind`; what was staged before is forgotten.
    ///
    /// The old version counts until [`Banks::commit`]. Errors: [`BankError::Kind`],
    /// [`BankError::NeedsErase`], [`BankError::Full`], [`BankError::Access`].
    pub fn begin<F: NorFlash>(&mut self, flash: &mut F, kind: u8) -> Result<(), BankError> {
        self.staging = None;
        if kind >= KINDS {
            return Err(BankError::Kind);
        }
        if self.needs_erase() {
            return Err(BankError::NeedsErase);
        }
        let other = self.other();
        // This also means that the bank is not blank any more, whatever the records are.
        self.left = self.bank();
        let sequence = self.sequence.wrapping_add(1);
        let lost = self.damaged & !(1 << kind);
        put(flash, other + SEQUENCE, sequence)?;
        put(flash, other + SEQUENCE + 2, !sequence)?;
        put(flash, other + LOST, lost)?;
        let before = self.before(flash, kind);
        self.copy(flash, CONTENT, other + CONTENT, before)?;
        let start = other + CONTENT + before;
        let behind = self.behind(flash, kind).1;
        self.staging = Some(Staging {
            kind,
            start,
            at: start,
            limit: other + CONTENT + room(self.bank()) - behind,
            odd: 0,
        });
        Ok(())
    }

    /// Adds `bytes` to what is staged.
    ///
    /// Errors: [`BankError::NotBegun`]; [`BankError::Full`] and [`BankError::Access`], which forget
    /// what is staged.
    pub fn append<F: NorFlash>(&mut self, flash: &mut F, bytes: &[u8]) -> Result<(), BankError> {
        let staging = self.staging.as_mut().ok_or(BankError::NotBegun)?;
        let added = bytes.iter().try_for_each(|byte| staging.add(flash, *byte));
        if added.is_err() {
            self.staging = None;
        }
        added
    }

    /// Reads back what is staged, as [`Banks::read`] does; 0 when nothing is.
    ///
    /// Errors: [`AccessError::Refused`].
    pub fn staged<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        offset: u32,
        into: &mut [u8],
    ) -> Result<usize, AccessError> {
        let Some(staging) = &self.staging else {
            return Ok(0);
        };
        let length = staging.at - staging.start;
        let count = part(flash, staging.start, length, offset, into)?;
        // The last byte is not in the flash as long as it waits for its other half.
        if length & 1 != 0
            && let Some(last) = (length - 1).checked_sub(offset)
            && let Some(byte) = into.get_mut(last as usize)
        {
            *byte = staging.odd;
        }
        Ok(count)
    }

    /// Forgets what is staged.
    pub fn discard(&mut self) {
        self.staging = None;
    }

    /// Makes the staged version the valid one, whole or not at all.
    ///
    /// An empty one is none. Errors: [`BankError::NotBegun`], [`BankError::Damaged`],
    /// [`BankError::Access`]; the old version then stays.
    pub fn commit<F: NorFlash>(&mut self, flash: &mut F) -> Result<(), BankError> {
        let staging = self.staging.take().ok_or(BankError::NotBegun)?;
        let other = self.other();
        self.complete(flash, &staging, other)?;
        let check = check_sum(flash, other, self.bank())?;
        program(flash, other + CHECK, &check.to_le_bytes())?;
        let marks = other + self.bank() - MARKS;
        put(flash, marks, 0)?;
        // It counts from here on, with or without the second mark.
        let _ = put(flash, marks + 2, 0);
        self.force = other;
        self.whole = true;
        self.sequence = self.sequence.wrapping_add(1);
        self.damaged &= !(1 << staging.kind);
        Ok(())
    }

    /// Writes all that is missing before the check sum.
    fn complete<F: NorFlash>(
        &mut self,
        flash: &mut F,
        staging: &Staging,
        other: u32,
    ) -> Result<(), BankError> {
        let mut end = staging.at;
        if end & 1 != 0 {
            program(flash, end - 1, &[staging.odd, u8::MAX])?;
            end += 1;
        }
        let (from, size) = self.behind(flash, staging.kind);
        self.copy(flash, from, end, size)?;
        for kind in 0..KINDS {
            let length = if kind == staging.kind {
                staging.at - staging.start
            } else {
                self.length(flash, kind)
            };
            let at = other + LENGTHS + 2 * u32::from(kind);
            put(flash, at, (length as u16).wrapping_sub(1))?;
        }
        // What was copied was right only if it still is.
        if self.whole && !self.is_whole(flash, self.force)? {
            return Err(BankError::Damaged);
        }
        Ok(())
    }

    /// Bytes of a bank.
    const fn bank(&self) -> u32 {
        self.region.length / 2
    }

    /// Offset of the bank that is not in force.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    const fn other(&self) -> u32 {
        2 * self.region.start + self.bank() - self.force
    }

    fn is_committed<F: ReadNorFlash>(&self, flash: &mut F, bank: u32) -> bool {
        let marks = bank + self.bank() - MARKS;
        word(flash, marks) == 0 || word(flash, marks + 2) == 0
    }

    /// Whether the check sum of `bank` is right.
    fn is_whole<F: ReadNorFlash>(&self, flash: &mut F, bank: u32) -> Result<bool, AccessError> {
        let mut held = [0; 4];
        read(flash, bank + CHECK, &mut held)?;
        Ok(u32::from_le_bytes(held) == check_sum(flash, bank, self.bank())?)
    }

    /// Bytes that the records below `kind` take.
    fn before<F: ReadNorFlash>(&self, flash: &mut F, kind: u8) -> u32 {
        if self.whole {
            before(flash, self.force, kind)
        } else {
            0
        }
    }

    /// Where in the bank the records above `kind` begin, and how many bytes they take.
    fn behind<F: ReadNorFlash>(&self, flash: &mut F, kind: u8) -> (u32, u32) {
        let start = self.before(flash, kind + 1);
        (CONTENT + start, self.before(flash, KINDS) - start)
    }

    /// Copies `size` bytes, an even number, from offset `from` in the bank in force to offset
    /// `to` of the flash.
    fn copy<F: NorFlash>(
        &self,
        flash: &mut F,
        from: u32,
        to: u32,
        size: u32,
    ) -> Result<(), AccessError> {
        let mut piece = [0; PIECE as usize];
        let mut done = 0;
        while done < size {
            let count = (size - done).min(PIECE);
            let bytes = piece.get_mut(..count as usize).unwrap_or_default();
            read(flash, self.force + from + done, bytes)?;
            program(flash, to + done, bytes)?;
            done += count;
        }
        Ok(())
    }
}

/// Whether the sequence number `a` was given out before `b`.
const fn is_before(a: u16, b: u16) -> bool {
    (a.wrapping_sub(b) as i16) < 0
}

/// The half-word at `at`; what cannot be read is as if it were blank. Each call that counts on one
/// also reads or programs where a refusal is told of.
fn word<F: ReadNorFlash>(flash: &mut F, at: u32) -> u16 {
    let mut bytes = [u8::MAX; 2];
    let _ = read(flash, at, &mut bytes);
    u16::from_le_bytes(bytes)
}

fn put<F: NorFlash>(flash: &mut F, at: u32, word: u16) -> Result<(), AccessError> {
    program(flash, at, &word.to_le_bytes())
}

/// What `bank` holds as the length of `kind`, bytes.
fn length<F: ReadNorFlash>(flash: &mut F, bank: u32, kind: u8) -> u32 {
    let held = word(flash, bank + LENGTHS + 2 * u32::from(kind));
    u32::from(held.wrapping_add(1))
}

/// Bytes that the records below `kind` take in `bank`.
fn before<F: ReadNorFlash>(flash: &mut F, bank: u32, kind: u8) -> u32 {
    let mut sum = 0;
    for below in 0..kind {
        sum += (length(flash, bank, below) + 1) & !1;
    }
    sum
}

/// What the check sum of the bank of `size` bytes at `bank` has to be.
fn check_sum<F: ReadNorFlash>(flash: &mut F, bank: u32, size: u32) -> Result<u32, AccessError> {
    let content = before(flash, bank, KINDS).min(room(size));
    let mut crc = Crc32::new();
    add_to(
        &mut crc,
        flash,
        bank + SEQUENCE,
        CONTENT - SEQUENCE + content,
    )?;
    Ok(crc.value())
}

/// Reads from `offset` on of the `length` bytes at `start`; how many came.
fn part<F: ReadNorFlash>(
    flash: &mut F,
    start: u32,
    length: u32,
    offset: u32,
    into: &mut [u8],
) -> Result<usize, AccessError> {
    let wanted = (length.saturating_sub(offset) as usize).min(into.len());
    let bytes = into.get_mut(..wanted).unwrap_or_default();
    read(flash, start.saturating_add(offset), bytes)?;
    Ok(wanted)
}

#[cfg(test)]
mod tests;
