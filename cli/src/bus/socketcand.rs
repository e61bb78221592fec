//! A client of socketcand, in its raw mode.
//!
//! In: the words `hi`, `ok`, `frame`, `error`. Out: `open`, `rawmode`, `send`. The words are
//! those of socketcand's protocol description.
//!
//! Left out: remote frames, for which the text has no form; the BCM, ISO-TP and control modes.

use std::io;
use std::time::{Duration, Instant};

use canopen::Frame;
use canopen::frame::{ExtendedId, Id, StandardId};

use super::intake::{self, Intake};
use super::{Received, Trouble, now_ns};
use crate::serve::hex;

/// How long a server has for its answers while the bus is opened.
const OPENING: Duration = Duration::from_secs(5);

/// A connection in raw mode.
#[derive(Debug)]
pub struct Client {
    intake: Intake,
    trouble: Trouble,
}

impl Client {
    /// Opens a bus of the server at `host:port`.
    ///
    /// Errors: what the system says; [`io::ErrorKind::InvalidData`] when the server says anything
    /// else than it should.
    pub fn join(at: &str, bus: &str) -> io::Result<Self> {
        let intake = Intake::new(Box::new(intake::connect(at)?));
        let trouble = Trouble::default();
        let mut client = Self { intake, trouble };
        client.expect("hi")?;
        client.intake.write(format!("< open {bus} >").as_bytes())?;
        client.expect("ok")?;
        client.intake.write(b"< rawmode >")?;
        client.expect("ok")?;
        Ok(client)
    }

    fn expect(&mut self, wanted: &str) -> io::Result<()> {
        match self.word(Instant::now() + OPENING)? {
            Some(word) if word == wanted.as_bytes() => Ok(()),
            Some(other) => {
                let said = String::from_utf8_lossy(other);
                let said = said.escape_debug();
                let sentence = format!("the server reports \"{said}\"");
                Err(io::Error::new(io::ErrorKind::InvalidData, sentence))
            }
            None => Err(io::ErrorKind::TimedOut.into()),
        }
    }

    /// What stands between the next `<` and `>`.
    fn word(&mut self, until: Instant) -> io::Result<Option<&[u8]>> {
        let word = self.intake.next(b">", until)?;
        Ok(word.map(|(word, _)| {
            let from = word.iter().position(|byte| *byte == b'<');
            word.get(from.map_or(0, |at| at + 1)..)
                .unwrap_or(&[])
                .trim_ascii()
        }))
    }

    /// Sends a data frame.
    ///
    /// Errors: what the system says; [`io::ErrorKind::Unsupported`] for a remote frame.
    pub fn send(&mut self, frame: &Frame) -> io::Result<()> {
        if frame.is_remote() {
            let sentence = "socketcand has no remote frames: take SLCAN or socketcan";
            return Err(io::Error::new(io::ErrorKind::Unsupported, sentence));
        }
        let mut text = b"< send ".to_vec();
        match frame.id() {
            Id::Standard(id) => hex::put(&mut text, u32::from(id.as_raw()), 3),
            Id::Extended(id) => hex::put(&mut text, id.as_raw(), 8),
        }
        text.extend_from_slice(format!(" {} ", frame.length()).as_bytes());
        for byte in frame.bytes() {
            hex::put(&mut text, u32::from(*byte), 2);
            text.push(b' ');
        }
        text.push(b'>');
        self.intake.write(&text)
    }

    /// The next frame until then.
    ///
    /// Errors: what the system says.
    pub fn receive(&mut self, until: Instant) -> io::Result<Option<Received>> {
        loop {
            let Some(word) = self.word(until)? else {
                return Ok(None);
            };
            if let Some(received) = frame(word) {
                return Ok(Some(received));
            }
            if word.starts_with(b"error") {
                self.trouble.errors += 1;
            }
        }
    }

    /// Errors that the server has told of.
    pub const fn trouble(&self) -> Trouble {
        self.trouble
    }
}

/// The frame of `frame ID TIME DATA`.
fn frame(word: &[u8]) -> Option<Received> {
    let mut words = word
        .split(u8::is_ascii_whitespace)
        .filter(|w| !w.is_empty());
    if words.next() != Some(b"frame") {
        return None;
    }
    let id = words.next()?;
    let number = hex::number(id)?;
    let id = match id.len() {
        ..=3 => Id::Standard(StandardId::new(u16::try_from(number).ok()?)?),
        _ => Id::Extended(ExtendedId::new(number)?),
    };
    let time_ns = words.next().and_then(stamp).unwrap_or_else(now_ns);
    let bytes = hex::bytes(words.next().unwrap_or(&[]))?;
    let frame = Frame::with(id, &bytes)?;
    Some(Received { time_ns, frame })
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
    use proptest::prelude::*;

    #[test]
    fn frames_of_the_server_are_read_and_other_words_passed_over() {
        let read = frame(b"frame 581 12.000345 43000A").unwrap();
        assert_eq!(read.time_ns, 12_000_345_000);
        assert_eq!(
            (read.frame.cob_id(), read.frame.bytes()),
            (Some(0x581), &[0x43, 0, 0x0A][..])
        );
        assert_eq!(frame(b"frame 080 1.000000").unwrap().frame.bytes(), [0; 0]);
        let long = frame(b"frame 18FF0001 1.0 00").unwrap().frame;
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
            crate::serve::socketcand::put_frame(&mut text, &sent, 1_700_000_000_123_456);
            let inner = text.trim_ascii_start().strip_prefix(b"<").unwrap();
            let read = frame(inner.strip_suffix(b">").unwrap().trim_ascii()).unwrap();
            assert_eq!(
                (read.frame, read.time_ns),
                (sent, 1_700_000_000_123_456_000)
            );
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
