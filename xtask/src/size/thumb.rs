//! Thumb-2 instructions as far as a stack cares: how long they are, what they do to the stack
//! pointer, and where they go (Armv7-M Architecture Reference Manual, A7.7).
//!
//! In: halfwords. Out: an [`Instruction`]. Everything else is [`Effect::None`].
//!
//! Left out: floating point, which the part does not have, and a stack pointer that is computed
//! at run time, which compiled Rust does not use.

/// What an instruction does that matters here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Nothing that matters.
    None,
    /// The stack grows by so many bytes.
    Grow(u32),
    /// The stack shrinks by so many bytes.
    Shrink(u32),
    /// Takes registers off the stack, the program counter among them: a return.
    Return,
    /// Goes somewhere and may come on, too: a branch on a condition; to this address.
    Branch(u32),
    /// Goes to this address and nowhere else.
    Jump(u32),
    /// Calls the function at this address.
    Call(u32),
    /// Calls a function whose address is in a register.
    CallRegister,
    /// Goes to an address that only the running program has: a return by register, or a table of
    /// branches.
    Leave,
    /// The next so many instructions are conditional.
    Conditional(u32),
}

/// One instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Length in bytes, 2 or 4.
    pub length: u32,
    /// What it does.
    pub effect: Effect,
}

/// The instruction at `address`, whose first halfword is `first`; `second` is the next one.
pub fn decode(address: u32, first: u16, second: u16) -> Instruction {
    let (first, second) = (u32::from(first), u32::from(second));
    if first >> 11 >= 0b11101 {
        Instruction {
            length: 4,
            effect: wide(address, first, second),
        }
    } else {
        Instruction {
            length: 2,
            effect: narrow(address, first),
        }
    }
}

/// Sign-extends the lowest `bits` of `number`.
const fn extended(number: u32, bits: u32) -> u32 {
    let shift = 32 - bits;
    ((number << shift).cast_signed() >> shift).cast_unsigned()
}

fn narrow(address: u32, word: u32) -> Effect {
    // The program counter reads four bytes ahead.
    let ahead = |offset: u32| address.wrapping_add(4).wrapping_add(offset);
    match word {
        0xB400..=0xB5FF => Effect::Grow(4 * (word & 0x1FF).count_ones()),
        0xBC00..=0xBCFF => Effect::Shrink(4 * (word & 0xFF).count_ones()),
        0xBD00..=0xBDFF => Effect::Return,
        0xB080..=0xB0FF => Effect::Grow(4 * (word & 0x7F)),
        0xB000..=0xB07F => Effect::Shrink(4 * (word & 0x7F)),
        0xD000..=0xDDFF => Effect::Branch(ahead(extended(word & 0xFF, 8) << 1)),
        0xE000..=0xE7FF => Effect::Jump(ahead(extended(word & 0x7FF, 11) << 1)),
        // CBZ and CBNZ.
        _ if word & 0xF500 == 0xB100 => {
            Effect::Branch(ahead((word >> 9 & 1) << 6 | (word >> 3 & 0x1F) << 1))
        }
        // IT: one to four instructions, told by the lowest bit set.
        0xBF00..=0xBFFF if word & 0xF != 0 => {
            Effect::Conditional(4 - (word & 0xF).trailing_zeros())
        }
        0x4700..=0x477F => Effect::Leave,
        0x4780..=0x47FF => Effect::CallRegister,
        _ => Effect::None,
    }
}

fn wide(address: u32, first: u32, second: u32) -> Effect {
    if first >> 11 == 0b11110 && second >> 15 == 1 {
        return branch(address, first, second);
    }
    let byte = second & 0xFF;
    match first {
        0xE92D => Effect::Grow(4 * second.count_ones()),
        0xE8BD if second >> 15 == 1 => Effect::Return,
        0xE8BD => Effect::Shrink(4 * second.count_ones()),
        // STR and LDR of one register, STRD and LDRD of two, with the stack pointer written back.
        0xF84D if second & 0xF00 == 0xD00 => Effect::Grow(byte),
        0xF85D if second & 0xFF00 == 0xFB00 => Effect::Return,
        0xF85D if second & 0xF00 == 0xB00 => Effect::Shrink(byte),
        0xE96D => Effect::Grow(4 * byte),
        0xE8FD => Effect::Shrink(4 * byte),
        0xF1AD | 0xF5AD if second & 0xF00 == 0xD00 => Effect::Grow(modified(first, second)),
        0xF10D | 0xF50D if second & 0xF00 == 0xD00 => Effect::Shrink(modified(first, second)),
        0xF2AD | 0xF6AD if second & 0xF00 == 0xD00 => Effect::Grow(plain(first, second)),
        0xF20D | 0xF60D if second & 0xF00 == 0xD00 => Effect::Shrink(plain(first, second)),
        // A table of branches, or a load of the program counter.
        _ if first & 0xFFF0 == 0xE8D0 && second & 0xFFE0 == 0xF000 => Effect::Leave,
        _ if first & 0xFF70 == 0xF850 && second >> 12 == 0xF => Effect::Leave,
        _ => Effect::None,
    }
}

fn branch(address: u32, first: u32, second: u32) -> Effect {
    let ahead = |offset: u32| address.wrapping_add(4).wrapping_add(offset);
    let [sign, j1, j2] = [first >> 10, second >> 13, second >> 11].map(|bits| bits & 1);
    let low = (second & 0x7FF) << 1;
    let far = || {
        let (i1, i2) = (j1 ^ sign ^ 1, j2 ^ sign ^ 1);
        let offset = sign << 24 | i1 << 23 | i2 << 22 | (first & 0x3FF) << 12 | low;
        ahead(extended(offset, 25))
    };
    match second >> 12 & 0b101 {
        0b101 => Effect::Call(far()),
        0b001 => Effect::Jump(far()),
        // Conditions 14 and 15 are other instructions: barriers, moves to special registers.
        0b000 if first >> 7 & 7 != 7 => {
            let offset = sign << 20 | j2 << 19 | j1 << 18 | (first & 0x3F) << 12 | low;
            Effect::Branch(ahead(extended(offset, 21)))
        }
        _ => Effect::None,
    }
}

/// The 12 bits of an immediate operand, gathered.
const fn plain(first: u32, second: u32) -> u32 {
    (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xFF
}

/// A modified immediate constant (A5.3.2): a byte, repeated or rotated.
const fn modified(first: u32, second: u32) -> u32 {
    let bits = plain(first, second);
    let byte = bits & 0xFF;
    match bits >> 8 {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte << 24 | byte << 16 | byte << 8 | byte,
        _ => (0x80 | bits & 0x7F).rotate_right(bits >> 7),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The effect of an instruction at 1000h, as an assembler encodes it.
    fn effect(first: u16, second: u16) -> Effect {
        decode(0x1000, first, second).effect
    }

    #[test]
    fn what_a_prologue_takes() {
        assert_eq!(effect(0xB5F0, 0), Effect::Grow(20)); // push {r4-r7, lr}
        assert_eq!(effect(0xB083, 0), Effect::Grow(12)); // sub sp, #12
        assert_eq!(effect(0xE92D, 0x4FF0), Effect::Grow(36)); // push.w {r4-r11, lr}
        assert_eq!(effect(0xF5AD, 0x7D00), Effect::Grow(512)); // sub.w sp, sp, #512
        assert_eq!(effect(0xF2AD, 0x4D04), Effect::Grow(1028)); // subw sp, sp, #1028
        assert_eq!(effect(0xF84D, 0xED08), Effect::Grow(8)); // str lr, [sp, #-8]!
        assert_eq!(effect(0xE96D, 0x4502), Effect::Grow(8)); // strd r4, r5, [sp, #-8]!
    }

    #[test]
    fn what_an_epilogue_gives_back() {
        assert_eq!(effect(0xB003, 0), Effect::Shrink(12)); // add sp, #12
        assert_eq!(effect(0xBC30, 0), Effect::Shrink(8)); // pop {r4, r5}
        assert_eq!(effect(0xF50D, 0x7D00), Effect::Shrink(512)); // add.w sp, sp, #512
        assert_eq!(effect(0xF85D, 0xEB08), Effect::Shrink(8)); // ldr lr, [sp], #8
        assert_eq!(effect(0xE8BD, 0x4FF0), Effect::Shrink(36)); // pop.w {r4-r11, lr}
        assert_eq!(effect(0xBDF0, 0), Effect::Return); // pop {r4-r7, pc}
        assert_eq!(effect(0xE8BD, 0x8FF0), Effect::Return); // pop.w {r4-r11, pc}
        assert_eq!(effect(0x4770, 0), Effect::Leave); // bx lr
    }

    #[test]
    fn where_branches_go() {
        assert_eq!(effect(0xE7FE, 0), Effect::Jump(0x1000)); // b .
        assert_eq!(effect(0xD1FE, 0), Effect::Branch(0x1000)); // bne .
        assert_eq!(effect(0xB108, 0), Effect::Branch(0x1006)); // cbz r0, .+6
        assert_eq!(effect(0xF7FF, 0xFFFE), Effect::Call(0x1000)); // bl .
        assert_eq!(effect(0xF000, 0xF800), Effect::Call(0x1004)); // bl .+4
        assert_eq!(effect(0xF7FF, 0xBFFE), Effect::Jump(0x1000)); // b.w .
        assert_eq!(effect(0xF47F, 0xAFFE), Effect::Branch(0x1000)); // bne.w .
        assert_eq!(effect(0x4798, 0), Effect::CallRegister); // blx r3
        assert_eq!(effect(0xE8DF, 0xF001), Effect::Leave); // tbb [pc, r1]
    }

    #[test]
    fn what_looks_like_it_and_is_not() {
        assert_eq!(effect(0xB2C0, 0), Effect::None); // uxtb r0, r0
        assert_eq!(effect(0xBF00, 0), Effect::None); // nop
        assert_eq!(effect(0xF3BF, 0x8F5F), Effect::None); // dmb sy
        assert_eq!(effect(0xF84D, 0x0C04), Effect::None); // str r0, [sp, #-4]
        assert_eq!(effect(0xF1A1, 0x0108), Effect::None); // sub.w r1, r1, #8
        assert_eq!(effect(0xBF08, 0), Effect::Conditional(1)); // it eq
        assert_eq!(effect(0xBF1C, 0), Effect::Conditional(2)); // itt ne
    }

    #[test]
    fn lengths() {
        assert_eq!(decode(0, 0x4770, 0).length, 2);
        assert_eq!(decode(0, 0xE7FE, 0).length, 2);
        for first in [0xE92D, 0xF7FF, 0xF84D, 0xFFFF] {
            assert_eq!(decode(0, first, 0).length, 4);
        }
    }
}
