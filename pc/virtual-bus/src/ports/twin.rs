//! Where `plumb twin` connects: words over TCP, answered one by one.
//!
//! In: lines of the words (`words/line`). Out: an [`Answer`] to each, as one line of JSON. A
//! word that was put off is answered at once, `wait` when it is over.
//!
//! Left out: how the lines travel (`line_server`), and the client (`plumb twin`).

use std::net::SocketAddr;
use std::ops::ControlFlow;

use serde::{Deserialize, Serialize};

use super::line_server::{LineServer, Manner, Request};
use crate::addresses::here;
use crate::console::complain;
use crate::error::ServeError;
use crate::world::agenda::{Agenda, Outcome, Until};
use crate::world::effects::Done;
use crate::world::stage::Stage;

/// The option that asks for another place.
const OPTION: &str = "--twin";

/// The longest word with all that belongs to it, and a comment behind.
const LONGEST: u64 = 4096;

/// Sent to each client that connects, so that what it has reached is known.
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

    fn accepted(text: &str) -> Self {
        Self::new(true, text)
    }

    /// The answer to a line that came to this.
    fn to(outcome: Result<Outcome, String>) -> Self {
        match outcome {
            Ok(Outcome::Done(Done::Told(text))) => Self::accepted(&text),
            Ok(Outcome::PutOff(at_ns)) => {
                Self::accepted(&format!("put off to {:.3} s", at_ns as f64 * 1e-9))
            }
            Ok(_) => Self::accepted(""),
            Err(why) => Self::new(false, &why),
        }
    }

    fn line(&self) -> String {
        // Text, numbers and lists always have a form in JSON.
        serde_json::to_string(self).unwrap_or_default()
    }
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

    /// Carries out what has come, and answers those whose `wait` is over. Breaks when a word has
    /// asked for the end.
    pub fn serve(&mut self, stage: &mut Stage, agenda: &mut Agenda) -> ControlFlow<()> {
        while let Some(request) = self.server.next() {
            match hear(request.line(), stage, agenda) {
                Ok(Outcome::Wait(until)) => self.waiting.push((until, request)),
                Ok(Outcome::Done(Done::Quit)) => {
                    request.answer_last(&Answer::accepted("").line());
                    return ControlFlow::Break(());
                }
                done => request.answer(&Answer::to(done).line()),
            }
        }
        let (now_ns, is_still) = (stage.network.now_ns(), stage.is_still());
        let is_over = |until| match until {
            Until::Time(at_ns) => at_ns <= now_ns,
            Until::Still => is_still,
        };
        for (_, request) in self.waiting.extract_if(.., |(until, _)| is_over(*until)) {
            request.answer(&Answer::accepted("").line());
        }
        ControlFlow::Continue(())
    }
}

/// Carries out a line; `None` for one that was too long.
fn hear(line: Option<&str>, stage: &mut Stage, agenda: &mut Agenda) -> Result<Outcome, String> {
    let line = line
        .ok_or_else(|| format!("a word has at most {LONGEST} bytes with all that belongs to it"))?;
    agenda.hear(line, stage).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use sim::network::Network;

    use super::*;
    use can_text::socketcand::PORT;

    use crate::addresses::TWIN_AT;
    use crate::words::line::Word;

    /// What a word comes to on a bus without nodes, and when what was put off is due.
    fn said(line: &str) -> (Result<Outcome, String>, u64) {
        let mut stage = Stage::new(Network::new(250_000, 1), 1);
        let mut agenda = Agenda::default();
        let outcome = hear(Some(line), &mut stage, &mut agenda);
        (outcome, agenda.due_ns())
    }

    fn refusal(line: &str) -> String {
        match said(line) {
            (outcome @ Err(_), u64::MAX) => {
                let answer = Answer::to(outcome);
                assert!(!answer.accepted);
                answer.lines.join("\n")
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_greets_a_client_is_an_answer() {
        assert_eq!(MANNER.greeting, Answer::accepted("").line());
    }

    #[test]
    fn a_word_that_was_carried_out_and_a_line_without_one_are_accepted() {
        for line in ["pitch 30", "", "  # later"] {
            let (outcome, due_ns) = said(line);
            assert_eq!(Answer::to(outcome), Answer::accepted(""), "{line}");
            assert_eq!(due_ns, u64::MAX, "{line}");
        }
    }

    #[test]
    fn a_word_that_was_put_off_is_answered_at_once_by_its_time() {
        for line in ["+2 s level", "at 2 level"] {
            let mut stage = Stage::new(Network::new(250_000, 1), 1);
            let mut agenda = Agenda::default();
            let outcome = hear(Some(line), &mut stage, &mut agenda);
            assert_eq!(Answer::to(outcome), Answer::accepted("put off to 2.000 s"));
            assert_eq!(agenda.due_ns(), 2_000_000_000);
            assert_eq!(agenda.take_due(1_999_999_999), None);
            assert_eq!(agenda.take_due(2_000_000_000), Some(Word::Level));
        }
    }

    #[test]
    fn what_is_refused_has_a_reason() {
        assert!(refusal("pitch 300").contains("write pitch DEGREES"));
        assert!(refusal("levitate").contains("there is no word \"levitate\""));
        assert!(refusal("fault b stuck").contains("there is no node \"b\""));
        for scripts_only in ["hold", "repeat", "+1 hold", "+1 wait", "at 9 wait 2"] {
            assert!(refusal(scripts_only).contains("words of scripts"));
        }
    }

    #[test]
    fn a_wait_is_answered_when_it_is_over() {
        assert_eq!(said("wait").0, Ok(Outcome::Wait(Until::Still)));
        let until = Until::Time(1_500_000_000);
        assert_eq!(said("wait 1.5 s").0, Ok(Outcome::Wait(until)));
        assert_eq!(said("quit").0, Ok(Outcome::Done(Done::Quit)));
    }

    #[test]
    fn a_line_that_is_too_long_is_told_how_long_it_may_be() {
        let mut stage = Stage::new(Network::new(250_000, 1), 1);
        let outcome = hear(None, &mut stage, &mut Agenda::default());
        let answer = Answer::to(outcome);
        assert!(!answer.accepted && answer.lines[0].contains("4096 bytes"));
    }

    #[test]
    fn the_port_is_one_above_the_bus_and_any_other_when_that_is_taken() {
        assert_eq!(TWIN_AT.port(), PORT + 1);
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
