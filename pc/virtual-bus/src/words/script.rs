//! A script: what happens to the virtual instrument, line after line, in virtual time.
//!
//! In: the text of a file. Out: the lines that are due, and when the next one is. All of the file
//! is read and checked before the first line is carried out.
//!
//! A line without a time is carried out together with the one before it. `wait` puts off all
//! that follow; `+SECONDS` counts from the line before, `at SECONDS` from the begin of the script.
//!
//! Left out: variables, conditions and loops other than `repeat`; a program that wants them can
//! type the words.

use std::path::{Path, PathBuf};

use sim::network::hand::Pose;

use super::line::{Line, When, Word, read};
use super::reader::WordError;
use crate::error::{Complaint, ServeError};

/// The longest script, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// A script that has been read.
#[derive(Clone, Debug)]
pub struct Script {
    /// Where it was read from; empty for one that was not.
    path: PathBuf,
    lines: Vec<Line>,
    next: usize,
    /// When this round of it began, s.
    begin_s: f64,
    /// The earliest time of the next line, s.
    earliest_s: f64,
    /// Waiting until the housing stands still.
    until_still: bool,
}

/// What a script wants now.
#[derive(Clone, Debug, PartialEq)]
pub enum Wanted {
    /// Carry out this.
    Word(Word),
    /// Nothing before this time, s.
    Later(f64),
    /// Nothing before the housing stands still.
    Stillness,
    /// Nothing ever, and serve on.
    Nothing,
    /// It has ended; where it was read from.
    End(PathBuf),
}

/// Reads a script from a file, for so many nodes.
///
/// Errors: [`ServeError::ScriptFile`], [`ServeError::ScriptLong`], [`ServeError::ScriptEmpty`],
/// [`ServeError::ScriptLine`].
pub fn open(path: &Path, nodes: usize) -> Result<Script, ServeError> {
    let failed = |error| ServeError::ScriptFile(path.to_owned(), error);
    if std::fs::metadata(path).map_err(failed)?.len() > MOST_BYTES {
        return Err(ServeError::ScriptLong(path.to_owned(), MOST_BYTES >> 10));
    }
    let bytes = std::fs::read(path).map_err(failed)?;
    let script = text(&bytes).and_then(|text| Script::new(text, nodes));
    let bad = |(line, complaint)| ServeError::ScriptLine(path.to_owned(), line, complaint);
    match script.map_err(bad)? {
        Script { lines, .. } if lines.is_empty() => Err(ServeError::ScriptEmpty(path.to_owned())),
        script => Ok(Script {
            path: path.to_owned(),
            ..script
        }),
    }
}

/// The text in these bytes, without the mark that some editors put first; else the line that is
/// none, from 1.
fn text(bytes: &[u8]) -> Result<&str, (usize, Complaint)> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let good = bytes.iter().take(error.valid_up_to());
        let line = 1 + good.filter(|byte| **byte == b'\n').count();
        (line, Complaint::NoText)
    })?;
    Ok(text.trim_start_matches('\u{FEFF}'))
}

/// What is known of a script while it is read.
#[derive(Default)]
struct Check {
    earliest_s: f64,
    pose: Pose,
    ended: Option<&'static str>,
}

impl Check {
    fn line(&mut self, line: &Line) -> Result<(), Complaint> {
        if let Some(word) = self.ended {
            return Err(Complaint::NeverReached(word));
        }
        match line.when {
            When::Now => {}
            When::After(s) => self.earliest_s += s,
            When::At(s) if s < self.earliest_s => {
                return Err(Complaint::Backwards(self.earliest_s));
            }
            When::At(s) => self.earliest_s = s,
        }
        match line.word {
            Word::Wait(time) => self.earliest_s += time.unwrap_or(0.0),
            Word::Hold => self.ended = Some("hold"),
            Word::Quit => self.ended = Some("quit"),
            Word::Repeat if self.earliest_s == 0.0 => return Err(Complaint::NoTime),
            Word::Repeat => self.ended = Some("repeat"),
            _ => {}
        }
        self.pose = line.word.pose(self.pose).unwrap_or(self.pose);
        match self.pose.is_possible() {
            true => Ok(()),
            false => Err(WordError::Impossible(self.pose).into()),
        }
    }
}

impl Script {
    /// Reads a script for so many nodes; on an error the line, from 1, and what is wrong with it.
    pub fn new(text: &str, nodes: usize) -> Result<Self, (usize, Complaint)> {
        let mut lines = Vec::new();
        let mut check = Check::default();
        for (text, number) in text.lines().zip(1..) {
            let line = read(text, nodes).map_err(|e| (number, Complaint::Word(e)))?;
            let Some(line) = line else { continue };
            check.line(&line).map_err(|complaint| (number, complaint))?;
            lines.push(line);
        }
        Ok(Self {
            path: PathBuf::new(),
            lines,
            next: 0,
            begin_s: 0.0,
            earliest_s: 0.0,
            until_still: false,
        })
    }

    /// What it wants at `now_s`, with the housing at rest or not. A word is given once.
    pub fn next(&mut self, now_s: f64, still: bool) -> Wanted {
        loop {
            if self.until_still && !still {
                return Wanted::Stillness;
            }
            if std::mem::take(&mut self.until_still) {
                self.earliest_s = self.earliest_s.max(now_s);
            }
            let Some(line) = self.lines.get(self.next) else {
                return self.after_the_last(now_s, still);
            };
            let due_s = match line.when {
                When::Now => self.earliest_s,
                When::After(s) => self.earliest_s + s,
                When::At(s) => self.begin_s + s,
            };
            if due_s > now_s {
                return Wanted::Later(due_s);
            }
            self.earliest_s = self.earliest_s.max(due_s);
            self.next += 1;
            match &line.word {
                Word::Wait(Some(s)) => self.earliest_s += s,
                Word::Wait(None) => self.until_still = true,
                Word::Hold => {}
                Word::Repeat => {
                    self.next = 0;
                    self.begin_s = self.earliest_s;
                }
                word => return Wanted::Word(word.clone()),
            }
        }
    }

    /// A script has ended when its last wait and its last turn have.
    fn after_the_last(&self, now_s: f64, still: bool) -> Wanted {
        match self.lines.last().map(|line| &line.word) {
            Some(Word::Hold) => Wanted::Nothing,
            _ if self.earliest_s > now_s => Wanted::Later(self.earliest_s),
            _ if still => Wanted::End(self.path.clone()),
            _ => Wanted::Stillness,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn script(text: &str) -> Script {
        Script::new(text, 2).unwrap_or_else(|(line, c)| panic!("line {line}: {c}"))
    }

    fn said(text: &str) -> (usize, String) {
        let (line, complaint) = Script::new(text, 2).unwrap_err();
        (line, complaint.to_string())
    }

    #[test]
    fn lines_come_at_their_times() {
        let mut script = script("rate 80\npitch 30\nwait 2\nlevel\n+1 roll 5\nat 9 status\n");
        assert_eq!(script.next(0.0, true), Wanted::Word(Word::Rate(80.0)));
        assert_eq!(script.next(0.0, true), Wanted::Word(Word::Pitch(30.0)));
        assert_eq!(script.next(0.0, false), Wanted::Later(2.0));
        assert_eq!(script.next(2.0, true), Wanted::Word(Word::Level));
        assert_eq!(script.next(2.0, false), Wanted::Later(3.0));
        assert_eq!(script.next(3.0, false), Wanted::Word(Word::Roll(5.0)));
        assert_eq!(script.next(3.0, false), Wanted::Later(9.0));
        assert_eq!(script.next(9.0, true), Wanted::Word(Word::Status));
        assert_eq!(script.next(9.0, true), Wanted::End(PathBuf::new()));
    }

    #[test]
    fn it_waits_for_the_housing_and_counts_from_there() {
        let mut script = script("pitch 30\nwait\n+1 level");
        assert_eq!(script.next(0.0, true), Wanted::Word(Word::Pitch(30.0)));
        assert_eq!(script.next(0.1, false), Wanted::Stillness);
        assert_eq!(script.next(1.5, true), Wanted::Later(2.5));
        assert_eq!(script.next(2.5, true), Wanted::Word(Word::Level));
        assert_eq!(script.next(2.6, false), Wanted::Stillness);
        assert_eq!(script.next(3.0, true), Wanted::End(PathBuf::new()));
    }

    #[test]
    fn a_wait_at_the_end_is_waited_for() {
        let mut script = script("level\nwait 2");
        assert_eq!(script.next(0.0, true), Wanted::Word(Word::Level));
        assert_eq!(script.next(0.5, true), Wanted::Later(2.0));
        assert_eq!(script.next(2.0, true), Wanted::End(PathBuf::new()));
    }

    #[test]
    fn hold_never_ends_and_repeat_begins_again_without_drift() {
        assert_eq!(script("hold").next(5.0, true), Wanted::Nothing);
        let mut script = script("at 1 pitch 3\nwait 1\nrepeat");
        assert_eq!(script.next(1.25, true), Wanted::Word(Word::Pitch(3.0)));
        assert_eq!(script.next(2.5, true), Wanted::Later(3.0));
        assert_eq!(script.next(3.0, true), Wanted::Word(Word::Pitch(3.0)));
    }

    #[test]
    fn what_is_wrong_is_found_before_the_start_and_named_by_its_line() {
        assert_eq!(said("level\n\nfly 3").0, 3);
        assert_eq!(said("at 5 level\nat 3 level").0, 2);
        assert!(said("wait 4\nat 3 level").1.contains("take 4 s"));
        assert!(said("pitch 60\nroll 40").1.contains("pitch 60 and roll 40"));
        assert!(said("hold\nlevel").1.contains("behind `hold`"));
        assert!(said("pitch 3\nrepeat").1.contains("has to take time"));
    }

    #[test]
    fn bytes_that_are_no_text_were_complained_about_without_their_line() {
        let said = text(b"pitch 3\nroll 4 # \xC3\xA4\n# \xE4\nhold").unwrap_err();
        assert_eq!(said.0, 3);
        assert!(said.1.to_string().contains("UTF-8"));
        assert_eq!(text(b"\xEF\xBB\xBFhold").unwrap(), "hold");
    }
}
