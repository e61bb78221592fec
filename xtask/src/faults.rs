//! `docs/faults.md` is generated: this compares the committed page with what the code does now.
//!
//! The generator is the example `faults` of `sim`. The whole page takes a quarter of an hour, so
//! the tests repeat its last section only, in small numbers. That section has a fingerprint of
//! everything that happened on its buses, and the rest of the page carries the same one: a page of
//! an instrument that behaved otherwise fails, whatever its figures are.

use std::path::PathBuf;
use std::process::Command;
use std::{fs, io};

use crate::built;
use crate::command::{self, CommandError};
use crate::difference;
use crate::workspace::Workspace;

/// The generated page, from the root.
pub const DOCUMENT: &str = "docs/faults.md";

/// Heading of the section that the tests repeat, the last one.
const REPEATED: &str = "## What every run of the tests repeats\n";

/// Digits of a fingerprint.
const DIGITS: usize = 16;

/// Why the page could not be compared or written.
#[derive(Debug, thiserror::Error)]
pub enum FaultsError {
    /// The generator did not run.
    #[error("{0}")]
    Generator(CommandError),
    /// The generator left out the section that the tests repeat.
    #[error("the generator of {DOCUMENT} wrote no section to repeat")]
    Empty,
    /// The committed file could not be read or written.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// The section that the tests repeat isn't what the code gives now; with the difference.
    #[error(
        "the last section of {DOCUMENT} is not what the code gives now (- file, + code):\n{}",
        .0.trim_end()
    )]
    Stale(String),
    /// The rest of the page was made with code that behaved otherwise.
    #[error("{DOCUMENT} was made with code that behaved otherwise: its fingerprint is another")]
    Outdated,
}

/// Fails when the committed page doesn't belong to what the code does now.
pub fn compare(workspace: &Workspace) -> Result<(), FaultsError> {
    let generated = generate(workspace)?;
    judge(&committed(workspace)?, &generated)
}

/// Writes the last section anew and leaves the rest as it is.
pub fn write_short(workspace: &Workspace) -> Result<(), FaultsError> {
    let generated = generate(workspace)?;
    let committed = committed(workspace)?;
    let (rest, _) = parts(&committed);
    write(workspace, &format!("{rest}{generated}"))
}

/// Writes the whole page anew.
pub fn write_long(workspace: &Workspace) -> Result<(), FaultsError> {
    let generated = generate_all(workspace)?;
    write(workspace, &generated)
}

/// Whether a committed page belongs to the section that was generated now.
fn judge(committed: &str, generated: &str) -> Result<(), FaultsError> {
    let (rest, section) = parts(committed);
    if section != generated {
        let difference = difference::between(section, generated);
        return Err(FaultsError::Stale(difference));
    }
    match (fingerprint(rest), fingerprint(generated)) {
        (Some(then), Some(now)) if then == now => Ok(()),
        _ => Err(FaultsError::Outdated),
    }
}

/// What stands before the section that is repeated, and that section.
fn parts(page: &str) -> (&str, &str) {
    page.split_at(page.find(REPEATED).unwrap_or(page.len()))
}

/// The first fingerprint of a text: so many hexadecimal digits between backquotes.
fn fingerprint(text: &str) -> Option<&str> {
    let is_one = |word: &&str| word.len() == DIGITS && word.chars().all(|c| c.is_ascii_hexdigit());
    text.split('`').find(is_one)
}

fn committed(workspace: &Workspace) -> Result<String, FaultsError> {
    let path = workspace.root().join(DOCUMENT);
    fs::read_to_string(&path).map_err(|error| FaultsError::File(path, error))
}

/// By way of a temporary file, so that the page is never half written.
fn write(workspace: &Workspace, page: &str) -> Result<(), FaultsError> {
    let path = workspace.root().join(DOCUMENT);
    let temporary = path.with_extension("md.new");
    fs::write(&temporary, page)
        .and_then(|()| fs::rename(&temporary, &path))
        .map_err(|error| FaultsError::File(path, error))
}

/// The section that is repeated, by the program that was built with the tests.
fn generate(workspace: &Workspace) -> Result<String, FaultsError> {
    let program = built::example(workspace, "faults").map_err(FaultsError::Generator)?;
    captured(workspace.program(&program.to_string_lossy(), &[]))
}

/// The whole page. Optimised as far as can be: it takes longer than that does.
fn generate_all(workspace: &Workspace) -> Result<String, FaultsError> {
    let mut cargo = workspace.cargo(&["run", "--quiet", "--release", "--package", "sim"]);
    cargo.args(["--example", "faults", "--", "--long"]);
    captured(cargo)
}

fn captured(command: Command) -> Result<String, FaultsError> {
    let text = command::capture(command).map_err(FaultsError::Generator)?;
    if parts(&text).1.is_empty() {
        return Err(FaultsError::Empty);
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(then: &str, now: &str) -> String {
        format!(
            "# Faults\n\nMade by `xtask` with `{then}`.\n\n{}",
            section(now)
        )
    }

    fn section(now: &str) -> String {
        format!("{REPEATED}\nFingerprint `{now}`.\n")
    }

    const NOW: &str = "0123456789abcdef";
    const THEN: &str = "fedcba9876543210";

    #[test]
    fn a_page_of_today_passes() {
        assert!(judge(&page(NOW, NOW), &section(NOW)).is_ok());
    }

    #[test]
    fn a_page_whose_last_section_differs_is_stale() {
        let error = judge(&page(NOW, THEN), &section(NOW));
        assert!(matches!(error, Err(FaultsError::Stale(d)) if d.contains("+ Fingerprint")));
        let error = judge("# Faults\n", &section(NOW));
        assert!(matches!(error, Err(FaultsError::Stale(_))));
    }

    #[test]
    fn a_page_of_code_that_behaved_otherwise_is_outdated() {
        for then in [THEN, "none"] {
            let error = judge(&page(then, NOW), &section(NOW));
            assert!(matches!(error, Err(FaultsError::Outdated)), "{then}");
        }
    }
}
