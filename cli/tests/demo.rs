//! `plumb demo` from the outside: its exit status, its report, and what it does when it cannot.

use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

/// A folder of this test's own, empty.
fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("demo {name}"));
    let _ = std::fs::remove_dir_all(&path);
    let _ = std::fs::remove_file(&path);
    path
}

fn demo(arguments: &[&str], out: &PathBuf) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plumb"));
    command.arg("demo").args(arguments).arg("--out").arg(out);
    command.output().unwrap()
}

const SHORT: [&str; 4] = ["--units", "1", "--days", "0"];

#[test]
fn the_same_seed_gives_the_same_report_with_every_key() {
    let folders = ["one", "two"].map(folder);
    let texts = folders.each_ref().map(|out| {
        let run = demo(&SHORT, out);
        assert_eq!(
            run.status.code(),
            Some(0),
            "{}",
            String::from_utf8_lossy(&run.stderr)
        );
        assert!(run.stderr.is_empty(), "quiet when not on a terminal");
        std::fs::read_to_string(out.join("report.json")).unwrap()
    });
    assert_eq!(texts[0], texts[1]);
    let report: Value = serde_json::from_str(&texts[0]).unwrap();
    assert_eq!(report["within_specification"], true);
    for (list, keys) in [
        (
            "static",
            "mode axis node angles rmse_deg max_deg mean_node_difference_deg",
        ),
        (
            "dynamic",
            "mode axis node lever_arm_cm rmse_deg rmse_aligned_deg latency_ms",
        ),
    ] {
        let rows = report[list].as_array().unwrap();
        assert!(rows.len() >= 8, "{list}");
        for (row, key) in rows
            .iter()
            .flat_map(|r| keys.split(' ').map(move |k| (r, k)))
        {
            assert!(!row[key].is_null(), "{list}: {key}");
        }
    }
    assert!(folders[0].join("report.html").is_file());
}

#[test]
fn the_week_has_a_row_for_each_day_and_finds_the_fault_on_the_fifth() {
    let out = folder("week");
    assert_eq!(
        demo(&["--units", "1", "--days", "5", "--json"], &out)
            .status
            .code(),
        Some(0)
    );
    let text = std::fs::read_to_string(out.join("report.json")).unwrap();
    let report: Value = serde_json::from_str(&text).unwrap();
    let week = report["week"].as_array().unwrap();
    assert_eq!(week.len(), 10);
    for row in week.iter().filter(|row| row["mode"] == "product") {
        let fifth = row["day"] == 5;
        assert_eq!(row["faults"].as_u64().unwrap() > 0, fifth, "{row}");
        assert_eq!(row["warnings"].as_u64().unwrap() > 0, fifth, "{row}");
        let cured = row["outcome"] == "physical fault, supply checked and reset";
        assert_eq!(cured, fifth, "{row}");
    }
}

#[test]
fn as_printed_is_a_mode_of_its_own_and_only_when_asked_for() {
    let out = folder("printed");
    let run = demo(
        &[SHORT.as_slice(), &["--as-printed", "--details"]].concat(),
        &out,
    );
    assert_eq!(run.status.code(), Some(0));
    let shown = String::from_utf8(run.stdout).unwrap();
    for title in ["As printed", "Table I:", "Table II:", "Table III:"] {
        assert!(shown.contains(title), "{title}: {shown}");
    }
    let text = std::fs::read_to_string(out.join("report.json")).unwrap();
    let report: Value = serde_json::from_str(&text).unwrap();
    let aligned = |mode: &str| {
        let rows = report["dynamic"].as_array().unwrap().iter();
        let mut rows = rows.filter(|row| row["mode"] == mode && row["lever_arm_cm"] == 0);
        rows.next().unwrap()["rmse_aligned_deg"].as_f64().unwrap()
    };
    // Table III has 0.085 to 0.100 deg; a nearest point of a 1 deg table alone has 0.289.
    assert!(aligned("paper") < 0.11 && aligned("as printed") > 0.2);
    let passed = |row: &&Value| row["mode"] == "paper" && row["accepted"] == true;
    let rows = report["calibration"].as_array().unwrap();
    assert_eq!(rows.iter().filter(passed).count(), 2);
}

#[test]
fn options_that_do_not_fit_together_are_refused() {
    let run = demo(&["--json", "--details"], &folder("both"));
    assert_eq!(run.status.code(), Some(2));
    assert!(run.stdout.is_empty());
    let said = String::from_utf8(run.stderr).unwrap();
    assert!(
        said.contains("--details") && said.contains("--json"),
        "{said}"
    );
}

#[test]
fn a_folder_that_is_a_file_costs_no_run_and_is_named() {
    let out = folder("file");
    std::fs::write(&out, "mine").unwrap();
    let run = demo(&["--units", "10000"], &out);
    assert_eq!(run.status.code(), Some(2));
    let said = String::from_utf8(run.stderr).unwrap();
    assert_eq!(said.lines().count(), 1);
    assert!(
        said.contains("demo file") && said.contains("--out"),
        "{said}"
    );
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "mine");
}

#[test]
fn a_reader_that_has_had_enough_is_no_error() {
    let out = folder("closed");
    let mut command = Command::new(env!("CARGO_BIN_EXE_plumb"));
    command
        .arg("demo")
        .args(SHORT)
        .arg("--json")
        .arg("--out")
        .arg(&out);
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let run = child.wait_with_output().unwrap();
    assert_eq!(
        run.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    assert!(out.join("report.json").is_file());
}

#[test]
fn impossible_numbers_are_refused() {
    for bad in [
        ["--units", "0"],
        ["--units", "-1"],
        ["--days", "x"],
        ["--seed", "1.5"],
    ] {
        let run = demo(&bad, &folder("bad"));
        assert_eq!(run.status.code(), Some(2), "{bad:?}");
    }
}
