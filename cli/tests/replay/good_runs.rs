//! Recordings that can be used: angles, cross-check, calibration files, skipped rows.

use serde_json::Value;

use super::bench::*;

fn plateaus(channel: &Value) -> Vec<(f64, [f64; 2])> {
    let number = |p: &Value, key: &str| p[key].as_f64().unwrap_or(f64::NAN);
    let plateaus = channel["plateaus"].as_array().unwrap().iter();
    plateaus
        .map(|p| {
            let middle = 0.5 * (number(p, "from_s") + number(p, "to_s"));
            (middle, [number(p, "x_deg"), number(p, "y_deg")])
        })
        .collect()
}

/// The largest error of the plateaus' mean angles, those within 1 deg of the vertical apart:
/// there the noise folds.
fn largest_error_deg(channel: &Value, motion: impl Fn(u64) -> [f64; 3]) -> f64 {
    let mut largest = 0.0;
    for (middle_s, measured) in plateaus(channel) {
        let truth = slopes_deg(motion((middle_s * RATE_HZ as f64) as u64));
        for (truth, measured) in truth.iter().zip(measured) {
            if truth.abs() < 89.0 && !measured.is_nan() {
                largest = f64::max(largest, (truth - measured).abs());
            }
        }
    }
    largest
}

#[test]
fn the_known_attitude_comes_out() {
    let folder = Folder::new("attitude");
    let one = folder.file("one.csv", SQUARE.record(up));
    for mode in ["product", "paper"] {
        let report = report(&folder, &[&one, "--mode", mode]);
        let channel = &report["channels"][0];
        assert_eq!(plateaus(channel).len(), POSES.len());
        let error = largest_error_deg(channel, up);
        println!("{mode}: largest error {error:.4} deg");
        assert!(error < 0.05, "{error}");
        assert_eq!(channel["calibration"]["kind"], "poses");
        assert!(channel["calibration"]["residual_mg"].as_f64().unwrap() < 0.2);
        // What it states of itself is true: noise behind the filter.
        for slope in channel["slopes"].as_array().unwrap() {
            let found = &slope["standstill"];
            let figure = |key: &str| found[key].as_f64().unwrap();
            let ratio = figure("noise_deg") / figure("scatter_deg");
            println!("{mode}: noise to scatter {ratio:.2}");
            assert!((0.8..1.2).contains(&ratio), "{ratio}");
        }
        // After the filter has settled it measures to the end.
        let verdicts = report["verdicts"].as_array().unwrap();
        assert_eq!(verdicts.len(), 2, "{verdicts:?}");
        assert_eq!(verdicts[1]["trusted"], true);
    }
}

#[test]
fn counts_and_metres_per_second_squared_give_the_same_angles() {
    let folder = Folder::new("units");
    let in_g = SQUARE.record(up);
    let scaled = |name: &str, factor: f64, decimals: usize| {
        let header = "time_s,ax_g,ay_g,az_g".replace("_g", name);
        with_lines(&in_g, |number, line| {
            if number == 1 {
                return Some(header.clone());
            }
            let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            let [t, x, y, z] = <[f64; 4]>::try_from(cells).unwrap();
            let [x, y, z] = [x, y, z].map(|a| format!("{:.decimals$}", factor * a));
            Some(format!("{t},{x},{y},{z}"))
        })
    };
    let metres = folder.file("metres.csv", scaled("_mps2", 9.80665, 5));
    let counts = folder.file("counts.csv", scaled("_lsb", 16384.0, 0));
    let odd = folder.file("odd.csv", scaled("_lsb", 1430.0, 2));
    for arguments in [
        vec![metres.as_str()],
        vec![&counts],
        vec![&odd, "--lsb-per-g", "1430"],
    ] {
        let report = report(&folder, &arguments);
        let error = largest_error_deg(&report["channels"][0], up);
        assert!(error < 0.05, "{arguments:?}: {error}");
    }
}

#[test]
fn slopes_as_a_reference_calibrate_and_are_compared_with() {
    let folder = Folder::new("reference");
    let text = SQUARE.record(up);
    let with_reference = with_lines(&text, |number, line| {
        let Some(i) = number.checked_sub(2) else {
            return Some(format!("{line},ref_x_deg,ref_y_deg"));
        };
        let [x, y] = slopes_deg(up(i as u64));
        // Two slopes don't show that the housing lies on its back.
        let hidden = up(i as u64)[2] < 0.0;
        Some(if hidden {
            format!("{line},,")
        } else {
            format!("{line},{x:.4},{y:.4}")
        })
    });
    let file = folder.file("reference.csv", with_reference);
    let by_reference = report(&folder, &[&file]);
    assert_eq!(
        by_reference["channels"][0]["calibration"]["kind"],
        "reference"
    );
    let by_poses = report(&folder, &[&file, "--from", "poses"]);
    assert_eq!(by_poses["channels"][0]["calibration"]["kind"], "poses");
    let slope = &by_poses["channels"][0]["slopes"][0];
    let rmse = |over: &str| slope[over]["rmse_deg"].as_f64().unwrap();
    println!("{} {}", rmse("accuracy_at_plateaus"), rmse("accuracy"));
    assert!(rmse("accuracy_at_plateaus") < 0.1);
    // 90 deg in a second, compared at the instants that the angles belong to.
    assert!(rmse("accuracy") < 1.0);
    // A rotation and offsets can't take up 2 % of scale.
    let bent = &by_reference["channels"][0]["slopes"][0]["accuracy_at_plateaus"]["rmse_deg"];
    assert!(bent.as_f64().unwrap() > rmse("accuracy_at_plateaus"));
}

#[test]
fn a_saved_calibration_gives_the_same_angles() {
    let folder = Folder::new("saved");
    let one = folder.file("one.csv", SQUARE.record(up));
    let other = folder.file("other.csv", TURNED.record(up));
    let kept = folder.path("kept.json");
    let made = report(&folder, &[&one, &other, "--save-calibration", &kept]);
    let used = report(&folder, &[&one, &other, "--calibration", &kept]);
    for channel in 0..2 {
        let (made, used) = (&made["channels"][channel], &used["channels"][channel]);
        assert_eq!(made["slopes"], used["slopes"]);
        assert_eq!(made["plateaus"], used["plateaus"]);
        assert_eq!(used["calibration"]["kind"], "file");
    }
    assert_eq!(made["cross_check"], used["cross_check"]);
    assert_eq!(folder.names(), ["kept.json", "one.csv", "other.csv", "out"]);
}

#[test]
fn two_good_channels_agree_and_the_second_is_turned_onto_the_first() {
    let folder = Folder::new("agree");
    let one = folder.file("one.csv", SQUARE.record(up));
    let other = folder.file("other.csv", TURNED.record(up));
    let report = report(&folder, &[&one, &other]);
    assert!(largest_error_deg(&report["channels"][1], up) < 0.05);
    let verdicts = report["verdicts"].as_array().unwrap();
    let words: Vec<&str> = verdicts
        .iter()
        .map(|v| v["verdict"].as_str().unwrap())
        .collect();
    assert_eq!(words, ["no comparison yet: the filter settles", "agree"]);
    assert_eq!(report["cross_check"]["faults"], 0);
}

/// The second channel slips by 1 deg in slope X, 1 s into the last level pose.
const SLIP: u64 = (13 * (POSE_S + WAY_S) + 1) * RATE_HZ;

fn slipped(i: u64) -> [f64; 3] {
    let [x, y, z] = up(i);
    let (s, c) = if i < SLIP {
        (0.0, 1.0)
    } else {
        1f64.to_radians().sin_cos()
    };
    [c * x + s * z, y, c * z - s * x]
}

#[test]
fn a_slip_of_one_degree_is_found_when_it_happens() {
    let folder = Folder::new("slip");
    let one = folder.file("one.csv", SQUARE.record(up));
    let other = folder.file("other.csv", TURNED.record(slipped));
    let report = report(&folder, &[&one, &other]);
    let verdicts = report["verdicts"].as_array().unwrap();
    let last = verdicts.last().unwrap();
    assert_eq!(last["verdict"], "disagree");
    assert_eq!(last["trusted"], false);
    let late_s = last["from_s"].as_f64().unwrap() - SLIP as f64 / RATE_HZ as f64;
    println!("found {late_s:.3} s after the slip");
    // 0.2 s of persistence, the latency, and the way of the filter.
    assert!((0.2..0.4).contains(&late_s), "{late_s}");
    assert_eq!(report["cross_check"]["faults"], 1);
    assert!(
        report["cross_check"]["slopes"][0]["warnings"]
            .as_u64()
            .unwrap()
            > 50
    );
}

#[test]
fn a_channel_that_stops_is_named() {
    let folder = Folder::new("stops");
    let one = folder.file("one.csv", SQUARE.record(up));
    let whole = TURNED.record(up);
    let cut: String = whole
        .lines()
        .take(6501)
        .map(|line| line.to_owned() + "\n")
        .collect();
    let other = folder.file("other.csv", cut);
    let report = report(&folder, &[&one, &other]);
    let last = report["verdicts"]
        .as_array()
        .unwrap()
        .last()
        .unwrap()
        .clone();
    assert_eq!(last["verdict"], "channel 2 is faulty: samples have stopped");
    assert!((last["from_s"].as_f64().unwrap() - 65.0).abs() < 0.1);
}

#[test]
fn times_of_both_files_are_one_clock() {
    let folder = Folder::new("clock");
    // The second logger began 20 s late on the same clock, which shows 1000 s at the first row.
    let shifted = |text: String, first: usize| {
        with_lines(&text, |number, line| {
            let (time, rest) = line.split_once(',')?;
            let time: f64 = time.parse().ok()?;
            (number > first).then(|| format!("{:.3},{rest}", time + 1000.0))
        })
    };
    let keep = |text: String, from: usize| -> String {
        let lines = text.lines().zip(0..).filter(|(_, i)| *i == 0 || *i > from);
        lines.map(|(line, _)| line.to_owned() + "\n").collect()
    };
    let one = folder.file("one.csv", shifted(SQUARE.record(up), 1));
    let other = folder.file("other.csv", keep(shifted(TURNED.record(up), 1), 2000));
    let report = report(&folder, &[&one, &other]);
    assert!(largest_error_deg(&report["channels"][1], up) < 0.05);
    let verdicts = report["verdicts"].as_array().unwrap();
    let agree = verdicts.iter().find(|v| v["verdict"] == "agree").unwrap();
    assert!(
        (agree["from_s"].as_f64().unwrap() - 21.3).abs() < 0.1,
        "{agree}"
    );
    assert_eq!(verdicts.last().unwrap()["verdict"], "agree");
}

#[test]
fn skipped_rows_are_counted_with_reason_and_line() {
    let folder = Folder::new("skipped");
    let text = with_lines(&SQUARE.record(up), |number, line| match number {
        10 => Some(line.rsplit_once(',').unwrap().0.to_owned() + ","),
        20 => Some(line.split_once(',').unwrap().0.to_owned() + ",0,0,0"),
        // Line 30 has the time of line 29, line 40 that of line 37.
        30 => Some(format!("0.270,{}", line.split_once(',').unwrap().1)),
        40 => Some(format!("0.350,{}", line.split_once(',').unwrap().1)),
        _ => None,
    });
    let file = folder.file("skipped.csv", text);
    let report = report(&folder, &[&file]);
    let skipped: Vec<(String, u64, u64)> = report["channels"][0]["skipped"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| {
            let number = |key: &str| s[key].as_u64().unwrap();
            (
                s["reason"].as_str().unwrap().to_owned(),
                number("count"),
                number("first_line"),
            )
        })
        .collect();
    let expected = [
        ("missing cell", 10),
        ("all axes zero", 20),
        ("repeated timestamp", 30),
        ("backward timestamp", 40),
    ];
    let expected: Vec<_> = expected
        .map(|(reason, line)| (reason.to_owned(), 1, line))
        .to_vec();
    assert_eq!(skipped, expected);
    let shown = replay_well(&folder, &[&file]);
    for (reason, _, line) in expected {
        let row = shown.lines().find(|shown| shown.contains(&reason)).unwrap();
        assert!(row.ends_with(&format!(" {line}")), "{row}");
    }
}

#[test]
fn the_report_is_written_and_json_is_all_that_stdout_holds() {
    let folder = Folder::new("written");
    let one = folder.file("one.csv", SQUARE.record(up));
    let printed = report(&folder, &[&one]);
    let written = std::fs::read_to_string(folder.0.join("out/report.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&written).unwrap(), printed);
    let page = std::fs::read_to_string(folder.0.join("out/report.html")).unwrap();
    assert!(page.contains("one.csv") && page.ends_with("</html>\n"));
    let shown = replay_well(&folder, &[&one]);
    assert!(shown.contains("replay in product mode") && shown.contains("report.html"));
    assert_eq!(
        Folder(folder.0.join("out")).names(),
        ["report.html", "report.json"]
    );
}

#[test]
fn one_motion_at_two_rates_agrees() {
    let folder = Folder::new("rates");
    let one = folder.file("one.csv", SQUARE.record(up));
    let fast = folder.file("fast.csv", TURNED.record_at(200, |i| up_at(i, 200)));
    for pair in [[&one, &fast], [&fast, &one]] {
        let report = report(&folder, &pair.map(String::as_str));
        for slope in report["cross_check"]["slopes"].as_array().unwrap() {
            let largest = slope["max_deg"].as_f64().unwrap();
            println!("largest difference {largest:.3} deg");
            assert!(largest < 0.3, "{largest}");
            assert_eq!(slope["warnings"], 0);
        }
        let latency = |channel: usize| &report["channels"][channel]["latency_ms"];
        assert_eq!(latency(0), latency(1));
        let verdicts = report["verdicts"].as_array().unwrap();
        let (last, first) = verdicts.split_last().unwrap();
        assert_eq!(last["verdict"], "agree");
        let waits = |v: &Value| {
            v["verdict"]
                .as_str()
                .unwrap()
                .starts_with("no comparison yet")
        };
        assert!(first.iter().all(waits), "{first:?}");
    }
}

fn notes(report: &Value) -> Vec<&str> {
    let notes = report["notes"].as_array().unwrap().iter();
    notes.map(|note| note.as_str().unwrap()).collect()
}

/// The sensor with another scale.
fn stretched(by: f64) -> Sensor {
    Sensor {
        matrix: SQUARE.matrix.map(|row| row.map(|v| by * v)),
        offset_g: SQUARE.offset_g.map(|v| by * v),
        ..SQUARE
    }
}

#[test]
fn a_kept_calibration_that_makes_two_per_cent_too_much_gets_a_note_and_its_uncertainty() {
    let folder = Folder::new("doubtful");
    let one = folder.file("one.csv", SQUARE.record(up));
    let other = folder.file("other.csv", stretched(1.02).record(up));
    let kept = folder.path("kept.json");
    report(&folder, &[&one, "--save-calibration", &kept]);
    let good = report(&folder, &[&one, "--calibration", &kept]);
    let doubtful = report(&folder, &[&other, "--calibration", &kept]);
    let said = "Channel 1: calibrated on one.csv.";
    assert!(notes(&good).contains(&said) && notes(&doubtful).contains(&said));
    let about = |report| {
        notes(report)
            .iter()
            .any(|n| n.contains("the sensor reads 1.020 g"))
    };
    assert!(about(&doubtful) && !about(&good), "{:?}", notes(&doubtful));
    // The length shows an acceleration; the table has what each angle stated.
    let reported = |report: &Value| {
        let found = &report["channels"][0]["slopes"][0]["standstill"];
        found["uncertainty_deg"].as_f64().unwrap()
    };
    println!("{:.3} and {:.3} deg", reported(&good), reported(&doubtful));
    assert!(reported(&doubtful) > 4.0 * reported(&good));
}

#[test]
fn a_channel_that_sticks_later_is_replayed_and_found() {
    let folder = Folder::new("sticks");
    let one = folder.file("one.csv", SQUARE.record(up));
    let whole = TURNED.record(up);
    let other = folder.file("other.csv", &whole);
    let kept = folder.path("kept.json");
    report(&folder, &[&one, &other, "--save-calibration", &kept]);
    for (name, dead) in [
        ("stuck.csv", "1.100,1.000,1.100"),
        ("full.csv", "2.000,2.000,2.000"),
    ] {
        let stuck = with_lines(&whole, |number, line| {
            (number > 3501).then(|| format!("{},{dead}", line.split_once(',').unwrap().0))
        });
        let stuck = folder.file(name, stuck);
        let report = report(&folder, &[&one, &stuck, "--calibration", &kept]);
        let verdicts = report["verdicts"].as_array().unwrap();
        let fault = verdicts
            .iter()
            .find(|v| v["verdict"] == "disagree")
            .unwrap();
        let from_s = fault["from_s"].as_f64().unwrap();
        assert!((35.0..35.5).contains(&from_s), "{name}: {from_s}");
    }
}

#[test]
#[cfg(unix)]
fn a_calibration_saved_through_a_link_is_written_where_it_leads() {
    let folder = Folder::new("link");
    let one = folder.file("one.csv", SQUARE.record(up));
    let target = folder.file("target.json", "old");
    let link = folder.path("link.json");
    std::os::unix::fs::symlink(&target, &link).unwrap();
    let refused = replay(&folder, &[&one, "--save-calibration", &link]);
    assert_eq!(refused.status.code(), Some(2));
    let told = String::from_utf8(refused.stderr).unwrap();
    assert!(told.ends_with("or replace it with --force\n"), "{told}");
    assert_eq!(std::fs::read_to_string(&target).unwrap(), "old");
    report(&folder, &[&one, "--force", "--save-calibration", &link]);
    assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
    let written = std::fs::read_to_string(&target).unwrap();
    assert!(written.contains("plumb-calibration"));
    assert_eq!(
        folder.names(),
        ["link.json", "one.csv", "out", "target.json"]
    );
}

#[test]
fn what_was_asked_for_and_not_used_is_noted() {
    let folder = Folder::new("unused");
    let empty = with_lines(&SQUARE.record(up), |number, line| {
        let more = if number == 1 {
            ",ref_x_deg,ref_y_deg"
        } else {
            ",,"
        };
        Some(format!("{line}{more}"))
    });
    let file = folder.file("empty.csv", empty);
    let report = report(&folder, &[&file, "--lsb-per-g", "2048"]);
    let has = |part: &str| notes(&report).iter().any(|note| note.contains(part));
    assert!(has("the reference columns are empty") && has("--lsb-per-g was not used"));
}
