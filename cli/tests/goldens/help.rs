//! The help of the program and of each verb, and a golden for each verb that the help lists.

use std::fs;
use std::path::Path;

use super::bus::plumb;
use super::golden::check;
use super::transcript::Transcript;

/// The verbs below these words, by the list in their help; `help` itself is clap's.
fn verbs(words: &[String]) -> Vec<String> {
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    let run = plumb(&words).arg("--help").output().unwrap();
    let help = String::from_utf8(run.stdout).unwrap();
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    listed
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next())
        .filter(|verb| *verb != "help")
        .map(str::to_owned)
        .collect()
}

/// Compares the help at these words and at all verbs below them.
fn walk(words: &[String], seen: &mut Vec<String>) {
    let typed: Vec<_> = words.iter().map(String::as_str).collect();
    let mut told = Transcript::default();
    told.run(plumb(&typed).arg("--help"));
    told.run(plumb(&typed).arg("-h"));
    if words.is_empty() {
        told.run(&mut plumb(&[])).run(&mut plumb(&["--version"]));
    }
    let name = [&["plumb".to_owned()], words].concat();
    let name = if words.is_empty() { &name } else { words };
    check(&format!("{}-help", name.join("-")), &told.text);
    for verb in verbs(words) {
        let below = [words, &[verb]].concat();
        seen.push(below.join("-"));
        walk(&below, seen);
    }
}

#[test]
fn the_help_of_every_verb() {
    let mut seen = Vec::new();
    walk(&[], &mut seen);
    assert!(seen.len() >= 24, "{seen:?}");
}

/// What a verb does has to have a golden too, not only its help and its errors.
#[test]
fn every_verb_has_goldens_of_its_errors_and_of_its_work() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/goldens/snapshots");
    let names = fs::read_dir(folder).unwrap();
    let names: Vec<_> = names
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    for verb in verbs(&[]) {
        let kinds = |except: &[&str]| {
            let kinds = names
                .iter()
                .filter_map(|name| name.strip_prefix(&format!("{verb}-")));
            let kinds = kinds.map(|kind| kind.trim_end_matches(".snap").to_owned());
            kinds
                .filter(|kind| !except.contains(&kind.as_str()))
                .count()
        };
        assert!(
            kinds(&["help", "errors"]) > 0,
            "no golden of what {verb} does"
        );
        assert!(
            names.contains(&format!("{verb}-errors.snap")),
            "no golden of {verb}'s errors"
        );
    }
}
