//! What stands behind a word, read from left to right.
//!
//! In: the words of a line. Out: numbers in their ranges, nodes, axes and choices, one after the
//! other, or what is wrong with the line.
//!
//! Left out: which words there are (`line`, `trouble`).

use std::ops::RangeInclusive;

use sim::network::hand::Pose;

/// Why a line is none, or why its word was not carried out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WordError {
    /// There is no such word, node or fault.
    #[error("there is no {what} {name:?}; the {what}s are {known}")]
    Unknown {
        /// What it should be.
        what: &'static str,
        /// What was written.
        name: String,
        /// All that there are.
        known: String,
    },
    /// The word is followed by something else than it should; how it is written.
    #[error("{0:?} does not fit: write {1}")]
    Form(String, &'static str),
    /// A pose in which no housing can stand.
    #[error(
        "no housing stands at pitch {a} and roll {b}: both together may be 90 deg at most, and one \
         alone 180",
        a = .0.pitch_deg,
        b = .0.roll_deg
    )]
    Impossible(Pose),
    /// A word that means nothing outside of a script.
    #[error(
        "`hold` and `repeat` are words of scripts, `wait` of scripts and, without a time before \
         it, of `plumb twin`"
    )]
    ScriptOnly,
    /// Trouble that only the code of a virtual node can have.
    #[error("its code runs on an emulated processor: only its part and its wires break")]
    Beyond,
    /// Trouble of a gyroscope that the part has not.
    #[error("this instrument has no gyroscope: serve the one with --mode dynamic")]
    NoGyroscope,
}

/// What was read, or why it was not.
pub type Read<T> = Result<T, WordError>;

/// Some of the nodes, by number from 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Nodes(pub Vec<usize>);

/// The name of a node: a and b of the first instrument, a2 and b2 of the second, and so on.
pub fn node_name(number: usize) -> String {
    let letter = if number.is_multiple_of(2) { 'a' } else { 'b' };
    match number / 2 {
        0 => letter.to_string(),
        instrument => format!("{letter}{}", instrument + 1),
    }
}

/// What may stand behind a number, with a space between.
const UNITS: [&str; 10] = [
    "deg", "deg/s", "degC", "mg", "mg/s", "s", "ms", "/s", "%", "kbit/s",
];

/// The words of a line; a unit belongs to the number before it.
pub fn with_units(text: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for word in text.split_ascii_whitespace() {
        match words.last_mut() {
            Some(last) if UNITS.contains(&word) && last.parse::<f64>().is_ok() => *last += word,
            _ => words.push(word.to_owned()),
        }
    }
    words
}

/// The words of a line that have not been read yet.
#[derive(Debug)]
pub struct Reader<'a> {
    text: &'a str,
    words: &'a [String],
    nodes: usize,
    /// How what is being read is written.
    pub form: &'static str,
}

impl<'a> Reader<'a> {
    /// The words of a line on a bus of so many nodes.
    pub const fn new(text: &'a str, words: &'a [String], nodes: usize) -> Self {
        let form = "";
        Self {
            text,
            words,
            nodes,
            form,
        }
    }

    /// The line does not have the form.
    pub fn bad(&self) -> WordError {
        WordError::Form(self.text.to_owned(), self.form)
    }

    /// The next word, which stays.
    pub fn peek(&self) -> Option<&'a str> {
        self.words.first().map(String::as_str)
    }

    /// The next word.
    pub fn next(&mut self) -> Option<&'a str> {
        let (first, rest) = self.words.split_first()?;
        self.words = rest;
        Some(first)
    }

    /// The next word, which must be there.
    pub fn one(&mut self) -> Read<&'a str> {
        self.next().ok_or_else(|| self.bad())
    }

    /// True when all has been read.
    pub const fn is_over(&self) -> bool {
        self.words.is_empty()
    }

    /// What this reads, unless all has been read.
    pub fn optional<T>(&mut self, read: impl FnOnce(&mut Self) -> Read<T>) -> Read<Option<T>> {
        match self.is_over() {
            true => Ok(None),
            false => read(self).map(Some),
        }
    }

    /// A number in a range, with or without its unit.
    pub fn number(&mut self, unit: &str, range: RangeInclusive<f64>) -> Read<f64> {
        let text = self.one()?;
        let number = text.strip_suffix(unit).unwrap_or(text).parse().ok();
        let number = number.filter(|number: &f64| range.contains(number));
        number.ok_or_else(|| self.bad())
    }

    /// A share of all.
    pub fn share(&mut self) -> Read<f64> {
        self.number("", 0.0..=1.0)
    }

    /// What the next word stands for, of these.
    pub fn one_of<T: Copy>(&mut self, all: &[(&str, T)]) -> Read<T> {
        let word = self.one()?;
        let found = all.iter().find(|(name, _)| *name == word);
        found.map(|(_, value)| *value).ok_or_else(|| self.bad())
    }

    /// An axis of the sensor.
    pub fn axis(&mut self) -> Read<usize> {
        self.one_of(&[("x", 0), ("y", 1), ("z", 2)])
    }

    /// A hexadecimal identifier of 11 bits.
    pub fn identifier(&mut self) -> Read<u16> {
        let text = self.one()?;
        let id = u16::from_str_radix(text.strip_prefix("0x").unwrap_or(text), 16).ok();
        id.filter(|id| *id <= 0x7FF).ok_or_else(|| self.bad())
    }

    /// One node or all of them, by name.
    pub fn nodes(&mut self) -> Read<Nodes> {
        let name = self.one()?;
        let is_meant = |node: &usize| name == "all" || name == node_name(*node);
        let chosen: Vec<usize> = (0..self.nodes).filter(is_meant).collect();
        if !chosen.is_empty() {
            return Ok(Nodes(chosen));
        }
        let names: Vec<_> = (0..self.nodes).map(node_name).collect();
        Err(WordError::Unknown {
            what: "node",
            name: name.to_owned(),
            known: format!("{}, and all of them together are `all`", names.join(", ")),
        })
    }
}
