//! The images of another checkout, on the machine of somebody else as far as one can have that.
//!
//! The sources are copied into another folder, and cargo builds there with another target folder
//! and another home, in which the sources of foreign crates have other paths. What was built there
//! before is used again, so only the first time takes a minute.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

use super::build_into;
use crate::workspace::{Workspace, remove_folder};

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

/// The files in a folder by their names.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).expect("the folder of the images");
    let paths = entries.map(|entry| entry.expect("an entry").path());
    let file = |path: PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        (name.into_owned(), fs::read(&path).expect("an image"))
    };
    paths.map(file).collect()
}

#[test]
fn two_checkouts_in_different_folders_give_the_same_images() {
    let here = Workspace::locate();
    let folder = here.target().join("elsewhere");
    let (root, cargo) = (folder.join("a/checkout"), folder.join("home/of/cargo"));
    copy(here.root(), &root).expect("a copy of the sources");
    home(&cargo).expect("a home for cargo");
    let there = Workspace::elsewhere(root, folder.join("built"), cargo);
    let built = |workspace: &Workspace, name: &str| {
        let images = folder.join(name);
        build_into(workspace, images.clone()).expect("images within their budgets");
        files(&images)
    };
    let (ours, theirs) = (built(&here, "ours"), built(&there, "theirs"));
    assert!(ours.len() >= 7, "{:?}", ours.keys());
    assert!(ours.keys().eq(theirs.keys()), "{:?}", theirs.keys());
    for (name, bytes) in &ours {
        // Bytes of a hundred kilobytes tell nobody anything.
        assert!(theirs[name] == *bytes, "{name} depends on the folder");
    }
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
