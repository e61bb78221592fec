//! An interface of the kernel's CAN.
//!
//! In: its name, frames. Out: frames of the bus, and errors that the controller has told of.
//!
//! Left out: setting the interface up, CAN FD.

use std::io;
use std::time::{Duration, Instant};

use can_text::kernel::{FULL_WAIT, from_kernel, may_send_again, to_kernel};
use canopen::Frame;
use socketcan::{CanSocket, ShouldRetry as _, Socket as _, SocketOptions as _};

use super::received::{Received, Trouble, now_ns};

/// How often a full queue is tried again.
const TRIES: u32 = 1000;

/// The shortest wait that the kernel takes for one.
const SHORTEST: Duration = Duration::from_millis(1);

/// A socket of one interface.
#[derive(Debug)]
pub struct Client {
    socket: CanSocket,
    trouble: Trouble,
}

impl Client {
    /// Opens an interface.
    ///
    /// Errors: what the system reports.
    pub fn join(interface: &str) -> io::Result<Self> {
        let socket = CanSocket::open(interface)?;
        // Errors tell a wrong bit rate from a silent bus; a driver that has none does no harm.
        let _ = socket.set_error_filter_accept_all();
        let trouble = Trouble::default();
        Ok(Self { socket, trouble })
    }

    /// Sends a frame.
    ///
    /// Errors: what the system reports; [`io::ErrorKind::TimedOut`] when the queue stays full.
    pub fn send(&mut self, frame: &Frame) -> io::Result<()> {
        let frame = to_kernel(frame).ok_or(io::ErrorKind::InvalidInput)?;
        for _ in 0..TRIES {
            match self.socket.write_frame(&frame) {
                Ok(()) => return Ok(()),
                Err(error) if may_send_again(&error) => {
                    std::thread::sleep(FULL_WAIT);
                }
                Err(error) => return Err(error),
            }
        }
        self.trouble.unsent = true;
        let sentence = "nothing can be sent: no node acknowledges; check bit rate and wires";
        Err(io::Error::new(io::ErrorKind::TimedOut, sentence))
    }

    /// The next frame until then.
    ///
    /// Errors: what the system reports.
    pub fn receive(&mut self, until: Instant) -> io::Result<Option<Received>> {
        let mut is_first = true;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() && !is_first {
                return Ok(None);
            }
            is_first = false;
            match self.socket.read_frame_timeout(left.max(SHORTEST)) {
                Ok(frame) => match from_kernel(&frame) {
                    Some(frame) => {
                        let time_ns = now_ns();
                        return Ok(Some(Received { time_ns, frame }));
                    }
                    None => self.trouble.errors += 1,
                },
                Err(error) if error.should_retry() => {}
                Err(error) if error.kind() == io::ErrorKind::TimedOut => return Ok(None),
                Err(error) => return Err(error),
            }
        }
    }

    /// What error frames have told.
    pub const fn trouble(&self) -> Trouble {
        self.trouble
    }
}
