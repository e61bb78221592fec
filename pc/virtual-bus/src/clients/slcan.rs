//! The serial line protocol of Lawicel's CAN adapters (SLCAN), one client, the adapter's side.
//!
//! In: the bytes a client writes, in pieces of any size; commands end with CR. Out: answers (CR
//! for done, BEL for refused), frames for the bus, and when and how it may have those of the bus.
//! Commands and their conditions are those of the CAN232/CANUSB manuals.
//!
//! Left out: CAN FD, polling (`P`, `A`), auto-poll (`X`: always on), the serial rate (`U`) and
//! the start-up setting (`Q`); they get BEL. The bit rate is checked and otherwise ignored, since
//! the bus has its own.

use std::time::Duration;

use super::dialogue::{Dialogue, Heard};
use super::outlet::Tap;
use can_text::slcan::{BEL, CR, Command, Flags, Form, LINE_LIMIT};
use canopen::Frame;
use canopen::frame::Id;

/// Hardware and software version, two digits each.
const VERSION: &[u8] = b"V0100";

/// Four letters or digits.
const SERIAL_NUMBER: &[u8] = b"NPLMB";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Channel {
    Closed,
    Open,
    ListenOnly,
}

/// A command that was not carried out: BEL.
struct Refused;

/// One client's side of the protocol.
#[derive(Debug)]
pub struct Session {
    line: Vec<u8>,
    channel: Channel,
    form: Form,
    /// kbit/s; `None` before `S`, or after `s`.
    rate: Option<u32>,
}

impl Session {
    /// A client that has just come.
    pub fn new() -> Self {
        Self {
            line: Vec::new(),
            channel: Channel::Closed,
            form: Form::default(),
            rate: None,
        }
    }

    fn line(&mut self, heard: &mut Heard) {
        let line = std::mem::take(&mut self.line);
        let done = match line.first() {
            // Clients send empty lines to end what stood there before.
            None => Ok(()),
            Some(_) if line.len() > LINE_LIMIT => Err(Refused),
            Some(_) => self.obey(&line, heard),
        };
        heard.answer.push(if done.is_ok() { CR } else { BEL });
    }

    fn obey(&mut self, line: &[u8], heard: &mut Heard) -> Result<(), Refused> {
        match Command::read(line).ok_or(Refused)? {
            Command::Send(frame) => self.transmit(frame, heard),
            Command::Open => self.open(Channel::Open, heard),
            Command::ListenOnly => self.open(Channel::ListenOnly, heard),
            Command::Close => self.close(heard),
            Command::Version => reply(VERSION, heard),
            Command::SerialNumber => reply(SERIAL_NUMBER, heard),
            Command::Flags if self.is_open() => reply(&Flags::default().text(), heard),
            setting if !self.is_open() => self.set(setting),
            _ => Err(Refused),
        }
    }

    /// The settings, which a client may change while its channel is closed.
    fn set(&mut self, setting: Command) -> Result<(), Refused> {
        match setting {
            Command::Rate(kbit_s) => self.rate = Some(kbit_s),
            // Registers of a controller that isn't there: read, and without effect.
            Command::Registers(_) => self.rate = None,
            Command::Stamped(on) => self.form.stamped = on,
            Command::Code(code) => self.form.code = code,
            Command::Mask(mask) => self.form.mask = mask,
            _ => return Err(Refused),
        }
        Ok(())
    }

    fn open(&mut self, channel: Channel, heard: &mut Heard) -> Result<(), Refused> {
        if self.channel != Channel::Closed {
            return Err(Refused);
        }
        self.channel = channel;
        heard.tap = Some((Tap::Slcan(self.form), Duration::ZERO));
        heard.notice = self.rate.map(|rate| {
            format!("asked for {rate} kbit/s, which changes nothing: the bus has its own rate")
        });
        Ok(())
    }

    fn close(&mut self, heard: &mut Heard) -> Result<(), Refused> {
        if self.channel == Channel::Closed {
            return Err(Refused);
        }
        self.channel = Channel::Closed;
        heard.tap = Some((Tap::Closed, Duration::ZERO));
        Ok(())
    }

    fn transmit(&self, frame: Frame, heard: &mut Heard) -> Result<(), Refused> {
        if self.channel != Channel::Open {
            return Err(Refused);
        }
        heard.answer.push(match frame.id() {
            Id::Standard(_) => b'z',
            Id::Extended(_) => b'Z',
        });
        heard.frames.push(frame);
        Ok(())
    }
}

fn reply(words: &[u8], heard: &mut Heard) -> Result<(), Refused> {
    heard.answer.extend_from_slice(words);
    Ok(())
}

impl Dialogue for Session {
    fn hear(&mut self, bytes: &[u8], heard: &mut Heard) {
        for byte in bytes {
            match *byte {
                CR => self.line(heard),
                // A person's terminal may send CR and LF.
                b'\n' => {}
                // The first byte too many is kept as the sign that the line was too long.
                byte if self.line.len() <= LINE_LIMIT => self.line.push(byte),
                _ => {}
            }
        }
    }

    fn is_open(&self) -> bool {
        self.channel != Channel::Closed
    }
}

#[cfg(test)]
mod tests {
    use canopen::frame::{ExtendedId, StandardId};

    use super::*;

    fn hear(session: &mut Session, text: &str) -> Heard {
        let mut heard = Heard::default();
        session.hear(text.as_bytes(), &mut heard);
        heard
    }

    fn answer(session: &mut Session, text: &str) -> String {
        String::from_utf8(hear(session, text).answer).unwrap()
    }

    fn opened() -> Session {
        let mut session = Session::new();
        assert_eq!(answer(&mut session, "S6\rO\r"), "\r\r");
        session
    }

    fn text(form: Form, frame: &Frame, time_us: u64) -> String {
        let mut out = Vec::new();
        form.put_frame(&mut out, frame, time_us);
        String::from_utf8(out).unwrap()
    }

    fn id(id: u16) -> StandardId {
        StandardId::new(id).unwrap()
    }

    #[test]
    fn python_can_closes_sets_the_rate_and_opens_twice() {
        let mut session = Session::new();
        assert_eq!(answer(&mut session, "C\rS6\r\rO\rO\r"), "\x07\r\r\r\x07");
        assert_eq!(session.channel, Channel::Open);
    }

    #[test]
    fn frames_of_all_four_kinds_come_and_go_alike() {
        let long = ExtendedId::new(0x1234_5678).unwrap();
        for (line, frame) in [
            ("t60124008\r", Frame::data_frame(0x601, &[0x40, 8])),
            ("t0800\r", Frame::data_frame(0x80, &[])),
            ("T1234567811A\r", Frame::with(long, &[0x1A]).unwrap()),
            ("r7011\r", Frame::remote(id(0x701), 1).unwrap()),
            ("R123456788\r", Frame::remote(long, 8).unwrap()),
        ] {
            assert_eq!(hear(&mut opened(), line).frames, [frame], "{line}");
            assert_eq!(text(Form::default(), &frame, 0), line);
        }
    }

    #[test]
    fn a_sent_frame_is_answered_by_its_kind() {
        let said = answer(&mut opened(), "t0800\rr7011\rT123456780\r");
        assert_eq!(said, "z\rz\rZ\r");
    }

    #[test]
    fn a_wrong_frame_is_refused() {
        for wrong in [
            "t8000",
            "tFFF0",
            "t12",
            "t123",
            "t1239112233445566778899",
            "t123211",
            "t12311122",
            "t1231GG",
            "T200000000",
            "r12311",
            "r1239",
            "t12300000",
        ] {
            let heard = hear(&mut opened(), &format!("{wrong}\r"));
            assert_eq!((heard.frames, heard.answer), (vec![], vec![BEL]), "{wrong}");
        }
    }

    #[test]
    fn a_closed_or_listening_channel_sends_nothing() {
        assert_eq!(answer(&mut Session::new(), "t0800\r"), "\x07");
        let mut session = Session::new();
        let heard = hear(&mut session, "L\rt0800\r");
        assert_eq!((heard.frames, heard.answer), (vec![], vec![CR, BEL]));
        assert!(matches!(heard.tap, Some((Tap::Slcan(_), _))));
        assert_eq!(
            hear(&mut session, "C\r").tap,
            Some((Tap::Closed, Duration::ZERO))
        );
    }

    #[test]
    fn questions_are_answered() {
        assert_eq!(answer(&mut opened(), "V\rN\rF\r"), "V0100\rNPLMB\rF00\r");
        assert_eq!(answer(&mut Session::new(), "F\r"), "\x07");
    }

    #[test]
    fn settings_need_a_closed_channel() {
        for setting in ["S0", "S8", "s031C", "Z0", "Z1", "M00000000", "mFFFFFFFF"] {
            let line = format!("{setting}\r");
            assert_eq!(answer(&mut Session::new(), &line), "\r", "{setting}");
            assert_eq!(answer(&mut opened(), &line), "\x07", "{setting}");
        }
        for wrong in [
            "S9",
            "S",
            "S10",
            "s03",
            "s03XX",
            "Z2",
            "M0",
            "mFFFFFFFG",
            "X1",
            "?",
        ] {
            let line = format!("{wrong}\r");
            assert_eq!(answer(&mut Session::new(), &line), "\x07", "{wrong}");
        }
    }

    #[test]
    fn another_bit_rate_is_noticed() {
        let heard = hear(&mut Session::new(), "S5\rO\r");
        assert!(heard.notice.unwrap().starts_with("asked for 250 kbit/s"));
    }

    #[test]
    fn stamps_are_milliseconds_of_the_minute() {
        let mut session = Session::new();
        let heard = hear(&mut session, "Z1\rO\r");
        let Some((Tap::Slcan(form), _)) = heard.tap else {
            panic!("the channel is not open");
        };
        let frame = Frame::data_frame(0x80, &[1]);
        assert_eq!(text(form, &frame, 59_999_999), "t080101EA5F\r");
        assert_eq!(text(form, &frame, 60_000_000), "t0801010000\r");
    }

    #[test]
    fn the_filter_keeps_other_identifiers_away() {
        let mut session = Session::new();
        // Both filters: 181h, any remote bit, any data.
        let heard = hear(&mut session, "M30203020\rm001F001F\rO\r");
        let Some((Tap::Slcan(form), _)) = heard.tap else {
            panic!("the channel is not open");
        };
        assert_eq!(text(form, &Frame::data_frame(0x181, &[9]), 0), "t181109\r");
        assert_eq!(text(form, &Frame::data_frame(0x182, &[9]), 0), "");
        assert_eq!(
            text(form, &Frame::remote(id(0x181), 0).unwrap(), 0),
            "r1810\r"
        );
    }

    #[test]
    fn lines_come_in_pieces_and_too_long_ones_are_refused_once() {
        let mut session = opened();
        assert_eq!(answer(&mut session, "t08"), "");
        assert_eq!(
            hear(&mut session, "00\r\nt").frames,
            [Frame::data_frame(0x80, &[])]
        );
        let long = "0".repeat(10_000);
        assert_eq!(answer(&mut session, &long), "");
        assert!(session.line.len() <= LINE_LIMIT + 1);
        assert_eq!(answer(&mut session, "\rV\r"), "\x07V0100\r");
    }
}
