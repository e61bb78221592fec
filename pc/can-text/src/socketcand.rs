//! A frame in the text protocol of socketcand, raw mode: text and back.
//!
//! In: a frame with its time, or the words between `<` and `>`. Out: `< frame ID TIME DATA >` of a
//! server, `< send ID LENGTH BYTES >` of a client; or the frame and its time.
//!
//! Left out: remote frames, for which the protocol has no text, and all other words of it.

use canopen::Frame;

use crate::hex;

/// The usual port of a server.
pub const PORT: u16 = 29536;

/// True for a name that can stand in `open`: a network interface's length, and no odd signs.
pub fn is_bus_name(name: &str) -> bool {
    let legal = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    (1..=15).contains(&name.len()) && name.chars().all(legal)
}

/// Appends a data frame of the bus; the time is in microseconds and shown in seconds.
pub fn put_frame(out: &mut Vec<u8>, frame: &Frame, time_us: u64) {
    if frame.is_remote() {
        return;
    }
    out.extend_from_slice(b"< frame ");
    hex::put_id(out, frame.id());
    out.push(b' ');
    put_seconds(out, time_us);
    // The space stays when no bytes follow: python-can takes the third word, empty or not.
    out.push(b' ');
    hex::put_bytes(out, frame.bytes());
    out.extend_from_slice(b" >");
}

/// Seconds with six decimals.
fn put_seconds(out: &mut Vec<u8>, time_us: u64) {
    let mut digits = [b'0'; 21];
    let mut rest = time_us;
    let mut used = 0;
    for (place, digit) in digits.iter_mut().rev().enumerate() {
        if place == 6 {
            *digit = b'.';
            continue;
        }
        if place > 7 && rest == 0 {
            break;
        }
        *digit = b'0' + (rest % 10) as u8;
        rest /= 10;
        used = place + 1;
    }
    out.extend_from_slice(&digits[digits.len() - used..]);
}

/// Appends a data frame as a client sends it.
pub fn put_send(text: &mut Vec<u8>, frame: &Frame) {
    text.extend_from_slice(b"< send ");
    hex::put_id(text, frame.id());
    text.extend_from_slice(format!(" {} ", frame.length()).as_bytes());
    for byte in frame.bytes() {
        hex::put(text, u32::from(*byte), 2);
        text.push(b' ');
    }
    text.push(b'>');
}

/// The frame of `frame ID TIME DATA`, and its time in nanoseconds where it has one.
pub fn frame(word: &[u8]) -> Option<(Frame, Option<u64>)> {
    let mut words = word
        .split(u8::is_ascii_whitespace)
        .filter(|w| !w.is_empty());
    if words.next() != Some(b"frame") {
        return None;
    }
    let id = hex::id(words.next()?)?;
    let time_ns = words.next().and_then(stamp);
    let bytes = hex::bytes(words.next().unwrap_or(&[]))?;
    let frame = Frame::with(id, &bytes)?;
    Some((frame, time_ns))
}

/// "seconds.microseconds" in nanoseconds.
fn stamp(word: &[u8]) -> Option<u64> {
    let word = std::str::from_utf8(word).ok()?;
    let (whole, part) = word.split_once('.').unwrap_or((word, ""));
    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if !digits(whole) || !digits(part) || part.len() > 9 {
        return None;
    }
    let part = format!("{part:0<9}").parse::<u64>().ok()?;
    let whole = whole.parse::<u64>().ok()?;
    whole.checked_mul(1_000_000_000)?.checked_add(part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::frame::{ExtendedId, Id};
    use proptest::prelude::*;

    #[test]
    fn frames_of_the_server_are_read_and_other_words_passed_over() {
        let (read, time_ns) = frame(b"frame 581 12.000345 43000A").unwrap();
        assert_eq!(time_ns, Some(12_000_345_000));
        assert_eq!(
            (read.cob_id(), read.bytes()),
            (Some(0x581), &[0x43, 0, 0x0A][..])
        );
        assert_eq!(frame(b"frame 080 1.000000").unwrap().0.bytes(), [0; 0]);
        let (long, _) = frame(b"frame 18FF0001 1.0 00").unwrap();
        assert_eq!(
            long.id(),
            Id::Extended(ExtendedId::new(0x18FF_0001).unwrap())
        );
        for word in ["ok", "frame 581 1.0 0G", "frame 800 1.0 00", "error x", ""] {
            assert_eq!(frame(word.as_bytes()), None, "{word}");
        }
    }

    #[test]
    fn what_plumb_serve_writes_is_read_back_with_its_time() {
        for sent in [
            Frame::data_frame(0x80, &[]),
            Frame::data_frame(0x7FF, &[1, 2, 3, 4, 5, 6, 7, 8]),
            Frame::with(ExtendedId::new(0x181).unwrap(), &[9]).unwrap(),
        ] {
            let mut text = Vec::new();
            put_frame(&mut text, &sent, 1_700_000_000_123_456);
            let inner = text.trim_ascii_start().strip_prefix(b"<").unwrap();
            let read = frame(inner.strip_suffix(b">").unwrap().trim_ascii()).unwrap();
            assert_eq!(read, (sent, Some(1_700_000_000_123_456_000)));
        }
    }

    proptest! {
        #[test]
        fn any_word_is_a_frame_or_none(word in prop::collection::vec(any::<u8>(), 0..60)) {
            let _ = frame(&word);
            let _ = frame(&[b"frame ", &word[..]].concat());
        }
    }
}
