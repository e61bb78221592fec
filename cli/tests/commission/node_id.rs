//! New node-ids that are interrupted.

use super::bench::*;
use super::watch::*;

/// NMT: reset node, reset communication.
const RESETS: [u8; 2] = [0x81, 0x82];

const NEW: [&str; 3] = ["node-id", "--pair", "10,11"];

/// The node-ids on the bus, also after resets of the nodes.
fn assert_are(bench: &mut Bench, ids: [u8; 2]) {
    for command in [None, Some(RESETS[1]), Some(RESETS[0])] {
        if let Some(command) = command {
            bench.nmt(command, 0);
        }
        let scan = bench.json(&["scan"]);
        let nodes = scan["nodes"].as_array().unwrap();
        let found: Vec<_> = nodes.iter().map(|node| node["node"].as_u64()).collect();
        assert_eq!(found, ids.map(|id| Some(u64::from(id))), "{command:?}");
    }
}

/// The frame with which a node is told to store, by its number.
const fn store(number: usize) -> At {
    At {
        number,
        ..At::first(b"\x17")
    }
}

/// What new node-ids print that are interrupted there.
fn at(bench: &Bench, words: &[&str], at: At) -> String {
    interrupted(bench, words, at).err
}

/// Interrupts new node-ids there, and expects the old ones.
fn assert_taken_back(bench: &mut Bench, there: At) {
    let words = [&NEW[..], &["--node", "1,2"]].concat();
    assert_eq!(at(bench, &words, there), "plumb: interrupted");
    assert_are(bench, [1, 2]);
}

#[test]
fn node_id_interrupted_before_it_was_stored_left_it_pending() {
    assert_taken_back(&mut Bench::quick(&[]), At::first(b"\x11"));
}

#[test]
fn node_id_interrupted_before_the_reset_left_it_stored() {
    let mut bench = Bench::quick(&[]);
    assert_taken_back(&mut bench, store(1));
    // The first channel has stored its own by then.
    assert_taken_back(&mut bench, store(2));
}

#[test]
fn node_id_interrupted_on_fresh_nodes_left_one_with_a_node_id() {
    let mut bench = Bench::quick(&["--node-ids", "none"]);
    assert_eq!(at(&bench, &NEW, store(2)), "plumb: interrupted");
    bench.pass(0.5);
    let (status, _, told) = bench.run(&["get", "heartbeat"]);
    assert_eq!(status, Some(2), "{told}");
    assert!(
        told.contains("a node without a node-id is on the bus"),
        "{told}"
    );
    let done = bench.run(&NEW).1;
    assert!(done.contains("channel B: node-id 11 is given"), "{done}");
}

#[test]
fn node_id_interrupted_on_a_dead_bus_did_not_print_what_is_stored() {
    let mut bench = Bench::quick(&[]);
    let words = ["node-id", "7", "--node", "1"];
    let told = interrupted_on_a_dead_bus(&mut bench, &words, store(1));
    assert!(
        told.contains("may be stored") && told.contains("reset on: 7 for node 1;"),
        "{told}"
    );
}

#[test]
fn node_id_interrupted_behind_the_reset_did_not_print_that_the_nodes_have_changed() {
    let mut bench = Bench::quick(&[]);
    let last_reset = At {
        id: 0,
        begin: b"\x82\x02",
        number: 1,
    };
    let told = at(&bench, &[&NEW[..], &["--node", "1,2"]].concat(), last_reset);
    assert!(
        told.starts_with("plumb: interrupted; these nodes have their new node-ids: 10, 11;"),
        "{told}"
    );
    assert_are(&mut bench, [10, 11]);
}

#[test]
fn a_node_id_was_changed_while_the_other_channel_that_refers_to_it_was_off() {
    let mut bench = Bench::new(&[]);
    bench.word("power b off");
    bench.pass(0.5);
    let words = ["node-id", "7", "--node", "1"];
    let told = bench.refused(&words);
    assert!(
        told.contains("node 2, the other channel of node 1, does not answer")
            && told.contains("nothing was written")
            && told.contains("--force"),
        "{told}"
    );
    bench.nmt(RESETS[0], 0);
    assert_eq!(bench.json(&["scan"])["nodes"][0]["node"], 1);
    let done = bench.done(&[&words[..], &["--force"]].concat());
    assert!(
        done.contains("node 7 answers\n") && done.contains("node 2, its other channel,"),
        "{done}"
    );
    bench.word("power b on");
    bench.pass(1.2);
    // As the note states.
    assert!(
        done.ends_with("`plumb node-id --pair 7,2 --node 7,2`"),
        "{done}"
    );
    let done = bench.done(&["node-id", "--pair", "7,2", "--node", "7,2"]);
    assert!(done.contains("nodes 7 and 2 compare"), "{done}");
}

#[test]
fn a_fresh_node_alone_gets_its_node_id() {
    let mut bench = Bench::quick(&["--node-ids", "none"]);
    bench.word("power b off");
    bench.pass(0.5);
    let done = bench.done(&["node-id", "5"]);
    assert!(
        done.contains("node 5 answers; no other channel refers to it yet"),
        "{done}"
    );
}
