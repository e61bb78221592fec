//! Bytes of a stream, cut into messages, with a time limit.
//!
//! In: a TCP connection or a serial port. Out: what stands before each delimiter. What came of a
//! message that is not complete is kept for the next time.
//!
//! Left out: what the messages mean.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

/// How long a connection may take to be made, or a write to be taken.
const PATIENCE: Duration = Duration::from_secs(5);

/// The shortest wait that a system takes for one.
const SHORTEST: Duration = Duration::from_millis(1);

/// More than any message of a known protocol: who sends so much without an end speaks another.
const LONGEST: usize = 1 << 16;

/// A stream whose reads can be limited in time.
pub trait Stream: Read + Write + Send {
    /// From now on a read ends after this time with [`io::ErrorKind::TimedOut`] or
    /// [`io::ErrorKind::WouldBlock`].
    ///
    /// Errors: what the system reports.
    fn limit_reads(&mut self, time: Duration) -> io::Result<()>;
}

impl Stream for TcpStream {
    fn limit_reads(&mut self, time: Duration) -> io::Result<()> {
        self.set_read_timeout(Some(time))
    }
}

impl Stream for Box<dyn serialport::SerialPort> {
    fn limit_reads(&mut self, time: Duration) -> io::Result<()> {
        Ok(self.set_timeout(time)?)
    }
}

/// A connection to `host:port`, of which neither making nor writing blocks for ever.
pub fn connect(at: &str) -> io::Result<TcpStream> {
    let mut failed = io::Error::from(io::ErrorKind::NotFound);
    for address in at.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                stream.set_write_timeout(Some(PATIENCE))?;
                return Ok(stream);
            }
            Err(error) => failed = error,
        }
    }
    Err(failed)
}

/// A stream, and what has come of it that nobody has looked at.
pub struct Intake {
    stream: Box<dyn Stream>,
    limit: Duration,
    bytes: Vec<u8>,
    /// Bytes in front that have been taken.
    taken: usize,
    /// Bytes in front without a delimiter.
    searched: usize,
}

impl std::fmt::Debug for Intake {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Intake").finish_non_exhaustive()
    }
}

impl Intake {
    /// Reads this stream.
    pub fn new(stream: Box<dyn Stream>) -> Self {
        Self {
            stream,
            limit: Duration::ZERO,
            bytes: Vec::new(),
            taken: 0,
            searched: 0,
        }
    }

    /// Writes all of it.
    ///
    /// Errors: what the system reports.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes)?;
        self.stream.flush()
    }

    /// What stands before the next of these delimiters, and the delimiter; `None` when none has
    /// come until `until`.
    ///
    /// Errors: what the system reports; [`io::ErrorKind::UnexpectedEof`] at the end of the stream;
    /// [`io::ErrorKind::InvalidData`] for a message without an end.
    pub fn next(&mut self, ends: &[u8], until: Instant) -> io::Result<Option<(&[u8], u8)>> {
        let mut is_first = true;
        loop {
            let rest = self.bytes.get(self.searched..).unwrap_or(&[]);
            if let Some(place) = rest.iter().position(|byte| ends.contains(byte)) {
                let (from, end) = (self.taken, self.searched + place);
                self.taken = end + 1;
                self.searched = end + 1;
                return Ok(Some((&self.bytes[from..end], self.bytes[end])));
            }
            self.searched = self.bytes.len();
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() && !is_first {
                return Ok(None);
            }
            is_first = false;
            self.fill(left.max(SHORTEST))?;
        }
    }

    /// Reads once.
    fn fill(&mut self, limit: Duration) -> io::Result<()> {
        self.bytes.drain(..self.taken);
        self.searched -= self.taken;
        self.taken = 0;
        if self.bytes.len() > LONGEST {
            let sentence = "what it sends has no end";
            return Err(io::Error::new(io::ErrorKind::InvalidData, sentence));
        }
        if self.limit != limit {
            self.stream.limit_reads(limit)?;
            self.limit = limit;
        }
        let mut piece = [0; 4096];
        match self.stream.read(&mut piece) {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                self.bytes.extend_from_slice(&piece[..count]);
                Ok(())
            }
            Err(error) if is_nothing(&error) => Ok(()),
            Err(error) => Err(error),
        }
    }
}

fn is_nothing(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    fn pair() -> (Intake, TcpStream) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let stream = connect(&listener.local_addr().unwrap().to_string()).unwrap();
        (Intake::new(Box::new(stream)), listener.accept().unwrap().0)
    }

    fn next(intake: &mut Intake) -> io::Result<Option<(Vec<u8>, u8)>> {
        let until = Instant::now() + Duration::from_millis(50);
        let found = intake.next(b"\r\x07", until)?;
        Ok(found.map(|(bytes, end)| (bytes.to_vec(), end)))
    }

    #[test]
    fn pieces_become_messages() {
        let (mut intake, mut other) = pair();
        other.write_all(b"ab\rc").unwrap();
        assert_eq!(next(&mut intake).unwrap(), Some((b"ab".to_vec(), b'\r')));
        assert_eq!(next(&mut intake).unwrap(), None);
        other.write_all(b"d\x07\r").unwrap();
        assert_eq!(next(&mut intake).unwrap(), Some((b"cd".to_vec(), 7)));
        assert_eq!(next(&mut intake).unwrap(), Some((Vec::new(), b'\r')));
        drop(other);
        let ended = next(&mut intake).unwrap_err().kind();
        assert_eq!(ended, io::ErrorKind::UnexpectedEof);
    }

    #[test]
    fn what_is_there_comes_also_when_the_time_is_over() {
        let (mut intake, mut other) = pair();
        other.write_all(b"a\r").unwrap();
        std::thread::sleep(Duration::from_millis(20));
        assert!(intake.next(b"\r", Instant::now()).unwrap().is_some());
        assert!(intake.next(b"\r", Instant::now()).unwrap().is_none());
    }

    #[test]
    fn a_message_without_an_end_is_given_up() {
        let (mut intake, mut other) = pair();
        let flood = std::thread::spawn(move || while other.write_all(&[b'x'; 4096]).is_ok() {});
        let until = Instant::now() + Duration::from_secs(20);
        let kind = intake.next(b"\r", until).unwrap_err().kind();
        assert_eq!(kind, io::ErrorKind::InvalidData);
        drop(intake);
        flood.join().unwrap();
    }
}
