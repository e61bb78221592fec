//! Lines of any reader, one at a time, in a buffer that never grows.
//!
//! In: bytes. Out: each line without its line end. Of a line over [`LONGEST`] the beginning is
//! given; whoever asks for another line has the rest passed over, however long it is. Lines of logs
//! are counted in millions a second, and a bad one is no reason to stop.

use std::io::{self, Read};

/// The longest line that is read, in bytes.
pub const LONGEST: usize = 64 * 1024;

/// Bytes that are asked for at a time.
const CAPACITY: usize = 4 * LONGEST;

/// One line.
#[derive(Debug, PartialEq, Eq)]
pub enum Line<'a> {
    /// A line that has its line end.
    Whole(&'a [u8]),
    /// The last one, without a line end.
    Unended(&'a [u8]),
    /// The beginning of one that is longer than [`LONGEST`], or all of it.
    TooLong(&'a [u8]),
}

/// Reads line by line.
pub struct Lines {
    reader: Box<dyn Read + Send>,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    number: u64,
    ended: bool,
    /// Why the reader ended, to be told behind what came before.
    failed: Option<io::Error>,
    /// The line that was given last was too long, and its rest has not been passed over.
    is_inside: bool,
}

impl Lines {
    /// Lines of this reader.
    pub fn new(reader: Box<dyn Read + Send>) -> Self {
        Self {
            reader,
            buffer: vec![0; CAPACITY],
            start: 0,
            end: 0,
            number: 0,
            ended: false,
            failed: None,
            is_inside: false,
        }
    }

    /// The number of the line that was read last, counted from 1; 0 before the first.
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// What the reader begins with, at least 16 KiB of it where it has as much; nothing is taken.
    /// A reader that fails on the way fails again behind its last line.
    pub fn head(&mut self) -> io::Result<&[u8]> {
        while self.end - self.start < LONGEST / 4 && !self.ended {
            self.fill();
            if let Some(error) = &self.failed {
                return Err(copy(error));
            }
        }
        Ok(&self.buffer[self.start..self.end])
    }

    /// Passes over this many bytes of the head.
    pub fn drop_bytes(&mut self, count: usize) {
        self.start = self.end.min(self.start + count);
    }

    /// The next line, or `None` at the end.
    #[inline]
    pub fn next_line(&mut self) -> io::Result<Option<Line<'_>>> {
        if self.is_inside {
            self.pass_over();
            self.is_inside = false;
        }
        let mut scanned = 0;
        let end = loop {
            let fresh = &self.buffer[self.start + scanned..self.end];
            if let Some(at) = memchr::memchr(b'\n', fresh) {
                break self.start + scanned + at;
            }
            scanned = self.end - self.start;
            if let Some(error) = self.failed.take() {
                return Err(error);
            }
            if self.ended {
                return Ok(self.rest());
            }
            if scanned > LONGEST {
                self.is_inside = true;
                self.number += 1;
                return Ok(Some(Line::TooLong(&self.buffer[self.start..self.end])));
            }
            self.fill();
        };
        let line = &self.buffer[self.start..end];
        self.start = end + 1;
        self.number += 1;
        if line.len() > LONGEST {
            return Ok(Some(Line::TooLong(line)));
        }
        let line = match line {
            [start @ .., b'\r'] => start,
            _ => line,
        };
        Ok(Some(Line::Whole(line)))
    }

    /// What stands behind the last line end.
    fn rest(&mut self) -> Option<Line<'_>> {
        let line = &self.buffer[self.start..self.end];
        self.start = self.end;
        if line.is_empty() {
            return None;
        }
        self.number += 1;
        Some(match line.len() {
            ..=LONGEST => Line::Unended(line),
            _ => Line::TooLong(line),
        })
    }

    /// Goes on behind the next line end, wherever it is.
    fn pass_over(&mut self) {
        loop {
            let found = memchr::memchr(b'\n', &self.buffer[self.start..self.end]);
            if let Some(at) = found {
                self.start += at + 1;
                return;
            }
            self.start = self.end;
            if self.ended {
                return;
            }
            self.fill();
        }
    }

    /// Reads once, behind what has not been taken yet.
    fn fill(&mut self) {
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        let room = &mut self.buffer[self.end..];
        match self.reader.read(room) {
            Ok(0) => self.ended = true,
            Ok(count) => self.end += count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => {
                self.ended = true;
                self.failed = Some(error);
            }
        }
    }
}

fn copy(error: &io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(code) => io::Error::from_raw_os_error(code),
        None => io::Error::new(error.kind(), error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(bytes: impl Read + Send + 'static) -> Lines {
        Lines::new(Box::new(bytes))
    }

    fn all(mut lines: Lines) -> Vec<String> {
        let mut found = Vec::new();
        while let Some(line) = lines.next_line().unwrap() {
            found.push(match line {
                Line::Whole(line) => String::from_utf8_lossy(line).into_owned(),
                Line::Unended(line) => format!("{}...", String::from_utf8_lossy(line)),
                Line::TooLong(_) => "too long".to_owned(),
            });
        }
        assert_eq!(lines.number(), found.len() as u64);
        assert_eq!(lines.buffer.len(), CAPACITY, "the buffer has grown");
        found
    }

    #[test]
    fn line_ends_of_every_kind() {
        assert_eq!(all(lines(&b"a\r\nb\n\nc"[..])), ["a", "b", "", "c..."]);
        assert!(all(lines(&b""[..])).is_empty());
        assert_eq!(all(lines(&b"\n"[..])), [""]);
    }

    #[test]
    fn a_line_of_any_length_is_passed_over_and_the_next_one_read() {
        for length in [LONGEST - 1, LONGEST, LONGEST + 1, CAPACITY, 1 << 26] {
            let long = io::repeat(b'7').take(length as u64);
            let bytes = (&b"a\n"[..]).chain(long).chain(&b"\nb\n"[..]);
            let found = all(lines(bytes));
            let middle = if length > LONGEST { 8 } else { length };
            assert_eq!((found.len(), found[1].len()), (3, middle), "{length}");
            assert_eq!((found[0].as_str(), found[2].as_str()), ("a", "b"));
        }
        let endless = io::repeat(b'7').take(1 << 26);
        assert_eq!(all(lines(endless)), ["too long"]);
    }

    #[test]
    fn a_line_without_end_is_given_up_without_holding_it() {
        let mut endless = lines((&b"ab\n"[..]).chain(io::repeat(b'7')));
        assert_eq!(endless.next_line().unwrap(), Some(Line::Whole(b"ab")));
        let Some(Line::TooLong(start)) = endless.next_line().unwrap() else {
            panic!("another line");
        };
        assert!(start.iter().all(|byte| *byte == b'7'));
        assert_eq!((endless.number(), endless.buffer.len()), (2, CAPACITY));
    }

    #[test]
    fn a_reader_that_fails_while_its_head_is_read_fails_behind_its_last_line() {
        struct Fails;
        impl Read for Fails {
            fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
                Err(io::ErrorKind::InvalidData.into())
            }
        }
        let mut lines = lines((&b"ab\ncd"[..]).chain(Fails));
        assert!(lines.head().is_err());
        assert_eq!(lines.head().unwrap(), b"ab\ncd");
        assert_eq!(lines.next_line().unwrap(), Some(Line::Whole(b"ab")));
        let kind = lines.next_line().unwrap_err().kind();
        assert_eq!(kind, io::ErrorKind::InvalidData);
        assert_eq!(lines.next_line().unwrap(), Some(Line::Unended(b"cd")));
        assert_eq!(lines.next_line().unwrap(), None);
    }

    #[test]
    fn a_reader_that_gives_a_byte_at_a_time_gives_the_same_lines() {
        struct Drops(&'static [u8]);
        impl Read for Drops {
            fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
                self.0.read(&mut buffer[..1])
            }
        }
        assert_eq!(all(lines(Drops(b"ab\ncd\r\ne"))), ["ab", "cd", "e..."]);
    }
}
