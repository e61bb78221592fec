//! `plumb calibrate` and `plumb verify` from the outside, against the nodes of `plumb serve`.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStderr, ChildStdin, Command, Stdio};
use std::time::{Duration, Instant};

use super::stand::{Bench, number, said};

/// A bench at which a calibration is watched.
fn bench(more: &[&str]) -> Bench {
    Bench::new("20", more)
}

fn calibrate(bench: &Bench, more: &[&str]) -> Command {
    let mut command = bench.command(&["calibrate", "--out", &bench.path("report")]);
    command.args(more);
    command
}

fn by_motor(bench: &Bench, more: &[&str]) -> Command {
    let mut command = calibrate(bench, &["--motor", &bench.motor, "--country", "IT"]);
    command.args(more);
    command
}

/// A socketcand client that has sent NMT "start" to all nodes.
fn started(bench: &Bench) -> TcpStream {
    let mut client = TcpStream::connect(&bench.bus).unwrap();
    write!(client, "< open plumb >< rawmode >").unwrap();
    std::thread::sleep(Duration::from_millis(100));
    write!(client, "< send 0 2 1 0 >").unwrap();
    client
}

/// The last state that the node's heartbeat has told within a while, which lasts until it has told
/// one on a machine that is busy.
fn state(client: &mut TcpStream, node: u8) -> Option<String> {
    let from = Instant::now();
    let mark = format!("frame 70{node} ");
    let (enough, longest) = (Duration::from_millis(500), Duration::from_secs(60));
    let patience = Some(Duration::from_millis(50));
    client.set_read_timeout(patience).unwrap();
    let mut text = String::new();
    let mut bytes = [0; 4096];
    while from.elapsed() < enough || !text.contains(&mark) && from.elapsed() < longest {
        if let Ok(count) = client.read(&mut bytes) {
            text += &String::from_utf8_lossy(&bytes[..count]);
        }
    }
    let (_, last) = text.rsplit_once(&mark)?;
    last.split_whitespace().nth(1).map(str::to_owned)
}

/// The node's heartbeat tells this state, at once but for what a busy machine makes of it.
fn assert_becomes(client: &mut TcpStream, node: u8, wanted: &str) {
    let from = Instant::now();
    loop {
        let found = state(client, node);
        if found.as_deref() == Some(wanted) {
            return;
        }
        let limit = Duration::from_secs(60);
        assert!(from.elapsed() < limit, "node {node}: {found:?}");
    }
}

/// Both nodes at work for a while, with a SYNC from a master.
fn put_to_work(bench: &Bench) {
    let mut client = started(bench);
    for _ in 0..20 {
        write!(client, "< send 80 0 >").unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Slope X of node 1 reads 1.5 deg more than measured.
fn shift_a_slope(bench: &Bench) {
    let offset = "slope-long.differential-offset";
    let set = bench
        .command(&["set", offset, "1.5deg", "--node", "1"])
        .output();
    let (status, _, err) = said(&set.unwrap());
    assert_eq!(status, Some(0), "{err}");
}

#[test]
fn a_motor_calibrates_both_channels_and_verify_accepts_the_report() {
    let bench = bench(&["--uncalibrated"]);
    // A shift of a slope is none of the calibration's, and was not mentioned.
    shift_a_slope(&bench);
    // What it was like before must not show: readings once stood still at the last SYNC.
    put_to_work(&bench);
    let before = bench.kept();
    let run = by_motor(&bench, &["--step", "15", "--json"])
        .output()
        .unwrap();
    let (status, out, err) = said(&run);
    assert_eq!(status, Some(0), "{err}");
    assert_eq!(out.lines().count(), 1);
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(report["format"], "plumb-calibrate");
    for channel in 0..2 {
        let of = |key: &str| format!("/channels/{channel}/{key}");
        assert!(number(&report, &of("residual_deg")) < 0.05);
        assert_eq!(
            report["channels"][channel]["as_left"]
                .as_array()
                .unwrap()
                .len(),
            16
        );
        assert!(number(&report, &of("expanded_uncertainty_deg")) < 0.05);
    }
    assert_eq!(number(&report, "/channels/0/presented/0/offset_deg"), 1.5);
    assert_eq!(report["channels"][1].get("presented"), None);
    let shown = "node 1: slope X has an offset of 1.50 deg, from before this calibration";
    assert!(err.contains(shown), "{err}");
    let largest = number(&report, "/decision/largest_error_deg");
    assert!(largest > 0.0 && largest < 0.1, "{largest}");
    // The live residuals of every stand.
    assert_eq!(
        err.lines()
            .filter(|line| line.starts_with("slope "))
            .count(),
        2 * 26 + 16
    );
    let found = fs::read_to_string(bench.path("report/as-found.json")).unwrap();
    assert_eq!(found, before);
    let (status, out, err) = bench.verify(&bench.path("report/dcc.xml"));
    assert_eq!(status, Some(0), "{out} {err}");
    let (status, _, err) = bench.verify(&bench.path("report/report.json"));
    assert_eq!(status, Some(2), "{err}");
    assert!(err.contains("give the dcc.xml"), "{err}");
    let changed = fs::read_to_string(bench.path("report/dcc.xml")).unwrap();
    let changed = changed.replace("not stated", "somebody");
    fs::write(bench.path("changed.xml"), changed).unwrap();
    let (status, out, _) = bench.verify(&bench.path("changed.xml"));
    assert_eq!(status, Some(1));
    assert!(out.contains("another report belongs to it"), "{out}");
    let as_found = bench.path("report/as-found.json");
    let restore = bench
        .command(&["calibrate", "--restore", &as_found])
        .output();
    let (status, _, err) = said(&restore.unwrap());
    assert_eq!(status, Some(0), "{err}");
    let (status, out, _) = bench.verify(&bench.path("report/dcc.xml"));
    assert_eq!(status, Some(1));
    assert!(out.contains("another calibration is in force"), "{out}");
}

/// Where the housing stands in each pose: pitch and roll. The surface is tilted by half a degree,
/// and what leans leans a few degrees off.
const STANDS: [(f64, f64); 15] = [
    (0.3, -0.4),
    (-0.3, 0.4),
    (0.0, 89.6),
    (0.0, 90.4),
    (0.0, -90.2),
    (89.8, 0.0),
    (-90.0, 0.0),
    (0.0, 179.6),
    (0.0, 41.0),
    (0.0, -48.0),
    (42.0, 0.0),
    (-47.0, 0.0),
    (41.0, 47.0),
    (0.2, 0.3),
    (-0.2, -0.3),
];

/// Puts the housing down as it is asked for, and confirms it by a line where there are `answers`.
fn put_down(bench: &mut Bench, asked: ChildStderr, answers: Option<ChildStdin>) -> String {
    put_down_by_way_of(&["level", "roll 20", "level"], bench, asked, answers)
}

/// The same with these words between two poses.
fn put_down_by_way_of(
    by_way_of: &[&str],
    bench: &mut Bench,
    asked: ChildStderr,
    mut answers: Option<ChildStdin>,
) -> String {
    bench.word("rate 400");
    let mut at = 0;
    let mut all = String::new();
    for line in BufReader::new(asked).lines().map_while(Result::ok) {
        all += &format!("{line}\n");
        // On a busy machine the pose between two stands lasts long enough to be taken for one; it
        // is asked for again.
        if line.starts_with("  that is another pose") {
            at -= 1;
        }
        if !(line.starts_with("pose ") || line.starts_with("verification, ")) {
            continue;
        }
        let Some((pitch, roll)) = STANDS.get(at) else {
            break;
        };
        at += 1;
        if answers.is_none() && line.starts_with("pose 1 ") {
            continue;
        }
        // Up, so that a housing that comes back to where it stood has moved all the same.
        for words in by_way_of {
            bench.word(words);
            bench.pass(0.15);
        }
        bench.word(&format!("roll {roll}"));
        bench.word(&format!("pitch {pitch}"));
        bench.pass(0.2);
        if let Some(answers) = &mut answers {
            writeln!(answers).unwrap();
        }
    }
    all
}

/// A calibration by hand that waits for its person.
fn by_hand(bench: &Bench) -> Child {
    let mut run = calibrate(bench, &["--by-hand", "--json"]);
    run.stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    run.spawn().unwrap()
}

#[test]
fn a_person_calibrates_in_thirteen_poses() {
    let mut bench = bench(&["--uncalibrated"]);
    let mut run = by_hand(&bench);
    let (asked, answers) = (run.stderr.take().unwrap(), run.stdin.take());
    let told = put_down(&mut bench, asked, answers);
    let output = run.wait_with_output().unwrap();
    let (status, out, _) = said(&output);
    assert_eq!(status, Some(0), "{told}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(report["method"], "by-hand");
    assert_eq!(report["channels"][1]["poses"].as_array().unwrap().len(), 13);
    let tilt = number(&report, "/faces/base_surface_deg");
    assert!((tilt - 0.5).abs() < 0.05, "{tilt}");
    let largest = number(&report, "/decision/largest_error_deg");
    assert!(largest < 0.05, "{largest}");
    let (status, out, _) = bench.verify(&bench.path("report/dcc.xml"));
    assert_eq!(status, Some(0), "{out}");
    // And the instrument agrees with the motor within what is promised.
    let check = by_motor(
        &bench,
        &["--step", "30", "--nodes", "1", "--force", "--json"],
    );
    let check = { check }.output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&check.stdout).unwrap();
    let errors = report["channels"][0]["as_found"].as_array().unwrap().iter();
    let errors = errors.filter(|p| p["reference_deg"].as_f64().unwrap().abs() < 80.0);
    let errors: Vec<f64> = errors.map(|p| p["error_deg"].as_f64().unwrap()).collect();
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    assert!(rms < 0.08, "{rms}: {errors:?}");
}

/// The largest U of the gains that a report states for a channel, %, and how many have one.
fn gains(channel: &serde_json::Value) -> (f64, usize) {
    let all = channel["gyroscope"].as_array().unwrap().iter();
    let gains = all.filter(|c| c["unit"] == "%" && c["name"] != "Scale, slope");
    let stated: Vec<f64> = gains.filter_map(|c| c["expanded"].as_f64()).collect();
    (stated.iter().copied().fold(0.0, f64::max), stated.len())
}

/// A bench whose instrument has gyroscopes, at this speed.
///
/// A node is followed while it is looked at four times in a second of its own time. By hand each
/// turn counts, so the bench is slower there: on a busy machine, at speed 5, a look came too late.
fn dynamic(speed: &str, more: &[&str]) -> Bench {
    Bench::new(speed, &[&["--mode", "dynamic"], more].concat())
}

/// The channels of the report of a motor's run.
fn channels(bench: &Bench, more: &[&str]) -> Vec<serde_json::Value> {
    let options = ["--step", "30", "--tolerance", "1", "--json"];
    let mut run = by_motor(bench, &[&options, more].concat());
    let (status, out, err) = said(&run.output().unwrap());
    assert_eq!(status, Some(0), "{err}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    report["channels"].as_array().unwrap().clone()
}

#[test]
fn a_motor_calibrates_the_gyroscopes_too_and_the_report_states_their_uncertainty() {
    let bench = dynamic("3", &["--uncalibrated"]);
    for channel in channels(&bench, &[]) {
        let turns = &channel["gyroscope_turns"];
        assert_eq!(turns["refused"], serde_json::Value::Null);
        assert!(turns["used"].as_u64().unwrap() >= 20, "{turns}");
        assert!(turns["check_deg"].as_f64().unwrap() < 0.3, "{turns}");
        let (largest, count) = gains(&channel);
        assert_eq!(count, 9);
        assert!(largest > 0.01 && largest < 0.6, "{largest}");
    }
    let certificate = fs::read_to_string(bench.path("report/dcc.xml")).unwrap();
    assert!(certificate.contains("Turns for the gyroscope"));
    let scale = certificate.split("Scale, axis x, in %").nth(1).unwrap();
    let scale = scale.split("</dcc:quantity>").next().unwrap();
    assert!(scale.contains("si:expandedUncXMLList"), "{scale}");
    let (status, out, err) = bench.verify(&bench.path("report/dcc.xml"));
    assert_eq!(status, Some(0), "{out} {err}");
}

#[test]
fn a_frozen_gyroscope_and_one_of_a_wrong_scale_are_refused_and_take_no_part() {
    let mut bench = dynamic("5", &["--uncalibrated"]);
    bench.word("fault a rate-frozen");
    bench.word("fault b rate-scale 40");
    for (channel, why) in channels(&bench, &[])
        .iter()
        .zip(["0 of its turns", "contradict"])
    {
        let refused = channel["gyroscope_turns"]["refused"].as_str().unwrap();
        assert!(refused.contains(why), "{refused}");
        assert_eq!(channel["gyroscope"], serde_json::Value::Null);
    }
    let page = fs::read_to_string(bench.path("report/report.html")).unwrap();
    assert!(page.contains("its correction is as it was found"));
}

#[test]
fn a_gyroscope_that_takes_part_and_is_wrong_leaves_the_whole_calibration_as_it_was() {
    let mut bench = dynamic("5", &[]);
    let before = bench.kept();
    bench.word("fault b rate-scale 40");
    let options = ["--step", "30", "--nodes", "2", "--json"];
    let (status, out, err) = said(&by_motor(&bench, &options).output().unwrap());
    assert_eq!(status, Some(1), "{err}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    let refused = report
        .pointer("/channels/0/gyroscope_turns/refused")
        .unwrap();
    assert!(
        refused.as_str().unwrap().contains("contradict"),
        "{refused}"
    );
    assert_eq!(bench.kept(), before);
}

#[test]
fn turns_from_pose_to_pose_calibrate_the_gyroscopes_by_hand() {
    let mut bench = dynamic("1.5", &["--uncalibrated"]);
    let mut run = by_hand(&bench);
    let (asked, answers) = (run.stderr.take().unwrap(), run.stdin.take());
    // From pose to pose at once, which turns about z as well.
    let told = put_down_by_way_of(&[], &mut bench, asked, answers);
    let (status, out, _) = said(&run.wait_with_output().unwrap());
    assert_eq!(status, Some(0), "{told}");
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    for channel in report["channels"].as_array().unwrap() {
        let turns = &channel["gyroscope_turns"];
        assert_eq!(turns["refused"], serde_json::Value::Null, "{told}");
        let (largest, count) = gains(channel);
        println!("by hand: {} turns, U {largest:.2} %", turns["used"]);
        assert!(count == 9 && largest < 0.6, "{largest}");
        // The second pose is the first one, turned: there and back shows nothing.
        assert!(!turns["left_out"].as_array().unwrap().is_empty(), "{told}");
    }
}

#[test]
fn with_yes_the_sensor_tells_when_the_housing_was_moved() {
    let mut bench = bench(&[]);
    let (pitch, roll) = STANDS[0];
    bench.word(&format!("roll {roll}"));
    bench.word(&format!("pitch {pitch}"));
    bench.pass(0.3);
    let mut run = calibrate(&bench, &["--by-hand", "--yes"]);
    run.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut run = run.spawn().unwrap();
    let told = put_down(&mut bench, run.stderr.take().unwrap(), None);
    let (status, out, _) = said(&run.wait_with_output().unwrap());
    assert_eq!(status, Some(0), "{told}");
    assert!(out.contains("accepted: within 0.2 deg"), "{out}");
}

#[test]
fn poses_that_end_early_are_named_and_nothing_changes() {
    let mut bench = bench(&[]);
    let before = bench.kept();
    bench.word("roll 0.2");
    let mut run = calibrate(&bench, &["--by-hand"]);
    run.stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut run = run.spawn().unwrap();
    run.stdin.take().unwrap().write_all(b"\n\n").unwrap();
    let (status, _, err) = said(&run.wait_with_output().unwrap());
    assert_eq!(status, Some(2), "{err}");
    let last = err.lines().last().unwrap();
    assert!(last.contains("missing: on its side, X up; "), "{err}");
    assert_eq!(bench.kept(), before);
}

#[test]
fn what_is_not_within_its_tolerance_is_taken_back() {
    let bench = bench(&["--mode", "paper"]);
    let before = bench.kept();
    // Tables with points 30 deg apart are read along straight lines: up to 7 deg off.
    let run = by_motor(&bench, &["--step", "30", "--tolerance", "0.2"]).output();
    let (status, out, err) = said(&run.unwrap());
    assert_eq!(status, Some(1), "{err}");
    assert!(out.contains("NOT accepted"), "{out}");
    assert_eq!(bench.kept(), before);
    let wide = ["--step", "30", "--tolerance", "9"];
    let (status, _, err) = said(&by_motor(&bench, &wide).output().unwrap());
    assert_eq!(status, Some(2));
    assert!(err.contains("as-found.json is there already"), "{err}");
    let run = by_motor(&bench, &wide).arg("--force").output();
    let (status, out, err) = said(&run.unwrap());
    assert_eq!(status, Some(0), "{out} {err}");
    assert!(out.contains("accepted: within 9 deg"), "{out}");
    let (status, out, _) = bench.verify(&bench.path("report/dcc.xml"));
    assert_eq!(status, Some(0), "{out}");
}

/// With steps of 30 deg tables were accepted within 9.057 deg, which nobody had asked for.
#[test]
fn tables_too_coarse_to_be_of_use_are_refused_before_the_motor_turns() {
    let bench = bench(&["--mode", "paper"]);
    for (step, deg) in [("5", "0.246"), ("30", "8.857")] {
        let (status, _, err) = said(&by_motor(&bench, &["--step", step]).output().unwrap());
        assert_eq!(status, Some(2), "{err}");
        let told = format!("points {step} deg apart err by up to {deg} deg");
        assert!(err.contains(&told), "{err}");
        assert_eq!(err.lines().count(), 1, "{err}");
        assert!(!fs::exists(bench.path("report/as-found.json")).unwrap());
    }
}

/// The errors as left of both nodes and slopes at +-77.5 deg; positive where a straight line sags.
fn steepest_deg(report: &serde_json::Value) -> Vec<f64> {
    let channels = report["channels"].as_array().unwrap();
    let points = channels
        .iter()
        .flat_map(|c| c["as_left"].as_array().unwrap());
    let both = points.map(|point| ["reference_deg", "error_deg"].map(|key| point[key].as_f64()));
    let both = both.map(|both| both.map(Option::unwrap));
    let steep = both.filter(|[reference, _]| reference.abs() > 77.0);
    steep.map(|[at, error]| error * at.signum()).collect()
}

/// The tables as the paper's section III asks for them: what is left between the points is their
/// straight line's sag, at most 0.157 deg with steps of 4 and 0.148 deg at 77.5 deg.
///
/// A point is one reading (R7), whose noise of 0.3 mg is 0.08 deg there. So the largest of eight
/// errors is beyond the tolerance, sag and 0.2 deg, in some runs: those take the tables back. Of 65
/// runs 11 were such, and this test failed with them.
#[test]
fn the_paper_s_tables_are_read_along_straight_lines() {
    let bench = bench(&["--mode", "paper"]);
    let before = bench.kept();
    let run = by_motor(&bench, &["--step", "4", "--json"]).output();
    let (status, out, err) = said(&run.unwrap());
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    let decision = &report["decision"];
    assert_eq!(decision["tolerance_deg"], 0.357);
    let errors = steepest_deg(&report);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let scatter = errors.iter().map(|deg| (deg - mean).powi(2)).sum::<f64>();
    let scatter = (scatter / (errors.len() - 1) as f64).sqrt();
    println!("tables in steps of 4 deg err by {mean:.3} deg at 77.5 deg, scatter {scatter:.3} deg");
    assert_eq!(errors.len(), 8, "{errors:?}");
    // Eight errors that scatter by 0.08 deg have a mean that scatters by 0.03 deg.
    assert!((mean - 0.148).abs() < 0.13, "{errors:?}");
    assert!(scatter < 0.16, "{errors:?}");
    let largest = decision["largest_error_deg"].as_f64().unwrap();
    let accepted = decision["accepted"].as_bool().unwrap();
    assert!(largest < 0.357 || !accepted, "{largest}");
    assert!(largest > 0.3 || accepted, "{largest}");
    assert_eq!(status, Some(i32::from(!accepted)), "{err}");
    assert_eq!(bench.kept() == before, !accepted, "{err}");
}

#[test]
fn a_rejected_run_replaced_the_certificate_of_the_calibration_in_force() {
    let bench = bench(&["--mode", "paper"]);
    let run = |more: &[&str]| {
        said(
            &by_motor(&bench, &["--step", "30"])
                .args(more)
                .output()
                .unwrap(),
        )
    };
    let (status, out, err) = run(&["--tolerance", "9"]);
    assert_eq!(status, Some(0), "{out} {err}");
    let files = ["as-found.json", "dcc.xml", "report.json", "report.html"];
    let files = files.map(|name| bench.path(&format!("report/{name}")));
    let before = files.each_ref().map(|file| fs::read(file).unwrap());
    let (status, out, err) = run(&["--force", "--tolerance", "0.2"]);
    assert_eq!(status, Some(1), "{err}");
    assert!(out.contains("report/not-accepted-2"), "{out}");
    assert!(err.contains("report stays"), "{err}");
    assert_eq!(files.each_ref().map(|file| fs::read(file).unwrap()), before);
    let (status, out, _) = bench.verify(&files[1]);
    assert_eq!(status, Some(0), "{out}");
}

#[test]
#[cfg(unix)]
fn ctrl_c_leaves_the_nodes_as_they_were_found() {
    let bench = bench(&[]);
    let mut client = started(&bench);
    assert_becomes(&mut client, 1, "05");
    let before = bench.kept();
    let mut run = by_motor(&bench, &["--step", "15"]);
    run.stdout(Stdio::null()).stderr(Stdio::piped());
    let mut run = run.spawn().unwrap();
    let mut lines = BufReader::new(run.stderr.take().unwrap()).lines();
    for _ in 0..5 {
        lines.next().unwrap().unwrap();
    }
    assert_becomes(&mut client, 2, "7F");
    crate::program::interrupt(&run);
    let status = run.wait().unwrap();
    assert_eq!(status.code(), Some(2));
    let last = lines.map_while(Result::ok).last().unwrap();
    assert!(last.contains("interrupted"), "{last}");
    for node in [1, 2] {
        assert_becomes(&mut client, node, "05");
    }
    assert_eq!(bench.kept(), before);
}

#[test]
fn a_node_that_vanishes_in_the_middle_is_named() {
    let mut bench = bench(&[]);
    let before = bench.kept();
    let mut run = by_motor(&bench, &["--step", "15"]);
    run.stdout(Stdio::null()).stderr(Stdio::piped());
    let mut run = run.spawn().unwrap();
    let mut lines = BufReader::new(run.stderr.take().unwrap()).lines();
    for _ in 0..5 {
        lines.next().unwrap().unwrap();
    }
    bench.word("power b off");
    let status = run.wait().unwrap();
    assert_eq!(status.code(), Some(2));
    let last = lines.map_while(Result::ok).last().unwrap();
    assert!(last.contains("node 2 does not answer"), "{last}");
    bench.word("power b on");
    bench.pass(0.5);
    assert_eq!(bench.kept(), before);
}

#[test]
fn what_can_not_be_done_is_said_in_a_sentence() {
    let bench = bench(&["--mode", "paper"]);
    let refused = |command: &mut Command, sentence: &str| {
        let (code, out, err) = said(&command.output().unwrap());
        assert_eq!((code, out.as_str()), (Some(2), ""), "{err}");
        assert!(err.contains(sentence), "{err}");
    };
    refused(&mut calibrate(&bench, &[]), "state how to calibrate");
    refused(&mut by_motor(&bench, &["--by-hand"]), "not both");
    refused(
        &mut by_motor(&bench, &["--nodes", "1,1"]),
        "node 1 is named twice",
    );
    refused(
        &mut by_motor(&bench, &["--nodes", "1,2,3"]),
        "give one node or the two",
    );
    refused(
        &mut by_motor(&bench, &["--nodes", "9"]),
        "there is no node 9; nodes 1 and 2 are there",
    );
    refused(
        &mut calibrate(&bench, &["--by-hand"]),
        "by hand goes for two slopes by vector only",
    );
    let nobody = ["--motor", "tcp://127.0.0.1:1"];
    refused(
        &mut calibrate(&bench, &nobody),
        "cannot reach the motor tcp://127.0.0.1:1",
    );
    let bus = format!("tcp://{}", bench.bus);
    refused(
        &mut calibrate(&bench, &["--motor", &bus]),
        "the motor tcp://127.0.0.1:",
    );
    let file = bench.path("file");
    fs::write(&file, "nothing").unwrap();
    refused(
        &mut bench.command(&["calibrate", "--keep", &file]),
        "is there already: choose another file with --keep",
    );
    refused(&mut bench.command(&["verify", &file]), "this is no dcc.xml");
    refused(
        &mut bench.command(&["verify", "no such file"]),
        "cannot use no such file",
    );
    let restore = ["calibrate", "--restore", &file];
    refused(
        &mut bench.command(&restore),
        "no file that --keep has written",
    );
}
