//! The bytes of a line that are still to be read.
//!
//! In: a line. Out: its numbers and words, or the [`Skip`] that the line has come to: cut when it
//! ends where more is needed, unreadable when something else stands there.

use canopen::Frame;
use canopen::frame::{ExtendedId, Id, StandardId};

use crate::skipped::Skip;

/// Not a hexadecimal digit, in [`HEX`].
const NONE: u8 = 0xFF;

/// The value of each hexadecimal digit.
static HEX: [u8; 256] = {
    let mut table = [NONE; 256];
    let mut value = 0;
    while value < 16 {
        table[b"0123456789ABCDEF"[value] as usize] = value as u8;
        table[b"0123456789abcdef"[value] as usize] = value as u8;
        value += 1;
    }
    table
};

/// Ten to the power of the place.
const TENS: [u64; 10] = [
    1,
    10,
    100,
    1_000,
    10_000,
    100_000,
    1_000_000,
    10_000_000,
    100_000_000,
    1_000_000_000,
];

/// The value of a digit of either base; `None` for any other character.
pub fn hex(byte: u8) -> Option<u8> {
    let value = HEX[usize::from(byte)];
    (value != NONE).then_some(value)
}

/// What is left of a line.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a>(pub &'a [u8]);

impl<'a> Cursor<'a> {
    /// True at the end of the line.
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The next byte, which stays.
    pub fn peek(&self) -> Option<u8> {
        self.0.first().copied()
    }

    /// What the line is when the next byte is not what is needed.
    pub const fn wrong(&self) -> Skip {
        if self.0.is_empty() {
            Skip::Cut
        } else {
            Skip::Unreadable
        }
    }

    /// Goes on behind this byte, which has to be the next.
    #[inline]
    pub fn expect(&mut self, byte: u8) -> Result<(), Skip> {
        match self.0 {
            [first, rest @ ..] if *first == byte => {
                self.0 = rest;
                Ok(())
            }
            _ => Err(self.wrong()),
        }
    }

    /// Goes on behind blanks and tabs.
    pub fn blanks(&mut self) {
        while let [b' ' | b'\t', rest @ ..] = self.0 {
            self.0 = rest;
        }
    }

    /// The bytes up to the next blank or the end; empty at the end.
    #[inline]
    pub fn word(&mut self) -> &'a [u8] {
        // The first condition alone decides for every byte of a word.
        let is_blank = |byte: &u8| *byte <= b' ' && matches!(byte, b' ' | b'\t');
        let end = self.0.iter().position(is_blank);
        let (word, rest) = self.0.split_at(end.unwrap_or(self.0.len()));
        self.0 = rest;
        word
    }

    /// The next word behind blanks; [`Skip::Cut`] when there is none.
    pub fn next_word(&mut self) -> Result<&'a [u8], Skip> {
        self.blanks();
        match self.word() {
            [] => Err(Skip::Cut),
            word => Ok(word),
        }
    }

    /// A decimal number and how many digits it has, of which the first 18 count.
    #[inline]
    pub fn digits(&mut self) -> (u64, usize) {
        let mut value = 0;
        let mut count = 0;
        while let [digit @ b'0'..=b'9', rest @ ..] = self.0 {
            if count < 18 {
                value = value * 10 + u64::from(digit - b'0');
            }
            count += 1;
            self.0 = rest;
        }
        (value, count)
    }

    /// Seconds with up to nine places, as ns.
    #[inline]
    pub fn seconds_ns(&mut self) -> Result<u64, Skip> {
        let (seconds, count) = self.digits();
        if count == 0 || count > 10 {
            return Err(self.wrong());
        }
        let mut part_ns = 0;
        if self.peek() == Some(b'.') {
            self.expect(b'.')?;
            let (part, places) = self.digits();
            let scale = 9_usize.checked_sub(places).and_then(|p| TENS.get(p));
            part_ns = match scale {
                Some(scale) if places > 0 => part * scale,
                _ => return Err(self.wrong()),
            };
        }
        let whole_ns = seconds.checked_mul(1_000_000_000);
        whole_ns
            .and_then(|whole| whole.checked_add(part_ns))
            .ok_or(Skip::Unreadable)
    }

    /// A number of hexadecimal digits, and how many they are, of which the last eight count.
    #[inline]
    pub fn hex_digits(&mut self) -> (u32, usize) {
        let mut value = 0_u32;
        let mut count = 0;
        // Three at a time, as nearly every identifier has them.
        if let Some((three, rest)) = self.0.split_first_chunk()
            && let [a, b, c] = three.map(|digit| u32::from(HEX[usize::from(digit)]))
            && a | b | c < 16
        {
            (value, count) = (a << 8 | b << 4 | c, 3);
            self.0 = rest;
        }
        while let [first, rest @ ..] = self.0
            && let digit @ ..16 = HEX[usize::from(*first)]
        {
            value = value << 4 | u32::from(digit);
            count += 1;
            self.0 = rest;
        }
        (value, count)
    }

    /// A byte of two hexadecimal digits; `None` when the next two bytes are not such.
    #[inline]
    pub fn hex_byte(&mut self) -> Option<u8> {
        let [high, low, rest @ ..] = self.0 else {
            return None;
        };
        let (high, low) = (HEX[usize::from(*high)], HEX[usize::from(*low)]);
        if high | low == NONE || high > 15 || low > 15 {
            return None;
        }
        self.0 = rest;
        Some(high << 4 | low)
    }
}

/// At most eight bytes of two hexadecimal digits each as a number, the first byte its lowest, and
/// how many they are; `None` when there is anything else in this text.
#[inline]
pub fn hex_bytes(text: &[u8]) -> Option<(u64, u8)> {
    let (pairs, []) = text.as_chunks::<2>() else {
        return None;
    };
    if pairs.len() > 8 {
        return None;
    }
    let (mut number, mut all) = (0, 0);
    for digits in pairs.iter().rev() {
        let [high, low] = digits.map(|digit| u64::from(HEX[usize::from(digit)]));
        all |= high | low;
        number = number << 8 | high << 4 | low;
    }
    (all < 16).then_some((number, pairs.len() as u8))
}

/// An identifier of 11 bits, or of 29 when `extended`; unreadable when it has more.
pub fn identifier(value: u32, extended: bool) -> Result<Id, Skip> {
    let id = if extended {
        ExtendedId::new(value).map(Id::Extended)
    } else {
        let short = u16::try_from(value).ok().and_then(StandardId::new);
        short.map(Id::Standard)
    };
    id.ok_or(Skip::Unreadable)
}

/// A data frame; unreadable with more than eight bytes.
pub fn data_frame(id: Id, bytes: &[u8]) -> Result<Frame, Skip> {
    Frame::with(id, bytes).ok_or(Skip::Unreadable)
}

/// A remote frame; unreadable when it asks for more than eight bytes.
pub fn remote_frame(id: Id, length: u64) -> Result<Frame, Skip> {
    let length = usize::try_from(length).unwrap_or(usize::MAX);
    Frame::remote(id, length).ok_or(Skip::Unreadable)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_of_two_digits_are_a_number_and_nothing_else_is() {
        assert_eq!(hex_bytes(b"0102fF"), Some((0xFF_0201, 3)));
        assert_eq!(hex_bytes(b""), Some((0, 0)));
        assert_eq!(hex_bytes(b"FFFFFFFFFFFFFFFF"), Some((u64::MAX, 8)));
        for other in ["1", "0g", "01.2", "01 R", "010203040506070809"] {
            assert_eq!(hex_bytes(other.as_bytes()), None, "{other}");
        }
    }

    #[test]
    fn seconds_keep_every_place_and_refuse_what_is_none() {
        let ns = |text: &str| Cursor(text.as_bytes()).seconds_ns();
        assert_eq!(ns("1700000000.123456"), Ok(1_700_000_000_123_456_000));
        assert_eq!(ns("0.000000001"), Ok(1));
        assert_eq!(ns("7"), Ok(7_000_000_000));
        assert_eq!(ns("9999999999.999999999"), Ok(9_999_999_999_999_999_999));
        assert_eq!(ns("1."), Err(Skip::Cut));
        assert_eq!(ns(""), Err(Skip::Cut));
        assert_eq!(ns("x"), Err(Skip::Unreadable));
        assert_eq!(ns("1.0000000001x"), Err(Skip::Unreadable));
        assert_eq!(ns("99999999999x"), Err(Skip::Unreadable));
    }

    #[test]
    fn a_byte_takes_both_digits_or_none() {
        for (text, value, left) in [("0Ff", Some(0x0F), 1), ("g0", None, 2), ("0", None, 1)] {
            let mut cursor = Cursor(text.as_bytes());
            assert_eq!((cursor.hex_byte(), cursor.0.len()), (value, left), "{text}");
        }
    }
}
