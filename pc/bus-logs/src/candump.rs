//! What `candump` writes (can-utils): `candump -L`, and the form that it prints on a terminal.
//!
//! | line | what it is |
//! |---|---|
//! | `(1700000000.123456) can0 181#E803` | data frame; three digits are 11 bit, eight are 29 bit |
//! | `... 701#R`, `... 701#R1` | remote frame, with the length asked for |
//! | `... 181##1E803` | CAN FD frame, counted |
//! | `... 20000004#...` | error frame (bit 29 of the identifier), counted |
//! | `... 181#E803 R`, `... T` | received or sent, as `-x` and python-can add it |
//! | ` (0.5)  can0  181   [2]  E8 03` | the terminal's form, with or without a time |
//!
//! In: a line. Out: its time, interface and frame, or why there is none. A time of day with date
//! (`-tA`) is taken as UTC; one between frames (`-td`) can't be told from one since the start.

use canopen::Frame;
use canopen::frame::ExtendedId;

use crate::cursor::{Cursor, data_frame, hex, hex_bytes, identifier, remote_frame};
use crate::date;
use crate::skipped::Skip;

/// Bit of the identifier that marks an error frame (Linux, `CAN_ERR_FLAG`).
const ERROR_FLAG: u32 = 1 << 29;

/// Bit of the identifier that marks 29 bits where a tool has left it in (`CAN_EFF_FLAG`).
const EXTENDED_FLAG: u32 = 1 << 31;

/// Time in ns, interface and frame of a line.
pub type Entry<'a> = (u64, &'a [u8], Frame);

/// Reads a line of either form.
#[inline]
pub fn parse(line: &[u8]) -> Result<Entry<'_>, Skip> {
    if let [b'(', rest @ ..] = line {
        return log_line(Cursor(rest));
    }
    match line.first() {
        Some(b' ' | b'\t') => terminal_line(Cursor(line)),
        None | Some(b'#' | b';' | b'*') => Err(Skip::NoFrame),
        Some(_) => Err(Skip::Unreadable),
    }
}

/// What follows the bracket of `candump -L`.
#[inline]
fn log_line(mut line: Cursor<'_>) -> Result<Entry<'_>, Skip> {
    let time_ns = time(&mut line)?;
    line.expect(b' ')?;
    line.blanks();
    let interface = line.word();
    if interface.is_empty() {
        return Err(Skip::Cut);
    }
    line.expect(b' ')?;
    line.blanks();
    let start = line;
    let (value, digits) = line.hex_digits();
    // Some tools write the terminal's form behind a time without leading blanks.
    if matches!(line.peek(), Some(b' ' | b'R' | b'T')) {
        return printed(start, time_ns, interface);
    }
    line.expect(b'#')?;
    if line.peek() == Some(b'#') {
        return Err(Skip::Fd);
    }
    let extended = match digits {
        3 => false,
        8 if value & ERROR_FLAG != 0 => return Err(Skip::ErrorFrame),
        8 => true,
        _ => return Err(Skip::Unreadable),
    };
    let id = identifier(value & !EXTENDED_FLAG, extended)?;
    let frame = if line.peek() == Some(b'R') {
        line.expect(b'R')?;
        remote_frame(id, line.digits().0)?
    } else {
        data(&mut line, id)?
    };
    ending(line)?;
    Ok((time_ns, interface, frame))
}

/// Seconds or a date, and the bracket behind it.
#[inline]
fn time(line: &mut Cursor<'_>) -> Result<u64, Skip> {
    if let Some((time_ns, rest)) = usual_time(line.0) {
        line.0 = rest;
        return Ok(time_ns);
    }
    let start = *line;
    let time_ns = match line.seconds_ns() {
        Ok(time_ns) if line.peek() != Some(b'-') => time_ns,
        _ => {
            *line = start;
            dated(line)?
        }
    };
    line.expect(b')')?;
    Ok(time_ns)
}

/// Ten digits, a point, six digits and the bracket, as nearly every line has them: two times
/// eight digits without a loop.
#[inline]
fn usual_time(line: &[u8]) -> Option<(u64, &[u8])> {
    let (head, rest) = line.split_first_chunk::<18>()?;
    let [a, b, c, d, e, f, g, h, i, j, b'.', k, l, m, n, o, p, b')'] = *head else {
        return None;
    };
    let high = eight_digits([a, b, c, d, e, f, g, h])?;
    let low = eight_digits([i, j, k, l, m, n, o, p])?;
    let us = high.checked_mul(100_000_000)?.checked_add(low)?;
    Some((us.checked_mul(1000)?, rest))
}

/// The number that eight decimal digits make, all of them at a time: neighbours are put together
/// to pairs, pairs to fours and these to one.
#[inline]
fn eight_digits(digits: [u8; 8]) -> Option<u64> {
    const UPPER: u64 = 0xF0F0_F0F0_F0F0_F0F0;
    const ZEROS: u64 = 0x3030_3030_3030_3030;
    let all = u64::from_le_bytes(digits);
    let above_nine = all.wrapping_add(0x0606_0606_0606_0606);
    if all & UPPER != ZEROS || above_nine & UPPER != ZEROS {
        return None;
    }
    let ones = all & 0x0F0F_0F0F_0F0F_0F0F;
    let pairs = (ones.wrapping_mul(10) + (ones >> 8)) & 0x00FF_00FF_00FF_00FF;
    let fours = (pairs.wrapping_mul(100) + (pairs >> 16)) & 0x0000_FFFF_0000_FFFF;
    Some((fours.wrapping_mul(10_000) + (fours >> 32)) & 0xFFFF_FFFF)
}

/// `2023-11-14 22:13:20.123456`.
fn dated(line: &mut Cursor<'_>) -> Result<u64, Skip> {
    let end = line.0.iter().position(|byte| *byte == b')');
    let (text, rest) = line.0.split_at(end.ok_or(Skip::Cut)?);
    line.0 = rest;
    let text = str::from_utf8(text).map_err(|_| Skip::Unreadable)?;
    date::moment(text).ok_or(Skip::Unreadable)
}

/// Bytes of two digits, with or without a point between them, up to a blank or the end.
#[inline]
fn data(line: &mut Cursor<'_>, id: canopen::frame::Id) -> Result<Frame, Skip> {
    if let Some((number, length)) = hex_bytes(line.0) {
        line.0 = &[];
        return Ok(Frame::of_parts(id, false, length, number.to_le_bytes()));
    }
    let mut bytes = [0; 8];
    let mut length = 0;
    while let Some(byte) = line.hex_byte() {
        *bytes.get_mut(length).ok_or(Skip::Unreadable)? = byte;
        length += 1;
        if line.peek() == Some(b'.') {
            line.expect(b'.')?;
        }
    }
    // A length code above 8 (`_9` to `_F`) is still a frame of eight bytes.
    if let [b'_', b'9' | b'A'..=b'F', rest @ ..] = line.0
        && length == 8
    {
        line.0 = rest;
    }
    Ok(Frame::of_parts(id, false, length as u8, bytes))
}

/// Nothing more, or whether the frame was received or sent.
#[inline]
fn ending(mut line: Cursor<'_>) -> Result<(), Skip> {
    if line.is_empty() {
        return Ok(());
    }
    // Half a byte at the very end is what a cut leaves.
    if let [one] = line.0
        && hex(*one).is_some()
    {
        return Err(Skip::Cut);
    }
    line.blanks();
    match line.0 {
        [] | [b'R' | b'T'] => Ok(()),
        _ => Err(Skip::Unreadable),
    }
}

/// The terminal's form from the first column on.
fn terminal_line(mut line: Cursor<'_>) -> Result<Entry<'_>, Skip> {
    line.blanks();
    if line.is_empty() {
        return Err(Skip::NoFrame);
    }
    let mut time_ns = 0;
    if line.peek() == Some(b'(') {
        line.expect(b'(')?;
        time_ns = time(&mut line)?;
    }
    let interface = line.next_word()?;
    printed(line, time_ns, interface)
}

/// The terminal's form from the identifier on.
fn printed<'a>(mut line: Cursor<'a>, time_ns: u64, interface: &'a [u8]) -> Result<Entry<'a>, Skip> {
    let mut word = line.next_word()?;
    // `-x` puts direction and flags before the identifier: `RX - -`.
    if matches!(word, b"RX" | b"TX") {
        line.next_word()?;
        line.next_word()?;
        word = line.next_word()?;
    }
    let mut digits = Cursor(word);
    let (value, count) = digits.hex_digits();
    if !digits.is_empty() || !matches!(count, 3 | 8) {
        return Err(Skip::Unreadable);
    }
    if count == 8 && value & ERROR_FLAG != 0 {
        return Err(Skip::ErrorFrame);
    }
    let id = identifier(value, count == 8)?;
    let length = match line.next_word()? {
        [b'[', digit @ b'0'..=b'8', b']'] => usize::from(digit - b'0'),
        [b'[', b'0'..=b'9', b'0'..=b'9', b']'] => return Err(Skip::Fd),
        _ => return Err(Skip::Unreadable),
    };
    let mut bytes = [0; 8];
    for byte in bytes.iter_mut().take(length) {
        line.blanks();
        if line.0.starts_with(b"remote") {
            return Ok((time_ns, interface, remote_frame(id, length as u64)?));
        }
        *byte = line.hex_byte().ok_or(line.wrong())?;
    }
    line.blanks();
    if length == 0 && line.0.starts_with(b"remote") {
        return Ok((time_ns, interface, remote_frame(id, 0)?));
    }
    let bytes = bytes.get(..length).unwrap_or(&[]);
    Ok((time_ns, interface, data_frame(id, bytes)?))
}

/// A line of `candump -L`, without a line end; the time in whole us, rounded down.
pub fn line(time_ns: u64, interface: &str, frame: &Frame) -> String {
    use std::fmt::Write as _;

    let (seconds, us) = (time_ns / 1_000_000_000, time_ns / 1000 % 1_000_000);
    let mut text = format!("({seconds:010}.{us:06}) {interface} ");
    let _ = match frame.id() {
        canopen::frame::Id::Standard(id) => write!(text, "{:03X}#", id.as_raw()),
        canopen::frame::Id::Extended(id) => write!(text, "{:08X}#", ExtendedId::as_raw(&id)),
    };
    if frame.is_remote() {
        text.push('R');
        // can-utils leaves a length of 0 away.
        if frame.length() > 0 {
            let _ = write!(text, "{}", frame.length());
        }
    }
    for byte in frame.bytes() {
        let _ = write!(text, "{byte:02X}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::Frame;

    const T: u64 = 1_700_000_000_123_456_000;

    fn short(id: u16, bytes: &[u8]) -> Frame {
        Frame::data_frame(id, bytes)
    }

    fn long(id: u32, bytes: &[u8]) -> Frame {
        Frame::with(ExtendedId::new(id).unwrap(), bytes).unwrap()
    }

    fn asked(id: u16, length: usize) -> Frame {
        Frame::remote(canopen::frame::standard(id), length).unwrap()
    }

    /// Each of these lines is this frame of this time.
    fn all_are<const N: usize>(cases: [(&str, u64, Frame); N]) {
        for (line, time_ns, frame) in cases {
            let read = parse(line.as_bytes());
            assert_eq!(read, Ok((time_ns, &b"can0"[..], frame)), "{line}");
        }
    }

    #[test]
    fn frames_of_every_form_of_a_log() {
        all_are([
            (
                "(1700000000.123456) can0 181#E803",
                T,
                short(0x181, &[0xE8, 3]),
            ),
            (
                "(1700000000.123456) can0 181#e803",
                T,
                short(0x181, &[0xE8, 3]),
            ),
            ("(1700000000.123456000) can0 080#", T, short(0x80, &[])),
            ("(1700000000.123456)  can0  080#", T, short(0x80, &[])),
            (
                "(1700000000.123456) can0 181#E8.03",
                T,
                short(0x181, &[0xE8, 3]),
            ),
            (
                "(1700000000.123456) can0 181#E803 R",
                T,
                short(0x181, &[0xE8, 3]),
            ),
            ("(1700000000.123456) can0 181# T", T, short(0x181, &[])),
            ("(1700000000.123456) can0 701#R", T, asked(0x701, 0)),
            ("(1700000000.123456) can0 701#R1", T, asked(0x701, 1)),
            ("(1700000000.123456) can0 701#R1 R", T, asked(0x701, 1)),
            (
                "(1700000000.123456) can0 18DAF110#0102",
                T,
                long(0x18DA_F110, &[1, 2]),
            ),
            (
                "(1700000000.123456) can0 98DAF110#0102",
                T,
                long(0x18DA_F110, &[1, 2]),
            ),
            ("(1.5) can0 001#1122334455667788_B", 1_500_000_000, {
                short(1, &[0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88])
            }),
        ]);
    }

    #[test]
    fn frames_of_every_form_of_a_terminal() {
        all_are([
            ("  can0  181   [2]  E8 03", 0, short(0x181, &[0xE8, 3])),
            (
                " (0.5)  can0  701   [1]  remote request",
                500_000_000,
                asked(0x701, 1),
            ),
            (
                " (0.5)  can0  701   [0]  remote request",
                500_000_000,
                asked(0x701, 0),
            ),
            (
                "  can0  RX - -  181   [2]  E8 03   '..'",
                0,
                short(0x181, &[0xE8, 3]),
            ),
            (
                " (2023-11-14 22:13:20.123456)  can0  080   [0] ",
                T,
                short(0x80, &[]),
            ),
            (
                "(1700000000.123456)  can0  181   [1]  05",
                T,
                short(0x181, &[5]),
            ),
        ]);
    }

    #[test]
    fn eight_digits_at_a_time_are_the_number_that_they_spell() {
        for number in (0..100_000_000_u64).step_by(9973).chain([99_999_999]) {
            let text = format!("{number:08}");
            let digits = text.as_bytes().try_into().unwrap();
            assert_eq!(eight_digits(digits), Some(number));
        }
        for place in 0..8 {
            for byte in (0..=u8::MAX).filter(|byte| !byte.is_ascii_digit()) {
                let mut digits = *b"12345678";
                digits[place] = byte;
                assert_eq!(eight_digits(digits), None, "{digits:?}");
            }
        }
    }

    #[test]
    fn what_is_no_frame_has_a_reason() {
        let cases = [
            ("", Skip::NoFrame),
            ("   ", Skip::NoFrame),
            ("# a note", Skip::NoFrame),
            ("(1700000000.123456) can0 181##1E803", Skip::Fd),
            ("  can0  181  [12]  00 01", Skip::Fd),
            (
                "(1700000000.123456) can0 20000004#0000000000000000",
                Skip::ErrorFrame,
            ),
            (
                "  can0  20000004   [8]  00 00 00 00 00 00 00 00   ERRORFRAME",
                Skip::ErrorFrame,
            ),
            ("(", Skip::Cut),
            ("(17000", Skip::Cut),
            ("(1700000000.", Skip::Cut),
            ("(1700000000.123456", Skip::Cut),
            ("(1700000000.123456)", Skip::Cut),
            ("(1700000000.123456) can0", Skip::Cut),
            ("(1700000000.123456) can0 18", Skip::Cut),
            ("(1700000000.123456) can0 181#E80", Skip::Cut),
            ("  can0  181   [2]  E8", Skip::Cut),
            ("(1700000000.123456) can0 18#E8", Skip::Unreadable),
            ("(1700000000.123456) can0 881#E8", Skip::Unreadable),
            ("(1700000000.123456) can0 181#E8X3", Skip::Unreadable),
            (
                "(1700000000.123456) can0 181#112233445566778899",
                Skip::Unreadable,
            ),
            ("(1700000000.123456) can0 181#R9", Skip::Unreadable),
            (
                "(1700000000.12(1700000000.123456) can0 181#E803",
                Skip::Unreadable,
            ),
            ("time,ax_g,ay_g", Skip::Unreadable),
            ("\u{fffd}\u{0}", Skip::Unreadable),
        ];
        for (line, why) in cases {
            assert_eq!(parse(line.as_bytes()), Err(why), "{line}");
        }
    }
}
