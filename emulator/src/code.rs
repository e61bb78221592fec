//! How many instructions a block of code has.
//!
//! In: the bytes of a block of Thumb code (ARMv7-M A5.1). Out: the count, and whether there is an
//! SEV among them; remembered by address, since blocks run often and change seldom.
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
const SEV: u16 = 0xBF40;

/// The engine ends a block after 512 instructions: so many half-words at most.
const LONGEST: u32 = 2 * 512;

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

/// The blocks of the code in flash.
#[derive(Clone, Debug)]
pub struct Code {
    /// The block that begins at each half-word; see [`pack`]. Small, since every block looks here.
    blocks: Vec<u16>,
    /// How many instructions have run in each; empty until that is asked for.
    runs: Vec<u64>,
}

/// Half-words and instructions of a block in one word; 0 for one that is not kept: it is long, or
/// has an event to send.
fn pack(size: u32, block: Block) -> u16 {
    let fits = size < 2 << 8 && block.instructions < 1 << 8 && !block.sends_event;
    u16::from(fits) * ((size / 2) << 8 | block.instructions) as u16
}

impl Code {
    /// Nothing known yet of a flash of `size` bytes.
    pub fn new(size: u32) -> Self {
        Self {
            blocks: vec![0; size as usize / 2],
            runs: Vec::new(),
        }
    }

    /// The instructions of a block that is about to run; 0 when it is not known.
    #[inline]
    pub fn run(&mut self, address: u32, size: u32) -> u32 {
        let place = place(address);
        let instructions = match self.blocks.get(place) {
            Some(packed) if u32::from(packed >> 8) == size / 2 => u32::from(packed & 0xFF),
            _ => return 0,
        };
        if let Some(runs) = self.runs.get_mut(place) {
            *runs = runs.wrapping_add(instructions.into());
        }
        instructions
    }

    /// Remembers a block, if it is in flash, which is about to run.
    pub fn learn(&mut self, address: u32, size: u32, block: Block) {
        let place = place(address);
        if let Some(packed) = self.blocks.get_mut(place) {
            *packed = pack(size, block);
        }
        if let Some(runs) = self.runs.get_mut(place) {
            *runs += u64::from(block.instructions);
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
        self.runs = vec![0; self.blocks.len()];
    }

    /// So many bytes of the flash have changed, from this offset on.
    pub fn forget(&mut self, offset: u32, length: usize) {
        // A block before them may reach into them.
        let from = (offset / 2).saturating_sub(LONGEST) as usize;
        let to = offset.div_ceil(2) as usize + length.div_ceil(2);
        let to = to.min(self.blocks.len());
        if let Some(blocks) = self.blocks.get_mut(from..to) {
            blocks.fill(0);
        }
    }
}

fn place(address: u32) -> usize {
    (address.wrapping_sub(BASE) / 2) as usize
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
    fn a_block_is_known_by_address_and_size() {
        let mut code = Code::new(1024);
        let block = Block::of(&[0, 0xBF]);
        code.learn(BASE + 8, 2, block);
        assert_eq!(code.run(BASE + 8, 2), 1);
        assert_eq!(code.run(BASE + 8, 4), 0);
        code.forget(16, 1000);
        assert_eq!(code.run(BASE + 8, 2), 0);
        code.learn(BASE + 8, 2, block);
        code.forget(0, 8);
        assert_eq!(code.run(BASE + 8, 2), 1);
        code.forget(8, 1);
        assert_eq!(code.run(BASE + 8, 2), 0);
        code.learn(0x2000_0000, 2, block);
        assert_eq!(code.run(0x2000_0000, 2), 0);
        // Of 512 half-words, the low bits of which are none.
        code.learn(BASE, 1024, Block::of(&[0, 0xBF]));
        assert_eq!(code.run(BASE, 1024), 0);
    }
}
