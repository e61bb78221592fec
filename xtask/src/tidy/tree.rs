//! The files the rules look at: everything git keeps or would keep.
//!
//! In: the root of the checkout. Out: each file with its size and, where it is text, its text.
//! Files that git ignores are left out. Where git can't answer (an unpacked archive, a checkout
//! owned by somebody else) the folders are walked instead, without those that builds make.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;
use std::{fs, io};

use super::source::Source;

/// What the walk leaves out; git reads `.gitignore` itself.
const NOT_WALKED: [&str; 4] = [".git", ".venv", "target", "plumb-report"];

/// One file.
pub struct File {
    /// From the root, with `/`.
    pub path: String,
    /// In bytes.
    pub size: u64,
    /// Its text, unless it holds something else.
    pub text: Option<String>,
}

/// All files, and the Rust ones scanned.
pub struct Tree {
    /// Sorted by path.
    pub files: Vec<File>,
    /// The Rust files among them.
    pub sources: Vec<Source>,
    /// Rust files, and folders of them, that are compiled for tests only.
    test_only: BTreeSet<String>,
}

impl Tree {
    /// Reads the checkout.
    pub fn load(root: &Path) -> io::Result<Self> {
        let mut files = Vec::new();
        for path in listed_by_git(root).map_or_else(|| walked(root), Ok)? {
            if let Some(file) = read(root, path)? {
                files.push(file);
            }
        }
        Ok(Self::new(files))
    }

    fn new(mut files: Vec<File>) -> Self {
        files.sort_by(|one, other| one.path.cmp(&other.path));
        let rust = files.iter().filter(|file| file.path.ends_with(".rs"));
        let sources: Vec<Source> = rust
            .filter_map(|file| Some(Source::new(&file.path, file.text.as_deref()?)))
            .collect();
        let test_only = sources.iter().flat_map(test_module_paths).collect();
        Self {
            files,
            sources,
            test_only,
        }
    }

    /// A tree of the given paths and texts, for tests of the rules.
    #[cfg(test)]
    pub fn of(files: &[(&str, &str)]) -> Self {
        let file = |&(path, text): &(&str, &str)| File {
            path: path.to_string(),
            size: text.len() as u64,
            text: Some(text.to_string()),
        };
        Self::new(files.iter().map(file).collect())
    }

    /// The text of a file.
    pub fn text(&self, path: &str) -> Option<&str> {
        self.files
            .iter()
            .find(|file| file.path == path)?
            .text
            .as_deref()
    }

    /// Whether a file or a folder stands at this path.
    pub fn has(&self, path: &str) -> bool {
        let path = path.trim_end_matches('/');
        let inside = |file: &File| {
            file.path
                .strip_prefix(path)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        };
        path.is_empty() || self.files.iter().any(inside)
    }

    /// Whether a Rust file is compiled for tests, benches or examples only.
    pub fn is_test_file(&self, path: &str) -> bool {
        let beside_src = ["/tests/", "/benches/", "/examples/"];
        beside_src.iter().any(|folder| path.contains(folder))
            || self
                .test_only
                .iter()
                .any(|one| path.starts_with(one.as_str()))
    }

    /// The names of all `#[test]` functions.
    pub fn test_names(&self) -> BTreeSet<String> {
        let rust = self.sources.iter().flat_map(Source::test_names);
        let files = self.files.iter().filter(|file| is_python_test(&file.path));
        let texts = files.filter_map(|file| file.text.as_deref());
        rust.chain(texts.flat_map(python_tests)).collect()
    }
}

/// Whether pytest collects this file by itself.
fn is_python_test(path: &str) -> bool {
    let name = path.rsplit('/').next().unwrap_or(path);
    name.starts_with("test_") && name.ends_with(".py")
}

/// The names of the tests in a file of Python.
fn python_tests(text: &str) -> impl Iterator<Item = String> {
    let functions = text.lines().filter_map(|line| line.strip_prefix("def "));
    let names = functions.filter_map(|rest| rest.split_once('(').map(|(name, _)| name));
    names
        .filter(|name| name.starts_with("test_"))
        .map(str::to_owned)
}

/// The places where the test modules that a file declares may live.
fn test_module_paths(source: &Source) -> Vec<String> {
    let (folder, file) = source.path.rsplit_once('/').unwrap_or(("", &source.path));
    let stem = file.trim_end_matches(".rs");
    let home = match stem {
        "lib" | "main" | "mod" => folder.to_string(),
        _ => format!("{folder}/{stem}"),
    };
    let modules = source.test_modules().into_iter();
    let by_name = modules.flat_map(|name| [format!("{home}/{name}.rs"), format!("{home}/{name}/")]);
    let by_path = source.test_files().into_iter();
    by_name
        .chain(by_path.map(|file| format!("{folder}/{file}")))
        .collect()
}

/// `None` when the file went away meanwhile, or is a folder of another repository.
fn read(root: &Path, path: String) -> io::Result<Option<File>> {
    let bytes = match fs::read(root.join(&path)) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) if error.kind() == io::ErrorKind::IsADirectory => return Ok(None),
        Err(error) => return Err(error),
    };
    let size = bytes.len() as u64;
    let text = String::from_utf8(bytes)
        .ok()
        .filter(|text| !text.contains('\0'));
    Ok(Some(File { path, size, text }))
}

fn listed_by_git(root: &Path) -> Option<Vec<String>> {
    let mut git = Command::new("git");
    git.args([
        "ls-files",
        "-z",
        "--cached",
        "--others",
        "--exclude-standard",
    ]);
    let output = git.current_dir(root).output().ok()?;
    let list = String::from_utf8_lossy(&output.stdout).into_owned();
    let paths = list
        .split('\0')
        .filter(|path| !path.is_empty())
        .map(str::to_string);
    (output.status.success() && !list.is_empty()).then(|| paths.collect())
}

fn walked(root: &Path) -> io::Result<Vec<String>> {
    let mut paths = Vec::new();
    let mut folders = vec![String::new()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(root.join(&folder))? {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let path = format!("{folder}{name}");
            if NOT_WALKED.contains(&path.as_str()) {
                continue;
            }
            if entry.file_type()?.is_dir() {
                folders.push(format!("{path}/"));
            } else {
                paths.push(path);
            }
        }
    }
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace::Workspace;

    #[test]
    fn tests_in_python_have_names_where_pytest_collects_them() {
        let code = "def test_one(\n    x: int,\n) -> None:\ndef helper():\n  def test_in():\n";
        let tree = Tree::of(&[
            ("python/tests/test_x.py", code),
            ("python/tests/y.py", code),
        ]);
        assert_eq!(
            tree.test_names().into_iter().collect::<Vec<_>>(),
            ["test_one"]
        );
        assert!(
            Tree::of(&[("python/tests/y.py", code)])
                .test_names()
                .is_empty()
        );
    }

    #[test]
    fn a_walk_finds_this_file_and_no_build_output() {
        let found = walked(Workspace::locate().root()).expect("a readable checkout");
        assert!(found.iter().any(|path| path == "xtask/src/tidy/tree.rs"));
        assert!(
            !found
                .iter()
                .any(|path| path.starts_with("target/") || path.starts_with(".git/"))
        );
    }

    #[test]
    fn folders_count_as_present() {
        let tree = Tree::of(&[("tilt/src/lib.rs", "")]);
        assert!(tree.has("tilt/src/lib.rs") && tree.has("tilt/") && tree.has("tilt/src"));
        assert!(!tree.has("til") && !tree.has("tilt/src/chain.rs"));
    }

    #[test]
    fn test_only_files_are_known_by_their_declaration() {
        let declares = "#[cfg(test)]\nmod tests;\n";
        let tree = Tree::of(&[
            ("tilt/src/chain.rs", declares),
            ("sim/src/lib.rs", declares),
        ]);
        assert!(tree.is_test_file("tilt/src/chain/tests.rs"));
        assert!(tree.is_test_file("sim/src/tests/supply.rs"));
        assert!(tree.is_test_file("tilt/benches/chain.rs"));
        assert!(!tree.is_test_file("tilt/src/tests.rs"));
    }
}
