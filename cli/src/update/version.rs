//! The version of a program.
//!
//! In: the number in an image's header or in 2080h. Out: text.

/// A version as people write it.
pub fn version(number: u32) -> String {
    let [low, high, minor, major] = number.to_le_bytes();
    format!("{major}.{minor}.{}", u16::from_le_bytes([low, high]))
}
