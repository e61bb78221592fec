//! `plumb describe` from the outside: the committed documents are what it prints today.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn describe(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plumb"));
    command.arg("describe").args(arguments).output().unwrap()
}

/// Compares a committed document with what the verb prints.
fn is_fresh(path: &str, arguments: &[&str]) {
    let run = describe(arguments);
    let said = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(0), "{said}");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let committed = std::fs::read(root.join(path)).unwrap_or_default();
    assert!(
        committed == run.stdout,
        "{path} is stale or missing; renew it at the root of the checkout with \
         `cargo run -- describe {} --force --output {path}`",
        arguments.join(" ")
    );
}

#[test]
fn the_data_sheets_are_fresh() {
    is_fresh("eds/plumb-a.eds", &["eds", "--channel", "a"]);
    is_fresh("eds/plumb-b.eds", &["eds", "--channel", "b"]);
    for instrument in ["paper", "dynamic"] {
        for channel in ["a", "b"] {
            let path = format!("eds/plumb-{instrument}-{channel}.eds");
            is_fresh(
                &path,
                &["eds", "--channel", channel, "--instrument", instrument],
            );
        }
    }
}

#[test]
fn the_configurations_are_fresh() {
    is_fresh("eds/plumb-a.dcf", &["dcf", "--channel", "a"]);
    is_fresh("eds/plumb-b.dcf", &["dcf", "--channel", "b"]);
    for instrument in ["paper", "dynamic"] {
        for channel in ["a", "b"] {
            let path = format!("eds/plumb-{instrument}-{channel}.dcf");
            is_fresh(
                &path,
                &["dcf", "--channel", channel, "--instrument", instrument],
            );
        }
    }
}

#[test]
fn the_database_is_fresh() {
    is_fresh("eds/plumb.dbc", &["dbc"]);
    for instrument in ["paper", "dynamic"] {
        let path = format!("eds/plumb-{instrument}.dbc");
        is_fresh(&path, &["dbc", "--instrument", instrument]);
    }
}

#[test]
fn the_page_of_objects_is_fresh() {
    is_fresh("docs/objects.md", &["objects"]);
    for instrument in ["paper", "dynamic"] {
        let path = format!("docs/objects-{instrument}.md");
        is_fresh(&path, &["objects", "--instrument", instrument]);
    }
}

#[test]
fn a_file_gets_what_would_be_printed() {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("describe.dcf");
    let arguments = ["dcf", "--channel", "b", "--node-id", "9"];
    let printed = describe(&arguments).stdout;
    assert!(String::from_utf8_lossy(&printed).contains("NodeID=9\r\n"));
    let name = path.to_str().unwrap();
    let run = describe(&[&arguments[..], &["--force", "--output", name]].concat());
    assert_eq!(run.status.code(), Some(0));
    assert!(run.stdout.is_empty());
    assert_eq!(std::fs::read(&path).unwrap(), printed);
}

#[test]
fn what_cannot_be_done_is_one_sentence_and_status_2() {
    let missing = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("no such folder/a.eds");
    let missing = missing.to_str().unwrap();
    for (arguments, word) in [
        (&["dbc", "--channel", "a"][..], "--channel"),
        (&["eds", "--node-id", "3"], "--node-id"),
        (&["eds", "--output", missing], "no such folder"),
    ] {
        let run = describe(arguments);
        assert_eq!(run.status.code(), Some(2), "{arguments:?}");
        assert!(run.stdout.is_empty());
        let said = String::from_utf8(run.stderr).unwrap();
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(said.contains(word), "{said}");
    }
}

#[test]
fn impossible_words_are_refused() {
    for bad in [
        &["dcf", "--node-id", "0"][..],
        &["dcf", "--node-id", "128"],
        &["eds", "--channel", "c"],
        &["xdd"],
        &[],
    ] {
        assert_eq!(describe(bad).status.code(), Some(2), "{bad:?}");
    }
}
