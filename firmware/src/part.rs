//! The parts that the firmware is for.
//!
//! Out: their maps, which the linker has too, and whose updates the product accepts (`build.rs`).

use device::memory::ed25519::{Ed25519, KEY};
use flash::layout::{C8, Layout, RC};

/// The map that the product's images are linked with.
pub const LAYOUT: Layout = RC;

/// The map that the paper's image is linked with.
pub const PAPER: Layout = C8;

/// Whose updates are believed (`build.rs`).
pub const SIGNATURES: Ed25519 = Ed25519 {
    key: key(env!("PLUMB_KEY").as_bytes()),
    unsigned: matches!(env!("PLUMB_UNSIGNED").as_bytes(), b"1"),
};

/// The bytes of hexadecimal digits, as many as there are; the build has looked at them.
const fn key(digits: &[u8]) -> [u8; KEY] {
    let mut key = [0; KEY];
    let mut at = 0;
    while at < KEY && 2 * at + 1 < digits.len() {
        key[at] = value(digits[2 * at]) << 4 | value(digits[2 * at + 1]);
        at += 1;
    }
    key
}

const fn value(digit: u8) -> u8 {
    match digit {
        b'0'..=b'9' => digit - b'0',
        b'a'..=b'f' => digit - b'a' + 10,
        b'A'..=b'F' => digit - b'A' + 10,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_its_digits() {
        let mut expected = [0; KEY];
        (expected[0], expected[1], expected[31]) = (0x1F, 0xA0, 0xFE);
        let mut digits = [b'0'; 64];
        digits[..4].copy_from_slice(b"1fA0");
        digits[62..].copy_from_slice(b"fe");
        assert_eq!(key(&digits), expected);
    }
}
