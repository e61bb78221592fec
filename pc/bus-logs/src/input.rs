//! The text of a log, whether it is compressed or not.
//!
//! In: a path, `-` for standard input. Out: its lines, from behind a byte order mark if it has
//! one. It is taken as gzip when its first two bytes say so, whatever the file is called.

use std::fs::File;
use std::io::{self, BufReader, Cursor, Read};
use std::path::Path;
use std::sync::Arc;

use flate2::bufread::MultiGzDecoder;

use crate::lines::{Line, Lines};
use output::progress::Task;

const GZIP: [u8; 2] = [0x1f, 0x8b];

const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

/// A log that is open.
pub struct Input {
    lines: Lines,
    is_gzip: bool,
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
        let whole: Box<dyn Read + Send> = if is_gzip {
            Box::new(MultiGzDecoder::new(BufReader::with_capacity(
                1 << 16,
                whole,
            )))
        } else {
            Box::new(whole)
        };
        let mut input = Self {
            lines: Lines::new(whole),
            is_gzip,
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
}
