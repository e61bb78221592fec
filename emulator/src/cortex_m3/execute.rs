//! Executes decoded instructions.
//!
//! In: entries of a block, one after the other. Out: registers, loads and stores, and a reason to
//! stop where there is one. Before its first entry the program counter is set to where the block
//! goes on; a branch that depends on anything is its last entry and changes that.
//!
//! Sources: ARMv7-M A7.7. Left out: how long an instruction takes.

#[macro_use]
mod rare;

use super::arithmetic::{self, add, difference, sum};
use super::memory::{Memory, Stopped};
use super::op::{
    Alu, Index, Indexed, Kind, LR, Long, Many, NOWHERE, Op, PC, Placed, Product, SP, Two, ZERO,
};
use super::registers::Registers;
use crate::cpu::Fault;

/// From here on a branch is a return from an exception (PM0056 2.3.7).
pub const EXC_RETURN: u32 = 0xFFFF_FFF0;

/// What comes behind an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// The entry behind it.
    Entry,
    /// So many of those are left out.
    Skip(u8),
    /// Another block.
    Block,
}

/// The core while it executes a block.
#[derive(Debug)]
pub struct Core {
    pub registers: Registers,
    pub memory: Memory,
}

impl Core {
    #[inline(always)]
    fn get(&self, number: u8) -> u32 {
        self.registers.get(number)
    }

    #[inline(always)]
    fn put(&mut self, number: u8, value: u32) {
        self.registers.put(number, value);
    }

    /// Executes an entry; what comes behind it.
    ///
    /// Errors: it was not executed, or stops the core, as [`Memory::stop`] has it.
    #[inline(always)]
    pub fn execute(&mut self, op: &Op) -> Result<Next, Stopped> {
        match *op {
            Op::Set { d, imm } => self.put(d, imm),
            Op::Sets { d, imm } => self.logical(d, imm),
            Op::Move { d, m } => self.put(d, self.get(m)),
            Op::MoveIf { when, d, m } => self.set_if(when, d, self.get(m)),
            Op::SetIf { when, d, imm } => self.set_if(when, d, imm),
            Op::AddImm { d, n, imm } => self.put(d, self.get(n).wrapping_add(imm)),
            Op::AddsImm { d, n, imm } => self.flagged(d, sum(self.get(n), imm)),
            Op::SubsImm { d, n, imm } => self.flagged(d, difference(self.get(n), imm)),
            Op::CmpImm { n, imm } => self.flagged(NOWHERE, difference(self.get(n), imm)),
            Op::Cmp { n, m } => self.flagged(NOWHERE, difference(self.get(n), self.get(m))),
            Op::Add { d, n, m } => self.put(d, self.get(n).wrapping_add(self.get(m))),
            Op::AndImm { d, n, imm } => self.put(d, self.get(n) & imm),
            Op::Ands { d, n, m } => self.logical(d, self.get(n) & self.get(m)),
            Op::Adds { d, n, m } => self.flagged(d, sum(self.get(n), self.get(m))),
            Op::Subs { d, n, m } => self.flagged(d, difference(self.get(n), self.get(m))),
            Op::Lsls { d, m, by } => self.moved_left(d, m, by),
            Op::Lsrs { d, m, by } => self.moved_right(d, m, by),
            Op::DataImm { alu, d, n, imm } => self.data(alu, d, n, imm),
            Op::DatasPlain { alu, d, n, m } => self.data_with_flags(alu, d, n, self.get(m)),
            Op::DatasImm { alu, d, n, imm } => self.data_with_flags(alu, d, n, imm),
            Op::DataLsl(data) => self.data(data.alu, data.d, data.n, self.placed_left(data)),
            Op::DataLsr(data) => self.data(data.alu, data.d, data.n, self.placed_right(data)),
            Op::Ubfx { d, n, lsb, width } => self.field(d, n, lsb, width),
            Op::Extend { kind, d, m, by } => self.extend(kind, d, m, by),
            Op::Long(product) => self.product(product),
            Op::Literal { t, at } => self.literal(t, at)?,
            Op::Ldr { t, n, imm } => self.load(Kind::Word, t, self.get(n).wrapping_add(imm))?,
            Op::Ldrb { t, n, imm } => self.load(Kind::Byte, t, self.get(n).wrapping_add(imm))?,
            Op::Ldrh { t, n, imm } => self.load(Kind::Half, t, self.get(n).wrapping_add(imm))?,
            Op::LoadSigned { kind, t, n, imm } => {
                self.load(kind, t, self.get(n).wrapping_add(imm))?
            }
            Op::Str { t, n, imm } => self.store(Kind::Word, t, self.get(n).wrapping_add(imm))?,
            Op::Strb { t, n, imm } => self.store(Kind::Byte, t, self.get(n).wrapping_add(imm))?,
            Op::Strh { t, n, imm } => self.store(Kind::Half, t, self.get(n).wrapping_add(imm))?,
            Op::LoadAt { kind, t, n, m, by } => self.load(kind, t, self.indexed(n, m, by))?,
            Op::StoreAt { kind, t, n, m, by } => self.store(kind, t, self.indexed(n, m, by))?,
            Op::LoadIndexed(indexed) => self.load_indexed(indexed)?,
            Op::StoreIndexed(indexed) => self.store_indexed(indexed)?,
            Op::Ldm(many) => self.load_many(many)?,
            Op::Stm(many) => self.store_many(many)?,
            Op::Push { d, len, mask, imm } => self.push([d, len], mask, imm)?,
            Op::Ldrd(two) => self.load_two(two)?,
            Op::Strd(two) => self.store_two(two)?,
            Op::JumpIf { when, to } => return Ok(self.jump_if(self.registers.flags.hold(when), to)),
            Op::JumpIfZero { n, to } => return Ok(self.jump_if(self.get(n) == 0, to)),
            Op::JumpIfNot { n, to } => return Ok(self.jump_if(self.get(n) != 0, to)),
            Op::CmpImmJumpIf { n, imm, when, to } => {
                return Ok(self.compare_and_jump(n, imm.into(), when, to));
            }
            Op::CmpJumpIf { n, m, when, to } => {
                return Ok(self.compare_and_jump(n, self.get(m), when, to));
            }
            Op::Call { to } => return Ok(self.call(to)),
            Op::JumpTo { m } => return Ok(self.jump_to(self.get(m))),
            Op::Carry { set } => self.registers.flags.carry = set,
            Op::SetPc { to } => self.put(PC, to),
            Op::SkipUnless { when, entries } => return Ok(self.skip_unless(when, entries)),
            Op::Moves { d, m, second, from } => self.move_twice([d, m], [second, from]),
            Op::MoveCall { d, m, to } => return Ok(self.move_and_call(d, m, to)),
            Op::LdmJump { many, m } => return self.load_many_and_jump(many, m),
            rare!() => self.execute_rare(op)?,
        }
        Ok(Next::Entry)
    }

    #[inline(always)]
    fn move_and_call(&mut self, d: u8, m: u8, to: u32) -> Next {
        self.put(d, self.get(m));
        self.call(to)
    }

    #[inline(always)]
    fn load_many_and_jump(&mut self, many: Many, m: u8) -> Result<Next, Stopped> {
        self.load_many(many)?;
        Ok(self.jump_to(self.get(m)))
    }

    #[inline(always)]
    fn move_twice(&mut self, [d, m]: [u8; 2], [second, from]: [u8; 2]) {
        self.put(d, self.get(m));
        self.put(second, self.get(from));
    }

    /// A result that sets N and Z.
    #[inline(always)]
    fn logical(&mut self, d: u8, value: u32) {
        self.registers.flags.negative = value;
        self.registers.flags.zero = value;
        self.put(d, value);
    }

    /// d = value, if a condition holds. It is written in any case: a branch in the emulator would
    /// be as hard to foresee as that of the code.
    #[inline(always)]
    fn set_if(&mut self, when: u8, d: u8, value: u32) {
        let held = self.get(d);
        let holds = self.registers.flags.hold(when);
        self.put(d, std::hint::select_unpredictable(holds, value, held));
    }

    #[inline(always)]
    fn skip_unless(&self, when: u8, entries: u8) -> Next {
        match self.registers.flags.hold(when) {
            true => Next::Entry,
            false => Next::Skip(entries),
        }
    }

    #[inline(always)]
    fn placed_left(&self, data: Placed) -> u32 {
        self.get(data.m) << (data.by & 31)
    }

    #[inline(always)]
    fn placed_right(&self, data: Placed) -> u32 {
        self.get(data.m) >> (data.by & 31)
    }

    /// A sum or a difference with its carry and its overflow, which sets all four flags.
    #[inline(always)]
    fn flagged(&mut self, d: u8, (value, carry, overflow): (u32, bool, bool)) {
        self.registers.flags.carry = carry;
        self.registers.flags.overflow = overflow;
        self.logical(d, value);
    }

    /// d = m shifted to the left by 1 to 31 places, with flags.
    #[inline(always)]
    fn moved_left(&mut self, d: u8, m: u8, by: u8) {
        let wide = u64::from(self.get(m)) << (by & 31);
        self.registers.flags.carry = wide >> 32 & 1 != 0;
        self.logical(d, wide as u32);
    }

    /// d = m shifted to the right by 1 to 32 places, with flags.
    #[inline(always)]
    fn moved_right(&mut self, d: u8, m: u8, by: u8) {
        let wide = u64::from(self.get(m)) << 1 >> (by & 63);
        self.registers.flags.carry = wide & 1 != 0;
        self.logical(d, (wide >> 1) as u32);
    }

    #[inline(always)]
    fn field(&mut self, d: u8, n: u8, lsb: u8, width: u8) {
        let field = self.get(n) >> (lsb & 31) & arithmetic::ones(width);
        self.put(d, field);
    }

    #[inline(always)]
    fn extend(&mut self, kind: Kind, d: u8, m: u8, by: u8) {
        let value = self.get(m).rotate_right(by.into());
        self.put(d, extended(kind, value));
    }

    #[inline(always)]
    fn product(&mut self, product: Product) {
        let Product { low, high, .. } = product;
        let (n, m) = (self.get(product.n), self.get(product.m));
        let held = u64::from(self.get(high)) << 32 | u64::from(self.get(low));
        let signed = || (i64::from(n as i32) * i64::from(m as i32)) as u64;
        let unsigned = || u64::from(n) * u64::from(m);
        let sum = match product.long {
            Long::Smull => signed(),
            Long::Umull => unsigned(),
            Long::Smlal => held.wrapping_add(signed()),
            Long::Umlal => held.wrapping_add(unsigned()),
        };
        self.put(low, sum as u32);
        self.put(high, (sum >> 32) as u32);
    }

    #[inline(always)]
    fn data(&mut self, alu: Alu, d: u8, n: u8, m: u32) {
        let n = self.get(n);
        let carry = u32::from(self.registers.flags.carry);
        let value = match alu {
            Alu::And => n & m,
            Alu::Bic => n & !m,
            Alu::Orr => n | m,
            Alu::Orn => n | !m,
            Alu::Eor => n ^ m,
            Alu::Add => n.wrapping_add(m),
            Alu::Adc => n.wrapping_add(m).wrapping_add(carry),
            Alu::Sbc => n.wrapping_add(!m).wrapping_add(carry),
            Alu::Sub => n.wrapping_sub(m),
            Alu::Rsb => m.wrapping_sub(n),
        };
        self.put(d, value);
    }

    /// The same with flags; the carry is the one that the second operand has got.
    #[inline(always)]
    fn data_with_flags(&mut self, alu: Alu, d: u8, n: u8, m: u32) {
        let (n, carry) = (self.get(n), self.registers.flags.carry);
        let value = match alu {
            Alu::Add => return self.flagged(d, sum(n, m)),
            Alu::Adc => return self.flagged(d, add(n, m, carry)),
            Alu::Sbc => return self.flagged(d, add(n, !m, carry)),
            Alu::Sub => return self.flagged(d, difference(n, m)),
            Alu::Rsb => return self.flagged(d, difference(m, n)),
            Alu::And => n & m,
            Alu::Bic => n & !m,
            Alu::Orr => n | m,
            Alu::Orn => n | !m,
            Alu::Eor => n ^ m,
        };
        self.logical(d, value);
    }

    #[inline(always)]
    fn indexed(&self, n: u8, m: u8, by: u8) -> u32 {
        self.get(n).wrapping_add(self.get(m) << (by & 3))
    }

    #[inline(always)]
    fn load(&mut self, kind: Kind, t: u8, at: u32) -> Result<(), Stopped> {
        let value = self.memory.load(kind, at)?;
        self.put(t, value);
        Ok(())
    }

    #[inline(always)]
    fn store(&mut self, kind: Kind, t: u8, at: u32) -> Result<(), Stopped> {
        self.memory.store(kind, at, self.get(t))
    }

    #[inline(always)]
    fn literal(&mut self, t: u8, at: u32) -> Result<(), Stopped> {
        let value = self.memory.literal(at)?;
        self.put(t, value);
        Ok(())
    }

    /// Where to load or store, and what the base then is.
    #[inline(always)]
    fn walked(&self, n: u8, index: Index, by: i16) -> (u32, u32) {
        let base = self.get(n);
        let there = base.wrapping_add(i32::from(by) as u32);
        match index {
            Index::Offset => (there, base),
            Index::Before => (there, there),
            Index::Behind => (base, there),
        }
    }

    #[inline(never)]
    fn load_indexed(&mut self, indexed: Indexed) -> Result<(), Stopped> {
        let (at, base) = self.walked(indexed.n, indexed.index, indexed.by);
        let value = self.memory.load(indexed.kind, at)?;
        self.put(indexed.n, base);
        self.put(indexed.t, value);
        Ok(())
    }

    #[inline(never)]
    fn store_indexed(&mut self, indexed: Indexed) -> Result<(), Stopped> {
        let (at, base) = self.walked(indexed.n, indexed.index, indexed.by);
        self.store(indexed.kind, indexed.t, at)?;
        self.put(indexed.n, base);
        Ok(())
    }

    #[inline(never)]
    fn load_two(&mut self, two: Two) -> Result<(), Stopped> {
        let (at, base) = self.walked(two.n, two.index, two.by);
        self.word_aligned(at)?;
        let [low, high] = match self.memory.words(at, 2) {
            Some([low, high]) => [*low, *high].map(u32::from_le_bytes),
            _ => [self.memory.word(at)?, self.memory.word(at.wrapping_add(4))?],
        };
        self.put(two.n, base);
        self.put(two.t, low);
        self.put(two.second, high);
        Ok(())
    }

    #[inline(never)]
    fn store_two(&mut self, two: Two) -> Result<(), Stopped> {
        let (at, base) = self.walked(two.n, two.index, two.by);
        self.word_aligned(at)?;
        let [low, high] = [two.t, two.second].map(|number| self.get(number));
        match self.memory.words(at, 2) {
            Some([first, second]) => {
                (*first, *second) = (low.to_le_bytes(), high.to_le_bytes());
            }
            _ => {
                self.memory.store(Kind::Word, at, low)?;
                self.memory.store(Kind::Word, at.wrapping_add(4), high)?;
            }
        }
        self.put(two.n, base);
        Ok(())
    }

    /// Where a block of registers begins, and what the base then is.
    #[inline(always)]
    fn span(&mut self, many: Many) -> Result<(u32, u32), Stopped> {
        let Many { n, down, count, .. } = many;
        let (base, length) = (self.get(n), 4 * u32::from(count));
        let lowest = if down {
            base.wrapping_sub(length)
        } else {
            base
        };
        self.word_aligned(lowest)?;
        Ok((
            lowest,
            if down {
                lowest
            } else {
                base.wrapping_add(length)
            },
        ))
    }

    #[inline(never)]
    fn load_many(&mut self, many: Many) -> Result<(), Stopped> {
        let Many { n, keeps, mask, .. } = many;
        let (at, end) = self.span(many)?;
        let Some(words) = self.memory.words(at, many.count.into()) else {
            return self.load_many_elsewhere(many, at, end);
        };
        let mut left = mask;
        for word in words {
            let number = left.trailing_zeros() as u8;
            self.registers.put(number, u32::from_le_bytes(*word));
            left &= left.wrapping_sub(1);
        }
        // What was loaded into the base stays.
        if keeps && mask >> (n & 15) & 1 == 0 {
            self.put(n, end);
        }
        Ok(())
    }

    /// The same where a load may be refused.
    #[inline(never)]
    fn load_many_elsewhere(&mut self, many: Many, at: u32, end: u32) -> Result<(), Stopped> {
        let Many { n, keeps, mask, .. } = many;
        let (mut at, mut left) = (at, mask);
        let mut base = keeps.then_some(end);
        while left != 0 {
            let number = left.trailing_zeros() as u8;
            let word = self.memory.word(at)?;
            match number == n {
                // The base comes last: until then a fault leaves it as it was.
                true => base = Some(word),
                false => self.put(number, word),
            }
            at = at.wrapping_add(4);
            left &= left - 1;
        }
        if let Some(base) = base {
            self.put(n, base);
        }
        Ok(())
    }

    #[inline(never)]
    fn store_many(&mut self, many: Many) -> Result<(), Stopped> {
        let Many { n, keeps, mask, .. } = many;
        let (mut at, end) = self.span(many)?;
        let mut left = mask;
        if let Some(words) = self.memory.words(at, many.count.into()) {
            for word in words {
                let number = left.trailing_zeros() as u8;
                *word = self.registers.get(number).to_le_bytes();
                left &= left.wrapping_sub(1);
            }
        }
        // Elsewhere a store may be refused.
        while left != 0 {
            self.store(Kind::Word, left.trailing_zeros() as u8, at)?;
            at = at.wrapping_add(4);
            left &= left - 1;
        }
        if keeps {
            self.put(n, end);
        }
        Ok(())
    }

    /// PUSH of `len` registers, and then d = the stack pointer + `imm`.
    #[inline(always)]
    fn push(&mut self, [d, len]: [u8; 2], mask: u16, imm: i16) -> Result<(), Stopped> {
        self.store_many(Many {
            n: SP,
            down: true,
            keeps: true,
            count: len,
            mask,
        })?;
        self.put(d, self.get(SP).wrapping_add(i32::from(imm) as u32));
        Ok(())
    }

    /// Errors: for what LDM, STM, LDRD and STRD do not take (ARMv7-M A3.2.1).
    #[inline(always)]
    fn word_aligned(&mut self, address: u32) -> Result<(), Stopped> {
        match address & 3 {
            0 => Ok(()),
            _ => Err(self.memory.stopped(Fault::Unaligned.into())),
        }
    }

    #[inline(always)]
    fn compare_and_jump(&mut self, n: u8, m: u32, when: u8, to: u32) -> Next {
        self.flagged(NOWHERE, difference(self.get(n), m));
        self.jump_if(self.registers.flags.hold(when), to)
    }

    #[inline(always)]
    fn call(&mut self, to: u32) -> Next {
        self.put(LR, self.registers.pc | 1);
        self.jump(to)
    }

    #[inline(always)]
    fn jump(&mut self, to: u32) -> Next {
        self.registers.pc = to;
        Next::Block
    }

    #[inline(always)]
    fn jump_if(&mut self, holds: bool, to: u32) -> Next {
        if holds {
            self.registers.pc = to;
        }
        Next::Block
    }

    /// A branch that may leave Thumb code, or an exception.
    #[inline(always)]
    fn jump_to(&mut self, to: u32) -> Next {
        self.registers.pc = to ^ 1;
        Next::Block
    }
}

fn extended(kind: Kind, value: u32) -> u32 {
    match kind {
        Kind::Word => value,
        Kind::Half => value & 0xFFFF,
        Kind::Byte => value & 0xFF,
        Kind::SignedHalf => value as i16 as u32,
        Kind::SignedByte => value as i8 as u32,
    }
}

// `ZERO` is read as any other register, so nothing may write it.
const _: () = assert!(ZERO != NOWHERE && ZERO != PC);
