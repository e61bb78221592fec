//! Sums with carry, shifts with carry, saturation.
//!
//! Sources: ARMv7-M A2.2.1 (AddWithCarry, shifts), D6.5 (saturation). Left out: flags' names; the
//! caller sets which of them are kept.

use super::op::Shift;

/// a + b + carry, the carry out of it, and whether it overflows as signed numbers do.
#[inline(always)]
pub fn add(a: u32, b: u32, carry: bool) -> (u32, bool, bool) {
    let (sum, first) = a.overflowing_add(b);
    let (sum, second) = sum.overflowing_add(carry.into());
    let overflow = (a ^ sum) & (b ^ sum);
    (sum, first | second, overflow >> 31 != 0)
}

/// The same without a carry that comes in.
#[inline(always)]
pub fn sum(a: u32, b: u32) -> (u32, bool, bool) {
    let (sum, carry) = a.overflowing_add(b);
    let (_, overflow) = (a as i32).overflowing_add(b as i32);
    (sum, carry, overflow)
}

/// a - b, as a + !b + 1: the carry is that there is no borrow.
#[inline(always)]
pub fn difference(a: u32, b: u32) -> (u32, bool, bool) {
    let (difference, borrow) = a.overflowing_sub(b);
    let (_, overflow) = (a as i32).overflowing_sub(b as i32);
    (difference, !borrow, overflow)
}

/// `value` shifted, and the bit that has come out last; the carry before where none has.
///
/// By 0 to 255 places; [`Shift::Ror`] by 0 to 31.
#[inline(always)]
pub fn shifted(value: u32, shift: Shift, by: u8, carry: bool) -> (u32, bool) {
    let wide = u64::from(value);
    match shift {
        Shift::Rrx => (u32::from(carry) << 31 | value >> 1, value & 1 != 0),
        _ if by == 0 => (value, carry),
        Shift::Lsl => {
            let out = wide.checked_shl(by.into()).unwrap_or(0);
            (out as u32, out >> 32 & 1 != 0)
        }
        Shift::Lsr => {
            let out = (wide << 1).checked_shr(by.into()).unwrap_or(0);
            ((out >> 1) as u32, out & 1 != 0)
        }
        Shift::Asr => {
            let out = (i64::from(value as i32) << 1) >> by.min(32);
            ((out >> 1) as u32, out & 1 != 0)
        }
        Shift::Ror => {
            let out = value.rotate_right(by.into());
            (out, out >> 31 != 0)
        }
    }
}

/// So many ones from bit 0 on; 1 to 32.
pub fn ones(width: u8) -> u32 {
    u32::MAX >> (32 - u32::from(width))
}

/// The nearest number of so many bits: signed of 1 to 32, unsigned of 0 to 31.
pub fn saturated(value: i32, to: u8, signed: bool) -> u32 {
    let value = i64::from(value);
    let (lowest, highest) = match signed {
        true => (-(1 << (to - 1)), (1 << (to - 1)) - 1),
        false => (0, (1i64 << to) - 1),
    };
    value.clamp(lowest, highest) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_carry_and_overflow() {
        assert_eq!(add(u32::MAX, 0, true), (0, true, false));
        assert_eq!(add(0x7FFF_FFFF, 1, false), (0x8000_0000, false, true));
        // 5 - 7: no carry is a borrow.
        assert_eq!(add(5, !7, true), (0xFFFF_FFFE, false, false));
        assert_eq!(add(0x8000_0000, 0x8000_0000, false), (0, true, true));
    }

    #[test]
    fn sums_without_a_carry_are_those_with_it() {
        let values = [0, 1, 5, 0x7FFF_FFFF, 0x8000_0000, 0x8000_0001, u32::MAX];
        for (a, b) in values.iter().flat_map(|a| values.map(|b| (*a, b))) {
            assert_eq!(sum(a, b), add(a, b, false));
            assert_eq!(difference(a, b), add(a, !b, true));
        }
    }

    #[test]
    fn shifts_by_more_than_a_word() {
        let lsl = |by| shifted(0x8000_0001, Shift::Lsl, by, false);
        assert_eq!(lsl(0), (0x8000_0001, false));
        assert_eq!(lsl(1), (2, true));
        assert_eq!(lsl(32), (0, true));
        assert_eq!(lsl(33), (0, false));
        assert_eq!(lsl(200), (0, false));
        let lsr = |by| shifted(0x8000_0001, Shift::Lsr, by, false);
        assert_eq!(lsr(1), (0x4000_0000, true));
        assert_eq!(lsr(32), (0, true));
        assert_eq!(lsr(33), (0, false));
        assert_eq!(lsr(200), (0, false));
        let asr = |by| shifted(0x8000_0001, Shift::Asr, by, false);
        assert_eq!(asr(1), (0xC000_0000, true));
        assert_eq!(asr(32), (u32::MAX, true));
        assert_eq!(asr(255), (u32::MAX, true));
        assert_eq!(shifted(3, Shift::Ror, 1, false), (0x8000_0001, true));
        assert_eq!(shifted(3, Shift::Rrx, 0, true), (0x8000_0001, true));
        assert_eq!(shifted(2, Shift::Rrx, 1, false), (1, false));
    }

    #[test]
    fn saturation_keeps_what_fits() {
        assert_eq!(saturated(-129, 8, true), -128i32 as u32);
        assert_eq!(saturated(127, 8, true), 127);
        assert_eq!(saturated(i32::MIN, 32, true), i32::MIN as u32);
        assert_eq!(saturated(-1, 8, false), 0);
        assert_eq!(saturated(256, 8, false), 255);
        assert_eq!(saturated(1, 0, false), 0);
    }
}
