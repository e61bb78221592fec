//! A file that can't be read, in one sentence for all verbs.
//!
//! In: the file, and why. Out: the sentence.

use std::io;
use std::path::Path;

use super::printable;

/// A file, or a folder, that can't be read.
#[derive(Debug, thiserror::Error)]
#[error("cannot read {a}: {why}; check the name and the permissions", a = printable(.name))]
pub struct Unreadable {
    /// Its name.
    name: String,
    /// Why.
    why: io::Error,
}

impl Unreadable {
    /// This file, for this reason.
    pub fn new(path: &Path, why: io::Error) -> Self {
        Self {
            name: path.display().to_string(),
            why,
        }
    }
}
