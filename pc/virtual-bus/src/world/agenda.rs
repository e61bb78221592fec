//! Words that come in as lines, and those of them that were put off.
//!
//! In: a line of a person or of a program. Out: what it came to; later, the words that were put
//! off, each when its time has come.
//!
//! Left out: who sent the line, and how it is answered (`ports/twin`, `server`).

use super::effects::Done;
use super::stage::Stage;
use crate::words::line::{Line, When, Word, read};
use crate::words::reader::WordError;

/// When a `wait` is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Until {
    /// At this time, ns.
    Time(u64),
    /// When the housing stands.
    Still,
}

/// What a line came to.
#[derive(Debug, PartialEq)]
pub enum Outcome {
    /// It was carried out.
    Done(Done),
    /// It will be carried out at this time, ns.
    PutOff(u64),
    /// Who sent it wants to wait.
    Wait(Until),
}

/// Words that were put off, with their times in ns.
#[derive(Debug, Default)]
pub struct Agenda(Vec<(u64, Word)>);

impl Agenda {
    /// Carries out a line, or puts it off.
    ///
    /// Errors: what is wrong with the line, or why nothing has changed.
    pub fn hear(&mut self, line: &str, stage: &mut Stage) -> Result<Outcome, WordError> {
        let Some(Line { when, word }) = read(line, stage.network.node_count())? else {
            return Ok(Outcome::Done(Done::Quietly));
        };
        let now_ns = stage.network.now_ns();
        let at_ns = when.at_ns(now_ns);
        match (word, when) {
            (Word::Wait(None), When::Now) => Ok(Outcome::Wait(Until::Still)),
            (Word::Wait(Some(s)), When::Now) => {
                Ok(Outcome::Wait(Until::Time(When::After(s).at_ns(now_ns))))
            }
            (word, _) if at_ns > now_ns && !word.is_for_scripts() => {
                self.0.push((at_ns, word));
                Ok(Outcome::PutOff(at_ns))
            }
            (word, _) => stage.obey(&word).map(Outcome::Done),
        }
    }

    /// When the next word is due, ns; the end of time when there is none.
    pub fn due_ns(&self) -> u64 {
        self.0.iter().map(|(at, _)| *at).min().unwrap_or(u64::MAX)
    }

    /// The next word whose time has come.
    pub fn take_due(&mut self, now_ns: u64) -> Option<Word> {
        let place = self.0.iter().position(|(at, _)| *at <= now_ns)?;
        Some(self.0.remove(place).1)
    }
}
