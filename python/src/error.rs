//! What Python is told when something could not be done: the sentence of the program `plumb`.

use std::fmt::Display;

use pyo3::PyErr;
use pyo3::create_exception;
use pyo3::exceptions::{PyUserWarning, PyValueError};

create_exception!(
    plumb,
    Error,
    PyValueError,
    "Something could not be done; the text is the sentence that the program `plumb` would print."
);

create_exception!(
    plumb,
    IncompleteWarning,
    PyUserWarning,
    "Part of a log could not be read; the rest was used."
);

/// Options that sentences name, and what they are called in Python.
const NAMES: [(&str, &str); 6] = [
    ("--channel", "channel"),
    ("--eds", "eds"),
    ("--from", "begin"),
    ("--node-ids", "node_ids"),
    ("--nodes", "nodes"),
    ("--to", "end"),
];

/// The exception with this sentence; an option in it has the name of the argument.
pub fn said(error: impl Display) -> PyErr {
    Error::new_err(in_python(&error.to_string()))
}

fn in_python(sentence: &str) -> String {
    // Where a report goes is an argument without a name.
    let sentence = sentence.strip_suffix(" with --out").unwrap_or(sentence);
    let words = sentence.split(' ').map(|word| {
        let option = word.trim_end_matches([':', ',', ';']);
        let known = NAMES.iter().find(|(name, _)| *name == option);
        known.map_or(word.to_owned(), |(name, argument)| {
            word.replacen(name, argument, 1)
        })
    });
    words.collect::<Vec<_>>().join(" ")
}
