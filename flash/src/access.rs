//! Verified access: what was programmed is read back, what was erased is looked through.
//!
//! In: a flash, an offset from its start in bytes, bytes. Out: nothing, or an [`AccessError`].
//! Programs and erases whole half-words and pages of [`PAGE`]; a flash with other sizes does not
//! compile, but for [`erase_unit`].
//!
//! Left out: what the bytes mean.

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::check_sum::Crc32;
use crate::layout::PAGE;

/// Bytes that are read at a time where much is looked through.
const PIECE: usize = 32;

/// Why the flash did not do what was asked. Without a number beside it: it comes back from every
/// access, and in one register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AccessError {
    /// The driver refused the operation.
    Refused,
    /// The page did not erase, or does not hold what was programmed.
    Worn,
}

fn refused<E>(_: E) -> AccessError {
    AccessError::Refused
}

/// Reads `into.len()` bytes from offset `at`.
///
/// Errors: [`AccessError::Refused`].
pub fn read<F: ReadNorFlash>(flash: &mut F, at: u32, into: &mut [u8]) -> Result<(), AccessError> {
    const { assert!(F::READ_SIZE == 1) };
    flash.read(at, into).map_err(refused)
}

/// Hands the `length` bytes from offset `at` on to `take`, in pieces.
///
/// Errors: [`AccessError::Refused`].
pub fn for_each<F: ReadNorFlash>(
    flash: &mut F,
    at: u32,
    length: u32,
    take: &mut dyn FnMut(&[u8]),
) -> Result<(), AccessError> {
    let mut piece = [0; PIECE];
    let end = at + length;
    let mut at = at;
    while at < end {
        let size = (end - at).min(PIECE as u32);
        let part = piece.get_mut(..size as usize).unwrap_or_default();
        read(flash, at, part)?;
        take(part);
        at += size;
    }
    Ok(())
}

/// Takes `length` bytes from offset `at` on into `crc`.
///
/// Errors: [`AccessError::Refused`].
pub fn add_to<F: ReadNorFlash>(
    crc: &mut Crc32,
    flash: &mut F,
    at: u32,
    length: u32,
) -> Result<(), AccessError> {
    for_each(flash, at, length, &mut |bytes| crc.add(bytes))
}

/// Whether `length` bytes from offset `at` on are all FFh.
///
/// Errors: [`AccessError::Refused`].
pub fn is_blank<F: ReadNorFlash>(flash: &mut F, at: u32, length: u32) -> Result<bool, AccessError> {
    let mut piece = [0; PIECE];
    let end = at + length;
    let mut at = at;
    while at < end {
        let size = (end - at).min(PIECE as u32);
        let part = piece.get_mut(..size as usize).unwrap_or_default();
        read(flash, at, part)?;
        if part.iter().any(|byte| *byte != u8::MAX) {
            return Ok(false);
        }
        at += size;
    }
    Ok(true)
}

/// Programs an even number of `bytes` at the even offset `at` and reads them back.
///
/// Half-words of FFFFh are left alone: they read so already, and stay free to be programmed.
/// Errors: any of [`AccessError`].
pub fn program<F: NorFlash>(flash: &mut F, at: u32, bytes: &[u8]) -> Result<(), AccessError> {
    const { assert!(F::WRITE_SIZE == 1 || F::WRITE_SIZE == 2) };
    for (place, half_word) in (at..).step_by(2).zip(bytes.chunks(2)) {
        if half_word != [u8::MAX; 2] {
            flash.write(place, half_word).map_err(refused)?;
        }
    }
    let mut rest = bytes;
    let mut same = true;
    for_each(flash, at, bytes.len() as u32, &mut |held| {
        let (expected, behind) = rest.split_at_checked(held.len()).unwrap_or_default();
        same &= held == expected;
        rest = behind;
    })?;
    if same { Ok(()) } else { Err(AccessError::Worn) }
}

/// Erases the page that begins at offset `at` and looks it through.
///
/// Errors: any of [`AccessError`].
pub fn erase<F: NorFlash>(flash: &mut F, at: u32) -> Result<(), AccessError> {
    const { assert!(F::ERASE_SIZE == PAGE as usize) };
    erase_unit(flash, at)
}

/// Erases what the flash erases at once ([`NorFlash::ERASE_SIZE`]) from offset `at` on and looks it
/// through.
///
/// Errors: any of [`AccessError`].
pub fn erase_unit<F: NorFlash>(flash: &mut F, at: u32) -> Result<(), AccessError> {
    let size = F::ERASE_SIZE as u32;
    flash.erase(at, at + size).map_err(refused)?;
    if is_blank(flash, at, size)? {
        Ok(())
    } else {
        Err(AccessError::Worn)
    }
}

#[cfg(test)]
mod tests {
    use embedded_storage::nor_flash::{ErrorType, NorFlashErrorKind};

    use super::*;
    use crate::nor::tests::bench;

    /// A flash of one page that answers `Ok` and holds what it held.
    struct Deaf([u8; PAGE as usize]);

    impl ErrorType for Deaf {
        type Error = NorFlashErrorKind;
    }

    impl ReadNorFlash for Deaf {
        const READ_SIZE: usize = 1;

        fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
            let at = offset as usize;
            bytes.copy_from_slice(&self.0[at..at + bytes.len()]);
            Ok(())
        }

        fn capacity(&self) -> usize {
            PAGE as usize
        }
    }

    impl NorFlash for Deaf {
        const WRITE_SIZE: usize = 2;
        const ERASE_SIZE: usize = PAGE as usize;

        fn erase(&mut self, _: u32, _: u32) -> Result<(), NorFlashErrorKind> {
            Ok(())
        }

        fn write(&mut self, _: u32, _: &[u8]) -> Result<(), NorFlashErrorKind> {
            Ok(())
        }
    }

    #[test]
    fn what_the_flash_does_not_hold_is_found() {
        let mut flash = Deaf([0xFF; PAGE as usize]);
        let worn = Err(AccessError::Worn);
        assert_eq!(program(&mut flash, 4, &[0xFF, 0xFF, 1, 2]), worn);
        assert_eq!(program(&mut flash, 4, &[0xFF; 40]), Ok(()));
        assert_eq!(erase(&mut flash, 0), Ok(()));
        for at in [0, 31, 32, 1023, 1024, 2047] {
            let mut flash = Deaf([0xFF; PAGE as usize]);
            flash.0[at] = 0xFE;
            assert_eq!(erase(&mut flash, 0), Err(AccessError::Worn));
        }
    }

    #[test]
    fn half_words_that_are_blank_are_left_free() {
        let mut nor = bench(1, 1);
        program(&mut nor, 0, &[1, 2, 0xFF, 0xFF, 3, 0xFF]).unwrap();
        program(&mut nor, 2, &[7, 8]).unwrap();
        let mut held = [0; 6];
        read(&mut nor, 0, &mut held).unwrap();
        assert_eq!((held, nor.operations()), ([1, 2, 7, 8, 3, 0xFF], 3));
        let beyond = AccessError::Refused;
        assert_eq!(read(&mut nor, PAGE - 4, &mut held), Err(beyond));
        assert_eq!(program(&mut nor, PAGE, &[0, 0]), Err(beyond));
    }
}
