//! Lines of a text file that may be compressed, one at a time and none too long.
//!
//! In: any reader. It is taken as gzip (one member or several) when its first two bytes say so,
//! whatever the file is called. What follows the last member, such as the zeros of a tape, is not
//! read, but told. Out: each line as bytes without its line end, with its number.
//! A line over [`LONGEST`] is refused before it is held in memory.

use std::cell::Cell;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::rc::Rc;

use flate2::bufread::GzDecoder;

/// The longest line that is read, in bytes.
pub const LONGEST: usize = 64 * 1024;

const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Why there is no next line.
#[derive(Debug)]
pub enum LineError {
    /// This line is longer than [`LONGEST`].
    TooLong,
    /// The gzip stream ends before its end mark.
    Truncated,
    /// The gzip stream contradicts itself: a bad header, a bad code or a bad checksum.
    Corrupt,
    /// The reader failed.
    Io(io::Error),
}

/// The text of all gzip members, one after the other.
struct Members<R> {
    /// The member under way; `None` behind the last.
    member: Option<GzDecoder<R>>,
    trailing_bytes: Rc<Cell<bool>>,
}

impl<R: BufRead> Read for Members<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while let Some(member) = &mut self.member {
            let bytes = member.read(buffer)?;
            if bytes > 0 || buffer.is_empty() {
                return Ok(bytes);
            }
            let next = member.get_mut().fill_buf()?.first().copied();
            let ended = self.member.take().map(GzDecoder::into_inner);
            if next == GZIP.first().copied() {
                self.member = ended.map(GzDecoder::new);
            } else {
                self.trailing_bytes.set(next.is_some());
            }
        }
        Ok(0)
    }
}

/// Reads line by line.
pub struct Lines<'a> {
    reader: Box<dyn BufRead + 'a>,
    gzip: bool,
    trailing_bytes: Rc<Cell<bool>>,
    line: Vec<u8>,
    number: u64,
}

impl<'a> Lines<'a> {
    /// Looks at the first two bytes and decompresses if they ask for it.
    pub fn new(mut source: impl Read + 'a) -> Result<Self, LineError> {
        let mut head = Vec::with_capacity(GZIP.len());
        source
            .by_ref()
            .take(GZIP.len() as u64)
            .read_to_end(&mut head)
            .map_err(LineError::Io)?;
        let gzip = head == GZIP;
        let whole = BufReader::new(Cursor::new(head).chain(source));
        let trailing_bytes = Rc::new(Cell::new(false));
        let reader: Box<dyn BufRead> = if gzip {
            Box::new(BufReader::new(Members {
                member: Some(GzDecoder::new(whole)),
                trailing_bytes: trailing_bytes.clone(),
            }))
        } else {
            Box::new(whole)
        };
        Ok(Self {
            reader,
            gzip,
            trailing_bytes,
            line: Vec::new(),
            number: 0,
        })
    }

    /// The number of the line that was read last, counted from 1; 0 before the first.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// True when something has been found behind the end of a gzip stream.
    pub fn has_trailing_bytes(&self) -> bool {
        self.trailing_bytes.get()
    }

    /// The next line without its `\n` or `\r\n`, or `None` at the end.
    pub fn next_line(&mut self) -> Result<Option<&[u8]>, LineError> {
        self.line.clear();
        self.number += 1;
        loop {
            let buffer = match self.reader.fill_buf() {
                Ok(buffer) => buffer,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(self.explain(error)),
            };
            if buffer.is_empty() && self.line.is_empty() {
                self.number -= 1;
                return Ok(None);
            }
            let end = buffer.iter().position(|&byte| byte == b'\n');
            let taken = end.unwrap_or(buffer.len());
            if self.line.len() + taken > LONGEST {
                return Err(LineError::TooLong);
            }
            let finished = end.is_some() || buffer.is_empty();
            self.line.extend_from_slice(&buffer[..taken]);
            self.reader.consume(taken + usize::from(end.is_some()));
            if finished {
                return Ok(Some(self.line.strip_suffix(b"\r").unwrap_or(&self.line)));
            }
        }
    }

    /// The start of the line that was given up, for a look at what kind of file it is.
    pub fn partial(&self) -> &[u8] {
        &self.line
    }

    fn explain(&self, error: io::Error) -> LineError {
        match error.kind() {
            io::ErrorKind::UnexpectedEof if self.gzip => LineError::Truncated,
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput if self.gzip => {
                LineError::Corrupt
            }
            _ => LineError::Io(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, write::GzEncoder};
    use std::io::Write;

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn all(bytes: &[u8]) -> Result<Vec<String>, LineError> {
        let mut lines = Lines::new(bytes)?;
        let mut found = Vec::new();
        while let Some(line) = lines.next_line()? {
            found.push(String::from_utf8_lossy(line).into_owned());
        }
        assert_eq!(lines.number(), found.len() as u64);
        Ok(found)
    }

    #[test]
    fn line_ends_of_every_kind() {
        assert_eq!(all(b"a\r\nb\n\nc").unwrap(), ["a", "b", "", "c"]);
        assert!(all(b"").unwrap().is_empty());
        assert_eq!(all(b"x").unwrap(), ["x"]);
        assert_eq!(all(b"\n").unwrap(), [""]);
    }

    #[test]
    fn several_gzip_members_are_one_text() {
        let bytes = [gzip(b"a\nb"), gzip(b"c\nd\n")].concat();
        assert_eq!(all(&bytes).unwrap(), ["a", "bc", "d"]);
    }

    #[test]
    fn what_follows_a_gzip_stream_is_told_and_not_read() {
        for behind in [&[0; 700][..], b"x", b"more text\n"] {
            let bytes = [&gzip(b"a\nb\n"), &gzip(b"c\n"), behind].concat();
            let mut lines = Lines::new(bytes.as_slice()).unwrap();
            let mut count = 0;
            while lines.next_line().unwrap().is_some() {
                count += 1;
            }
            assert_eq!((count, lines.has_trailing_bytes()), (3, true));
        }
        let bytes = gzip(b"a\n");
        let mut lines = Lines::new(bytes.as_slice()).unwrap();
        while lines.next_line().unwrap().is_some() {}
        assert!(!lines.has_trailing_bytes());
    }

    #[test]
    fn a_cut_or_damaged_gzip_is_told_apart() {
        let whole = gzip("one line or another\n".repeat(50).as_bytes());
        for end in 2..whole.len() {
            assert!(
                matches!(all(&whole[..end]), Err(LineError::Truncated)),
                "cut at {end}"
            );
        }
        let mut damaged = whole.clone();
        let checksum = damaged.len() - 8;
        damaged[checksum] ^= 1;
        assert!(matches!(all(&damaged), Err(LineError::Corrupt)));
    }

    #[test]
    fn a_line_without_end_is_refused_without_holding_it() {
        let endless = io::repeat(b'7');
        let mut lines = Lines::new(endless).unwrap();
        assert!(matches!(lines.next_line(), Err(LineError::TooLong)));
        assert!(lines.line.capacity() <= 2 * LONGEST);
        let longest = "7".repeat(LONGEST);
        assert_eq!(all(longest.as_bytes()).unwrap(), [longest]);
    }
}
