//! Input that can't be used: one sentence on stderr that names the file, exit status 2, and
//! nothing written.

use std::io::Write;

use flate2::{Compression, write::GzEncoder};

use super::bench::*;

/// Runs and expects a refusal; the sentence.
fn refused(folder: &Folder, arguments: &[&str], names_file: &str, reason: &str) -> String {
    let before = folder.names();
    let output = replay(folder, arguments);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(
        stderr.starts_with("plumb: ") && stderr.ends_with('\n'),
        "{stderr}"
    );
    assert!(stderr.contains(names_file), "no {names_file} in: {stderr}");
    assert!(stderr.contains(reason), "no `{reason}` in: {stderr}");
    assert!(!stderr.contains("panicked"));
    assert!(output.stdout.is_empty());
    assert_eq!(folder.names(), before, "something was written");
    stderr
}

fn good() -> String {
    SQUARE.record(up)
}

/// Changes the line of each row.
fn rows(change: impl Fn(usize, &str) -> String) -> String {
    with_lines(&good(), |number, line| {
        (number > 1).then(|| change(number, line))
    })
}

fn gzip(text: &str) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(text.as_bytes()).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn rows_that_can_not_be_used() {
    let folder = Folder::new("bad-rows");
    let (time, rest) = (
        |line: &str| line.split_once(',').unwrap().0.to_owned(),
        |line: &str| line.split_once(',').unwrap().1.to_owned(),
    );
    let cases = [
        (
            "missing.csv",
            rows(|_, l| l.rsplit_once(',').unwrap().0.to_owned() + ","),
            "line 2: more rows skipped than the 0 kept",
        ),
        (
            "cut.csv",
            rows(|_, l| l.rsplit_once(',').unwrap().0.to_owned()),
            "mend the number of cells in each row",
        ),
        (
            "zeros.csv",
            rows(|_, l| time(l) + ",0,0,0"),
            "the sensor did not answer",
        ),
        (
            "repeated.csv",
            rows(|_, l| "5.0,".to_owned() + &rest(l)),
            "repeated timestamp",
        ),
        (
            "backward.csv",
            rows(|n, l| format!("{:.3},{}", 900.0 - n as f64 / 100.0, rest(l))),
            "mend the time column",
        ),
        (
            "words.csv",
            rows(|_, l| l.replace('.', ":")),
            "cell that is no number",
        ),
        (
            "few.csv",
            good().lines().take(30).collect::<Vec<_>>().join("\n"),
            "only 29 usable rows",
        ),
    ];
    for (name, text, reason) in cases {
        let file = folder.file(name, text);
        refused(&folder, &[&file], name, reason);
    }
}

#[test]
fn headers_and_units_that_can_not_be_used() {
    let folder = Folder::new("bad-header");
    let header = |new: &str| with_lines(&good(), |n, _| (n == 1).then(|| new.to_owned()));
    let cases = [
        (
            "metres.csv",
            header("time_s,ax_mps2,ay_mps2,az_mps2"),
            "line 1: the length at standstill is",
        ),
        (
            "counts.csv",
            header("time_s,ax_lsb,ay_lsb,az_lsb"),
            "--lsb-per-g",
        ),
        (
            "column.csv",
            header("time_s,ax_g,ay_g,a_g"),
            "line 1: no column",
        ),
        (
            "time.csv",
            header("time_ms,ax_g,ay_g,az_g"),
            "the time looks as if it were `time_s`",
        ),
        ("unit.csv", header("time_s,ax,ay,az"), "has no unit"),
        ("mixed.csv", header("time_s,ax_g,ay_g,az_lsb"), "line 1"),
        ("twice.csv", header("time_s,ax_g,ay_g,ax_g"), "line 1"),
        (
            "numbers.csv",
            good().lines().skip(1).collect::<Vec<_>>().join("\n"),
            "line 1: holds numbers where the header should be",
        ),
    ];
    for (name, text, reason) in cases {
        let file = folder.file(name, text);
        refused(&folder, &[&file], name, reason);
    }
}

#[test]
fn files_that_are_no_recording() {
    let folder = Folder::new("bad-file");
    let whole = gzip(&good());
    let mut damaged = whole.clone();
    let end = damaged.len() - 6;
    damaged[end] ^= 0x55;
    let cases: [(&str, Vec<u8>, &str); 6] = [
        (
            "truncated.csv.gz",
            whole[..whole.len() / 2].to_vec(),
            "the gzip stream breaks off",
        ),
        ("damaged.csv.gz", damaged, "the gzip stream is damaged"),
        ("empty.csv", Vec::new(), "holds no line"),
        ("comments.csv", b"# nothing\n\n".to_vec(), "holds no line"),
        (
            "binary.csv",
            (0..4096u32).map(|i| (i * 37 % 256) as u8).collect(),
            "is no text",
        ),
        (
            "header.csv",
            b"time_s,ax_g,ay_g,az_g\n".to_vec(),
            "only 0 usable rows",
        ),
    ];
    for (name, bytes, reason) in cases {
        let file = folder.file(name, bytes);
        refused(&folder, &[&file], name, reason);
    }
    refused(
        &folder,
        &[&folder.path("none.csv")],
        "none.csv",
        "there is no such file",
    );
    refused(
        &folder,
        &[folder.0.to_str().unwrap()],
        "replay-bad-file",
        "--out is for recordings of sensors",
    );
}

#[test]
fn a_log_that_is_not_there_was_refused_its_options() {
    let folder = Folder::new("missing-log");
    let (log, table) = (folder.path("none.log"), folder.path("table.csv"));
    for option in [["--export", &table], ["--from", "5"], ["--nodes", "1,2"]] {
        let all = [&[log.as_str()], &option[..]].concat();
        refused(&folder, &all, "none.log", "there is no such file");
    }
}

#[test]
fn poses_that_do_not_make_a_calibration() {
    let folder = Folder::new("bad-poses");
    let few = SQUARE.record(|i| up(i.min(4 * 500)));
    let few = folder.file("few.csv", few);
    refused(
        &folder,
        &[&few],
        "few.csv",
        "it takes 9; add poses with gravity near",
    );
    // Eleven poses, all about one axis: nothing is known of the others.
    let flat = SQUARE.record(|i| {
        let turn = (i / 600) as f64 * 0.5 + ((i % 600) as f64 - 400.0).max(0.0) / 200.0 * 0.5;
        [turn.sin(), 0.0, turn.cos()]
    });
    let flat = folder.file("flat.csv", flat);
    let sentence = refused(&folder, &[&flat], "flat.csv", "add poses with gravity near");
    assert!(
        sentence.contains("+y, -y") && sentence.contains("too alike"),
        "{sentence}"
    );
    let good = folder.file("good.csv", good());
    refused(
        &folder,
        &[&good, "--from", "reference"],
        "good.csv",
        "has no reference columns",
    );
}

#[test]
fn pairs_that_do_not_belong_together() {
    let folder = Folder::new("bad-pairs");
    let one = folder.file("one.csv", good());
    let late = folder.file(
        "late.csv",
        rows(|_, line| {
            let (time, rest) = line.split_once(',').unwrap();
            format!("{:.3},{rest}", time.parse::<f64>().unwrap() + 5000.0)
        }),
    );
    refused(
        &folder,
        &[&one, &late],
        "late.csv",
        "its time runs from 5000.000 s",
    );
    let other = folder.file("other.csv", TURNED.record(|i| up((i + 2000) % SAMPLES)));
    refused(
        &folder,
        &[&one, &other],
        "other.csv",
        "give two recordings of one run",
    );
    refused(&folder, &[&one, &one], "one.csv", "given as both channels");
    refused(
        &folder,
        &[&one, &late, &other],
        "other.csv",
        "a third recording",
    );
    refused(
        &folder,
        &[&one, "--lsb-per-g", "-3"],
        "one.csv",
        "--lsb-per-g -3 is no scale",
    );
}

#[test]
fn calibration_files_that_can_not_be_used() {
    let folder = Folder::new("bad-calibration");
    let one = folder.file("one.csv", good());
    let kept = folder.path("kept.json");
    replay_well(&folder, &[&one, "--save-calibration", &kept]);
    std::fs::remove_dir_all(folder.0.join("out")).unwrap();
    let text = std::fs::read_to_string(&kept).unwrap();
    let cases = [
        (
            "version.json",
            text.replace("\"version\": 1", "\"version\": 2"),
            "version 2 can't be read here",
        ),
        (
            "crc.json",
            text.replace("\"poses\": 14", "\"poses\": 15"),
            "the CRC-32 of its channels is",
        ),
        (
            "format.json",
            text.replace("plumb-calibration", "others"),
            "`format` is not",
        ),
        (
            "half.json",
            text[..text.len() / 2].to_owned(),
            "is no calibration file",
        ),
        ("none.json", String::new(), "is no calibration file"),
        (
            "impossible.json",
            impossible(&text),
            "an offset is over 1 g",
        ),
        (
            "counts.json",
            resealed(&text, |c| c[0]["numbers_per_g"] = 2048.into()),
            "was made for 2048 numbers per g",
        ),
    ];
    for (name, contents, reason) in cases {
        let file = folder.file(name, contents);
        refused(&folder, &[&one, "--calibration", &file], name, reason);
    }
    let other = folder.file("other.csv", TURNED.record(up));
    let reason = "holds 1 channels for 2 recordings";
    refused(
        &folder,
        &[&one, &other, "--calibration", &kept],
        "kept.json",
        reason,
    );
    let missing = folder.path("missing.json");
    refused(
        &folder,
        &[&one, "--calibration", &missing],
        "missing.json",
        "there is no such file",
    );
}

/// The calibration with changed channels and the CRC that belongs to them.
fn resealed(text: &str, change: impl Fn(&mut serde_json::Value)) -> String {
    let mut file: serde_json::Value = serde_json::from_str(text).unwrap();
    change(&mut file["channels"]);
    let mut crc = flate2::Crc::new();
    crc.update(file["channels"].to_string().as_bytes());
    file["crc32"] = format!("{:08x}", crc.sum()).into();
    file.to_string()
}

fn impossible(text: &str) -> String {
    resealed(text, |channels| {
        channels[0]["offset_g"][1] = 1.5.into();
        channels[0]["offset_q26"][1] = (1.5 * f64::from(1 << 26)).into();
        let steps = channels[0]["offset_q26"][1].as_f64().unwrap() as i64;
        channels[0]["offset_q26"][1] = steps.into();
    })
}

#[test]
fn places_that_can_not_be_written() {
    let folder = Folder::new("bad-places");
    let one = folder.file("one.csv", good());
    refused(
        &folder,
        &[&one, "--save-calibration", &one],
        "one.csv",
        "is read by this replay",
    );
    assert_eq!(std::fs::read_to_string(&one).unwrap(), good());
    let nowhere = folder.path("nowhere/kept.json");
    refused(
        &folder,
        &[&one, "--save-calibration", &nowhere],
        "kept.json",
        "can't be written",
    );
    // A file stands where the folder should be: neither report nor calibration is left behind.
    folder.file("out", "taken");
    let kept = folder.path("kept.json");
    refused(
        &folder,
        &[&one, "--save-calibration", &kept],
        "out",
        "--out",
    );
    assert_eq!(folder.names(), ["one.csv", "out"]);
}

#[test]
fn a_calibration_of_another_sensor_or_an_impossible_one() {
    let folder = Folder::new("other-sensor");
    let one = folder.file("one.csv", good());
    let kept = folder.path("kept.json");
    replay_well(&folder, &[&one, "--save-calibration", &kept]);
    std::fs::remove_dir_all(folder.0.join("out")).unwrap();
    let mut sensor = SQUARE;
    sensor.matrix = sensor.matrix.map(|row| row.map(|v| 1.08 * v));
    let other = folder.file("other.csv", sensor.record(up));
    let sentence = refused(
        &folder,
        &[&other, "--calibration", &kept],
        "kept.json",
        "it belongs to another sensor",
    );
    assert!(sentence.contains("other.csv"), "{sentence}");
    let text = std::fs::read_to_string(&kept).unwrap();
    let mirrored = resealed(&text, |channels| {
        for key in ["matrix", "matrix_q30"] {
            for column in 0..3 {
                let cell = &mut channels[0][key][2][column];
                *cell = match cell.as_i64() {
                    Some(steps) => (-steps).into(),
                    None => (-cell.as_f64().unwrap()).into(),
                };
            }
        }
    });
    let mirrored = folder.file("mirrored.json", mirrored);
    refused(
        &folder,
        &[&one, "--calibration", &mirrored],
        "mirrored.json",
        "the matrix mirrors",
    );
}

#[test]
#[cfg(unix)]
fn a_calibration_is_saved_in_a_regular_file_or_not_at_all() {
    let folder = Folder::new("irregular");
    let pipe = folder.path("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.is_ok_and(|status| status.success()), "no mkfifo here");
    let loose = folder.path("loose");
    std::os::unix::fs::symlink(folder.path("nowhere"), &loose).unwrap();
    let round = folder.path("round");
    std::os::unix::fs::symlink(&pipe, &round).unwrap();
    std::fs::create_dir(folder.path("inside")).unwrap();
    // Before any work: the recording is not even there.
    let none = folder.path("none.csv");
    for (place, reason) in [
        (&pipe, "it is no regular file"),
        (&round, "it is no regular file"),
        (&loose, "the link leads nowhere"),
        (&folder.path("inside"), "it is a folder"),
    ] {
        refused(
            &folder,
            &[&none, "--save-calibration", place],
            place,
            reason,
        );
    }
}

#[test]
fn other_separators_and_names_that_break_lines() {
    let folder = Folder::new("separators");
    for (name, separator, reason) in [
        (
            "semicolon.csv",
            ";",
            "the columns are separated by ';'; use commas",
        ),
        (
            "tab.csv",
            "\t",
            "the columns are separated by '\\t'; use commas",
        ),
    ] {
        let text = good().replace(',', separator).replace('.', ",");
        let file = folder.file(name, text);
        refused(&folder, &[&file], name, reason);
    }
    let decimals = with_lines(&good(), |n, line| (n > 1).then(|| line.replace('.', ",")));
    let file = folder.file("decimals.csv", decimals);
    refused(
        &folder,
        &[&file],
        "decimals.csv",
        "with points and no commas",
    );
    let none = folder.path("two\nlines\u{1b}[2J.csv");
    refused(
        &folder,
        &[&none],
        "two\\nlines\\u{1b}[2J.csv",
        "there is no such file",
    );
}
