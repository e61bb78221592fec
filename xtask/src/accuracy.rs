//! `docs/accuracy.md` is generated: this compares the committed file with what the code gives now.
//!
//! The generator is the example `accuracy` of `sim`, which writes the document on standard
//! output. A difference is a failure, because every figure quoted in prose refers to that file.

use std::path::PathBuf;
use std::{fmt, fs, io};

use crate::command::{self, CommandError};
use crate::difference;
use crate::workspace::Workspace;

/// The generated document, from the root.
pub const DOCUMENT: &str = "docs/accuracy.md";

/// Why the document could not be compared or written.
#[derive(Debug)]
pub enum AccuracyError {
    /// The generator did not run.
    Generator(CommandError),
    /// The generator wrote nothing.
    Empty,
    /// The committed file could not be read or written.
    File(PathBuf, io::Error),
    /// The committed file isn't what the code gives now; with the difference.
    Stale(String),
}

impl fmt::Display for AccuracyError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Generator(error) => write!(out, "{error}"),
            Self::Empty => write!(out, "the generator of {DOCUMENT} wrote nothing"),
            Self::File(path, error) => write!(out, "{}: {error}", path.display()),
            Self::Stale(difference) => {
                writeln!(
                    out,
                    "{DOCUMENT} is not what the code gives now (- file, + code):"
                )?;
                write!(out, "{}", difference.trim_end())
            }
        }
    }
}

/// Fails with the difference when the committed document is not what the generator writes.
pub fn compare(workspace: &Workspace) -> Result<(), AccuracyError> {
    let generated = generate(workspace)?;
    let path = workspace.root().join(DOCUMENT);
    let committed = fs::read_to_string(&path).map_err(|error| AccuracyError::File(path, error))?;
    if committed == generated {
        return Ok(());
    }
    Err(AccuracyError::Stale(difference::between(
        &committed, &generated,
    )))
}

/// Writes the document anew, by way of a temporary file so that it is never half written.
pub fn write(workspace: &Workspace) -> Result<(), AccuracyError> {
    let generated = generate(workspace)?;
    let path = workspace.root().join(DOCUMENT);
    let temporary = path.with_extension("md.new");
    fs::write(&temporary, generated)
        .and_then(|()| fs::rename(&temporary, &path))
        .map_err(|error| AccuracyError::File(path, error))
}

fn generate(workspace: &Workspace) -> Result<String, AccuracyError> {
    let command = workspace.cargo(&[
        "run",
        "--quiet",
        "--release",
        "--package",
        "sim",
        "--example",
        "accuracy",
    ]);
    let text = command::capture(command).map_err(AccuracyError::Generator)?;
    if text.trim().is_empty() {
        return Err(AccuracyError::Empty);
    }
    Ok(text)
}
