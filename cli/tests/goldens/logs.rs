//! Logs of a bus through `replay`, `report` and `monitor`.
//!
//! The logs are the same to the byte on every machine, so nothing is left out of what is printed,
//! except that the page is reduced to its text, and its bytes to their hash.

use super::bus::plumb;
use super::golden::check;
use super::page::seen;
use super::sensors::Folder;
use super::transcript::Transcript;
use super::{log_text, transcript};

/// A folder with the logs, in which the program runs, so that no path is printed.
fn folder(name: &str) -> Folder {
    let folder = Folder::new(&format!("golden-{name}"));
    folder.file("shift.log", log_text::shift());
    folder.file("moment.log", log_text::moment());
    folder.file("damaged.log", log_text::damaged());
    folder
}

/// Runs of lines in a folder.
fn typed(folder: &Folder, lines: &[&str]) -> Transcript {
    let mut told = Transcript::default();
    for line in lines {
        let words: Vec<_> = line.split_whitespace().collect();
        told.run(plumb(&words).current_dir(&folder.0));
    }
    told
}

fn read(folder: &Folder, name: &str) -> String {
    transcript::text(&std::fs::read(folder.0.join(name)).unwrap())
}

#[test]
fn replay_sums_up() {
    let folder = folder("replay");
    let lines = [
        "replay shift.log",
        "replay shift.log --from 6 --to 9",
        "replay damaged.log",
    ];
    check("replay-text", &typed(&folder, &lines).text);
    let lines = ["replay shift.log --json", "replay damaged.log --json"];
    check("replay-json", &typed(&folder, &lines).text);
}

#[test]
fn replay_writes_tables_and_logs() {
    let folder = folder("export");
    let lines = [
        "replay moment.log --export a.csv",
        "replay moment.log --export a.asc --json",
        "replay a.asc --export b.log",
        "replay a.asc --export b.log",
        "replay shift.log --from 7.95 --to 8.05 --export fault.csv",
    ];
    let mut told = typed(&folder, &lines);
    for name in ["a.csv", "a.asc", "b.log", "fault.csv"] {
        told.part(name, &read(&folder, name));
    }
    check("replay-export", &told.text);
}

#[test]
fn replay_knows_other_devices_by_their_data_sheet() {
    let folder = folder("sheet");
    let sheet = "[DeviceInfo]\nProductName=Encoder\n[1800sub1]\nDataType=7\n\
        DefaultValue=$NODEID+0x180\n[1A00sub0]\nDefaultValue=01\n[1A00sub1]\n\
        DefaultValue=0x60040020\nodd\n[6004]\nParameterName=Position value\nDataType=4\n";
    folder.file("encoder.eds", sheet);
    let other = "(1700000000.3) can0 185#FEFFFFFF\n(1700000000.4) can0 185#0A000000\n";
    folder.file("two.log", log_text::moment() + other);
    let line = "replay two.log --eds encoder.eds@5";
    let lines = [line, &format!("{line} --json --export two.csv")];
    let mut told = typed(&folder, &lines);
    let table = read(&folder, "two.csv");
    let last = table.lines().last().unwrap();
    told.part("the last line of two.csv", last);
    check("replay-other-device", &told.text);
}

#[test]
fn report_tells_of_a_period() {
    let folder = folder("report");
    let lines = [
        "report shift.log --bitrate 250000",
        "report shift.log --from 2023-11-14T22:13:26 --to 1700000009 --out part",
        "report damaged.log --out damaged",
    ];
    check("report-text", &typed(&folder, &lines).text);
    check(
        "report-page",
        &seen(&read(&folder, "plumb-period/report.html")),
    );
    check(
        "report-page-damaged",
        &seen(&read(&folder, "damaged/report.html")),
    );
    let told = typed(&folder, &["report shift.log --json"]);
    check("report-json", &told.text);
}

#[test]
fn monitor_plays_a_log() {
    let folder = folder("monitor");
    let lines = [
        "monitor --log shift.log --speed max --plain",
        "monitor --log shift.log --speed max --plain --bitrate 250000 --skip-gaps",
        "monitor --log damaged.log --speed max --plain",
    ];
    check("monitor-text", &typed(&folder, &lines).text);
    let lines = ["monitor --log shift.log --speed max --json"];
    check("monitor-json", &typed(&folder, &lines).text);
}
