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

/// The exception with this sentence.
pub fn said(error: impl Display) -> PyErr {
    Error::new_err(error.to_string())
}
