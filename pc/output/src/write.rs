//! `report.html` and `report.json` on disk.
//!
//! In: a report and a folder, which is made when it is not there. Out: both files, or an error
//! that names the path and says what to do. Each file is written under another name in the same
//! folder and renamed when it is complete, so nobody ever finds half a report.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use tempfile::NamedTempFile;

use super::{json, printable};

/// Where the report went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The page.
    pub html: PathBuf,
    /// The data.
    pub json: PathBuf,
}

impl Written {
    /// Where it is, as a line for the terminal.
    pub fn line(&self) -> String {
        format!("Report: {} and {}\n", shown(&self.html), shown(&self.json))
    }
}

/// Why a report could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The folder could not be made.
    #[error(
        "cannot make the folder {}: {why}; choose another one with --out",
        shown(.0), why = .1
    )]
    Folder(PathBuf, #[source] io::Error),
    /// A file in it could not be written.
    #[error(
        "cannot write {}: {why}; make room or choose another folder with --out",
        shown(.0), why = .1
    )]
    File(PathBuf, #[source] io::Error),
    /// A complete file could not be put in its place.
    #[error(
        "cannot replace {}: {why}; move it away or choose another folder with --out",
        shown(.0), why = .1
    )]
    Replace(PathBuf, #[source] io::Error),
    /// The report could not be turned into JSON.
    #[error(
        "cannot put the report into JSON for {}: {why}; please report this as a defect",
        shown(.0), why = .1
    )]
    Encode(PathBuf, #[source] serde_json::Error),
}

fn shown(path: &Path) -> String {
    printable(&path.display().to_string())
}

/// Makes `folder` and tries it out, so that a long run does not end at a folder that cannot be
/// written. Leaves nothing behind but the folder.
pub fn try_folder(folder: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(folder).map_err(|why| WriteError::Folder(folder.to_owned(), why))?;
    let place = folder.join("report.json");
    match Staged::write(&place, "") {
        Ok(_) => Ok(()),
        Err(why) => Err(WriteError::File(place, why)),
    }
}

/// Writes a page and its data into `folder`: both files are complete before the first is put in
/// its place.
pub fn both(folder: &Path, html: &str, report: &impl Serialize) -> Result<Written, WriteError> {
    let written = Written {
        html: folder.join("report.html"),
        json: folder.join("report.json"),
    };
    let json =
        json::to_lines(report).map_err(|why| WriteError::Encode(written.json.clone(), why))?;
    together(folder, &[("report.json", &json), ("report.html", html)])?;
    Ok(written)
}

/// Writes files of these names and contents into `folder`, in this order; all of them are complete
/// before the first is put in its place.
///
/// Errors: see [`WriteError`].
pub fn together(folder: &Path, files: &[(&str, &str)]) -> Result<(), WriteError> {
    fs::create_dir_all(folder).map_err(|why| WriteError::Folder(folder.to_owned(), why))?;
    let mut staged = Vec::new();
    for (name, text) in files {
        let place = folder.join(name);
        if place.is_dir() {
            let why = io::Error::from(io::ErrorKind::IsADirectory);
            return Err(WriteError::Replace(place, why));
        }
        let file = Staged::write(&place, text);
        staged.push((
            file.map_err(|why| WriteError::File(place.clone(), why))?,
            place,
        ));
    }
    staged.into_iter().try_for_each(|(file, place)| {
        let placed = file.put_in_place();
        placed.map_err(|why| WriteError::Replace(place, why))
    })
}

/// A complete file beside its place, under a name of its own; removed again unless it is put in
/// its place.
#[derive(Debug)]
pub struct Staged {
    file: NamedTempFile,
    place: PathBuf,
}

impl Staged {
    /// Writes a file beside `place`, hidden, with the rights of any new file.
    ///
    /// Errors: what the system says.
    pub fn write(place: &Path, text: &str) -> io::Result<Self> {
        let mut file = beside(place)?;
        file.write_all(text.as_bytes())?;
        file.as_file().sync_all()?;
        let place = place.to_owned();
        Ok(Self { file, place })
    }

    /// Puts the file in its place, where it replaces an older one.
    ///
    /// Errors: what the system says.
    pub fn put_in_place(self) -> io::Result<()> {
        let placed = self.file.persist(&self.place).map(drop);
        placed.map_err(|failed| failed.error)
    }
}

fn beside(place: &Path) -> io::Result<NamedTempFile> {
    let name = place.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
    let folder = place.parent().filter(|folder| *folder != Path::new(""));
    let prefix = format!(".{}.", name.to_string_lossy());
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".part");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder.unwrap_or(Path::new(".")))
}

#[cfg(test)]
mod tests {
    use super::*;

    const OLD: [f64; 3] = [1.0, 2.0, 3.0];

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn both_files_are_written_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let deep = folder.path().join("a/b");
        let written = both(&deep, "<p>page</p>", &OLD).unwrap();
        let json = fs::read_to_string(&written.json).unwrap();
        assert_eq!(serde_json::from_str::<[f64; 3]>(&json).unwrap(), OLD);
        assert_eq!(fs::read_to_string(&written.html).unwrap(), "<p>page</p>");
        assert_eq!(names(&deep), ["report.html", "report.json"]);
    }

    #[test]
    fn an_older_report_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        both(folder.path(), "old", &OLD).unwrap();
        let written = both(folder.path(), "new", &["new"]).unwrap();
        assert_eq!(fs::read_to_string(&written.html).unwrap(), "new");
        assert!(fs::read_to_string(&written.json).unwrap().contains("new"));
        assert_eq!(names(folder.path()), ["report.html", "report.json"]);
    }

    #[test]
    fn a_failure_names_the_path_and_leaves_the_old_report_alone() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name| folder.path().join(name);
        fs::write(at("report.json"), "old").unwrap();
        fs::create_dir(at("report.html")).unwrap();
        let error = both(folder.path(), "new", &OLD).unwrap_err();
        let text = error.to_string();
        assert!(matches!(error, WriteError::Replace(..)));
        assert!(
            text.contains("report.html") && text.contains("--out"),
            "{text}"
        );
        assert_eq!(fs::read_to_string(at("report.json")).unwrap(), "old");
        assert_eq!(names(folder.path()), ["report.html", "report.json"]);
    }

    #[test]
    fn a_folder_that_is_a_file_is_refused_in_one_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("taken");
        fs::write(&file, "").unwrap();
        let error = both(&file, "page", &OLD).unwrap_err();
        assert!(matches!(error, WriteError::Folder(..)));
        assert_eq!(error.to_string().lines().count(), 1);
        assert!(error.to_string().contains("taken"));
    }
}
