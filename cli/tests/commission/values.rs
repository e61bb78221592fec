//! How values are read and written.

use super::bench::*;

#[test]
fn a_bare_time_switched_the_supervision_of_the_other_channel_off() {
    let bench = Bench::quick(&[]);
    let get = || bench.json(&["get", "1016h:1", "--node", "1"])["objects"][0].clone();
    let told = bench.refused(&["set", "1016h:1", "500ms", "--node", "1"]);
    assert!(told.contains("write 2:500ms"), "{told}");
    assert_eq!(get()["text"], "node 2, 500 ms");
    assert!(get()["value"].is_null() && get()["unit"].is_null());
    let done = bench.done(&["set", "1016h:1", "2:0.7s", "--node", "1"]);
    assert!(done.contains("is node 2, 700 ms, counts at once"), "{done}");
    assert_eq!(get()["raw"], 0x0002_02BC);
    bench.done(&["set", "1016h:1", "0x100", "--node", "1"]);
    assert_eq!(get()["raw"], 0x100);
}

#[test]
fn a_number_in_hexadecimal_was_no_number_where_there_is_a_unit() {
    let bench = Bench::quick(&[]);
    let done = bench.done(&["set", "heartbeat", "0x12C", "--node", "1"]);
    assert!(done.contains("is 300 ms"), "{done}");
}

#[test]
fn half_a_sentence_was_the_name_of_a_value() {
    let bench = Bench::quick(&[]);
    let told = bench.refused(&["set", "degraded-operation", "yes", "--node", "1"]);
    assert!(told.contains("nor one of forbidden, allowed;"), "{told}");
    bench.done(&["set", "degraded-operation", "forbidden", "--node", "1"]);
    let got = bench.json(&["get", "degraded-operation", "--node", "1"]);
    assert_eq!(got["objects"][0]["text"], "0 (forbidden)");
    let info = bench.json(&["info", "1"]);
    let facts = info["nodes"][0]["facts"].as_array().unwrap();
    let fact = facts
        .iter()
        .find(|fact| fact["name"] == "degraded-operation");
    assert_eq!(fact.unwrap()["text"], "forbidden");
}

/// Cut short by the seam of the full circle, the mean was 134.98 deg, or -90.
#[test]
fn a_zero_at_180_deg_read_an_angle_far_away() {
    // One axis is a matter of the calibration.
    let bench = Bench::new(&["--mode", "one-axis"]);
    let zeroed = bench.json(&["zero", "--to=-180deg"]);
    for slope in zeroed["slopes"].as_array().unwrap() {
        let after = slope["after_deg"].as_f64().unwrap();
        assert!((179.0..=180.0).contains(&after.abs()), "{zeroed}");
    }
}

#[test]
fn a_heartbeat_that_the_other_channel_takes_for_lost_was_set_without_a_word() {
    let bench = Bench::quick(&[]);
    let set = |time| bench.done(&["set", "heartbeat", time, "--node", "1"]);
    for time in ["500ms", "2s"] {
        let told = set(time);
        assert!(
            told.contains("note: node 2, the other channel, waits for this heartbeat for 500 ms")
                && told.contains("(1016h sub 1)")
                && told.contains("again and again"),
            "{told}"
        );
    }
    assert!(set("0ms").contains("plumb set 1016h:1 0 --node 2"));
    assert!(!set("499ms").contains("note"));
    let set = bench.json(&["set", "heartbeat", "600ms", "--node", "1"]);
    let note = set["nodes"][0]["note"].as_str().unwrap();
    let (_, remedy) = note.split_once(": plumb ").unwrap();
    let words: Vec<_> = remedy.split_whitespace().collect();
    let done = bench.done(&words);
    assert!(done.contains("is node 1, 1500 ms"), "{done}");
    let set = bench.json(&["set", "heartbeat", "600ms", "--node", "1"]);
    assert!(set["nodes"][0]["note"].is_null(), "{set}");
}

#[test]
fn the_names_and_what_went_to_a_file_were_no_json() {
    let (status, out, err) = said(&plumb(&["get", "--list", "--json"]).output().unwrap());
    assert_eq!((status, err.as_str()), (Some(0), ""));
    let list: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(
        (&list["format"], &list["version"]),
        (&"plumb-get".into(), &1.into())
    );
    let names = list["names"].as_array().unwrap();
    for (name, index, sub) in [("device-type", "1000", 0), ("serial-number", "1018", 4)] {
        let wanted = serde_json::json!({ "name": name, "index": index, "sub": sub });
        assert!(names.contains(&wanted), "{wanted}");
    }
    let bench = Bench::quick(&[]);
    let file = Scratch::new();
    let path = file.0.display().to_string();
    let got = bench.json(&["get", "calibration-data", "--node", "1", "--output", &path]);
    let length = std::fs::read(&file.0).unwrap().len();
    let saved = &got["files"][0];
    assert_eq!(
        (&saved["file"], &saved["length_bytes"]),
        (&path.into(), &length.into())
    );
    assert_eq!(
        (&saved["node"], &saved["index"]),
        (&1.into(), &"2061".into())
    );
}
