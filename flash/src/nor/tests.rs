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
    nor.erase(0, PAGE).unwrap();
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
    assert_eq!(nor.write(2 * PAGE, &[0, 0]), Err(NorError::OutOfBounds));
    assert_eq!(nor.erase(0, PAGE / 2), Err(NorError::NotAligned));
    assert_eq!(nor.erase(PAGE, 0), Err(NorError::OutOfBounds));
    assert_eq!(
        nor.read(2 * PAGE - 1, &mut [0; 2]),
        Err(NorError::OutOfBounds)
    );
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

/// A page of zeros between others, after its erase was cut.
fn torn_page(seed: u64) -> Bench {
    let mut nor = bench(2, seed);
    nor.write(0, &[0; PAGE as usize]).unwrap();
    nor.write(PAGE, &[7; PAGE as usize]).unwrap();
    nor.cut_after(0);
    assert_eq!(nor.erase(0, PAGE), Err(NorError::NoPower));
    nor.power_up();
    nor
}

fn page(nor: &mut Bench) -> [u8; PAGE as usize] {
    let mut bytes = [0; PAGE as usize];
    nor.read(0, &mut bytes).unwrap();
    bytes
}

#[test]
fn a_cut_erase_reads_differently_each_time_and_takes_no_program() {
    let (mut unlike, mut untouched, mut blank, mut half) = (0, 0, 0, 0);
    for seed in 0..200 {
        let mut nor = torn_page(seed);
        let pair = [page(&mut nor), page(&mut nor)];
        let alike = pair[0] == pair[1];
        let mixed = pair[0].contains(&0) && pair[0].contains(&0xFF);
        unlike += u32::from(!alike);
        untouched += u32::from(pair[0] == [0; PAGE as usize]);
        blank += u32::from(pair[0] == [0xFF; PAGE as usize]);
        half += u32::from(alike && mixed);
        assert_eq!(held(&mut nor, PAGE), [7, 7]);
        // Whatever either half looks like, it takes nothing.
        for at in [0, PAGE / 2, PAGE - 2] {
            assert_eq!(nor.write(at, &[0, 0]), Err(NorError::NotErased));
        }
        nor.erase(0, PAGE).unwrap();
        nor.write(0, &[1, 0]).unwrap();
        assert_eq!(nor.pages()[0].erases(), 2);
    }
    // A tenth of the pages looks untouched, another blank, and a third is half erased.
    assert_eq!(unlike + untouched + blank + half, 200);
    assert!(
        unlike > 60 && untouched > 10 && blank > 10 && half > 40,
        "{unlike} {untouched} {blank} {half}"
    );
}

#[test]
fn an_erase_is_cut_in_either_half_and_between_the_two() {
    let mut seen = [[0; 3]; 2];
    for seed in 0..200 {
        let mut nor = torn_page(seed);
        let pair = [page(&mut nor), page(&mut nor)];
        let state = |range: std::ops::Range<usize>| {
            let (first, second) = (&pair[0][range.clone()], &pair[1][range]);
            match first {
                _ if first != second => 1,
                _ if first.iter().all(|byte| *byte == 0) => 0,
                _ if first.iter().all(|byte| *byte == 0xFF) => 2,
                _ => panic!("seed {seed}"),
            }
        };
        match (state(0..HALF), state(HALF..PAGE as usize)) {
            // The second half is not begun before the first is done, or both are one.
            (0, after) => assert_eq!(after, 0),
            (1, after) => seen[0][after] += 1,
            (_, after) => seen[1][after] += 1,
        }
    }
    // Torn and untouched, torn both, never torn and blank; blank, and all three behind it.
    let [[begun, both, never], done] = seen;
    assert_eq!(never, 0);
    assert!(begun > 10 && both > 10, "{seen:?}");
    assert!(done.iter().all(|count| *count > 10), "{seen:?}");
}

#[test]
fn a_page_of_1_kb_is_erased_alone_and_its_cut_leaves_the_other_alone() {
    for seed in 0..50 {
        let mut nor = bench(1, seed);
        nor.write(0, &[0; PAGE as usize]).unwrap();
        nor.erase_half(HALF_PAGE).unwrap();
        let [low, high] = [held(&mut nor, HALF_PAGE - 2), held(&mut nor, HALF_PAGE)];
        assert_eq!((low, high), ([0, 0], [0xFF, 0xFF]));
        assert_eq!(nor.write(HALF_PAGE, &[1, 2]), Ok(()));
        nor.cut_after(0);
        assert_eq!(nor.erase_half(0), Err(NorError::NoPower));
        nor.power_up();
        assert_eq!(nor.write(0, &[0, 0]), Err(NorError::NotErased));
        assert_eq!(nor.write(HALF_PAGE + 2, &[3, 4]), Ok(()));
        assert_eq!(held(&mut nor, HALF_PAGE), [1, 2]);
        nor.erase_half(0).unwrap();
        assert_eq!(nor.write(0, &[1, 0]), Ok(()));
        assert_eq!(nor.pages()[0].erases(), 2);
        assert_eq!(nor.erase_half(2), Err(NorError::NotAligned));
    }
}

#[test]
fn a_worn_page_keeps_a_bit() {
    let mut nor = bench(1, 3);
    nor.set_endurance(2);
    nor.erase(0, PAGE).unwrap();
    nor.erase(0, PAGE).unwrap();
    assert_eq!(held(&mut nor, 0), [0xFF, 0xFF]);
    nor.erase(0, PAGE).unwrap();
    assert_eq!(held(&mut nor, 0), [0xFE, 0xFF]);
    nor.flip(1, 0x80);
    assert_eq!(held(&mut nor, 0), [0xFE, 0x7F]);
}
