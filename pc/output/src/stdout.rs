//! The standard output, of which a reader may have had enough.
//!
//! In: text, or a value for `--json`. Out: it is printed, or why not. That nobody reads any more,
//! as in `plumb describe eds | head`, is no error.
//!
//! Left out: progress and complaints, which go to the standard error.

use std::io::{self, Write as _};

use serde::Serialize;

/// Prints.
///
/// Errors: what the system reports, but not that the reader has gone.
pub fn print(text: impl AsRef<[u8]>) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_ref()).and_then(|()| out.flush()) {
        Err(why) if why.kind() != io::ErrorKind::BrokenPipe => Err(why),
        _ => Ok(()),
    }
}

/// Prints a value as one line of JSON.
///
/// Errors: what the system reports, and that the value has no form in JSON.
pub fn print_json(value: &impl Serialize) -> io::Result<()> {
    print(serde_json::to_string(value)? + "\n")
}

/// Prints a value as one line of JSON where `json` is wanted, else the text for people.
///
/// Errors: as [`print_json`].
pub fn print_as(
    json: bool,
    value: &impl Serialize,
    text: impl FnOnce() -> String,
) -> io::Result<()> {
    match json {
        true => print_json(value),
        false => print(text()),
    }
}
