//! Hexadecimal text, as both wire formats have it.
//!
//! In: numbers, bytes and identifiers, or ASCII digits of either case. Out: upper-case digits, or
//! the value.
//! Left out: signs, prefixes and separators.

use canopen::frame::{ExtendedId, Id, StandardId};

const DIGITS: &[u8; 16] = b"0123456789ABCDEF";

/// Appends the lowest `digits` hexadecimal digits of `value`.
pub fn put(out: &mut Vec<u8>, value: u32, digits: u32) {
    let places = (0..digits).rev();
    out.extend(places.map(|place| DIGITS[(value >> (4 * place) & 0xF) as usize]));
}

/// Appends two digits for each byte.
pub fn put_bytes(out: &mut Vec<u8>, bytes: &[u8]) {
    for byte in bytes {
        put(out, u32::from(*byte), 2);
    }
}

/// Appends an identifier: three digits for 11 bits, eight for 29.
pub fn put_id(out: &mut Vec<u8>, id: Id) {
    match id {
        Id::Standard(id) => put(out, u32::from(id.as_raw()), 3),
        Id::Extended(id) => put(out, id.as_raw(), 8),
    }
}

/// An identifier: up to three digits make one of 11 bits, more one of 29.
pub fn id(text: &[u8]) -> Option<Id> {
    let value = number(text)?;
    match text.len() {
        ..=3 => StandardId::new(u16::try_from(value).ok()?).map(Id::Standard),
        _ => ExtendedId::new(value).map(Id::Extended),
    }
}

/// The value of 1 to 8 digits; `None` for anything else.
pub fn number(text: &[u8]) -> Option<u32> {
    if text.is_empty() || text.len() > 8 {
        return None;
    }
    text.iter().try_fold(0, |value: u32, digit| {
        Some(value << 4 | char::from(*digit).to_digit(16)?)
    })
}

/// The bytes of pairs of digits, at most eight; `None` for anything else.
pub fn bytes(text: &[u8]) -> Option<Vec<u8>> {
    if text.len() > 16 || !text.len().is_multiple_of(2) {
        return None;
    }
    let pairs = text.chunks_exact(2).map(number);
    pairs.map(|value| u8::try_from(value?).ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_come_back_as_they_went() {
        let mut text = Vec::new();
        put(&mut text, 0x1A, 3);
        put_bytes(&mut text, &[0, 0xFE]);
        assert_eq!(text, b"01A00FE");
        assert_eq!(number(b"01a"), Some(0x1A));
        assert_eq!(bytes(b"00fE"), Some(vec![0, 0xFE]));
    }

    #[test]
    fn an_identifier_keeps_its_length() {
        for text in [&b"001"[..], b"7FF", b"00000001", b"1FFFFFFF"] {
            let mut again = Vec::new();
            put_id(&mut again, id(text).unwrap());
            assert_eq!(again, text);
        }
        for text in [&b""[..], b"800", b"20000000", b"7FG"] {
            assert_eq!(id(text), None);
        }
    }

    #[test]
    fn what_is_no_number_is_refused() {
        for text in [&b""[..], b"12G", b"+1", b"123456789", b"0x1"] {
            assert_eq!(number(text), None);
        }
        assert_eq!(bytes(b"123"), None);
        assert_eq!(bytes(&[b'0'; 18]), None);
    }
}
