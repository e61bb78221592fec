//! The text of a log, whether it is compressed or not.
//!
//! In: a path, `-` for standard input. Out: its lines, from behind a byte order mark if it has
//! one. It is taken as gzip (one member or several) by its first two bytes, whatever the file
//! is called. What follows the last member, such as the zeros of a tape, is reported and not read.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use flate2::bufread::GzDecoder;

use crate::lines::{Line, Lines};
use crate::skipped::Damage;
use output::progress::Task;

const GZIP: [u8; 2] = [0x1f, 0x8b];

const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

/// A text that is open.
pub struct Input {
    lines: Lines,
    is_gzip: bool,
    trailing_bytes: Arc<AtomicBool>,
}

/// The text of all gzip members, one after the other.
struct Members<R> {
    /// The member under way; `None` behind the last.
    member: Option<GzDecoder<R>>,
    trailing_bytes: Arc<AtomicBool>,
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
                self.trailing_bytes.store(next.is_some(), Ordering::Relaxed);
            }
        }
        Ok(0)
    }
}

/// Tells a progress bar of the bytes that go by.
struct Told<R> {
    reader: R,
    task: Option<Arc<Task>>,
}

impl<R: Read> Read for Told<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.reader.read(buffer)?;
        if let Some(task) = &self.task {
            task.advance(count as u64);
        }
        Ok(count)
    }
}

/// Whether the path stands for standard input.
pub fn is_stdin(path: &Path) -> bool {
    path.as_os_str() == "-"
}

impl Input {
    /// Opens a file or standard input.
    pub fn open(path: &Path, task: Option<Arc<Task>>) -> io::Result<Self> {
        if is_stdin(path) {
            return Self::new(io::stdin(), task);
        }
        let file = File::open(path)?;
        if file.metadata()?.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        Self::new(file, task)
    }

    /// Reads from anything.
    pub fn new(reader: impl Read + Send + 'static, task: Option<Arc<Task>>) -> io::Result<Self> {
        let mut reader = Told { reader, task };
        let mut head = Vec::with_capacity(GZIP.len());
        reader
            .by_ref()
            .take(GZIP.len() as u64)
            .read_to_end(&mut head)?;
        let is_gzip = head == GZIP;
        let whole = Cursor::new(head).chain(reader);
        let trailing_bytes = Arc::new(AtomicBool::new(false));
        let whole: Box<dyn Read + Send> = if is_gzip {
            let packed = BufReader::with_capacity(1 << 16, whole);
            Box::new(Members {
                member: Some(GzDecoder::new(packed)),
                trailing_bytes: trailing_bytes.clone(),
            })
        } else {
            Box::new(whole)
        };
        let mut input = Self {
            lines: Lines::new(whole),
            is_gzip,
            trailing_bytes,
        };
        // What can't be read at once is found when the lines are.
        if matches!(input.lines.head(), Ok(head) if head.starts_with(BYTE_ORDER_MARK)) {
            input.lines.drop_bytes(BYTE_ORDER_MARK.len());
        }
        Ok(input)
    }

    /// What the text begins with; nothing is taken.
    pub fn head(&mut self) -> io::Result<&[u8]> {
        self.lines.head()
    }

    /// The next line.
    #[inline]
    pub fn next_line(&mut self) -> io::Result<Option<Line<'_>>> {
        self.lines.next_line()
    }

    /// The number of the line that was read last.
    #[inline]
    pub const fn number(&self) -> u64 {
        self.lines.number()
    }

    /// Whether it was compressed.
    pub const fn is_gzip(&self) -> bool {
        self.is_gzip
    }

    /// Whether something was found behind the end of a compressed text, asked for the first time.
    pub fn take_trailing_bytes(&self) -> bool {
        self.trailing_bytes.swap(false, Ordering::Relaxed)
    }

    /// What an error while reading means for a compressed text; `None` when it is another one.
    pub fn damage(&self, error: &io::Error) -> Option<Damage> {
        match error.kind() {
            io::ErrorKind::UnexpectedEof if self.is_gzip => Some(Damage::Cut),
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput if self.is_gzip => {
                Some(Damage::Corrupt)
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, write::GzEncoder};

    use super::*;

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn open(bytes: Vec<u8>) -> Input {
        Input::new(Cursor::new(bytes), None).unwrap()
    }

    /// Every line, or what is wrong with the compressed text.
    fn all(input: &mut Input) -> Result<Vec<String>, Option<Damage>> {
        let mut found = Vec::new();
        loop {
            match input.next_line() {
                Ok(Some(Line::Whole(line) | Line::Unended(line) | Line::TooLong(line))) => {
                    found.push(String::from_utf8_lossy(line).into_owned());
                }
                Ok(None) => return Ok(found),
                Err(error) => return Err(input.damage(&error)),
            }
        }
    }

    #[test]
    fn several_gzip_members_are_one_text() {
        let bytes = [gzip(b"a\nb"), gzip(b"c\nd\n")].concat();
        assert_eq!(all(&mut open(bytes)).unwrap(), ["a", "bc", "d"]);
    }

    #[test]
    fn what_follows_a_gzip_stream_is_told_and_not_read() {
        for behind in [&[0; 700][..], b"x", b"more text\n", b""] {
            let bytes = [&gzip(b"a\nb\n"), &gzip(b"c\n"), behind].concat();
            let mut input = open(bytes);
            assert_eq!(all(&mut input).unwrap().len(), 3);
            assert_eq!(input.take_trailing_bytes(), !behind.is_empty());
            assert!(!input.take_trailing_bytes(), "told once");
        }
    }

    #[test]
    fn a_cut_or_damaged_gzip_is_told_apart() {
        let whole = gzip("one line or another\n".repeat(50).as_bytes());
        for end in 2..whole.len() {
            let read = all(&mut open(whole[..end].to_vec()));
            assert_eq!(read, Err(Some(Damage::Cut)), "cut at {end}");
        }
        let mut damaged = whole.clone();
        let checksum = damaged.len() - 8;
        damaged[checksum] ^= 1;
        assert_eq!(all(&mut open(damaged)), Err(Some(Damage::Corrupt)));
    }
}
