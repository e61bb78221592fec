//! Executes what code does less often.
//!
//! In: an entry that [`Core::execute`] has no place for. Out: what it does, and a reason to stop
//! where there is one. Sources: ARMv7-M A7.7. Left out: what is frequent.

use super::Core;
use crate::cortex_m3::arithmetic::{self, shifted};
use crate::cortex_m3::memory::Stopped;
use crate::cortex_m3::op::{Alu, Bits, Kind, LR, Op, PC, Shift, Shifted};
use crate::cpu::{Fault, Stop};

/// The entries that [`Core::execute`] leaves to [`Core::execute_rare`]. By name, all of them: so
/// the branch to what an entry does needs no check before it.
macro_rules! rare {
    () => {
        Op::Begin { .. }
            | Op::More { .. }
            | Op::Sub { .. }
            | Op::Data(_)
            | Op::Datas(_)
            | Op::ShiftBy { .. }
            | Op::ShiftsBy { .. }
            | Op::Eor { .. }
            | Op::Orr { .. }
            | Op::Lsl { .. }
            | Op::Lsr { .. }
            | Op::Movt { .. }
            | Op::Mul { .. }
            | Op::Muls { .. }
            | Op::Mla { .. }
            | Op::Mls { .. }
            | Op::Udiv { .. }
            | Op::Sdiv { .. }
            | Op::Bits { .. }
            | Op::Sbfx { .. }
            | Op::Bfi { .. }
            | Op::Saturate { .. }
            | Op::Ldrex { .. }
            | Op::Strex { .. }
            | Op::Clrex
            | Op::Jump { .. }
            | Op::CallTo { .. }
            | Op::JumpPc
            | Op::Table { .. }
            | Op::Mrs { .. }
            | Op::Msr { .. }
            | Op::Cps { .. }
            | Op::Svc
            | Op::Wfi
            | Op::Wfe
            | Op::Bkpt
            | Op::Undefined
            | Op::SetIt { .. }
            | Op::SendEvent
    };
}

impl Core {
    /// What code does less often: out of line, so that the rest has the registers to itself.
    #[inline(never)]
    pub(super) fn execute_rare(&mut self, op: &Op) -> Result<(), Stopped> {
        match *op {
            Op::Sub { d, n, m } => self.put(d, self.get(n).wrapping_sub(self.get(m))),
            Op::Eor { d, n, m } => self.put(d, self.get(n) ^ self.get(m)),
            Op::Orr { d, n, m } => self.put(d, self.get(n) | self.get(m)),
            Op::Lsl { d, m, by } => self.put(d, self.get(m) << (by & 31)),
            Op::Lsr { d, m, by } => self.put(d, (u64::from(self.get(m)) >> (by & 63)) as u32),
            Op::Data(data) => self.data_shifted(data),
            Op::Datas(data) => self.data_shifted_with_flags(data),
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
            _ => self.execute_products(op)?,
        }
        Ok(())
    }

    /// Products and quotients of 32 bits.
    fn execute_products(&mut self, op: &Op) -> Result<(), Stopped> {
        let product = |core: &Self, n, m| core.get(n).wrapping_mul(core.get(m));
        match *op {
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
            _ => self.execute_system(op)?,
        }
        Ok(())
    }

    /// What code does to the core itself, and branches that are rare.
    fn execute_system(&mut self, op: &Op) -> Result<(), Stopped> {
        match *op {
            Op::CallTo { m } => {
                let to = self.get(m);
                self.put(LR, self.registers.pc | 1);
                let _ = self.jump_to(to);
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
            Op::SetIt { it } => {
                self.registers.it = it;
                // The next block is looked for in another way.
                self.memory.chip.call();
            }
            Op::More { instructions, at } => self.memory.chip.count(at, instructions.into()),
            Op::Jump { to } => {
                let _ = self.jump(to);
            }
            Op::SendEvent => self.memory.chip.send_event(),
            Op::Svc => return Err(self.memory.stopped(Stop::SupervisorCall)),
            Op::Wfi => return Err(self.memory.stopped(Stop::WaitForInterrupt)),
            Op::Wfe => return Err(self.memory.stopped(Stop::WaitForEvent)),
            Op::Bkpt => return Err(self.memory.stopped(Fault::Breakpoint.into())),
            _ => return Err(self.memory.stopped(Fault::Undefined.into())),
        }
        Ok(())
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
        let (second, shifted) = shifted(self.get(data.m), data.shift, data.by, carry);
        match data.alu {
            // Their carry goes in, and another one comes out.
            Alu::Adc | Alu::Sbc => {}
            _ => self.registers.flags.carry = shifted,
        }
        self.data_with_flags(data.alu, data.d, data.n, second);
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
