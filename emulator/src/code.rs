//! How many instructions a block of code has, and how many have run where.
//!
//! In: the bytes of a block of Thumb code (ARMv7-M A5.1), and which blocks run. Out: the counts,
//! and whether there is an SEV among the instructions.
//!
//! Left out: what instructions do.

use flash::layout::BASE;

/// Wait for interrupt (ARMv7-M A7.7.262).
pub const WFI: u16 = 0xBF30;
/// Wait for event (ARMv7-M A7.7.261).
pub const WFE: u16 = 0xBF20;
/// A hint that others might run (ARMv7-M A7.7.263).
pub const YIELD: u16 = 0xBF10;
/// Send event (ARMv7-M A7.7.129).
pub const SEV: u16 = 0xBF40;

/// What is known of a block of code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Block {
    /// How many instructions it has; those that an IT block skips count.
    pub instructions: u32,
    /// It has an SEV.
    pub sends_event: bool,
}

impl Block {
    /// Counts: an instruction whose first half-word begins with 11101, 11110 or 11111 has two.
    pub fn of(bytes: &[u8]) -> Self {
        let mut block = Self::default();
        let mut half_words = bytes.as_chunks::<2>().0.iter();
        while let Some(half_word) = half_words.next() {
            let half_word = u16::from_le_bytes(*half_word);
            block.instructions += 1;
            block.sends_event |= half_word == SEV;
            if half_word >= 0xE800 {
                half_words.next();
            }
        }
        block
    }
}

/// How often code has run.
#[derive(Clone, Debug)]
pub struct Code {
    /// Bytes of the flash.
    size: u32,
    /// Instructions that have run in the block that begins at each half-word; empty until that is
    /// asked for.
    runs: Vec<u64>,
}

impl Code {
    /// Of a flash of `size` bytes.
    pub fn new(size: u32) -> Self {
        Self {
            size,
            runs: Vec::new(),
        }
    }

    /// Whether [`Code::profile`] has been asked for.
    #[inline]
    pub fn is_counted(&self) -> bool {
        !self.runs.is_empty()
    }

    /// So many instructions run in the block that begins there.
    #[inline(always)]
    pub fn ran(&mut self, address: u32, instructions: u32) {
        if let Some(runs) = self.runs.get_mut(place(address)) {
            *runs = runs.wrapping_add(instructions.into());
        }
    }

    /// Instructions that have run since [`Code::start_profile`] in the blocks that begin at each
    /// address of the flash. One that was cut short by a fault counts whole.
    pub fn profile(&self) -> impl Iterator<Item = (u32, u64)> {
        let run = self.runs.iter().zip(0u32..);
        let run = run.filter(|(instructions, _)| **instructions > 0);
        run.map(|(instructions, number)| (BASE + 2 * number, *instructions))
    }

    /// Lets [`Code::profile`] begin anew.
    pub fn start_profile(&mut self) {
        self.runs = vec![0; self.size as usize / 2];
    }
}

/// The number of a half-word in the flash; a number beyond any elsewhere, and between two of them.
#[inline(always)]
pub fn place(address: u32) -> usize {
    address.wrapping_sub(BASE).rotate_right(1) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_instructions_count_once() {
        // MOVS r0, #1; BL +0; MOVW r1, #0; NOP.
        let code = [
            0x01, 0x20, 0x00, 0xF0, 0x00, 0xF8, 0x40, 0xF2, 0x00, 0x01, 0x00, 0xBF,
        ];
        let block = Block::of(&code);
        assert_eq!((block.instructions, block.sends_event), (4, false));
        assert!(Block::of(&[0x40, 0xBF]).sends_event);
        // The second half of a long instruction may look like an SEV.
        assert!(!Block::of(&[0x00, 0xF0, 0x40, 0xBF]).sends_event);
    }

    #[test]
    fn runs_count_from_when_they_are_asked_for() {
        let mut code = Code::new(1024);
        code.ran(BASE + 8, 5);
        assert_eq!(code.profile().count(), 0);
        code.start_profile();
        code.ran(BASE + 8, 5);
        code.ran(BASE + 8, 3);
        // Code elsewhere is none of the flash.
        code.ran(0x2000_0000, 3);
        assert_eq!(code.profile().collect::<Vec<_>>(), [(BASE + 8, 8)]);
    }
}
