//! 64 bits cut off at the ends of 32.
//!
//! In: a number of 64 bits. Out: the nearest one that 32 bits hold. A Cortex-M3 has no instruction
//! for it, and two comparisons of 64 bits at each of some thirty places were 1 kB of its program.

/// The nearest number of 32 bits.
#[cfg_attr(target_pointer_width = "32", inline(never))]
pub(crate) const fn saturate(value: i64) -> i32 {
    let (low, high) = (value as i32, (value >> 32) as i32);
    // It fits if the upper half has only the sign: none, or that of a negative lower half. Written
    // as a comparison the compiler takes it for two of 64 bits, which are twice as long.
    if high.wrapping_add((low < 0) as i32) == 0 {
        low
    } else {
        (high >> 31) ^ i32::MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fits_is_kept_and_what_does_not_ends_at_the_nearer_end() {
        let ends = [0, 1, i64::from(i32::MAX), i64::from(u32::MAX), 1 << 62];
        for end in ends {
            for value in [end - 1, end, end + 1, -end - 2, -end - 1, -end, -end + 1] {
                let nearest = value.clamp(i64::from(i32::MIN), i64::from(i32::MAX));
                assert_eq!(i64::from(saturate(value)), nearest, "{value}");
            }
        }
        for value in [i64::MIN, i64::MAX] {
            let nearest = value.clamp(i64::from(i32::MIN), i64::from(i32::MAX));
            assert_eq!(i64::from(saturate(value)), nearest, "{value}");
        }
    }
}
