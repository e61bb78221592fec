//! Verbs on nodes that are STOPPED or OPERATIONAL.

use super::bench::*;

/// The NMT commands by hand.
const START: u8 = 1;
const STOP: u8 = 2;

fn state(bench: &Bench, place: usize) -> String {
    let scan = bench.json(&["scan"]);
    let state = scan["nodes"][place]["state"].as_str();
    state.unwrap_or("none").to_owned()
}

#[test]
fn a_stopped_node_was_to_be_given_the_stop_that_it_had() {
    let mut bench = Bench::quick(&[]);
    bench.nmt(STOP, 1);
    bench.done(&["save", "--stop", "--node", "1"]);
    assert_eq!(state(&bench, 0), "stopped");
    let done = bench.done(&["set", "heartbeat", "150ms", "--stop", "--node", "1"]);
    assert!(done.contains("is 150 ms, counts at once"), "{done}");
    // The unit of this one is read from the node first.
    let offset = ["set", "slope-long.differential-offset", "1deg"];
    bench.done(&[&offset[..], &["--stop", "--node", "1"]].concat());
    bench.done(&["restore", "--only", "profile", "--stop", "--node", "1"]);
    assert_eq!(state(&bench, 0), "stopped");
    bench.done(&["restore", "--reset", "--stop", "--node", "1"]);
    assert_eq!(state(&bench, 0), "stopped");
}

#[test]
fn the_remedy_for_a_stopped_node_was_what_had_just_been_typed() {
    let mut bench = Bench::quick(&[]);
    bench.nmt(STOP, 1);
    let told = bench.refused(&["info", "1"]);
    assert!(told.contains("000#8001"), "{told}");
    // Where no node is named, that is what is missing.
    let told = bench.refused(&["save", "--stop"]);
    assert!(
        told.contains("is in STOPPED") && told.contains("name both with --node"),
        "{told}"
    );
    bench.nmt(STOP, 2);
    let told = bench.refused(&["save", "--stop"]);
    assert!(told.contains("use --node 1 --stop"), "{told}");
    bench.done(&["save", "--stop", "--node", "1,2"]);
}

#[test]
fn calibrate_did_not_print_that_a_node_is_stopped() {
    let mut bench = Bench::quick(&[]);
    bench.nmt(STOP, 2);
    let file = Scratch::new();
    let path = file.0.display().to_string();
    let told = bench.refused(&["calibrate", "--keep", &path]);
    assert!(told.starts_with("plumb: node 2 is in STOPPED"), "{told}");
}

#[test]
fn a_stopped_node_was_to_be_left_behind_by_a_change_of_the_bit_rate() {
    let mut bench = Bench::quick(&[]);
    bench.nmt(STOP, 1);
    let told = bench.refused(&["bitrate", "500", "--force"]);
    assert!(
        told.contains("STOPPED") && told.contains("them: 1;") && told.contains("--stop"),
        "{told}"
    );
    let out = bench.at_500_kbit(&["--stop"], 0.75);
    assert!(
        out.contains("node 1: 500 kbit/s, changed and stored"),
        "{out}"
    );
    assert_eq!(state(&bench, 0), "stopped");
}

#[test]
fn an_operational_node_was_asked_for_its_twin_by_node_id() {
    let mut bench = Bench::quick(&[]);
    bench.nmt(START, 0);
    let one = ["node-id", "7", "--node", "1"];
    let both = ["node-id", "--pair", "10,11", "--node", "1,2"];
    for (words, nodes) in [(&one[..], "LSS: 1;"), (&both, "LSS: 1, 2;")] {
        let told = bench.refused(words);
        assert!(
            told.contains("OPERATIONAL") && told.contains(nodes) && told.contains("--stop"),
            "{told}"
        );
    }
    assert_eq!(state(&bench, 0), "operational");
    let done = bench.done(&[&both[..], &["--stop"]].concat());
    assert!(done.contains("nodes 10 and 11 are back"), "{done}");
    assert_eq!(state(&bench, 0), "operational");
    assert_eq!(state(&bench, 1), "operational");
}

#[test]
fn the_other_channel_was_left_in_pre_operational_by_node_id() {
    let mut bench = Bench::new(&[]);
    bench.nmt(START, 2);
    let done = bench.done(&["node-id", "7", "--node", "1"]);
    assert!(done.contains("nodes 7 and 2 compare"), "{done}");
    // In the order of the node-ids: the other channel first.
    assert_eq!(state(&bench, 0), "operational");
    assert_eq!(state(&bench, 1), "pre-operational");
}

#[test]
fn two_channels_a_were_calibrated_as_one_instrument() {
    let bench = Bench::quick(&["--instruments", "2"]);
    let file = Scratch::new();
    let path = file.0.display().to_string();
    let refused = |verb: &str, nodes: &str| {
        let words = [verb, "--keep", &path, "--nodes", nodes];
        bench.refused(&words)
    };
    for verb in ["calibrate", "characterise"] {
        let told = refused(verb, "1,3");
        assert!(told.contains("nodes 1 and 3 are both channel A"), "{told}");
        let told = refused(verb, "3,2");
        assert!(
            told.contains("the other channel of node 3 is node 4"),
            "{told}"
        );
    }
    bench.done(&["calibrate", "--keep", &path, "--nodes", "4,3"]);
}

/// An instrument whose nodes send no heartbeat, after this NMT command to both.
fn unheard(command: Option<u8>, more: &[&str]) -> Bench {
    let mut bench = Bench::quick(more);
    bench.done(&["set", "heartbeat", "0ms", "--node", "all"]);
    if let Some(command) = command {
        bench.nmt(command, 0);
        bench.pass(2.0);
    }
    bench
}

fn assert_operational(bench: &Bench, node: &str) {
    let told = bench.refused(&["save", "--node", node]);
    assert!(
        told.contains("is OPERATIONAL, where it stores nothing"),
        "{told}"
    );
}

const UNKNOWN: &str = "sends no heartbeat (1017h), so its state before is not known and it is left \
                       in PRE-OPERATIONAL";

#[test]
fn without_a_heartbeat_stop_left_a_node_operational_and_the_verb_failed() {
    let bench = unheard(Some(START), &[]);
    assert_operational(&bench, "1");
    for words in [&["save"][..], &["restore"], &["set", "nmt-startup", "0"]] {
        let done = bench.done(&[words, &["--stop", "--node", "1"]].concat());
        assert!(!done.contains("PRE-OPERATIONAL"), "{done}");
        assert_operational(&bench, "1");
    }
}

#[test]
fn without_a_heartbeat_calibrate_left_the_nodes_in_pre_operational_without_a_word() {
    let bench = unheard(Some(START), &[]);
    let file = Scratch::new();
    let path = file.0.display().to_string();
    bench.done(&["calibrate", "--keep", &path]);
    bench.done(&["calibrate", "--restore", &path]);
    for node in ["1", "2"] {
        assert_operational(&bench, node);
    }
    // A node without heartbeat and PDOs may have been in any state.
    let bench = unheard(None, &[]);
    let (status, _, err) = bench.run(&["calibrate", "--restore", &path]);
    assert_eq!(status, Some(0), "{err}");
    assert_eq!(err.matches(UNKNOWN).count(), 2, "{err}");
}

#[test]
fn without_a_heartbeat_node_id_did_not_stop_the_nodes() {
    let bench = unheard(Some(START), &[]);
    bench.done(&["save", "--stop"]);
    let done = bench.done(&["node-id", "7", "--node", "1", "--stop"]);
    assert!(done.contains("nodes 7 and 2 compare"), "{done}");
    assert!(!done.contains("PRE-OPERATIONAL"), "{done}");
    for node in ["2", "7"] {
        assert_operational(&bench, node);
    }
}

#[test]
fn without_a_heartbeat_bitrate_did_not_stop_the_nodes() {
    let mut bench = unheard(Some(START), &[]);
    let told = bench.refused(&["bitrate", "500"]);
    assert!(
        told.contains("OPERATIONAL do not answer LSS: 1, 2;"),
        "{told}"
    );
    let out = bench.at_500_kbit(&["--stop"], 0.75);
    assert!(
        out.ends_with("node 2: 500 kbit/s, changed and stored"),
        "{out}"
    );
    for node in ["1", "2"] {
        assert_operational(&bench, node);
    }
}

#[test]
fn a_node_whose_state_nothing_tells_is_left_in_pre_operational_with_a_word() {
    for command in [None, Some(STOP)] {
        let mut bench = unheard(command, &[]);
        let done = bench.done(&["save", "--stop", "--node", "1"]);
        assert!(done.contains(&format!("note: node 1 {UNKNOWN}")), "{done}");
        let save = bench.json(&["save", "--stop", "--node", "1"]);
        assert_eq!(save["left_nodes"], serde_json::json!([1]));
        bench.nmt(STOP, 1);
        let done = bench.done(&["restore", "--stop", "--node", "1"]);
        assert!(done.contains(UNKNOWN), "{done}");
    }
    let mut bench = unheard(None, &[]);
    let done = bench.done(&["node-id", "7", "--node", "1", "--stop"]);
    assert!(done.contains(&format!("node 7 {UNKNOWN}")), "{done}");
    bench.done(&["set", "heartbeat", "0ms", "--node", "7"]);
    let out = bench.at_500_kbit(&["--stop"], 0.75);
    assert!(out.contains(&format!("note: node 7 {UNKNOWN}")), "{out}");
}

/// It was to be looked for among the faults, and in `plumb info`, which does not show it.
#[test]
fn a_node_without_a_heartbeat_and_pdos_was_not_named_as_operational() {
    let mut bench = unheard(None, &[]);
    for (tpdo, id) in [0x180, 0x280, 0x380, 0x480].into_iter().enumerate() {
        let (address, cob_id) = (format!("180{tpdo}h:1"), format!("0x8000{:04X}", id + 1));
        bench.done(&["set", &address, &cob_id, "--node", "1"]);
    }
    bench.nmt(START, 0);
    bench.pass(2.0);
    for words in [&["save"][..], &["restore"], &["set", "1301h:2", "30"]] {
        let told = bench.refused(&[words, &["--node", "1"]].concat());
        assert!(
            told.contains("(abort code 0800 0022h), and sends no heartbeat")
                && told.contains("use --stop"),
            "{told}"
        );
    }
    let done = bench.done(&["set", "1301h:2", "30", "--node", "1", "--stop"]);
    assert!(done.contains(UNKNOWN), "{done}");
}
