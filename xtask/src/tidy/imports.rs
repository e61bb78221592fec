//! Who may depend on whom, and what a manifest may contain.
//!
//! In: the `Cargo.toml` of each crate. Out: a finding for a dependency that the table below
//! doesn't allow (development dependencies are held to the same table where the crate is ours),
//! for a `[features]` section, and for a crate that opts out of the workspace's lints. The
//! leaves also list the foreign crates they may use, since those run on the part.

use super::Finding;
use super::tree::Tree;

/// What one crate may use.
struct Rule {
    /// The folder of the crate.
    folder: &'static str,
    /// Our own crates it may use, by package name.
    ours: &'static [&'static str],
    /// The foreign crates it may use; `None` leaves the choice to its author.
    foreign: Option<&'static [&'static str]>,
}

/// The table of ARCHITECTURE.md. A new crate needs a row here.
const RULES: [Rule; 26] = [
    rule("instant", &[], Some(&[])),
    rule(
        "tilt",
        &["instant"],
        Some(&["idsp", "dsp-fixedpoint", "dsp-process", "heapless"]),
    ),
    rule("canopen", &["instant"], Some(&["embedded-can", "heapless"])),
    rule("flash", &[], Some(&["embedded-storage"])),
    rule(
        "device",
        &["instant", "tilt", "canopen", "flash"],
        Some(&[
            "embedded-hal",
            "embedded-storage",
            "heapless",
            "ed25519-compact",
        ]),
    ),
    rule(
        "firmware",
        &["instant", "device", "flash", "tilt", "canopen"],
        None,
    ),
    rule(
        "firmware/bus_footprint",
        &["instant", "canopen", "device", "flash", "tilt"],
        Some(&[]),
    ),
    rule(
        "sim",
        &["instant", "device", "tilt", "canopen", "flash"],
        None,
    ),
    // Its bus server is the one of `plumb serve`; its tests run the image's code on the host too.
    rule(
        "emulator",
        &[
            "instant",
            "sim",
            "canopen",
            "device",
            "firmware",
            "flash",
            "tilt",
            "virtual-bus",
        ],
        None,
    ),
    rule("emulator/fixture", &["flash"], None),
    rule("emulator/golden", &["instant", "tilt", "flash"], None),
    rule(
        "emulator/lockstep",
        &["emulator", "canopen", "flash", "sim"],
        None,
    ),
    rule("pc/output", &[], None),
    rule("pc/can-text", &["canopen"], None),
    rule("pc/codes", &["canopen", "device", "output", "tilt"], None),
    rule("pc/bus-logs", &["canopen", "output"], None),
    rule("pc/listen", &["canopen", "device", "output"], None),
    rule(
        "pc/bus-master",
        &["canopen", "device", "can-text", "codes", "output"],
        None,
    ),
    rule(
        "pc/virtual-bus",
        &[
            "instant", "tilt", "canopen", "flash", "device", "sim", "can-text", "codes", "output",
        ],
        None,
    ),
    rule(
        "pc/bench",
        &["instant", "tilt", "sim", "codes", "bus-logs", "output"],
        None,
    ),
    rule(
        "pc/calibrate",
        &["tilt", "canopen", "device", "sim", "bus-master", "output"],
        None,
    ),
    // Of the world it takes the length of a frame on the wires, and its tests a bus.
    rule(
        "pc/bus-report",
        &[
            "instant",
            "canopen",
            "device",
            "sim",
            "codes",
            "bus-logs",
            "bus-master",
            "listen",
            "output",
        ],
        None,
    ),
    rule(
        "pc/monitor",
        &[
            "tilt",
            "canopen",
            "device",
            "sim",
            "codes",
            "bus-logs",
            "bus-master",
            "listen",
            "output",
        ],
        None,
    ),
    // What runs on the chip, and the model of its memory, for the files of programs.
    rule(
        "cli",
        &[
            "canopen",
            "device",
            "flash",
            "sim",
            "bench",
            "bus-logs",
            "bus-master",
            "bus-report",
            "calibrate",
            "codes",
            "monitor",
            "output",
            "virtual-bus",
        ],
        None,
    ),
    rule(
        "python",
        &[
            "instant",
            "tilt",
            "canopen",
            "device",
            "sim",
            "bench",
            "bus-report",
            "codes",
            "listen",
            "virtual-bus",
        ],
        None,
    ),
    rule("xtask", &["flash"], None),
];

/// The workspace forbids `unsafe`; these need it, and have lints of their own that ask for a
/// reason each time.
pub const UNSAFE: [&str; 4] = [
    "firmware",
    "emulator/fixture",
    "emulator/golden",
    "emulator/lockstep",
];

const fn rule(
    folder: &'static str,
    ours: &'static [&'static str],
    foreign: Option<&'static [&'static str]>,
) -> Rule {
    Rule {
        folder,
        ours,
        foreign,
    }
}

/// Reads every manifest but the workspace's own.
pub fn check(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for file in &tree.files {
        let (Some(text), Some(folder)) = (&file.text, file.path.strip_suffix("Cargo.toml")) else {
            continue;
        };
        let entries = entries(text);
        findings.extend(features(&file.path, &entries));
        let folder = folder.trim_end_matches('/');
        if !folder.is_empty() {
            findings.extend(manifest(&file.path, folder, &entries));
        }
    }
    findings
}

/// A line of a manifest: its number, the section it is in, the key it sets.
struct Entry<'a> {
    line: usize,
    section: &'a str,
    key: &'a str,
}

fn entries(text: &str) -> Vec<Entry<'_>> {
    let mut section = "";
    let mut entries = Vec::new();
    for (line, number) in text.lines().map(str::trim).zip(1..) {
        if let Some(header) = line.strip_prefix('[') {
            section = header
                .trim_end_matches(|c| c != ']')
                .trim_matches(|c| c == '[' || c == ']');
            entries.push(Entry {
                line: number,
                section,
                key: "",
            });
        } else if let Some((key, _)) = line.split_once('=').filter(|_| !line.starts_with('#')) {
            entries.push(Entry {
                line: number,
                section,
                key: key.trim(),
            });
        }
    }
    entries
}

fn features(path: &str, entries: &[Entry]) -> Vec<Finding> {
    let headers = entries
        .iter()
        .filter(|entry| entry.section == "features" && entry.key.is_empty());
    headers
        .map(|entry| {
            let text = "no [features]: there is one program; use a parameter or another crate";
            Finding::new(path, entry.line, text)
        })
        .collect()
}

fn manifest(path: &str, folder: &str, entries: &[Entry]) -> Vec<Finding> {
    let Some(rule) = RULES.iter().find(|rule| rule.folder == folder) else {
        let text = format!("`{folder}` has no row in the table of xtask/src/tidy/imports.rs");
        return vec![Finding::new(path, 0, text)];
    };
    let mut findings = Vec::new();
    for entry in entries {
        let Some((name, development)) = dependency(entry) else {
            continue;
        };
        if !allowed(rule, name, development) {
            let text = format!("`{folder}` may not depend on `{name}`");
            findings.push(Finding::new(path, entry.line, text));
        }
    }
    let (section, key, missing) = if UNSAFE.contains(&folder) {
        let text = "`undocumented_unsafe_blocks` of `[lints.clippy]` is missing";
        ("lints.clippy", "undocumented_unsafe_blocks", text)
    } else {
        let text = "`[lints] workspace = true` is missing";
        ("lints", "workspace", text)
    };
    let keeps_lints = |entry: &Entry| entry.section == section && entry.key == key;
    if !entries.iter().any(keeps_lints) {
        findings.push(Finding::new(path, 0, missing));
    }
    findings
}

/// The crate a line asks for, and whether only for development. Reads `name = ...`,
/// `name.workspace = true` and a section of its own such as `[dependencies.name]`.
fn dependency<'a>(entry: &Entry<'a>) -> Option<(&'a str, bool)> {
    let (kind, rest) = entry.section.split_once("dependencies")?;
    let development = kind.ends_with("dev-");
    match rest.strip_prefix('.') {
        Some(name) if entry.key.is_empty() => Some((name, development)),
        None if !entry.key.is_empty() => {
            let name = entry.key.split('.').next().unwrap_or(entry.key);
            Some((name.trim_matches('"'), development))
        }
        _ => None,
    }
}

/// True for a crate of the workspace; each has the name of its folder, but the program.
fn is_ours(name: &str) -> bool {
    let folders = RULES.iter().map(|rule| rule.folder);
    name == "plumb"
        || folders
            .filter_map(|f| f.rsplit('/').next())
            .any(|f| f == name)
}

fn allowed(rule: &Rule, name: &str, development: bool) -> bool {
    if is_ours(name) {
        return rule.ours.contains(&name);
    }
    development || rule.foreign.is_none_or(|foreign| foreign.contains(&name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings(folder: &str, dependencies: &str) -> Vec<String> {
        let path = format!("{folder}/Cargo.toml");
        let text = format!("[package]\nname = \"x\"\n[lints]\nworkspace = true\n{dependencies}");
        let found = check(&Tree::of(&[(&path, &text)]));
        found.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_leaf_may_use_its_own_list_only() {
        assert!(findings("tilt", "[dependencies]\nidsp.workspace = true\n").is_empty());
        let found = findings("tilt", "[dependencies]\nserde = { version = \"1\" }\n");
        assert_eq!(
            found,
            vec!["tilt/Cargo.toml:6: `tilt` may not depend on `serde`"]
        );
        assert_eq!(
            findings("tilt", "[dependencies.device]\npath = \"../device\"\n").len(),
            1
        );
        assert_eq!(
            findings("tilt", "[target.'cfg(unix)'.dependencies]\nlibc = \"1\"\n").len(),
            1
        );
    }

    #[test]
    fn nothing_depends_upwards_not_even_for_tests() {
        assert_eq!(
            findings("device", "[dev-dependencies]\nsim.workspace = true\n").len(),
            1
        );
        assert_eq!(
            findings("sim", "[dependencies]\nplumb.workspace = true\n").len(),
            1
        );
        assert_eq!(
            findings("cli", "[dependencies]\nxtask = { path = \"../xtask\" }\n").len(),
            1
        );
    }

    #[test]
    fn tests_may_bring_foreign_crates() {
        assert!(findings("tilt", "[dev-dependencies]\nproptest.workspace = true\n").is_empty());
    }

    #[test]
    fn features_and_unknown_crates_are_found() {
        assert_eq!(findings("sim", "[features]\nfast = []\n").len(), 1);
        assert_eq!(findings("utils", "").len(), 1);
    }

    #[test]
    fn every_crate_keeps_the_lints() {
        let found = check(&Tree::of(&[(
            "sim/Cargo.toml",
            "[package]\nname = \"sim\"\n",
        )]));
        assert_eq!(found.len(), 1);
        let own = "[package]\nname = \"firmware\"\n[lints.clippy]\n";
        let reasons = format!("{own}undocumented_unsafe_blocks = \"deny\"\n");
        assert_eq!(check(&Tree::of(&[("firmware/Cargo.toml", own)])).len(), 1);
        assert!(check(&Tree::of(&[("firmware/Cargo.toml", &reasons)])).is_empty());
    }

    #[test]
    fn comments_and_other_sections_are_no_dependencies() {
        assert!(findings("tilt", "[dependencies]\n# serde = \"1\"\n").is_empty());
        assert!(findings("tilt", "[[bench]]\nname = \"chain\"\n").is_empty());
    }
}
