//! Files on disk that appear whole or not at all; `report.html` and `report.json` above all.
//!
//! In: a report and a folder, which is made when it is not there; or any file. Out: the files, or
//! an error that names the path and states what to do. Each file is written under another name in
//! the same folder and renamed when it is complete, so nobody ever finds half a report, and what
//! was there before stays until then. A link stays, and the file it leads to is replaced. A
//! device, a pipe or an open file of the process is never replaced: [`save`] writes into it, all
//! others refuse it ([`NoPlace`]). A file whose name the user gave is replaced only where the user
//! said so ([`Existing`]). What a process that was killed has left beside a place is removed by
//! the next one that writes there.

use std::fs::{self, File, OpenOptions, TryLockError};
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
    staged(folder.join("report.json"), "").map(drop)
}

fn staged(place: PathBuf, text: &str) -> Result<Staged, WriteError> {
    let existing = Existing::Replace;
    match check_place(&place, existing) {
        Err(why) => Err(WriteError::Replace(place, why.into())),
        Ok(_) => Staged::write(&place, text, existing).map_err(|why| WriteError::File(place, why)),
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
    let mut complete = Vec::new();
    for (name, text) in files {
        let place = folder.join(name);
        complete.push((staged(place.clone(), text)?, place));
    }
    complete.into_iter().try_for_each(|(file, place)| {
        let placed = file.put_in_place();
        placed.map_err(|why| WriteError::Replace(place, why))
    })
}

/// What becomes of a file that is at the place of a new one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Existing {
    /// It stays, and nothing is written.
    #[default]
    Keep,
    /// The new one replaces it.
    Replace,
}

impl Existing {
    /// What `--force`, given or not, means.
    pub const fn of(force: bool) -> Self {
        match force {
            true => Self::Replace,
            false => Self::Keep,
        }
    }
}

/// The sentence for a file that was not written, of which the user gave the name.
///
/// In: the file, what the system or [`NoPlace`] reports, and what to choose instead, as "another
/// file with --output".
pub fn not_written(place: &Path, why: &io::Error, other: &str) -> String {
    let place = shown(place);
    match why.kind() {
        io::ErrorKind::AlreadyExists => {
            format!("{place} is there already: choose {other}, or replace it with --force")
        }
        _ => format!("cannot write {place}: {why}; make room or choose {other}"),
    }
}

/// Why a place takes no file.
#[derive(Debug, thiserror::Error)]
pub enum NoPlace {
    /// A file that may not be replaced.
    #[error("it is there already")]
    Taken,
    /// A link to what is not there.
    #[error("the link leads nowhere")]
    Link,
    /// A folder.
    #[error("it is a folder")]
    Folder,
    /// A device, a pipe, or an open file of the process as `/dev/stdout` names it.
    #[error("it is no regular file")]
    Special,
    /// A file that may not be written, or what else the system reports.
    #[error("{0}")]
    System(#[from] io::Error),
}

impl From<NoPlace> for io::Error {
    fn from(why: NoPlace) -> Self {
        match why {
            NoPlace::System(why) => why,
            NoPlace::Taken => Self::new(io::ErrorKind::AlreadyExists, why),
            NoPlace::Folder => Self::new(io::ErrorKind::IsADirectory, why),
            NoPlace::Link | NoPlace::Special => Self::new(io::ErrorKind::InvalidInput, why),
        }
    }
}

/// Refuses a place that holds anything but a regular file that may be written: a rename would
/// replace it all the same. Refuses such a file too where an existing one stays.
///
/// Out: where the file itself is, which is elsewhere for a link.
///
/// Errors: see [`NoPlace`].
pub fn check_place(place: &Path, existing: Existing) -> Result<PathBuf, NoPlace> {
    if fs::symlink_metadata(place).is_err() {
        return Ok(place.to_owned());
    }
    let about = fs::metadata(place).map_err(|_| NoPlace::Link)?;
    if about.is_dir() {
        return Err(NoPlace::Folder);
    }
    if !about.is_file() || is_open_file(place) {
        return Err(NoPlace::Special);
    }
    if existing == Existing::Keep {
        return Err(NoPlace::Taken);
    }
    OpenOptions::new().write(true).open(place)?;
    Ok(place.canonicalize()?)
}

/// Whether the path names an open file of a process, as `/dev/stdout` and `/dev/fd/3` do: whoever
/// has opened it would go on with the old file after a rename.
fn is_open_file(path: &Path) -> bool {
    let folder = folder_of(path);
    let is_of_process = folder
        .canonicalize()
        .is_ok_and(|folder| folder.starts_with("/proc") || folder == Path::new("/dev/fd"));
    is_of_process || fs::read_link(path).is_ok_and(|to| is_open_file(&folder.join(to)))
}

/// Writes a file, which appears whole or not at all. What is there and is neither a regular file
/// nor a folder, as a device or a pipe, is written into.
///
/// Errors: what the system reports, or why nothing can be replaced there.
pub fn save(place: &Path, content: impl AsRef<[u8]>, existing: Existing) -> io::Result<()> {
    match check_place(place, existing) {
        Err(NoPlace::Special) => fs::write(place, content),
        _ => Staged::write(place, content, existing).and_then(Staged::put_in_place),
    }
}

/// A complete file beside its place, under a name of its own; removed again unless it is put in
/// its place.
#[derive(Debug)]
pub struct Staged {
    file: NamedTempFile,
    place: PathBuf,
    existing: Existing,
}

impl Staged {
    /// Begins an empty file beside `place`, hidden, with the rights of the file that it is to
    /// replace, or of any new one.
    ///
    /// Errors: a place of which [`NoPlace`] tells, or what the system reports.
    pub fn begin(place: &Path, existing: Existing) -> io::Result<Self> {
        let place = check_place(place, existing)?;
        let file = beside(&place)?;
        if let Ok(old) = fs::metadata(&place) {
            // Some file systems have no rights.
            let _ = file.as_file().set_permissions(old.permissions());
        }
        Ok(Self {
            file,
            place,
            existing,
        })
    }

    /// Writes a file beside `place`, see [`Staged::begin`]; it is on the disk then.
    ///
    /// Errors: as [`Staged::begin`].
    pub fn write(place: &Path, content: impl AsRef<[u8]>, existing: Existing) -> io::Result<Self> {
        let mut staged = Self::begin(place, existing)?;
        staged.file.as_file_mut().write_all(content.as_ref())?;
        staged.sync()?;
        Ok(staged)
    }

    /// The file, for what is written to it piece by piece.
    ///
    /// Errors: what the system reports.
    pub fn handle(&self) -> io::Result<File> {
        self.file.as_file().try_clone()
    }

    /// Waits until what was written is on the disk.
    ///
    /// Errors: what the system reports, above all that the disk is full.
    pub fn sync(&self) -> io::Result<()> {
        self.file.as_file().sync_all()
    }

    /// Puts the file in its place, where it replaces an older one if it may.
    ///
    /// Errors: what the system reports, also that a file has come there meanwhile.
    pub fn put_in_place(self) -> io::Result<()> {
        let placed = match self.existing {
            Existing::Keep => self.file.persist_noclobber(&self.place),
            Existing::Replace => self.file.persist(&self.place),
        };
        let placed = placed.map(drop);
        placed.map_err(|failed| failed.error)
    }
}

fn beside(place: &Path) -> io::Result<NamedTempFile> {
    let name = place.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
    // As much of it as leaves room for the rest of a name.
    let name: String = name.to_string_lossy().chars().take(40).collect();
    let prefix = format!(".{name}.");
    let folder = folder_of(place);
    remove_leftovers(folder, &prefix);
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(PART);
    loop {
        // `tempfile_in` would put this file's name into the errors, which nobody has given.
        let file = builder.make_in(folder, |path| {
            OpenOptions::new().write(true).create_new(true).open(path)
        })?;
        // Another process may have taken it for a leftover before it was locked. Some file systems
        // have no locks, and nobody removes a leftover there.
        let is_own = !matches!(file.as_file().try_lock(), Err(TryLockError::WouldBlock));
        if is_own && file.path().exists() {
            return Ok(file);
        }
    }
}

/// How the names end of files that are not in their place yet.
const PART: &str = ".part";

/// Removes the files that begin so and whose writer was killed: it had them locked.
fn remove_leftovers(folder: &Path, prefix: &str) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let middle = name.to_str().and_then(|name| {
            let rest = name.strip_prefix(prefix)?;
            rest.strip_suffix(PART)
        });
        // What `tempfile` puts between.
        let is_part = middle.is_some_and(|middle| {
            middle.len() == 6 && middle.bytes().all(|byte| byte.is_ascii_alphanumeric())
        });
        let path = entry.path();
        if is_part
            && entry.file_type().is_ok_and(|kind| kind.is_file())
            && let Ok(file) = OpenOptions::new().write(true).open(&path)
            && file.try_lock().is_ok()
        {
            // What can't be removed is in nobody's way.
            let _ = fs::remove_file(path);
        }
    }
}

fn folder_of(place: &Path) -> &Path {
    let folder = place.parent().filter(|folder| *folder != Path::new(""));
    folder.unwrap_or(Path::new("."))
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
    #[cfg(unix)]
    fn a_link_was_replaced_by_a_file() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| folder.path().join(name));
        fs::write(&file, "old").unwrap();
        fs::set_permissions(&file, PermissionsExt::from_mode(0o600)).unwrap();
        symlink(&file, &link).unwrap();
        save(&link, "new", Existing::Replace).unwrap();
        assert_eq!(fs::read_link(&link).unwrap(), file);
        assert_eq!(fs::read_to_string(&file).unwrap(), "new");
        let mode = fs::metadata(&file).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        fs::remove_file(&file).unwrap();
        let told = save(&link, "newer", Existing::Replace).unwrap_err();
        assert_eq!(told.to_string(), "the link leads nowhere");
        assert_eq!(names(folder.path()), ["link"]);
    }

    #[test]
    #[cfg(unix)]
    fn a_pipe_or_device_was_replaced_by_a_file() {
        use std::os::unix::fs::FileTypeExt as _;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("report.json");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.is_ok_and(|status| status.success()), "no mkfifo here");
        let told = Staged::write(&pipe, "new", Existing::Replace).unwrap_err();
        assert_eq!(told.to_string(), "it is no regular file");
        for told in [
            both(folder.path(), "", &OLD).map(drop),
            try_folder(folder.path()),
        ] {
            assert!(matches!(told, Err(WriteError::Replace(..))), "{told:?}");
        }
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(names(folder.path()), ["report.json"]);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn an_open_file_and_a_device_are_written_into() {
        use std::io::Read as _;
        use std::os::fd::AsRawFd as _;
        let folder = tempfile::tempdir().unwrap();
        let mut file = File::create_new(folder.path().join("out")).unwrap();
        let place = PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()));
        assert!(matches!(
            check_place(&place, Existing::Keep),
            Err(NoPlace::Special)
        ));
        save(&place, "text", Existing::Keep).unwrap();
        file.write_all(b"T").unwrap();
        let mut text = String::new();
        let mut again = File::open(folder.path().join("out")).unwrap();
        again.read_to_string(&mut text).unwrap();
        assert_eq!(text, "Text");
        assert!(matches!(
            check_place(Path::new("/dev/full"), Existing::Keep),
            Err(NoPlace::Special)
        ));
        let told = save(Path::new("/dev/full"), "text", Existing::Keep).unwrap_err();
        assert_eq!(told.kind(), io::ErrorKind::StorageFull);
    }

    #[test]
    fn a_file_that_may_not_be_written_is_not_replaced_either() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "old").unwrap();
        let mut rights = fs::metadata(&file).unwrap().permissions();
        rights.set_readonly(true);
        fs::set_permissions(&file, rights).unwrap();
        // Root may.
        let may = OpenOptions::new().write(true).open(&file).is_ok();
        assert_eq!(save(&file, "new", Existing::Replace).is_ok(), may);
        let left = fs::read_to_string(&file).unwrap();
        assert_eq!(left, if may { "new" } else { "old" });
    }

    #[test]
    fn a_long_name_can_be_written() {
        let folder = tempfile::tempdir().unwrap();
        save(&folder.path().join("n".repeat(255)), "text", Existing::Keep).unwrap();
    }

    #[test]
    fn a_file_was_replaced_without_a_word() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        let begun = Staged::write(&file, "first", Existing::Keep).unwrap();
        save(&file, "old", Existing::Keep).unwrap();
        let late = begun.put_in_place().unwrap_err();
        let told = save(&file, "new", Existing::Keep).unwrap_err();
        for why in [late, told] {
            let told = not_written(&file, &why, "another one");
            assert!(
                told.ends_with("choose another one, or replace it with --force"),
                "{told}"
            );
        }
        assert_eq!(fs::read_to_string(&file).unwrap(), "old");
        save(&file, "new", Existing::Replace).unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "new");
        assert_eq!(names(folder.path()), ["file"]);
    }

    #[test]
    fn what_a_killed_process_left_beside_a_file_stayed_there() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        let others = [".file.user.part", ".filer.abcdef.part", "file.abcdef.part"];
        for name in others.iter().chain(&[".file.abcdef.part"]) {
            fs::write(folder.path().join(name), "left").unwrap();
        }
        // One that another process is writing stays.
        let begun = Staged::begin(&file, Existing::Keep).unwrap();
        save(&file, "new", Existing::Keep).unwrap();
        assert_eq!(names(folder.path()).len(), others.len() + 2);
        drop(begun);
        let mut left = [&others[..], &["file"]].concat();
        left.sort_unstable();
        assert_eq!(names(folder.path()), left);
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
