//! Packages of the distribution: CMake and the library of clang that reads C headers, with which
//! the core is built that the emulator's own is held to, and a browser for the tests of
//! `plumb monitor --web`.
//!
//! In: the workspace. Out: they are there, or one sentence with the line to type. They are
//! installed where that needs no question answered: as root, or through `sudo` without a
//! password, with Debian's tools. Without the browser its tests are skipped and print that.
//!
//! Left out: other package managers, whose users get the names in the sentence.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};

use crate::command::{self, CommandError};
use crate::workspace::Workspace;

/// What Debian and its relatives call them.
const NAMES: [&str; 2] = ["cmake", "libclang-dev"];

/// The browser, and the program by which a test drives it.
const BROWSER: [&str; 2] = ["chromium", "chromium-driver"];

/// Folders in which a distribution keeps the library; `*` is any one name.
const FOLDERS: [&str; 7] = [
    "/usr/lib/llvm-*/lib",
    "/usr/lib/*-linux-gnu",
    "/usr/lib64/llvm*/lib",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/opt/homebrew/opt/llvm/lib",
];

/// The line for somebody who has to do it by hand.
pub const TYPED: &str = "sudo apt-get install -y cmake libclang-dev";

/// The same for the browser.
pub const TYPED_BROWSER: &str = "sudo apt-get install -y chromium chromium-driver";

/// Sees to it that the packages are there; false when they could not be installed.
///
/// Errors: none of its own; what apt-get prints goes through.
pub fn provide(workspace: &Workspace) -> bool {
    if present(workspace) {
        return true;
    }
    println!("      installing {}", NAMES.join(" and "));
    let installed = install(workspace, NAMES).is_ok();
    installed && present(workspace)
}

/// Sees to it that there is a browser; false when it could not be installed.
pub fn provide_browser(workspace: &Workspace) -> bool {
    let present = || {
        let runs = |name| command::succeeds(workspace.program(name, &["--version"]));
        runs("chromium") && runs("chromedriver")
    };
    if present() {
        return true;
    }
    println!("      installing {}", BROWSER.join(" and "));
    install(workspace, BROWSER).is_ok() && present()
}

fn present(workspace: &Workspace) -> bool {
    command::succeeds(workspace.program("cmake", &["--version"])) && has_library()
}

/// Whether one of the folders has the library, by any of its names.
fn has_library() -> bool {
    let told = env::var_os("LIBCLANG_PATH").map(PathBuf::from);
    let folders = FOLDERS.iter().flat_map(|pattern| matching(pattern));
    told.into_iter().chain(folders).any(|folder| holds(&folder))
}

fn holds(folder: &Path) -> bool {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .any(|name| is_library(&name))
}

/// `libclang.so`, `libclang-14.so.1` and so on, but not the C++ library beside it.
fn is_library(name: &str) -> bool {
    let shared = name.contains(".so") || name.ends_with(".dylib");
    let rest = name.strip_prefix("libclang");
    let version = rest.and_then(|rest| rest.strip_prefix('-'));
    shared
        && (rest.is_some_and(|rest| rest.starts_with('.'))
            || version.is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit())))
}

/// The folders that a pattern with at most one `*` stands for.
fn matching(pattern: &str) -> Vec<PathBuf> {
    let Some((before, after)) = pattern.split_once('*') else {
        return vec![PathBuf::from(pattern)];
    };
    let (parent, start) = before.rsplit_once('/').unwrap_or(("", before));
    let (end, below) = after.split_once('/').unwrap_or((after, ""));
    let entries = fs::read_dir(parent).into_iter().flatten().flatten();
    entries
        .filter(|entry| {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            name.len() >= start.len() + end.len() && name.starts_with(start) && name.ends_with(end)
        })
        .map(|entry| entry.path().join(below))
        .collect()
}

fn install(workspace: &Workspace, names: [&str; 2]) -> Result<(), CommandError> {
    // A machine that has never asked has no list of packages; an old list is better than none.
    let _ = apt(workspace, &["update", "-qq"]);
    let mut words = vec!["install", "-y", "-qq", "--no-install-recommends"];
    words.extend(names);
    apt(workspace, &words)
}

fn apt(workspace: &Workspace, words: &[&str]) -> Result<(), CommandError> {
    let root = command::capture(workspace.program("id", &["-u"])).is_ok_and(|id| id.trim() == "0");
    let mut all = vec!["-n", "apt-get"];
    all.extend(words);
    let mut command = if root {
        workspace.program("apt-get", words)
    } else {
        workspace.program("sudo", &all)
    };
    command.env("DEBIAN_FRONTEND", "noninteractive");
    command::pass(command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_is_told_from_its_neighbours() {
        for name in [
            "libclang.so",
            "libclang-14.so.1",
            "libclang.so.1",
            "libclang.dylib",
        ] {
            assert!(is_library(name), "{name}");
        }
        let others = [
            "libclang-cpp.so.14",
            "libclangAST.a",
            "libclang.a",
            "clang",
            "libclang",
        ];
        for name in others {
            assert!(!is_library(name), "{name}");
        }
    }

    #[test]
    fn the_line_to_type_names_every_package() {
        assert!(NAMES.iter().all(|name| TYPED.contains(name)));
        assert!(BROWSER.iter().all(|name| TYPED_BROWSER.contains(name)));
    }

    #[test]
    fn a_pattern_stands_for_the_folders_that_are_there() {
        let root = env!("CARGO_MANIFEST_DIR");
        let found = matching(&format!("{root}/s*c/tidy"));
        assert_eq!(found, [Path::new(root).join("src/tidy")]);
        assert!(matching(&format!("{root}/no*/x")).is_empty());
        assert_eq!(matching("/usr/lib"), [Path::new("/usr/lib")]);
    }
}
