//! Cargo's commands for the part, the same bytes from every folder.
//!
//! In: the workspace, a package. Out: the one command that builds it for the part, as `image` and
//! `size` use it, and where the result is.
//!
//! The compiler writes the paths of sources into a program, for the places of panics. So every
//! folder of this machine that sources lie in is mapped to a name that is the same on all
//! machines: the checkout and what is generated below it, the sources of foreign crates and those
//! of the compiler's library. These are the only flags: flags of the environment or of cargo's
//! configuration would make another image, and are not taken.
//!
//! Left out: settings of cargo's profiles in the environment or in the user's configuration.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use flash::layout::Slot;
use serde_json::Value;

use crate::command::{self, CommandError};
use crate::workspace::Workspace;

/// The part's target: a Cortex-M3 without an operating system.
pub const TARGET: &str = "thumbv7m-none-eabi";
/// The profile of the workspace that the firmware is built with.
const PROFILE: &str = "footprint";
/// The file in the target folder that is locked by who builds programs of the part and reads them.
const LOCK: &str = "chip.lock";
/// What stands between two flags for the compiler (cargo, `CARGO_ENCODED_RUSTFLAGS`).
const BETWEEN: &str = "\u{1f}";

/// Builds these programs of the firmware, the application for `slot`; the results are in
/// [`folder`].
pub fn firmware(workspace: &Workspace, programs: &[&str], slot: Slot) -> Result<(), CommandError> {
    let mut cargo = cargo(workspace, "build", &["firmware"])?;
    let wanted = programs.iter().flat_map(|program| ["--bin", program]);
    cargo.args(wanted);
    cargo.env("PLUMB_SLOT", letter(slot).to_uppercase().to_string());
    command::pass(cargo)
}

/// The slot's letter.
pub const fn letter(slot: Slot) -> char {
    match slot {
        Slot::A => 'a',
        Slot::B => 'b',
    }
}

/// Cargo's command `verb`, `build` or `rustc`, for packages of the part.
///
/// Errors: the folders of the sources cannot be found out.
pub fn cargo(
    workspace: &Workspace,
    verb: &str,
    packages: &[&str],
) -> Result<Command, CommandError> {
    let mut cargo = workspace.cargo(&[verb, "--quiet", "--locked"]);
    cargo.args(packages.iter().flat_map(|package| ["--package", package]));
    cargo.args(["--target", TARGET, "--profile", PROFILE]);
    cargo.env_remove("RUSTFLAGS");
    cargo.env("CARGO_ENCODED_RUSTFLAGS", flags(workspace)?.join(BETWEEN));
    Ok(cargo)
}

/// Keeps others, in this process or another, from building for the part until it is dropped: they
/// would replace programs that are not read yet.
pub fn alone(workspace: &Workspace) -> Result<File, CommandError> {
    let failed = |error| CommandError::Output("building for the part".to_owned(), error);
    let target = workspace.target();
    let file = fs::create_dir_all(&target).and_then(|()| File::create(target.join(LOCK)));
    let file = file.map_err(failed)?;
    // It ends with the file.
    file.lock().map_err(failed)?;
    Ok(file)
}

/// Where cargo puts the programs.
pub fn folder(workspace: &Workspace) -> PathBuf {
    workspace.target().join(TARGET).join(PROFILE)
}

/// Flags for the compiler. Of two that fit it takes the later one.
fn flags(workspace: &Workspace) -> Result<Vec<String>, CommandError> {
    let (library, release) = library(workspace)?;
    let map = |from: &Path, to: &str| format!("--remap-path-prefix={}={to}", from.display());
    let mut flags = vec![map(&library, &format!("/rustc/{release}"))];
    flags.extend(registries(workspace)?.iter().map(|from| map(from, "")));
    flags.push(map(workspace.root(), ""));
    flags.push(map(&workspace.target(), "target"));
    Ok(flags)
}

/// Where the sources of the compiler's library are if they are installed, and the compiler's
/// commit, by which the library names them itself.
fn library(workspace: &Workspace) -> Result<(PathBuf, String), CommandError> {
    let root = command::capture(workspace.rustc(&["--print", "sysroot"]))?;
    let about = command::capture(workspace.rustc(&["--version", "--verbose"]))?;
    let mut lines = about.lines();
    let commit = lines.find_map(|line| line.strip_prefix("commit-hash: "));
    let sources = Path::new(root.trim()).join("lib/rustlib/src/rust");
    Ok((sources, commit.unwrap_or("unknown").to_owned()))
}

/// The folders in which the sources of foreign crates lie, each crate in a folder of its own: one
/// below cargo's home, or that of `cargo vendor`.
pub fn registries(workspace: &Workspace) -> Result<BTreeSet<PathBuf>, CommandError> {
    let words = ["metadata", "--quiet", "--locked", "--format-version", "1"];
    let mut cargo = workspace.cargo(&words);
    cargo.args(["--filter-platform", TARGET]);
    Ok(parents(&command::capture(cargo)?))
}

/// The folders above those of the foreign crates in what `cargo metadata` tells; ours have no
/// source.
fn parents(metadata: &str) -> BTreeSet<PathBuf> {
    let metadata: Value = serde_json::from_str(metadata).unwrap_or_default();
    let packages = metadata["packages"].as_array().into_iter().flatten();
    let foreign = packages.filter(|package| !package["source"].is_null());
    let manifests = foreign.filter_map(|package| package["manifest_path"].as_str());
    let parents = manifests.filter_map(|manifest| Path::new(manifest).ancestors().nth(2));
    parents.map(Path::to_path_buf).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_crates_lie_in_one_folder_and_ours_are_none() {
        let metadata = r#"{"packages": [
            {"source": "registry+x", "manifest_path": "/h/registry/src/i-1/crc-3.4.0/Cargo.toml"},
            {"source": "registry+x", "manifest_path": "/h/registry/src/i-1/idsp-0.23.1/Cargo.toml"},
            {"source": null, "manifest_path": "/checkout/tilt/Cargo.toml"}
        ]}"#;
        let found: Vec<_> = parents(metadata).into_iter().collect();
        assert_eq!(found, [PathBuf::from("/h/registry/src/i-1")]);
        assert!(parents("").is_empty());
    }

    #[test]
    fn flags_of_the_environment_do_not_reach_the_image() {
        let cargo = cargo(&Workspace::locate(), "build", &["firmware"]).unwrap();
        let variable = |name: &str| {
            let mut all = cargo.get_envs();
            all.find(|(key, _)| *key == name).map(|(_, value)| value)
        };
        assert_eq!(variable("RUSTFLAGS"), Some(None));
        let flags = variable("CARGO_ENCODED_RUSTFLAGS").flatten();
        let flags = flags.unwrap_or_default().to_string_lossy();
        let maps = |flag: &str| flag.starts_with("--remap-path-prefix=/");
        assert!(flags.split(BETWEEN).all(maps), "{flags}");
        assert!(flags.split(BETWEEN).count() >= 4, "{flags}");
    }

    #[test]
    fn images_built_side_by_side_were_mixed() {
        let workspace = Workspace::locate();
        let folder = workspace.target().join("alone");
        let workspace = Workspace::elsewhere(folder.clone(), folder.clone(), folder.clone());
        let first = alone(&workspace).expect("a lock");
        let second = File::open(folder.join(LOCK)).expect("its file");
        assert!(second.try_lock().is_err());
        drop(first);
        assert!(second.try_lock().is_ok());
    }
}
