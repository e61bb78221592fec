//! Bytes as hexadecimal digits, two for each, and back.
//!
//! Left out: numbers, whose digits have a length of their own, and frames on a wire (`can-text`).

/// The digits of bytes in lower case.
pub fn digits(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The bytes of digits of either case; `None` for anything else.
pub fn bytes(digits: impl AsRef<[u8]>) -> Option<Vec<u8>> {
    let value = |digit: u8| char::from(digit).to_digit(16);
    let (pairs, rest) = digits.as_ref().as_chunks();
    let byte = |[high, low]: &[u8; 2]| u8::try_from(value(*high)? << 4 | value(*low)?).ok();
    rest.is_empty().then(|| pairs.iter().map(byte).collect())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_back_from_their_digits() {
        assert_eq!(digits(&[0, 0x5A, 0xFF]), "005aff");
        assert_eq!(bytes(b"005aFF"), Some(vec![0, 0x5A, 0xFF]));
        for wrong in [&b"5"[..], b"0g", b"+1", b" 1", b"\xC3\xA91", b"\xC3\xA9"] {
            assert_eq!(bytes(wrong), None);
        }
    }
}
