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
    /// The block that begins at each half-word.
    blocks: Vec<Known>,
}

/// A block of the flash, and how often it has run; small, since every block looks here.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    runs: u64,
    /// Bytes; 0 for none.
    size: u16,
    instructions: u16,
    sends_event: bool,
}

impl Code {
    /// Nothing known yet of a flash of `size` bytes.
    pub fn new(size: u32) -> Self {
        Self {
            blocks: vec![Known::default(); size as usize / 2],
        }
    }

    /// What is known of a block, which is about to run.
    #[inline]
    pub fn known(&mut self, address: u32, size: u32) -> Option<Block> {
        let known = self.blocks.get_mut(place(address))?;
        if u32::from(known.size) != size {
            return None;
        }
        known.runs += 1;
        Some(Block {
            instructions: known.instructions.into(),
            sends_event: known.sends_event,
        })
    }

    /// Remembers a block, if it is in flash, which is about to run for the first time.
    pub fn learn(&mut self, address: u32, size: u32, block: Block) {
        if let Some(known) = self.blocks.get_mut(place(address)) {
            // A block ends with its page at the latest, so both fit.
            *known = Known {
                runs: 1,
                size: size as u16,
                instructions: block.instructions as u16,
                sends_event: block.sends_event,
            };
        }
    }

    /// Instructions that have run so far in the blocks that begin at each address of the flash.
    /// One that was cut short by a fault counts whole.
    pub fn profile(&self) -> impl Iterator<Item = (u32, u64)> {
        let run = self
            .blocks
            .iter()
            .zip(0u32..)
            .filter(|(known, _)| known.runs > 0);
        run.map(|(known, number)| {
            let instructions = known.runs * u64::from(known.instructions);
            (BASE + 2 * number, instructions)
        })
    }

    /// Lets the counts of [`Code::profile`] begin anew.
    pub fn clear_profile(&mut self) {
        self.blocks.iter_mut().for_each(|known| known.runs = 0);
    }

    /// The flash has changed.
    pub fn forget(&mut self) {
        self.blocks.fill(Known::default());
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
        assert_eq!(code.known(BASE + 8, 2), Some(block));
        assert_eq!(code.known(BASE + 8, 4), None);
        code.forget();
        assert_eq!(code.known(BASE + 8, 2), None);
        code.learn(0x2000_0000, 2, block);
        assert_eq!(code.known(0x2000_0000, 2), None);
    }
}
