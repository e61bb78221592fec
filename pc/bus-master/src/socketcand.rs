//! A client of socketcand, in its raw mode.
//!
//! In: the words `hi`, `ok`, `frame`, `error`. Out: `open`, `rawmode`, `send`. The words are
//! those of socketcand's protocol description.
//!
//! Left out: remote frames, for which the text has no form; the BCM, ISO-TP and control modes.

use std::io;
use std::time::{Duration, Instant};

use canopen::Frame;

use super::intake::{self, Intake};
use super::received::{Received, Trouble, now_ns};
use can_text::socketcand::{frame, put_send};

/// How long a server has for its answers while the bus is opened.
const OPENING: Duration = Duration::from_secs(5);

/// A connection in raw mode.
#[derive(Debug)]
pub struct Client {
    intake: Intake,
    trouble: Trouble,
    /// Frames that can't be read.
    unreadable: u64,
}

impl Client {
    /// Opens a bus of the server at `host:port`.
    ///
    /// Errors: what the system reports; [`io::ErrorKind::InvalidData`] when the server sends
    /// anything else than it should.
    pub fn join(at: &str, bus: &str) -> io::Result<Self> {
        let intake = Intake::new(Box::new(intake::connect(at)?));
        let trouble = Trouble::default();
        let mut client = Self {
            intake,
            trouble,
            unreadable: 0,
        };
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
    /// Errors: what the system reports; [`io::ErrorKind::Unsupported`] for a remote frame.
    pub fn send(&mut self, frame: &Frame) -> io::Result<()> {
        if frame.is_remote() {
            let sentence = "socketcand has no remote frames: take SLCAN or socketcan";
            return Err(io::Error::new(io::ErrorKind::Unsupported, sentence));
        }
        let mut text = Vec::new();
        put_send(&mut text, frame);
        self.intake.write(&text)
    }

    /// The next frame until then.
    ///
    /// Errors: what the system reports.
    pub fn receive(&mut self, until: Instant) -> io::Result<Option<Received>> {
        loop {
            let Some(word) = self.word(until)? else {
                return Ok(None);
            };
            if let Some((frame, time_ns)) = frame(word) {
                let time_ns = time_ns.unwrap_or_else(now_ns);
                return Ok(Some(Received { time_ns, frame }));
            }
            if word.starts_with(b"error") {
                self.trouble.errors += 1;
            } else if word.starts_with(b"frame ") {
                self.unreadable += 1;
            }
        }
    }

    /// Frames so far that can't be read.
    pub const fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// Errors that the server has told of.
    pub const fn trouble(&self) -> Trouble {
        self.trouble
    }
}
