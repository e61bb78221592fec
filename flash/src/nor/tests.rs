//! The model's own rules, and the flash that the other tests use.

use std::vec;
use std::vec::Vec;

use super::*;

/// Random words from a seed: xorshift, which is enough to leave bits half done.
#[derive(Clone, Debug)]
pub(crate) struct Seeded(u64);

impl Seeded {
    /// The generator of `seed`.
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// A number below `end`.
    pub(crate) fn below(&mut self, end: u32) -> u32 {
        ((u64::from(self.draw()) * u64::from(end)) >> 32) as u32
    }
}

impl Draw for Seeded {
    fn draw(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32) as u32
    }
}

/// The flash that the tests use.
pub(crate) type Bench = Nor<Vec<Page>, Seeded>;

impl Bench {
    /// Draws from another seed from now on.
    pub(crate) fn reseed(&mut self, seed: u64) {
        self.draw = Seeded::new(seed);
    }
}

/// A flash of `pages` that takes every half-word once only.
pub(crate) fn bench(pages: u32, seed: u64) -> Bench {
    let mut nor = Nor::new(vec![Page::new(); pages as usize], Seeded::new(seed));
    nor.set_once_only(true);
    nor
}

fn held(nor: &mut Bench, at: u32) -> [u8; 2] {
    let mut bytes = [0; 2];
    nor.read(at, &mut bytes).unwrap();
    bytes
}

#[test]
fn a_half_word_is_programmed_once_and_then_only_to_zero() {
    let mut nor = bench(2, 1);
    nor.set_once_only(false);
    nor.write(4, &[0x34, 0x12]).unwrap();
    assert_eq!(nor.write(4, &[0x30, 0x12]), Err(NorError::Overwrite));
    assert_eq!(nor.broken_rules(), 1);
    nor.write(4, &[0, 0]).unwrap();
    nor.erase(0, 1024).unwrap();
    nor.write(4, &[0xFF, 0xFF]).unwrap();
    assert_eq!(nor.write(4, &[1, 1]), Err(NorError::Overwrite));
    nor.set_once_only(true);
    assert_eq!(nor.write(4, &[0, 0]), Err(NorError::Overwrite));
}

#[test]
fn half_words_and_pages_only() {
    let mut nor = bench(2, 1);
    assert_eq!(nor.write(1, &[0, 0]), Err(NorError::NotAligned));
    assert_eq!(nor.write(0, &[0]), Err(NorError::NotAligned));
    assert_eq!(nor.write(2048, &[0, 0]), Err(NorError::OutOfBounds));
    assert_eq!(nor.erase(0, 512), Err(NorError::NotAligned));
    assert_eq!(nor.erase(1024, 0), Err(NorError::OutOfBounds));
    assert_eq!(nor.read(2047, &mut [0; 2]), Err(NorError::OutOfBounds));
    assert_eq!(nor.broken_rules(), 6);
}

#[test]
fn a_cut_program_leaves_some_of_its_bits_and_the_rest_of_the_write_undone() {
    let mut seen = Vec::new();
    for seed in 0..20 {
        let mut nor = bench(1, seed);
        nor.cut_after(1);
        assert_eq!(nor.write(0, &[1, 2, 0, 0, 5, 6]), Err(NorError::NoPower));
        assert_eq!(nor.read(0, &mut [0]), Err(NorError::NoPower));
        nor.power_up();
        assert_eq!(held(&mut nor, 0), [1, 2]);
        assert_eq!(held(&mut nor, 4), [0xFF, 0xFF]);
        seen.push(held(&mut nor, 2));
        assert_eq!(held(&mut nor, 2), seen[seed as usize]);
    }
    seen.sort_unstable();
    seen.dedup();
    assert!(seen.len() > 15, "{seen:?}");
}

#[test]
fn a_cut_erase_reads_differently_each_time_and_takes_no_program() {
    let (mut unlike, mut untouched, mut blank) = (0, 0, 0);
    for seed in 0..50 {
        let mut nor = bench(2, seed);
        nor.write(0, &[0; 1024]).unwrap();
        nor.write(1024, &[7; 1024]).unwrap();
        nor.cut_after(0);
        assert_eq!(nor.erase(0, 1024), Err(NorError::NoPower));
        nor.power_up();
        let mut pair = [[0; 1024]; 2];
        for read in &mut pair {
            nor.read(0, read).unwrap();
        }
        unlike += u32::from(pair[0] != pair[1]);
        untouched += u32::from(pair[0] == [0; 1024]);
        blank += u32::from(pair[0] == [0xFF; 1024]);
        assert_eq!(held(&mut nor, 1024), [7, 7]);
        assert_eq!(nor.write(0, &[0, 0]), Err(NorError::NotErased));
        nor.erase(0, 1024).unwrap();
        nor.write(0, &[1, 0]).unwrap();
        assert_eq!(nor.pages()[0].erases(), 2);
    }
    // A fifth of the pages looks untouched, and another blank.
    assert_eq!(unlike + untouched + blank, 50);
    assert!(
        unlike > 20 && untouched > 3 && blank > 3,
        "{unlike} {untouched} {blank}"
    );
}

#[test]
fn a_worn_page_keeps_a_bit() {
    let mut nor = bench(1, 3);
    nor.set_endurance(2);
    nor.erase(0, 1024).unwrap();
    nor.erase(0, 1024).unwrap();
    assert_eq!(held(&mut nor, 0), [0xFF, 0xFF]);
    nor.erase(0, 1024).unwrap();
    assert_eq!(held(&mut nor, 0), [0xFE, 0xFF]);
    nor.flip(1, 0x80);
    assert_eq!(held(&mut nor, 0), [0xFE, 0x7F]);
}
