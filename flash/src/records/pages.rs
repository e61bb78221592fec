//! A ring of pages: which page follows which, and which of them are ready for use.
//!
//! In: a region. Out: pages by their sequence number. The page with number n lies at n modulo the
//! number of pages, so the number gives both order and place, and all pages wear alike.
//!
//! A page is ready once it was erased to the end and its header was written. One that only looks
//! blank isn't: its erase may have been cut. Before an erase the page is retired, so that no
//! header outlives the start of an erase.
//!
//! # Header, 16 bytes
//! Numbers are little-endian.
//!
//! | byte | content |
//! |---|---|
//! | 0 to 3 | what the ring is for |
//! | 4 to 7 | sequence number, below 2^31 |
//! | 8 to 11 | CRC-32 of bytes 0 to 7 |
//! | 12 to 15 | FFFFFFFFh; 0: retired |
//!
//! Left out: what is in a page behind its header.

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::access::{AccessError, erase, is_blank, program, read};
use crate::check_sum::Crc32;
use crate::layout::{PAGE, Region};

/// Bytes of a page's header.
pub(crate) const HEAD: u32 = 16;

/// Sequence numbers end here, long after the flash has worn out.
const LAST: u32 = 1 << 31;

/// A ring of pages.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pages {
    start: u32,
    /// Number of pages, one at least.
    count: u32,
    mark: u32,
}

impl Pages {
    /// The ring of `region`; `mark` tells one kind of ring from another.
    pub(crate) fn new(region: Region, mark: u32) -> Self {
        Self {
            start: region.start,
            count: region.pages().max(1),
            mark,
        }
    }

    /// Number of pages.
    pub(crate) const fn count(&self) -> u32 {
        self.count
    }

    /// Offset in the flash of the page with number `sequence`.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub(crate) fn offset(&self, sequence: u32) -> u32 {
        let place = sequence.checked_rem(self.count).unwrap_or(0);
        self.start + place * PAGE
    }

    /// The header of page `sequence`, not retired.
    fn header(&self, sequence: u32) -> [u8; 12] {
        let mut bytes = [0; 12];
        let (words, _) = bytes.as_chunks_mut::<4>();
        if let [mark, number, check] = words {
            *mark = self.mark.to_le_bytes();
            *number = sequence.to_le_bytes();
            let mut crc = Crc32::new();
            crc.add(mark);
            crc.add(number);
            *check = crc.value().to_le_bytes();
        }
        bytes
    }

    /// The number of the page at `place` in the ring, if it is ready or in use.
    fn number<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        place: u32,
    ) -> Result<Option<u32>, AccessError> {
        let mut bytes = [0; HEAD as usize];
        read(flash, self.offset(place), &mut bytes)?;
        let (words, _) = bytes.as_chunks::<4>();
        let [_, number, _, retired] = words else {
            return Ok(None);
        };
        let number = u32::from_le_bytes(*number);
        let whole = *retired == [u8::MAX; 4] && bytes.starts_with(&self.header(number));
        let in_place = number < LAST && number.checked_rem(self.count) == Some(place);
        Ok((whole && in_place).then_some(number))
    }

    /// Whether the page with number `sequence` is ready or in use.
    pub(crate) fn has<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        sequence: u32,
    ) -> Result<bool, AccessError> {
        let place = sequence.checked_rem(self.count).unwrap_or(0);
        Ok(self.number(flash, place)? == Some(sequence))
    }

    /// The highest number of any page.
    pub(crate) fn newest<F: ReadNorFlash>(
        &self,
        flash: &mut F,
    ) -> Result<Option<u32>, AccessError> {
        let mut newest = None;
        for place in 0..self.count {
            newest = newest.max(self.number(flash, place)?);
        }
        Ok(newest)
    }

    /// Whether nothing is in page `sequence` from offset `at` in the page on.
    pub(crate) fn is_blank<F: ReadNorFlash>(
        &self,
        flash: &mut F,
        sequence: u32,
        at: u32,
    ) -> Result<bool, AccessError> {
        let from = self.offset(sequence) + at;
        is_blank(flash, from, PAGE.saturating_sub(at))
    }

    /// Makes the page for `sequence` ready: one erase, unless it is ready already.
    ///
    /// What was in it is gone.
    pub(crate) fn renew<F: NorFlash>(
        &self,
        flash: &mut F,
        sequence: u32,
    ) -> Result<(), AccessError> {
        if self.has(flash, sequence)? && self.is_blank(flash, sequence, HEAD)? {
            return Ok(());
        }
        let offset = self.offset(sequence);
        let place = sequence.checked_rem(self.count).unwrap_or(0);
        // Where no header is whole there is nothing to retire, or the last erase was cut; what
        // such a page reads as shows nothing about what may be programmed.
        if self.number(flash, place)?.is_some() {
            program(flash, offset + 12, &[0; 4])?;
        }
        erase(flash, offset)?;
        program(flash, offset, &self.header(sequence))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nor::tests::bench;

    const MARK: u32 = 0x1234_5678;

    #[test]
    fn a_page_whose_erase_was_cut_has_no_header_and_is_erased_before_it_is_programmed() {
        let region = Region {
            start: 0,
            length: 4 * PAGE,
        };
        let pages = Pages::new(region, MARK);
        for (seed, cut) in (0..400).flat_map(|seed| (0..8).map(move |cut| (seed, cut))) {
            let mut nor = bench(4, seed);
            pages.renew(&mut nor, 5).unwrap();
            program(&mut nor, PAGE + 100, &[1; 20]).unwrap();
            nor.cut_after(cut);
            assert!(pages.renew(&mut nor, 9).is_err());
            nor.power_up();
            // From the start of the erase on, the old header is gone, however far that came.
            let begun = nor.pages()[1].erases() > 1;
            assert!(!(begun && pages.has(&mut nor, 5).unwrap()));
            pages.renew(&mut nor, 9).unwrap();
            assert!(pages.has(&mut nor, 9).unwrap());
            assert_eq!(nor.broken_rules(), 0);
        }
    }

    #[test]
    fn a_page_counts_in_its_own_place_and_for_its_own_ring_only() {
        let region = Region {
            start: PAGE,
            length: 3 * PAGE,
        };
        let pages = Pages::new(region, MARK);
        let mut nor = bench(4, 1);
        pages.renew(&mut nor, 7).unwrap();
        assert_eq!(pages.newest(&mut nor), Ok(Some(7)));
        // A number that belongs elsewhere, and one from another ring.
        program(&mut nor, PAGE, &pages.header(4)).unwrap();
        assert_eq!(pages.newest(&mut nor), Ok(Some(7)));
        assert_eq!(Pages::new(region, MARK + 1).newest(&mut nor), Ok(None));
    }
}
