//! What an instruction does, decoded once and executed often.
//!
//! Registers are numbers: 0 to 15, [`ZERO`] that reads as 0 and [`NOWHERE`] for a result that only
//! sets flags. Offsets wrap: what is subtracted is added as its complement. Some entries are no
//! instruction by themselves; they stand before or behind that of another one. Others are two
//! instructions that often stand side by side, since each entry costs a branch of the host.
//!
//! Sources: ARMv7-M A7.7. Left out: the bits of an instruction ([`decode`](super::decode)).

/// A register that reads as 0.
pub const ZERO: u8 = 16;
/// A register that nobody reads.
pub const NOWHERE: u8 = 17;
/// The stack pointer.
pub const SP: u8 = 13;
/// The link register.
pub const LR: u8 = 14;
/// The program counter: read after [`Op::SetPc`], written before [`Op::JumpPc`].
pub const PC: u8 = 15;

/// A register's number.
type Reg = u8;

/// What two operands become (ARMv7-M A5.3.1, A5.3.11). MOV is ORR of [`ZERO`], MVN its ORN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alu {
    And,
    Bic,
    Orr,
    Orn,
    Eor,
    Add,
    Adc,
    Sbc,
    Sub,
    Rsb,
}

/// How a register is shifted (ARMv7-M A7.4.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shift {
    Lsl,
    Lsr,
    Asr,
    Ror,
    /// Right by one, the carry coming in.
    Rrx,
}

/// What is loaded or stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Word,
    Half,
    Byte,
    SignedHalf,
    SignedByte,
}

/// When an address is changed by its offset, and whether the base keeps it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Index {
    /// Before, and it does not.
    Offset,
    /// Before, and it does.
    Before,
    /// Behind, and it does.
    Behind,
}

/// Products of 64 bits (ARMv7-M A5.3.17).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Long {
    Smull,
    Umull,
    Smlal,
    Umlal,
}

/// Bytes and bits of a register in another order (ARMv7-M A5.3.15).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bits {
    Clz,
    Rbit,
    Rev,
    Rev16,
    Revsh,
}

/// Two operands, of which the second is shifted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shifted {
    pub alu: Alu,
    pub d: Reg,
    pub n: Reg,
    pub m: Reg,
    pub shift: Shift,
    pub by: u8,
}

/// Two operands, of which the second is shifted in a way that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placed {
    pub alu: Alu,
    pub d: Reg,
    pub n: Reg,
    pub m: Reg,
    pub by: u8,
}

/// A product of 64 bits: what it becomes, and its factors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Product {
    pub long: Long,
    pub low: Reg,
    pub high: Reg,
    pub n: Reg,
    pub m: Reg,
}

/// A load or store that changes its base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Indexed {
    pub kind: Kind,
    pub t: Reg,
    pub n: Reg,
    pub index: Index,
    pub by: i16,
}

/// A load or store of two words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Two {
    pub t: Reg,
    pub second: Reg,
    pub n: Reg,
    pub index: Index,
    pub by: i16,
}

/// Registers that are loaded or stored together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Many {
    pub n: Reg,
    /// They end below n, and do not begin at it.
    pub down: bool,
    /// The base becomes the other end.
    pub keeps: bool,
    /// How many they are.
    pub count: u8,
    /// Bit n for register n.
    pub mask: u16,
}

impl Many {
    /// The registers of `mask`, from n upwards or from below it.
    pub fn new(n: Reg, down: bool, keeps: bool, mask: u16) -> Self {
        Self {
            n,
            down,
            keeps,
            count: mask.count_ones() as u8,
            mask,
        }
    }
}

/// An instruction with its operands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// Before the entries of a block: how many these are, its instructions, and where it goes on.
    Begin {
        instructions: u8,
        entries: u16,
        end: u32,
    },
    /// So many instructions more than fit there, and where their block is; at its begin.
    More {
        instructions: u16,
        at: u32,
    },
    /// d = immediate.
    Set {
        d: Reg,
        imm: u32,
    },
    /// The same, with N and Z.
    Sets {
        d: Reg,
        imm: u32,
    },
    Move {
        d: Reg,
        m: Reg,
    },
    AddImm {
        d: Reg,
        n: Reg,
        imm: u32,
    },
    AddsImm {
        d: Reg,
        n: Reg,
        imm: u32,
    },
    SubsImm {
        d: Reg,
        n: Reg,
        imm: u32,
    },
    CmpImm {
        n: Reg,
        imm: u32,
    },
    Cmp {
        n: Reg,
        m: Reg,
    },
    Add {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Sub {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    /// d = n `alu` immediate.
    DataImm {
        alu: Alu,
        d: Reg,
        n: Reg,
        imm: u32,
    },
    /// The same with flags.
    DatasImm {
        alu: Alu,
        d: Reg,
        n: Reg,
        imm: u32,
    },
    /// d = n `alu` (m shifted).
    Data(Shifted),
    /// The same with flags.
    Datas(Shifted),
    /// d = n `alu` (m shifted by 1 to 31 places), one way and the other.
    DataLsl(Placed),
    DataLsr(Placed),
    /// d = n `alu` m, with flags.
    DatasPlain {
        alu: Alu,
        d: Reg,
        n: Reg,
        m: Reg,
    },
    /// d = n shifted by as much as m holds.
    ShiftBy {
        shift: Shift,
        d: Reg,
        n: Reg,
        m: Reg,
    },
    /// The same with flags.
    ShiftsBy {
        shift: Shift,
        d: Reg,
        n: Reg,
        m: Reg,
    },
    /// The most frequent of these by themselves: AND with an immediate, ANDS, EOR, ORR, shifts.
    AndImm {
        d: Reg,
        n: Reg,
        imm: u32,
    },
    Ands {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Eor {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Orr {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Adds {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Subs {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Lsl {
        d: Reg,
        m: Reg,
        by: u8,
    },
    Lsr {
        d: Reg,
        m: Reg,
        by: u8,
    },
    Lsls {
        d: Reg,
        m: Reg,
        by: u8,
    },
    Lsrs {
        d: Reg,
        m: Reg,
        by: u8,
    },
    /// The carry that the immediate of the next instruction has.
    Carry {
        set: bool,
    },
    /// The upper half of d.
    Movt {
        d: Reg,
        imm: u16,
    },
    Mul {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Muls {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Mla {
        d: Reg,
        n: Reg,
        m: Reg,
        a: Reg,
    },
    Mls {
        d: Reg,
        n: Reg,
        m: Reg,
        a: Reg,
    },
    Long(Product),
    Udiv {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Sdiv {
        d: Reg,
        n: Reg,
        m: Reg,
    },
    Bits {
        bits: Bits,
        d: Reg,
        m: Reg,
    },
    /// d = m rotated right, of it what `kind` has.
    Extend {
        kind: Kind,
        d: Reg,
        m: Reg,
        by: u8,
    },
    Ubfx {
        d: Reg,
        n: Reg,
        lsb: u8,
        width: u8,
    },
    Sbfx {
        d: Reg,
        n: Reg,
        lsb: u8,
        width: u8,
    },
    Bfi {
        d: Reg,
        n: Reg,
        lsb: u8,
        width: u8,
    },
    /// To so many bits; `signed`: SSAT.
    Saturate {
        signed: bool,
        d: Reg,
        n: Reg,
        to: u8,
        shift: Shift,
        by: u8,
    },
    /// t = word at an address, which is in the flash.
    Literal {
        t: Reg,
        at: u32,
    },
    /// t = word at n + immediate; the two below are bytes and half-words.
    Ldr {
        t: Reg,
        n: Reg,
        imm: u32,
    },
    Ldrb {
        t: Reg,
        n: Reg,
        imm: u32,
    },
    Ldrh {
        t: Reg,
        n: Reg,
        imm: u32,
    },
    Str {
        t: Reg,
        n: Reg,
        imm: u32,
    },
    Strb {
        t: Reg,
        n: Reg,
        imm: u32,
    },
    Strh {
        t: Reg,
        n: Reg,
        imm: u32,
    },
    LoadSigned {
        kind: Kind,
        t: Reg,
        n: Reg,
        imm: u32,
    },
    /// At n + (m << by).
    LoadAt {
        kind: Kind,
        t: Reg,
        n: Reg,
        m: Reg,
        by: u8,
    },
    StoreAt {
        kind: Kind,
        t: Reg,
        n: Reg,
        m: Reg,
        by: u8,
    },
    LoadIndexed(Indexed),
    StoreIndexed(Indexed),
    Ldrd(Two),
    Strd(Two),
    /// From n upwards, or from below n (`down`).
    Ldm(Many),
    Stm(Many),
    Ldrex {
        kind: Kind,
        t: Reg,
        n: Reg,
        imm: u16,
    },
    Strex {
        kind: Kind,
        d: Reg,
        t: Reg,
        n: Reg,
        imm: u16,
    },
    Clrex,
    Jump {
        to: u32,
    },
    JumpIf {
        when: u8,
        to: u32,
    },
    /// A comparison and the branch behind it.
    CmpImmJumpIf {
        n: Reg,
        imm: u8,
        when: u8,
        to: u32,
    },
    CmpJumpIf {
        n: Reg,
        m: Reg,
        when: u8,
        to: u32,
    },
    JumpIfZero {
        n: Reg,
        to: u32,
    },
    JumpIfNot {
        n: Reg,
        to: u32,
    },
    Call {
        to: u32,
    },
    /// BX, and behind a load of the program counter.
    JumpTo {
        m: Reg,
    },
    CallTo {
        m: Reg,
    },
    /// Behind an instruction that has written the program counter.
    JumpPc,
    /// TBB, TBH (`by` 1).
    Table {
        n: Reg,
        m: Reg,
        by: u8,
    },
    Mrs {
        d: Reg,
        special: u8,
    },
    Msr {
        n: Reg,
        special: u8,
    },
    /// CPSIE and CPSID (`disable`).
    Cps {
        disable: bool,
        primask: bool,
        faultmask: bool,
    },
    Svc,
    Wfi,
    Wfe,
    Bkpt,
    Undefined,
    /// What an IT block most often has: one of these alone, if the condition holds.
    MoveIf {
        when: u8,
        d: Reg,
        m: Reg,
    },
    SetIf {
        when: u8,
        d: Reg,
        imm: u32,
    },
    /// Two that stand side by side.
    Moves {
        d: Reg,
        m: Reg,
        second: Reg,
        from: Reg,
    },
    MoveCall {
        d: Reg,
        m: Reg,
        to: u32,
    },
    /// Registers onto the stack, `len` of them, and d = its pointer + immediate.
    Push {
        d: Reg,
        len: u8,
        mask: u16,
        imm: i16,
    },
    /// LDM, and BX; or the branch to the program counter that was among it.
    LdmJump {
        many: Many,
        m: Reg,
    },
    /// So many entries are left out unless the condition holds (IT).
    SkipUnless {
        when: u8,
        entries: u8,
    },
    /// What the program counter reads as.
    SetPc {
        to: u32,
    },
    /// Where in an IT block the code is.
    SetIt {
        it: u8,
    },
    /// An event (SEV); at the begin of its block.
    SendEvent,
}

// Every instruction that runs is fetched from here.
const _: () = assert!(size_of::<Op>() == 8);
