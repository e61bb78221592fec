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
