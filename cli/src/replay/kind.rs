//! Whether files are recordings of sensors or logs of a bus.
//!
//! In: the files and options of the command line. Out: which kind they are, or why they can't be
//! replayed together. A file that can't be opened is left to those who read it.

use std::path::Path;

use super::arguments::Arguments;
use super::error::ReplayError;

/// What only one of both kinds is told by.
const RECORDINGS: &str = "recordings of sensors (CSV)";
const LOGS: &str = "logs of a bus";

/// True for logs of a bus; options of the other kind are refused.
pub fn are_logs(arguments: &Arguments) -> Result<bool, ReplayError> {
    let name = |path: &Path| path.display().to_string();
    for file in arguments.files.iter().filter(|file| file.is_file()) {
        if let Ok(Some(format)) = bus_logs::foreign(file) {
            let why = bus_logs::LogError::Foreign(name(file), format);
            return Err(ReplayError::Playback(why.into()));
        }
    }
    let log = arguments.files.iter().find(|file| is_log(file));
    let other = arguments.files.iter().find(|file| !is_log(file));
    let first = arguments.files.first().map(|file| name(file));
    let refuse = |option, kind| ReplayError::WrongKind(option, first.unwrap_or_default(), kind);
    match (log, other) {
        (Some(log), Some(other)) if is_recording(other) => {
            Err(ReplayError::BothKinds(name(other), name(log)))
        }
        (Some(_), _) => arguments
            .given()
            .map_or(Ok(true), |option| Err(refuse(option, RECORDINGS))),
        (None, _) => arguments
            .log
            .given()
            .or_else(|| arguments.begin().map(|_| "--from with a time"))
            .map_or(Ok(false), |option| Err(refuse(option, LOGS))),
    }
}

/// Folders and standard input hold logs; a file is looked into.
fn is_log(path: &Path) -> bool {
    let is_folder = path.is_dir();
    let can_be_opened_again = path.is_file();
    // What can't be opened twice is no recording either.
    is_folder || !can_be_opened_again && (path.exists() || path.as_os_str() == "-") || {
        can_be_opened_again && matches!(bus_logs::kind_of(path), Ok(Some(_)))
    }
}

fn is_recording(path: &Path) -> bool {
    path.is_file() && matches!(bus_logs::kind_of(path), Ok(None))
}
