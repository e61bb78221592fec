//! `report.html` and `report.json` on disk.
//!
//! In: a report and a folder, which is made when it is not there. Out: both files, or an error
//! that names the path and says what to do. Each file is written under another name in the same
//! folder and renamed when it is complete, so nobody ever finds half a report.

use std::fmt;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::data::DemoReport;
use super::replay_data::ReplayReport;
use super::{page, replay_page};

/// Where the report went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The page.
    pub html: PathBuf,
    /// The data.
    pub json: PathBuf,
}

/// Why a report could not be written.
#[derive(Debug)]
pub enum WriteError {
    /// The folder could not be made.
    Scratch(PathBuf, io::Error),
    /// A file in it could not be written.
    File(PathBuf, io::Error),
    /// A complete file could not be put in its place.
    Replace(PathBuf, io::Error),
    /// The report could not be turned into JSON.
    Encode(PathBuf, serde_json::Error),
}

impl fmt::Display for WriteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scratch(path, why) => write!(
                f,
                "cannot make the folder {}: {why}; choose another one with --out",
                path.display()
            ),
            Self::File(path, why) => write!(
                f,
                "cannot write {}: {why}; make room or choose another folder with --out",
                path.display()
            ),
            Self::Replace(path, why) => write!(
                f,
                "cannot replace {}: {why}; move it away or choose another folder with --out",
                path.display()
            ),
            Self::Encode(path, why) => write!(
                f,
                "cannot put the report into JSON for {}: {why}; please report this as a defect",
                path.display()
            ),
        }
    }
}

impl std::error::Error for WriteError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Scratch(_, why) | Self::File(_, why) | Self::Replace(_, why) => Some(why),
            Self::Encode(_, why) => Some(why),
        }
    }
}

/// Makes `folder` and tries it out, so that a long run does not end at a folder that cannot be
/// written. Leaves nothing behind but the folder.
pub fn try_folder(folder: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(folder).map_err(|why| WriteError::Scratch(folder.to_owned(), why))?;
    Pending::write(&folder.join("report.json"), "").map(drop)
}

/// Writes the report of a demo run into `folder`.
pub fn demo(folder: &Path, report: &DemoReport) -> Result<Written, WriteError> {
    both(folder, &page::demo(report), report)
}

/// Writes the report of a replay into `folder`.
pub fn replay(folder: &Path, report: &ReplayReport) -> Result<Written, WriteError> {
    both(folder, &replay_page::replay(report), report)
}

/// Writes a page and its data into `folder`: both files are complete before the first is put in
/// its place.
pub fn both(folder: &Path, html: &str, report: &impl Serialize) -> Result<Written, WriteError> {
    let written = Written {
        html: folder.join("report.html"),
        json: folder.join("report.json"),
    };
    let json = super::json::to_lines(report)
        .map_err(|why| WriteError::Encode(written.json.clone(), why))?;
    try_folder(folder)?;
    let mut html = Pending::write(&written.html, html)?;
    let mut json = Pending::write(&written.json, &json)?;
    for place in [&written.json, &written.html] {
        if place.is_dir() {
            let why = io::Error::from(io::ErrorKind::IsADirectory);
            return Err(WriteError::Replace(place.clone(), why));
        }
    }
    json.put_in_place(&written.json)?;
    html.put_in_place(&written.html)?;
    Ok(written)
}

/// Writes files of these names and contents into `folder`, in this order; all of them are complete
/// before the first is put in its place.
///
/// Errors: see [`WriteError`].
pub fn together(folder: &Path, files: &[(&str, &str)]) -> Result<(), WriteError> {
    fs::create_dir_all(folder).map_err(|why| WriteError::Scratch(folder.to_owned(), why))?;
    let mut pending = Vec::new();
    for (name, text) in files {
        let place = folder.join(name);
        if place.is_dir() {
            let why = io::Error::from(io::ErrorKind::IsADirectory);
            return Err(WriteError::Replace(place, why));
        }
        pending.push((Pending::write(&place, text)?, place));
    }
    pending
        .iter_mut()
        .try_for_each(|(file, place)| file.put_in_place(place))
}

/// A complete file under a name of its own; removed again unless it gets to its place.
struct Pending {
    path: Option<PathBuf>,
}

impl Pending {
    fn write(place: &Path, text: &str) -> Result<Self, WriteError> {
        let name = place.file_name().unwrap_or_default().to_string_lossy();
        let path = place.with_file_name(format!(".{name}.{}.part", std::process::id()));
        // Made before the first byte, so that a half-written file is removed as well.
        let pending = Self {
            path: Some(path.clone()),
        };
        let fill = |path: &Path| {
            let mut file = fs::File::create(path)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()
        };
        fill(&path).map_err(|why| WriteError::File(place.to_owned(), why))?;
        Ok(pending)
    }

    fn put_in_place(&mut self, place: &Path) -> Result<(), WriteError> {
        let Some(path) = self.path.take() else {
            return Ok(());
        };
        fs::rename(&path, place).map_err(|why| {
            self.path = Some(path);
            WriteError::Replace(place.to_owned(), why)
        })
    }
}

impl Drop for Pending {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // Nothing better can be done when this fails: the name says that it is a part.
            let _ = fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::*;
    use crate::scratch::Scratch;

    #[test]
    fn both_files_are_written_and_nothing_else_is_left() {
        let folder = Scratch::new("both");
        let deep = folder.0.join("a/b");
        let written = demo(&deep, &sample::demo()).unwrap();
        let read: DemoReport =
            serde_json::from_str(&fs::read_to_string(&written.json).unwrap()).unwrap();
        assert_eq!(read, sample::demo());
        assert_eq!(
            fs::read_to_string(&written.html).unwrap(),
            page::demo(&sample::demo())
        );
        assert_eq!(Scratch(deep).names(), ["report.html", "report.json"]);
    }

    #[test]
    fn an_older_report_is_replaced() {
        let folder = Scratch::new("older");
        demo(&folder.0, &sample::demo()).unwrap();
        replay(&folder.0, &sample::replay()).unwrap();
        let json = fs::read_to_string(folder.0.join("report.json")).unwrap();
        assert!(json.contains("plumb-replay"));
        assert_eq!(folder.names(), ["report.html", "report.json"]);
    }

    #[test]
    fn a_failure_names_the_path_and_leaves_the_old_report_alone() {
        let folder = Scratch::new("failure");
        fs::write(folder.0.join("report.json"), "old").unwrap();
        fs::create_dir(folder.0.join("report.html")).unwrap();
        let error = demo(&folder.0, &sample::demo()).unwrap_err();
        let text = error.to_string();
        assert!(matches!(error, WriteError::Replace(..)));
        assert!(
            text.contains("report.html") && text.contains("--out"),
            "{text}"
        );
        assert_eq!(
            fs::read_to_string(folder.0.join("report.json")).unwrap(),
            "old"
        );
        assert_eq!(folder.names(), ["report.html", "report.json"]);
    }

    #[test]
    fn a_folder_that_is_a_file_is_refused_in_one_sentence() {
        let folder = Scratch::new("file");
        let file = folder.0.join("taken");
        fs::write(&file, "").unwrap();
        let error = demo(&file, &sample::demo()).unwrap_err();
        assert!(matches!(error, WriteError::Scratch(..)));
        assert_eq!(error.to_string().lines().count(), 1);
        assert!(error.to_string().contains("taken"));
    }

    /// Writes the two sample pages where PLUMB_SAMPLE_DIR says, to look at them in a browser.
    #[test]
    #[ignore = "writes files for a person to look at"]
    fn sample_pages() {
        let folder = std::env::var_os("PLUMB_SAMPLE_DIR")
            .map(PathBuf::from)
            .unwrap();
        demo(&folder.join("demo"), &sample::demo()).unwrap();
        replay(&folder.join("replay"), &sample::replay()).unwrap();
        let shown = super::super::terminal::print_demo(&sample::demo(), true);
        let replayed = super::super::terminal::print_replay(&sample::replay());
        fs::write(folder.join("demo.txt"), shown).unwrap();
        fs::write(folder.join("replay.txt"), replayed).unwrap();
    }
}
