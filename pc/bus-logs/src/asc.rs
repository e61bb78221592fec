//! Vector's ASC: the text log of CANoe, CANalyzer and many other tools.
//!
//! | line | what it is |
//! |---|---|
//! | `date Tue Nov 14 10:13:20.123 pm 2023` | the start, without a zone: taken as UTC |
//! | `Begin Triggerblock Tue Nov 14 ...` | what times count from, where the date above is not |
//! | `base hex  timestamps absolute` | also `dec`; times since the start or `relative` |
//! | `0.010000 1  181  Rx   d 2 E8 03` | data frame; an `x` behind the identifier is 29 bit |
//! | `0.010000 1  701  Tx   r 1` | remote frame |
//! | `0.010000 CANFD 1 Rx 181 0 0 d 8 8 ...` | a classical frame by its flags, or counted |
//! | `0.010000 1  ErrorFrame` | error frame, counted |
//!
//! In: the lines in their order, since times may count from line to line. Out: time, channel and
//! frame. A `TxRq` is a wish and not a frame; bus statistics and the like are other events.

use canopen::Frame;
use canopen::frame::Id;

use crate::candump::Entry;
use crate::cursor::{Cursor, data_frame, identifier, remote_frame};
use crate::date::{since_1970_ns, time_of_day};
use crate::skipped::Skip;

/// Bit of a CANFD event's flags that is set in an FD frame, and the one of a remote frame.
const FD_FLAG: u32 = 1 << 12;
const REMOTE_FLAG: u32 = 1 << 4;

/// Names of months as tools in English and German write them.
const MONTHS: [&[&str]; 12] = [
    &["jan"],
    &["feb"],
    &["mar", "mär", "mrz"],
    &["apr"],
    &["may", "mai"],
    &["jun"],
    &["jul"],
    &["aug"],
    &["sep"],
    &["oct", "okt"],
    &["nov"],
    &["dec", "dez"],
];

/// What may lie between a trigger and its first event by the date that both were rounded to, ns.
const ROUNDING_NS: u64 = 1_000_000_000;

/// What the lines so far have set.
#[derive(Clone, Debug, Default)]
pub struct Asc {
    /// When the log was started, ns since 1970; 0 where it doesn't state it.
    start_ns: u64,
    /// When the block was begun that no event was seen of, ns since 1970.
    block_ns: Option<u64>,
    decimal: bool,
    relative: bool,
    /// The time of the line before, since the start.
    before_ns: u64,
}

impl Asc {
    /// Reads a line.
    pub fn parse<'a>(&mut self, line: &'a [u8]) -> Result<Entry<'a>, Skip> {
        let mut words = Cursor(line);
        words.blanks();
        if words.is_empty() {
            return Err(Skip::NoFrame);
        }
        let Ok(time_ns) = words.seconds_ns() else {
            return Err(self.header(line));
        };
        if !words.is_empty() && !matches!(words.peek(), Some(b' ' | b'\t')) {
            return Err(Skip::Unreadable);
        }
        let since_ns = if self.relative {
            self.before_ns.saturating_add(time_ns)
        } else {
            time_ns
        };
        self.before_ns = since_ns;
        let channel = words.next_word()?;
        let (channel, frame) = if channel == b"CANFD" {
            self.settle_start(since_ns);
            fd_event(&mut words, self.decimal)?
        } else {
            let is_number = channel.iter().all(u8::is_ascii_digit);
            if !is_number {
                return Err(Skip::NoFrame);
            }
            self.settle_start(since_ns);
            (channel, event(&mut words, self.decimal)?)
        };
        Ok((self.start_ns.saturating_add(since_ns), channel, frame))
    }

    /// At the first event of a block: times count from the start of the measurement, unless the
    /// block was begun before that or long after the event. Tools that write a file later give it
    /// the date of the writing, and count from the block.
    fn settle_start(&mut self, since_ns: u64) {
        let Some(block_ns) = self.block_ns.take() else {
            return;
        };
        let event_ns = self.start_ns.saturating_add(since_ns);
        if block_ns < self.start_ns || event_ns.saturating_add(ROUNDING_NS) < block_ns {
            self.start_ns = block_ns;
        }
    }

    /// A line without a time.
    fn header(&mut self, line: &[u8]) -> Skip {
        let text = String::from_utf8_lossy(line).to_ascii_lowercase();
        let mut words = text.split_ascii_whitespace();
        match words.next() {
            Some("date") => self.start_ns = date(words).unwrap_or(0),
            Some("base") => {
                self.decimal = words.next() == Some("dec");
                self.relative = words.any(|word| word == "relative");
            }
            Some("begin") => {
                let is_block = words.next() == Some("triggerblock");
                self.block_ns = is_block.then(|| date(words)).flatten();
            }
            Some("end" | "no" | "internal" | "version" | "previous" | "split") => {}
            Some(word) if word.starts_with("//") => {}
            _ => return Skip::Unreadable,
        }
        Skip::NoFrame
    }
}

/// `Tue Nov 14 10:13:20.123 pm 2023`, in small letters; also with 24 hours and no `pm`.
fn date<'a>(words: impl Iterator<Item = &'a str>) -> Option<u64> {
    let words: Vec<_> = words.take(8).collect();
    let month_of = |word: &str| {
        let mut months = (1..).zip(MONTHS);
        months.find(|(_, names)| names.iter().any(|name| word.starts_with(name)))
    };
    // The day of the week comes first and may look like a month.
    let mut found = words.iter().enumerate().skip(1);
    let (at, month) = found.find_map(|(at, word)| Some((at, month_of(word)?.0)))?;
    let day = words.get(at + 1)?.trim_end_matches('.').parse().ok()?;
    let (mut second, ns) = time_of_day(words.get(at + 2)?)?;
    let afternoon = words.contains(&"pm");
    if (afternoon || words.contains(&"am")) && second >= 12 * 3600 {
        second -= 12 * 3600;
    }
    second += if afternoon { 12 * 3600 } else { 0 };
    let year = words.last()?.parse().ok()?;
    since_1970_ns(year, month, day, (second, ns))
}

/// A number in the base of the log; `None` when the word is none.
fn number(word: &[u8], decimal: bool) -> Option<u32> {
    let mut digits = Cursor(word);
    let value = if decimal {
        u32::try_from(digits.digits().0).ok()?
    } else {
        let (value, count) = digits.hex_digits();
        (count <= 8).then_some(value)?
    };
    (digits.is_empty() && !word.is_empty()).then_some(value)
}

/// An identifier; one that is a name has its number in `ID = ` at the end of the line.
fn id(word: &[u8], rest: &[u8], decimal: bool) -> Result<Id, Skip> {
    let of = |word: &[u8], decimal| match word {
        [digits @ .., b'x' | b'X'] => Some((number(digits, decimal)?, true)),
        _ => Some((number(word, decimal)?, false)),
    };
    let (value, extended) = match of(word, decimal) {
        Some(found) => found,
        None => {
            let at = memchr::memmem::find(rest, b"ID = ").ok_or(Skip::Unreadable)?;
            let word = Cursor(rest.get(at + 5..).unwrap_or(&[])).word();
            of(word, true).ok_or(Skip::Unreadable)?
        }
    };
    identifier(value, extended)
}

/// What follows the channel: `181  Rx   d 2 E8 03`.
fn event(words: &mut Cursor<'_>, decimal: bool) -> Result<Frame, Skip> {
    let name = words.next_word()?;
    if name.starts_with(b"ErrorFrame") {
        return Err(Skip::ErrorFrame);
    }
    match words.next_word() {
        Ok(b"Rx" | b"Tx") => {}
        // A line cut here can't be told from an event of one word, of which there are many.
        Ok(_) | Err(_) => return Err(Skip::NoFrame),
    }
    let kind = words.next_word()?;
    let id = id(name, words.0, decimal)?;
    match kind {
        b"r" => {
            let asked = words
                .next_word()
                .ok()
                .and_then(|word| number(word, decimal));
            remote_frame(id, u64::from(asked.unwrap_or(0).min(8)))
        }
        b"d" => {
            let length = number(words.next_word()?, decimal).ok_or(Skip::Unreadable)?;
            if length > 15 {
                return Err(Skip::Unreadable);
            }
            data(words, id, length.min(8) as usize, decimal)
        }
        _ => Err(Skip::Unreadable),
    }
}

fn data(words: &mut Cursor<'_>, id: Id, length: usize, decimal: bool) -> Result<Frame, Skip> {
    let mut bytes = [0; 8];
    let bytes = bytes.get_mut(..length).ok_or(Skip::Unreadable)?;
    for byte in bytes.iter_mut() {
        let value = number(words.next_word()?, decimal);
        let value = value.and_then(|value| u8::try_from(value).ok());
        *byte = value.ok_or(Skip::Unreadable)?;
    }
    data_frame(id, bytes)
}

/// What follows `CANFD`: channel, direction, identifier, perhaps a name, two bits, length code,
/// length, data, duration, bits, flags.
fn fd_event<'a>(words: &mut Cursor<'a>, decimal: bool) -> Result<(&'a [u8], Frame), Skip> {
    let channel = words.next_word()?;
    match words.next_word()? {
        b"Rx" | b"Tx" => {}
        b"ErrorFrame" => return Err(Skip::ErrorFrame),
        _ => return Err(Skip::NoFrame),
    }
    let name = words.next_word()?;
    if name.starts_with(b"ErrorFrame") {
        return Err(Skip::ErrorFrame);
    }
    let mut bit = words.next_word()?;
    // A name may stand behind the number; the first bit is one character, 0 or 1.
    if !matches!(bit, b"0" | b"1") {
        bit = words.next_word()?;
    }
    let other = words.next_word()?;
    if !matches!((bit, other), (b"0" | b"1", b"0" | b"1")) {
        return Err(Skip::Unreadable);
    }
    let code = number(words.next_word()?, false).ok_or(Skip::Unreadable)?;
    let length = number(words.next_word()?, true).ok_or(Skip::Unreadable)?;
    if bit == b"1" || length > 8 {
        return Err(Skip::Fd);
    }
    let id = id(name, words.0, decimal)?;
    let frame = data(words, id, length as usize, decimal)?;
    words.next_word()?;
    words.next_word()?;
    let flags = number(words.next_word()?, false).ok_or(Skip::Unreadable)?;
    if flags & FD_FLAG != 0 {
        return Err(Skip::Fd);
    }
    if flags & REMOTE_FLAG != 0 {
        return Ok((channel, remote_frame(id, u64::from(code.min(8)))?));
    }
    Ok((channel, frame))
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::frame::ExtendedId;

    const START: u64 = 1_700_000_000_123_000_000;

    fn read(text: &str) -> Vec<Result<(u64, String, Frame), Skip>> {
        let mut asc = Asc::default();
        let lines = text.lines();
        lines
            .map(|line| {
                let (time_ns, channel, frame) = asc.parse(line.as_bytes())?;
                let channel = String::from_utf8_lossy(channel).into_owned();
                Ok((time_ns, channel, frame))
            })
            .collect()
    }

    fn one(header: &str, line: &str) -> Result<(u64, String, Frame), Skip> {
        read(&format!("{header}\n{line}")).pop().unwrap()
    }

    #[test]
    fn frames_of_every_form() {
        let header = "date Tue Nov 14 10:13:20.123 pm 2023\nbase hex  timestamps absolute";
        let data = Frame::data_frame(0x181, &[0xE8, 3]);
        let long = Frame::with(ExtendedId::new(0x18DA_F110).unwrap(), &[1]).unwrap();
        let remote = Frame::remote(canopen::frame::standard(0x701), 1).unwrap();
        let cases = [
            ("   0.010000 1  181             Rx   d 2 E8 03", data),
            (
                "0.010000 1 181 Tx d 2 e8 3 Length = 0 BitCount = 64 ID = 385",
                data,
            ),
            (
                "0.010000 1  Slopes  Rx   d 2 E8 03  Length = 1 BitCount = 2 ID = 385",
                data,
            ),
            ("0.010000 1  18DAF110x  Rx   d 1 01", long),
            ("0.010000 1  Other  Rx  d 1 01  ID = 417001744x", long),
            ("0.010000 1  701  Rx   r 1", remote),
            (
                "0.010000 CANFD   1 Rx   181  0 0 2  2 E8 03  130000  130 0 0 0 0",
                data,
            ),
            (
                "0.010000 CANFD   1 Rx   181  Slopes  0 0 2  2 E8 03  130000  130 0 0 0",
                data,
            ),
            (
                "0.010000 CANFD   1 Rx   701  0 0 1  0  130000  130 10 0 0",
                remote,
            ),
        ];
        for (line, frame) in cases {
            let want = (START + 10_000_000, "1".to_owned(), frame);
            assert_eq!(one(header, line), Ok(want), "{line}");
        }
        let dec = header.replace("hex", "dec");
        let want = (START + 10_000_000, "1".to_owned(), data);
        assert_eq!(one(&dec, "0.010000 1 385 Rx d 2 232 3"), Ok(want));
    }

    #[test]
    fn what_is_no_frame_has_a_reason() {
        let cases = [
            ("// version 9.0.0", Skip::NoFrame),
            ("no internal events logged", Skip::NoFrame),
            (
                "Begin Triggerblock Tue Nov 14 10:13:20.123 pm 2023",
                Skip::NoFrame,
            ),
            ("End TriggerBlock", Skip::NoFrame),
            ("   0.000000 Start of measurement", Skip::NoFrame),
            (
                "   0.5 1  Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0 B 0.05%",
                Skip::NoFrame,
            ),
            ("0.5 1 181 TxRq d 1 00", Skip::NoFrame),
            ("0.5 1  ErrorFrame", Skip::ErrorFrame),
            ("0.5 CANFD 1 Rx ErrorFrame", Skip::ErrorFrame),
            (
                "0.5 CANFD 1 Rx 181 1 0 a 16 00 11 22 33 44 55 66 77 88 99 AA",
                Skip::Fd,
            ),
            (
                "0.5 CANFD 1 Rx 181 0 0 2 2 E8 03 130000 130 1000 0",
                Skip::Fd,
            ),
            ("0.5", Skip::Cut),
            ("0.5 1 181 Rx", Skip::Cut),
            ("0.5 1 181 Rx d 2 E8", Skip::Cut),
            ("0.5 1 881 Rx d 1 00", Skip::Unreadable),
            ("0.5 1 181 Rx d 1 1E8", Skip::Unreadable),
            ("0.5 1 181 Rx q 1 00", Skip::Unreadable),
            ("0.5x 1 181 Rx d 1 00", Skip::Unreadable),
            ("what is this", Skip::Unreadable),
        ];
        for (line, why) in cases {
            assert_eq!(
                one("base hex timestamps absolute", line),
                Err(why),
                "{line}"
            );
        }
    }

    #[test]
    fn relative_times_count_from_the_line_before_whatever_it_was() {
        let found = read(
            "base hex timestamps relative\n1.0 1 181 Rx d 0\n0.5 1 ErrorFrame\n0.25 1 181 Rx d 0",
        );
        let times: Vec<_> = found.iter().flatten().map(|entry| entry.0).collect();
        assert_eq!(times, [1_000_000_000, 1_750_000_000]);
    }

    #[test]
    fn dates_of_several_tools() {
        let dates = [
            ("Tue Nov 14 10:13:20.123 pm 2023", START),
            ("Tue Nov 14 10:13:20.123 PM 2023", START),
            ("Tue Nov 14 22:13:20.123 2023", START),
            ("Die Nov 14 22:13:20.123 2023", START),
            ("Fri Mar 1 12:00:01 am 2024", 1_709_251_201_000_000_000),
            ("Fre Mär 1 12:00:01 pm 2024", 1_709_294_401_000_000_000),
            ("Mar Mar 1 00:00:01 2024", 1_709_251_201_000_000_000),
            ("gestern", 0),
        ];
        for (text, start_ns) in dates {
            let found = one(
                &format!("date {text}\nbase hex timestamps absolute"),
                "0 1 80 Rx d 0",
            );
            assert_eq!(found.unwrap().0, start_ns, "{text}");
        }
    }

    #[test]
    fn a_file_written_later_was_dated_by_its_writing() {
        const S: u64 = 1_000_000_000;
        let block = "Tue Nov 14 10:13:20.123 pm 2023";
        let cases = [
            // Written later, or begun long before the first frame: times count from the block.
            ("Tue Nov 14 10:16:00.000 pm 2023", "0.5", START + S / 2),
            ("Tue Nov 14 10:00:00.000 pm 2023", "0.5", START + S / 2),
            ("", "0.5", START + S / 2),
            // Triggered 800 s behind the start, which times count from.
            ("Tue Nov 14 10:00:00.123 pm 2023", "800.5", START + S / 2),
            (block, "0.5", START + S / 2),
            (block, "800.5", START + 800 * S + S / 2),
        ];
        for (date, time, want_ns) in cases {
            let header = format!(
                "date {date}\nbase hex timestamps absolute\nBegin Triggerblock {block}\n\
                 0.000000 Start of measurement"
            );
            let found = one(&header, &format!("{time} 1 80 Rx d 0"));
            assert_eq!(found.unwrap().0, want_ns, "{date} {time}");
        }
    }
}
