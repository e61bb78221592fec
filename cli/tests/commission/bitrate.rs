//! Changes of the bit rate that are refused, interrupted, or follow an interrupted one.

use super::bench::*;
use super::watch::*;

const BOTH_AS_BEFORE: &str = "node 1: 250 kbit/s\nnode 2: 250 kbit/s";

const CHANGE: [&str; 2] = ["bitrate", "500"];

const NOT_REACHED: &str = "note: these nodes were not reached and keep their bit rate: 2; on a bus \
                           at 500 kbit/s they disturb the others, so connect them to a bus of \
                           their own at their rate, and use `plumb bitrate 500 --force` there";

/// NMT: reset node.
const RESET: u8 = 0x81;

/// A change that is interrupted at such a request.
fn at(bench: &Bench, command: &'static [u8; 1]) -> Interrupted {
    interrupted(bench, &CHANGE, At::first(command))
}

#[test]
fn bitrate_changed_half_an_instrument_without_a_word() {
    let mut bench = Bench::quick(&[]);
    bench.word("power b off");
    bench.pass(0.5);
    let told = bench.refused(&["bitrate", "500"]);
    assert!(
        told.contains("node 2, the other channel of node 1, does not answer")
            && told.contains("nothing was written")
            && told.contains("--force"),
        "{told}"
    );
    bench.nmt(RESET, 0);
    let got = bench.run(&["bitrate"]).1;
    assert_eq!(got, "node 1: 250 kbit/s");
    let out = bench.at_500_kbit(&["--force"], 0.75);
    assert!(
        out.contains("\nnode 1: 500 kbit/s, changed and stored"),
        "{out}"
    );
    assert_eq!(out.lines().last(), Some(NOT_REACHED), "{out}");
}

#[test]
fn bitrate_by_force_did_not_name_the_node_that_it_has_not_reached() {
    let mut bench = Bench::quick(&[]);
    bench.word("power b off");
    bench.pass(0.5);
    let out = bench.at_500_kbit(&["--force", "--json"], 0.75);
    let value: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(value["nodes"][0]["bit_rate_kbit_s"], 500, "{out}");
    assert_eq!(value["not_reached"], serde_json::json!([2]), "{out}");
}

#[test]
fn bitrate_interrupted_before_the_change_left_the_new_rate_stored() {
    let mut bench = Bench::quick(&[]);
    assert_eq!(at(&bench, b"\x17").err, "plumb: interrupted");
    assert_eq!(bench.done(&["bitrate"]), BOTH_AS_BEFORE);
    bench.nmt(RESET, 0);
    assert_eq!(bench.done(&["bitrate"]), BOTH_AS_BEFORE);
}

#[test]
fn bitrate_interrupted_on_a_dead_bus_did_not_print_what_is_stored() {
    let mut bench = Bench::quick(&[]);
    let told = interrupted_on_a_dead_bus(&mut bench, &CHANGE, At::first(b"\x17"));
    assert!(
        told.contains("may have stored 500 kbit/s") && told.contains("next reset on: 1, 2;"),
        "{told}"
    );
}

#[test]
fn bitrate_interrupted_behind_the_change_did_not_print_that_the_nodes_have_changed() {
    let mut bench = Bench::quick(&[]);
    let told = at(&bench, b"\x15").err;
    assert!(
        told.starts_with("plumb: interrupted; these nodes have changed to 500 kbit/s")
            && told.contains("stored it: 1, 2;")
            && told.contains("`plumb twin bit-rate 500`"),
        "{told}"
    );
    bench.word("bit-rate 500");
    bench.pass(0.5);
    let got = bench.done(&["bitrate"]);
    assert_eq!(got, "node 1: 500 kbit/s\nnode 2: 500 kbit/s");
}

#[test]
fn bitrate_interrupted_in_the_selection_left_a_node_in_the_configuration_state() {
    let bench = Bench::quick(&[]);
    let told = at(&bench, b"\x43");
    assert_eq!(told.err, "plumb: interrupted");
    let mut behind = told.behind.iter();
    assert!(behind.any(|(id, data)| *id == LSS && data.starts_with(&[4, 0])));
    assert_eq!(bench.done(&["bitrate"]), BOTH_AS_BEFORE);
}

#[test]
fn bitrate_did_not_find_a_node_that_was_left_in_the_configuration_state() {
    let mut bench = Bench::quick(&[]);
    bench.send(LSS, &[4, 1, 0, 0, 0, 0, 0, 0]);
    let out = bench.at_500_kbit(&[], 0.75);
    assert!(
        out.ends_with("node 2: 500 kbit/s, changed and stored"),
        "{out}"
    );
}
