//! What the person or program that has started the bus gets to read.
//!
//! In: text, or a value. Out: standard output, as text or as one line of JSON, and standard error.

use std::io::Write as _;

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

/// One line of JSON, without its end.
pub fn json(value: &impl Serialize) -> String {
    // Text, numbers and lists always have a form in JSON.
    serde_json::to_string(value).unwrap_or_default()
}

/// Prints. A reader that has gone is no reason to end the bus for all others.
pub fn say(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Prints a line of JSON, as [`say`] does.
pub fn say_json(value: &impl Serialize) {
    say(&(json(value) + "\n"));
}

/// Tells what is the matter.
pub fn complain(sentence: &str) {
    eprintln!("plumb: {sentence}");
}
