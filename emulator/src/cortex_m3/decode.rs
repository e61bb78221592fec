//! Turns the code of a block into entries to execute.
//!
//! In: flash, and where in it a block begins. Out: its entries, and of each the instruction that it
//! belongs to. A block ends behind a branch, behind what changes the core's state, and at the end
//! of a page of 1 kB: between two blocks interrupts are taken, never within one.
//!
//! Sources: ARMv7-M A5.2 (16 bits), A7.3.3 (IT). Instructions of 32 bits are in [`wide`]. Left out:
//! instructions of the DSP and floating-point extensions: a Cortex-M3 has none.

mod wide;

use super::op::{Alu, Bits, Kind, LR, Many, NOWHERE, Op, PC, Placed, SP, Shift, Shifted, ZERO};
use crate::code::{Block, SEV, WFE, WFI, YIELD};

/// A block does not reach beyond so many bytes that begin at a multiple of it.
const PAGE: u32 = 1 << 10;
/// A first half-word from here on begins an instruction of 32 bits (ARMv7-M A5.1).
const WIDE: u16 = 0xE800;

/// Where an entry's instruction begins in its block, bytes, and the IT state that it stands in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    pub offset: u16,
    pub it: u8,
}

/// The instructions of a block, under way.
#[derive(Debug)]
pub struct Decoder<'a> {
    bytes: &'a [u8],
    /// The address of the instruction that is decoded.
    at: u32,
    /// Where in an IT block it is.
    it: u8,
    /// Where the last instruction's entries begin, and its code in the block, bytes.
    last: (usize, u16),
    /// The instruction before stands in an IT block.
    was_in_it: bool,
    /// The last instruction of the block has been found.
    ended: bool,
    /// Where the block goes on by its last instruction, which has no entry then.
    pub to: Option<u32>,
    pub ops: Vec<Op>,
    pub places: Vec<Place>,
    pub block: Block,
    /// Bytes of the block.
    pub size: u32,
}

impl<'a> Decoder<'a> {
    /// Decodes the block that begins with `bytes` at `address`, within an IT block as `it` has it.
    pub fn decode(bytes: &'a [u8], address: u32, it: u8) -> Self {
        let mut decoder = Self {
            bytes,
            at: address,
            it,
            last: (0, 0),
            was_in_it: false,
            ended: false,
            to: None,
            ops: Vec::new(),
            places: Vec::new(),
            block: Block::default(),
            size: 0,
        };
        if it != 0 {
            decoder.push(Op::SetIt { it: 0 });
            decoder.note_places();
        }
        let page_end = (address & !(PAGE - 1)) + PAGE;
        while !decoder.ended && decoder.at < page_end {
            let Some(size) = decoder.next_size() else {
                break;
            };
            // Only the first of a block may lie in two pages.
            if decoder.size > 0 && decoder.at + size > page_end {
                break;
            }
            decoder.instruction(size);
        }
        if decoder.it != 0 {
            decoder.leave_within_it();
        }
        decoder
    }

    fn half_word(&self, offset: u32) -> Option<u16> {
        let bytes = self.bytes.get((self.size + offset) as usize..)?;
        bytes.first_chunk().map(|bytes| u16::from_le_bytes(*bytes))
    }

    /// Bytes of the next instruction; `None` behind the end of the flash.
    fn next_size(&self) -> Option<u32> {
        match self.half_word(0)? {
            WIDE.. => self.half_word(2).map(|_| 4),
            _ => Some(2),
        }
    }

    /// Decodes the next instruction, with the condition that an IT block gives it.
    fn instruction(&mut self, size: u32) {
        let [first, second] = [0, 2].map(|offset| self.half_word(offset).unwrap_or(0));
        let begin = self.ops.len();
        self.last = (begin, self.size as u16);
        let when = (self.it != 0 && first >> 8 != 0xBE).then_some(self.it >> 4);
        if let Some(when) = when {
            // How many there are is not known before.
            self.push(Op::SkipUnless { when, entries: 0 });
        }
        let before = self.it;
        match size {
            2 => self.narrow(first),
            _ => self.wide(first, second),
        }
        let entries = (self.ops.len() - begin).saturating_sub(1) as u8;
        if let Some(when) = when {
            self.set_condition(begin, when, entries);
        }
        self.note_places();
        self.was_in_it = before != 0;
        if before != 0 {
            let left = before << 1 & 0x1F;
            self.it = if before & 7 == 0 {
                0
            } else {
                before & 0xE0 | left
            };
        }
        self.block.instructions += 1;
        self.size += size;
        self.at += size;
    }

    /// The instruction whose entries begin there, so many, has this condition.
    fn set_condition(&mut self, begin: usize, when: u8, entries: u8) {
        let condition = match self.ops.get(begin + 1..) {
            Some([Op::Move { d, m }]) => Op::MoveIf { when, d: *d, m: *m },
            Some([Op::Set { d, imm }]) => {
                let (d, imm) = (*d, *imm);
                Op::SetIf { when, d, imm }
            }
            _ => Op::SkipUnless { when, entries },
        };
        if !matches!(condition, Op::SkipUnless { .. }) {
            self.ops.truncate(begin + 1);
        }
        if let Some(first) = self.ops.get_mut(begin) {
            *first = condition;
        }
    }

    /// The entries without a place belong to this instruction.
    fn note_places(&mut self) {
        let place = Place {
            offset: self.size as u16,
            it: self.it,
        };
        self.places.resize(self.ops.len(), place);
    }

    /// The block ends within an IT block: what is left of that is noted before the last
    /// instruction, which may stop the core.
    fn leave_within_it(&mut self) {
        let place = Place {
            offset: self.last.1,
            it: self.it,
        };
        self.ops.insert(self.last.0, Op::SetIt { it: self.it });
        self.places.insert(self.last.0, place);
    }

    fn push(&mut self, op: Op) {
        let joined = self.before().and_then(|before| joined(before, op));
        match (joined, self.ops.last_mut()) {
            (Some(joined), Some(before)) => *before = joined,
            _ => self.ops.push(op),
        }
    }

    /// The entry before, if none of both stands in an IT block.
    fn before(&self) -> Option<Op> {
        let is_free = !self.was_in_it && self.it == 0;
        self.ops.last().copied().filter(|_| is_free)
    }

    /// The last instruction of the block.
    fn end(&mut self, op: Op) {
        self.ended = true;
        match op {
            Op::Jump { to } if self.it == 0 => self.to = Some(to),
            _ => self.push(op),
        }
    }

    /// What the program counter reads as, in this instruction.
    fn pc(&self) -> u32 {
        self.at.wrapping_add(4)
    }

    /// Has the program counter read by what comes, if that is one of these registers.
    fn read_pc(&mut self, registers: &[u8]) {
        if registers.contains(&PC) {
            self.push(Op::SetPc { to: self.pc() });
        }
    }

    /// Branches where the instruction before has written the program counter.
    fn written(&mut self, d: u8, branch: Op) {
        if d == PC {
            self.end(branch);
        }
    }

    /// Flags are set by instructions of 16 bits outside of IT blocks only.
    fn sets_flags(&self) -> bool {
        self.it == 0
    }

    /// d = n `alu` m shifted.
    fn data(&mut self, flags: bool, alu: Alu, [d, n, m]: [u8; 3], (shift, by): (Shift, u8)) {
        let plain = shift != Shift::Rrx && by == 0;
        let moved = alu == Alu::Orr && n == ZERO;
        self.push(match (flags, alu, plain) {
            (false, _, true) if moved => Op::Move { d, m },
            (false, _, false) if moved && shift == Shift::Lsl => Op::Lsl { d, m, by },
            (true, _, false) if moved && shift == Shift::Lsl => Op::Lsls { d, m, by },
            (false, _, _) if moved && shift == Shift::Lsr => Op::Lsr { d, m, by },
            (true, _, _) if moved && shift == Shift::Lsr => Op::Lsrs { d, m, by },
            (false, Alu::Add, true) => Op::Add { d, n, m },
            (false, Alu::Sub, true) => Op::Sub { d, n, m },
            (false, Alu::Eor, true) => Op::Eor { d, n, m },
            (false, Alu::Orr, true) => Op::Orr { d, n, m },
            (true, Alu::And, true) => Op::Ands { d, n, m },
            (true, Alu::Add, true) => Op::Adds { d, n, m },
            (true, Alu::Sub, true) if d == NOWHERE => Op::Cmp { n, m },
            (true, Alu::Sub, true) => Op::Subs { d, n, m },
            (false, _, false) if shift == Shift::Lsl && by < 32 => {
                Op::DataLsl(Placed { alu, d, n, m, by })
            }
            (false, _, false) if shift == Shift::Lsr && by < 32 => {
                Op::DataLsr(Placed { alu, d, n, m, by })
            }
            (false, ..) => Op::Data(Shifted {
                alu,
                d,
                n,
                m,
                shift,
                by,
            }),
            (true, _, true) => Op::DatasPlain { alu, d, n, m },
            (true, ..) => Op::Datas(Shifted {
                alu,
                d,
                n,
                m,
                shift,
                by,
            }),
        });
    }

    /// d = n `alu` immediate.
    fn data_imm(&mut self, flags: bool, alu: Alu, [d, n]: [u8; 2], imm: u32) {
        self.push(match (flags, alu) {
            (false, Alu::Orr) if n == ZERO => Op::Set { d, imm },
            (false, Alu::And) => Op::AndImm { d, n, imm },
            (false, Alu::Add) => Op::AddImm { d, n, imm },
            (false, Alu::Sub) => {
                let imm = imm.wrapping_neg();
                Op::AddImm { d, n, imm }
            }
            (true, Alu::Orr) if n == ZERO => Op::Sets { d, imm },
            (true, Alu::Add) => Op::AddsImm { d, n, imm },
            (true, Alu::Sub) if d == NOWHERE => Op::CmpImm { n, imm },
            (true, Alu::Sub) => Op::SubsImm { d, n, imm },
            (false, _) => Op::DataImm { alu, d, n, imm },
            (true, _) => Op::DatasImm { alu, d, n, imm },
        });
    }

    fn load(&mut self, kind: Kind, t: u8, n: u8, imm: u32) {
        self.push(match kind {
            Kind::Word if n == ZERO => Op::Literal { t, at: imm },
            Kind::Word => Op::Ldr { t, n, imm },
            Kind::Half => Op::Ldrh { t, n, imm },
            Kind::Byte => Op::Ldrb { t, n, imm },
            Kind::SignedHalf | Kind::SignedByte => Op::LoadSigned { kind, t, n, imm },
        });
    }

    fn store(&mut self, kind: Kind, t: u8, n: u8, imm: u32) {
        self.push(match kind {
            Kind::Word => Op::Str { t, n, imm },
            Kind::Half | Kind::SignedHalf => Op::Strh { t, n, imm },
            Kind::Byte | Kind::SignedByte => Op::Strb { t, n, imm },
        });
    }

    /// A load or store of which a bit sets which it is.
    fn transfer(&mut self, loads: bool, kind: Kind, t: u8, n: u8, imm: u32) {
        match loads {
            true => self.load(kind, t, n, imm),
            false => self.store(kind, t, n, imm),
        }
    }

    /// An instruction of 16 bits (ARMv7-M table A5-1).
    fn narrow(&mut self, code: u16) {
        let field = |lsb: u32, width: u32| (code >> lsb & ((1 << width) - 1)) as u8;
        let imm8 = u32::from(code & 0xFF);
        let (t, far) = (field(8, 3), u32::from(field(6, 5)));
        match code >> 11 {
            0..=3 => self.shift_or_add(code),
            4 => self.data_imm(self.sets_flags(), Alu::Orr, [t, ZERO], imm8),
            5 => self.push(Op::CmpImm { n: t, imm: imm8 }),
            6 => self.data_imm(self.sets_flags(), Alu::Add, [t, t], imm8),
            7 => self.data_imm(self.sets_flags(), Alu::Sub, [t, t], imm8),
            8 if code >> 10 & 1 == 0 => self.data_processing(code),
            8 => self.high_registers(code),
            9 => self.load(Kind::Word, t, ZERO, (self.pc() & !3) + 4 * imm8),
            10 | 11 => self.register_offset(code),
            12 => self.store(Kind::Word, field(0, 3), field(3, 3), 4 * far),
            13 => self.load(Kind::Word, field(0, 3), field(3, 3), 4 * far),
            14 => self.store(Kind::Byte, field(0, 3), field(3, 3), far),
            15 => self.load(Kind::Byte, field(0, 3), field(3, 3), far),
            16 => self.store(Kind::Half, field(0, 3), field(3, 3), 2 * far),
            17 => self.load(Kind::Half, field(0, 3), field(3, 3), 2 * far),
            18 => self.store(Kind::Word, t, SP, 4 * imm8),
            19 => self.load(Kind::Word, t, SP, 4 * imm8),
            20 => self.push(Op::Set {
                d: t,
                imm: (self.pc() & !3) + 4 * imm8,
            }),
            21 => self.data_imm(false, Alu::Add, [t, SP], 4 * imm8),
            22 | 23 => self.miscellaneous(code),
            24 => {
                let mask = code & 0xFF;
                self.push(Op::Stm(Many::new(t, false, true, mask)));
            }
            25 => {
                let mask = code & 0xFF;
                let keeps = mask >> t & 1 == 0;
                self.push(Op::Ldm(Many::new(t, false, keeps, mask)));
            }
            26 | 27 => self.condition_or_call(code),
            _ => {
                let to = self.pc().wrapping_add(signed(code.into(), 11) << 1);
                self.end(Op::Jump { to });
            }
        }
    }

    /// Shifts by an immediate, sums and differences (ARMv7-M table A5-2).
    fn shift_or_add(&mut self, code: u16) {
        let field = |lsb: u32| (code >> lsb & 7) as u8;
        let (d, n, m) = (field(0), field(3), field(6));
        let (flags, by) = (self.sets_flags(), (code >> 6 & 0x1F) as u8);
        match code >> 9 {
            0..=3 => self.data(flags, Alu::Orr, [d, ZERO, n], (Shift::Lsl, by)),
            4..=7 => self.data(flags, Alu::Orr, [d, ZERO, n], (Shift::Lsr, whole(by))),
            8..=11 => self.data(flags, Alu::Orr, [d, ZERO, n], (Shift::Asr, whole(by))),
            12 => self.data(flags, Alu::Add, [d, n, m], (Shift::Lsl, 0)),
            13 => self.data(flags, Alu::Sub, [d, n, m], (Shift::Lsl, 0)),
            14 => self.data_imm(flags, Alu::Add, [d, n], m.into()),
            _ => self.data_imm(flags, Alu::Sub, [d, n], m.into()),
        }
    }

    /// Two low registers (ARMv7-M table A5-3).
    fn data_processing(&mut self, code: u16) {
        let (d, m) = ((code & 7) as u8, (code >> 3 & 7) as u8);
        let flags = self.sets_flags();
        let plain = (Shift::Lsl, 0);
        let mut shift = |shift| {
            self.push(match flags {
                true => Op::ShiftsBy { shift, d, n: d, m },
                false => Op::ShiftBy { shift, d, n: d, m },
            });
        };
        match code >> 6 & 15 {
            2 => shift(Shift::Lsl),
            3 => shift(Shift::Lsr),
            4 => shift(Shift::Asr),
            7 => shift(Shift::Ror),
            0 => self.data(flags, Alu::And, [d, d, m], plain),
            1 => self.data(flags, Alu::Eor, [d, d, m], plain),
            5 => self.data(flags, Alu::Adc, [d, d, m], plain),
            6 => self.data(flags, Alu::Sbc, [d, d, m], plain),
            8 => self.data(true, Alu::And, [NOWHERE, d, m], plain),
            9 => self.data_imm(flags, Alu::Rsb, [d, m], 0),
            10 => self.data(true, Alu::Sub, [NOWHERE, d, m], plain),
            11 => self.data(true, Alu::Add, [NOWHERE, d, m], plain),
            12 => self.data(flags, Alu::Orr, [d, d, m], plain),
            13 if flags => self.push(Op::Muls { d, n: m, m: d }),
            13 => self.push(Op::Mul { d, n: m, m: d }),
            14 => self.data(flags, Alu::Bic, [d, d, m], plain),
            _ => self.data(flags, Alu::Orn, [d, ZERO, m], plain),
        }
    }

    /// Any register, and branches to one (ARMv7-M table A5-4).
    fn high_registers(&mut self, code: u16) {
        let (d, m) = ((code >> 4 & 8 | code & 7) as u8, (code >> 3 & 15) as u8);
        match code >> 8 & 3 {
            0 => {
                self.read_pc(&[d, m]);
                self.push(Op::Add { d, n: d, m });
                self.written(d, Op::JumpPc);
            }
            1 => {
                self.read_pc(&[d, m]);
                self.push(Op::Cmp { n: d, m });
            }
            2 => {
                self.read_pc(&[m]);
                self.push(Op::Move { d, m });
                self.written(d, Op::JumpPc);
            }
            _ => {
                self.read_pc(&[m]);
                let links = code >> 7 & 1 != 0;
                self.end(if links {
                    Op::CallTo { m }
                } else {
                    Op::JumpTo { m }
                });
            }
        }
    }

    /// Loads and stores at the sum of two registers (ARMv7-M table A5-5).
    fn register_offset(&mut self, code: u16) {
        let field = |lsb: u32| (code >> lsb & 7) as u8;
        let (t, n, m, by) = (field(0), field(3), field(6), 0);
        let store = |kind| Op::StoreAt { kind, t, n, m, by };
        let load = |kind| Op::LoadAt { kind, t, n, m, by };
        self.push(match code >> 9 & 7 {
            0 => store(Kind::Word),
            1 => store(Kind::Half),
            2 => store(Kind::Byte),
            3 => load(Kind::SignedByte),
            4 => load(Kind::Word),
            5 => load(Kind::Half),
            6 => load(Kind::Byte),
            _ => load(Kind::SignedHalf),
        });
    }

    /// ARMv7-M table A5-6.
    fn miscellaneous(&mut self, code: u16) {
        let (d, m) = ((code & 7) as u8, (code >> 3 & 7) as u8);
        let extend = |kind| Op::Extend { kind, d, m, by: 0 };
        let reorder = |bits| Op::Bits { bits, d, m };
        let imm7 = 4 * u32::from(code & 0x7F);
        match code >> 6 & 0x3F {
            0 | 1 => self.data_imm(false, Alu::Add, [SP, SP], imm7),
            2 | 3 => self.data_imm(false, Alu::Sub, [SP, SP], imm7),
            4..=7 | 12..=15 | 36..=39 | 44..=47 => self.compare_and_branch(code),
            8 => self.push(extend(Kind::SignedHalf)),
            9 => self.push(extend(Kind::SignedByte)),
            10 => self.push(extend(Kind::Half)),
            11 => self.push(extend(Kind::Byte)),
            16..=23 => {
                let mask = code & 0xFF | (code >> 8 & 1) << LR;
                self.push(Op::Stm(Many::new(SP, true, true, mask)));
            }
            25 if code & 0x28 == 0x20 => {
                let (primask, faultmask) = (code & 2 != 0, code & 1 != 0);
                let disable = code & 0x10 != 0;
                self.end(Op::Cps {
                    disable,
                    primask,
                    faultmask,
                });
            }
            40 => self.push(reorder(Bits::Rev)),
            41 => self.push(reorder(Bits::Rev16)),
            43 => self.push(reorder(Bits::Revsh)),
            48..=55 => {
                let mask = code & 0xFF | (code >> 8 & 1) << PC;
                self.push(Op::Ldm(Many::new(SP, false, true, mask)));
                self.written(if mask >> PC != 0 { PC } else { d }, Op::JumpTo { m: PC });
            }
            56..=59 => self.end(Op::Bkpt),
            60..=63 => self.it_or_hint(code),
            _ => self.end(Op::Undefined),
        }
    }

    /// CBZ and CBNZ.
    fn compare_and_branch(&mut self, code: u16) {
        let n = (code & 7) as u8;
        let far = u32::from(code >> 3 & 0x1F) * 2 + u32::from(code >> 9 & 1) * 64;
        let to = self.pc().wrapping_add(far);
        match code >> 11 & 1 {
            0 => self.end(Op::JumpIfZero { n, to }),
            _ => self.end(Op::JumpIfNot { n, to }),
        }
    }

    /// IT, and what does nothing or waits (ARMv7-M table A5-7).
    fn it_or_hint(&mut self, code: u16) {
        match code {
            WFI => self.end(Op::Wfi),
            WFE => self.end(Op::Wfe),
            YIELD => self.ended = true,
            _ if code & 15 != 0 => self.it = (code & 0xFF) as u8,
            _ => self.block.sends_event |= code == SEV,
        }
    }

    /// ARMv7-M table A5-8.
    fn condition_or_call(&mut self, code: u16) {
        let to = self.pc().wrapping_add(signed(code.into(), 8) << 1);
        match (code >> 8 & 15) as u8 {
            14 => self.end(Op::Undefined),
            15 => self.end(Op::Svc),
            when => self.branch_if(when, to),
        }
    }

    /// A conditional branch, as one with the comparison before it.
    fn branch_if(&mut self, when: u8, to: u32) {
        // One that an IT block may leave out stays by itself.
        let before = self.ops.last().copied().filter(|_| !self.was_in_it);
        let joined = match before {
            Some(Op::Cmp { n, m }) => Some(Op::CmpJumpIf { n, m, when, to }),
            Some(Op::CmpImm { n, imm }) => {
                let imm = u8::try_from(imm).ok();
                imm.map(|imm| Op::CmpImmJumpIf { n, imm, when, to })
            }
            _ => None,
        };
        if joined.is_some() {
            self.ops.pop();
            self.places.pop();
        }
        self.end(joined.unwrap_or(Op::JumpIf { when, to }));
    }
}

/// Two entries as one. Of the two only the first can be refused, since both have its place.
fn joined(before: Op, op: Op) -> Option<Op> {
    Some(match (before, op) {
        (Op::Move { d, m }, Op::Move { d: second, m: from }) if second != PC => {
            Op::Moves { d, m, second, from }
        }
        (Op::Move { d, m }, Op::Call { to }) => Op::MoveCall { d, m, to },
        (Op::Ldm(many), Op::JumpTo { m }) => Op::LdmJump { many, m },
        (Op::Stm(many), Op::AddImm { d, n: SP, imm }) if is_push(many) && d != PC => {
            let Many {
                count: len, mask, ..
            } = many;
            let imm = i16::try_from(imm as i32).ok()?;
            Op::Push { d, len, mask, imm }
        }
        _ => return None,
    })
}

/// Whether it is a PUSH, of whatever registers.
fn is_push(many: Many) -> bool {
    many.n == SP && many.down && many.keeps
}

/// A shift to the right by no places is one by 32.
fn whole(by: u8) -> u8 {
    if by == 0 { 32 } else { by }
}

/// The lowest `bits` as a signed number.
fn signed(value: u32, bits: u32) -> u32 {
    ((value << (32 - bits)) as i32 >> (32 - bits)) as u32
}
