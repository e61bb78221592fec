//! Recordings of sensors through `replay`: two sensors on a housing that goes through its poses.
//!
//! The recordings are made up here without a sine. What is printed of them has four digits behind
//! the point at most, and of JSON, which has
//! the same numbers and samples besides, only the form is kept.

use super::bus::plumb;
use super::golden::{check, members, rounded};
use super::page::text;
use super::sensors::{Folder, SQUARE, TURNED, up};
use super::transcript::Transcript;

fn read(folder: &Folder, name: &str) -> String {
    std::fs::read_to_string(folder.0.join(name)).unwrap()
}

#[test]
fn replay_runs_recordings_through_the_chain() {
    let folder = Folder::new("golden-recordings");
    folder.file("one.csv", SQUARE.record(up));
    folder.file("two.csv", TURNED.record(up));
    let session = |lines: &[&str]| {
        let mut told = Transcript::default();
        for line in lines {
            let words: Vec<_> = line.split(' ').collect();
            told.run(plumb(&words).current_dir(&folder.0));
        }
        told
    };
    let told = session(&[
        "replay one.csv --save-calibration kept.json",
        "replay one.csv --calibration kept.json",
        "replay one.csv --mode paper",
        "replay one.csv two.csv",
    ]);
    check("replay-recordings-text", &told.text);
    check(
        "replay-recordings-page",
        &rounded(&text(&read(&folder, "plumb-report/report.html"))),
    );
    check(
        "replay-recordings-calibration",
        &rounded(&read(&folder, "kept.json")),
    );
    let told = session(&["replay one.csv two.csv --json"]);
    check("replay-recordings-json", &members(&told.text));
}
