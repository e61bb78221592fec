//! A NOR flash stricter than the chip: for tests and for the simulation, never on the part.
//!
//! In: programs and erases through `embedded_storage`'s traits, the operation at which the supply
//! fails, and random words from the caller. Out: the bytes, or an error for what the chip would
//! refuse or would let pass unsaid.
//!
//! - One operation is one half-word programmed or one page erased.
//! - A half-word is programmed once after its page was erased. A second time only 0000h is taken
//!   (PM0075 2.3.3), and [`Nor::set_once_only`] refuses that too. Programming FFFFh counts.
//! - A program that is cut leaves any of its bits done, the others not.
//! - An erase that is cut leaves none, few, half, most or all of the page's bits done, and from
//!   then on those that are not done read differently each time, with the same likelihood. Such a
//!   page refuses programs until it was erased whole, also one that looks blank or untouched.
//! - Where the chip's own pages are half of [`PAGE`], an erase is cut in the first half, between
//!   the two or in the second: one half then is blank or torn, the other untouched or blank. Every
//!   model draws these too, since what bears them bears the pages of all parts. Whoever has such a
//!   part's flash controller erases its own pages ([`Nor::erase_half`], [`medium`]).
//! - Wear is counted per page; behind the endurance a page keeps a bit that does not erase.
//! - Whatever was broken is counted, so that a test sees it even where the code under test hides
//!   the error.
//!
//! Left out: time, and the bus of the chip.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

use crate::layout::{HALF_PAGE, PAGE};

/// Half-words of a page.
const HALF_WORDS: usize = PAGE as usize / 2;

/// Bytes of half a page: a page of the medium-density parts (RM0008 table 5).
const HALF: usize = HALF_PAGE as usize;

/// Erases that the data sheets promise for a page (STM32F103x8/xB and xC/xD/xE, 5.3.9).
pub const ENDURANCE: u32 = 10_000;

/// Where random words come from: the caller's seeded generator.
pub trait Draw {
    /// The next 32 random bits.
    fn draw(&mut self) -> u32;
}

/// One page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Page {
    bytes: [u8; PAGE as usize],
    programmed: [bool; HALF_WORDS],
    /// Of each half.
    erases: [u32; 2],
    /// How far the last erase of each half came, if that was cut.
    torn: [Option<Torn>; 2],
}

/// How many bits an erase has done when it was cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Torn {
    None,
    Few,
    Half,
    Most,
    All,
}

impl Torn {
    /// Any of them.
    fn any(draw: &mut impl Draw) -> Self {
        match draw.draw() % 5 {
            0 => Self::None,
            1 => Self::Few,
            2 => Self::Half,
            3 => Self::Most,
            _ => Self::All,
        }
    }

    /// Both halves of a page, whose erase is one operation of the chip or two.
    fn halves(draw: &mut impl Draw) -> [Self; 2] {
        let any = Self::any(draw);
        match draw.draw() % 4 {
            0 => [any, any],
            1 => [any, Self::None],
            2 => [Self::All, Self::None],
            _ => [Self::All, any],
        }
    }

    /// 32 bits of which as many are 1: an eighth are few, seven eighths most.
    fn bits(self, draw: &mut impl Draw) -> u32 {
        let [a, b, c] = [draw.draw(), draw.draw(), draw.draw()];
        match self {
            Self::None => 0,
            Self::Few => a & b & c,
            Self::Half => a,
            Self::Most => a | b | c,
            Self::All => u32::MAX,
        }
    }
}

impl Default for Page {
    fn default() -> Self {
        Self::new()
    }
}

impl Page {
    /// As it comes from the factory: erased, no wear.
    pub const fn new() -> Self {
        Self {
            bytes: [u8::MAX; PAGE as usize],
            programmed: [false; HALF_WORDS],
            erases: [0; 2],
            torn: [None; 2],
        }
    }

    /// How far the last erase of the half came in which the byte at `place` lies, if it was cut.
    const fn torn_at(&self, place: usize) -> Option<Torn> {
        let [first, second] = self.torn;
        if place < HALF { first } else { second }
    }

    /// The half of this number was erased, or as much of that as `cut` sets.
    fn erase_half(&mut self, half: usize, cut: Option<Torn>, draw: &mut impl Draw) {
        let bytes = self.bytes.chunks_mut(HALF).nth(half).unwrap_or_default();
        match cut {
            None => bytes.fill(u8::MAX),
            Some(torn) => bytes.chunks_mut(4).for_each(|bytes| {
                let done = torn.bits(draw).to_le_bytes();
                bytes
                    .iter_mut()
                    .zip(done)
                    .for_each(|(byte, done)| *byte |= done);
            }),
        }
        if cut.is_none()
            && let Some(programmed) = self.programmed.chunks_mut(HALF / 2).nth(half)
        {
            programmed.fill(false);
        }
        if let Some(held) = self.torn.get_mut(half) {
            *held = cut;
        }
    }

    /// Whether the half-word at offset `at` reads FFFFh.
    fn reads_blank(&self, at: usize) -> bool {
        let half_word = self.bytes.get(at..at.saturating_add(2));
        half_word.is_some_and(|bytes| bytes == [u8::MAX; 2])
    }

    /// How often it was erased: of its halves the one that was more often.
    pub const fn erases(&self) -> u32 {
        let [first, second] = self.erases;
        if first < second { second } else { first }
    }

    /// What it holds; of a page whose erase was cut, one of the things that it may read as.
    pub const fn bytes(&self) -> &[u8; PAGE as usize] {
        &self.bytes
    }
}

/// What the model refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NorError {
    /// Not whole half-words, or not whole pages.
    NotAligned,
    /// Beyond the end.
    OutOfBounds,
    /// A half-word was programmed before, and its page not erased since.
    Overwrite,
    /// The last erase of the page was cut.
    NotErased,
    /// The supply has failed: nothing happens until [`Nor::power_up`].
    NoPower,
}

impl NorFlashError for NorError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NotAligned => NorFlashErrorKind::NotAligned,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            Self::Overwrite | Self::NotErased | Self::NoPower => NorFlashErrorKind::Other,
        }
    }
}

/// A flash of as many pages as `P` has, an array or a vector, with random words from `D`.
#[derive(Clone, Debug)]
pub struct Nor<P, D> {
    pages: P,
    draw: D,
    operations: u64,
    cut: Option<u64>,
    powered: bool,
    once_only: bool,
    endurance: u32,
    broken_rules: u32,
}

impl<P: AsRef<[Page]> + AsMut<[Page]>, D: Draw> Nor<P, D> {
    /// A flash with `pages`, powered.
    pub fn new(pages: P, draw: D) -> Self {
        Self {
            pages,
            draw,
            operations: 0,
            cut: None,
            powered: true,
            once_only: false,
            endurance: ENDURANCE,
            broken_rules: 0,
        }
    }

    /// Programs and erases since it was made, also those that were cut.
    pub const fn operations(&self) -> u64 {
        self.operations
    }

    /// How often something was asked that the chip's rules forbid.
    pub const fn broken_rules(&self) -> u32 {
        self.broken_rules
    }

    /// Its pages.
    pub fn pages(&self) -> &[Page] {
        self.pages.as_ref()
    }

    /// Fails the supply in the middle of the operation that follows `after` more.
    pub fn cut_after(&mut self, after: u64) {
        self.cut = Some(self.operations.saturating_add(after));
    }

    /// Whether the supply has failed.
    pub const fn is_cut(&self) -> bool {
        !self.powered
    }

    /// The supply is back, and no cut is ahead.
    pub fn power_up(&mut self) {
        self.powered = true;
        self.cut = None;
    }

    /// Whether a half-word that was programmed refuses 0000h as well; at first it takes that.
    pub fn set_once_only(&mut self, once_only: bool) {
        self.once_only = once_only;
    }

    /// Takes random words from another generator from now on.
    pub fn set_draw(&mut self, draw: D) {
        self.draw = draw;
    }

    /// After so many erases a page keeps a bit that does not erase.
    pub fn set_endurance(&mut self, erases: u32) {
        self.endurance = erases;
    }

    /// Flips the bits of `mask` in the byte at offset `at`, as a bad cell does.
    pub fn flip(&mut self, at: u32, mask: u8) {
        let page = self.pages.as_mut().get_mut((at / PAGE) as usize);
        if let Some(byte) = page.and_then(|page| page.bytes.get_mut((at % PAGE) as usize)) {
            *byte ^= mask;
        }
    }

    /// Refuses what breaks a rule, and counts it.
    fn broken<T>(&mut self, error: NorError) -> Result<T, NorError> {
        self.broken_rules = self.broken_rules.saturating_add(1);
        Err(error)
    }

    /// Checks supply, bounds and alignment to `size`.
    fn admit(&mut self, at: u32, length: usize, size: u32) -> Result<(), NorError> {
        if !self.powered {
            return Err(NorError::NoPower);
        }
        let length = u32::try_from(length).unwrap_or(u32::MAX);
        let end = u64::from(at).saturating_add(u64::from(length));
        if end > self.capacity() as u64 {
            return self.broken(NorError::OutOfBounds);
        }
        if !at.is_multiple_of(size) || !length.is_multiple_of(size) {
            return self.broken(NorError::NotAligned);
        }
        Ok(())
    }

    /// Counts an operation; whether the supply fails in it.
    fn fails_now(&mut self) -> bool {
        let now = self.operations;
        self.operations = now.saturating_add(1);
        if self.cut.is_some_and(|cut| now >= cut) {
            self.powered = false;
        }
        !self.powered
    }

    fn program_half_word(&mut self, at: u32, new: [u8; 2]) -> Result<(), NorError> {
        let (number, place) = ((at / PAGE) as usize, (at % PAGE) as usize);
        let once_only = self.once_only;
        let Some(page) = self.pages.as_ref().get(number) else {
            return self.broken(NorError::OutOfBounds);
        };
        if page.torn_at(place).is_some() {
            return self.broken(NorError::NotErased);
        }
        let programmed = page.programmed.get(place / 2) != Some(&false);
        let blank = page.reads_blank(place);
        if (programmed || !blank) && (once_only || new != [0; 2]) {
            return self.broken(NorError::Overwrite);
        }
        let cut = self.fails_now();
        let [left_low, left_high, ..] = match cut {
            true => self.draw.draw().to_le_bytes(),
            false => [0; 4],
        };
        let Some(page) = self.pages.as_mut().get_mut(number) else {
            return Err(NorError::OutOfBounds);
        };
        if let Some([low, high]) = page.bytes.get_mut(place..place + 2) {
            *low &= new[0] | left_low;
            *high &= new[1] | left_high;
        }
        // The chip looks at the value: what still reads FFFFh it programs again.
        let blank = page.reads_blank(place);
        if let Some(programmed) = page.programmed.get_mut(place / 2) {
            *programmed = !(cut && blank);
        }
        if cut { Err(NorError::NoPower) } else { Ok(()) }
    }

    fn read_page(&mut self, number: usize, at: usize, into: &mut [u8]) -> Result<(), NorError> {
        let page = self.pages.as_ref().get(number);
        let held = page.and_then(|page| page.bytes.get(at..)?.get(..into.len()));
        let (Some(page), Some(held)) = (page, held) else {
            return Err(NorError::OutOfBounds);
        };
        into.iter_mut()
            .zip(held)
            .for_each(|(byte, held)| *byte = *held);
        for (place, byte) in (at..).zip(into) {
            // The cells of a torn half stand between 0 and 1.
            if let Some(torn) = page.torn_at(place) {
                *byte |= torn.bits(&mut self.draw) as u8;
            }
        }
        Ok(())
    }

    fn erase_page(&mut self, number: usize) -> Result<(), NorError> {
        let cut = self.fails_now();
        let torn = cut.then(|| Torn::halves(&mut self.draw));
        let [first, second] = match torn {
            Some([first, second]) => [Some(first), Some(second)],
            None => [None; 2],
        };
        self.wear(number, [(0, first), (1, second)])
    }

    /// Erases one page of a part whose pages are half of a [`PAGE`]: one operation.
    ///
    /// Errors: those of an erase.
    pub fn erase_half(&mut self, offset: u32) -> Result<(), NorError> {
        self.admit(offset, HALF, HALF_PAGE)?;
        let cut = self.fails_now();
        let torn = cut.then(|| Torn::any(&mut self.draw));
        let half = (offset % PAGE / HALF_PAGE) as usize;
        self.wear((offset / PAGE) as usize, [(half, torn)])
    }

    /// Erases these halves of a page, each as far as it came if that was cut.
    fn wear<const N: usize>(
        &mut self,
        number: usize,
        halves: [(usize, Option<Torn>); N],
    ) -> Result<(), NorError> {
        let endurance = self.endurance;
        let Some(page) = self.pages.as_mut().get_mut(number) else {
            return Err(NorError::OutOfBounds);
        };
        for (half, cut) in halves {
            page.erase_half(half, cut, &mut self.draw);
            let Some(erases) = page.erases.get_mut(half) else {
                return Err(NorError::OutOfBounds);
            };
            *erases = erases.saturating_add(1);
            if *erases > endurance
                && cut.is_none()
                && let Some(byte) = page.bytes.get_mut(half * HALF)
            {
                *byte = 0xFE;
            }
        }
        match self.powered {
            true => Ok(()),
            false => Err(NorError::NoPower),
        }
    }
}

impl<P, D> ErrorType for Nor<P, D> {
    type Error = NorError;
}

impl<P: AsRef<[Page]> + AsMut<[Page]>, D: Draw> ReadNorFlash for Nor<P, D> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorError> {
        self.admit(offset, bytes.len(), 1)?;
        let mut at = offset;
        let mut rest = bytes;
        while !rest.is_empty() {
            let place = (at % PAGE) as usize;
            let size = rest.len().min(PAGE as usize - place);
            let (now, later) = rest.split_at_mut_checked(size).unwrap_or_default();
            self.read_page((at / PAGE) as usize, place, now)?;
            at = at.saturating_add(size as u32);
            rest = later;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.pages.as_ref().len().saturating_mul(PAGE as usize)
    }
}

impl<P: AsRef<[Page]> + AsMut<[Page]>, D: Draw> NorFlash for Nor<P, D> {
    const WRITE_SIZE: usize = 2;
    const ERASE_SIZE: usize = PAGE as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorError> {
        let Some(length) = to.checked_sub(from) else {
            return self.broken(NorError::OutOfBounds);
        };
        self.admit(from, length as usize, PAGE)?;
        for number in from / PAGE..to / PAGE {
            self.erase_page(number as usize)?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorError> {
        self.admit(offset, bytes.len(), 2)?;
        let (half_words, _) = bytes.as_chunks::<2>();
        for (number, half_word) in (0..).zip(half_words) {
            self.program_half_word(offset.saturating_add(2 * number), *half_word)?;
        }
        Ok(())
    }
}

pub mod medium;

#[cfg(test)]
pub(crate) mod tests;
