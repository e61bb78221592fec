//! The verbs that talk to nodes, on the bus of a `plumb serve` with the seed that it has as
//! delivered.
//!
//! The nodes measure in real time, so the moment of a reading is another one in each run: numbers
//! with a fraction are left out where an angle or a temperature is printed. What a node stores is
//! compared to the digit.

use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Output, Stdio};

use super::bus::{Bench, plumb};
use super::golden::{check, check_with, decimals};
use super::transcript::Transcript;

/// Adds a run of each line on the bus of the bench.
fn typed(told: &mut Transcript, bench: &Bench, lines: &[&str]) {
    for line in lines {
        let words: Vec<_> = line.split_whitespace().collect();
        told.run(plumb(&words).args(["--bus", &bench.bus]));
    }
}

fn session(bench: &Bench, lines: &[&str]) -> String {
    let mut told = Transcript::default();
    typed(&mut told, bench, lines);
    told.text
}

/// Readings that no number with a fraction shows.
const READINGS: [(&str, &str); 3] = [
    (r"\d+ degC", "N degC"),
    (r"\b\d+ %", "N %"),
    (r#""raw": -?\d+"#, r#""raw": N"#),
];

#[test]
fn who_is_there() {
    let bench = Bench::quick(&[]);
    check("scan-text", &session(&bench, &["scan"]));
    check(
        "scan-json",
        &session(&bench, &["scan --json", "scan --time 0.3 --json"]),
    );
}

/// A calibration comes from a simulated bench, whose last bits are another machine's own affair: so
/// the nodes have none here.
#[test]
fn what_the_nodes_are() {
    let bench = Bench::quick(&[]);
    let text = session(&bench, &["info", "info 2"]);
    check_with("info-text", &decimals(&text), &READINGS);
    let json = session(&bench, &["info 1 --json"]);
    check_with("info-json", &decimals(&json), &READINGS);
}

#[test]
fn objects_are_read() {
    let bench = Bench::quick(&[]);
    let lines = [
        "get --list",
        "get heartbeat 1018h manufacturer-device-name 1016h:1 --node all",
    ];
    check("get-text", &session(&bench, &lines));
    let lines = [
        "get heartbeat 1018h device-name --node 1 --json",
        "get black-box.1 fault-log --node 1 --json",
        "get black-box.1 --node 1",
    ];
    check("get-json", &session(&bench, &lines));
    let lines = [
        "get slope-long uncertainty temperature --node all",
        "get slope-long --node 2 --json",
    ];
    check_with(
        "get-readings",
        &decimals(&session(&bench, &lines)),
        &READINGS,
    );
}

/// Long sessions, side by side on a bus each, since they mostly wait.
#[test]
fn nodes_are_set_up() {
    std::thread::scope(|scope| {
        scope.spawn(objects_are_written_saved_and_restored);
        scope.spawn(node_ids_are_given);
        scope.spawn(the_bit_rate_is_read_and_changed);
    });
}

fn objects_are_written_saved_and_restored() {
    let bench = Bench::quick(&[]);
    let lines = [
        "set heartbeat 500ms --node all",
        "set nmt-startup 8 --node 2",
        "set heartbeat 0.25s --node 1 --json",
        "set resolution 0.1deg --node 1 --json",
        "set 1017h 300 --raw --node 2",
    ];
    check("set-session", &session(&bench, &lines));
    let lines = ["save --node 1", "save --only profile", "save --json"];
    check("save-session", &session(&bench, &lines));
    let lines = [
        "restore --node 1",
        "restore --node all --only communication --json",
        "restore --node all --reset",
    ];
    check("restore-session", &session(&bench, &lines));
}

#[test]
fn slopes_are_set_to_zero() {
    let bench = Bench::quick(&[]);
    let lines = [
        "zero --node 1 --axis x",
        "zero",
        "zero --to 1deg --node 2 --json",
    ];
    check("zero-session", &decimals(&session(&bench, &lines)));
}

fn node_ids_are_given() {
    let bench = Bench::quick(&[]);
    let lines = [
        "node-id 5 --node 2",
        "node-id 2 --node 5 --json",
        "node-id --pair 1,2",
    ];
    check("node-id-session", &session(&bench, &lines));
}

/// The adapter of `plumb serve` is told of the new bit rate by hand, as any other one.
fn the_bit_rate_is_read_and_changed() {
    let mut bench = Bench::quick(&[]);
    let mut told = Transcript::default();
    typed(
        &mut told,
        &bench,
        &["bitrate", "bitrate --json", "bitrate 500 --node 1"],
    );
    let mut change = plumb(&["bitrate", "500", "--delay", "300", "--bus", &bench.bus]);
    let mut child = change
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut first = String::new();
    let mut out = BufReader::new(child.stdout.take().unwrap());
    out.read_line(&mut first).unwrap();
    // The nodes pause before the change and behind it; the adapter follows between.
    bench.word("+0.4 bit-rate 500");
    let mut stdout = first.into_bytes();
    out.read_to_end(&mut stdout).unwrap();
    let ended = child.wait_with_output().unwrap();
    let output = Output { stdout, ..ended };
    told.ended(&change, &output);
    typed(&mut told, &bench, &["bitrate --json"]);
    check("bitrate-session", &told.text);
}
