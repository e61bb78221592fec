//! Lines of the serial protocol of Lawicel's CAN adapters (SLCAN), as both ends have them.
//!
//! In: a frame of the bus, and what the client has asked for; or a line. Out: `t`, `T`, `r` or `R`
//! with identifier, length, bytes and CR, as in the CAN232/CANUSB manuals; or the frame. The other
//! [`Command`]s of a client, bit rates and status flags have their letters here as well.
//!
//! Left out: when which command is sent, and how it is answered, which the two ends decide.

use canopen::Frame;
use canopen::frame::Id;

use crate::hex;

/// Ends a command; alone it is the answer to one that was carried out.
pub const CR: u8 = b'\r';

/// The answer to a command that was refused.
pub const BEL: u8 = 7;

/// Bytes of the longest command (`T`, identifier, length, 8 bytes), and some.
pub const LINE_LIMIT: usize = 32;

/// Letters of the lines that are frames.
pub const FRAME_LETTERS: [u8; 4] = *b"tTrR";

/// Status flags (CAN232 manual, `F`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags(pub u8);

impl Flags {
    /// Error warning, error passive, bus error.
    const BAD: u8 = 1 << 2 | 1 << 5 | 1 << 7;

    /// The queue of frames to be sent is full.
    const UNSENT: u8 = 1 << 1;

    /// The flags behind `F`.
    pub fn read(digits: &[u8]) -> Option<Self> {
        let flags = hex::number(digits)?;
        u8::try_from(flags).ok().map(Self)
    }

    /// `F` and the flags, without the end of the line.
    pub fn text(self) -> Vec<u8> {
        let mut text = b"F".to_vec();
        hex::put_bytes(&mut text, &[self.0]);
        text
    }

    /// How many of them are errors of the bus.
    pub const fn errors(self) -> u32 {
        (self.0 & Self::BAD).count_ones()
    }

    /// True when frames wait that could not be sent.
    pub const fn is_unsent(self) -> bool {
        self.0 & Self::UNSENT != 0
    }
}

/// kbit/s of `S0` to `S8`.
pub const RATES: [u32; 9] = [10, 20, 50, 100, 125, 250, 500, 800, 1000];

/// A command of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Open the channel.
    Open,
    /// Open it to listen only.
    ListenOnly,
    /// Close it.
    Close,
    /// Tell hardware and software version.
    Version,
    /// Tell the serial number.
    SerialNumber,
    /// Tell the status flags.
    Flags,
    /// Take this bit rate, one of [`RATES`].
    Rate(u32),
    /// Take these values of the controller's registers for the bit rate.
    Registers(u32),
    /// Stamp frames with the time, or do not.
    Stamped(bool),
    /// Take this acceptance code.
    Code(u32),
    /// Take this acceptance mask.
    Mask(u32),
    /// Send a frame.
    Send(Frame),
}

impl Command {
    /// The command of a line without its end; `None` for one that is unknown or malformed.
    pub fn read(line: &[u8]) -> Option<Self> {
        let (letter, rest) = line.split_first()?;
        Some(match (*letter, rest) {
            (letter, _) if FRAME_LETTERS.contains(&letter) => Self::Send(frame(letter, rest)?),
            (b'O', []) => Self::Open,
            (b'L', []) => Self::ListenOnly,
            (b'C', []) => Self::Close,
            (b'V', []) => Self::Version,
            (b'N', []) => Self::SerialNumber,
            (b'F', []) => Self::Flags,
            (b'S', [digit @ b'0'..=b'8']) => {
                Self::Rate(RATES.get(usize::from(digit - b'0')).copied()?)
            }
            (b's', [_, _, _, _]) => Self::Registers(hex::number(rest)?),
            (b'Z', [b'0']) => Self::Stamped(false),
            (b'Z', [b'1']) => Self::Stamped(true),
            (b'M', _) if rest.len() == 8 => Self::Code(hex::number(rest)?),
            (b'm', _) if rest.len() == 8 => Self::Mask(hex::number(rest)?),
            _ => return None,
        })
    }

    /// The line of the command, with its end. A rate that is none of [`RATES`] has none.
    pub fn line(self) -> Option<Vec<u8>> {
        let mut line = Vec::new();
        match self {
            Self::Open => line.push(b'O'),
            Self::ListenOnly => line.push(b'L'),
            Self::Close => line.push(b'C'),
            Self::Version => line.push(b'V'),
            Self::SerialNumber => line.push(b'N'),
            Self::Flags => line.push(b'F'),
            Self::Rate(kbit_s) => {
                let place = RATES.iter().position(|rate| *rate == kbit_s)?;
                line.push(b'S');
                hex::put(&mut line, place as u32, 1);
            }
            Self::Registers(values) => put(&mut line, b's', values, 4),
            Self::Stamped(on) => put(&mut line, b'Z', u32::from(on), 1),
            Self::Code(code) => put(&mut line, b'M', code, 8),
            Self::Mask(mask) => put(&mut line, b'm', mask, 8),
            Self::Send(frame) => {
                Form::default().put_frame(&mut line, &frame, 0);
                return Some(line);
            }
        }
        line.push(CR);
        Some(line)
    }
}

fn put(line: &mut Vec<u8>, letter: u8, value: u32, digits: u32) {
    line.push(letter);
    hex::put(line, value, digits);
}

/// How a client wants its frames, set by `Z`, `M` and `m`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Form {
    /// With the milliseconds of the minute behind each frame.
    pub stamped: bool,
    /// The acceptance code: two filters of 16 bits.
    pub code: u32,
    /// The acceptance mask; a bit of 1 lets anything pass.
    pub mask: u32,
}

impl Default for Form {
    fn default() -> Self {
        Self {
            stamped: false,
            code: 0,
            mask: u32::MAX,
        }
    }
}

impl Form {
    /// Appends a frame of the bus, unless the filter keeps it away; the time is in microseconds.
    pub fn put_frame(self, out: &mut Vec<u8>, frame: &Frame, time_us: u64) {
        if !self.passes(frame) {
            return;
        }
        out.push(match (frame.id(), frame.is_remote()) {
            (Id::Standard(_), false) => b't',
            (Id::Standard(_), true) => b'r',
            (Id::Extended(_), false) => b'T',
            (Id::Extended(_), true) => b'R',
        });
        hex::put_id(out, frame.id());
        hex::put(out, frame.length() as u32, 1);
        hex::put_bytes(out, frame.bytes());
        if self.stamped {
            // Milliseconds that start again every minute.
            hex::put(out, (time_us / 1000 % 60_000) as u32, 4);
        }
        out.push(CR);
    }

    /// The two 16-bit filters of the SJA1000 in dual mode; a mask bit of 1 lets anything pass.
    fn passes(self, frame: &Frame) -> bool {
        let equal = |value: u32, code: u32, mask: u32| (value ^ code) & !mask & 0xFFFF == 0;
        let (first, second) = (self.code >> 16, self.code & 0xFFFF);
        let (first_mask, second_mask) = (self.mask >> 16, self.mask & 0xFFFF);
        match frame.id() {
            Id::Extended(id) => {
                let upper = id.as_raw() >> 13;
                equal(upper, first, first_mask) || equal(upper, second, second_mask)
            }
            Id::Standard(id) => {
                let head = u32::from(id.as_raw()) << 5 | u32::from(frame.is_remote()) << 4;
                // The first filter also compares the first data byte, its lower half with the
                // lowest bits of the second; without a data byte those bits don't count.
                let byte = frame.bytes().first().map(|byte| u32::from(*byte));
                let unused = if byte.is_some() { 0 } else { 0xF };
                let (upper, lower) = (byte.unwrap_or(0) >> 4, byte.unwrap_or(0) & 0xF);
                let one = equal(head | upper, first, first_mask | unused)
                    && equal(lower, second & 0xF, second_mask | 0xFFF0 | unused);
                one || equal(head, second, second_mask | 0xF)
            }
        }
    }
}

/// The frame after its letter: identifier, one digit of length, and as many bytes exactly.
pub fn frame(letter: u8, rest: &[u8]) -> Option<Frame> {
    let digits = if letter.is_ascii_lowercase() { 3 } else { 8 };
    let (id, rest) = rest.split_at_checked(digits)?;
    let id = hex::id(id)?;
    let (length, bytes) = rest.split_first()?;
    let length = char::from(*length).to_digit(9)? as usize;
    let bytes = hex::bytes(bytes)?;
    if letter.eq_ignore_ascii_case(&b'r') {
        return bytes.is_empty().then(|| Frame::remote(id, length))?;
    }
    (bytes.len() == length).then(|| Frame::with(id, &bytes))?
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::frame::ExtendedId;

    #[test]
    fn flags_come_back_and_those_of_a_bus_in_trouble_count() {
        let text = Flags(0xA6).text();
        assert_eq!(text, b"FA6");
        let flags = Flags::read(&text[1..]).unwrap();
        assert_eq!(flags, Flags(0xA6));
        assert!(flags.errors() == 3 && flags.is_unsent());
        assert!(Flags(0x59).errors() == 0 && !Flags(0x59).is_unsent());
        assert_eq!(Flags::read(b"100"), None);
    }

    #[test]
    fn a_command_comes_back_from_its_line() {
        let commands = [
            Command::Open,
            Command::ListenOnly,
            Command::Close,
            Command::Version,
            Command::SerialNumber,
            Command::Flags,
            Command::Rate(250),
            Command::Registers(0x031C),
            Command::Stamped(true),
            Command::Stamped(false),
            Command::Code(0x3025_FFEA),
            Command::Mask(0x10),
            Command::Send(Frame::data_frame(0x601, &[0x40, 8])),
        ];
        for command in commands {
            let line = command.line().unwrap();
            let (end, line) = line.split_last().unwrap();
            assert_eq!((*end, Command::read(line)), (CR, Some(command)));
        }
        assert_eq!(Command::Rate(250).line().unwrap(), b"S5\r");
        assert_eq!(Command::Rate(77).line(), None);
        for line in [
            &b""[..],
            b"O1",
            b"S9",
            b"s03G0",
            b"Z2",
            b"M123",
            b"t12",
            b"X1",
        ] {
            assert_eq!(Command::read(line), None);
        }
    }

    #[test]
    fn the_first_filter_sees_the_first_byte() {
        // Filter 1: 181h with 5Ah first; filter 2: 7FFh, so that it lets nothing else pass.
        let form = Form {
            stamped: false,
            code: 0x3025_FFEA,
            mask: 0x0010_0010,
        };
        assert!(form.passes(&Frame::data_frame(0x181, &[0x5A])));
        assert!(!form.passes(&Frame::data_frame(0x181, &[0x5B])));
        assert!(!form.passes(&Frame::data_frame(0x181, &[0x6A])));
        assert!(form.passes(&Frame::data_frame(0x181, &[])));
        assert!(form.passes(&Frame::data_frame(0x7FF, &[0])));
        let long = ExtendedId::new(0x3025 << 13).unwrap();
        assert!(form.passes(&Frame::with(long, &[]).unwrap()));
        assert!(!form.passes(&Frame::with(ExtendedId::ZERO, &[]).unwrap()));
    }
}
