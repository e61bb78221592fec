//! What kind of log a file is, by what it begins with: names tell nothing.
//!
//! In: the first bytes of a text. Out: its [`Kind`], and the time of its first frame.

use std::io;
use std::path::Path;

use crate::asc::Asc;
use crate::candump;
use crate::error::LogError;
use crate::input::Input;
use crate::skipped::Skip;

/// A format that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `candump -L`, or what `candump` prints on a terminal.
    Candump,
    /// Vector ASC.
    Asc,
}

/// What the head of a file tells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Head {
    /// Its format; `None` when it is no log.
    pub kind: Option<Kind>,
    /// The time of the first frame, as the source gives it; `None` when the head has none.
    pub first_ns: Option<u64>,
    /// Whether it is UTF-16, which is no format but a common mishap.
    pub is_wide: bool,
    /// The format of a log that is not read.
    pub foreign: Option<&'static str>,
}

impl Head {
    /// Why a file of this name with this head is refused, if it is.
    pub fn refusal(&self, name: &str) -> Option<LogError> {
        let name = || name.to_owned();
        if self.is_wide {
            return Some(LogError::Wide(name()));
        }
        self.foreign.map(|format| LogError::Foreign(name(), format))
    }
}

/// What logs begin with that are often met and not read.
const FOREIGN: [(&[u8], &str); 2] = [(b"LOGG\x90\0\0\0", "BLF"), (b";$FILEVERSION", "TRC")];

/// Looks at the head of a text; its last line may be cut.
pub fn look(head: &[u8]) -> Head {
    if matches!(head, [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..]) {
        return Head {
            is_wide: true,
            ..Head::default()
        };
    }
    if let Some((_, format)) = FOREIGN.iter().find(|(start, _)| head.starts_with(start)) {
        return Head {
            foreign: Some(*format),
            ..Head::default()
        };
    }
    let mut asc = Asc::default();
    let mut found = Head::default();
    for line in head.split(|byte| *byte == b'\n') {
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        let (kind, read) = match found.kind {
            Some(Kind::Asc) => (Kind::Asc, asc.parse(line)),
            Some(Kind::Candump) => (Kind::Candump, candump::parse(line)),
            None => first_that_reads(&mut asc, line),
        };
        match read {
            Ok((time_ns, ..)) => {
                return Head {
                    kind: Some(kind),
                    first_ns: Some(time_ns),
                    ..Head::default()
                };
            }
            Err(Skip::Fd | Skip::ErrorFrame) => found.kind = Some(kind),
            Err(_) if is_asc_header(line) => found.kind = Some(Kind::Asc),
            Err(_) => {}
        }
    }
    found
}

fn first_that_reads<'a>(asc: &mut Asc, line: &'a [u8]) -> (Kind, Result<candump::Entry<'a>, Skip>) {
    let by_asc = asc.parse(line);
    match candump::parse(line) {
        by_candump @ (Ok(_) | Err(Skip::Fd | Skip::ErrorFrame)) => (Kind::Candump, by_candump),
        Err(_) => (Kind::Asc, by_asc),
    }
}

/// `base hex  timestamps absolute`, which no other text has.
fn is_asc_header(line: &[u8]) -> bool {
    let line = line.to_ascii_lowercase();
    line.starts_with(b"base hex") || line.starts_with(b"base dec")
}

/// Why a file is read neither as a log nor as anything else: it is UTF-16, or a log of a format
/// that is not read. `None` of any other file.
pub fn refusal(path: &Path) -> io::Result<Option<LogError>> {
    let mut input = Input::open(path, None)?;
    Ok(look(input.head()?).refusal(&path.display().to_string()))
}

/// What kind of log a file is; `None` when it is none.
pub fn kind_of(path: &Path) -> io::Result<Option<Kind>> {
    let mut input = Input::open(path, None)?;
    Ok(look(input.head()?).kind)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_is_known_by_what_it_holds() {
        let cases: [(&str, Option<Kind>, Option<u64>); 8] = [
            (
                "(1.5) can0 080#\n",
                Some(Kind::Candump),
                Some(1_500_000_000),
            ),
            (
                "#\n0) can0 1\n(1.5) can0 080#\n",
                Some(Kind::Candump),
                Some(1_500_000_000),
            ),
            ("  can0  080   [0]\n", Some(Kind::Candump), Some(0)),
            ("(1.5) can0 080##0\n", Some(Kind::Candump), None),
            (
                "date x\nbase hex timestamps absolute\n",
                Some(Kind::Asc),
                None,
            ),
            (
                "base hex\n 0.25 1 80 Rx d 0\n",
                Some(Kind::Asc),
                Some(250_000_000),
            ),
            ("time_s,ax_g,ay_g,az_g\n1.0,0,0,1\n", None, None),
            ("", None, None),
        ];
        for (text, kind, first_ns) in cases {
            let head = look(text.as_bytes());
            assert_eq!((head.kind, head.first_ns), (kind, first_ns), "{text}");
        }
        assert!(look(b"\xFF\xFE(\x001\x00").is_wide);
    }
}
