//! Recordings with the rates of a gyroscope.

use std::fmt::Write as _;

use super::bench::*;

/// Samples a second, and for how many seconds.
const RATE_HZ: u32 = 200;
const SECONDS: u32 = 60;

/// Time at rest at the start, s.
const REST_S: f64 = 2.0;

/// The sensor rests for 2 s, and is then swung about x and y by 50 and 20 deg and shaken by 0.3 g,
/// with reference slopes; its rates come `times` as large, under a header with this `suffix`.
fn swung(suffix: &str, times: f64) -> String {
    let names = ["gx", "gy", "gz"].map(|axis| format!("{axis}_{suffix}"));
    let mut text = format!(
        "time_s,{},ax_g,ay_g,az_g,ref_x_deg,ref_y_deg,moving\n",
        names.join(",")
    );
    for n in 0..RATE_HZ * SECONDS {
        let time_s = f64::from(n) / f64::from(RATE_HZ);
        let (roll, about_x) = swing(50.0, 1.3, time_s - REST_S);
        let (pitch, about_y) = swing(20.0, 0.7, time_s - REST_S);
        // First about y by `pitch`, then about x by `roll`.
        let up = [
            -pitch.sin(),
            roll.sin() * pitch.cos(),
            roll.cos() * pitch.cos(),
        ];
        let rate = [about_x, about_y * roll.cos(), -about_y * roll.sin()];
        let moving = u8::from(time_s > REST_S);
        // It shakes about where it is: its velocity is zero in the mean.
        let shaken = f64::from(moving) * 0.3 * (40.0 * (time_s - REST_S)).cos();
        let [gx, gy, gz] = rate.map(|rate| times * rate);
        let [x, y] = slopes_deg(up);
        let [ax, ay, az] = up;
        let ax = ax + shaken;
        writeln!(
            text,
            "{time_s},{gx},{gy},{gz},{ax},{ay},{az},{x},{y},{moving}"
        )
        .unwrap();
    }
    text
}

/// Angle and rate of a swing that begins at 0, rad and rad/s.
fn swing(deg: f64, omega: f64, time_s: f64) -> (f64, f64) {
    if time_s < 0.0 {
        return (0.0, 0.0);
    }
    let (sine, cosine) = (omega * time_s).sin_cos();
    (deg.to_radians() * sine, deg.to_radians() * omega * cosine)
}

#[test]
fn the_vertical_is_followed_through_swings_and_shaking() {
    let folder = Folder::new("gyroscope");
    for (suffix, times) in [("radps", 1.0), ("dps", 1f64.to_radians().recip())] {
        let file = folder.file("swung.csv", swung(suffix, times));
        let report = report(&folder, &[&file, "--from", "nominal"]);
        let channel = &report["channels"][0];
        assert_eq!(channel["calibration"]["kind"], "nominal");
        let found = &channel["moving"];
        let figure = |key: &str| found[key].as_f64().unwrap();
        println!("{suffix}: {found}");
        assert_eq!(figure("compared"), f64::from(RATE_HZ * (SECONDS - 2) - 1));
        assert!(
            figure("rms_deg") < 0.25 && figure("max_deg") < 0.6,
            "{found}"
        );
        assert!(figure("within_2u_percent") > 95.0, "{found}");
        // The accelerometer alone takes the shaking for tilt.
        let alone = &channel["slopes"][0]["accuracy"]["rmse_deg"];
        assert!(alone.as_f64().unwrap() > 3.0 * figure("rms_deg"), "{alone}");
    }
}

#[test]
fn rates_that_contradict_the_acceleration_are_refused_with_one_sentence() {
    let folder = Folder::new("rates");
    let degrees = 1f64.to_radians().recip();
    let cases = [
        (
            swung("radps", degrees),
            "as if the rates were in deg/s and not in rad/s",
        ),
        (
            swung("dps", 1.0),
            "as if the rates were in rad/s and not in deg/s",
        ),
        (
            swung("radps", -1.0),
            "its rates turn the other way than its acceleration",
        ),
        (
            swung("radps", 1.0).replacen("gy_radps", "gy_dps", 1),
            "the axes differ in unit",
        ),
        (
            swung("radps", 1.0).replacen("gz_radps", "gz", 1),
            "`gz` has no unit",
        ),
    ];
    for (text, words) in cases {
        let file = folder.file("rates.csv", text);
        let refused = replay(&folder, &[&file, "--from", "nominal"]);
        let told = String::from_utf8(refused.stderr).unwrap();
        assert_eq!(refused.status.code(), Some(2), "{told}");
        assert!(told.contains(words) && told.lines().count() == 1, "{told}");
    }
}

#[test]
fn a_recording_without_a_gyroscope_goes_the_old_way_and_is_told() {
    let folder = Folder::new("no-gyroscope");
    let text = swung("radps", 1.0).replace("_radps", "_unknown");
    let file = folder.file("plain.csv", text);
    let report = report(&folder, &[&file, "--from", "nominal"]);
    assert!(report["channels"][0]["moving"].is_null());
    assert_eq!(
        report["channels"][0]["ignored_columns"]
            .as_array()
            .unwrap()
            .len(),
        3
    );
    let notes = report["notes"].to_string();
    assert!(notes.contains("no gyroscope was recorded"), "{notes}");
}

#[test]
fn rows_without_a_rate_interrupt_the_vertical_and_no_row_is_lost() {
    let folder = Folder::new("rate-gaps");
    let text = with_lines(&swung("radps", 1.0), |number, line| {
        let mut cells: Vec<&str> = line.split(',').collect();
        if (4000..4100).contains(&number) {
            (cells[1], cells[2], cells[3]) = ("", "", "");
        }
        if (6000..6005).contains(&number) {
            cells[2] = "x";
        }
        Some(cells.join(","))
    });
    let file = folder.file("gaps.csv", text);
    let report = report(&folder, &[&file, "--from", "nominal"]);
    let found = &report["channels"][0]["moving"];
    let without = found["without"].as_u64().unwrap();
    // It starts anew in the middle of a swing, where it takes seconds to tell motion from tilt.
    assert!((105..1500).contains(&without), "{found}");
    assert!(
        found["within_3u_percent"].as_f64().unwrap() > 99.0,
        "{found}"
    );
    let notes = report["notes"].to_string();
    assert!(
        notes.contains("5 rows were used without their reference, temperature or rate"),
        "{notes}"
    );
}
