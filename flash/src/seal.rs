//! The end of the bootloader's region: its check sum, and where its verifier of signatures is.
//!
//! In: the flash. Out: the addresses of three functions, if every byte of the region is as it was
//! linked. Both applications call the one verifier that stands beside the bootloader; so neither
//! carries its own, and an update cannot change it.
//!
//! | offset from the end | bytes | is |
//! |---:|---:|---|
//! | -24 | 4 | [`MAGIC`], with the version of the calls in its lowest byte |
//! | -20 | 12 | addresses of `begin`, `add` and `is_good`, with the Thumb bit |
//! | -8 | 4 | bytes of the state that the caller lends |
//! | -4 | 4 | [`Crc32`] of all before it in the region |
//!
//! The linker fills in the first 20 bytes, `cargo xtask image` the last four.
//!
//! Left out: the calls, which are the firmware's.

use embedded_storage::nor_flash::ReadNorFlash;

use crate::access::{AccessError, for_each, read};
use crate::check_sum::Crc32;
use crate::layout::{Region, SEAL};

/// "PLV" and the version of the calls.
pub const MAGIC: u32 = u32::from_le_bytes([1, b'V', b'L', b'P']);

/// Where the check sum is, from the end of the region.
pub const CHECK_SUM: u32 = 4;

/// The verifier that was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seal {
    /// Address of the function that begins a check.
    pub begin: u32,
    /// Address of the function that takes in bytes.
    pub add: u32,
    /// Address of the function that judges.
    pub is_good: u32,
    /// Bytes of state that it needs.
    pub state: u32,
}

/// Why there is no verifier to be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SealError {
    /// There is none, or one with other calls.
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
    /// Finds the verifier in the bootloader's region, all of which is read.
    ///
    /// Errors: see [`SealError`].
    pub fn find<F: ReadNorFlash>(flash: &mut F, boot: Region) -> Result<Self, SealError> {
        let mut bytes = [0; SEAL as usize];
        read(flash, boot.end().saturating_sub(SEAL), &mut bytes)?;
        let (words, _) = bytes.as_chunks::<4>();
        let mut words = words.iter().map(|word| u32::from_le_bytes(*word));
        let mut next = || words.next().unwrap_or(u32::MAX);
        let magic = next();
        if magic != MAGIC {
            return Err(SealError::Magic(magic));
        }
        let (begin, add, is_good) = (next(), next(), next());
        let (state, check_sum) = (next(), next());
        let mut crc = Crc32::new();
        let length = boot.length.saturating_sub(CHECK_SUM);
        for_each(flash, boot.start, length, &mut |bytes| crc.add(bytes))?;
        if crc.value() != check_sum {
            return Err(SealError::Damaged);
        }
        let code = boot.address()..boot.address().saturating_add(boot.length);
        let outside = |at: &u32| at & 1 == 0 || !code.contains(at);
        if let Some(at) = [begin, add, is_good].into_iter().find(outside) {
            return Err(SealError::Address(at));
        }
        Ok(Self {
            begin,
            add,
            is_good,
            state,
        })
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
        Seal::find(&mut nor, RC.boot)
    }

    #[test]
    fn what_was_closed_is_found() {
        let seal = found(&region([MAGIC, CODE, CODE + 2, CODE + 4, 640])).unwrap();
        let calls = [seal.begin, seal.add, seal.is_good];
        assert_eq!(calls, [CODE, CODE + 2, CODE + 4]);
        assert_eq!(seal.state, 640);
    }

    #[test]
    fn any_flipped_bit_of_the_region_leaves_no_verifier() {
        let whole = region([MAGIC, CODE, CODE, CODE, 640]);
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
        let other = region([MAGIC + 1, CODE, CODE, CODE, 640]);
        assert_eq!(found(&other), Err(SealError::Magic(MAGIC + 1)));
        let end = RC.boot.address() + RC.boot.length + 1;
        for wrong in [CODE - 1, 0, end, 0x2000_0001] {
            let elsewhere = region([MAGIC, CODE, wrong, CODE, 640]);
            assert_eq!(found(&elsewhere), Err(SealError::Address(wrong)));
        }
    }
}
