//! Instructions of 32 bits.
//!
//! Source: ARMv7-M A5.3. Left out: coprocessors, which end in an undefined instruction as they do
//! where none answers.

use super::super::op::{
    Alu, Bits, Index, Indexed, Kind, Long, Many, NOWHERE, Op, PC, Product, Shift, Two, ZERO,
};
use super::{Decoder, signed, whole};

/// Bits of a half-word.
fn field(code: u16, lsb: u32, width: u32) -> u8 {
    (code >> lsb & ((1 << width) - 1)) as u8
}

/// Three bits and two bits of the second half-word that are a number of places.
fn places(second: u16) -> u8 {
    field(second, 12, 3) << 2 | field(second, 6, 2)
}

fn shift_of(kind: u8, by: u8) -> (Shift, u8) {
    match (kind, by) {
        (0, _) => (Shift::Lsl, by),
        (1, _) => (Shift::Lsr, whole(by)),
        (2, _) => (Shift::Asr, whole(by)),
        (_, 0) => (Shift::Rrx, 1),
        _ => (Shift::Ror, by),
    }
}

/// A constant of 12 bits, and the carry that it brings (ARMv7-M A5.3.2).
fn expanded(imm12: u16) -> (u32, Option<bool>) {
    let byte = u32::from(imm12 & 0xFF);
    match imm12 >> 8 {
        0 => (byte, None),
        1 => (byte * 0x0001_0001, None),
        2 => (byte * 0x0100_0100, None),
        3 => (byte * 0x0101_0101, None),
        _ => {
            let value = (byte & 0x7F | 0x80).rotate_right(u32::from(imm12 >> 7));
            (value, Some(value >> 31 != 0))
        }
    }
}

/// Operation, destination and first operand of a data-processing instruction; `None` for one that
/// is none (ARMv7-M tables A5-10 and A5-22).
fn data_of(code: u8, flags: bool, d: u8, n: u8) -> Option<(Alu, u8, u8)> {
    let discards = flags && d == PC;
    let d = if discards { NOWHERE } else { d };
    let moved = if n == PC { ZERO } else { n };
    Some(match code {
        0 => (Alu::And, d, n),
        1 => (Alu::Bic, d, n),
        2 => (Alu::Orr, d, moved),
        3 => (Alu::Orn, d, moved),
        4 => (Alu::Eor, d, n),
        8 => (Alu::Add, d, n),
        10 => (Alu::Adc, d, n),
        11 => (Alu::Sbc, d, n),
        13 => (Alu::Sub, d, n),
        14 => (Alu::Rsb, d, n),
        _ => return None,
    })
}

/// What is loaded or stored, of a size and a sign.
fn kind_of(size: u8, signed: bool) -> Option<Kind> {
    Some(match (size, signed) {
        (0, false) => Kind::Byte,
        (1, false) => Kind::Half,
        (2, false) => Kind::Word,
        (0, true) => Kind::SignedByte,
        (1, true) => Kind::SignedHalf,
        _ => return None,
    })
}

impl Decoder<'_> {
    /// An instruction of 32 bits (ARMv7-M table A5-9).
    pub(super) fn wide(&mut self, first: u16, second: u16) {
        let found = match (first >> 9 & 0x3F, second >> 15) {
            (0x34, _) if first >> 6 & 1 == 0 => self.many(first, second),
            (0x34, _) => self.pair_or_table(first, second),
            (0x35, _) => self.data_shifted(first, second),
            (0x38..=0x3B, 1) => self.branch_or_control(first, second),
            (0x38 | 0x3A, _) => self.data_constant(first, second),
            (0x39 | 0x3B, _) => self.plain_constant(first, second),
            (0x3C, _) => self.single(first, second),
            (0x3D, _) if first >> 8 & 1 == 0 => self.registers(first, second),
            (0x3D, _) => self.products(first, second),
            _ => None,
        };
        if found.is_none() {
            self.end(Op::Undefined);
        }
    }

    /// LDM and STM (ARMv7-M table A5-16).
    fn many(&mut self, first: u16, mask: u16) -> Option<()> {
        let (n, keeps) = (field(first, 0, 4), field(first, 5, 1) != 0);
        let down = match field(first, 7, 2) {
            1 => false,
            2 => true,
            _ => return None,
        };
        if field(first, 4, 1) == 0 {
            self.push(Op::Stm(Many::new(n, down, keeps, mask)));
            return Some(());
        }
        self.push(Op::Ldm(Many::new(n, down, keeps, mask)));
        if mask >> PC != 0 {
            self.end(Op::JumpTo { m: PC });
        }
        Some(())
    }

    /// LDRD, STRD, exclusive ones, TBB and TBH (ARMv7-M table A5-17).
    fn pair_or_table(&mut self, first: u16, second: u16) -> Option<()> {
        let (n, t, other) = (
            field(first, 0, 4),
            field(second, 12, 4),
            field(second, 8, 4),
        );
        let (loads, keeps) = (field(first, 4, 1) != 0, field(first, 5, 1) != 0);
        let (up, before) = (field(first, 7, 1) != 0, field(first, 8, 1) != 0);
        let imm = (second & 0xFF) << 2;
        if before || keeps {
            let by = if up { imm as i16 } else { -(imm as i16) };
            let index = match (before, keeps) {
                (true, false) => Index::Offset,
                (true, true) => Index::Before,
                (false, _) => Index::Behind,
            };
            if n == PC {
                self.push(Op::SetPc { to: self.pc() & !3 });
            }
            let two = Two {
                t,
                second: other,
                n,
                index,
                by,
            };
            self.push(match loads {
                true => Op::Ldrd(two),
                false => Op::Strd(two),
            });
            return Some(());
        }
        let (kind, imm, d) = match (up, field(second, 4, 4)) {
            (false, _) => (Kind::Word, imm, other),
            (true, 4) => (Kind::Byte, 0, field(second, 0, 4)),
            (true, 5) => (Kind::Half, 0, field(second, 0, 4)),
            (true, by @ (0 | 1)) if loads => {
                self.read_pc(&[n]);
                self.end(Op::Table {
                    n,
                    m: field(second, 0, 4),
                    by,
                });
                return Some(());
            }
            _ => return None,
        };
        self.push(match loads {
            true => Op::Ldrex { kind, t, n, imm },
            false => Op::Strex { kind, d, t, n, imm },
        });
        Some(())
    }

    /// Data processing with a register that is shifted (ARMv7-M table A5-22).
    fn data_shifted(&mut self, first: u16, second: u16) -> Option<()> {
        let (flags, m) = (field(first, 4, 1) != 0, field(second, 0, 4));
        let (d, n) = (field(second, 8, 4), field(first, 0, 4));
        let (alu, d, n) = data_of(field(first, 5, 4), flags, d, n)?;
        let shift = shift_of(field(second, 4, 2), places(second));
        self.data(flags, alu, [d, n, m], shift);
        Some(())
    }

    /// Data processing with a constant (ARMv7-M table A5-10).
    fn data_constant(&mut self, first: u16, second: u16) -> Option<()> {
        let flags = field(first, 4, 1) != 0;
        let (d, n) = (field(second, 8, 4), field(first, 0, 4));
        let (alu, d, n) = data_of(field(first, 5, 4), flags, d, n)?;
        let (imm, carry) = expanded(imm12(first, second));
        let logical = matches!(alu, Alu::And | Alu::Bic | Alu::Orr | Alu::Orn | Alu::Eor);
        if let Some(set) = carry.filter(|_| flags && logical) {
            self.push(Op::Carry { set });
        }
        self.data_imm(flags, alu, [d, n], imm);
        Some(())
    }

    /// Plain constants, bit fields, saturation (ARMv7-M table A5-12).
    fn plain_constant(&mut self, first: u16, second: u16) -> Option<()> {
        let (d, n) = (field(second, 8, 4), field(first, 0, 4));
        let imm = u32::from(imm12(first, second));
        let imm16 = imm | u32::from(n) << 12;
        let (lsb, low) = (places(second), field(second, 0, 5));
        let here = self.pc() & !3;
        let op = field(first, 4, 5);
        let shift = shift_of(op & 2, lsb);
        self.push(match op {
            0 if n == PC => Op::Set { d, imm: here + imm },
            0 => Op::AddImm { d, n, imm },
            4 => Op::Set { d, imm: imm16 },
            10 if n == PC => Op::Set { d, imm: here - imm },
            10 => Op::AddImm {
                d,
                n,
                imm: imm.wrapping_neg(),
            },
            12 => Op::Movt {
                d,
                imm: imm16 as u16,
            },
            16 | 18 => {
                let (shift, by) = shift;
                Op::Saturate {
                    signed: true,
                    d,
                    n,
                    to: low + 1,
                    shift,
                    by,
                }
            }
            24 | 26 => {
                let (shift, by) = shift;
                Op::Saturate {
                    signed: false,
                    d,
                    n,
                    to: low,
                    shift,
                    by,
                }
            }
            20 if lsb + low < 32 => Op::Sbfx {
                d,
                n,
                lsb,
                width: low + 1,
            },
            28 if lsb + low < 32 => Op::Ubfx {
                d,
                n,
                lsb,
                width: low + 1,
            },
            22 if low >= lsb => {
                let n = if n == PC { ZERO } else { n };
                Op::Bfi {
                    d,
                    n,
                    lsb,
                    width: low - lsb + 1,
                }
            }
            _ => return None,
        });
        Some(())
    }

    /// Branches and what controls the core (ARMv7-M table A5-13).
    fn branch_or_control(&mut self, first: u16, second: u16) -> Option<()> {
        let sign = u32::from(first >> 10 & 1);
        let [j1, j2] = [13, 11].map(|lsb| u32::from(second >> lsb & 1));
        let low = u32::from(second & 0x7FF) << 1;
        // B.W and BL: their upper bits are kept against the sign (ARMv7-M A7.7.12, A7.7.18).
        let upper = (sign << 2 | (j1 ^ sign ^ 1) << 1 | (j2 ^ sign ^ 1)) << 22;
        let far = signed(upper | u32::from(first & 0x3FF) << 12 | low, 25);
        let to = self.pc().wrapping_add(far);
        match (second >> 14 & 1, second >> 12 & 1) {
            (1, 1) => self.end(Op::Call { to }),
            (0, 1) => self.end(Op::Jump { to }),
            (0, 0) if field(first, 7, 3) != 7 => {
                let upper = (sign << 2 | j2 << 1 | j1) << 18;
                let far = signed(upper | u32::from(first & 0x3F) << 12 | low, 21);
                let to = self.pc().wrapping_add(far);
                let when = field(first, 6, 4);
                self.branch_if(when, to);
            }
            (0, 0) => return self.control(first, second),
            _ => return None,
        }
        Some(())
    }

    /// MSR, MRS, hints and barriers (ARMv7-M tables A5-13 to A5-15).
    fn control(&mut self, first: u16, second: u16) -> Option<()> {
        let (low, special) = (field(second, 4, 4), field(second, 0, 8));
        match first >> 4 & 0x7F {
            0x38 | 0x39 => self.end(Op::Msr {
                n: field(first, 0, 4),
                special,
            }),
            0x3E | 0x3F => self.push(Op::Mrs {
                d: field(second, 8, 4),
                special,
            }),
            0x3A => match special {
                1 => self.ended = true,
                2 => self.end(Op::Wfe),
                3 => self.end(Op::Wfi),
                // What does nothing has no entry, but counts.
                _ => {}
            },
            0x3B => match low {
                2 => self.push(Op::Clrex),
                4 | 5 => {}
                6 => self.ended = true,
                _ => return None,
            },
            _ => return None,
        }
        Some(())
    }

    /// Loads and stores of one register (ARMv7-M tables A5-18 to A5-21).
    fn single(&mut self, first: u16, second: u16) -> Option<()> {
        let (t, n) = (field(second, 12, 4), field(first, 0, 4));
        let loads = field(first, 4, 1) != 0;
        let kind = kind_of(field(first, 5, 2), field(first, 8, 1) != 0)?;
        let up = field(first, 7, 1) != 0;
        let (imm12, imm8) = (u32::from(second & 0xFFF), second & 0xFF);
        if loads && t == PC && kind != Kind::Word {
            // PLD and PLI fetch ahead, of which nothing is seen.
            return Some(());
        }
        if n == PC {
            let here = self.pc() & !3;
            let at = if up {
                here + imm12
            } else {
                here.wrapping_sub(imm12)
            };
            self.transfer(loads, kind, t, ZERO, at);
        } else if up {
            self.transfer(loads, kind, t, n, imm12);
        } else if field(second, 11, 1) == 0 {
            let (m, by) = (field(second, 0, 4), field(second, 4, 2));
            self.push(match loads {
                true => Op::LoadAt { kind, t, n, m, by },
                false => Op::StoreAt { kind, t, n, m, by },
            });
        } else {
            let by = if field(second, 9, 1) != 0 {
                imm8 as i16
            } else {
                -(imm8 as i16)
            };
            let index = match (field(second, 10, 1), field(second, 8, 1)) {
                (1, 0) => Index::Offset,
                (1, _) => Index::Before,
                (_, 0) => return None,
                _ => Index::Behind,
            };
            let indexed = Indexed {
                kind,
                t,
                n,
                index,
                by,
            };
            match (index, loads) {
                (Index::Offset, _) => self.transfer(loads, kind, t, n, i32::from(by) as u32),
                (_, true) => self.push(Op::LoadIndexed(indexed)),
                (_, false) => self.push(Op::StoreIndexed(indexed)),
            }
        }
        if loads && t == PC {
            self.end(Op::JumpTo { m: PC });
        }
        Some(())
    }

    /// Shifts by a register, extensions, bits in another order (ARMv7-M tables A5-23 to A5-27).
    fn registers(&mut self, first: u16, second: u16) -> Option<()> {
        let (d, n, m) = (field(second, 8, 4), field(first, 0, 4), field(second, 0, 4));
        let (op, low) = (field(first, 4, 4), field(second, 4, 4));
        self.push(match (op, low) {
            (0..=7, 0) => {
                let shift = [Shift::Lsl, Shift::Lsr, Shift::Asr, Shift::Ror];
                let shift = *shift.get(usize::from(op >> 1))?;
                match op & 1 {
                    0 => Op::ShiftBy { shift, d, n, m },
                    _ => Op::ShiftsBy { shift, d, n, m },
                }
            }
            (0 | 1 | 4 | 5, 8..=11) if n == PC => {
                let kind = kind_of(u8::from(op < 4), op & 1 == 0)?;
                Op::Extend {
                    kind,
                    d,
                    m,
                    by: 8 * (low & 3),
                }
            }
            (9, 8) => Op::Bits {
                bits: Bits::Rev,
                d,
                m,
            },
            (9, 9) => Op::Bits {
                bits: Bits::Rev16,
                d,
                m,
            },
            (9, 10) => Op::Bits {
                bits: Bits::Rbit,
                d,
                m,
            },
            (9, 11) => Op::Bits {
                bits: Bits::Revsh,
                d,
                m,
            },
            (11, 8) => Op::Bits {
                bits: Bits::Clz,
                d,
                m,
            },
            _ => return None,
        });
        Some(())
    }

    /// Products and quotients (ARMv7-M tables A5-28 and A5-29).
    fn products(&mut self, first: u16, second: u16) -> Option<()> {
        let (n, m) = (field(first, 0, 4), field(second, 0, 4));
        let (high, d) = (field(second, 8, 4), field(second, 12, 4));
        let long = |long| {
            Op::Long(Product {
                long,
                low: d,
                high,
                n,
                m,
            })
        };
        self.push(match (field(first, 4, 4), field(second, 4, 4)) {
            (0, 0) if d == PC => Op::Mul { d: high, n, m },
            (0, 0) => Op::Mla {
                d: high,
                n,
                m,
                a: d,
            },
            (0, 1) => Op::Mls {
                d: high,
                n,
                m,
                a: d,
            },
            (8, 0) => long(Long::Smull),
            (9, 15) => Op::Sdiv { d: high, n, m },
            (10, 0) => long(Long::Umull),
            (11, 15) => Op::Udiv { d: high, n, m },
            (12, 0) => long(Long::Smlal),
            (14, 0) => long(Long::Umlal),
            _ => return None,
        });
        Some(())
    }
}

/// The twelve bits of a constant.
fn imm12(first: u16, second: u16) -> u16 {
    (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xFF
}
