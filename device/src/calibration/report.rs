//! The hash of the calibration report: which paper belongs to the calibration in force.
//!
//! In: the 32 bytes of a SHA-256 from a tool, and the check sum of the calibration in force. Out:
//! the same bytes, as long as that calibration is in force. Both are one record, so a hash never
//! vouches for a calibration that came after it, whatever is cut or restored between.
//!
//! Left out: what the hash is of, which is the tool's business (docs/calibration-report.md).

use crate::records::{Record, RecordStore, StoreError};

/// Bytes of the hash.
pub const HASH: u32 = 32;

/// Bytes of the check sum before it.
const HEAD: u32 = 4;

/// Bytes of the record.
pub const LENGTH: u32 = HEAD + HASH;

/// Whether the hash that is stored belongs to the calibration with this check sum.
pub fn belongs<M: RecordStore>(memory: &mut M, identity: u32) -> bool {
    let mut head = [0; HEAD as usize];
    let read = memory.read(Record::Report, 0, &mut head);
    read == head.len() && u32::from_le_bytes(head) == identity
}

/// Reads the stored hash from `offset` on; how many bytes, fewer only at the end.
pub fn read_at<M: RecordStore>(memory: &mut M, offset: u32, into: &mut [u8]) -> usize {
    memory.read(Record::Report, offset.saturating_add(HEAD), into)
}

/// Stages a record for the calibration with this check sum; its hash is appended by the caller.
///
/// Errors: those of the store.
pub fn begin<M: RecordStore>(memory: &mut M, identity: u32) -> Result<(), StoreError> {
    memory.begin(Record::Report, LENGTH)?;
    memory.append(&identity.to_le_bytes())
}

/// Whether exactly one hash is staged.
pub fn is_whole<M: RecordStore>(memory: &mut M) -> bool {
    memory.staged(LENGTH - 1, &mut [0; 2]) == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::records::tests::Memory;

    fn stored(memory: &mut Memory, identity: u32, hash: &[u8]) -> bool {
        begin(memory, identity).unwrap();
        memory.append(hash).unwrap();
        let whole = is_whole(memory);
        if whole {
            memory.commit().unwrap();
        } else {
            memory.discard();
        }
        whole
    }

    #[test]
    fn a_hash_counts_for_its_own_calibration_only() {
        let mut memory = Memory::with_room(LENGTH as usize);
        assert!(!belongs(&mut memory, 0));
        assert!(stored(&mut memory, 7, &[0x5A; 32]));
        assert!(belongs(&mut memory, 7) && !belongs(&mut memory, 8));
        let mut hash = [0; 40];
        assert_eq!(read_at(&mut memory, 0, &mut hash), 32);
        assert_eq!(hash[..32], [0x5A; 32]);
        assert_eq!(read_at(&mut memory, 30, &mut hash), 2);
    }

    #[test]
    fn a_hash_that_is_cut_short_is_no_hash() {
        let mut memory = Memory::with_room(64);
        assert!(stored(&mut memory, 7, &[0x5A; 32]));
        for bytes in [&[][..], &[1; 31], &[1; 33]] {
            assert!(!stored(&mut memory, 8, bytes));
            assert!(belongs(&mut memory, 7));
        }
    }
}
