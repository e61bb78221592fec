//! A client of an SLCAN adapter: over TCP, at a serial port, or at a pseudo-terminal.
//!
//! In: lines that end with CR (frames, answers) and BEL (refused). Out: commands: close, bit
//! rate, open, frames, status flags. Commands are those of the CAN232/CANUSB manuals, as far as
//! every adapter supports them.
//!
//! Left out: time stamps of the adapter, which count milliseconds of a minute and not all have;
//! filters, CAN FD.

use std::io;
use std::time::{Duration, Instant};

use canopen::Frame;

use super::intake::{self, Intake, Stream};
use super::received::{Received, Trouble, now_ns};
use can_text::slcan::{BEL, CR, Command, FRAME_LETTERS, Flags, frame};

/// How long an adapter has for an answer.
const ANSWER: Duration = Duration::from_secs(1);

/// How often the opening is tried: an adapter may have been left in the middle of a line, and
/// some restart when their port is opened. An answer to a client before may come late, so that the
/// refusal to close what is closed is read as the answer to the next command.
const OPENINGS: usize = 3;

/// After which errors the opening is tried again: no answer in time, and a refusal.
const AGAIN: [io::ErrorKind; 2] = [io::ErrorKind::TimedOut, io::ErrorKind::InvalidData];

/// How the other answers of an adapter begin: a frame is taken, version, serial number.
const ANSWERS: &[u8] = b"zZVvN";

/// An adapter whose channel is open.
#[derive(Debug)]
pub struct Client {
    intake: Intake,
    serial: bool,
    trouble: Trouble,
    /// Lines that are neither a frame nor an answer, since the channel was first opened.
    unreadable: u64,
    /// Frames that came while an answer was waited for.
    early: std::collections::VecDeque<Received>,
}

/// What a line of the adapter is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Said {
    Frame(Received),
    /// CR, with or without a word before it.
    Done,
    /// BEL.
    Refused,
    /// Neither a frame nor an answer: what came is damaged, or half a line.
    Unreadable,
    /// Status flags.
    Flags(Flags),
}

impl Client {
    /// Opens the adapter behind `host:port`.
    ///
    /// Errors: what the system reports; [`io::ErrorKind::TimedOut`] and
    /// [`io::ErrorKind::InvalidData`] when nothing like an adapter answers.
    pub fn join_tcp(at: &str, kbit_s: Option<u32>) -> io::Result<Self> {
        Self::open(Box::new(intake::connect(at)?), false, kbit_s)
    }

    /// Opens the adapter at a serial port.
    ///
    /// Errors: as [`Client::join_tcp`].
    pub fn join_serial(path: &str, baud: u32, kbit_s: Option<u32>) -> io::Result<Self> {
        let port = serialport::new(path, baud).timeout(ANSWER).open()?;
        Self::open(Box::new(port), true, kbit_s)
    }

    fn open(stream: Box<dyn Stream>, serial: bool, kbit_s: Option<u32>) -> io::Result<Self> {
        let mut client = Self {
            intake: Intake::new(stream),
            serial,
            trouble: Trouble::default(),
            unreadable: 0,
            early: std::collections::VecDeque::new(),
        };
        // A rate that the adapter was not told is the one that it has.
        client.open_again(kbit_s)?;
        // What an earlier client has left shows nothing of this one's line.
        client.unreadable = 0;
        Ok(client)
    }

    /// Closes the channel and opens it with another bit rate, kbit/s.
    ///
    /// Errors: as [`Client::join_tcp`].
    pub fn set_bit_rate(&mut self, kbit_s: u32) -> io::Result<()> {
        self.open_again(Some(kbit_s))
    }

    fn open_again(&mut self, kbit_s: Option<u32>) -> io::Result<()> {
        // A rate that has no letter is left as it is.
        let rate = kbit_s.and_then(|kbit_s| Command::Rate(kbit_s).line());
        let mut failed = io::Error::from(io::ErrorKind::TimedOut);
        for _ in 0..OPENINGS {
            match self.open_once(rate.as_deref()) {
                Ok(()) => return Ok(()),
                Err(error) if AGAIN.contains(&error.kind()) => failed = error,
                Err(error) => return Err(error),
            }
        }
        Err(failed)
    }

    fn open_once(&mut self, rate: Option<&[u8]>) -> io::Result<()> {
        // Whatever stands half written is ended, and an open channel closed; either may be refused.
        let close = Command::Close.line().unwrap_or_default();
        self.intake.write(&[&[CR], close.as_slice()].concat())?;
        self.answered(Instant::now() + ANSWER)?;
        self.answered(Instant::now() + ANSWER)?;
        if let Some(rate) = rate {
            self.intake.write(rate)?;
            self.must_take("the bit rate")?;
        }
        self.write(Command::Open)?;
        self.must_take("to open its channel")?;
        self.early.clear();
        Ok(())
    }

    fn write(&mut self, command: Command) -> io::Result<()> {
        let line = command.line().ok_or(io::ErrorKind::InvalidInput)?;
        self.intake.write(&line)
    }

    /// The command that was written must not be refused.
    fn must_take(&mut self, what: &str) -> io::Result<()> {
        match self.answered(Instant::now() + ANSWER)? {
            true => Ok(()),
            false => {
                let sentence = format!("the adapter refuses {what}");
                Err(io::Error::new(io::ErrorKind::InvalidData, sentence))
            }
        }
    }

    /// Whether the next answer is CR; frames that come before it are kept.
    fn answered(&mut self, until: Instant) -> io::Result<bool> {
        loop {
            match self.said(until)? {
                Some(Said::Frame(received)) => self.early.push_back(received),
                Some(Said::Refused) => return Ok(false),
                // A line of an earlier client, cut by the opening, is answered as one that is done.
                Some(Said::Done | Said::Flags(_) | Said::Unreadable) => return Ok(true),
                None => return Err(io::ErrorKind::TimedOut.into()),
            }
        }
    }

    fn said(&mut self, until: Instant) -> io::Result<Option<Said>> {
        let line = self.intake.next(&[CR, BEL], until)?;
        let said = line.map(|(line, end)| read(line, end));
        self.unreadable += u64::from(said == Some(Said::Unreadable));
        Ok(said)
    }

    /// Whether the adapter can be unplugged.
    pub const fn is_serial(&self) -> bool {
        self.serial
    }

    /// Sends a frame. Its acknowledgement by the adapter is not waited for.
    ///
    /// Errors: what the system reports.
    pub fn send(&mut self, frame: &Frame) -> io::Result<()> {
        self.write(Command::Send(*frame))
    }

    /// The next frame until then. A refused frame counts as trouble.
    ///
    /// Errors: what the system reports.
    pub fn receive(&mut self, until: Instant) -> io::Result<Option<Received>> {
        if let Some(early) = self.early.pop_front() {
            return Ok(Some(early));
        }
        loop {
            match self.said(until)? {
                Some(Said::Frame(received)) => return Ok(Some(received)),
                Some(Said::Refused) => self.trouble.unsent = true,
                Some(Said::Flags(flags)) => self.note(flags),
                Some(Said::Done | Said::Unreadable) => {}
                None => return Ok(None),
            }
        }
    }

    const fn note(&mut self, flags: Flags) {
        self.trouble.errors += flags.errors() as u64;
        self.trouble.unsent |= flags.is_unsent();
    }

    /// Lines so far that can't be read; a frame may have been in each.
    pub const fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// Asks for the status flags; an adapter that does not support this is not in trouble.
    ///
    /// Errors: what the system reports.
    pub fn trouble(&mut self) -> io::Result<Trouble> {
        self.write(Command::Flags)?;
        let until = Instant::now() + ANSWER / 4;
        while let Some(said) = self.said(until)? {
            match said {
                Said::Frame(received) => self.early.push_back(received),
                Said::Flags(flags) => {
                    self.note(flags);
                    break;
                }
                Said::Done | Said::Refused | Said::Unreadable => {}
            }
        }
        Ok(self.trouble)
    }
}

impl Drop for Client {
    /// An adapter that is left open goes on sending to whoever opens its port next.
    fn drop(&mut self) {
        let _ = self.write(Command::Close);
    }
}

fn read(line: &[u8], end: u8) -> Said {
    // Some adapters end lines with CR and LF.
    let line = line.trim_ascii();
    if end != CR {
        return Said::Refused;
    }
    match line.split_first() {
        Some((letter, rest)) if FRAME_LETTERS.contains(letter) => {
            // An adapter that was told to stamp by somebody before appends four digits.
            let cut = rest.len().checked_sub(4).and_then(|end| rest.get(..end));
            let read = frame(*letter, rest).or_else(|| frame(*letter, cut?));
            let time_ns = now_ns();
            read.map_or(Said::Unreadable, |frame| {
                Said::Frame(Received { time_ns, frame })
            })
        }
        Some((b'F', flags)) => Flags::read(flags).map_or(Said::Unreadable, Said::Flags),
        Some((letter, _)) if !ANSWERS.contains(letter) => Said::Unreadable,
        _ => Said::Done,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::frame::{ExtendedId, standard};
    use proptest::prelude::*;
    use std::io::{BufRead, BufReader, Write};
    use std::net::TcpListener;

    /// An adapter that answers each line with what `answers` has for it, and hangs up after that.
    fn adapter(answers: &[&'static str]) -> (String, std::thread::JoinHandle<Vec<String>>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let at = listener.local_addr().unwrap().to_string();
        let answers = answers.to_vec();
        let server = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let mut lines = BufReader::new(stream.try_clone().unwrap()).split(b'\r');
            let mut heard = Vec::new();
            for answer in answers {
                let Some(Ok(line)) = lines.next() else { break };
                heard.push(String::from_utf8(line).unwrap());
                stream.write_all(answer.as_bytes()).unwrap();
            }
            heard
        });
        (at, server)
    }

    #[test]
    fn a_channel_is_closed_told_its_rate_and_opened() {
        let answers = &["\r", "\x07", "\r", "\r", "z\rt0801AA\rF04\r"];
        let (at, server) = adapter(answers);
        let mut client = Client::join_tcp(&at, Some(500)).unwrap();
        client.send(&Frame::data_frame(0x601, &[1, 2])).unwrap();
        let until = Instant::now() + ANSWER;
        let received = client.receive(until).unwrap().unwrap();
        assert_eq!(received.frame, Frame::data_frame(0x80, &[0xAA]));
        // The adapter hangs up: named, and nothing hangs.
        let ended = client.receive(until).unwrap_err().kind();
        assert_eq!(ended, io::ErrorKind::UnexpectedEof);
        assert_eq!(client.trouble.errors, 1);
        let heard = server.join().unwrap();
        assert_eq!(heard, ["", "C", "S6", "O", "t60120102"]);
    }

    #[test]
    fn an_adapter_that_was_left_open_shows_frames_before_its_answers() {
        let (at, server) = adapter(&["t0800\r\r", "t0800\r\r", "\r"]);
        Client::join_tcp(&at, None).unwrap();
        assert_eq!(server.join().unwrap(), ["", "C", "O"]);
    }

    #[test]
    fn an_adapter_that_refuses_is_told_of() {
        let once = ["\r", "\r", "\x07"];
        let (at, server) = adapter([once, once, once].as_flattened());
        let refused = Client::join_tcp(&at, None).unwrap_err();
        assert!(refused.to_string().contains("refuses to open"), "{refused}");
        assert_eq!(server.join().unwrap().len(), 9);
    }

    /// The refusal to close what is closed was read as the answer to the opening.
    #[test]
    fn a_late_answer_to_the_client_before_shifted_all_others() {
        let answers = &["\r\r", "\x07", "\r", "\r", "\r", "\r"];
        let (at, server) = adapter(answers);
        Client::join_tcp(&at, None).unwrap();
        assert_eq!(server.join().unwrap(), ["", "C", "O", "", "C", "O"]);
    }

    #[test]
    fn frames_of_all_four_kinds_are_read_with_a_stamp_and_without() {
        let long = ExtendedId::new(0x1234_5678).unwrap();
        for (line, sent) in [
            ("t60124008", Frame::data_frame(0x601, &[0x40, 8])),
            ("t601240080B0C", Frame::data_frame(0x601, &[0x40, 8])),
            ("T1234567811A", Frame::with(long, &[0x1A]).unwrap()),
            ("r7011", Frame::remote(standard(0x701), 1).unwrap()),
            ("R12345678 ", Frame::data_frame(0, &[])),
        ] {
            match read(line.as_bytes(), b'\r') {
                Said::Frame(received) => assert_eq!(received.frame, sent, "{line}"),
                said => assert_eq!((line, said), ("R12345678 ", Said::Unreadable)),
            }
        }
    }

    /// A monitor showed PDOs that are missing, and nothing of the lines that they were in.
    #[test]
    fn damaged_lines_were_not_counted() {
        let answers = &[
            "\r",
            "\r",
            "\rz\rt60124008\rt6012\u{1}400\rx18\rV1013\r\rt6012\r",
        ];
        let (at, _server) = adapter(answers);
        let mut client = Client::join_tcp(&at, None).unwrap();
        let soon = Instant::now() + 20 * ANSWER;
        assert!(client.receive(soon).unwrap().is_some());
        assert!(client.receive(soon).is_err(), "it has hung up");
        assert_eq!(client.unreadable(), 3);
    }

    proptest! {
        #[test]
        fn any_line_is_read_somehow(line in prop::collection::vec(any::<u8>(), 0..40)) {
            let _ = read(&line, b'\r');
        }
    }
}
