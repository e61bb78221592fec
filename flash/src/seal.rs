//! The end of the bootloader's region: its check sum, and where the functions are that it lends.
//!
//! In: the flash, and what is looked for. Out: the addresses of its functions, if every byte of
//! the region is as it was linked. The product's bootloader lends its verifier of signatures, so
//! that neither application carries its own and an update cannot change it. The paper's lends what
//! erases a page of records (R10), so that its application has nothing that erases.
//!
//! | offset from the end | bytes | is |
//! |---:|---:|---|
//! | -24 | 4 | [`VERIFIER`] or [`ERASER`], the version of the calls in its lowest byte |
//! | -20 | 12 | addresses of three functions, with the Thumb bit |
//! | -8 | 4 | bytes of the state that the caller lends |
//! | -4 | 4 | [`Crc32`] of all before it in the region |
//!
//! The functions are `begin`, `add` and `is_good` of a verifier; of an eraser all are `erase`.
//!
//! The linker fills in the first 20 bytes, `cargo xtask image` the last four.
//!
//! Left out: the calls, which are the firmware's.

use embedded_storage::nor_flash::ReadNorFlash;

use crate::access::{AccessError, for_each, read};
use crate::check_sum::Crc32;
use crate::layout::{Region, SEAL};

/// "PLV" and the version of the calls: a verifier of signatures.
pub const VERIFIER: u32 = u32::from_le_bytes([1, b'V', b'L', b'P']);

/// "PLE" and the version of the calls: what erases a page of records.
pub const ERASER: u32 = u32::from_le_bytes([1, b'E', b'L', b'P']);

/// Functions that are told of.
pub const CALLS: usize = 3;

/// Where the check sum is, from the end of the region.
pub const CHECK_SUM: u32 = 4;

/// The functions that were found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seal {
    /// Their addresses, in the order of their kind.
    pub calls: [u32; CALLS],
    /// Bytes of state that they need.
    pub state: u32,
}

/// Why there are no functions to be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SealError {
    /// There are none, others, or some with other calls.
    Magic(u32),
    /// The region is not as it was linked.
    Damaged,
    /// A function is outside the region.
    Address(u32),
    /// The flash could not be read.
    Access(AccessError),
}

impl From<AccessError> for SealError {
    fn from(error: AccessError) -> Self {
        Self::Access(error)
    }
}

impl Seal {
    /// Finds what `wanted` names, [`VERIFIER`] or [`ERASER`], in the bootloader's region, all of
    /// which is read.
    ///
    /// Errors: see [`SealError`].
    pub fn find<F: ReadNorFlash>(
        flash: &mut F,
        boot: Region,
        wanted: u32,
    ) -> Result<Self, SealError> {
        let mut bytes = [0; SEAL as usize];
        read(flash, boot.end().saturating_sub(SEAL), &mut bytes)?;
        let (words, _) = bytes.as_chunks::<4>();
        let mut words = words.iter().map(|word| u32::from_le_bytes(*word));
        let mut next = || words.next().unwrap_or(u32::MAX);
        let magic = next();
        if magic != wanted {
            return Err(SealError::Magic(magic));
        }
        let calls = [next(), next(), next()];
        let (state, check_sum) = (next(), next());
        let mut crc = Crc32::new();
        let length = boot.length.saturating_sub(CHECK_SUM);
        for_each(flash, boot.start, length, &mut |bytes| crc.add(bytes))?;
        if crc.value() != check_sum {
            return Err(SealError::Damaged);
        }
        let code = boot.address()..boot.address().saturating_add(boot.length);
        let outside = |at: &u32| at & 1 == 0 || !code.contains(at);
        if let Some(at) = calls.into_iter().find(outside) {
            return Err(SealError::Address(at));
        }
        Ok(Self { calls, state })
    }
}

/// Closes the bootloader's region: what was linked, all of it, with its check sum behind it.
///
/// `region` is the whole region; its last four bytes are filled in.
pub fn close(region: &mut [u8]) {
    let at = region.len().saturating_sub(CHECK_SUM as usize);
    let (body, end) = region.split_at_mut(at);
    let check_sum = Crc32::of(body).to_le_bytes();
    for (to, from) in end.iter_mut().zip(check_sum) {
        *to = from;
    }
}

#[cfg(test)]
mod tests {
    use std::vec;
    use std::vec::Vec;

    use embedded_storage::nor_flash::NorFlash;

    use super::*;
    use crate::layout::{PAGE, RC};
    use crate::nor::{Draw, Nor, Page};

    struct Zeros;

    impl Draw for Zeros {
        fn draw(&mut self) -> u32 {
            0
        }
    }

    const CODE: u32 = 0x0800_0401;

    fn region(words: [u32; 5]) -> Vec<u8> {
        let mut region: Vec<u8> = (0..RC.boot.length).map(|n| (n / 3) as u8).collect();
        let at = (RC.boot.length - SEAL) as usize;
        for (place, word) in region[at..].chunks_mut(4).zip(words) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        close(&mut region);
        region
    }

    fn found(region: &[u8]) -> Result<Seal, SealError> {
        let pages = vec![Page::new(); (RC.boot.length / PAGE) as usize];
        let mut nor = Nor::new(pages, Zeros);
        nor.write(0, region).unwrap();
        Seal::find(&mut nor, RC.boot, VERIFIER)
    }

    #[test]
    fn what_was_closed_is_found() {
        let seal = found(&region([VERIFIER, CODE, CODE + 2, CODE + 4, 640])).unwrap();
        assert_eq!(seal.calls, [CODE, CODE + 2, CODE + 4]);
        assert_eq!(seal.state, 640);
    }

    #[test]
    fn any_flipped_bit_of_the_region_leaves_no_verifier() {
        let whole = region([VERIFIER, CODE, CODE, CODE, 640]);
        let end = whole.len();
        for at in (0..end - 32).step_by(509).chain(end - 32..end) {
            for bit in [0, 7] {
                let mut damaged = whole.clone();
                damaged[at] ^= 1 << bit;
                assert!(found(&damaged).is_err(), "{at}");
            }
        }
    }

    #[test]
    fn an_erased_region_other_calls_and_addresses_elsewhere_are_told_apart() {
        let erased = vec![u8::MAX; RC.boot.length as usize];
        assert_eq!(found(&erased), Err(SealError::Magic(u32::MAX)));
        let other = region([VERIFIER + 1, CODE, CODE, CODE, 640]);
        assert_eq!(found(&other), Err(SealError::Magic(VERIFIER + 1)));
        let eraser = region([ERASER, CODE, CODE, CODE, 0]);
        assert_eq!(found(&eraser), Err(SealError::Magic(ERASER)));
        let end = RC.boot.address() + RC.boot.length + 1;
        for wrong in [CODE - 1, 0, end, 0x2000_0001] {
            let elsewhere = region([VERIFIER, CODE, wrong, CODE, 640]);
            assert_eq!(found(&elsewhere), Err(SealError::Address(wrong)));
        }
    }
}
