//! Writing `candump -L`, until `log` has its writer.

use std::io::{self, Write};

use canopen::Frame;
use canopen::frame::Id;

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `candump -L`.
    Candump,
}

impl Format {
    /// The only one.
    pub const fn of(_: &std::path::Path) -> Self {
        Self::Candump
    }
}

/// Writes a log.
#[derive(Debug)]
pub struct Writer<W: Write> {
    out: W,
}

impl<W: Write> Writer<W> {
    /// Writes to `out`.
    pub const fn new(out: W, _: Format) -> Self {
        Self { out }
    }

    /// Writes a frame.
    pub fn write(&mut self, time_ns: u64, interface: &str, frame: &Frame) -> io::Result<()> {
        let us = time_ns / 1000;
        let id = match frame.id() {
            Id::Standard(id) => format!("{:03X}", id.as_raw()),
            Id::Extended(id) => format!("{:08X}", id.as_raw()),
        };
        let data: String = frame.bytes().iter().map(|b| format!("{b:02X}")).collect();
        let data = if frame.is_remote() {
            format!("R{}", frame.length())
        } else {
            data
        };
        let (s, us) = (us / 1_000_000, us % 1_000_000);
        writeln!(self.out, "({s}.{us:06}) {interface} {id}#{data}")
    }

    /// Flushes.
    pub fn finish(mut self) -> io::Result<W> {
        self.out.flush()?;
        Ok(self.out)
    }

    /// Flushes.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
