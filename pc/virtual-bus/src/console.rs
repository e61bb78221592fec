//! What the person or program that has started the bus gets to read.
//!
//! In: text, or a value. Out: standard output, as text or as one line of JSON, and standard error.

use output::stdout;
use serde::Serialize;

/// What a typed word has told, for `--json`.
#[derive(Clone, Debug, Serialize)]
pub struct Told<'a> {
    /// "plumb-serve-told".
    pub format: &'static str,
    /// 1.
    pub version: u32,
    /// The text, in lines.
    pub lines: Vec<&'a str>,
}

impl<'a> Told<'a> {
    /// This text.
    pub fn new(text: &'a str) -> Self {
        Self {
            format: "plumb-serve-told",
            version: 1,
            lines: text.lines().collect(),
        }
    }
}

/// Prints. A reader that has gone is no reason to end the bus for all others.
pub fn say(text: &str) {
    let _ = stdout::print(text);
}

/// Prints a line of JSON, as [`say`] does.
pub fn say_json(value: &impl Serialize) {
    let _ = stdout::print_json(value);
}

/// Tells what is the matter.
pub fn complain(sentence: &str) {
    eprintln!("plumb: {sentence}");
}
