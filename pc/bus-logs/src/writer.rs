//! Writing logs that other tools read.
//!
//! In: frames with their time and interface. Out: `candump -L`, or Vector ASC with CRLF line ends,
//! as the field expects. Times are in whole us, rounded down. In an ASC interfaces are numbers:
//! `can0` is 1 unless another interface has that already, and one without a number has the lowest
//! that is free when it appears.

use std::io::{self, Write};

use canopen::Frame;
use canopen::frame::Id;

use crate::candump;
use crate::date::{is_dated, utc};

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `candump -L`.
    Candump,
    /// Vector ASC.
    Asc,
}

impl Format {
    /// ASC for a name that ends so, else candump.
    pub fn of(path: &std::path::Path) -> Self {
        let is_asc = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("asc"));
        if is_asc { Self::Asc } else { Self::Candump }
    }
}

/// Writes a log.
#[derive(Debug)]
pub struct Writer<W: Write> {
    out: W,
    format: Format,
    /// When the ASC began.
    start_ns: Option<u64>,
    /// Channel of each interface that has appeared.
    channels: Vec<(String, usize)>,
}

impl<W: Write> Writer<W> {
    /// Writes to `out`, which should be buffered.
    pub const fn new(out: W, format: Format) -> Self {
        Self {
            out,
            format,
            start_ns: None,
            channels: Vec::new(),
        }
    }

    /// Writes a frame that was seen at this time, ns since 1970 or since a start.
    pub fn write(&mut self, time_ns: u64, interface: &str, frame: &Frame) -> io::Result<()> {
        match self.format {
            Format::Candump => {
                let name = candump_name(interface);
                writeln!(self.out, "{}", candump::line(time_ns, &name, frame))
            }
            Format::Asc => {
                let start_ns = self.begin(time_ns)?;
                let channel = self.channel(interface);
                self.asc_line(time_ns.saturating_sub(start_ns), channel, frame)
            }
        }
    }

    /// Writes what a format has at its end, and gives the writer back, flushed.
    pub fn finish(mut self) -> io::Result<W> {
        if self.format == Format::Asc {
            self.begin(0)?;
            self.out.write_all(b"End TriggerBlock\r\n")?;
        }
        self.out.flush()?;
        Ok(self.out)
    }

    /// What was written reaches the file.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// The head of an ASC, before its first frame; the time its times count from.
    fn begin(&mut self, time_ns: u64) -> io::Result<u64> {
        if let Some(start_ns) = self.start_ns {
            return Ok(start_ns);
        }
        // The date has whole ms only. A log without a date keeps its times as they are.
        let start_ns = if is_dated(time_ns) {
            time_ns - time_ns % 1_000_000
        } else {
            0
        };
        self.start_ns = Some(start_ns);
        // `Tue Nov 14 10:13:20.123 pm 2023`.
        let date = utc(start_ns).format("%a %b %-d %I:%M:%S%.3f %P %Y");
        write!(
            self.out,
            "date {date}\r\nbase hex  timestamps absolute\r\ninternal events logged\r\n\
             Begin Triggerblock {date}\r\n   0.000000 Start of measurement\r\n"
        )?;
        Ok(start_ns)
    }

    fn asc_line(&mut self, since_ns: u64, channel: usize, frame: &Frame) -> io::Result<()> {
        let us = since_ns / 1000;
        let id = match frame.id() {
            Id::Standard(id) => format!("{:X}", id.as_raw()),
            Id::Extended(id) => format!("{:X}x", id.as_raw()),
        };
        let (seconds, us) = (us / 1_000_000, us % 1_000_000);
        write!(self.out, "{seconds:4}.{us:06} {channel}  {id:<15} Rx   ")?;
        if frame.is_remote() {
            write!(self.out, "r {:x}\r\n", frame.length())
        } else {
            write!(self.out, "d {:x}", frame.length())?;
            for byte in frame.bytes() {
                write!(self.out, " {byte:02X}")?;
            }
            self.out.write_all(b"\r\n")
        }
    }

    /// The number of an interface.
    fn channel(&mut self, interface: &str) -> usize {
        let known = self.channels.iter().find(|(name, _)| name == interface);
        if let Some((_, channel)) = known {
            return *channel;
        }
        let is_free = |channel: &usize| self.channels.iter().all(|(_, taken)| taken != channel);
        let wanted = own_number(interface).filter(is_free);
        // There are fewer interfaces than numbers.
        let lowest = || (1..).find(is_free).unwrap_or(1);
        let channel = wanted.unwrap_or_else(lowest);
        self.channels.push((interface.to_owned(), channel));
        channel
    }
}

/// The number that an interface has in its name: `2` is 2, `can0` is 1.
fn own_number(interface: &str) -> Option<usize> {
    if let Ok(number) = interface.parse() {
        return Some(number);
    }
    let digits = interface.trim_start_matches(|c: char| !c.is_ascii_digit());
    let number = digits.parse::<usize>().ok().filter(|number| *number < 255);
    number.map(|number| number + 1)
}

/// A name without blanks; the number 1 of an ASC is `can0`.
fn candump_name(interface: &str) -> String {
    if let Ok(number) = interface.parse::<usize>() {
        return format!("can{}", number.saturating_sub(1));
    }
    let name: String = interface.split_whitespace().collect();
    if name.is_empty() {
        "can0".to_owned()
    } else {
        name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channels(interfaces: &[&str]) -> Vec<String> {
        let mut writer = Writer::new(Vec::new(), Format::Asc);
        let frame = Frame::data_frame(0x80, &[]);
        for interface in interfaces {
            writer.write(1_000_000, interface, &frame).unwrap();
        }
        let text = String::from_utf8(writer.finish().unwrap()).unwrap();
        let frames = text.lines().filter(|line| line.contains(" Rx "));
        let channel = |line: &str| line.split_whitespace().nth(1).unwrap().to_owned();
        frames.map(channel).collect()
    }

    #[test]
    fn an_interface_without_a_number_was_channel_256() {
        assert_eq!(channels(&["plumb", "plumb"]), ["1", "1"]);
        assert_eq!(
            channels(&["plumb", "can0", "can2", "cab"]),
            ["1", "2", "3", "4"]
        );
        assert_eq!(channels(&["can1", "plumb", "can0"]), ["2", "1", "3"]);
        assert_eq!(channels(&["7", "can0", "7"]), ["7", "1", "7"]);
    }
}
