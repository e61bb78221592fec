//! Store and restore of parameters, 1010h and 1011h (CiA 301, 7.5.2.13 and 7.5.2.14).
//!
//! In: which group, and the signature written. Out: every stored row of that group passed to the
//! application's memory, or taken from it at a start. A restore forgets what was stored; the
//! defaults count from the next reset on, as the standard asks.
//!
//! Left out: the memory itself, which is the application's.

use crate::object::{Abort, Access, Dictionary, Entries, Entry, Value};

/// "save" as it stands in 1010h, first letter in the lowest byte.
pub const SAVE: u32 = u32::from_le_bytes(*b"save");
/// "load" as it stands in 1011h.
pub const LOAD: u32 = u32::from_le_bytes(*b"load");
/// What 1010h and 1011h read: stores and restores on command, never by itself.
pub const ON_COMMAND: u32 = 1;

/// Which objects are stored together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// 1000h to 1FFFh (sub 2).
    Communication,
    /// 6000h to 9FFFh (sub 3).
    Profile,
    /// 2000h to 5FFFh (sub 4).
    Manufacturer,
}

impl Group {
    /// Every group.
    pub const ALL: [Self; 3] = [Self::Communication, Self::Profile, Self::Manufacturer];

    /// The groups that a sub-index of 1010h or 1011h stands for.
    pub const fn of_sub(sub: u8) -> &'static [Self] {
        match sub {
            1 => &Self::ALL,
            2 => &[Self::Communication],
            3 => &[Self::Profile],
            4 => &[Self::Manufacturer],
            _ => &[],
        }
    }

    /// True for objects of this group.
    pub const fn holds(self, index: u16) -> bool {
        match self {
            Self::Communication => matches!(index, 0x1000..=0x1FFF),
            Self::Manufacturer => matches!(index, 0x2000..=0x5FFF),
            Self::Profile => matches!(index, 0x6000..=0x9FFF),
        }
    }
}

/// Checks the signature; anything else is refused as data that cannot be stored.
pub fn signed(value: &Value, signature: u32) -> Result<(), Abort> {
    if value.unsigned() == u64::from(signature) {
        Ok(())
    } else {
        Err(Abort::CannotStore)
    }
}

/// The rows of a group that are kept.
pub fn rows(dictionary: &Dictionary, group: Group) -> Rows {
    Rows {
        left: dictionary.entries(),
        group,
    }
}

/// What [`rows`] goes through.
#[derive(Clone, Debug)]
pub struct Rows {
    left: Entries,
    group: Group,
}

impl Iterator for Rows {
    type Item = Entry;

    fn next(&mut self) -> Option<Entry> {
        let group = self.group;
        self.left
            .find(|e| group.holds(e.index) && e.access.has(Access::STORED))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_signatures_are_not_byte_swapped() {
        assert_eq!(SAVE, 0x6576_6173);
        assert_eq!(LOAD, 0x6461_6F6C);
        assert_eq!(
            signed(&Value::u32(0x7361_7665), SAVE),
            Err(Abort::CannotStore)
        );
    }

    #[test]
    fn every_group_has_its_own_objects() {
        for index in [0x1000_u16, 0x1FFF, 0x2000, 0x5FFF, 0x6000, 0x9FFF] {
            let holders = Group::ALL.iter().filter(|g| g.holds(index)).count();
            assert_eq!(holders, 1, "{index:04X}");
        }
    }
}
