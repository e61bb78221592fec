//! Verbs that need no bus: `image`, `describe`, `completions`, `man` and `demo`.
//!
//! Left out: the whole of each document of `describe`, which is committed in `eds/` and `docs/`
//! and compared by `describe.rs`; of each script for a shell, which clap writes from the same
//! definition as the help.

use super::bus::plumb;
use super::golden::{check, numbers};
use super::page::text;
use super::sensors::Folder;
use super::transcript::{self, Transcript};

/// Runs lines in a folder; adds only the lines of their output that are `wanted`.
fn excerpts(folder: &Folder, lines: &[&str], wanted: impl Fn(usize, &str) -> bool) -> Transcript {
    let mut told = Transcript::default();
    for line in lines {
        let words: Vec<_> = line.split(' ').collect();
        let mut command = plumb(&words);
        let mut output = command.current_dir(&folder.0).output().unwrap();
        let out = transcript::text(&output.stdout);
        let numbered = out.lines().enumerate();
        let some = numbered.filter(|(number, line)| wanted(*number, line));
        let some: String = some.map(|(_, line)| format!("{line}\n")).collect();
        output.stdout = format!("{some}[of {} lines]\n", out.lines().count()).into_bytes();
        told.ended(&command, &output);
    }
    told
}

#[test]
fn image_builds_a_program() {
    let folder = Folder::new("golden-image");
    let mut told = Transcript::default();
    for line in [
        "image p.bin --version 1.2.3",
        "image p.bin --version 1.2.4 --json",
        "image p.bin --version 1.2.4 --json --force",
        "image u.bin --version 1.2.4 --unsigned --json",
        "image s.bin --from u.bin --json",
        "image --public",
        "image --public --json",
    ] {
        let words: Vec<_> = line.split(' ').collect();
        told.run(plumb(&words).current_dir(&folder.0));
    }
    check("image-session", &told.text);
}

#[test]
fn describe_prints_documents() {
    let folder = Folder::new("golden-describe");
    let lines = [
        "describe eds",
        "describe dcf --channel b --node-id 9",
        "describe dbc",
        "describe objects",
        "describe eds --instrument paper --channel b",
    ];
    // The date of a data sheet is its own, not today's.
    let told = excerpts(&folder, &lines, |number, _| number < 24);
    check("describe-heads", &told.text);
}

#[test]
fn shells_get_verbs_and_the_words_of_the_twin() {
    let folder = Folder::new("golden-completions");
    let lines = ["completions bash", "completions zsh", "completions fish"];
    let told = excerpts(&folder, &lines, |number, line| {
        number < 8 || line.contains("sync-lost") || line.contains("l a list of verbs")
    });
    check("completions-excerpts", &told.text);
}

#[test]
fn man_prints_pages() {
    let folder = Folder::new("golden-man");
    let mut told = Transcript::default();
    for words in [
        &["man"][..],
        &["man", "zero"],
        &["man", "--output", "pages"],
    ] {
        told.run(plumb(words).current_dir(&folder.0));
    }
    let mut names: Vec<_> = std::fs::read_dir(folder.0.join("pages"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    told.part("pages", &names.join("\n"));
    check("man-pages", &told.text);
}

/// Figures come from a simulation of sensors, and `cargo xtask accuracy` compares those.
#[test]
fn demo_builds_one_instrument() {
    let folder = Folder::new("golden-demo");
    let mut told = Transcript::default();
    let words = ["demo", "--units", "1", "--days", "0", "--details"];
    told.run(plumb(&words).current_dir(&folder.0));
    check("demo-text", &numbers(&told.text));
    let read = |name: &str| std::fs::read_to_string(folder.0.join("plumb-report").join(name));
    check("demo-page", &numbers(&text(&read("report.html").unwrap())));
}
