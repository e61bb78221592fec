//! The text protocol of socketcand, raw mode, one client.
//!
//! In: the bytes a client sends, in pieces of any size. Out: answers, frames for the bus, and
//! when it may have those of the bus. The words and spaces are those of socketcand's protocol
//! description as python-can 4.6.1 speaks it.
//!
//! Left out: remote frames (the text has no form for them, so `send` can't make one and those of
//! the bus are not shown), the BCM, ISO-TP and control modes, CAN FD, and the UDP beacon.

use std::time::Duration;

use canopen::Frame;

use super::dialogue::{Dialogue, Heard};
use super::outlet::Tap;
use can_text::hex;

/// Faults in a row after which a client is shown the door.
const FAULTS_LIMIT: u32 = 8;

/// The longest command, bytes between `<` and `>`: twice a `send` with 8 bytes.
const COMMAND_LIMIT: usize = 96;

/// How long frames are held back at most after the answer to `rawmode`, until the client sends
/// one. python-can reads that answer with one receive call and gives up when anything else comes
/// with it. Longer than this, and boot-up messages of before pass for new ones.
pub const HOLD: Duration = Duration::from_millis(20);

/// What a client is told at first.
pub const GREETING: &[u8] = b"< hi >";

/// One client's side of the protocol.
#[derive(Debug)]
pub struct Session {
    bus_name: String,
    open: bool,
    /// What stands after the last `<`; `None` between commands.
    command: Option<Vec<u8>>,
    /// Inside a run of bytes that belong to no command, and are one fault together.
    lost: bool,
    faults: u32,
}

impl Session {
    /// A client that has just been greeted, on the bus of this name.
    pub fn new(bus_name: &str) -> Self {
        Self {
            bus_name: bus_name.to_owned(),
            open: false,
            command: None,
            lost: false,
            faults: 0,
        }
    }

    fn byte(&mut self, byte: u8, heard: &mut Heard) {
        match (byte, &mut self.command) {
            (b'<', command) => {
                let cut_short = command.replace(Vec::new()).is_some();
                self.lost = false;
                if cut_short {
                    self.fault("a `<` within a command", heard);
                }
            }
            (b'>', Some(command)) => {
                let command = std::mem::take(command);
                self.command = None;
                self.command(&command, heard);
            }
            (_, Some(command)) if command.len() < COMMAND_LIMIT => command.push(byte),
            (_, Some(_)) => {
                let why = format!("a command is longer than {COMMAND_LIMIT} bytes");
                put_error(&mut heard.answer, &why);
                heard.close = Some(why);
            }
            (_, None) if byte.is_ascii_whitespace() || self.lost => {}
            (_, None) => {
                self.lost = true;
                self.fault("text outside of < and >", heard);
            }
        }
    }

    fn command(&mut self, command: &[u8], heard: &mut Heard) {
        let done = match std::str::from_utf8(command) {
            Ok(text) => {
                let words: Vec<&str> = text.split_ascii_whitespace().collect();
                self.obey(&words, heard)
            }
            Err(_) => Err("a command is ASCII text".to_owned()),
        };
        match done {
            Ok(()) => self.faults = 0,
            Err(why) => self.fault(&why, heard),
        }
    }

    fn obey(&mut self, words: &[&str], heard: &mut Heard) -> Result<(), String> {
        match words {
            ["open", name] => self.open(name, heard),
            ["echo"] => {
                heard.answer.extend_from_slice(b"< echo >");
                Ok(())
            }
            ["rawmode"] if self.open => {
                heard.answer.extend_from_slice(b"< ok >");
                heard.tap = Some((Tap::Socketcand, HOLD));
                Ok(())
            }
            ["send", id, length, bytes @ ..] if self.open => {
                heard.frames.push(frame(id, length, bytes)?);
                Ok(())
            }
            ["rawmode" | "send", ..] if !self.open => {
                Err(format!("open the bus first: open {}", self.bus_name))
            }
            ["open" | "rawmode" | "send" | "echo", ..] => {
                Err("wrong number of words in a command".to_owned())
            }
            [word, ..] => Err(format!(
                "{} is not offered, only open, rawmode, send and echo",
                shown(word)
            )),
            [] => Err("empty command".to_owned()),
        }
    }

    fn open(&mut self, name: &str, heard: &mut Heard) -> Result<(), String> {
        if self.open {
            return Err("the bus is open already".to_owned());
        }
        if name != self.bus_name {
            let here = &self.bus_name;
            return Err(format!("no bus {} here, only {here}", shown(name)));
        }
        self.open = true;
        heard.answer.extend_from_slice(b"< ok >");
        Ok(())
    }

    fn fault(&mut self, why: &str, heard: &mut Heard) {
        self.faults += 1;
        put_error(&mut heard.answer, why);
        if self.faults >= FAULTS_LIMIT {
            heard.close = Some(format!("{FAULTS_LIMIT} faults in a row, the last: {why}"));
        }
    }
}

impl Dialogue for Session {
    fn hear(&mut self, bytes: &[u8], heard: &mut Heard) {
        for byte in bytes {
            if heard.close.is_some() {
                return;
            }
            self.byte(*byte, heard);
        }
    }

    fn is_open(&self) -> bool {
        self.open
    }

    fn refusal(&self, why: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        put_error(&mut bytes, why);
        bytes
    }
}

fn put_error(out: &mut Vec<u8>, why: &str) {
    out.extend_from_slice(b"< error ");
    // The sentence must not hold the signs that part commands.
    out.extend(why.bytes().map(|byte| match byte {
        b'<' | b'>' => b'|',
        byte => byte,
    }));
    out.extend_from_slice(b" >");
}

/// A client's word as it may be sent back: short and plain.
fn shown(word: &str) -> String {
    let plain = |c: char| if c.is_ascii_graphic() { c } else { '?' };
    word.chars().take(16).map(plain).collect()
}

/// The frame of a `send`: identifier, length and bytes, all hexadecimal.
fn frame(id: &str, length: &str, bytes: &[&str]) -> Result<Frame, String> {
    // With four to seven digits it is not clear which length was meant.
    let digits = Some(id.as_bytes()).filter(|digits| matches!(digits.len(), 1..=3 | 8));
    let no_id = || format!("{} is no CAN identifier", shown(id));
    let id = digits.and_then(hex::id).ok_or_else(no_id)?;
    let length = hex::number(length.as_bytes()).filter(|length| *length <= 8);
    let length = length.ok_or("the length is 0 to 8 bytes")?;
    if bytes.len() != length as usize {
        // A remote frame of python-can arrives like this: a length and no bytes.
        let given = bytes.len();
        return Err(format!(
            "{length} bytes announced, {given} given (a remote frame can't be sent here)"
        ));
    }
    let value = |word: &&str| hex::number(word.as_bytes()).and_then(|v| u8::try_from(v).ok());
    let bytes: Option<Vec<u8>> = bytes.iter().map(value).collect();
    let bytes = bytes.ok_or("a byte is 0 to FF")?;
    Frame::with(id, &bytes).ok_or_else(|| "the length is 0 to 8 bytes".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use can_text::socketcand::put_frame;
    use canopen::frame::{ExtendedId, StandardId};

    fn hear(session: &mut Session, text: &str) -> Heard {
        let mut heard = Heard::default();
        session.hear(text.as_bytes(), &mut heard);
        heard
    }

    fn answer(session: &mut Session, text: &str) -> String {
        String::from_utf8(hear(session, text).answer).unwrap()
    }

    fn raw() -> Session {
        let mut session = Session::new("plumb");
        assert_eq!(answer(&mut session, "< open plumb >"), "< ok >");
        assert_eq!(answer(&mut session, "< rawmode >"), "< ok >");
        session
    }

    fn text(frame: &Frame, time_us: u64) -> String {
        let mut out = Vec::new();
        put_frame(&mut out, frame, time_us);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn python_can_opens_the_bus() {
        let mut session = Session::new("plumb");
        assert_eq!(answer(&mut session, "< open plumb >"), "< ok >");
        let heard = hear(&mut session, "< rawmode >");
        assert_eq!(heard.answer, b"< ok >");
        assert_eq!(heard.tap, Some((Tap::Socketcand, HOLD)));
    }

    #[test]
    fn python_can_writes_bytes_without_leading_zeros() {
        let heard = hear(&mut raw(), "< send 601 8 40 8 10 0 0 0 0 ff >");
        let expected = Frame::data_frame(0x601, &[0x40, 8, 0x10, 0, 0, 0, 0, 0xFF]);
        assert_eq!((heard.frames, heard.answer), (vec![expected], vec![]));
    }

    #[test]
    fn a_frame_without_bytes_has_two_spaces_both_ways() {
        let heard = hear(&mut raw(), "< send 080 0  >");
        assert_eq!(heard.frames, [Frame::data_frame(0x80, &[])]);
        let sync = text(&Frame::data_frame(0x80, &[]), 1_700_000_000_123_456);
        assert_eq!(sync, "< frame 080 1700000000.123456  >");
    }

    #[test]
    fn times_have_seconds_and_six_decimals() {
        let frame = Frame::data_frame(0x123, &[0x11, 0x2A]);
        assert_eq!(text(&frame, 0), "< frame 123 0.000000 112A >");
        assert_eq!(text(&frame, 1), "< frame 123 0.000001 112A >");
        assert_eq!(text(&frame, 10_000_000), "< frame 123 10.000000 112A >");
        let last = "< frame 123 18446744073709.551615 112A >";
        assert_eq!(text(&frame, u64::MAX), last);
    }

    #[test]
    fn eight_digits_are_an_extended_identifier_both_ways() {
        let frame = Frame::with(ExtendedId::new(0x181).unwrap(), &[1]).unwrap();
        assert_eq!(text(&frame, 0), "< frame 00000181 0.000000 01 >");
        assert_eq!(hear(&mut raw(), "< send 00000181 1 1 >").frames, [frame]);
    }

    #[test]
    fn a_remote_frame_has_no_text() {
        let frame = Frame::remote(StandardId::new(0x701).unwrap(), 1).unwrap();
        assert_eq!(text(&frame, 0), "");
        let heard = hear(&mut raw(), "< send 701 1  >");
        assert_eq!(heard.frames, []);
        assert!(
            heard
                .answer
                .starts_with(b"< error 1 bytes announced, 0 given")
        );
    }

    #[test]
    fn commands_come_in_pieces_and_together() {
        let mut session = raw();
        assert_eq!(hear(&mut session, "< se").frames, []);
        assert_eq!(hear(&mut session, "nd 1 1 0").frames, []);
        let heard = hear(&mut session, "5 >< send 2 0  >\n< echo >< send 3");
        let expected = [Frame::data_frame(1, &[5]), Frame::data_frame(2, &[])];
        assert_eq!(heard.frames, expected);
        assert_eq!(heard.answer, b"< echo >");
        assert_eq!(
            hear(&mut session, " 0 >").frames,
            [Frame::data_frame(3, &[])]
        );
    }

    #[test]
    fn another_bus_is_refused_by_name() {
        let mut session = Session::new("plumb");
        let said = answer(&mut session, "< open can7 >");
        assert_eq!(said, "< error no bus can7 here, only plumb >");
        assert_eq!(answer(&mut session, "< open plumb >"), "< ok >");
        assert!(answer(&mut session, "< open plumb >").starts_with("< error "));
    }

    #[test]
    fn nothing_goes_before_open() {
        let mut session = Session::new("plumb");
        for command in ["< rawmode >", "< send 1 0 >"] {
            let heard = hear(&mut session, command);
            assert_eq!(heard.answer, b"< error open the bus first: open plumb >");
            assert_eq!((heard.frames, heard.tap), (vec![], None));
        }
    }

    #[test]
    fn what_is_not_offered_is_named() {
        let mut session = raw();
        for command in ["statistics 1000", "bcmmode", "subscribe 0 0 123"] {
            let said = answer(&mut session, &format!("< {command} >"));
            let word = command.split(' ').next().unwrap();
            assert!(said.starts_with(&format!("< error {word} is not offered")));
        }
    }

    #[test]
    fn a_wrong_send_is_no_frame() {
        for wrong in [
            "800 0",
            "FFF 0",
            "20000000 0",
            "1234 0",
            "xyz 0",
            "1 9 1 2 3 4 5 6 7 8 9",
            "1 1 100",
            "1 2 1",
            "1 1 1 2",
            "1",
            "1 -1",
            "1 1 0x1",
        ] {
            let heard = hear(&mut raw(), &format!("< send {wrong} >"));
            assert_eq!(heard.frames, [], "{wrong}");
            assert!(heard.answer.starts_with(b"< error "), "{wrong}");
        }
    }

    #[test]
    fn garbage_is_an_error_and_at_last_the_end() {
        let mut session = raw();
        let first = hear(&mut session, "GET / HTTP/1.1\r\n");
        assert_eq!(first.answer, b"< error text outside of | and | >");
        for _ in 2..FAULTS_LIMIT {
            assert_eq!(hear(&mut session, "< what >").close, None);
        }
        let last = hear(&mut session, "< what >< echo >");
        assert!(last.close.unwrap().starts_with("8 faults in a row"));
        assert!(!last.answer.ends_with(b"< echo >"));
    }

    #[test]
    fn one_good_command_forgives_the_faults() {
        let mut session = raw();
        for _ in 0..FAULTS_LIMIT {
            assert_eq!(hear(&mut session, "< what >< echo >").close, None);
        }
    }

    #[test]
    fn an_endless_command_ends_the_conversation() {
        let heard = hear(&mut raw(), &format!("< {}", "a".repeat(1000)));
        assert!(heard.close.unwrap().contains("longer than 96 bytes"));
        assert!(heard.answer.starts_with(b"< error "));
    }

    #[test]
    fn any_bytes_make_frames_or_errors_and_bounded_answers() {
        let mut seed = 1_u32;
        let mut session = raw();
        for _ in 0..20_000 {
            let mut bytes = b"< send 123 2 11 22 >".to_vec();
            for _ in 0..3 {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let at = (seed >> 8) as usize % bytes.len();
                bytes[at] = (seed >> 24) as u8;
            }
            let mut heard = Heard::default();
            session.hear(&bytes, &mut heard);
            assert!(heard.answer.len() < 1000 && heard.frames.len() <= 1);
            if heard.close.is_some() {
                session = raw();
            }
        }
    }
}
