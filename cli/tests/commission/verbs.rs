//! What each verb does, and refuses.

use device::objects::table::{self, Models};
use serde_json::Value;
use std::time::{Duration, Instant};

use super::bench::*;

#[test]
fn who_is_on_the_bus_and_which_are_a_pair() {
    let bench = Bench::quick(&[]);
    let table = bench.done(&["scan"]);
    assert!(table.contains("Plumb inclinometer, channel B"), "{table}");
    assert!(table.contains("with node 2"), "{table}");
    let scan = bench.json(&["scan"]);
    let nodes = scan["nodes"].as_array().unwrap();
    assert_eq!(nodes.len(), 2);
    assert_eq!(nodes[0]["channel"], "A");
    assert_eq!(nodes[0]["state"], "pre-operational");
    assert_eq!(nodes[0]["pair"], 2);
    assert_eq!(nodes[1]["profile"], 410);
    assert!(nodes[1]["reason"].is_null());
    let info = bench.done(&["info"]);
    for words in [
        "node 1",
        "node 2",
        "the channel is not calibrated",
        "250 kbit/s",
    ] {
        assert!(info.contains(words), "{words}: {info}");
    }
    let info = bench.json(&["info", "2"]);
    let facts = info["nodes"][0]["facts"].as_array().unwrap();
    let report = facts
        .iter()
        .find(|fact| fact["name"] == "calibration-report-hash")
        .unwrap();
    assert!(report["text"].is_null(), "{report}");
    assert_eq!(report["reason"], "it stores no report of this calibration");
    let latency = facts
        .iter()
        .find(|fact| fact["name"] == "latency.in-microseconds");
    assert_eq!(latency.unwrap()["unit"], "us");
}

#[test]
fn objects_are_read_by_name_and_address_and_kept_as_files() {
    let bench = Bench::quick(&[]);
    let table = bench.done(&["get", "heartbeat", "1017h", "uncertainty"]);
    assert_eq!(table.matches("200 ms").count(), 4, "{table}");
    assert!(table.contains("uncertainty.larger-uncertainty"), "{table}");
    let got = bench.json(&["get", "slope-long", "device-name", "--node", "1"]);
    let slope = &got["objects"][0];
    assert_eq!(
        (&slope["unit"], &slope["index"]),
        (&"deg".into(), &"6110".into())
    );
    let (raw, value) = (
        slope["raw"].as_i64().unwrap(),
        slope["value"].as_f64().unwrap(),
    );
    assert!((raw as f64 * 0.01 - value).abs() < 1e-9);
    assert_eq!(got["objects"][1]["text"], "Plumb inclinometer");
    // A fault log of many segments, in blocks.
    let file = Scratch::new();
    let path = file.0.display().to_string();
    bench.done(&["get", "calibration-data", "--node", "1", "--output", &path]);
    let bytes = std::fs::read(&file.0).unwrap();
    let (content, sum) = bytes.split_at(bytes.len() - 4);
    assert!(content.len() > 64, "{}", content.len());
    let got = bench.json(&["get", "2062:1", "--node", "1"]);
    let sum = u32::from_le_bytes(sum.try_into().unwrap());
    assert_eq!(got["objects"][0]["raw"], sum);
    let told = bench.refused(&["get", "black-box.1", "--node", "1"]);
    assert!(
        told.contains("there is no data (abort code 0800 0024h)"),
        "{told}"
    );
    let told = bench.refused(&["get", "heartbaet"]);
    assert!(told.contains("near are heartbeat"), "{told}");
    let told = bench.refused(&["get", "fault-log", "--force", "--output", &path]);
    assert!(told.contains("one object of one node"), "{told}");
}

#[test]
fn a_value_is_checked_written_once_read_back_and_told_to_be_unsaved() {
    let bench = Bench::quick(&[]);
    let told = bench.refused(&["set", "heartbeat", "500ms"]);
    assert!(
        told.contains("choose one with --node 1, or --node all"),
        "{told}"
    );
    let told = bench.refused(&["set", "heartbeat", "70s", "--node", "1"]);
    assert!(
        told.contains("has to be 0 ms to 65535 ms; nothing was written"),
        "{told}"
    );
    let told = bench.refused(&["set", "slope-long", "0deg", "--node", "1"]);
    assert!(told.contains("can only be read"), "{told}");
    let done = bench.done(&["set", "heartbeat", "0.5s", "--node", "all"]);
    assert!(
        done.contains("node 2: producer-heartbeat-time is 500 ms, counts at once"),
        "{done}"
    );
    assert!(done.contains("plumb save --node 1"), "{done}");
    let set = bench.json(&["set", "nmt-startup", "8", "--node", "2"]);
    assert_eq!(set["nodes"][0]["counts_from"], "reset");
    assert_eq!(set["nodes"][0]["to_be_saved"], true);
    // The unit of the slopes is the one that the node has.
    bench.done(&["set", "resolution", "0.1deg", "--node", "1"]);
    bench.done(&[
        "set",
        "slope-long.differential-offset",
        "-1.2deg",
        "--node",
        "1",
    ]);
    let got = bench.json(&["get", "slope-long.differential-offset", "--node", "1"]);
    assert_eq!(got["objects"][0]["raw"], -12);
    let told = bench.refused(&[
        "set",
        "slope-long.differential-offset",
        "-1.234deg",
        "--node",
        "2",
    ]);
    assert!(
        told.contains("nearest steps are -1.24 deg and -1.23 deg"),
        "{told}"
    );
}

#[test]
fn a_zero_counts_on_both_channels_and_outlasts_a_reset() {
    let mut bench = Bench::quick(&[]);
    let zeroed = bench.json(&["zero"]);
    let slopes = zeroed["slopes"].as_array().unwrap();
    assert_eq!(slopes.len(), 4);
    for slope in slopes {
        assert!(slope["after_deg"].as_f64().unwrap().abs() < 0.2, "{slope}");
    }
    // An uncalibrated channel is off by degrees, so it was not zero before.
    assert!(
        slopes
            .iter()
            .any(|slope| slope["before_deg"].as_f64().unwrap().abs() > 0.5)
    );
    bench.done(&["save", "--only", "profile"]);
    let before = bench.json(&["get", "slope-long.offset", "--node", "1"])["objects"][0].clone();
    bench.nmt(129, 1);
    let after = bench.json(&["get", "slope-long.offset", "--node", "1"])["objects"][0].clone();
    assert_eq!(before["raw"], after["raw"]);
    let done = bench.done(&["restore", "--node", "1", "--reset"]);
    assert!(done.contains("as delivered; the node was reset"), "{done}");
    let after = bench.json(&["get", "slope-long.offset", "--node", "1"])["objects"][0].clone();
    assert_eq!(after["raw"], 0);
}

/// A preset that is written once takes a reading that may be farther off than this.
#[test]
fn a_zero_had_the_noise_of_a_single_reading() {
    let bench = Bench::quick(&[]);
    for to in [0.0, 5.0] {
        let zeroed = bench.json(&["zero", "--to", &format!("{to}deg")]);
        for slope in zeroed["slopes"].as_array().unwrap() {
            let after = slope["after_deg"].as_f64().unwrap();
            assert!((after - to).abs() < 0.03, "{slope}");
        }
    }
}

#[test]
fn a_preset_without_scaling_was_stored_and_not_shown() {
    let bench = Bench::quick(&[]);
    bench.done(&["set", "slope-long.operating-parameter", "0", "--node", "2"]);
    let told = bench.refused(&["zero"]);
    assert!(
        told.contains("scaling of slope-long is off in node 2"),
        "{told}"
    );
    assert!(told.contains("nothing was written"), "{told}");
    // Node 1 was looked at first and was not written either.
    let got = bench.json(&["get", "slope-long.offset", "--node", "1"]);
    assert_eq!(got["objects"][0]["raw"], 0);
    let done = bench.done(&["zero", "--enable-scaling", "--axis", "x", "--to", "5deg"]);
    assert!(done.contains("scaling is on now"), "{done}");
    let got = bench.json(&["get", "slope-long", "--node", "2"]);
    assert!((got["objects"][0]["value"].as_f64().unwrap() - 5.0).abs() < 0.2);
}

#[test]
fn a_pair_of_which_one_node_was_zeroed_alone_could_not_be_zeroed_any_more() {
    let mut bench = Bench::quick(&[]);
    bench.nmt(1, 0);
    bench.pass(2.0);
    let alone = ["zero", "--to", "45deg", "--axis", "x", "--node", "1"];
    let told = bench.done(&alone);
    let warning = "node 2, the other channel of node 1, was not zeroed";
    assert!(told.contains(warning), "{told}");
    bench.pass(3.0);
    let got = bench.json(&["get", "2025.1", "--node", "2"]);
    assert_eq!(got["objects"][0]["raw"], 20, "{got}");
    let zeroed = bench.json(&["zero"]);
    for slope in zeroed["slopes"].as_array().unwrap() {
        let after = slope["after_deg"].as_f64();
        assert!(after.is_some_and(|deg| deg.abs() < 0.2), "{zeroed}");
    }
    let told = bench.done(&["zero"]);
    assert!(!told.contains("was not zeroed"), "{told}");
}

#[test]
fn without_a_valid_angle_a_zero_prints_why() {
    let mut bench = Bench::quick(&[]);
    bench.word("fault b stuck");
    bench.pass(0.8);
    let told = bench.refused(&["zero"]);
    assert!(told.contains("node 2 has no valid slope-long ("), "{told}");
    assert!(told.contains("nothing was zeroed"), "{told}");
}

/// What was refused with status 2 behind what could be done.
fn half_done((status, out, err): Said) -> (String, String) {
    assert_eq!(status, Some(2), "{out}: {err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    assert_ne!(out, "", "{err}");
    (out, err)
}

#[test]
fn half_an_instrument_was_zeroed_without_a_word() {
    let mut bench = Bench::quick(&[]);
    bench.word("power b off");
    bench.pass(0.5);
    let verbs: [&[&str]; 4] = [
        &["zero"],
        &["save"],
        &["set", "heartbeat", "300ms", "--node", "all"],
        &["set", "heartbeat", "300ms"],
    ];
    for verb in verbs {
        let told = bench.refused(verb);
        assert!(
            told.contains("node 2, the other channel of node 1, does not answer")
                && told.contains("nothing was written")
                && told.contains("--node 1"),
            "{told}"
        );
    }
    let got = bench.json(&["get", "slope-long.offset", "heartbeat", "--node", "1"]);
    assert_eq!(got["objects"][0]["raw"], 0);
    assert_eq!(got["objects"][1]["raw"], 200);
    let done = bench.done(&["zero", "--node", "1"]);
    assert!(done.contains("now in the mean of 16"), "{done}");
    // What is read is printed, and the missing one told.
    for verb in [&["get", "slope-long"][..], &["info"], &["bitrate"]] {
        let (out, err) = half_done(bench.run(verb));
        assert!(out.contains("node 1"), "{out}");
        assert!(err.contains("node 2, the other channel of node 1"), "{err}");
    }
}

#[test]
fn what_was_written_before_a_node_failed_was_not_in_the_json() {
    let mut bench = Bench::quick(&[]);
    bench.word("power b off");
    bench.pass(0.5);
    let words = ["set", "heartbeat", "300ms", "--node", "1,2", "--json"];
    let (out, err) = half_done(bench.run(&words));
    let set: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(set["nodes"].as_array().unwrap().len(), 1);
    assert_eq!(set["nodes"][0]["node"], 1);
    assert!(err.contains("there is no node 2"), "{err}");
    let (out, _) = half_done(bench.run(&["save", "--node", "1,2", "--json"]));
    let save: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(save["saved_nodes"], serde_json::json!([1]));
}

#[test]
fn a_refusal_in_a_table_ended_with_status_0() {
    let bench = Bench::quick(&[]);
    let (out, err) = half_done(bench.run(&["get", "1018h:99"]));
    assert!(out.contains("refused: it has no such sub-index"), "{out}");
    assert!(err.contains("2 objects are refused"), "{err}");
    let words = ["get", "heartbeat", "1018h:99", "--node", "1", "--json"];
    let (out, err) = half_done(bench.run(&words));
    let got: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(got["objects"][0]["raw"], 200);
    assert!(err.contains("node 1 refuses 1018h"), "{err}");
}

#[test]
fn where_frames_got_lost_one_of_two_channels_was_left_out() {
    let mut bench = Bench::quick(&[]);
    bench.word("bus loss 0.3");
    bench.pass(0.3);
    for _ in 0..4 {
        let (status, out, err) = bench.run(&["get", "slope-long"]);
        match status {
            Some(0) => assert!(out.contains("node 1") && out.contains("node 2"), "{out}"),
            status => {
                assert_eq!(status, Some(2), "{err}");
                assert!(!err.contains("no heartbeat and no answer"), "{err}");
            }
        }
    }
}

#[test]
fn an_operational_node_was_to_be_left_behind_by_force() {
    let mut bench = Bench::quick(&[]);
    bench.nmt(1, 0);
    for more in [&[][..], &["--force"]] {
        let told = bench.refused(&[&["bitrate", "500"], more].concat());
        assert!(
            told.contains("OPERATIONAL") && told.contains("1, 2") && told.contains("--stop"),
            "{told}"
        );
        assert!(!told.contains("--force"), "{told}");
    }
    let out = bench.at_500_kbit(&["--stop"], 0.75);
    assert!(
        out.ends_with("node 2: 500 kbit/s, changed and stored"),
        "{out}"
    );
    let scan = bench.json(&["scan"]);
    assert_eq!(scan["nodes"][0]["state"], "operational");
    assert_eq!(scan["nodes"][1]["state"], "operational");
}

#[test]
fn on_a_dead_bus_node_id_asked_for_a_name() {
    let mut bench = Bench::quick(&[]);
    bench.word("power all off");
    bench.pass(0.5);
    let told = bench.refused(&["node-id", "--pair", "3,4"]);
    assert!(
        told.contains("no frame is received on socketcand://"),
        "{told}"
    );
}

#[test]
fn a_preset_without_an_angle_was_told_to_need_pre_operational() {
    let mut bench = Bench::quick(&[]);
    bench.word("fault b stuck");
    bench.pass(0.8);
    let told = bench.refused(&["set", "slope-long.preset", "0deg", "--node", "2"]);
    assert!(
        told.contains("without a valid angle, and there is none ("),
        "{told}"
    );
    assert!(!told.contains("--stop"), "{told}");
}

#[test]
fn operational_nodes_store_nothing_unless_they_may_be_stopped() {
    let mut bench = Bench::quick(&[]);
    bench.nmt(1, 0);
    let told = bench.refused(&["save", "--node", "1"]);
    assert!(
        told.contains("node 1 is OPERATIONAL") && told.contains("--stop"),
        "{told}"
    );
    let told = bench.refused(&["restore", "--node", "1"]);
    assert!(
        told.contains("node 1 is OPERATIONAL") && told.contains("--stop"),
        "{told}"
    );
    bench.done(&["save", "--stop", "--node", "1"]);
    let scan = bench.json(&["scan"]);
    assert_eq!(scan["nodes"][0]["state"], "operational");
}

#[test]
fn two_fresh_nodes_get_their_node_ids_and_find_each_other() {
    let mut bench = Bench::new(&["--node-ids", "none"]);
    let told = bench.refused(&["get", "heartbeat"]);
    assert!(
        told.contains("a node without a node-id is on the bus"),
        "{told}"
    );
    let told = bench.refused(&["node-id", "5"]);
    assert!(
        told.contains("3 nodes") || told.contains("2 nodes without a node-id"),
        "{told}"
    );
    let from = Instant::now();
    let done = bench.done(&["node-id", "--pair", "10,11"]);
    assert!(
        done.contains("channel A: node-id 10 is given and stored"),
        "{done}"
    );
    assert!(
        done.contains("nodes 10 and 11 compare their angles: both agree"),
        "{done}"
    );
    assert!(from.elapsed() < Duration::from_secs(60));
    // It outlasts a reset, and so does what they hold of each other.
    bench.nmt(129, 0);
    let scan = bench.json(&["scan"]);
    assert_eq!(scan["nodes"][0]["node"], 10);
    assert_eq!(scan["nodes"][0]["pair"], 11);
    let got = bench.json(&["get", "1401:1", "--node", "11"]);
    assert_eq!(got["objects"][0]["raw"], 0x48A);
}

/// The raw number of an object.
fn raw(bench: &Bench, address: &str, node: u8) -> u64 {
    let node = node.to_string();
    let got = bench.json(&["get", address, "--node", &node]);
    got["objects"][0]["raw"].as_u64().unwrap()
}

/// Each channel hears the other one's exchange, and no other node's.
fn assert_heard(bench: &Bench, models: Models, pair: [u8; 2]) {
    let [a, b] = pair;
    for (node, peer) in [(a, b), (b, a)] {
        assert_eq!(raw(bench, "2001", node), u64::from(peer));
        assert_eq!(raw(bench, "1016:1", node) >> 16, u64::from(peer));
        for (index, base) in table::exchange(models) {
            let address = format!("{index:04X}:1");
            let heard = u64::from(base) + u64::from(peer);
            assert_eq!(raw(bench, &address, node), heard, "{address} of {node}");
        }
    }
}

const VARIANTS: [(&str, Models); 2] = [("product", Models::PRODUCT), ("dynamic", Models::DYNAMIC)];

#[test]
fn a_second_instrument_heard_the_accelerations_of_the_first_one() {
    for (mode, models) in VARIANTS {
        let bench = Bench::new(&["--instruments", "2", "--mode", mode]);
        assert_heard(&bench, models, [1, 2]);
        assert_heard(&bench, models, [3, 4]);
    }
}

#[test]
fn after_new_node_ids_a_channel_did_not_hear_how_far_the_other_one_had_turned() {
    for (mode, models) in VARIANTS {
        let bench = Bench::new(&["--mode", mode]);
        let told = bench.done(&["node-id", "--pair", "10,11", "--node", "1,2"]);
        assert!(told.contains("compare their angles: both agree"), "{told}");
        let turned = models == Models::DYNAMIC;
        assert_eq!(told.contains("1401h:1, 1402h:1)"), turned, "{told}");
        assert_heard(&bench, models, [10, 11]);
    }
}

#[test]
fn identifiers_that_were_saved_stayed_with_the_old_node_id() {
    let bench = Bench::new(&[]);
    bench.done(&["save"]);
    let told = bench.refused(&["node-id", "2", "--node", "1"]);
    assert!(told.contains("node-id 2 is in use"), "{told}");
    let node_id = bench.json(&["node-id", "7", "--node", "1"]);
    assert_eq!(node_id["agree"], true);
    for (object, raw) in [("1014", 0x87), ("1802:1", 0x387)] {
        let got = bench.json(&["get", object, "--node", "7"]);
        assert_eq!(got["objects"][0]["raw"], raw, "{object}");
    }
    let got = bench.json(&["get", "1400:1", "--node", "2"]);
    assert_eq!(got["objects"][0]["raw"], 0x387);
    // What the channels hold of each other is as delivered again, and that is printed.
    let done = bench.done(&["restore", "--node", "7", "--reset"]);
    assert!(
        done.contains("plumb node-id --pair A,B --node A,B"),
        "{done}"
    );
    let told = bench.done(&["node-id", "--pair", "7,2", "--node", "7,2"]);
    assert!(told.contains("compare their angles: both agree"), "{told}");
}

#[test]
fn all_nodes_change_their_bit_rate_together() {
    let mut bench = Bench::quick(&[]);
    assert_eq!(
        bench.done(&["bitrate"]),
        "node 1: 250 kbit/s\nnode 2: 250 kbit/s"
    );
    let told = bench.refused(&["bitrate", "500", "--node", "1"]);
    assert!(told.contains("a bus has one bit rate"), "{told}");
    let out = bench.at_500_kbit(&["--delay", "300"], 0.45);
    assert!(
        out.ends_with("node 2: 500 kbit/s, changed and stored"),
        "{out}"
    );
    bench.nmt(129, 0);
    assert_eq!(
        bench.done(&["bitrate"]),
        "node 1: 500 kbit/s\nnode 2: 500 kbit/s"
    );
    // An adapter with another rate hears nothing, and that is said.
    bench.word("bit-rate 250");
    bench.pass(0.1);
    let told = bench.refused(&["get", "heartbeat", "--node", "1"]);
    assert!(told.contains("or the bit rate is another one"), "{told}");
}
