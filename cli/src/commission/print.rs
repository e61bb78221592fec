//! How the verbs print: lines for people, or one JSON object.
//!
//! In: text, or something that serialises. Out: the standard output. A reader that has had
//! enough, as in `plumb get ... | head`, is no error.

use std::io::{self, Write as _};

use serde::Serialize;

use super::fault::Fault;

/// Prints text as it is.
///
/// Errors: [`Fault::Print`].
pub fn text(text: &str) -> Result<(), Fault> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(why) if why.kind() != io::ErrorKind::BrokenPipe => Err(Fault::Print(why)),
        _ => Ok(()),
    }
}

/// Prints one object and a line feed.
///
/// Errors: [`Fault::Print`].
pub fn json(object: &impl Serialize) -> Result<(), Fault> {
    let line = serde_json::to_string(object).map_err(|error| Fault::Print(error.into()))?;
    text(&format!("{line}\n"))
}
