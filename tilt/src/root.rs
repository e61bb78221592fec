//! The square root, in words of 32 bits.
//!
//! In: a number of 64 bits. Out: its root, rounded down, exactly that of [`u64::isqrt`]. That one
//! divides 64 bits by 64, which a Cortex-M3 does in software; here two steps of Newton's method
//! find the upper half of the root, and one division the lower half (Zimmermann, "Karatsuba Square
//! Root", INRIA RR-3805).
//!
//! Left out: roots of fractions; whoever wants one shifts first.

/// The root of `value`, rounded down.
pub(crate) const fn root(value: u64) -> u32 {
    let (high, low) = ((value >> 32) as u32, value as u32);
    // An even shift brings one of the upper two bits to 1; the root then has half of it too many.
    let (top, low, shift) = if high == 0 {
        let shift = low.leading_zeros() & 30;
        (low << shift, 0, 32 + shift)
    } else {
        let shift = high.leading_zeros() & 30;
        (
            high << shift | low >> 1 >> (31 - shift),
            low << shift,
            shift,
        )
    };
    if top == 0 {
        return 0;
    }
    let root = upper(top);
    // At most twice the root, 17 bits, so that half of what is divided has 32.
    let rest = top - root * root;
    let lower = divide(rest << 15 | low >> 17, root);
    let lower = if lower > 0xFFFF { 0xFFFF } else { lower };
    let root = root << 16 | lower;
    let square = root as u64 * root as u64;
    (root - (square > (top as u64) << 32 | low as u64) as u32) >> (shift / 2)
}

/// The root of the sum of two squares, rounded down; at most `u32::MAX`.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
pub(crate) fn root_sum(a: u32, b: u32) -> u32 {
    let square = |a: u32| u64::from(a) * u64::from(a);
    root(square(a).saturating_add(square(b)))
}

/// The root of a number of 32 bits, from 2^30 on.
#[inline(always)]
const fn upper(top: u32) -> u32 {
    // The line is within 3.1 % of the root; each step squares that and halves it. Both steps end
    // at the root or above, which leaves one too many at most.
    let guess = (top >> 17) + (top >> 19) + (top >> 20) + 22_400;
    let guess = (guess + divide(top, guess)) >> 1;
    let guess = (guess + divide(top, guess)) >> 1;
    let guess = if guess > 0xFFFF { 0xFFFF } else { guess };
    guess - (guess * guess > top) as u32
}

/// Nothing here divides by zero; where the compiler does not see that, no way to a panic is left.
#[inline(always)]
const fn divide(a: u32, b: u32) -> u32 {
    match a.checked_div(b) {
        Some(quotient) => quotient,
        None => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_root_of_16_bits_begins_where_it_should() {
        for exact in 0..=u32::from(u16::MAX) {
            let square = u64::from(exact) * u64::from(exact);
            assert_eq!(root(square), exact);
            assert_eq!(root(square + 2 * u64::from(exact)), exact);
        }
    }

    #[test]
    fn roots_are_those_of_the_library() {
        let mut state = 1u64;
        for n in 0..2_000_000u32 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_041);
            let value = state >> (n % 64);
            assert_eq!(u64::from(root(value)), value.isqrt(), "{value}");
            let exact = u64::from((state >> 32) as u32 >> (n % 32));
            for near in [
                exact * exact,
                (exact * exact).wrapping_sub(1),
                exact * (exact + 2),
            ] {
                assert_eq!(u64::from(root(near)), near.isqrt(), "{near}");
            }
        }
        for value in [0, 1, 2, 3, u64::MAX, u64::MAX << 32, u64::from(u32::MAX)] {
            assert_eq!(u64::from(root(value)), value.isqrt(), "{value}");
        }
    }
}
