//! How many instructions an SDO upload of a four-byte object takes on the device's side.
//!
//! In: the example `sdo_upload` of `device`, which does as many as it is told, under valgrind.
//! Out: a printed line. It is the example that tests share, with their checks of overflow, so no
//! step builds for it. Two runs differ in nothing but the number of uploads, so start and end of
//! the program cancel out. Where there is no valgrind the line states it.
//!
//! Left out: cycles of the part; the instructions are the host's.

use std::env::consts::ARCH;
use std::path::Path;
use std::{env, fs, process};

use super::SizeError;
use crate::built;
use crate::command;
use crate::workspace::Workspace;

/// Uploads of the shorter run, and how many more the longer one does.
const UPLOADS: u64 = 1000;

/// Prints instructions per upload.
pub fn print(workspace: &Workspace) -> Result<(), SizeError> {
    if !command::succeeds(workspace.program("valgrind", &["--version"])) {
        println!("      skipped: instructions of an SDO upload (no valgrind here)");
        return Ok(());
    }
    let program = built::example(workspace, "sdo_upload")?;
    let few = count(workspace, &program, UPLOADS)?;
    let many = count(workspace, &program, 2 * UPLOADS)?;
    if let (Some(few), Some(many)) = (few, many) {
        let each = many.saturating_sub(few) / UPLOADS;
        println!("      SDO upload of 4 bytes, request to response, as built for tests:");
        println!("      {each} instructions ({ARCH})");
    }
    Ok(())
}

/// Instructions of a whole run; `None` when valgrind does not tell them.
fn count(workspace: &Workspace, program: &Path, uploads: u64) -> Result<Option<u64>, SizeError> {
    let file = env::temp_dir().join(format!("plumb-instructions-{}", process::id()));
    let mut valgrind = workspace.program("valgrind", &["--quiet", "--tool=callgrind"]);
    valgrind
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg(program)
        .arg(uploads.to_string());
    let run = command::capture(valgrind);
    let text = fs::read_to_string(&file);
    // It is there only when valgrind has run.
    let _ = fs::remove_file(&file);
    run?;
    let text = text.map_err(|error| SizeError::File(file, error))?;
    Ok(total(&text))
}

/// The line of totals in what callgrind writes.
fn total(text: &str) -> Option<u64> {
    let mut lines = text.lines();
    let total = lines.find_map(|l| l.strip_prefix("totals:").or(l.strip_prefix("summary:")))?;
    total.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::total;

    #[test]
    fn the_total_of_a_run_is_found() {
        assert_eq!(
            total("events: Ir\nfn=(1) a\n0 5\n\ntotals: 12345\n"),
            Some(12_345)
        );
        assert_eq!(total("summary: 7\n"), Some(7));
        assert_eq!(total("events: Ir\n"), None);
    }
}
