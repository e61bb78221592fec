//! The verbs of the bench: `calibrate` by motor and by hand, `characterise`, `verify`, `update`.
//!
//! Everything here is measured in real time, so numbers are left out, except those that are asked
//! for. Of the files, the text and the elements are kept; sums over the measured have a filter.

use std::io::Write as _;
use std::process::Stdio;

use super::golden::{check_with, decimals, members, numbers};
use super::page::text;
use super::stand::Bench;
use super::transcript::Transcript;

/// Hashes, check sums, calibrations and dates of what was measured; and a guess of what is left,
/// which has hours on a slow machine, and the marks of an axis, which go with its range.
const SUMS: [(&str, &str); 8] = [
    (r"about (N h )?N min left", "about N left"),
    (r"(?m)^N  \(x\d+\)$", "N"),
    (r"\b[0-9a-f]{64}\b", "SHA256"),
    (r"\b(calibration|crc32:?) [0-9A-F]{8}\b", "$1 CRC32"),
    (r#""([a-z0-9_]*crc32)": "[0-9A-FN]+""#, r#""$1": "CRC32""#),
    (
        r#""calibration_hex": "[0-9a-fN]+""#,
        r#""calibration_hex": "HEX""#,
    ),
    (r"\d{4}-\d\d-\d\dT[0-9:]+Z", "TIME"),
    (r"plumb-1-\d{8}T\d{6}Z", "plumb-1-TIME"),
];

/// Runs a line on the bus of the bench, in its folder.
fn run(told: &mut Transcript, bench: &Bench, line: &str) {
    let words: Vec<_> = line.split_whitespace().collect();
    told.run(bench.command(&words).current_dir(bench.path("")));
}

fn read(bench: &Bench, name: &str) -> String {
    std::fs::read_to_string(bench.path(name)).unwrap()
}

/// Twenty times as fast as real time, and chamber and housing faster still.
fn bench() -> Bench {
    Bench::new("20", &["--chamber-speed", "300", "--uncalibrated"])
}

#[test]
fn a_motor_calibrates_and_verify_compares() {
    let bench = bench();
    let mut told = Transcript::default();
    let line = format!("calibrate --motor {} --step 30", bench.motor);
    run(&mut told, &bench, &line);
    check_with("calibrate-text", &decimals(&told.text), &SUMS);
    let json = numbers(&read(&bench, "calibration-report/report.json"));
    check_with("calibrate-json", &members(&json), &SUMS);
    check_with(
        "calibrate-page",
        &numbers(&text(&read(&bench, "calibration-report/report.html"))),
        &SUMS,
    );
    check_with(
        "calibrate-dcc",
        &numbers(&text(&read(&bench, "calibration-report/dcc.xml"))),
        &SUMS,
    );
    let mut told = Transcript::default();
    let dcc = "calibration-report/dcc.xml";
    for line in [
        &format!("verify {dcc}"),
        "calibrate --restore calibration-report/as-found.json --nodes 1",
        &format!("verify {dcc} --nodes 2"),
        &format!("verify {dcc} --json"),
        "verify calibration-report/report.json",
    ] {
        run(&mut told, &bench, line);
    }
    check_with("verify-session", &told.text, &SUMS);
    let mut told = Transcript::default();
    for line in [
        "calibrate --keep kept.json",
        "calibrate --keep kept.json",
        "calibrate --keep kept.json --force --json",
        "calibrate --restore kept.json",
        "calibrate --restore kept.json --json",
        "characterise --restore kept.json --nodes 2",
    ] {
        run(&mut told, &bench, line);
    }
    check_with("calibrate-keep", &told.text, &SUMS);
}

/// The housing stays as it is, so that the second pose is not one.
#[test]
fn poses_by_hand_are_asked_for() {
    let bench = Bench::new("4", &["--uncalibrated"]);
    let mut command = bench.command(&["calibrate", "--by-hand"]);
    command.current_dir(bench.path(""));
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(b"\n\n").unwrap();
    let mut told = Transcript::default();
    told.ended(&command, &child.wait_with_output().unwrap());
    check_with("calibrate-by-hand", &decimals(&told.text), &SUMS);
}

#[test]
fn a_chamber_characterises() {
    let bench = bench();
    let mut told = Transcript::default();
    let line = format!(
        "characterise --chamber {} --motor {} --step 40 --dwell 0.2 --runs 1",
        bench.chamber, bench.motor
    );
    run(&mut told, &bench, &line);
    check_with("characterise-text", &numbers(&told.text), &SUMS);
    let folder = "characterisation-report";
    let json = numbers(&read(&bench, &format!("{folder}/report.json")));
    check_with("characterise-json", &members(&json), &SUMS);
    let page = text(&read(&bench, &format!("{folder}/report.html")));
    check_with("characterise-page", &numbers(&page), &SUMS);
}

#[test]
fn nodes_get_a_program() {
    let bench = Bench::new("10", &["--uncalibrated"]);
    let mut told = Transcript::default();
    run(&mut told, &bench, "update missing.bin");
    for (name, version) in [("p.bin", "1.2.3"), ("old.bin", "1.2.2")] {
        let image = ["image", name, "--version", version];
        let mut image = super::bus::plumb(&image);
        assert!(
            image
                .current_dir(bench.path(""))
                .status()
                .unwrap()
                .success()
        );
    }
    for line in [
        "update p.bin",
        "update p.bin --json",
        "update old.bin --nodes 1",
    ] {
        run(&mut told, &bench, line);
    }
    check_with("update-session", &told.text, &[]);
}
