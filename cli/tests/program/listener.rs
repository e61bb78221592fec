//! A client of a bus of socketcand that listens.
//!
//! In: the bus. Out: its frames, with their times on the bus. What is waited for ends the wait, and
//! a limit that only a defect reaches ends the test.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// What never comes within this time on a machine that is busy with others.
pub const LIMIT: Duration = Duration::from_secs(60);

/// A frame as it was on the bus.
#[derive(Clone, Debug, PartialEq)]
pub struct Heard {
    /// Its identifier.
    pub id: u32,
    /// Its time on the bus, s.
    pub at_s: f64,
    /// Its data.
    pub data: Vec<u8>,
}

/// A client that is in raw mode.
pub struct Listener {
    stream: TcpStream,
    text: String,
}

impl Listener {
    /// Joins the bus at this address; no frame is missed from here on.
    pub fn join(bus: &str) -> Self {
        let stream = TcpStream::connect(bus).unwrap();
        let text = String::new();
        let mut listener = Self { stream, text };
        assert_eq!(listener.message(LIMIT).as_deref(), Some("< hi"));
        for command in ["< open plumb >", "< rawmode >"] {
            listener.send(command);
            assert_eq!(listener.message(LIMIT).as_deref(), Some("< ok"));
        }
        listener
    }

    /// Sends a command of socketcand.
    pub fn send(&mut self, command: &str) {
        self.stream.write_all(command.as_bytes()).unwrap();
    }

    /// The first frame with this identifier that begins so.
    pub fn hears(&mut self, id: u32, begin: &[u8]) -> Heard {
        let until = Instant::now() + LIMIT;
        while Instant::now() < until {
            let frame = self.frame(LIMIT);
            if let Some(frame) = frame.filter(|f| f.id == id && f.data.starts_with(begin)) {
                return frame;
            }
        }
        panic!("never on the bus: {id:03X}h {begin:02X?}");
    }

    /// How many frames with this identifier come, up to so many and for a moment behind them.
    pub fn counts(&mut self, id: u32, wanted: usize) -> usize {
        let (until, mut found) = (Instant::now() + LIMIT, 0);
        while found < wanted && Instant::now() < until {
            found += usize::from(self.frame(LIMIT).is_some_and(|frame| frame.id == id));
        }
        let until = Instant::now() + Duration::from_millis(300);
        while Instant::now() < until {
            let frame = self.frame(until.saturating_duration_since(Instant::now()));
            found += usize::from(frame.is_some_and(|frame| frame.id == id));
        }
        found
    }

    /// The next frame, if one comes within this time.
    pub fn frame(&mut self, time: Duration) -> Option<Heard> {
        let message = self.message(time)?;
        let words: Vec<&str> = message.split_whitespace().collect();
        let ["<", "frame", id, at_s, data @ ..] = &words[..] else {
            panic!("no frame: {message}");
        };
        let data = data.concat();
        let byte = |at| u8::from_str_radix(&data[at..at + 2], 16).unwrap();
        Some(Heard {
            id: u32::from_str_radix(id, 16).unwrap(),
            at_s: at_s.parse().unwrap(),
            data: (0..data.len()).step_by(2).map(byte).collect(),
        })
    }

    /// What stands before the next `>`.
    fn message(&mut self, time: Duration) -> Option<String> {
        let until = Instant::now() + time;
        loop {
            if let Some((message, rest)) = self.text.split_once('>') {
                let message = message.trim().to_owned();
                self.text = rest.to_owned();
                return Some(message);
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            self.stream.set_read_timeout(Some(left)).unwrap();
            let mut bytes = [0; 4096];
            if let Ok(count) = self.stream.read(&mut bytes) {
                assert!(count > 0, "the bus has ended");
                self.text += std::str::from_utf8(&bytes[..count]).unwrap();
            }
        }
    }
}
