//! `docs/accuracy.md` is generated, and belongs to what the code gives now.
//!
//! The generators are the example `accuracy` of `sim` and, for what the stated uncertainty covers,
//! `coverage` of `calibrate`, which write its parts on standard output. All units take a quarter of
//! an hour, so the tests repeat and compare the same page of a few units, which is written together
//! with the other one and never without it. A difference is a failure, because every figure quoted
//! in prose refers to that file; so is a bound in it that is not kept.

use std::path::PathBuf;
use std::process::Command;
use std::{fs, io};

use crate::built;
use crate::command::{self, CommandError};
use crate::difference;
use crate::workspace::Workspace;

/// The generated document, from the root.
pub const DOCUMENT: &str = "docs/accuracy.md";

/// The same of few units, which every run of the tests repeats.
const REPEATED: &str = "docs/accuracy-of-few-units.md";

/// Stands in the document before the hash of the commit whose code has printed it.
const PRINTED: &str = "Printed by the code of commit `";

/// Why the document could not be compared or written.
#[derive(Debug, thiserror::Error)]
pub enum AccuracyError {
    /// The generator did not run.
    #[error("{0}")]
    Generator(CommandError),
    /// The generator wrote nothing.
    #[error("the generator of {DOCUMENT} wrote nothing")]
    Empty,
    /// The committed file could not be read or written.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// The page of few units isn't what the code gives now; with the difference.
    #[error("{REPEATED} is not what the code gives now (- file, + code):\n{}", .0.trim_end())]
    Stale(String),
    /// Rows of the document that are over their bound.
    #[error("{DOCUMENT} has bounds that are not kept:\n{}", .0.join("\n"))]
    NotKept(Vec<String>),
    /// The document does not name the commit that has printed it.
    #[error("{DOCUMENT} does not name the commit that has printed it")]
    NoCommit,
}

/// Fails with the difference when the committed page of few units is not what the generators write,
/// and with the rows of the document that are over their bounds.
pub fn compare(workspace: &Workspace) -> Result<(), AccuracyError> {
    let generated = of_few(workspace)?;
    let committed = read(workspace, REPEATED)?;
    if committed != generated {
        return Err(AccuracyError::Stale(difference::between(
            &committed, &generated,
        )));
    }
    judge(&read(workspace, DOCUMENT)?)
}

/// Whether the document of all units keeps its bounds and states where it comes from.
fn judge(document: &str) -> Result<(), AccuracyError> {
    let rows = not_kept(document);
    if !rows.is_empty() {
        return Err(AccuracyError::NotKept(rows));
    }
    if names_commit(document) {
        Ok(())
    } else {
        Err(AccuracyError::NoCommit)
    }
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
        (DOCUMENT, of_all(workspace)?),
        (REPEATED, of_few(workspace)?),
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

/// The parts, in their order.
const PARTS: [Part; 2] = [
    Part {
        package: "sim",
        example: "accuracy",
    },
    Part {
        package: "calibrate",
        example: "coverage",
    },
];

/// A part of the page, and the example that writes it.
#[derive(Clone, Copy)]
struct Part {
    package: &'static str,
    example: &'static str,
}

/// The page of few units, by the programs that were built with the tests.
fn of_few(workspace: &Workspace) -> Result<String, AccuracyError> {
    page(|part| {
        let program = built::example(workspace, part.example)?;
        Ok(workspace.program(&program.to_string_lossy(), &[]))
    })
}

/// The page of all units. Optimised as far as can be: it takes longer than that does.
fn of_all(workspace: &Workspace) -> Result<String, AccuracyError> {
    let commit = commit(workspace)?;
    page(|Part { package, example }| {
        let mut cargo = workspace.cargo(&["run", "--quiet", "--release", "--package", package]);
        cargo.args(["--example", example, "--", "--full", "--commit", &commit]);
        Ok(cargo)
    })
}

/// What the commands for the parts write.
fn page(command: impl Fn(Part) -> Result<Command, CommandError>) -> Result<String, AccuracyError> {
    let mut page = String::new();
    for part in PARTS {
        let text = command(part).and_then(command::capture);
        let text = text.map_err(AccuracyError::Generator)?;
        if text.trim().is_empty() {
            return Err(AccuracyError::Empty);
        }
        page += &text;
    }
    Ok(page)
}

/// The commit whose code prints the page, in the page's words.
fn commit(workspace: &Workspace) -> Result<String, AccuracyError> {
    let git = |words: &[&str]| command::capture(workspace.program("git", words));
    let hash = git(&["rev-parse", "--short=12", "HEAD"]).map_err(AccuracyError::Generator)?;
    let changes = git(&["status", "--porcelain", "--untracked-files=no"]);
    let changes = changes.map_err(AccuracyError::Generator)?;
    Ok(words_of(hash.trim(), !changes.trim().is_empty()))
}

fn words_of(hash: &str, is_changed: bool) -> String {
    let changes = if is_changed {
        " and the changes committed with it"
    } else {
        ""
    };
    format!("`{hash}`{changes}")
}

/// Whether a page names the commit that has printed it.
fn names_commit(page: &str) -> bool {
    let behind = page.split_once(PRINTED).map(|(_, behind)| behind);
    let hash = behind.and_then(|behind| behind.split('`').next());
    hash.is_some_and(|hash| hash.len() >= 7 && hash.chars().all(|c| c.is_ascii_hexdigit()))
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

    #[test]
    fn a_page_that_did_not_name_the_commit_that_had_printed_it_passed() {
        let page = |words: &str| format!("# Accuracy\n\nPrinted by the code of commit {words}.\n");
        assert!(judge(&page(&words_of("1d815905842a", false))).is_ok());
        assert!(judge(&page(&words_of("1d815905842a", true))).is_ok());
        for silent in ["", "`", "``", "`unknown`", "`1d8`"] {
            let judged = judge(&page(silent));
            assert!(matches!(judged, Err(AccuracyError::NoCommit)), "{silent}");
        }
    }
}
