//! How the verbs print: lines for people, or one JSON object.
//!
//! In: text, or something that serialises. Out: the standard output, or a [`Fault`].
//!
//! Left out: what a reader that has gone means (`stdout`).

use serde::Serialize;

use bus_master::fault::Fault;
use output::stdout;

/// Prints text as it is.
///
/// Errors: [`Fault::Print`].
pub fn text(text: &str) -> Result<(), Fault> {
    stdout::print(text).map_err(Fault::Print)
}

/// Prints one object and a line feed.
///
/// Errors: [`Fault::Print`].
pub fn json(object: &impl Serialize) -> Result<(), Fault> {
    stdout::print_json(object).map_err(Fault::Print)
}
