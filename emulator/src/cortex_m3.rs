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

use std::iter;

use flash::layout::BASE;

use crate::chip::Chip;
use crate::code::{self, Block};
use crate::cpu::{Cpu, Fault, NoMemory, Register, Stop};
use decode::{Decoder, Place};
use execute::{Core, EXC_RETURN, Next};
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
    /// Where in `ops` the block is that begins at each half-word of the flash; 0 for none.
    numbers: Vec<u32>,
    /// The same in the flash's alias.
    alias: Vec<u32>,
    /// The entries of all of them, each block's behind its [`Op::Begin`].
    ops: Vec<Op>,
    /// What they belong to; of a block's begin its size.
    places: Vec<Place>,
}

impl Blocks {
    fn new(flash: usize) -> Self {
        Self {
            numbers: vec![0; flash / 2],
            alias: vec![0; flash / 2],
            ops: vec![Op::Undefined],
            places: vec![Place { offset: 0, it: 0 }],
        }
    }

    /// The number of the block that begins at this address of the flash; 0 if none is known.
    #[inline(always)]
    fn find(&self, address: u32) -> u32 {
        let number = self.numbers.get(code::place(address));
        number.copied().unwrap_or(0)
    }

    /// The place of the number of the block that begins at this address of the flash or of its
    /// alias, and its offset in the flash; `None` outside of them.
    fn place(&mut self, address: u32) -> Option<(&mut u32, usize)> {
        let offset = match address.checked_sub(BASE) {
            Some(offset) => offset as usize,
            None => return Some((self.alias.get_mut(address as usize / 2)?, address as usize)),
        };
        Some((self.numbers.get_mut(offset / 2)?, offset))
    }

    /// Takes the block at `address` in that has just been decoded; its number.
    fn add(&mut self, decoder: Decoder<'_>, address: u32) -> u32 {
        if self.ops.len() > MOST_ENTRIES {
            *self = Self::new(2 * self.numbers.len());
        }
        let number = self.ops.len();
        let all = decoder.block.instructions;
        let instructions = u8::try_from(all).unwrap_or(u8::MAX);
        let more = (all - u32::from(instructions)) as u16;
        let more = (more > 0).then_some(Op::More {
            instructions: more,
            at: address,
        });
        let event = decoder.block.sends_event.then_some(Op::SendEvent);
        let first = more.into_iter().chain(event);
        let entries = first.clone().count() + decoder.ops.len();
        let begin = Op::Begin {
            instructions,
            entries: entries as u16,
            end: decoder.to.unwrap_or(address.wrapping_add(decoder.size)),
        };
        self.ops.extend(iter::once(begin).chain(first.clone()));
        let (offset, it) = (decoder.size as u16, 0);
        self.places.push(Place { offset, it });
        self.places.extend(first.map(|_| Place { offset: 0, it }));
        self.ops.extend(decoder.ops);
        self.places.extend(decoder.places);
        number as u32
    }

    /// So many bytes of the flash have changed, from this offset on.
    fn forget(&mut self, offset: usize, length: usize) {
        // A block before them may reach into them.
        let from = offset.saturating_sub(LONGEST) / 2;
        let to = (offset + length).div_ceil(2);
        for numbers in [&mut self.numbers, &mut self.alias] {
            let to = to.min(numbers.len());
            if let Some(numbers) = numbers.get_mut(from..to) {
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
    /// Number and address of the block under way. They are kept here, since only a stop asks for
    /// them: what executes a block has the registers of the host for itself.
    under_way: (u32, u32),
}

impl CortexM3 {
    /// The number of the next block, where the chip wants attention, or the block is not known yet
    /// or begins within an IT block: the code calls the chip when it leaves one in such a place.
    ///
    /// Errors: the reason to stop before it.
    #[cold]
    #[inline(never)]
    fn block_with_attention(&mut self, found: u32) -> Result<u32, Stop> {
        let number = match found {
            1.. if self.core.registers.it == 0 => found,
            _ => self.block_anywhere()?,
        };
        match self.core.memory.chip.needs_attention() && self.stops() {
            true => Err(Stop::Wanted),
            false => Ok(number),
        }
    }

    /// Why there is no code where the program counter is.
    #[cold]
    fn nowhere(&self) -> Stop {
        let at = self.core.registers.pc & !1;
        match at | 1 {
            link @ EXC_RETURN.. => Stop::ExceptionReturn(link),
            _ if !self.core.registers.is_thumb() => Fault::Undefined.into(),
            _ => Fault::Fetch { address: at }.into(),
        }
    }

    /// The number of the block that begins where the program counter is, decoded if it has to be.
    ///
    /// Errors: why there is none.
    #[cold]
    fn block_anywhere(&mut self) -> Result<u32, Stop> {
        let (at, it) = (self.core.registers.pc, self.core.registers.it);
        let is_thumb = self.core.registers.is_thumb();
        let place = self.blocks.place(at).filter(|_| is_thumb);
        let Some((number, offset)) = place else {
            return Err(self.nowhere());
        };
        // Within an IT block the same code is another block.
        if it == 0 && *number != 0 {
            return Ok(*number);
        }
        let code = self.core.memory.flash.get(offset..).unwrap_or(&[]);
        let decoder = Decoder::decode(code, at, it);
        if decoder.size == 0 {
            return Err(Fault::Fetch { address: at }.into());
        }
        let added = self.blocks.add(decoder, at);
        if let Some((number, _)) = self.blocks.place(at).filter(|_| it == 0) {
            *number = added;
        }
        Ok(added)
    }

    /// Executes until there is a reason to stop.
    fn execute(&mut self) -> Stop {
        let mut number = match self.block_anywhere() {
            Ok(number) => number,
            Err(stop) => return stop,
        };
        // The first block is let through, or the chip could keep the core from ever going on.
        loop {
            if let Err(stop) = self.execute_block(number) {
                return stop;
            }
            number = self.blocks.find(self.core.registers.pc);
            if number == 0 || self.core.memory.chip.needs_attention() {
                number = match self.block_with_attention(number) {
                    Ok(number) => number,
                    Err(stop) => return stop,
                };
            }
        }
    }

    /// Executes the block of this number.
    ///
    /// Errors: the reason to stop.
    #[inline(always)]
    fn execute_block(&mut self, number: u32) -> Result<(), Stop> {
        let at = self.core.registers.pc;
        if self.core.memory.chip.is_watched() {
            self.watch(at, number);
        }
        let (first, ops) = (number as usize + 1, &self.blocks.ops);
        let Some(&Op::Begin {
            instructions,
            entries,
            end,
        }) = ops.get(first - 1)
        else {
            return Ok(());
        };
        let ops = ops.get(first..first + usize::from(entries));
        self.under_way = (number, at);
        self.core.memory.chip.count(at, instructions.into());
        self.core.registers.pc = end;
        let mut left = ops.unwrap_or(&[]).iter();
        while let Some(op) = left.next() {
            match self.core.execute(op) {
                Ok(Next::Entry) => {}
                Ok(Next::Skip(entries)) => {
                    let behind = left.as_slice().get(usize::from(entries)..);
                    left = behind.unwrap_or(&[]).iter();
                }
                Ok(Next::Block) => return Ok(()),
                Err(Stopped) => {
                    let left = left.len();
                    return Err(self.stopped(left));
                }
            }
        }
        Ok(())
    }

    /// Bytes of a block.
    fn size(&self, number: u32) -> u16 {
        let place = self.blocks.places.get(number as usize);
        place.map_or(0, |place| place.offset)
    }

    /// Notes that this block at `at` is about to run, for those who watch addresses.
    #[cold]
    #[inline(never)]
    fn watch(&mut self, at: u32, number: u32) {
        let size = self.size(number);
        self.core.memory.observe(at, size);
    }

    /// Goes back to the instruction that could not be executed: to that of the entry behind which
    /// so many are left in the block under way.
    #[cold]
    #[inline(never)]
    fn stopped(&mut self, left: usize) -> Stop {
        let (number, at) = self.under_way;
        let stop = self.core.memory.stop;
        let entries = match self.blocks.ops.get(number as usize) {
            Some(Op::Begin { entries, .. }) => usize::from(*entries),
            _ => 0,
        };
        let entry = entries.saturating_sub(left);
        let place = self.blocks.places.get(number as usize + entry);
        if let (Stop::Fault(_), Some(place)) = (stop, place) {
            let rest = self.size(number) - place.offset;
            let at = at.wrapping_add(place.offset.into());
            (self.core.registers.pc, self.core.registers.it) = (at, place.it);
            let mut bytes = vec![0; rest.into()];
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
            under_way: (0, 0),
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
