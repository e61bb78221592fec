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
