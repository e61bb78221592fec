//! The files behind what was named on the command line.
//!
//! In: paths of files and folders, `-` for standard input. Out: each file once, those of a folder
//! in the order of their names and of its folders after it, hidden ones left out.

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};

use crate::LogError;
use crate::input::is_stdin;
use output::unreadable::Unreadable;

/// Folders within folders that are looked into.
const DEPTH: usize = 8;

/// A file that may be a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Candidate {
    /// Where it is.
    pub path: PathBuf,
    /// Whether it was named itself, and not only its folder.
    pub is_named: bool,
    /// Whether it can be opened again: no pipe and no device.
    pub is_file: bool,
    /// Its length in bytes; 0 where it has none.
    pub length: u64,
}

/// All files behind the paths.
pub fn candidates(paths: &[PathBuf]) -> Result<Vec<Candidate>, LogError> {
    let mut found = Vec::new();
    let mut seen = HashSet::new();
    for path in paths {
        if is_stdin(path) {
            found.push(Candidate {
                path: path.clone(),
                is_named: true,
                is_file: false,
                length: 0,
            });
            continue;
        }
        let about = path.metadata().map_err(|why| cannot_read(path, why))?;
        if about.is_dir() {
            let before = found.len();
            walk(path, DEPTH, &mut found).map_err(|why| cannot_read(path, why))?;
            if found.len() == before {
                return Err(LogError::NoLogs(path.display().to_string()));
            }
        } else {
            found.push(Candidate {
                path: path.clone(),
                is_named: true,
                is_file: about.is_file(),
                length: about.len(),
            });
        }
    }
    found.retain(|one| match one.path.canonicalize() {
        Ok(place) => seen.insert(place),
        Err(_) => true,
    });
    Ok(found)
}

fn walk(folder: &Path, depth: usize, found: &mut Vec<Candidate>) -> io::Result<()> {
    let entries = std::fs::read_dir(folder)?;
    let mut paths: Vec<_> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    paths.sort();
    let is_hidden = |path: &Path| {
        let name = path.file_name().unwrap_or_default();
        name.as_encoded_bytes().starts_with(b".")
    };
    paths.retain(|path| !is_hidden(path));
    let mut folders = Vec::new();
    for path in paths {
        let Ok(about) = path.metadata() else { continue };
        if about.is_dir() && !path.is_symlink() {
            folders.push(path);
        } else if about.is_file() {
            found.push(Candidate {
                path,
                is_named: false,
                is_file: true,
                length: about.len(),
            });
        }
    }
    if depth > 1 {
        for folder in folders {
            // A folder that may not be read is passed over like a hidden one.
            let _ = walk(&folder, depth - 1, found);
        }
    }
    Ok(())
}

/// The error of a path that can't be read.
pub fn cannot_read(path: &Path, why: io::Error) -> LogError {
    Unreadable::new(path, why).into()
}
