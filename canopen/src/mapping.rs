//! Which objects a PDO, or one half of an SRDO, carries (CiA 301, 7.5.2.36 and 7.5.2.38;
//! EN 50325-5).
//!
//! In: mapping entries as they stand in the dictionary, index, sub-index and length in bits. Out:
//! whether the device's dictionary allows them, and the bytes of a frame made from the objects or
//! taken apart into them.
//!
//! Left out: parts of a byte (the granularity is 8 bits), and multiplexed PDOs.

use crate::object::{Abort, Access, Address, DataType, Dictionary, Objects, Value, at};

#[cfg(test)]
pub(crate) mod shelf;

/// Entries of a mapping: eight bytes, one object each.
pub const ENTRIES: u8 = 8;

/// Bits in a frame.
const FRAME_BITS: u16 = 64;

/// Objects 0001h to 0007h stand for their data type and hold a place in an RPDO (CiA 301, table
/// 44). BOOLEAN has no whole byte, so its bits here are 0 and no entry matches.
const DUMMIES: [u8; 8] = [0, 0, 8, 16, 32, 8, 16, 32];

/// A list of up to eight mapped objects.
///
/// It holds whatever has been put in; [`Mapping::check`] returns whether it may be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mapping {
    entries: [u32; ENTRIES as usize],
    count: u8,
    /// All objects named take any value of their length: there is nothing to look up.
    unlimited: bool,
    /// The bytes of all objects, where they are consecutive sub-indices of one index; otherwise 0.
    adjacent: u8,
}

const fn address(entry: u32) -> Address {
    at((entry >> 16) as u16, (entry >> 8) as u8)
}

const fn bits(entry: u32) -> u8 {
    entry as u8
}

/// Whether an entry of a list that may be used names a dummy object: no other has such an index.
const fn is_dummy(entry: u32) -> bool {
    entry >> 16 < DUMMIES.len() as u32
}

/// Bits that a dummy object takes; `None` when the entry names a real object.
fn dummy(entry: u32) -> Option<u8> {
    let Address { index, sub } = address(entry);
    let bits = DUMMIES.get(usize::from(index))?;
    (index != 0 && sub == 0).then_some(*bits)
}

/// Whether one entry may stand in a mapping that needs `access`.
///
/// Errors: [`Abort::NoSuchObject`], [`Abort::NoSuchSubIndex`], or [`Abort::NotMappable`] for an
/// object without that access, for BOOLEAN and for a length other than the object's.
pub fn admits(dictionary: &Dictionary, entry: u32, access: Access) -> Result<(), Abort> {
    let size = match dummy(entry) {
        Some(size) if access == Access::RPDO => size,
        _ => {
            let row = dictionary.form(address(entry))?;
            if !row.access.has(access) || row.data_type == DataType::Boolean {
                return Err(Abort::NotMappable);
            }
            row.data_type.size().map_or(0, |size| 8 * size as u8)
        }
    };
    if size == 0 || size != bits(entry) {
        return Err(Abort::NotMappable);
    }
    Ok(())
}

impl Mapping {
    /// Nothing mapped.
    pub const fn new() -> Self {
        Self {
            entries: [0; ENTRIES as usize],
            count: 0,
            unlimited: false,
            adjacent: 0,
        }
    }

    /// How many entries count (sub-index 0).
    pub const fn count(&self) -> u8 {
        self.count
    }

    /// Sets how many entries count, unchecked.
    pub const fn set_count(&mut self, count: u8) {
        self.count = count;
        self.changed();
    }

    const fn changed(&mut self) {
        self.unlimited = false;
        self.adjacent = 0;
    }

    /// Looks once for what every frame would ask anew: whether any of the objects has limits
    /// ([`Mapping::fits`]), and whether they stand side by side.
    pub fn look_ahead(&mut self, dictionary: &Dictionary) {
        let free = |entry| {
            let row = || dictionary.form(address(entry));
            is_dummy(entry) || row().is_ok_and(|row| !dictionary.limits(row))
        };
        let unlimited = self.used().all(free);
        self.unlimited = unlimited;
        let first = self.entry(0).unwrap_or(0) >> 8;
        let in_a_row = (first..)
            .zip(self.used())
            .all(|(at, entry)| at == entry >> 8);
        self.adjacent = if in_a_row && !is_dummy(self.entry(0).unwrap_or(0)) {
            self.length() as u8
        } else {
            0
        };
    }

    /// The first object and the bytes of all of them, where they stand side by side.
    fn adjacent(&self) -> Option<(Address, usize)> {
        let first = self.entry(0).filter(|_| self.adjacent != 0)?;
        Some((address(first), self.adjacent.into()))
    }

    /// Entry number `n` from 0, 0 when it was never written; `None` from 8 on.
    pub fn entry(&self, n: u8) -> Option<u32> {
        self.entries.get(usize::from(n)).copied()
    }

    /// Sets entry number `n` from 0, unchecked; false from 8 on.
    pub fn set_entry(&mut self, n: u8, entry: u32) -> bool {
        self.changed();
        let slot = self.entries.get_mut(usize::from(n));
        slot.map(|slot| *slot = entry).is_some()
    }

    fn used(&self) -> impl Iterator<Item = u32> + '_ {
        self.entries.iter().take(usize::from(self.count)).copied()
    }

    /// Whether the first `count` entries may be used together, by objects with `access`.
    ///
    /// Errors: those of [`admits`], and [`Abort::PdoTooLong`] for more than 8 entries (this
    /// includes the 254 and 255 of multiplexed PDOs) or more than 64 bits.
    pub fn check(&self, dictionary: &Dictionary, access: Access, count: u8) -> Result<(), Abort> {
        if count > ENTRIES {
            return Err(Abort::PdoTooLong);
        }
        let mut total = 0;
        for entry in self.entries.iter().take(usize::from(count)) {
            admits(dictionary, *entry, access)?;
            total += u16::from(bits(*entry));
        }
        if total > FRAME_BITS {
            return Err(Abort::PdoTooLong);
        }
        Ok(())
    }

    /// True when each entry of `other` is the twin of the one at its place here: the object with
    /// the next index (CiA 410: 6210h and 6211h) or the next sub-index. Anything else would be
    /// signed and sent in vain, or with the halves swapped.
    pub fn is_parallel(&self, other: &Self) -> bool {
        self.count == other.count && self.are_twins(other, self.count)
    }

    /// As [`Mapping::is_parallel`], if the first `count` entries of both counted.
    pub(crate) fn are_twins(&self, other: &Self, count: u8) -> bool {
        let twin =
            |plain: u32, inverted: u32| matches!(inverted.wrapping_sub(plain), 0x1_0000 | 0x100);
        let mut pairs = self.entries.iter().zip(&other.entries).take(count.into());
        pairs.all(|(a, b)| twin(*a, *b))
    }

    /// Bytes that the mapped objects take in a frame.
    pub fn length(&self) -> usize {
        let total: u16 = self.used().map(|entry| u16::from(bits(entry))).sum();
        usize::from(total >> 3)
    }

    /// Reads the mapped objects into the bytes of a frame, the first entry first.
    ///
    /// Errors: what an object answers that cannot be read now. A frame with a hole in it would
    /// pass for a measurement, so there is none.
    pub fn pack<O: Objects>(&self, objects: &mut O) -> Result<Value, Abort> {
        if let Some((first, length)) = self.adjacent()
            && let Some(values) = objects.read_adjacent(first, length)
        {
            return Ok(values);
        }
        let mut number = 0;
        let mut shift = 0;
        for entry in self.used() {
            // An object has the length of its entry, and all of them at most 64 bits.
            let value = objects.read(address(entry))?;
            number |= value.unsigned().wrapping_shl(shift);
            shift += u32::from(bits(entry));
        }
        Ok(Value::cut(number, shift as usize >> 3))
    }

    /// Whether the bytes of a frame, the first one lowest, are inside the limits of the objects.
    ///
    /// Errors: the first limit that is broken.
    pub fn fits(&self, dictionary: &Dictionary, data: u64) -> Result<(), Abort> {
        if self.unlimited {
            return Ok(());
        }
        self.each(data, |at, value| {
            dictionary.admits(dictionary.form(at)?, &value)
        })
    }

    /// Writes the bytes of a frame, the first one lowest, into the mapped objects.
    ///
    /// Errors: those of [`Mapping::fits`], nothing being written then; or what an object answers
    /// to its write, those behind it being left as they are.
    pub fn unpack<O: Objects>(&self, objects: &mut O, data: u64) -> Result<(), Abort> {
        if !self.unlimited {
            self.fits(&objects.dictionary(), data)?;
        } else if let Some((first, length)) = self.adjacent()
            && objects.write_adjacent(first, &Value::cut(data, length))
        {
            return Ok(());
        }
        self.each(data, |at, value| objects.write(at, value))
    }

    fn each<F>(&self, mut data: u64, mut take: F) -> Result<(), Abort>
    where
        F: FnMut(Address, Value) -> Result<(), Abort>,
    {
        for entry in self.used() {
            if !is_dummy(entry) {
                take(
                    address(entry),
                    Value::cut(data, usize::from(bits(entry) >> 3)),
                )?;
            }
            // Behind one of 64 bits there is none.
            data = data.wrapping_shr(u32::from(bits(entry)));
        }
        Ok(())
    }
}

impl Default for Mapping {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::shelf::Shelf;
    use super::*;

    fn mapping(entries: &[u32]) -> Mapping {
        let mut mapping = Mapping::new();
        for (n, entry) in entries.iter().enumerate() {
            assert!(mapping.set_entry(n as u8, *entry));
        }
        mapping.set_count(entries.len() as u8);
        mapping
    }

    fn checked(entries: &[u32], access: Access) -> Result<(), Abort> {
        let dictionary = Shelf::new().dictionary();
        mapping(entries).check(&dictionary, access, entries.len() as u8)
    }

    /// Such a configuration could be signed, and sent angles with their halves swapped.
    #[test]
    fn swapped_or_foreign_twins_are_none() {
        let plain = mapping(&[0x6210_0010, 0x2012_0110]);
        assert!(plain.is_parallel(&mapping(&[0x6211_0010, 0x2012_0210])));
        assert!(!plain.is_parallel(&mapping(&[0x6211_0010])));
        let slope = mapping(&[0x6210_0010]);
        for other in [0x6210_0010, 0x6221_0010, 0x6211_0008, 0x2012_0210] {
            assert!(!slope.is_parallel(&mapping(&[other])), "{other:X}");
        }
        assert!(!mapping(&[0x6211_0010]).is_parallel(&slope));
    }

    #[test]
    fn bytes_stand_in_the_order_of_the_entries() {
        let mut shelf = Shelf::new();
        shelf.put(0x6010, 0, 0x1122);
        shelf.put(0x2021, 0, 0x33);
        shelf.put(0x2030, 0, 0x44556677);
        let packed = mapping(&[0x6010_0010, 0x2021_0008, 0x2030_0020]).pack(&mut shelf);
        let bytes = [0x22, 0x11, 0x33, 0x77, 0x66, 0x55, 0x44];
        assert_eq!(packed, Ok(Value::new(&bytes).unwrap()));
    }

    #[test]
    fn a_value_of_64_bits_fills_the_frame() {
        let mut shelf = Shelf::new();
        shelf.put(0x2040, 0, 0x8877_6655_4433_2211);
        let list = mapping(&[0x2040_0040]);
        let packed = list.pack(&mut shelf).unwrap();
        assert_eq!(packed.unsigned(), 0x8877_6655_4433_2211);
        assert_eq!(list.unpack(&mut shelf, 7), Ok(()));
        assert_eq!(shelf.get(0x2040, 0), 7);
    }

    #[test]
    fn nothing_is_written_when_one_value_is_out_of_range() {
        let mut shelf = Shelf::new();
        let list = mapping(&[0x2050_0008, 0x2051_0008]);
        assert_eq!(list.unpack(&mut shelf, 0x65_01), Err(Abort::ValueTooHigh));
        assert_eq!((shelf.get(0x2050, 0), shelf.get(0x2051, 0)), (0, 0));
        assert_eq!(list.unpack(&mut shelf, 0x64_01), Ok(()));
        assert_eq!((shelf.get(0x2050, 0), shelf.get(0x2051, 0)), (1, 100));
    }

    #[test]
    fn limits_that_were_looked_for_count_until_the_list_changes() {
        let mut shelf = Shelf::new();
        let mut list = mapping(&[0x2050_0008, 0x0005_0008]);
        list.look_ahead(&shelf.dictionary());
        assert!(list.unlimited);
        assert_eq!(list.unpack(&mut shelf, 0xFF), Ok(()));
        assert_eq!(shelf.get(0x2050, 0), 0xFF);
        list.set_entry(1, 0x2051_0008);
        assert_eq!(list.unpack(&mut shelf, 0x65_01), Err(Abort::ValueTooHigh));
        list.look_ahead(&shelf.dictionary());
        assert_eq!(list.unpack(&mut shelf, 0x65_01), Err(Abort::ValueTooHigh));
        list.set_count(1);
        assert_eq!(list.unpack(&mut shelf, 0x01), Ok(()));
    }

    #[test]
    fn dummies_hold_a_place_in_an_rpdo_only() {
        let list = [0x0005_0008, 0x0003_0010, 0x2050_0008];
        assert_eq!(checked(&list, Access::RPDO), Ok(()));
        assert_eq!(checked(&list, Access::TPDO), Err(Abort::NoSuchObject));
        let mut shelf = Shelf::new();
        assert_eq!(mapping(&list).unpack(&mut shelf, 0x09_AA_BB_CC), Ok(()));
        assert_eq!(shelf.get(0x2050, 0), 9);
    }

    #[test]
    fn a_dummy_has_the_length_of_its_type() {
        for bad in [0x0005_0010, 0x0001_0001, 0x0001_0008] {
            assert_eq!(checked(&[bad], Access::RPDO), Err(Abort::NotMappable));
        }
        for none in [0x0000_0008, 0x0005_0108, 0x0008_0020] {
            assert_eq!(checked(&[none], Access::RPDO), Err(Abort::NoSuchObject));
        }
    }

    #[test]
    fn what_is_not_there_is_told_from_what_cannot_be_mapped() {
        let one = |entry| checked(&[entry], Access::TPDO);
        assert_eq!(one(0x6010_0010), Ok(()));
        assert_eq!(one(0x7000_0010), Err(Abort::NoSuchObject));
        assert_eq!(one(0x6010_0110), Err(Abort::NoSuchSubIndex));
        assert_eq!(one(0x6010_0008), Err(Abort::NotMappable));
        assert_eq!(one(0x6011_0008), Err(Abort::NotMappable));
        assert_eq!(one(0x2060_0001), Err(Abort::NotMappable));
        assert_eq!(one(0x2060_0008), Err(Abort::NotMappable));
        assert_eq!(one(0x2061_0000), Err(Abort::NotMappable));
    }

    #[test]
    fn sixty_four_bits_and_no_more() {
        let list = [0x2030_0020, 0x2030_0020];
        assert_eq!(checked(&list, Access::TPDO), Ok(()));
        let list = [0x2030_0020, 0x2030_0020, 0x2021_0008];
        assert_eq!(checked(&list, Access::TPDO), Err(Abort::PdoTooLong));
    }

    #[test]
    fn an_object_that_cannot_be_read_leaves_no_frame() {
        let mut shelf = Shelf::new();
        shelf.unreadable = Some(at(0x2021, 0));
        let packed = mapping(&[0x6010_0010, 0x2021_0008]).pack(&mut shelf);
        assert_eq!(packed, Err(Abort::NoData));
    }
}
