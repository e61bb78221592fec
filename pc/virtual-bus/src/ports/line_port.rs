//! Where programs that speak to a virtual device connect.
//!
//! In: an address, and a device (the motor, the chamber). Out: the answers to its lines, and the
//! device's queue of errors (IEEE 488.2, SCPI-1999 volume 2, chapter 21).
//!
//! Left out: what the lines mean (`motor`, `climate`), and how they travel (`line_server`).

use std::collections::VecDeque;
use std::fmt::Debug;
use std::net::SocketAddr;

use super::line_server::{LineServer, Manner, Request};
use crate::error::ServeError;
use crate::world::stage::Stage;

/// A device sends nothing unasked; no word of one is longer.
const MANNER: Manner = Manner {
    greeting: "",
    longest: 256,
};

/// Errors that wait to be asked for.
const ERRORS_LIMIT: usize = 10;

/// What a line comes to.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// No answer.
    Nothing,
    /// This line.
    Line(String),
    /// `1`, as soon as the housing stands.
    WhenStill,
}

/// An error by its number and text, as SCPI has them.
pub type Error = (i32, &'static str);

/// The line is no word of the device.
pub const UNDEFINED: Error = (-113, "Undefined header");
/// What should be a number is none.
pub const NO_NUMBER: Error = (-120, "Numeric data error");
/// The number is beyond what the device can do.
pub const OUT_OF_RANGE: Error = (-222, "Data out of range");
/// The device can't do this with what it does already.
pub const CONFLICT: Error = (-221, "Settings conflict");

/// A number within bounds.
///
/// Errors: [`NO_NUMBER`], [`OUT_OF_RANGE`].
pub fn number(text: &str, low: f64, high: f64) -> Result<f64, Error> {
    let number: f64 = text.parse().map_err(|_| NO_NUMBER)?;
    if (low..=high).contains(&number) {
        Ok(number)
    } else {
        Err(OUT_OF_RANGE)
    }
}

/// A device that is spoken to in lines.
pub trait LineDevice: Debug {
    /// What kind of device it is.
    fn model(&self) -> &'static str;

    /// Carries out a line of its own words, in capital letters.
    ///
    /// Errors: [`UNDEFINED`] for what is none, and what else SCPI has.
    fn obey(&mut self, words: &[&str], stage: &mut Stage) -> Result<Answer, Error>;
}

/// A device with the words that all of them have: `*IDN?` and `SYST:ERR?`.
#[derive(Debug)]
pub struct Lines {
    device: Box<dyn LineDevice>,
    /// Its serial number.
    seed: u64,
    errors: VecDeque<Error>,
}

impl Lines {
    /// This device, with its serial number and without an error.
    pub fn new(device: Box<dyn LineDevice>, seed: u64) -> Self {
        Self {
            device,
            seed,
            errors: VecDeque::new(),
        }
    }

    /// Maker, model, serial number and release.
    fn identity(&self) -> String {
        let (model, seed) = (self.device.model(), self.seed);
        format!("Plumb,{model},{seed},{}", env!("CARGO_PKG_VERSION"))
    }

    /// Carries out a line.
    pub fn hear(&mut self, line: &str, stage: &mut Stage) -> Answer {
        let words: Vec<String> = line
            .split_ascii_whitespace()
            .map(str::to_ascii_uppercase)
            .collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let outcome = match words[..] {
            [] => Ok(Answer::Nothing),
            ["*IDN?"] => Ok(Answer::Line(self.identity())),
            ["SYST:ERR?"] => {
                let (number, text) = self.errors.pop_front().unwrap_or((0, "No error"));
                Ok(Answer::Line(format!("{number},\"{text}\"")))
            }
            _ => self.device.obey(&words, stage),
        };
        outcome.unwrap_or_else(|error| {
            // A full queue keeps the first of them, which are what went wrong.
            if self.errors.len() < ERRORS_LIMIT {
                self.errors.push_back(error);
            }
            Answer::Nothing
        })
    }
}

/// A port with a device behind it.
#[derive(Debug)]
pub struct LinePort {
    lines: Lines,
    server: LineServer,
    /// Those who wait until the housing stands.
    waiting: Vec<Request>,
    /// Where it listens.
    pub at: SocketAddr,
}

impl LinePort {
    /// Listens there; port 0 is any free one. `option` is the one that asks for it.
    ///
    /// Errors: [`ServeError::PortInUse`], [`ServeError::Listen`], [`ServeError::Thread`].
    pub fn listen(
        at: SocketAddr,
        option: &'static str,
        (device, seed): (Box<dyn LineDevice>, u64),
    ) -> Result<Self, ServeError> {
        let server = LineServer::listen(at, option, MANNER)?;
        Ok(Self {
            lines: Lines::new(device, seed),
            at: server.at,
            server,
            waiting: Vec::new(),
        })
    }

    /// Carries out what has come, and answers those who waited for the housing to stand.
    pub fn serve(&mut self, stage: &mut Stage) {
        while let Some(request) = self.server.next() {
            // One that goes without an answer ends the conversation.
            let Some(line) = request.line() else {
                continue;
            };
            match self.lines.hear(line, stage) {
                Answer::Nothing => request.answer(""),
                Answer::Line(text) => request.answer(&text),
                Answer::WhenStill => self.waiting.push(request),
            }
        }
        if stage.is_still() {
            for request in self.waiting.drain(..) {
                request.answer("1");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim::network::Network;

    /// Takes no word at all.
    #[derive(Debug)]
    struct Deaf;

    impl LineDevice for Deaf {
        fn model(&self) -> &'static str {
            "Deaf"
        }

        fn obey(&mut self, _: &[&str], _: &mut Stage) -> Result<Answer, Error> {
            Err(UNDEFINED)
        }
    }

    #[test]
    fn a_full_queue_of_errors_keeps_the_first() {
        let mut stage = Stage::new(Network::new(250_000, 1), 1);
        let mut lines = Lines::new(Box::new(Deaf), 7);
        assert_eq!(
            lines.hear("*idn?", &mut stage),
            Answer::Line(format!("Plumb,Deaf,7,{}", env!("CARGO_PKG_VERSION")))
        );
        for _ in 0..ERRORS_LIMIT + 5 {
            assert_eq!(lines.hear("what?", &mut stage), Answer::Nothing);
        }
        let mut told = 0;
        while lines.hear("SYST:ERR?", &mut stage) != Answer::Line("0,\"No error\"".to_owned()) {
            told += 1;
        }
        assert_eq!(told, ERRORS_LIMIT);
    }
}
