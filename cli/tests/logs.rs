//! `plumb replay` of bus logs from the outside.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::process::{Output, Stdio};

use flate2::{Compression, write::GzEncoder};
use serde_json::Value;

mod program;

use program::listener::Listener;
use program::{Folder, Served, plumb};

fn gzip(text: &str) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(text.as_bytes()).unwrap();
    encoder.finish().unwrap()
}

/// Rounds of a healthy pair at 100 SYNC/s: A at 10 deg, B 0.02 deg less.
fn rounds(start_s: u64, count: u64, interface: &str) -> String {
    let mut text = String::new();
    for round in 0..count {
        let us = round * 10_000;
        let time = format!(
            "({}.{:06}) {interface} ",
            start_s + us / 1_000_000,
            us % 1_000_000
        );
        for frame in [
            "080#",
            "181#E80300003F01",
            "182#E60300003F01",
            "381#721C07000000707",
            "382#CE1807000000707",
        ] {
            let whole = if frame.len() == 19 {
                format!("{frame}0")
            } else {
                frame.to_owned()
            };
            writeln!(text, "{time}{whole}").unwrap();
        }
    }
    text
}

fn said(output: &Output) -> (Option<i32>, String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

/// Runs with `--json` and expects success.
fn json(arguments: &[&str]) -> Value {
    let (value, err) = json_with(0, arguments);
    assert!(err.is_empty(), "{err}");
    value
}

/// The same with this exit status, and what the standard error holds.
fn json_with(wanted: i32, arguments: &[&str]) -> (Value, String) {
    let output = plumb(&["replay", "--json"])
        .args(arguments)
        .output()
        .unwrap();
    let (status, out, err) = said(&output);
    assert_eq!(status, Some(wanted), "{err}");
    let value: Value = serde_json::from_str(&out).unwrap();
    let (kind, version) = match arguments.contains(&"--onto") {
        true => ("plumb-onto", 1),
        false => ("plumb-log", 2),
    };
    let head = format!(r#"{{"format":"{kind}","version":{version},"#);
    assert!(out.starts_with(&head), "{out}");
    (value, err)
}

/// Runs and expects status 2 with one sentence that has these words.
fn refused(arguments: &[&str], words: &[&str]) {
    let output = plumb(&["replay"]).args(arguments).output().unwrap();
    let (status, out, err) = said(&output);
    assert_eq!((status, out.as_str()), (Some(2), ""), "{err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    assert!(err.starts_with("plumb: "), "{err}");
    words
        .iter()
        .for_each(|word| assert!(err.contains(word), "no {word} in: {err}"));
}

fn number(value: &Value, pointer: &str) -> f64 {
    value
        .pointer(pointer)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("{pointer}"))
}

#[test]
fn a_log_is_summed_up_by_node_and_pair() {
    let folder = Folder::new();
    let log = folder.file("a.log", rounds(1_700_000_000, 100, "can0"));
    let report = json(&[&log]);
    assert_eq!(number(&report, "/frames"), 500.0);
    let pair = "/interfaces/0/instruments/0";
    assert_eq!(number(&report, "/interfaces/0/syncs"), 100.0);
    assert_eq!(
        number(&report, &format!("{pair}/nodes/0/slope_x/mean_deg")),
        10.0
    );
    assert_eq!(
        number(&report, &format!("{pair}/nodes/1/slope_x/max_deg")),
        9.98
    );
    assert_eq!(number(&report, &format!("{pair}/delta/0/count")), 100.0);
    assert_eq!(number(&report, &format!("{pair}/delta/0/max_deg")), 0.02);
    for node in 0..2 {
        let findings = report.pointer(&format!("{pair}/nodes/{node}/findings"));
        assert_eq!(findings, Some(&Value::Array(vec![])));
    }
    let (status, out, _) = said(&plumb(&["replay", &log]).output().unwrap());
    assert_eq!(status, Some(0));
    assert!(
        out.contains("node 1: 100 readings") && out.contains("2023-11-14 22:13:20"),
        "{out}"
    );
}

#[test]
fn what_is_no_frame_is_counted_with_its_first_line_and_the_rest_is_read() {
    let folder = Folder::new();
    let bad = "\
(1700000000.000000) can0 080#
(1700000000.00
(1700000000.001000) can0 181##1E8
(1700000000.001000) can0 20000004#0000000000000000
what is this
(1700000000.002000) can0 18DAF110#01
(1700000000.002000) can0 705#05
(1700000000.002000) can0 701#R
(1699999999.000000) can0 080#
(1700000000.003000) can0 181#E80300
(1700000000.003000) can0 181#E803";
    let log = folder.file("bad.log", bad);
    let (report, err) = json_with(2, &[&log]);
    assert!(
        err.starts_with("plumb: 3 lines are cut or can't be read"),
        "{err}"
    );
    assert!(
        err.contains("bad.log line 2") && err.lines().count() == 1,
        "{err}"
    );
    let skipped = report["skipped"].as_array().unwrap();
    let told: Vec<_> = skipped
        .iter()
        .map(|kind| {
            (
                kind["kind"].as_str().unwrap(),
                &kind["count"],
                &kind["first_line"],
            )
        })
        .map(|(kind, count, line)| format!("{kind} {count} {line}"))
        .collect();
    let want = [
        "cut_lines 2 2",
        "unreadable_lines 1 5",
        "fd_frames 1 3",
        "error_frames 1 4",
    ];
    assert_eq!(told, want);
    assert_eq!(number(&report, "/backwards/count"), 1.0);
    assert_eq!(number(&report, "/backwards/first_line"), 9.0);
    let counted = skipped.iter().map(|kind| kind["count"].as_u64().unwrap());
    assert_eq!(counted.sum::<u64>() + 6, bad.lines().count() as u64);
    assert_eq!(number(&report, "/interfaces/0/malformed"), 1.0);
    assert_eq!(number(&report, "/interfaces/0/others/extended"), 1.0);
    assert_eq!(number(&report, "/interfaces/0/others/remote"), 1.0);
    assert_eq!(number(&report, "/interfaces/0/others/node_ids/0"), 5.0);
    let (_, out, _) = said(&plumb(&["replay", &log]).output().unwrap());
    assert!(out.contains("bad.log line 2"), "{out}");
}

#[test]
fn what_can_not_be_read_is_one_sentence_and_status_2() {
    let folder = Folder::new();
    let log = folder.file("a.log", rounds(1_700_000_000, 3, "can0"));
    let note = folder.file("note.txt", "nothing of the kind\n");
    let wide = folder.file("wide.log", b"\xFF\xFE(\x001\x00");
    std::fs::create_dir(folder.0.path().join("empty")).unwrap();
    refused(
        &[&folder.path("missing.log"), &log],
        &["missing.log", "cannot read"],
    );
    refused(&[&folder.path("empty")], &["empty", "no log"]);
    refused(&[&note, &log], &["note.txt", "a.log", "one kind at a time"]);
    refused(&[&log, "--mode", "paper"], &["--mode", "recordings"]);
    refused(&[&log, "--from", "poses"], &["--from poses", "recordings"]);
    refused(&[&note, "--nodes", "1,2"], &["--nodes", "logs of a bus"]);
    refused(&[&log, "--nodes", "1,2,3"], &["--nodes", "each instrument"]);
    refused(&[&log, "--interface", "can7"], &["can7", "can0"]);
    refused(
        &[&log, "--export", &folder.path("x.txt")],
        &["x.txt", ".csv or .parquet"],
    );
    refused(
        &[&log, "--eds", &format!("{note}@5")],
        &["note.txt", "no object"],
    );
    refused(&[&log, "--onto", "127.0.0.1:1"], &["127.0.0.1:1"]);
    let words = ["is UTF-16 text", "convert it to UTF-8"];
    refused(&[&wide], &words);
    refused(&[&log, &wide], &words);
    let input = std::fs::File::open(wide).unwrap();
    let (status, _, err) = said(&plumb(&["replay", "-"]).stdin(input).output().unwrap());
    assert_eq!(status, Some(2));
    assert!(err.starts_with("plumb: standard input is UTF-16"), "{err}");
}

#[test]
fn times_backwards_and_frames_of_other_kinds_were_no_reason_for_status_2() {
    let folder = Folder::new();
    let text = "(1700000000.5) can0 080#\n(1700000000.4) can0 181##1E8\n\
        (1700000000.3) can0 20000004#0000000000000000\n(1700000000.2) can0 18DAF110#01\n\
        (1700000000.1) can0 705#05\n(1700000000.0) can0 701#R\n";
    let report = json(&[&folder.file("odd.log", text)]);
    assert_eq!(number(&report, "/frames"), 4.0);
    assert_eq!(number(&report, "/backwards/count"), 3.0);
}

#[test]
fn frames_from_before_a_clock_was_set_were_neither_in_the_period_nor_counted() {
    let folder = Folder::new();
    let text = rounds(100, 20, "can0") + &rounds(1_700_000_000, 50, "can0");
    let log = folder.file("boot.log", text);
    let report = json(&[&log]);
    let bus = |field: &str| number(&report, &format!("/interfaces/0/{field}"));
    assert_eq!(number(&report, "/frames"), 350.0);
    assert_eq!((bus("frames"), bus("undated")), (350.0, 0.0));
    assert_eq!(bus("other_clock"), 100.0);
    assert_eq!(bus("first_time_s"), 1_700_000_000.0);
    let text = plumb(&["replay", &log]).output().unwrap().stdout;
    let text = String::from_utf8(text).unwrap();
    assert!(
        text.contains("100 frames by a clock that was set within the log"),
        "{text}"
    );
    let dated = json(&[&folder.file("a.log", rounds(1_700_000_000, 3, "can0"))]);
    assert_eq!(number(&dated, "/interfaces/0/other_clock"), 0.0);
}

#[test]
fn an_export_was_whole_though_lines_could_not_be_read() {
    let folder = Folder::new();
    let text =
        rounds(1_700_000_000, 2, "can0") + "what is this\n" + &rounds(1_700_000_001, 2, "can0");
    let (log, out) = (folder.file("a.log", text), folder.path("out.csv"));
    let (report, err) = json_with(2, &[&log, "--export", &out]);
    assert_eq!(number(&report, "/export/rows"), 16.0);
    assert_eq!(std::fs::read_to_string(out).unwrap().lines().count(), 17);
    assert!(
        err.contains("1 line is cut or can't be read") && err.contains("line 11"),
        "{err}"
    );
}

#[test]
fn a_log_of_a_format_that_is_not_read_was_called_no_csv() {
    let folder = Folder::new();
    let blf = folder.file("a.blf", b"LOGG\x90\0\0\0");
    refused(&[&blf], &["a.blf is a BLF log", "candump"]);
    let trc = folder.file("a.trc", ";$FILEVERSION=2.1\n;$STARTTIME=45000\n");
    refused(&[&trc], &["a.trc is a TRC log", "candump"]);
}

#[test]
fn a_folder_is_read_in_the_order_of_time_whatever_its_files_are_called() {
    let folder = Folder::new();
    folder.file("b.log", rounds(1_700_000_000, 100, "can0"));
    folder.file("a.log.gz", gzip(&rounds(1_700_000_001, 100, "can0")));
    std::fs::create_dir(folder.0.path().join("day")).unwrap();
    folder.file("day/c.log", rounds(1_700_000_002, 100, "can0"));
    folder.file("notes.txt", "not a log\n");
    folder.file(".hidden.log", rounds(1_600_000_000, 10, "can0"));
    let whole = folder.path("");
    let report = json(&[&whole]);
    assert_eq!(number(&report, "/frames"), 1500.0);
    assert!(report["backwards"].is_null(), "{report}");
    assert_eq!(report["not_logs"].as_array().unwrap().len(), 1);
    assert_eq!(number(&report, "/overlapping_files"), 0.0);
    assert_eq!(number(&report, "/interfaces/0/holes"), 0.0);
    // Named twice it is read once.
    let twice = json(&[&whole, &folder.path("b.log")]);
    assert_eq!(number(&twice, "/frames"), 1500.0);
}

#[test]
fn logs_that_overlap_are_merged_and_interfaces_are_instruments_of_their_own() {
    let folder = Folder::new();
    let one = folder.file("one.log", rounds(1_700_000_000, 100, "can0"));
    let two = folder.file("two.log", rounds(1_700_000_000, 100, "can1"));
    let report = json(&[&one, &two]);
    assert_eq!(number(&report, "/overlapping_files"), 1.0);
    assert!(report["backwards"].is_null());
    for place in 0..2 {
        assert_eq!(
            number(&report, &format!("/interfaces/{place}/frames")),
            500.0
        );
        let findings = format!("/interfaces/{place}/instruments/0/nodes/0/findings");
        assert_eq!(report.pointer(&findings), Some(&Value::Array(vec![])));
    }
    let chosen = json(&[&one, &two, "--interface", "can1"]);
    assert_eq!(number(&chosen, "/frames"), 500.0);
    assert_eq!(chosen["skipped"][0]["kind"], "other_interfaces");
}

#[test]
fn a_compressed_log_that_ends_in_the_middle_gives_what_it_has() {
    let folder = Folder::new();
    let whole = gzip(&rounds(1_700_000_000, 2000, "can0"));
    let cut = folder.file("cut.log.gz", &whole[..whole.len() / 2]);
    let (report, err) = json_with(2, &[&cut]);
    assert!(
        err.contains("the end of ") && err.contains("cut.log.gz is missing"),
        "{err}"
    );
    assert!(number(&report, "/frames") > 100.0);
    assert!(
        report["damaged"][0]["why"]
            .as_str()
            .unwrap()
            .contains("end mark")
    );
}

#[test]
fn an_asc_and_a_part_of_its_time() {
    let folder = Folder::new();
    let mut text =
        "date Tue Nov 14 10:13:20.000 pm 2023\r\nbase hex  timestamps absolute\r\n".to_owned();
    for second in 0..10 {
        writeln!(text, "   {second}.000000 1  80  Rx   d 0\r").unwrap();
    }
    let asc = folder.file("a.asc", text + "End TriggerBlock\r\n");
    let report = json(&[&asc, "--from", "2.5", "--to", "5"]);
    assert_eq!(number(&report, "/interfaces/0/syncs"), 3.0);
    assert_eq!(number(&report, "/outside"), 7.0);
    assert_eq!(
        number(&report, "/interfaces/0/first_time_s"),
        1_700_000_003.0
    );
    let report = json(&[&asc, "--from", "2023-11-14T22:13:28"]);
    assert_eq!(number(&report, "/interfaces/0/syncs"), 2.0);
}

#[test]
fn every_value_goes_into_a_table() {
    let folder = Folder::new();
    let log = folder.file(
        "a.log",
        rounds(1_700_000_000, 50, "can0") + "(1700000000.6) can0 705#05\n",
    );
    let csv = folder.path("a.csv");
    let report = json(&[&log, "--export", &csv]);
    assert_eq!(number(&report, "/export/rows"), 200.0);
    let mut table = csv::Reader::from_path(&csv).unwrap();
    let names = table.headers().unwrap().clone();
    let column = |name: &str| names.iter().position(|n| n == name).unwrap();
    let rows: Vec<_> = table.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 200);
    let of_b = &rows[1];
    assert_eq!(&of_b[column("time_s")], "1700000000.000000000");
    assert_eq!(&of_b[column("node_id")], "2");
    assert_eq!(&of_b[column("slope_x_deg")], "9.98");
    assert_eq!(&of_b[column("delta_x_deg")], "0.02");
    assert_eq!(&rows[0][column("delta_x_deg")], "");
    let parquet = folder.path("a.parquet");
    json(&[&log, "--export", &parquet]);
    let bytes = std::fs::read(&parquet).unwrap();
    assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
    assert!(bytes.windows(11).any(|name| name == b"slope_x_deg"));
    assert!(!folder.0.path().join("a.parquet.part").exists());
    refused(
        &[&log, "--export", &folder.path("no/folder.csv")],
        &["folder.csv"],
    );
}

#[test]
fn a_log_comes_out_as_another_kind_of_log_with_the_same_frames() {
    let folder = Folder::new();
    let log = folder.file("a.log", rounds(1_700_000_000, 50, "can0"));
    let asc = folder.path("b.asc");
    json(&[&log, "--export", &asc]);
    let back = folder.path("c.log");
    json(&[&asc, "--export", &back]);
    let read = |path: &str| std::fs::read_to_string(path).unwrap();
    assert!(read(&asc).starts_with("date Tue Nov 14 10:13:20.000 pm 2023\r\n"));
    assert_eq!(read(&back), read(&log));
    refused(
        &[&log, "--export", &log],
        &["a.log", "is read by this replay"],
    );
}

#[test]
fn another_node_is_decoded_by_its_data_sheet() {
    let folder = Folder::new();
    let sheet = "[DeviceInfo]\r\nProductName=Encoder\r\n[1800sub1]\r\nDataType=7\r\n\
        DefaultValue=$NODEID+0x180\r\n[1A00sub0]\r\nDefaultValue=01\r\n[1A00sub1]\r\n\
        DefaultValue=0x60040020\r\nodd\r\n[6004]\r\nParameterName=Position value\r\nDataType=4\r\n";
    let eds = folder.file("encoder.eds", sheet);
    let text = rounds(1_700_000_000, 10, "can0") + "(1700000000.2) can0 185#FEFFFFFF\n";
    let log = folder.file("a.log", text + "(1700000000.3) can0 185#0A000000\n");
    let csv = folder.path("a.csv");
    let report = json(&[&log, "--eds", &format!("{eds}@5"), "--export", &csv]);
    assert_eq!(report["devices"][0]["signals"][0]["name"], "Position value");
    assert_eq!(number(&report, "/devices/0/signals/0/min"), -2.0);
    assert_eq!(number(&report, "/devices/0/signals/0/max"), 10.0);
    assert_eq!(number(&report, "/devices/0/warnings/0/line"), 10.0);
    assert_eq!(
        number(&report, "/interfaces/0/instruments/0/delta/0/count"),
        10.0
    );
    let table = std::fs::read_to_string(&csv).unwrap();
    assert!(
        table
            .lines()
            .next()
            .unwrap()
            .ends_with(",node5_position_value")
    );
    assert!(table.lines().last().unwrap().ends_with(",10"));
    refused(
        &[&log, "--eds", &eds],
        &["encoder.eds", "does not name its node"],
    );
}

/// Peak memory of a replay of so many bytes through its standard input, kB.
#[cfg(target_os = "linux")]
fn peak_kb(bytes: usize) -> u64 {
    let mut replay = plumb(&["replay", "--json", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = replay.stdin.take().unwrap();
    let block = rounds(1_700_000_000, 2000, "can0");
    let mut written = 0;
    while written < bytes {
        input.write_all(block.as_bytes()).unwrap();
        written += block.len();
    }
    // All but what is in the pipe has been read by now.
    let status = std::fs::read_to_string(format!("/proc/{}/status", replay.id())).unwrap();
    let peak = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .unwrap();
    let peak = peak.trim().trim_end_matches(" kB").parse().unwrap();
    drop(input);
    let mut out = String::new();
    replay
        .stdout
        .take()
        .unwrap()
        .read_to_string(&mut out)
        .unwrap();
    assert!(replay.wait().unwrap().success());
    let report: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(
        number(&report, "/frames"),
        (written / block.len() * 10_000) as f64
    );
    peak
}

#[cfg(target_os = "linux")]
#[test]
fn memory_does_not_grow_with_the_log() {
    let (short, long) = (peak_kb(10 << 20), peak_kb(100 << 20));
    println!("peak memory: {short} kB at 10 MiB, {long} kB at 100 MiB");
    assert!(long < short + 1000, "{short} kB, then {long} kB");
}

#[test]
fn a_log_goes_onto_a_bus_at_its_own_pace() {
    let (folder, served) = (Folder::new(), Served::start(&["--uncalibrated"]));
    let mut text = String::new();
    for frame in 0..51 {
        writeln!(
            text,
            "(1700000000.{:06}) can0 123#{frame:02X}",
            frame * 19_600
        )
        .unwrap();
    }
    let log = folder.file("a.log", &text);
    let mut listener = Listener::join(&served.bus());
    let onto = ["--onto", &served.bus()];
    // 0.98 s at twice the speed, and what the machine makes of it: the best of some counts, since a
    // busy one makes single plays longer and none shorter.
    let mut play = || {
        let played = json(&[&log, onto[0], onto[1], "--speed", "2"]);
        assert_eq!(number(&played, "/sent"), 51.0);
        assert_eq!(listener.counts(0x123, 51), 51);
        let elapsed = number(&played, "/elapsed_s");
        assert!(elapsed >= 0.49, "{elapsed}");
        elapsed
    };
    assert!((0..10).any(|_| play() < 3.0));
    // A gap of an hour is over at once, and what comes of it is told.
    let gap = folder.file(
        "gap.log",
        "(1700000000.0) can0 123#00\n(1700003600.0) can0 123#01\n",
    );
    let played = json(&[&gap, onto[0], onto[1], "--skip-gaps", "0.1"]);
    assert_eq!(number(&played, "/sent"), 2.0);
    assert!(number(&played, "/elapsed_s") < 30.0);
    // A step for each Enter, and the end at the end of the input.
    let mut step = plumb(&["replay", &log, "--json", "--step", onto[0], onto[1]])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    step.stdin.take().unwrap().write_all(b"\n\n\nq\n").unwrap();
    let (status, out, _) = said(&step.wait_with_output().unwrap());
    let report: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((status, number(&report, "/sent")), (Some(0), 3.0));
    let two = folder.file("two.log", "(1.0) can0 123#00\n(1.1) can1 123#01\n");
    refused(&[&two, onto[0], onto[1]], &["can0", "can1", "--channel"]);
}

#[test]
fn a_log_that_is_played_for_ever_ends_with_the_bus() {
    let (folder, served) = (Folder::new(), Served::start(&["--uncalibrated"]));
    let log = folder.file(
        "a.log",
        "(1700000000.0) can0 123#00\n(1700000000.02) can0 123#01\n",
    );
    let mut listener = Listener::join(&served.bus());
    let mut endless = plumb(&["replay", &log, "--loop", "--onto", &served.bus()])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    assert!(listener.counts(0x123, 5) > 4);
    assert!(endless.try_wait().unwrap().is_none());
    drop(served);
    let (status, _, err) = said(&endless.wait_with_output().unwrap());
    assert_eq!(status, Some(2), "{err}");
    assert!(err.contains("frames of the log"), "{err}");
}

/// Names of all fields, also of those inside of others.
fn fields(value: &Value, names: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) => {
            for (name, value) in object {
                names.insert(name.clone());
                fields(value, names);
            }
        }
        Value::Array(values) => values.iter().for_each(|value| fields(value, names)),
        _ => {}
    }
}

#[test]
fn every_field_of_plumb_log_is_in_the_page() {
    let folder = Folder::new();
    let log = rounds(1_700_000_000, 300, "can0")
        + "(1700000003.100000) can0 081#00FF8100000000\n(1700000003.200000) can0 701#05\n"
        + "(1700000003.000000) can0 080#\ncut\n(1700000003.300000) can0 185#0102030405060708\n";
    let log = folder.file("a.log", log);
    let sheet = "[1800sub1]\nDataType=7\nDefaultValue=0x185\n[1A00sub0]\nDefaultValue=01\nodd\n\
        [1A00sub1]\nDefaultValue=0x60040020\n[6004]\nParameterName=Position\nDataType=4\n";
    let eds = folder.file("encoder.eds", sheet) + "@5";
    let (value, _) = json_with(2, &[&log, "--eds", &eds]);
    let mut names = BTreeSet::new();
    fields(&value, &mut names);
    assert!(names.len() > 60, "{names:?}");
    let page = include_str!("../../docs/logs.md");
    let missing = names
        .iter()
        .filter(|name| !page.contains(&format!("`{name}`")));
    assert_eq!(missing.collect::<Vec<_>>(), Vec::<&String>::new());
}
