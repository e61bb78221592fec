//! `plumb twin`: words for the virtual instrument of a `plumb serve` that runs already.
//!
//! In: words, from the command line or the standard input. Out: the server's answer to each, as
//! text or JSON; exit status 1 when one of them was refused, or the server went before its answer.
//!
//! Left out: what the words mean (`virtual-bus`), and how the server takes them (there as well).

use std::ffi::OsStr;
use std::io::{self, BufRead as _};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::builder::{PossibleValue, StringValueParser, TypedValueParser};
use clap::{Arg, Args, Command};

use bus_master::intake::{Intake, connect};
use output::stdout;
use virtual_bus::{Answer, TWIN_AT, candidates, help, read};

/// How long a server may take to answer that it is one.
const GREETING: Duration = Duration::from_secs(10);

/// One look for an answer, which may take as long as a `wait`.
const GLANCE: Duration = Duration::from_secs(60);

/// Nodes of the largest bus that `plumb serve` makes.
const MOST_NODES: usize = 40;

/// Stands for the lines of the standard input.
const STDIN: &str = "-";

/// Which words, and where to.
#[derive(Clone, Debug, Args)]
#[command(after_help = format!(
    "Each argument is one line with a word and what belongs to it: plumb twin 'pitch 30' status.\n\
     One line may be typed without quotes: plumb twin pitch 30\n\nWords:\n{}",
    help()
))]
pub struct Arguments {
    /// A word with what belongs to it, from the list below; `-` reads lines from the standard input
    #[arg(required = true, value_name = "WORD", value_parser = WordParser)]
    #[arg(hide_possible_values = true, allow_negative_numbers = true)]
    pub words: Vec<String>,
    /// Where `plumb serve` takes words; it prints the address at its start
    #[arg(long, value_name = "HOST:PORT", default_value_t = TWIN_AT.to_string())]
    #[arg(value_parser = address)]
    pub to: String,
    /// Print each answer as one line of JSON
    #[arg(long)]
    pub json: bool,
}

fn address(text: &str) -> Result<String, String> {
    match text.contains(':') && !text.contains('/') {
        true => Ok(text.to_owned()),
        false => Err(format!("write HOST:PORT, for instance {TWIN_AT}")),
    }
}

/// Takes any text, since the server has the words; a shell offers those that there are.
#[derive(Clone)]
struct WordParser;

impl TypedValueParser for WordParser {
    type Value = String;

    fn parse_ref(
        &self,
        line: &Command,
        argument: Option<&Arg>,
        value: &OsStr,
    ) -> Result<String, clap::Error> {
        StringValueParser::new().parse_ref(line, argument, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(candidates().map(PossibleValue::new)))
    }
}

/// Why words were not answered.
#[derive(Debug, thiserror::Error)]
pub enum TwinError {
    /// Nobody is there.
    #[error(
        "no virtual instrument takes words at {0} ({1}): start one with `plumb serve`, or give \
         the address that it has printed with --to"
    )]
    NoServer(String, io::Error),
    /// Who is there takes no words.
    #[error(
        "what listens at {0} takes no words: give the address that `plumb serve` has printed \
         behind `plumb twin --to`"
    )]
    Stranger(String),
    /// The connection has ended before this word was answered.
    #[error(
        "the connection to {0} has ended before {1:?} was answered: look whether `plumb serve` \
         still runs"
    )]
    Gone(String, String),
    /// The standard input can't be read.
    #[error("the standard input cannot be read: {0}")]
    Input(io::Error),
    /// It could not be printed.
    #[error("the answer cannot be printed: {0}")]
    Print(io::Error),
}

/// Sends the words and prints the answers; exit status 1 when one was refused or not answered.
///
/// Errors: see [`TwinError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, TwinError> {
    match send(arguments) {
        Err(error @ TwinError::Gone(..)) => {
            eprintln!("plumb: {error}");
            Ok(ExitCode::from(1))
        }
        Ok(true) => Ok(ExitCode::SUCCESS),
        Ok(false) => Ok(ExitCode::from(1)),
        Err(error) => Err(error),
    }
}

/// True when each word was accepted.
fn send(arguments: &Arguments) -> Result<bool, TwinError> {
    let mut twin = Twin::connect(&arguments.to)?;
    let mut all_accepted = true;
    for argument in lines(&arguments.words) {
        if argument == STDIN {
            for line in io::stdin().lock().split(b'\n') {
                let line = line.map_err(TwinError::Input)?;
                let line = String::from_utf8_lossy(&line);
                all_accepted &= twin.obeys(&line, arguments.json)?;
            }
            continue;
        }
        for line in argument.lines() {
            all_accepted &= twin.obeys(line, arguments.json)?;
        }
    }
    Ok(all_accepted)
}

/// The arguments, or all of them as one line that was typed without quotes: one in which no
/// argument has a space, and some are no lines by themselves.
fn lines(arguments: &[String]) -> Vec<String> {
    let is_quoted = |argument: &String| argument == STDIN || argument.contains(char::is_whitespace);
    let is_line = |argument: &String| read(argument, MOST_NODES).is_ok();
    match arguments.iter().any(is_quoted) || arguments.iter().all(is_line) {
        true => arguments.to_vec(),
        false => vec![arguments.join(" ")],
    }
}

/// A connection to a server.
struct Twin {
    intake: Intake,
    at: String,
}

impl Twin {
    fn connect(at: &str) -> Result<Self, TwinError> {
        let stream = connect(at).map_err(|why| TwinError::NoServer(at.to_owned(), why))?;
        let mut twin = Self {
            intake: Intake::new(Box::new(stream)),
            at: at.to_owned(),
        };
        match twin.answer(GREETING) {
            Ok(Some(_)) => Ok(twin),
            _ => Err(TwinError::Stranger(at.to_owned())),
        }
    }

    /// The next answer; `None` when none has come within this time.
    fn answer(&mut self, patience: Duration) -> io::Result<Option<Answer>> {
        let line = self.intake.next(b"\n", Instant::now() + patience)?;
        let Some((line, _)) = line else {
            return Ok(None);
        };
        let answer: Answer = serde_json::from_slice(line)?;
        match answer.format == Answer::FORMAT {
            true => Ok(Some(answer)),
            false => Err(io::ErrorKind::InvalidData.into()),
        }
    }

    /// The answer to a line, however long it takes.
    fn ask(&mut self, line: &str) -> io::Result<Answer> {
        self.intake.write(format!("{line}\n").as_bytes())?;
        loop {
            if let Some(answer) = self.answer(GLANCE)? {
                return Ok(answer);
            }
        }
    }

    /// Sends a line and prints its answer; true when it was accepted. A line without a word is.
    fn obeys(&mut self, line: &str, json: bool) -> Result<bool, TwinError> {
        if matches!(read(line, MOST_NODES), Ok(None)) {
            return Ok(true);
        }
        let asked = self.ask(line);
        let answer = asked.map_err(|_| TwinError::Gone(self.at.clone(), shown(line)))?;
        match json {
            true => stdout::print_json(&answer).map_err(TwinError::Print)?,
            false => print(&answer).map_err(TwinError::Print)?,
        }
        Ok(answer.accepted)
    }
}

/// A line as it is told, without the most of a very long one.
fn shown(line: &str) -> String {
    const MOST: usize = 60;
    match line.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line.to_owned(),
    }
}

fn print(answer: &Answer) -> io::Result<()> {
    let text = answer.lines.join("\n");
    match (answer.accepted, text.as_str()) {
        (true, "") => stdout::print("ok\n"),
        (true, text) => stdout::print(format!("{text}\n")),
        (false, why) => {
            eprintln!("plumb: {why}");
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(arguments: &[&str]) -> Vec<String> {
        let arguments: Vec<_> = arguments.iter().map(|word| (*word).to_owned()).collect();
        lines(&arguments)
    }

    #[test]
    fn each_argument_is_a_line() {
        let lines = ["pitch 30", "level", "+60 s fault b bias x 20 mg", "status"];
        assert_eq!(sent(&lines), lines);
        assert_eq!(sent(&["level", "status"]), ["level", "status"]);
        assert_eq!(sent(&["level", "-", "quit"]), ["level", "-", "quit"]);
        assert_eq!(sent(&["pitch 30", "satus"]), ["pitch 30", "satus"]);
    }

    #[test]
    fn one_line_may_be_typed_without_quotes() {
        let typed = ["+60", "s", "fault", "b", "babble", "07F"];
        assert_eq!(sent(&typed), ["+60 s fault b babble 07F"]);
        assert_eq!(sent(&["wait", "5"]), ["wait 5"]);
        assert_eq!(sent(&["pitch", "300"]), ["pitch 300"]);
    }

    #[test]
    fn the_arguments_of_serve_fit_those_of_twin() {
        assert_eq!(
            address(&TWIN_AT.to_string()),
            Ok("127.0.0.1:29537".to_owned())
        );
        assert!(
            address("localhost")
                .unwrap_err()
                .contains("127.0.0.1:29537")
        );
        assert!(address("tcp://localhost:1").is_err());
    }

    #[test]
    fn of_a_long_line_the_begin_is_told() {
        assert_eq!(shown("level"), "level");
        assert_eq!(shown(&"\u{e4}".repeat(99)).chars().count(), 63);
    }
}
