//! The bus as a client sees it: a socketcand server, or a CAN interface of the kernel.
//!
//! In: frames to send, and how long to wait for one. Out: frames of the bus. A client of
//! socketcand knows the words of its raw mode: `open`, `rawmode`, `send`, `frame`.
//!
//! Left out: frames without data bytes of their own (remote), long identifiers, CAN FD.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use canopen::Frame;

/// How long the wait for a frame goes on before it is looked whether the user has enough.
const GLANCE: Duration = Duration::from_millis(50);

/// Whether the user has asked for the end, by a signal.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// From now on a signal to end lets [`Bus::receive`] fail once, with
/// [`io::ErrorKind::Interrupted`].
///
/// Errors: what the system says.
pub fn watch_signals() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed))
}

/// How long a server has for its answers while the bus is opened.
const OPENING: Duration = Duration::from_secs(5);

/// A bus that was joined.
pub enum Bus {
    /// Over TCP.
    Socketcand(Socketcand),
    /// The kernel's.
    #[cfg(target_os = "linux")]
    Kernel(socketcan::CanSocket),
}

impl Bus {
    /// Joins `ADDRESS:PORT`, `ADDRESS:PORT/NAME`, or the interface of this name.
    ///
    /// Errors: what the system says.
    pub fn join(name: &str) -> io::Result<Self> {
        let (at, bus) = name.split_once('/').unwrap_or((name, "plumb"));
        if at.contains(':') {
            return Socketcand::join(at, bus).map(Self::Socketcand);
        }
        Self::join_kernel(name)
    }

    #[cfg(target_os = "linux")]
    fn join_kernel(name: &str) -> io::Result<Self> {
        use socketcan::Socket;
        socketcan::CanSocket::open(name).map(Self::Kernel)
    }

    #[cfg(not(target_os = "linux"))]
    fn join_kernel(_: &str) -> io::Result<Self> {
        Err(io::Error::other("this system has no SocketCAN"))
    }

    /// Sends a frame with an 11-bit identifier.
    ///
    /// Errors: what the system says.
    pub fn send(&mut self, id: u16, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Socketcand(server) => server.send(id, bytes),
            #[cfg(target_os = "linux")]
            Self::Kernel(socket) => kernel::send(socket, id, bytes),
        }
    }

    /// The next frame with an 11-bit identifier; `None` when none has come until `until`.
    ///
    /// Errors: what the system says, and [`io::ErrorKind::Interrupted`] after a signal to end.
    pub fn receive(&mut self, until: Instant) -> io::Result<Option<Frame>> {
        loop {
            if INTERRUPTED.swap(false, Ordering::Relaxed) {
                return Err(io::ErrorKind::Interrupted.into());
            }
            let glance = until.min(Instant::now() + GLANCE);
            let received = self.receive_soon(glance)?;
            if received.is_some() || glance == until {
                return Ok(received);
            }
        }
    }

    fn receive_soon(&mut self, until: Instant) -> io::Result<Option<Frame>> {
        match self {
            Self::Socketcand(server) => server.receive(until),
            #[cfg(target_os = "linux")]
            Self::Kernel(socket) => kernel::receive(socket, until),
        }
    }
}

/// A connection to a socketcand server, in raw mode.
pub struct Socketcand {
    stream: TcpStream,
    /// What has come and was not looked at.
    text: Vec<u8>,
}

impl Socketcand {
    fn join(at: &str, bus: &str) -> io::Result<Self> {
        let stream = TcpStream::connect(at)?;
        stream.set_nodelay(true)?;
        let text = Vec::new();
        let mut server = Self { stream, text };
        server.expect("hi")?;
        write!(server.stream, "< open {bus} >")?;
        server.expect("ok")?;
        write!(server.stream, "< rawmode >")?;
        server.expect("ok")?;
        Ok(server)
    }

    fn expect(&mut self, wanted: &str) -> io::Result<()> {
        match self.word(Instant::now() + OPENING)? {
            Some(word) if word == wanted => Ok(()),
            Some(other) => Err(io::Error::other(format!("the server says {other:?}"))),
            None => Err(io::ErrorKind::TimedOut.into()),
        }
    }

    /// What stands between the next `<` and `>`.
    fn word(&mut self, until: Instant) -> io::Result<Option<String>> {
        loop {
            if let Some(end) = self.text.iter().position(|byte| *byte == b'>') {
                let word: Vec<u8> = self.text.drain(..=end).collect();
                let word = String::from_utf8_lossy(&word);
                let word = word.trim_matches(|c: char| "<>".contains(c) || c.is_whitespace());
                return Ok(Some(word.to_owned()));
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            self.stream.set_read_timeout(Some(left))?;
            let mut piece = [0; 4096];
            match self.stream.read(&mut piece) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.text.extend_from_slice(&piece[..count]),
                Err(error) if is_nothing(&error) => {}
                Err(error) => return Err(error),
            }
        }
    }

    fn send(&mut self, id: u16, bytes: &[u8]) -> io::Result<()> {
        let data: String = bytes.iter().map(|byte| format!("{byte:02X} ")).collect();
        let text = format!("< send {id:X} {} {data}>", bytes.len());
        self.stream.write_all(text.as_bytes())
    }

    fn receive(&mut self, until: Instant) -> io::Result<Option<Frame>> {
        while let Some(word) = self.word(until)? {
            if let Some(frame) = frame(&word) {
                return Ok(Some(frame));
            }
        }
        Ok(None)
    }
}

fn is_nothing(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}

/// The frame of `frame ID TIME DATA`, with an 11-bit identifier.
fn frame(word: &str) -> Option<Frame> {
    let mut words = word.split_whitespace();
    if words.next() != Some("frame") {
        return None;
    }
    let id = words.next().filter(|id| id.len() == 3)?;
    let id = u16::from_str_radix(id, 16).ok().filter(|id| *id < 0x800)?;
    let data = words.nth(1).unwrap_or("");
    let pairs = data.as_bytes().chunks(2);
    let bytes: Option<Vec<u8>> = pairs
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok())
        .collect();
    bytes
        .filter(|b| b.len() <= 8)
        .map(|b| Frame::data_frame(id, &b))
}

#[cfg(target_os = "linux")]
mod kernel {
    use std::io;
    use std::time::{Duration, Instant};

    use canopen::Frame;
    use socketcan::{CanFrame, CanSocket, EmbeddedFrame, Id, ShouldRetry, Socket, StandardId};

    /// How long to wait when the interface's own queue is full: eight frames at 1 Mbit/s.
    const FULL_WAIT: Duration = Duration::from_millis(1);

    /// How often a full queue is tried again.
    const TRIES: u32 = 1000;

    pub fn send(socket: &CanSocket, id: u16, bytes: &[u8]) -> io::Result<()> {
        let id = StandardId::new(id).ok_or(io::ErrorKind::InvalidInput)?;
        let frame = CanFrame::new(id, bytes).ok_or(io::ErrorKind::InvalidInput)?;
        for _ in 0..TRIES {
            match socket.write_frame(&frame) {
                Ok(()) => return Ok(()),
                Err(error) if error.should_retry() || is_full(&error) => {
                    std::thread::sleep(FULL_WAIT);
                }
                Err(error) => return Err(error),
            }
        }
        Err(io::ErrorKind::TimedOut.into())
    }

    fn is_full(error: &io::Error) -> bool {
        let full = rustix::io::Errno::NOBUFS.raw_os_error();
        error.raw_os_error() == Some(full)
    }

    pub fn receive(socket: &CanSocket, until: Instant) -> io::Result<Option<Frame>> {
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            match socket.read_frame_timeout(left) {
                Ok(CanFrame::Data(data)) => {
                    if let Id::Standard(id) = data.id() {
                        return Ok(Some(Frame::data_frame(id.as_raw(), data.data())));
                    }
                }
                Ok(_) => {}
                Err(error) if error.should_retry() => {}
                Err(error) if error.kind() == io::ErrorKind::TimedOut => return Ok(None),
                Err(error) => return Err(error),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_the_server_are_read_and_other_words_passed_over() {
        let read = frame("frame 581 12.000345 43000A").unwrap();
        assert_eq!(
            (read.cob_id(), read.bytes()),
            (Some(0x581), &[0x43, 0, 0x0A][..])
        );
        assert_eq!(frame("frame 080 1.000000").unwrap().bytes(), [0; 0]);
        for word in [
            "ok",
            "frame 18FF0001 1.0 00",
            "frame 581 1.0 0G",
            "error x",
            "",
        ] {
            assert_eq!(frame(word), None, "{word}");
        }
    }
}
