//! Where the report of a calibration goes, so that none replaces an earlier one by accident.
//!
//! In: the folder of --out and whether --force was given. Out: a folder that holds nothing of a
//! report, or with --force one whose earlier report stays until a new calibration is accepted;
//! what was not accepted goes into a folder of its own beside it.
//!
//! Left out: what the files hold.

use std::fs;
use std::path::{Path, PathBuf};

use super::data::{now, utc};
use super::error::CalibrateError;
use super::kept::{self, Kept};
use output::write::{self, Existing};

/// What the nodes had before.
const AS_FOUND: &str = "as-found.json";

/// What `plumb characterise` has measured.
pub const MEASURED: &str = "measured.json";

/// Each of them makes a folder one of a calibration.
const NAMES: [&str; 5] = [AS_FOUND, "dcc.xml", REPORT, "report.html", MEASURED];

/// The report's numbers, without which there is no report.
const REPORT: &str = "report.json";

/// How the folders beside a report begin that hold what is not accepted, or not yet.
const NOT_ACCEPTED: &str = "not-accepted-";

/// The folder of a report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folder {
    /// The value of --out.
    out: PathBuf,
    /// Where the files go before the calibration is accepted: `out` unless a report is there.
    own: PathBuf,
}

impl Folder {
    /// Takes a folder, which is made when it is not there; nothing in it changes.
    ///
    /// Errors: [`CalibrateError::Earlier`] without `force` where a report is; a folder that can't
    /// be written.
    pub fn claim(out: &Path, force: bool) -> Result<Self, CalibrateError> {
        let mut places = NAMES.iter().map(|name| out.join(name));
        let earlier = places.find(|place| place.symlink_metadata().is_ok());
        let own = match earlier {
            None => out.to_owned(),
            Some(_) if force => {
                let time = utc(now()).replace(['-', ':'], "");
                out.join(format!("{NOT_ACCEPTED}{time}"))
            }
            Some(place) => return Err(CalibrateError::Earlier(place, "folder with --out")),
        };
        write::try_folder(out)?;
        let out = out.to_owned();
        Ok(Self { out, own })
    }

    /// Takes the folder of a run that was interrupted, to go on with it. Where a report is, the run
    /// is the newest one that --force has put beside it; its folder may be named as well.
    ///
    /// Errors: [`CalibrateError::Finished`] where a report is and no such run.
    pub fn resume(out: &Path) -> Result<Self, CalibrateError> {
        let has_report = |out: &Path| out.join(REPORT).symlink_metadata().is_ok();
        if !has_report(out) {
            let beside = out.parent().filter(|parent| has_report(parent));
            return Ok(Self {
                out: beside.filter(|_| is_beside(out)).unwrap_or(out).to_owned(),
                own: out.to_owned(),
            });
        }
        let entries = fs::read_dir(out).map_err(CalibrateError::file(out))?;
        let folders = entries.flatten().map(|entry| entry.path());
        let runs = folders.filter(|path| is_beside(path) && Self::is_unfinished(path));
        match runs.max() {
            Some(own) => Ok(Self {
                out: out.to_owned(),
                own,
            }),
            None => Err(CalibrateError::Finished(out.to_owned())),
        }
    }

    /// True when it holds what `plumb characterise` has measured, and no report.
    pub fn is_unfinished(out: &Path) -> bool {
        let is_there = |name: &str| out.join(name).symlink_metadata().is_ok();
        is_there(MEASURED) && !is_there(REPORT)
    }

    /// Where the files go until the calibration is accepted.
    pub fn own(&self) -> &Path {
        &self.own
    }

    /// Writes down what the nodes had.
    ///
    /// Errors: [`CalibrateError::File`].
    pub fn keep(&self, kept: &Kept) -> Result<(), CalibrateError> {
        if self.own != self.out {
            // Fails where one is, which so is never replaced.
            fs::create_dir(&self.own).map_err(CalibrateError::file(&self.own))?;
        }
        kept::save(&self.found(), kept, Existing::Replace)
    }

    /// The value of --out.
    pub fn out(&self) -> &Path {
        &self.out
    }

    /// Where it stands what the nodes had.
    pub fn found(&self) -> PathBuf {
        self.own.join(AS_FOUND)
    }

    /// Writes the files of the report and returns the folder that they are in. What was accepted
    /// takes the place of an earlier report, what was not stands in a folder of its own.
    ///
    /// Errors: [`CalibrateError::Write`], [`CalibrateError::File`].
    pub fn write(&self, files: &[(&str, &str)], accepted: bool) -> Result<PathBuf, CalibrateError> {
        if !accepted || self.own == self.out {
            write::together(&self.own, files)?;
            return Ok(self.own.clone());
        }
        let found = self.found();
        let found = fs::read_to_string(&found).map_err(CalibrateError::file(&found))?;
        let mut all = vec![(AS_FOUND, found.as_str())];
        all.extend_from_slice(files);
        write::together(&self.out, &all)?;
        let measured = self.own.join(MEASURED);
        if measured.symlink_metadata().is_ok() {
            fs::rename(&measured, self.out.join(MEASURED))
                .map_err(CalibrateError::file(&measured))?;
        }
        self.forget();
        Ok(self.out.clone())
    }

    /// Takes back what [`Folder::keep`] has written, when it is of no more use: it stands
    /// elsewhere, or the nodes have it again.
    pub fn forget(&self) {
        // What can't be removed is in nobody's way.
        let _ = fs::remove_file(self.found());
        if self.own != self.out {
            let _ = fs::remove_dir(&self.own);
        }
    }
}

/// By its name a folder stands beside a report and holds what is not accepted, or not yet.
fn is_beside(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    name.is_some_and(|name| name.starts_with(NOT_ACCEPTED))
}

#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;

    fn kept(format: &str) -> Kept {
        Kept {
            format: format.to_owned(),
            version: 1,
            nodes: Vec::new(),
        }
    }

    /// Files of a calibration; a chamber run has one more.
    const WRITTEN: usize = NAMES.len() - 1;

    fn text(scratch: &TempDir, name: &str) -> String {
        fs::read_to_string(scratch.path().join(name)).unwrap()
    }

    fn names(scratch: &TempDir) -> Vec<String> {
        let entries = fs::read_dir(scratch.path()).unwrap();
        entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    fn run(scratch: &TempDir, force: bool, what: &str, accepted: bool) -> PathBuf {
        let folder = Folder::claim(scratch.path(), force).unwrap();
        folder.keep(&kept(what)).unwrap();
        let files = [
            ("dcc.xml", what),
            ("report.json", what),
            ("report.html", what),
        ];
        folder.write(&files, accepted).unwrap()
    }

    #[test]
    fn an_earlier_report_was_replaced_without_a_word() {
        let scratch = tempfile::tempdir().unwrap();
        run(&scratch, false, "first", true);
        let told = Folder::claim(scratch.path(), false)
            .unwrap_err()
            .to_string();
        assert!(told.contains("as-found.json is there already"), "{told}");
        assert!(told.contains("--out") && told.contains("--force"), "{told}");
        for name in NAMES {
            let alone = tempfile::tempdir().unwrap();
            fs::create_dir_all(alone.path()).unwrap();
            fs::write(alone.path().join(name), "").unwrap();
            assert!(Folder::claim(alone.path(), false).is_err(), "{name}");
        }
        run(&scratch, true, "second", true);
        assert_eq!(text(&scratch, "dcc.xml"), "second");
        assert!(text(&scratch, AS_FOUND).contains("second"));
        assert_eq!(names(&scratch).len(), WRITTEN, "{:?}", names(&scratch));
    }

    #[test]
    fn a_rejected_run_replaced_what_an_accepted_one_had_written() {
        let scratch = tempfile::tempdir().unwrap();
        run(&scratch, false, "first", true);
        let beside = run(&scratch, true, "second", false);
        for name in NAMES.into_iter().filter(|name| *name != MEASURED) {
            assert!(text(&scratch, name).contains("first"), "{name}");
            let text = fs::read_to_string(beside.join(name)).unwrap();
            assert!(text.contains("second"), "{name}");
        }
        let name = beside.file_name().unwrap().to_string_lossy().into_owned();
        assert!(name.starts_with("not-accepted-2"), "{name}");
    }

    #[test]
    fn a_run_that_came_to_nothing_leaves_nothing() {
        let scratch = tempfile::tempdir().unwrap();
        let folder = Folder::claim(scratch.path(), false).unwrap();
        folder.keep(&kept("first")).unwrap();
        folder.forget();
        assert!(names(&scratch).is_empty(), "{:?}", names(&scratch));
        run(&scratch, false, "first", true);
        let folder = Folder::claim(scratch.path(), true).unwrap();
        folder.keep(&kept("second")).unwrap();
        folder.forget();
        assert_eq!(names(&scratch).len(), WRITTEN, "{:?}", names(&scratch));
        assert!(text(&scratch, AS_FOUND).contains("first"));
    }

    /// Where a report stood, --resume asked for --force, which goes without --resume; and what was
    /// accepted stayed in the folder of what is not.
    #[test]
    fn a_run_beside_a_report_could_not_be_resumed_into_its_place() {
        let scratch = tempfile::tempdir().unwrap();
        let out = scratch.path();
        let put = |place: &Path, name: &str| fs::write(place.join(name), "old").unwrap();
        put(out, REPORT);
        put(out, MEASURED);
        let refused = Folder::resume(out).unwrap_err().to_string();
        assert!(refused.contains("nothing to resume"), "{refused}");
        for (time, begun) in [("1", true), ("2", true), ("3", false)] {
            let own = out.join(format!("{NOT_ACCEPTED}{time}"));
            fs::create_dir(&own).unwrap();
            if begun {
                fs::write(own.join(MEASURED), time).unwrap();
                fs::write(own.join(AS_FOUND), time).unwrap();
            }
        }
        let newest = Folder::resume(out).unwrap();
        assert_eq!(newest.own(), out.join("not-accepted-2"));
        assert_eq!(Folder::resume(newest.own()).unwrap(), newest);
        let written = newest.write(&[(REPORT, "new")], true).unwrap();
        assert_eq!(written, out);
        assert_eq!(text(&scratch, REPORT), "new");
        assert_eq!(text(&scratch, MEASURED), "2");
        assert!(!newest.own().exists());
        // Elsewhere the folder is that of the run, whatever its name.
        let alone = Path::new("/nowhere/not-accepted-1");
        assert_eq!(Folder::resume(alone).unwrap().out(), alone);
    }
}
