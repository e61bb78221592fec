//! `plumb completions` and `plumb man` as a shell and `man` take them, and what every verb owes
//! its user.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const PLUMB: &str = env!("CARGO_BIN_EXE_plumb");

fn plumb(arguments: &[&str]) -> Output {
    let mut command = Command::new(PLUMB);
    command.args(arguments).stdin(Stdio::null());
    command.output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// A folder of this test alone, gone with it.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("plumb-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// What bash offers behind the words `plumb` and `typed`.
fn offered(folder: &Path, typed: &str) -> Option<String> {
    let script = folder.join("plumb.bash");
    std::fs::write(&script, plumb(&["completions", "bash"]).stdout).unwrap();
    let line = format!(
        "source {}; COMP_WORDS=(plumb {typed}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); \
         _plumb plumb ${{COMP_WORDS[-1]}} ${{COMP_WORDS[-2]}}; echo ${{COMPREPLY[@]}}",
        script.display()
    );
    let ran = Command::new("bash").args(["-c", &line]).output().ok()?;
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    Some(text(&ran.stdout).trim().to_owned())
}

#[test]
fn bash_completes_a_verb() {
    let folder = Folder::new("completions");
    match offered(&folder.0, "desc") {
        Some(words) => assert_eq!(words, "describe"),
        None => println!("skipped: there is no bash"),
    }
}

#[test]
fn every_verb_in_the_help_has_a_manual_page() {
    let folder = Folder::new("man");
    let written = plumb(&["man", "--output", folder.0.to_str().unwrap()]);
    assert_eq!(written.status.code(), Some(0));
    let help = text(&plumb(&["--help"]).stdout);
    let verbs = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let verbs: Vec<_> = verbs
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next())
        .filter(|word| *word != "help")
        .collect();
    assert!(verbs.len() >= 8, "{verbs:?}");
    for verb in verbs {
        let page = std::fs::read_to_string(folder.0.join(format!("plumb-{verb}.1"))).unwrap();
        assert!(page.contains(".SH OPTIONS"), "{verb}");
        assert_eq!(text(&plumb(&["man", verb]).stdout), page);
    }
}

#[test]
fn a_page_of_no_verb_and_a_folder_that_cannot_be_made_are_told() {
    let ran = plumb(&["man", "nothing"]);
    assert_eq!(ran.status.code(), Some(2));
    assert!(text(&ran.stderr).contains("no verb \"nothing\""));
    let folder = Folder::new("man-file");
    let file = folder.0.join("file");
    std::fs::write(&file, "kept").unwrap();
    let ran = plumb(&["man", "--output", file.to_str().unwrap()]);
    assert_eq!(ran.status.code(), Some(2));
    assert!(text(&ran.stderr).contains("choose another folder"));
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "kept");
}

#[test]
fn a_reader_that_has_had_enough_is_no_error() {
    let mut child = Command::new(PLUMB)
        .args(["completions", "zsh"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let ended = child.wait_with_output().unwrap();
    assert_eq!(
        (ended.status.code(), text(&ended.stderr)),
        (Some(0), String::new())
    );
}

#[test]
fn what_prints_its_result_does_so_as_json_too() {
    let help = text(&plumb(&["--help"]).stdout);
    // What they print is a document of its own form.
    let others = ["help", "completions", "describe", "man"];
    let verbs = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let verbs = verbs.take_while(|line| !line.is_empty());
    let verbs = verbs.filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next());
    let missing: Vec<_> = verbs
        .filter(|verb| !others.contains(verb))
        .filter(|verb| !text(&plumb(&[verb, "--help"]).stdout).contains("--json"))
        .collect();
    assert!(missing.is_empty(), "without --json: {missing:?}");
}

#[test]
fn a_word_that_is_not_known_is_status_2_and_no_backtrace() {
    let ran = plumb(&["levitate"]);
    assert_eq!(ran.status.code(), Some(2));
    let said = text(&ran.stderr);
    assert!(
        said.contains("levitate") && !said.contains("panicked"),
        "{said}"
    );
}

#[test]
fn bash_completes_the_words_of_the_twin_the_nodes_and_the_faults() {
    let folder = Folder::new("completions-twin");
    if offered(&folder.0, "twin").is_none() {
        return println!("skipped: there is no bash");
    }
    for (typed, word) in [
        ("twin vibr", "vibration"),
        ("twin fault al", "all"),
        ("twin fault b bia", "bias"),
    ] {
        assert_eq!(offered(&folder.0, typed).as_deref(), Some(word), "{typed}");
    }
}

#[test]
fn fish_and_zsh_offer_the_words_of_the_twin_too() {
    for shell in ["fish", "zsh"] {
        let script = text(&plumb(&["completions", shell]).stdout);
        let words = ["vibration", "all", "sync-lost"];
        let line = script
            .lines()
            .find(|line| words.iter().all(|word| line.contains(word)));
        assert!(line.is_some(), "{shell}");
    }
}
