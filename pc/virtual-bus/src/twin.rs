//! Where `plumb twin` connects: words over TCP, answered one by one.
//!
//! In: lines of the words ([`super::words`]). Out: an [`Answer`] to each, as one line of JSON. A
//! word that was put off is answered at once, `wait` when it is over.
//!
//! Left out: how the lines travel (`line_server`), and the client (`plumb twin`).

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};

use serde::{Deserialize, Serialize};

use super::error::ServeError;
use super::line_server::{LineServer, Manner, Request};
use super::server::{Go, complain};
use super::stage::{Done, Stage};
use super::tcp::SOCKETCAND_PORT;
use super::words::{When, Word, read};

/// Where `plumb twin` finds a `plumb serve` that was started without options.
pub const TWIN_AT: SocketAddr =
    SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, SOCKETCAND_PORT + 1));

/// The option that asks for another place.
const OPTION: &str = "--twin";

/// The longest word with all that belongs to it, and a comment behind.
const LONGEST: u64 = 4096;

/// Told to who connects, so that a client knows what it has reached.
const MANNER: Manner = Manner {
    greeting: r#"{"format":"plumb-serve-answer","version":1,"accepted":true,"lines":[]}"#,
    longest: LONGEST,
};

/// What a word has come to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Answer {
    /// "plumb-serve-answer".
    pub format: String,
    /// 1.
    pub version: u32,
    /// False when nothing has changed and nothing will.
    pub accepted: bool,
    /// What is told, or why the word was not accepted.
    pub lines: Vec<String>,
}

impl Answer {
    /// The name of the form.
    pub const FORMAT: &str = "plumb-serve-answer";

    fn new(accepted: bool, text: &str) -> Self {
        Self {
            format: Self::FORMAT.to_owned(),
            version: 1,
            accepted,
            lines: text.lines().map(str::to_owned).collect(),
        }
    }

    fn line(&self) -> String {
        super::ready::json(self).trim_end().to_owned()
    }
}

/// When a `wait` is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Until {
    /// At this time, ns.
    Time(u64),
    /// When the housing stands.
    Still,
}

/// What follows from a line.
#[derive(Debug, PartialEq)]
enum Outcome {
    Told(Answer),
    Wait(Until),
    Quit,
}

/// The port.
#[derive(Debug)]
pub struct TwinPort {
    server: LineServer,
    waiting: Vec<(Until, Request)>,
    /// Where it listens.
    pub at: SocketAddr,
}

impl TwinPort {
    /// Listens there; port 0 is any free one.
    ///
    /// Errors: [`ServeError::PortInUse`], [`ServeError::Listen`], [`ServeError::Thread`].
    pub fn listen(at: SocketAddr) -> Result<Self, ServeError> {
        let server = LineServer::listen(at, OPTION, MANNER)?;
        Ok(Self {
            at: server.at,
            server,
            waiting: Vec::new(),
        })
    }

    /// Listens at the port above that of socketcand, or else at any free one: a port that nobody
    /// has asked for is no reason not to serve.
    ///
    /// Errors: [`ServeError::Listen`], [`ServeError::Thread`].
    pub fn beside(socketcand: SocketAddr) -> Result<Self, ServeError> {
        let port = match socketcand.port() {
            0 => 0,
            port => port.checked_add(1).unwrap_or(0),
        };
        let here = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        match Self::listen(here(port)) {
            Err(ServeError::PortInUse(taken, _)) => {
                let other = Self::listen(here(0))?;
                complain(&format!(
                    "{taken}, where `plumb twin` would look, is in use: give it --to {}",
                    other.at
                ));
                Ok(other)
            }
            listens => listens,
        }
    }

    /// Carries out what has come, and answers those whose `wait` is over. What is put off goes to
    /// `put_off`, with its time in ns.
    pub fn serve(&mut self, stage: &mut Stage, put_off: &mut Vec<(u64, Word)>) -> Go {
        while let Some(request) = self.server.next() {
            match outcome(request.line(), stage, put_off) {
                Outcome::Told(answer) => request.answer(&answer.line()),
                Outcome::Wait(until) => self.waiting.push((until, request)),
                Outcome::Quit => {
                    request.answer_last(&Answer::new(true, "").line());
                    return Go::Quit;
                }
            }
        }
        let (now_ns, is_still) = (stage.network.now_ns(), stage.is_still());
        let is_over = |until| match until {
            Until::Time(at_ns) => at_ns <= now_ns,
            Until::Still => is_still,
        };
        for (_, request) in self.waiting.extract_if(.., |(until, _)| is_over(*until)) {
            request.answer(&Answer::new(true, "").line());
        }
        Go::On
    }
}

/// Carries out a line; `None` for one that was too long.
fn outcome(line: Option<&str>, stage: &mut Stage, put_off: &mut Vec<(u64, Word)>) -> Outcome {
    let told = |accepted, text: &str| Outcome::Told(Answer::new(accepted, text));
    let Some(line) = line else {
        let sentence = format!("a word has at most {LONGEST} bytes with all that belongs to it");
        return told(false, &sentence);
    };
    let line = match read(line, stage.network.node_count()) {
        Ok(Some(line)) => line,
        Ok(None) => return told(true, ""),
        Err(error) => return told(false, &error.to_string()),
    };
    let now_ns = stage.network.now_ns();
    let at_ns = line.when.at_ns(now_ns);
    match (line.word, line.when) {
        (Word::Wait(None), When::Now) => Outcome::Wait(Until::Still),
        (Word::Wait(Some(s)), When::Now) => {
            Outcome::Wait(Until::Time(When::After(s).at_ns(now_ns)))
        }
        (word, _) if at_ns > now_ns && !word.is_for_scripts() => {
            put_off.push((at_ns, word));
            told(true, &format!("put off to {:.3} s", at_ns as f64 * 1e-9))
        }
        (word, _) => match stage.obey(&word) {
            Done::Quietly => told(true, ""),
            Done::Told(text) => told(true, &text),
            Done::Quit => Outcome::Quit,
            refused => told(false, &refused.refusal().unwrap_or_default()),
        },
    }
}

#[cfg(test)]
mod tests {
    use sim::network::Network;

    use super::*;

    /// What a word comes to on a bus without nodes, and whether it was put off.
    fn said(line: &str) -> (Outcome, Vec<(u64, Word)>) {
        let mut stage = Stage::new(Network::new(250_000, 1), 1);
        let mut put_off = Vec::new();
        let outcome = outcome(Some(line), &mut stage, &mut put_off);
        (outcome, put_off)
    }

    fn refusal(line: &str) -> String {
        match said(line) {
            (Outcome::Told(answer), put_off) if !answer.accepted && put_off.is_empty() => {
                answer.lines.join("\n")
            }
            other => panic!("{other:?}"),
        }
    }

    fn accepted(text: &str) -> Outcome {
        Outcome::Told(Answer::new(true, text))
    }

    #[test]
    fn what_greets_a_client_is_an_answer() {
        assert_eq!(MANNER.greeting, Answer::new(true, "").line());
    }

    #[test]
    fn a_word_that_was_carried_out_and_a_line_without_one_are_accepted() {
        for line in ["pitch 30", "", "  # later"] {
            assert_eq!(said(line), (accepted(""), Vec::new()), "{line}");
        }
    }

    #[test]
    fn a_word_that_was_put_off_is_answered_at_once_by_its_time() {
        for line in ["+2 s level", "at 2 level"] {
            let put_off = vec![(2_000_000_000, Word::Level)];
            assert_eq!(said(line), (accepted("put off to 2.000 s"), put_off));
        }
    }

    #[test]
    fn what_is_refused_says_why() {
        assert!(refusal("pitch 300").contains("write pitch DEGREES"));
        assert!(refusal("levitate").contains("there is no word \"levitate\""));
        assert!(refusal("fault b stuck").contains("there is no node \"b\""));
        for scripts_only in ["hold", "repeat", "+1 hold", "+1 wait", "at 9 wait 2"] {
            assert!(refusal(scripts_only).contains("words of scripts"));
        }
    }

    #[test]
    fn a_wait_is_answered_when_it_is_over() {
        assert_eq!(said("wait").0, Outcome::Wait(Until::Still));
        let until = Until::Time(1_500_000_000);
        assert_eq!(said("wait 1.5 s").0, Outcome::Wait(until));
        assert_eq!(said("quit").0, Outcome::Quit);
    }

    #[test]
    fn a_line_that_is_too_long_is_told_how_long_it_may_be() {
        let mut stage = Stage::new(Network::new(250_000, 1), 1);
        let Outcome::Told(answer) = outcome(None, &mut stage, &mut Vec::new()) else {
            panic!("no answer")
        };
        assert!(!answer.accepted && answer.lines[0].contains("4096 bytes"));
    }

    #[test]
    fn the_port_is_one_above_the_bus_and_any_other_when_that_is_taken() {
        assert_eq!(TWIN_AT.port(), SOCKETCAND_PORT + 1);
        let taken = TwinPort::beside(([0, 0, 0, 0], 0).into()).unwrap();
        assert!(taken.at.ip().is_loopback());
        let below = taken.at.port() - 1;
        let second = TwinPort::beside(([127, 0, 0, 1], below).into()).unwrap();
        assert_ne!(second.at.port(), taken.at.port());
        assert!(matches!(
            TwinPort::listen(taken.at),
            Err(ServeError::PortInUse(_, "--twin"))
        ));
    }
}
