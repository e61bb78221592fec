//! Executes decoded instructions.
//!
//! In: entries of a block, one after the other. Out: registers, loads and stores, and a reason to
//! stop where there is one. The program counter is set to the end of the block before its first
//! entry; a branch is its last one and changes that.
//!
//! Sources: ARMv7-M A7.7. Left out: how long an instruction takes.

use super::arithmetic::{self, add, shifted};
use super::memory::{Memory, Stopped};
use super::op::{Alu, Bits, Index, Kind, LR, Long, Many, NOWHERE, Op, PC, Shift, Shifted, ZERO};
use super::registers::Registers;
use crate::cpu::{Fault, Stop};

/// From here on a branch is a return from an exception (PM0056 2.3.7).
pub const EXC_RETURN: u32 = 0xFFFF_FFF0;

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

    /// Executes an entry; how many of those behind it are left out.
    ///
    /// Errors: it was not executed, or stops the core, as [`Memory::stop`] says.
    #[inline(always)]
    pub fn execute(&mut self, op: Op) -> Result<u8, Stopped> {
        match op {
            Op::Set { d, imm } => self.put(d, imm),
            Op::Sets { d, imm } => self.logical(d, imm),
            Op::Move { d, m } => self.put(d, self.get(m)),
            Op::AddImm { d, n, imm } => self.put(d, self.get(n).wrapping_add(imm)),
            Op::AddsImm { d, n, imm } => self.sum(d, self.get(n), imm, false),
            Op::SubsImm { d, n, imm } => self.sum(d, self.get(n), !imm, true),
            Op::CmpImm { n, imm } => self.sum(NOWHERE, self.get(n), !imm, true),
            Op::Cmp { n, m } => self.sum(NOWHERE, self.get(n), !self.get(m), true),
            Op::Add { d, n, m } => self.put(d, self.get(n).wrapping_add(self.get(m))),
            Op::Sub { d, n, m } => self.put(d, self.get(n).wrapping_sub(self.get(m))),
            Op::AndImm { d, n, imm } => self.put(d, self.get(n) & imm),
            Op::Eor { d, n, m } => self.put(d, self.get(n) ^ self.get(m)),
            Op::Orr { d, n, m } => self.put(d, self.get(n) | self.get(m)),
            Op::Ands { d, n, m } => self.logical(d, self.get(n) & self.get(m)),
            Op::Adds { d, n, m } => self.sum(d, self.get(n), self.get(m), false),
            Op::Subs { d, n, m } => self.sum(d, self.get(n), !self.get(m), true),
            Op::Lsl { d, m, by } => self.moved(d, m, Shift::Lsl, by),
            Op::Lsr { d, m, by } => self.moved(d, m, Shift::Lsr, by),
            Op::Lsls { d, m, by } => self.moved_with_flags(d, m, Shift::Lsl, by),
            Op::Lsrs { d, m, by } => self.moved_with_flags(d, m, Shift::Lsr, by),
            Op::DataImm { alu, d, n, imm } => self.data(alu, d, n, imm),
            Op::DatasImm { alu, d, n, imm } => {
                self.data_with_flags(alu, d, n, imm, self.registers.flags.carry);
            }
            Op::Data(data) => self.data_shifted(data),
            Op::Datas(data) => self.data_shifted_with_flags(data),
            Op::Ldr { t, n, imm } => self.load(Kind::Word, t, self.get(n).wrapping_add(imm))?,
            Op::Ldrb { t, n, imm } => self.load(Kind::Byte, t, self.get(n).wrapping_add(imm))?,
            Op::Ldrh { t, n, imm } => self.load(Kind::Half, t, self.get(n).wrapping_add(imm))?,
            Op::Str { t, n, imm } => self.store(Kind::Word, t, self.get(n).wrapping_add(imm))?,
            Op::Strb { t, n, imm } => self.store(Kind::Byte, t, self.get(n).wrapping_add(imm))?,
            Op::Strh { t, n, imm } => self.store(Kind::Half, t, self.get(n).wrapping_add(imm))?,
            Op::LoadAt { kind, t, n, m, by } => self.load(kind, t, self.indexed(n, m, by))?,
            Op::StoreAt { kind, t, n, m, by } => self.store(kind, t, self.indexed(n, m, by))?,
            Op::Ldm(many) => self.load_many(many)?,
            Op::Stm(many) => self.store_many(many)?,
            Op::Jump { to } => self.registers.pc = to,
            Op::JumpIf { when, to } => self.jump_if(self.registers.flags.hold(when), to),
            Op::CmpImmJumpIf { n, imm, when, to } => self.compare_and_jump(n, imm.into(), when, to),
            Op::CmpJumpIf { n, m, when, to } => self.compare_and_jump(n, self.get(m), when, to),
            Op::JumpIfZero { n, to } => self.jump_if(self.get(n) == 0, to),
            Op::JumpIfNot { n, to } => self.jump_if(self.get(n) != 0, to),
            Op::Call { to } => self.call(to),
            Op::JumpTo { m } => self.jump_to(self.get(m)),
            Op::Carry { set } => self.registers.flags.carry = set,
            Op::SetPc { to } => self.put(PC, to),
            Op::SkipUnless { when, entries } => {
                let holds = self.registers.flags.hold(when);
                return Ok(if holds { 0 } else { entries });
            }
            _ => self.execute_rare(op)?,
        }
        Ok(0)
    }

    /// What code does less often: out of line, so that the rest has the registers to itself.
    #[inline(never)]
    fn execute_rare(&mut self, op: Op) -> Result<(), Stopped> {
        match op {
            Op::ShiftBy { shift, d, n, m } => {
                let (value, _) = self.shifted_by(shift, n, m);
                self.put(d, value);
            }
            Op::ShiftsBy { shift, d, n, m } => {
                let (value, carry) = self.shifted_by(shift, n, m);
                self.registers.flags.carry = carry;
                self.logical(d, value);
            }
            Op::Movt { d, imm } => self.put(d, self.get(d) & 0xFFFF | u32::from(imm) << 16),
            Op::Bits { bits, d, m } => self.put(d, reordered(bits, self.get(m))),
            Op::Extend { kind, d, m, by } => {
                let value = self.get(m).rotate_right(by.into());
                self.put(d, extended(kind, value));
            }
            Op::Ubfx { d, n, lsb, width } => {
                let field = self.get(n) >> lsb & arithmetic::ones(width);
                self.put(d, field);
            }
            Op::Sbfx { d, n, lsb, width } => {
                let left = self.get(n) << (32 - u32::from(lsb + width));
                self.put(d, (left as i32 >> (32 - u32::from(width))) as u32);
            }
            Op::Bfi { d, n, lsb, width } => {
                let mask = arithmetic::ones(width) << lsb;
                self.put(d, self.get(d) & !mask | self.get(n) << lsb & mask);
            }
            Op::Saturate {
                signed,
                d,
                n,
                to,
                shift,
                by,
            } => {
                let (value, _) = shifted(self.get(n), shift, by, false);
                let kept = arithmetic::saturated(value as i32, to, signed);
                self.registers.flags.saturated |= kept != value;
                self.put(d, kept);
            }
            _ => self.execute_walk(op)?,
        }
        Ok(())
    }

    /// Loads and stores that change their base, or are of two words.
    fn execute_walk(&mut self, op: Op) -> Result<(), Stopped> {
        match op {
            Op::LoadSigned { kind, t, n, imm } => {
                self.load(kind, t, self.get(n).wrapping_add(imm))?;
            }
            Op::LoadIndexed {
                kind,
                t,
                n,
                index,
                by,
            } => {
                let (at, base) = self.walked(n, index, by);
                let value = self.memory.load(kind, at)?;
                self.put(n, base);
                self.put(t, value);
            }
            Op::StoreIndexed {
                kind,
                t,
                n,
                index,
                by,
            } => {
                let (at, base) = self.walked(n, index, by);
                self.store(kind, t, at)?;
                self.put(n, base);
            }
            Op::Ldrd {
                t,
                second,
                n,
                index,
                by,
            } => {
                let (at, base) = self.walked(n, index, by);
                let [low, high] = [self.aligned(at)?, self.aligned(at.wrapping_add(4))?];
                self.put(n, base);
                self.put(t, low);
                self.put(second, high);
            }
            Op::Strd {
                t,
                second,
                n,
                index,
                by,
            } => {
                let (at, base) = self.walked(n, index, by);
                self.word_aligned(at)?;
                self.store(Kind::Word, t, at)?;
                self.store(Kind::Word, second, at.wrapping_add(4))?;
                self.put(n, base);
            }
            _ => self.execute_products(op)?,
        }
        Ok(())
    }

    /// Products and quotients.
    fn execute_products(&mut self, op: Op) -> Result<(), Stopped> {
        let product = |core: &Self, n, m| core.get(n).wrapping_mul(core.get(m));
        match op {
            Op::Mul { d, n, m } => self.put(d, product(self, n, m)),
            Op::Muls { d, n, m } => self.logical(d, product(self, n, m)),
            Op::Mla { d, n, m, a } => self.put(d, self.get(a).wrapping_add(product(self, n, m))),
            Op::Mls { d, n, m, a } => self.put(d, self.get(a).wrapping_sub(product(self, n, m))),
            Op::Udiv { d, n, m } => {
                let quotient = self.get(n).checked_div(self.get(m));
                self.put(d, quotient.unwrap_or(0));
            }
            Op::Sdiv { d, n, m } => {
                let (n, m) = (self.get(n) as i32, self.get(m) as i32);
                let quotient = if m == 0 { 0 } else { n.wrapping_div(m) };
                self.put(d, quotient as u32);
            }
            Op::Long {
                long,
                low,
                high,
                n,
                m,
            } => {
                let held = u64::from(self.get(high)) << 32 | u64::from(self.get(low));
                let product = match long {
                    Long::Smull | Long::Smlal => {
                        let [n, m] = [n, m].map(|number| i64::from(self.get(number) as i32));
                        (n * m) as u64
                    }
                    Long::Umull | Long::Umlal => u64::from(self.get(n)) * u64::from(self.get(m)),
                };
                let sum = match long {
                    Long::Smull | Long::Umull => product,
                    Long::Smlal | Long::Umlal => held.wrapping_add(product),
                };
                self.put(low, sum as u32);
                self.put(high, (sum >> 32) as u32);
            }
            _ => self.execute_system(op)?,
        }
        Ok(())
    }

    /// What code does to the core itself, and branches that are rare.
    fn execute_system(&mut self, op: Op) -> Result<(), Stopped> {
        match op {
            Op::CallTo { m } => {
                let to = self.get(m);
                self.put(LR, self.registers.pc | 1);
                self.jump_to(to);
            }
            Op::JumpPc => self.registers.pc = self.get(PC) & !1,
            Op::Table { n, m, by } => {
                let kind = if by == 0 { Kind::Byte } else { Kind::Half };
                let far = self.memory.load(kind, self.indexed(n, m, by))?;
                self.registers.pc = self.registers.pc.wrapping_add(2 * far);
            }
            Op::Ldrex { kind, t, n, imm } => {
                let at = self.exclusive(kind, n, imm)?;
                self.load(kind, t, at)?;
                self.registers.exclusive = Some(at);
            }
            Op::Strex { kind, d, t, n, imm } => {
                let at = self.exclusive(kind, n, imm)?;
                let holds = self.registers.exclusive.take() == Some(at);
                if holds {
                    self.store(kind, t, at)?;
                }
                self.put(d, u32::from(!holds));
            }
            Op::Clrex => self.registers.exclusive = None,
            Op::Mrs { d, special } => self.put(d, self.registers.special(special)),
            Op::Msr { n, special } => self.registers.set_special(special, self.get(n)),
            Op::Cps {
                disable,
                primask,
                faultmask,
            } => {
                if primask {
                    self.registers.primask = disable;
                }
                if faultmask {
                    self.registers.faultmask = disable;
                }
            }
            Op::SetIt { it } => self.registers.it = it,
            Op::Svc => return Err(self.memory.stopped(Stop::SupervisorCall)),
            Op::Wfi => return Err(self.memory.stopped(Stop::WaitForInterrupt)),
            Op::Wfe => return Err(self.memory.stopped(Stop::WaitForEvent)),
            Op::Bkpt => return Err(self.memory.stopped(Fault::Breakpoint.into())),
            _ => return Err(self.memory.stopped(Fault::Undefined.into())),
        }
        Ok(())
    }

    /// A result that sets N and Z.
    #[inline(always)]
    fn logical(&mut self, d: u8, value: u32) {
        self.registers.flags.negative = value;
        self.registers.flags.zero = value;
        self.put(d, value);
    }

    /// A sum that sets all four flags.
    #[inline(always)]
    fn sum(&mut self, d: u8, n: u32, m: u32, carry: bool) {
        let (value, carry, overflow) = add(n, m, carry);
        self.registers.flags.carry = carry;
        self.registers.flags.overflow = overflow;
        self.logical(d, value);
    }

    #[inline(always)]
    fn data_shifted(&mut self, data: Shifted) {
        let carry = self.registers.flags.carry;
        let (second, _) = shifted(self.get(data.m), data.shift, data.by, carry);
        self.data(data.alu, data.d, data.n, second);
    }

    #[inline(always)]
    fn data_shifted_with_flags(&mut self, data: Shifted) {
        let carry = self.registers.flags.carry;
        let (second, carry) = shifted(self.get(data.m), data.shift, data.by, carry);
        self.data_with_flags(data.alu, data.d, data.n, second, carry);
    }

    /// d = m shifted.
    #[inline(always)]
    fn moved(&mut self, d: u8, m: u8, shift: Shift, by: u8) {
        let (value, _) = shifted(self.get(m), shift, by, false);
        self.put(d, value);
    }

    /// The same with flags.
    #[inline(always)]
    fn moved_with_flags(&mut self, d: u8, m: u8, shift: Shift, by: u8) {
        let (value, carry) = shifted(self.get(m), shift, by, self.registers.flags.carry);
        self.registers.flags.carry = carry;
        self.logical(d, value);
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

    /// The same with flags; `shifted` is the carry that the second operand has got.
    #[inline(always)]
    fn data_with_flags(&mut self, alu: Alu, d: u8, n: u8, m: u32, shifted: bool) {
        let (n, carry) = (self.get(n), self.registers.flags.carry);
        let value = match alu {
            Alu::Add => return self.sum(d, n, m, false),
            Alu::Adc => return self.sum(d, n, m, carry),
            Alu::Sbc => return self.sum(d, n, !m, carry),
            Alu::Sub => return self.sum(d, n, !m, true),
            Alu::Rsb => return self.sum(d, !n, m, true),
            Alu::And => n & m,
            Alu::Bic => n & !m,
            Alu::Orr => n | m,
            Alu::Orn => n | !m,
            Alu::Eor => n ^ m,
        };
        self.registers.flags.carry = shifted;
        self.logical(d, value);
    }

    /// n shifted by the low byte of m (ARMv7-M A7.4.2).
    fn shifted_by(&self, shift: Shift, n: u8, m: u8) -> (u32, bool) {
        let carry = self.registers.flags.carry;
        match (self.get(m) & 0xFF, shift) {
            (0, _) => (self.get(n), carry),
            // A turn by whole words leaves the value, and bit 31 is what has come out last.
            (by, Shift::Ror) if by % 32 == 0 => (self.get(n), self.get(n) >> 31 != 0),
            (by, Shift::Ror) => shifted(self.get(n), shift, (by % 32) as u8, carry),
            (by, _) => shifted(self.get(n), shift, by as u8, carry),
        }
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

    /// Where to load or store, and what the base then is.
    fn walked(&self, n: u8, index: Index, by: i16) -> (u32, u32) {
        let base = self.get(n);
        let there = base.wrapping_add(i32::from(by) as u32);
        match index {
            Index::Offset => (there, base),
            Index::Before => (there, there),
            Index::Behind => (base, there),
        }
    }

    fn aligned(&mut self, at: u32) -> Result<u32, Stopped> {
        self.word_aligned(at)?;
        self.memory.word(at)
    }

    /// Where a block of registers begins, and what the base then is.
    #[inline(always)]
    fn span(&mut self, many: Many) -> Result<(u32, u32), Stopped> {
        let Many { n, down, mask, .. } = many;
        let (base, length) = (self.get(n), 4 * mask.count_ones());
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

    fn load_many(&mut self, many: Many) -> Result<(), Stopped> {
        let Many { n, keeps, mask, .. } = many;
        let (mut at, end) = self.span(many)?;
        let mut left = mask;
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

    fn store_many(&mut self, many: Many) -> Result<(), Stopped> {
        let Many { n, keeps, mask, .. } = many;
        let (mut at, end) = self.span(many)?;
        let mut left = mask;
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

    /// The address of an exclusive access, which is aligned (ARMv7-M A3.2.1).
    fn exclusive(&mut self, kind: Kind, n: u8, imm: u16) -> Result<u32, Stopped> {
        let at = self.get(n).wrapping_add(imm.into());
        let across = match kind {
            Kind::Word => at & 3,
            Kind::Half | Kind::SignedHalf => at & 1,
            Kind::Byte | Kind::SignedByte => 0,
        };
        match across {
            0 => Ok(at),
            _ => Err(self.memory.stopped(Fault::Unaligned.into())),
        }
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
    fn compare_and_jump(&mut self, n: u8, m: u32, when: u8, to: u32) {
        self.sum(NOWHERE, self.get(n), !m, true);
        self.jump_if(self.registers.flags.hold(when), to);
    }

    #[inline(always)]
    fn call(&mut self, to: u32) {
        self.put(LR, self.registers.pc | 1);
        self.registers.pc = to;
    }

    #[inline(always)]
    fn jump_if(&mut self, holds: bool, to: u32) {
        if holds {
            self.registers.pc = to;
        }
    }

    /// A branch that may leave Thumb code, or an exception.
    #[inline(always)]
    fn jump_to(&mut self, to: u32) {
        self.registers.pc = to & !1;
        self.registers.thumb = to & 1 != 0;
    }
}

fn reordered(bits: Bits, value: u32) -> u32 {
    match bits {
        Bits::Clz => value.leading_zeros(),
        Bits::Rbit => value.reverse_bits(),
        Bits::Rev => value.swap_bytes(),
        Bits::Rev16 => value.swap_bytes().rotate_right(16),
        Bits::Revsh => (value as u16).swap_bytes() as i16 as u32,
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
