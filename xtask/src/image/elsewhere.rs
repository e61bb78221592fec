//! The images of another checkout, on the machine of somebody else as far as one can have that.
//!
//! In: the workspace, and the folder with its images. Out: an error that names an image which is
//! another one there. The sources are copied into another folder, and cargo builds there with
//! another target folder and another home, in which the sources of foreign crates have other paths.
//! What was built there before is used again, so only the first time takes a minute.
//!
//! Left out: another machine, and another release of the compiler.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{env, fs, io};

use super::{ImageError, OURS, build_into, is_ours};
use crate::workspace::Workspace;

/// Copies what cargo needs; a file that is the same already keeps its time, by which cargo goes.
fn copy(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let (path, name) = entry.map(|entry| (entry.path(), entry.file_name()))?;
        let is_hidden = name.to_string_lossy().starts_with('.') && name != ".cargo";
        if is_hidden || name == "target" {
            continue;
        }
        let copied = to.join(name);
        if path.is_dir() {
            copy(&path, &copied)?;
        } else {
            let bytes = fs::read(&path)?;
            if !fs::read(&copied).is_ok_and(|old| old == bytes) {
                fs::write(&copied, bytes)?;
            }
        }
    }
    remove_what_is_gone(from, to)
}

/// What was copied before and is no longer there: cargo would take a file of tests for one more.
fn remove_what_is_gone(from: &Path, to: &Path) -> io::Result<()> {
    for entry in fs::read_dir(to)? {
        let (path, name) = entry.map(|entry| (entry.path(), entry.file_name()))?;
        match from.join(name) {
            there if there.exists() => {}
            _ if path.is_dir() => fs::remove_dir_all(path)?,
            _ => fs::remove_file(path)?,
        }
    }
    Ok(())
}

/// A home of cargo in `folder` that has the crates of the real one.
fn home(folder: &Path) -> io::Result<()> {
    let user = env::home_dir().unwrap_or_default();
    let real = env::var_os("CARGO_HOME").map_or_else(|| user.join(".cargo"), PathBuf::from);
    fs::create_dir_all(folder)?;
    for name in ["registry", "git", "config.toml"] {
        let (real, link) = (real.join(name), folder.join(name));
        if real.exists() && !link.exists() {
            std::os::unix::fs::symlink(real, link)?;
        }
    }
    Ok(())
}

/// The files of ours in a folder by their names.
fn files(folder: &Path) -> io::Result<BTreeMap<String, Vec<u8>>> {
    let file = |entry: io::Result<fs::DirEntry>| {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        Ok((name, fs::read(entry.path())?))
    };
    let files: BTreeMap<_, _> = fs::read_dir(folder)?.map(file).collect::<io::Result<_>>()?;
    Ok(files
        .into_iter()
        .filter(|(name, _)| is_ours(name))
        .collect())
}

/// Builds the images of a copy of this checkout in another folder, and compares them with those in
/// `ours`.
///
/// Errors: [`ImageError::Differ`] names what is not the same; those of a build.
pub fn compare(here: &Workspace, ours: &Path) -> Result<(), ImageError> {
    let folder = here.target().join("elsewhere");
    let (root, cargo) = (folder.join("a/checkout"), folder.join("home/of/cargo"));
    let copied = copy(here.root(), &root).and_then(|()| home(&cargo));
    copied.map_err(|error| ImageError::File(folder.clone(), error))?;
    let there = Workspace::elsewhere(root, folder.join("built"), cargo);
    let theirs = folder.join("theirs");
    build_into(&there, theirs.clone())?;
    let files = |folder: &Path| {
        files(folder).map_err(|error| ImageError::File(folder.to_path_buf(), error))
    };
    // Where nothing is built, nothing differs.
    let linked = OURS.iter().filter(|name| !name.starts_with('.'));
    let linked = linked.map(|name| (*name).to_owned());
    match differing(linked, &files(ours)?, &files(&theirs)?) {
        names if names.is_empty() => Ok(()),
        names => Err(ImageError::Differ(names)),
    }
}

/// The names of the files that are not the same in both, and of those in `wanted` that are in
/// neither.
fn differing<T: PartialEq>(
    wanted: impl Iterator<Item = String>,
    ours: &BTreeMap<String, T>,
    theirs: &BTreeMap<String, T>,
) -> Vec<String> {
    let found = ours.keys().chain(theirs.keys()).cloned();
    let names: BTreeSet<_> = found.chain(wanted).collect();
    let same = |name: &String| match ours.get(name) {
        Some(file) => theirs.get(name) == Some(file),
        None => false,
    };
    names.into_iter().filter(|name| !same(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace::remove_folder;

    #[test]
    fn an_image_that_differs_or_is_missing_is_named() {
        let of = |files: &[(&str, u8)]| -> BTreeMap<_, _> {
            let files = files.iter().map(|(name, byte)| (name.to_string(), *byte));
            files.collect()
        };
        let ours = of(&[("a", 1), ("b", 2), ("c", 3)]);
        let theirs = of(&[("a", 1), ("b", 7), ("d", 3)]);
        let wanted = |name: &str| [name.to_owned()].into_iter();
        assert!(differing(wanted("a"), &ours, &ours).is_empty());
        assert_eq!(differing(wanted("a"), &ours, &theirs), ["b", "c", "d"]);
        assert_eq!(differing(wanted("e"), &ours, &ours), ["e"]);
    }

    #[test]
    fn a_file_that_was_moved_stayed_in_the_copy_and_no_image_was_built() {
        let folder = Workspace::locate().target().join("moved");
        remove_folder(&folder).expect("a folder that goes");
        let (from, to) = (folder.join("from"), folder.join("to"));
        fs::create_dir_all(from.join("tests")).expect("a folder");
        fs::write(from.join("tests/pair.rs"), "old").expect("a file");
        copy(&from, &to).expect("a copy");
        fs::remove_file(from.join("tests/pair.rs")).expect("a file that goes");
        fs::create_dir_all(from.join("tests/pair")).expect("a folder");
        fs::write(from.join("tests/pair/main.rs"), "new").expect("a file");
        copy(&from, &to).expect("a copy");
        assert!(to.join("tests/pair/main.rs").exists());
        assert!(!to.join("tests/pair.rs").exists());
    }
}
