//! The core: a Cortex-M3 that executes the code in flash.
//!
//! In: flash and RAM, everything else through the [`Chip`]. Out: [`Stop`]. The code of a block is
//! decoded once and executed as often as it runs. Before each block the chip is told how many
//! instructions it has and may stop the core there, never inside of it; so the count of
//! instructions is exact, skipped ones of an IT block included, and an exception comes at most one
//! block late. An access of a block to the chip happens at the time of the block's end.
//!
//! `emulator/lockstep` executes the product's images on this core and on Unicorn's, and compares
//! frames, registers, memory and counts.
//!
//! Left out: code in the RAM, where a fetch ends in a fault; the traps that CCR can switch on, for
//! a division by 0 and for every access that is not aligned (PM0056 4.4.7); and cycles, one
//! instruction counts as one.

mod arithmetic;
mod decode;
mod execute;
mod memory;
mod op;
mod registers;

use flash::layout::BASE;

use crate::chip::Chip;
use crate::code::Block;
use crate::cpu::{Cpu, Fault, NoMemory, Register, Stop};
use decode::{Decoder, Place};
use execute::{Core, EXC_RETURN};
use memory::{Memory, Stopped};
use op::Op;
use registers::Registers;

/// The longest block, bytes: a page, and the half of an instruction behind it.
const LONGEST: usize = 1026;
/// So many entries are remembered; those of blocks that were thrown away count until all are.
const MOST_ENTRIES: usize = 1 << 20;

/// The blocks that are known.
#[derive(Debug)]
struct Blocks {
    /// Where in `ops` the block is that begins at each half-word, in the flash and then in its
    /// alias; 0 for none.
    numbers: Vec<u32>,
    /// The entries of all of them, each block's behind its [`Op::Begin`].
    ops: Vec<Op>,
    places: Vec<Place>,
}

impl Blocks {
    fn new(flash: usize) -> Self {
        let nothing = Op::Undefined;
        let place = Place { offset: 0, it: 0 };
        Self {
            numbers: vec![0; flash],
            ops: vec![nothing],
            places: vec![place],
        }
    }

    /// The place of an address in `numbers`, and its offset in the flash; `None` outside of it.
    #[inline(always)]
    fn place(&self, address: u32) -> Option<(usize, usize)> {
        let flash = self.numbers.len();
        let offset = address.wrapping_sub(BASE) as usize;
        if offset < flash {
            return Some((offset / 2, offset));
        }
        let offset = address as usize;
        (offset < flash).then_some(((flash + offset) / 2, offset))
    }

    /// Takes a block that has just been decoded in; its number.
    fn add(&mut self, decoder: Decoder<'_>) -> u32 {
        if self.ops.len() > MOST_ENTRIES {
            *self = Self::new(self.numbers.len());
        }
        let number = self.ops.len();
        self.ops.push(Op::Begin {
            size: decoder.size as u16,
            entries: decoder.ops.len() as u16,
            instructions: decoder.block.instructions as u16,
            sends_event: decoder.block.sends_event,
        });
        self.ops.extend(decoder.ops);
        self.places.push(Place { offset: 0, it: 0 });
        self.places.extend(decoder.places);
        number as u32
    }

    /// So many bytes of the flash have changed, from this offset on.
    fn forget(&mut self, offset: usize, length: usize) {
        // A block before them may reach into them.
        let from = offset.saturating_sub(LONGEST) / 2;
        let to = (offset + length).div_ceil(2);
        let half = self.numbers.len() / 2;
        for begin in [0, half] {
            let range = begin + from..begin + to.min(half);
            if let Some(numbers) = self.numbers.get_mut(range) {
                numbers.fill(0);
            }
        }
    }
}

/// A Cortex-M3 with a chip around it.
#[derive(Debug)]
pub struct CortexM3 {
    core: Core,
    blocks: Blocks,
}

impl CortexM3 {
    /// The number of the block that begins where the program counter is.
    ///
    /// Errors: why there is none.
    #[inline(always)]
    fn block(&mut self) -> Result<u32, Stop> {
        let registers = &self.core.registers;
        let (place, _) = match self.blocks.place(registers.pc) {
            Some(place) if registers.thumb => place,
            _ => return Err(self.nowhere()),
        };
        match self.blocks.numbers.get(place) {
            Some(number) if *number != 0 && self.core.registers.it == 0 => Ok(*number),
            _ => self.decode(),
        }
    }

    /// Why there is no code where the program counter is.
    #[cold]
    fn nowhere(&self) -> Stop {
        let at = self.core.registers.pc;
        match at | 1 {
            link @ EXC_RETURN.. => Stop::ExceptionReturn(link),
            _ if !self.core.registers.thumb => Fault::Undefined.into(),
            _ => Fault::Fetch { address: at }.into(),
        }
    }

    #[cold]
    fn decode(&mut self) -> Result<u32, Stop> {
        let (at, it) = (self.core.registers.pc, self.core.registers.it);
        let (place, offset) = self.blocks.place(at).ok_or_else(|| self.nowhere())?;
        let code = self.core.memory.flash.get(offset..).unwrap_or(&[]);
        let decoder = Decoder::decode(code, at, it);
        if decoder.size == 0 {
            return Err(Fault::Fetch { address: at }.into());
        }
        let number = self.blocks.add(decoder);
        // Within an IT block the same code is another block.
        if it == 0
            && let Some(place) = self.blocks.numbers.get_mut(place)
        {
            *place = number;
        }
        Ok(number)
    }

    /// Executes until there is a reason to stop.
    fn execute(&mut self) -> Stop {
        // The first block is let through, or the chip could keep the core from ever going on.
        let mut is_first = true;
        loop {
            let number = match self.block() {
                Ok(number) => number,
                Err(stop) => return stop,
            };
            if !is_first && self.core.memory.chip.needs_attention() && self.stops() {
                return Stop::Wanted;
            }
            is_first = false;
            if let Err(stop) = self.execute_block(number) {
                return stop;
            }
        }
    }

    /// Executes the block of this number.
    ///
    /// Errors: the reason to stop.
    #[inline(always)]
    fn execute_block(&mut self, number: u32) -> Result<(), Stop> {
        let block = self.blocks.ops.get(number as usize..).unwrap_or(&[]);
        let Some((
            Op::Begin {
                size,
                entries,
                instructions,
                sends_event,
            },
            ops,
        )) = block.split_first()
        else {
            return Ok(());
        };
        let at = self.core.registers.pc;
        let block = Block {
            instructions: (*instructions).into(),
            sends_event: *sends_event,
        };
        if self.core.memory.chip.is_observed() {
            self.core.memory.observe(at, block, *size);
        }
        self.core.memory.chip.begin(block);
        self.core.registers.pc = at.wrapping_add((*size).into());
        let ops = ops.get(..usize::from(*entries)).unwrap_or(ops);
        let mut left = ops.iter();
        while let Some(op) = left.next() {
            match self.core.execute(*op) {
                Ok(0) => {}
                Ok(entries) => {
                    left.nth(usize::from(entries).wrapping_sub(1));
                }
                Err(Stopped) => {
                    let entry = number as usize + ops.len() - left.len();
                    return Err(self.stopped(entry, *size));
                }
            }
        }
        Ok(())
    }

    /// Goes back to the instruction that could not be executed, to which this entry belongs, in a
    /// block of `size` bytes.
    #[cold]
    #[inline(never)]
    fn stopped(&mut self, entry: usize, size: u16) -> Stop {
        let stop = self.core.memory.stop;
        if let (Stop::Fault(_), Some(place)) = (stop, self.blocks.places.get(entry)) {
            let rest = u32::from(size - place.offset);
            // A fault is never behind a branch: the program counter still is at the block's end.
            let at = self.core.registers.pc.wrapping_sub(rest);
            (self.core.registers.pc, self.core.registers.it) = (at, place.it);
            let mut bytes = vec![0; rest as usize];
            if self.core.memory.read(at, &mut bytes).is_ok() {
                let count = Block::of(&bytes).instructions;
                self.core.memory.chip.take_back(count);
            }
        }
        stop
    }

    /// Lets the chip come to now; true when the core stops before the next block.
    #[cold]
    #[inline(never)]
    fn stops(&mut self) -> bool {
        self.core.memory.chip.attend();
        self.core.memory.chip.wants_stop() || self.is_interrupted()
    }

    /// Whether an exception is to be taken here: not within an IT block.
    fn is_interrupted(&self) -> bool {
        let registers = &self.core.registers;
        let nvic = &self.core.memory.chip.nvic;
        let taken = |waiting| registers.masks().let_through(waiting, nvic);
        nvic.first().is_some_and(taken) && registers.it == 0
    }
}

impl Cpu for CortexM3 {
    fn new(chip: Chip) -> Self {
        Self {
            blocks: Blocks::new(chip.flash_size() as usize),
            core: Core {
                registers: Registers::default(),
                memory: Memory::new(chip),
            },
        }
    }

    fn register(&self, register: Register) -> u32 {
        self.core.registers.named(register)
    }

    fn set_register(&mut self, register: Register, value: u32) {
        self.core.registers.set_named(register, value);
    }

    fn read(&self, address: u32, into: &mut [u8]) -> Result<(), NoMemory> {
        self.core.memory.read(address, into)
    }

    fn write(&mut self, address: u32, bytes: &[u8]) -> Result<(), NoMemory> {
        if let Some(offset) = self.core.memory.write(address, bytes)? {
            self.blocks.forget(offset, bytes.len());
        }
        Ok(())
    }

    fn run(&mut self) -> Stop {
        loop {
            self.put_flash_right();
            self.core.memory.chip.call();
            let stop = self.execute();
            if stop != Stop::Wanted || self.chip().wants_stop() || self.is_interrupted() {
                self.put_flash_right();
                return stop;
            }
        }
    }

    fn chip(&self) -> &Chip {
        &self.core.memory.chip
    }

    fn chip_mut(&mut self) -> &mut Chip {
        &mut self.core.memory.chip
    }
}

#[cfg(test)]
mod tests;
