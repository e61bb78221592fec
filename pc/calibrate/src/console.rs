//! Who puts the housing down: asked in words, answers by a line.
//!
//! In: what is to be done. Out: that it is done, or that nobody answers any more. While a line is
//! waited for the bus is heard, so that Ctrl-C ends the waiting and no frame piles up.
//!
//! Left out: what the answers are about.

use std::io::BufRead;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::Duration;

use super::error::CalibrateError;
use super::session::Session;

/// How long the bus is heard between two looks for a line.
pub const GLANCE: Duration = Duration::from_millis(30);

/// A person, or a script in the person's place.
#[derive(Debug)]
pub struct Console {
    /// `None`: nobody is asked, and the sensor tells what happens.
    lines: Option<Receiver<String>>,
}

/// What was answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Go on.
    Done,
    /// No line will come any more.
    Ended,
}

impl Console {
    /// Answers come as lines on the standard input; with `yes` none are wanted.
    pub fn new(yes: bool) -> Self {
        if yes {
            return Self { lines: None };
        }
        let (sender, lines) = channel();
        thread::spawn(move || {
            for line in std::io::stdin().lock().lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        Self { lines: Some(lines) }
    }

    /// Whether somebody answers.
    pub const fn asks(&self) -> bool {
        self.lines.is_some()
    }

    /// Waits for a line, when somebody answers at all.
    ///
    /// Errors: a lost bus, and [`CalibrateError::Interrupted`].
    pub fn wait(&self, session: &mut Session) -> Result<Answer, CalibrateError> {
        let answer = session.meanwhile(GLANCE, |wait| self.wait_while(wait))?;
        Ok(answer.unwrap_or(Answer::Ended))
    }

    /// The same for as long as `wait`, which is called again and again, is true; `None` when it is
    /// no more.
    pub fn wait_while(&self, wait: &mut dyn FnMut() -> bool) -> Option<Answer> {
        let Some(lines) = &self.lines else {
            return Some(Answer::Done);
        };
        loop {
            match lines.try_recv() {
                Ok(_) => return Some(Answer::Done),
                Err(TryRecvError::Disconnected) => return Some(Answer::Ended),
                Err(TryRecvError::Empty) if wait() => {}
                Err(TryRecvError::Empty) => return None,
            }
        }
    }
}

/// A line for the person, beside what is printed as the result.
pub fn tell(line: &str) {
    eprintln!("{line}");
}
