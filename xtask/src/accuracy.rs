//! `docs/accuracy.md` is generated, and belongs to what the code gives now.
//!
//! The generators are the example `accuracy` of `sim` and, for what the stated uncertainty covers,
//! `coverage` of `plumb`, which write its parts on standard output. All units take a quarter of an
//! hour, so the tests repeat and compare the same page of a few units, which is written together
//! with the other one and never without it. A difference is a failure, because every figure quoted
//! in prose refers to that file; so is a bound in it that is not kept.

use std::path::PathBuf;
use std::{fmt, fs, io};

use crate::command::{self, CommandError};
use crate::difference;
use crate::workspace::Workspace;

/// The generated document, from the root.
pub const DOCUMENT: &str = "docs/accuracy.md";

/// The same of few units, which every run of the tests repeats.
const REPEATED: &str = "docs/accuracy-of-few-units.md";

/// Why the document could not be compared or written.
#[derive(Debug)]
pub enum AccuracyError {
    /// The generator did not run.
    Generator(CommandError),
    /// The generator wrote nothing.
    Empty,
    /// The committed file could not be read or written.
    File(PathBuf, io::Error),
    /// The page of few units isn't what the code gives now; with the difference.
    Stale(String),
    /// Rows of the document that are over their bound.
    NotKept(Vec<String>),
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
                    "{REPEATED} is not what the code gives now (- file, + code):"
                )?;
                write!(out, "{}", difference.trim_end())
            }
            Self::NotKept(rows) => {
                writeln!(out, "{DOCUMENT} has bounds that are not kept:")?;
                write!(out, "{}", rows.join("\n"))
            }
        }
    }
}

/// Fails with the difference when the committed page of few units is not what the generators write,
/// and with the rows of the document that are over their bounds.
pub fn compare(workspace: &Workspace) -> Result<(), AccuracyError> {
    let generated = generate(workspace, &[])?;
    let committed = read(workspace, REPEATED)?;
    if committed != generated {
        return Err(AccuracyError::Stale(difference::between(
            &committed, &generated,
        )));
    }
    let rows = not_kept(&read(workspace, DOCUMENT)?);
    if rows.is_empty() {
        return Ok(());
    }
    Err(AccuracyError::NotKept(rows))
}

fn read(workspace: &Workspace, document: &str) -> Result<String, AccuracyError> {
    let path = workspace.root().join(document);
    fs::read_to_string(&path).map_err(|error| AccuracyError::File(path, error))
}

/// The rows of `page` that have a column with NO.
fn not_kept(page: &str) -> Vec<String> {
    let rows = page.lines().filter(|row| row.contains("| NO |"));
    rows.map(String::from).collect()
}

/// Writes both pages anew, each by way of a temporary file so that it is never half written. The
/// page of few units comes last: it is what the tests compare.
pub fn write(workspace: &Workspace) -> Result<(), AccuracyError> {
    let pages = [
        (DOCUMENT, generate(workspace, &["--", "--full"])?),
        (REPEATED, generate(workspace, &[])?),
    ];
    for (document, page) in pages {
        let path = workspace.root().join(document);
        let temporary = path.with_extension("md.new");
        fs::write(&temporary, page)
            .and_then(|()| fs::rename(&temporary, &path))
            .map_err(|error| AccuracyError::File(path, error))?;
    }
    Ok(())
}

/// Package and example of each part, in their order.
const PARTS: [(&str, &str); 2] = [("sim", "accuracy"), ("plumb", "coverage")];

/// The page that the generators write with these arguments.
fn generate(workspace: &Workspace, arguments: &[&str]) -> Result<String, AccuracyError> {
    let mut page = String::new();
    for (package, example) in PARTS {
        let mut command = workspace.cargo(&[
            "run",
            "--quiet",
            "--release",
            "--package",
            package,
            "--example",
            example,
        ]);
        command.args(arguments);
        let text = command::capture(command).map_err(AccuracyError::Generator)?;
        if text.trim().is_empty() {
            return Err(AccuracyError::Empty);
        }
        page += &text;
    }
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bound_that_is_not_kept_was_no_failure() {
        let kept = "| by hand | none | 95.1 % | yes |\n";
        let over = "| by motor | none | 94.9 % | NO |\n";
        assert_eq!(not_kept(kept), Vec::<String>::new());
        assert_eq!(not_kept(&[kept, over].concat()), [over.trim_end()]);
    }
}
