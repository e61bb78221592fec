//! How the verbs answer: lines for people as the work goes on, or one JSON object at the end.
//!
//! In: what a verb has found or done, node by node, and how a line of it reads. Out: the standard
//! output. What was done before a node failed is printed in either form, since it stays done.
//!
//! Left out: what a reader that has gone means (`stdout`).

use std::process::ExitCode;

use serde::Serialize;

use super::error::CommissionError;
use bus_master::Bus;
use output::stdout;

/// The answer of one verb.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    /// The name of its JSON.
    pub format: &'static str,
    /// Whether JSON is wanted.
    pub json: bool,
}

#[derive(Serialize)]
struct Document<'a, T> {
    format: &'static str,
    version: u32,
    /// Not of what no bus is needed for.
    #[serde(skip_serializing_if = "Option::is_none")]
    bus: Option<&'a str>,
    #[serde(flatten)]
    content: T,
}

impl Answer {
    /// Prints lines for people; nothing where JSON is wanted.
    ///
    /// Errors: [`CommissionError::Print`].
    pub fn say(&self, lines: impl AsRef<str>) -> Result<(), CommissionError> {
        match self.json {
            true => Ok(()),
            false => text(lines.as_ref()),
        }
    }

    /// Prints all that was found, of which `lines` are the form for people.
    ///
    /// Errors: [`CommissionError::Print`].
    pub fn show(
        &self,
        bus: &Bus,
        found: impl Serialize,
        lines: impl FnOnce() -> String,
    ) -> Result<(), CommissionError> {
        match self.json {
            true => self.object(Some(bus), found),
            false => text(&lines()),
        }
    }

    /// As [`Answer::show`], of what is known without a bus.
    ///
    /// Errors: [`CommissionError::Print`].
    pub fn show_without_bus(
        &self,
        found: impl Serialize,
        lines: impl FnOnce() -> String,
    ) -> Result<(), CommissionError> {
        match self.json {
            true => self.object(None, found),
            false => text(&lines()),
        }
    }

    /// Does something to one node after the other until one fails, and prints a line for each:
    /// what was done, and how that ended.
    pub fn each<I, T>(
        &self,
        nodes: impl IntoIterator<Item = I>,
        mut work: impl FnMut(I) -> Result<T, CommissionError>,
        line: impl Fn(&T) -> String,
    ) -> (Vec<T>, Result<(), CommissionError>) {
        let mut all = Vec::new();
        let ended = nodes.into_iter().try_for_each(|node| {
            let done = work(node)?;
            let printed = self.say(line(&done));
            all.push(done);
            printed
        });
        (all, ended)
    }

    /// Ends what [`Answer::each`] has begun: the JSON object, unless nothing at all was done.
    ///
    /// Errors: how the work `ended`, and [`CommissionError::Print`].
    pub fn end(
        &self,
        bus: &Bus,
        ended: Result<(), CommissionError>,
        nothing: bool,
        content: impl Serialize,
    ) -> Result<ExitCode, CommissionError> {
        if self.json && (ended.is_ok() || !nothing) {
            self.object(Some(bus), content)?;
        }
        ended.map(|()| ExitCode::SUCCESS)
    }

    fn object(&self, bus: Option<&Bus>, content: impl Serialize) -> Result<(), CommissionError> {
        let document = Document {
            format: self.format,
            version: 1,
            bus: bus.map(Bus::name),
            content,
        };
        stdout::print_json(&document).map_err(CommissionError::Print)
    }
}

/// Prints text as it is.
///
/// Errors: [`CommissionError::Print`].
fn text(text: &str) -> Result<(), CommissionError> {
    stdout::print(text).map_err(CommissionError::Print)
}
