//! What a file of the repository may be, and what may not stand in its text.
//!
//! In: every file git keeps. Out: a finding for a Rust file without its opening comment, a path
//! of somebody's machine, the host name of a package registry, a mark of unfinished work, a file
//! over 1 MiB, and for recordings or build output that belong outside the repository.

use super::Finding;
use super::tree::{File, Tree};

const LARGEST: u64 = 1 << 20;

/// Folders that are there on one machine only, with the homes of its users. Put together from
/// pieces, so that this file doesn't hold what it looks for.
pub const MACHINE_PATHS: [&str; 4] = [
    concat!("/wo", "rk/"),
    concat!("/ro", "ot/"),
    concat!("/ho", "me/"),
    concat!("/Us", "ers/"),
];

const REGISTRY_HOSTS: [&str; 7] = [
    concat!("crates", ".io"),
    concat!("pypi", ".org"),
    concat!("python", "hosted.org"),
    concat!("registry.", "npmjs"),
    concat!("static.", "rust-lang.org"),
    concat!("deb.", "debian.org"),
    concat!("archive.", "ubuntu.com"),
];

/// Marks of work left for later.
const UNFINISHED: [&str; 2] = [concat!("FIX", "ME"), concat!("<!-- ", "lead:")];

/// Kinds of file that are recordings or built, never written by hand.
const KEPT_OUT: [&str; 12] = [
    "csv", "gz", "zip", "bin", "elf", "hex", "o", "a", "so", "rlib", "rmeta", "profraw",
];

/// The shared recordings, which keep their own licences outside the repository.
const RECORDINGS: [&str; 2] = ["abb-robot", "mimu4444"];

/// Applies every rule to every file.
pub fn check(tree: &Tree) -> Vec<Finding> {
    let rules = [kind, size, opening, words];
    tree.files
        .iter()
        .flat_map(|file| rules.iter().flat_map(|rule| rule(file)))
        .collect()
}

fn kind(file: &File) -> Vec<Finding> {
    let name = file.path.rsplit('/').next().unwrap_or(&file.path);
    let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending);
    let folders = file
        .path
        .rsplit_once('/')
        .map_or("", |(folders, _)| folders);
    let recording = RECORDINGS
        .iter()
        .any(|recording| folders.contains(recording));
    let built = file.path.starts_with("target/") || file.path.starts_with("plumb-report/");
    if KEPT_OUT.contains(&ending) || recording || built {
        let text = "recordings and build output stay outside the repository";
        return vec![Finding::new(&file.path, 0, text)];
    }
    Vec::new()
}

fn size(file: &File) -> Vec<Finding> {
    if file.size <= LARGEST {
        return Vec::new();
    }
    vec![Finding::new(
        &file.path,
        0,
        format!("{} bytes; the limit is {LARGEST}", file.size),
    )]
}

fn opening(file: &File) -> Vec<Finding> {
    let opens = |text: &String| text.starts_with("//!");
    if !file.path.ends_with(".rs") || file.text.as_ref().is_some_and(opens) {
        return Vec::new();
    }
    vec![Finding::new(
        &file.path,
        1,
        "a Rust file opens with `//!` and states what it is for",
    )]
}

fn words(file: &File) -> Vec<Finding> {
    let mut findings = Vec::new();
    let lock = file.path.ends_with("Cargo.lock");
    for (line, number) in file.text.iter().flat_map(|text| text.lines()).zip(1..) {
        let mut add = |text: String| findings.push(Finding::new(&file.path, number, text));
        for path in MACHINE_PATHS.iter().filter(|path| holds_path(line, path)) {
            add(format!("`{path}` is a path of one machine"));
        }
        for host in REGISTRY_HOSTS
            .iter()
            .filter(|host| !lock && line.contains(**host))
        {
            add(format!(
                "`{host}`: registries are named in the lock file only"
            ));
        }
        for mark in UNFINISHED.iter().filter(|mark| line.contains(**mark)) {
            add(format!(
                "`{mark}`: finish it, or say in a sentence what is missing"
            ));
        }
    }
    findings
}

/// Whether the path stands at the start of a path, not in the middle of a longer one.
fn holds_path(line: &str, path: &str) -> bool {
    line.match_indices(path).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        !before.is_some_and(|c| c.is_alphanumeric() || matches!(c, '.' | '_' | '-' | '/'))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings(path: &str, text: &str) -> Vec<String> {
        check(&Tree::of(&[(path, text)]))
            .iter()
            .map(ToString::to_string)
            .collect()
    }

    #[test]
    fn a_rust_file_opens_with_its_comment() {
        assert!(findings("sim/src/x.rs", "//! What it is.\n").is_empty());
        assert_eq!(findings("sim/src/x.rs", "use a::b;\n").len(), 1);
        assert_eq!(findings("sim/src/x.rs", "").len(), 1);
    }

    #[test]
    fn machine_paths_are_found_wherever_they_start() {
        for path in MACHINE_PATHS {
            assert_eq!(
                findings("docs/x.md", &format!("see {path}main")).len(),
                1,
                "{path}"
            );
            assert_eq!(
                findings("docs/x.md", &format!("a/b{path}main")).len(),
                0,
                "{path}"
            );
        }
    }

    #[test]
    fn registries_are_named_in_the_lock_file_only() {
        for host in REGISTRY_HOSTS {
            assert_eq!(
                findings("README.md", &format!("https://{host}/x")).len(),
                1,
                "{host}"
            );
            assert_eq!(
                findings("Cargo.lock", &format!("https://{host}/x")).len(),
                0,
                "{host}"
            );
        }
    }

    #[test]
    fn marks_of_unfinished_work_are_found_with_their_line() {
        for mark in UNFINISHED {
            let found = findings("docs/x.md", &format!("one\ntwo {mark}\n"));
            assert!(found[0].starts_with("docs/x.md:2:"), "{found:?}");
        }
    }

    #[test]
    fn recordings_and_build_output_are_kept_out() {
        for path in [
            "cli/tests/data/abb-robot/x.txt",
            "a.csv",
            "x.csv.gz",
            "target/x",
        ] {
            assert_eq!(findings(path, "").len(), 1, "{path}");
        }
        assert!(findings("cli/tests/mimu4444.rs", "//! x").is_empty());
    }

    #[test]
    fn a_file_over_one_mebibyte_is_found() {
        let mebibyte = "x".repeat(1 << 20);
        assert!(findings("docs/x.svg", &mebibyte).is_empty());
        assert_eq!(findings("docs/x.svg", &format!("{mebibyte}x")).len(), 1);
    }
}
