//! The virtual instrument for a program that holds it, in virtual time alone.
//!
//! In: words of `plumb serve`, frames of the program's clients, and how far to go. Out: the answers
//! of the words, and the frames that were on the bus, each with its time. Nothing goes on by itself
//! and nothing waits for the machine's clock, so the same calls give the same frames.
//!
//! Left out: clients over sockets, scripts, and memory that outlasts the program (`server`).

use canopen::Frame;
use output::progress::Progress;
use sim::network::guest::Switch;

use crate::clients::round_robin::{ClientId, Incoming};
use crate::error::ServeError;
use crate::instruments;
use crate::options::{Arguments, Mode};
use crate::words::reader::WordError;
use crate::world::agenda::{Agenda, Outcome, Until};
use crate::world::effects::Done;
use crate::world::stage::Stage;

/// The longest that the word `wait` waits for a housing that does not come to rest, ns.
const LONGEST_WAIT_NS: u64 = 3_600_000_000_000;

/// Time between two looks at a housing that moves, ns.
const LOOK_NS: u64 = 10_000_000;

/// A frame that was on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// When it ended, ns of virtual time.
    pub at_ns: u64,
    /// What.
    pub frame: Frame,
    /// The client that sent it; `None` for a node.
    pub from: Option<u32>,
}

/// What came of a word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Said {
    /// It was carried out or put off, and this is what it has to tell.
    Told(String),
    /// It was `wait`.
    Wait(Wait),
}

/// Virtual time that a `wait` has still to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wait {
    /// When it is over at the latest, ns.
    end_ns: u64,
    /// It is over as soon as the housing stands.
    still: bool,
}

/// Virtual instruments on a bus.
#[derive(Debug)]
pub struct Twin {
    stage: Stage,
    agenda: Agenda,
    heard: Vec<Heard>,
}

impl Twin {
    /// Builds the instruments, calibrates them and gives them power, at virtual time 0. Of the
    /// arguments those count that set what is built.
    ///
    /// Errors: see [`ServeError`].
    pub fn new(arguments: &Arguments) -> Result<Self, ServeError> {
        let node_ids = arguments.node_ids()?;
        let (network, _) = instruments::build(arguments, &node_ids, None, &Progress::hidden())?;
        let mut stage = Stage::new(network, arguments.seed);
        stage.one_axis = arguments.mode == Mode::OneAxis;
        stage.chamber_speed = arguments.chamber_speed;
        (0..node_ids.len()).for_each(|number| stage.switch(number, Switch::On));
        Ok(Self {
            stage,
            agenda: Agenda::default(),
            heard: Vec::new(),
        })
    }

    /// Virtual time, ns.
    pub fn now_ns(&self) -> u64 {
        self.stage.network.now_ns()
    }

    /// Where the housing truly stands: X and slope Y, deg; and air and die, degC.
    pub fn truth(&self) -> ([f64; 2], [f64; 2]) {
        self.stage.truth()
    }

    /// Carries a word out now, or puts it off; what it has to tell. After `wait` the caller has to
    /// [`go_on`](Self::go_on).
    ///
    /// Errors: see [`WordError`]; nothing has changed then.
    pub fn say(&mut self, line: &str) -> Result<Said, WordError> {
        let told = match self.agenda.hear(line, &mut self.stage)? {
            Outcome::Done(Done::Told(text)) => text,
            Outcome::Done(_) => String::new(),
            Outcome::PutOff(at_ns) => format!("put off to {:.3} s", at_ns as f64 * 1e-9),
            Outcome::Wait(until) => return Ok(Said::Wait(self.wait(until))),
        };
        Ok(Said::Told(told))
    }

    fn wait(&self, until: Until) -> Wait {
        let longest_ns = self.now_ns().saturating_add(LONGEST_WAIT_NS);
        match until {
            Until::Time(end_ns) => Wait {
                end_ns,
                still: false,
            },
            Until::Still => Wait {
                end_ns: longest_ns,
                still: true,
            },
        }
    }

    /// Goes on with a wait for `piece_ns` at most; true when it is over.
    ///
    /// Errors: as [`run_until`](Self::run_until).
    pub fn go_on(&mut self, wait: Wait, piece_ns: u64) -> Result<bool, WordError> {
        let end_ns = wait.end_ns.min(self.now_ns().saturating_add(piece_ns));
        let stands = |twin: &Self| wait.still && twin.stage.is_still();
        while self.now_ns() < end_ns && !stands(self) {
            let step_ns = if wait.still { LOOK_NS } else { piece_ns };
            self.run_until(end_ns.min(self.now_ns().saturating_add(step_ns)))?;
        }
        Ok(self.now_ns() >= wait.end_ns || stands(self))
    }

    /// True when one more frame of this client can be taken.
    pub fn has_room(&self, client: u32) -> bool {
        self.stage.has_room(ClientId(client))
    }

    /// Takes a client's frame, which goes onto the bus while time goes on.
    pub fn send(&mut self, client: u32, frame: Frame) {
        let client = ClientId(client);
        self.stage.offer(Incoming { client, frame });
    }

    /// Goes on to `until_ns`, with every word that was put off at its time.
    ///
    /// Errors: such a word could not be carried out; time has gone on to its own.
    pub fn run_until(&mut self, until_ns: u64) -> Result<(), WordError> {
        loop {
            let now_ns = self.now_ns();
            while let Some(word) = self.agenda.take_due(now_ns) {
                self.stage.obey(&word)?;
            }
            if now_ns >= until_ns {
                return Ok(());
            }
            let due_ns = self.agenda.due_ns().clamp(now_ns + 1, until_ns);
            let passed = self.stage.run_until(due_ns).into_iter();
            self.heard.extend(passed.map(|passed| Heard {
                at_ns: passed.at_ns,
                frame: passed.frame,
                from: passed.from.map(|client| client.0),
            }));
        }
    }

    /// What was on the bus since this was asked for the last time.
    pub fn take_heard(&mut self) -> Vec<Heard> {
        std::mem::take(&mut self.heard)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn twin(words: &[&str]) -> Twin {
        let all = ["serve", "--uncalibrated"].iter().chain(words);
        Twin::new(&Line::parse_from(all).arguments).unwrap()
    }

    /// Waits in pieces of this length.
    fn wait(twin: &mut Twin, line: &str, piece_ns: u64) {
        let Said::Wait(wait) = twin.say(line).unwrap() else {
            panic!("{line} is no wait");
        };
        while !twin.go_on(wait, piece_ns).unwrap() {}
    }

    #[test]
    fn the_same_calls_give_the_same_frames_and_another_seed_gives_others() {
        let frames = |seed| {
            let mut twin = twin(&["--seed", seed]);
            twin.say("+0.5 s pitch 10").unwrap();
            twin.send(7, Frame::data_frame(0, &[1, 0]));
            twin.run_until(2_000_000_000).unwrap();
            twin.take_heard()
        };
        let first = frames("3");
        assert!(first.len() > 20 && first.iter().any(|heard| heard.from == Some(7)));
        assert_eq!(first, frames("3"));
        assert_ne!(first, frames("4"));
    }

    #[test]
    fn a_wait_takes_virtual_time_and_a_turn_ends_where_it_should() {
        let mut twin = twin(&[]);
        twin.say("pitch 30").unwrap();
        wait(&mut twin, "wait", 1_000_000_000);
        let ([x_deg, y_deg], _) = twin.truth();
        assert!(x_deg.hypot(y_deg) > 29.0, "{x_deg} {y_deg}");
        let before_ns = twin.now_ns();
        assert!(before_ns > 100_000_000);
        wait(&mut twin, "wait 2 s", 300_000_000);
        assert_eq!(twin.now_ns(), before_ns + 2_000_000_000);
        assert!(twin.say("levitate").is_err());
    }

    #[test]
    fn a_fault_of_a_gyroscope_was_accepted_where_there_is_none() {
        for word in ["rate-frozen", "rate-bias x 5", "rate-scale 3"] {
            let word = format!("fault b {word}");
            let refused = twin(&[]).say(&word);
            assert_eq!(refused, Err(WordError::NoGyroscope));
            assert!(twin(&["--mode", "dynamic"]).say(&word).is_ok());
        }
    }

    #[test]
    fn a_word_that_was_put_off_is_carried_out_at_its_time() {
        let mut twin = twin(&[]);
        assert_eq!(
            twin.say("at 1.5 power b off").unwrap(),
            Said::Told("put off to 1.500 s".to_owned())
        );
        twin.run_until(4_000_000_000).unwrap();
        let heard = twin.take_heard();
        let of_b = heard
            .iter()
            .filter(|heard| heard.frame.cob_id() == Some(0x702));
        let last_ns = of_b.map(|heard| heard.at_ns).max().unwrap();
        assert!(last_ns < 1_501_000_000, "{last_ns}");
    }
}
