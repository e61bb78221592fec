//! What may be written to the chip's flash, and what never.
//!
//! In: where an operation is to go, and the slot of the program that asks. Out: nothing, or why
//! not. The bootloader is never written, and of the running slot only the marks in its header,
//! which show whether it is on trial: whatever goes wrong above, a program does not take away its
//! own ground.

use embedded_storage::nor_flash::{NorFlashError, NorFlashErrorKind};
use flash::layout::{HEADER, Layout, Region};
use flash::slots::MARKS;

/// Why the flash did not do what was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NorError {
    /// Offset or length is no whole half-word or page.
    Alignment,
    /// Beyond the flash.
    Bounds,
    /// It is the bootloader's, or the running program's.
    Forbidden,
    /// The half-word was not blank (PGERR).
    NotBlank,
    /// The page is write-protected (WRPRTERR), or the controller refused its keys.
    Protected,
    /// The operation has not ended (BSY), or not with EOP.
    Stuck,
    /// The bootloader lends nothing to erase with, or what it lends has refused.
    Eraser,
}

impl NorFlashError for NorError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Alignment => NorFlashErrorKind::NotAligned,
            Self::Bounds => NorFlashErrorKind::OutOfBounds,
            Self::Forbidden | Self::NotBlank | Self::Protected | Self::Stuck | Self::Eraser => {
                NorFlashErrorKind::Other
            }
        }
    }
}

/// Whether `length` bytes from `offset` on are in the flash, in whole steps of `step`.
///
/// Errors: [`NorError::Alignment`], [`NorError::Bounds`].
pub fn inside(layout: &Layout, offset: u32, length: usize, step: u32) -> Result<u32, NorError> {
    let length = u32::try_from(length).map_err(|_| NorError::Bounds)?;
    if !offset.is_multiple_of(step) || !length.is_multiple_of(step) {
        return Err(NorError::Alignment);
    }
    let end = offset.checked_add(length).ok_or(NorError::Bounds)?;
    if end > layout.flash {
        return Err(NorError::Bounds);
    }
    Ok(end)
}

/// Whether a page of the chip begins at `offset` that belongs to the records: the only one that a
/// bootloader erases for whoever calls it.
pub fn is_of_records(layout: &Layout, offset: u32) -> bool {
    let page = layout.chip_page;
    let end = inside(layout, offset, page as usize, page);
    end.is_ok_and(|end| offset >= layout.records.start && end <= layout.records.end())
}

/// Which flash is whose.
#[derive(Clone, Copy, Debug)]
pub struct Guard {
    /// The map.
    pub layout: &'static Layout,
    /// The slot that the program runs in; `None` for the bootloader.
    pub running: Option<Region>,
}

impl Guard {
    /// Whether `length` bytes from `offset` on may be programmed.
    ///
    /// Errors: those of [`inside`], and [`NorError::Forbidden`].
    pub fn program(&self, offset: u32, length: usize) -> Result<(), NorError> {
        let end = inside(self.layout, offset, length, 2)?;
        let marks = |slot: Region| {
            let first = slot.start.saturating_add(MARKS);
            offset >= first && end <= slot.start.saturating_add(HEADER)
        };
        self.free(offset, end, marks)
    }

    /// Whether the pages of `page` bytes from `from` to `to` may be erased.
    ///
    /// Errors: those of [`inside`], and [`NorError::Forbidden`].
    pub fn erase(&self, from: u32, to: u32, page: u32) -> Result<(), NorError> {
        let length = to.checked_sub(from).ok_or(NorError::Bounds)?;
        let end = inside(self.layout, from, length as usize, page)?;
        self.free(from, end, |_| false)
    }

    fn free(&self, offset: u32, end: u32, but: impl Fn(Region) -> bool) -> Result<(), NorError> {
        let is_boots = offset < self.layout.boot.end();
        let overlaps = |slot: Region| offset < slot.end() && end > slot.start && !but(slot);
        if is_boots || self.running.is_some_and(overlaps) {
            return Err(NorError::Forbidden);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use flash::layout::{C8, PAGE, RC};

    use super::*;

    const APP: Guard = Guard {
        layout: &RC,
        running: Some(RC.a),
    };

    #[test]
    fn nobody_writes_the_bootloader_or_the_running_program() {
        let boot = Guard {
            running: None,
            ..APP
        };
        let (a, page) = (RC.a, PAGE as usize);
        for guard in [boot, APP] {
            for offset in [0, RC.boot.end() - PAGE] {
                assert_eq!(guard.program(offset, page), Err(NorError::Forbidden));
                let erased = guard.erase(offset, offset + 2 * PAGE, PAGE);
                assert_eq!(erased, Err(NorError::Forbidden));
            }
        }
        for offset in [a.start, a.start + HEADER, a.end() - 2] {
            assert_eq!(APP.program(offset, 2), Err(NorError::Forbidden));
            assert_eq!(boot.program(offset, 2), Ok(()));
        }
        assert_eq!(APP.erase(a.start, a.end(), PAGE), Err(NorError::Forbidden));
        let last = a.end() - PAGE;
        assert_eq!(
            APP.erase(last, a.end() + PAGE, PAGE),
            Err(NorError::Forbidden)
        );
    }

    #[test]
    fn the_marks_of_the_running_slot_the_other_slot_and_the_records_are_free() {
        let b = RC.b.unwrap();
        let marks = RC.a.start + MARKS;
        assert_eq!(APP.program(marks, (HEADER - MARKS) as usize), Ok(()));
        assert_eq!(APP.program(marks - 2, 2), Err(NorError::Forbidden));
        assert_eq!(
            APP.program(RC.a.start + HEADER - 2, 4),
            Err(NorError::Forbidden)
        );
        assert_eq!(APP.erase(b.start, b.end(), PAGE), Ok(()));
        assert_eq!(APP.erase(RC.records.start, RC.flash, PAGE), Ok(()));
        assert_eq!(APP.program(RC.flash - 2, 2), Ok(()));
    }

    #[test]
    fn what_a_bootloader_erases_for_others_is_a_page_of_records() {
        for layout in [C8, RC] {
            let page = layout.chip_page as usize;
            let whole = (0..u32::MAX - PAGE).step_by(page / 4);
            let erased = whole.filter(|offset| is_of_records(&layout, *offset));
            let records = layout.records.start..layout.records.end();
            assert!(erased.eq(records.step_by(page)));
            assert!(!is_of_records(&layout, u32::MAX));
        }
    }

    #[test]
    fn what_is_not_whole_or_not_in_the_flash_is_refused() {
        let at = RC.records.start;
        assert_eq!(APP.program(at + 1, 2), Err(NorError::Alignment));
        assert_eq!(APP.program(at, 3), Err(NorError::Alignment));
        assert_eq!(APP.erase(at, at + PAGE / 2, PAGE), Err(NorError::Alignment));
        assert_eq!(APP.erase(at + PAGE, at, PAGE), Err(NorError::Bounds));
        assert_eq!(APP.program(RC.flash - 2, 4), Err(NorError::Bounds));
        assert_eq!(inside(&RC, u32::MAX, 2, 1), Err(NorError::Bounds));
        assert_eq!(inside(&RC, 0, RC.flash as usize, 1), Ok(RC.flash));
    }
}
