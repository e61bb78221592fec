//! Changes of the bit rate that are refused, interrupted, or follow an interrupted one.

use std::io::{BufReader, prelude::*};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use super::bench::*;

const BOTH_AS_BEFORE: &str = "node 1: 250 kbit/s\nnode 2: 250 kbit/s";

const NOT_REACHED: &str = "note: these nodes were not reached and keep their bit rate: 2; on a bus \
                           at 500 kbit/s they disturb the others, so connect them to a bus of \
                           their own at their rate, and use `plumb bitrate 500 --force` there";

/// NMT: reset node.
const RESET: u8 = 0x81;

/// A second client of the bus, which sees the frames of the first.
struct Watch(BufReader<TcpStream>);

impl Watch {
    fn new(bench: &Bench) -> Self {
        let mut stream = TcpStream::connect(&bench.bus).unwrap();
        write!(stream, "< open plumb >< rawmode >").unwrap();
        sleep(Duration::from_millis(200));
        Self(BufReader::new(stream))
    }

    /// Sends a request of the LSS master.
    fn request(&mut self, bytes: &str) {
        write!(self.0.get_mut(), "< send 7E5 8 {bytes} >").unwrap();
    }

    /// Waits for a request of the LSS master that begins so.
    fn until(&mut self, begin: &str) {
        loop {
            let mut word = Vec::new();
            assert!(self.0.read_until(b'>', &mut word).unwrap() > 0, "{begin}");
            let word = String::from_utf8_lossy(&word).into_owned();
            let mut parts = word.split_whitespace().skip_while(|part| *part != "frame");
            let is_request = parts.nth(1) == Some("7E5");
            if is_request && parts.nth(1).is_some_and(|bytes| bytes.starts_with(begin)) {
                return;
            }
        }
    }
}

fn begun(bench: &Bench) -> Child {
    let mut change = plumb(&["bitrate", "500", "--bus", &bench.bus]);
    let pipes = change.stdout(Stdio::piped()).stderr(Stdio::piped());
    pipes.spawn().unwrap()
}

/// What a change says that is interrupted now.
fn interrupted(change: Child) -> String {
    let id = change.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status().unwrap();
    assert!(sent.success());
    let (status, _, err) = said(&change.wait_with_output().unwrap());
    assert_eq!(status, Some(2), "{err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    err
}

#[test]
fn bitrate_changed_half_an_instrument_without_a_word() {
    let mut bench = Bench::quick(&[]);
    bench.word("power b off");
    sleep(Duration::from_millis(500));
    let told = bench.refused(&["bitrate", "500"]);
    assert!(
        told.contains("node 2, the other channel of node 1, does not answer")
            && told.contains("nothing was written")
            && told.contains("--force"),
        "{told}"
    );
    bench.nmt(RESET, 0);
    let got = bench.say(&["bitrate"]).1;
    assert_eq!(got, "node 1: 250 kbit/s");
    let out = bench.at_500_kbit(&["--force"], 3500);
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
    sleep(Duration::from_millis(500));
    let out = bench.at_500_kbit(&["--force", "--json"], 3500);
    let value: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(value["nodes"][0]["bit_rate_kbit_s"], 500, "{out}");
    assert_eq!(value["not_reached"], serde_json::json!([2]), "{out}");
}

#[test]
fn bitrate_interrupted_before_the_change_left_the_new_rate_stored() {
    let bench = Bench::quick(&[]);
    let mut watch = Watch::new(&bench);
    let change = begun(&bench);
    watch.until("17");
    assert_eq!(interrupted(change), "plumb: interrupted");
    assert_eq!(bench.done(&["bitrate"]), BOTH_AS_BEFORE);
    bench.nmt(RESET, 0);
    assert_eq!(bench.done(&["bitrate"]), BOTH_AS_BEFORE);
}

#[test]
fn bitrate_interrupted_on_a_dead_bus_did_not_say_what_is_stored() {
    let mut bench = Bench::quick(&[]);
    let mut watch = Watch::new(&bench);
    let change = begun(&bench);
    watch.until("17");
    bench.word("power all off");
    let told = interrupted(change);
    assert!(
        told.contains("may have stored 500 kbit/s") && told.contains("next reset on: 1, 2;"),
        "{told}"
    );
}

#[test]
fn bitrate_interrupted_behind_the_change_did_not_say_that_the_nodes_have_changed() {
    let mut bench = Bench::quick(&[]);
    let mut watch = Watch::new(&bench);
    let change = begun(&bench);
    watch.until("15");
    let told = interrupted(change);
    assert!(
        told.starts_with("plumb: interrupted; these nodes have changed to 500 kbit/s")
            && told.contains("stored it: 1, 2;")
            && told.contains("`plumb twin bit-rate 500`"),
        "{told}"
    );
    bench.word("bit-rate 500");
    sleep(Duration::from_millis(500));
    let got = bench.done(&["bitrate"]);
    assert_eq!(got, "node 1: 500 kbit/s\nnode 2: 500 kbit/s");
}

#[test]
fn bitrate_interrupted_in_the_selection_left_a_node_in_the_configuration_state() {
    let bench = Bench::quick(&[]);
    let mut watch = Watch::new(&bench);
    let change = begun(&bench);
    watch.until("43");
    assert_eq!(interrupted(change), "plumb: interrupted");
    watch.until("0400");
    assert_eq!(bench.done(&["bitrate"]), BOTH_AS_BEFORE);
}

#[test]
fn bitrate_did_not_find_a_node_that_was_left_in_the_configuration_state() {
    let mut bench = Bench::quick(&[]);
    Watch::new(&bench).request("4 1 0 0 0 0 0 0");
    sleep(Duration::from_millis(200));
    let out = bench.at_500_kbit(&[], 3500);
    assert!(
        out.ends_with("node 2: 500 kbit/s, changed and stored"),
        "{out}"
    );
}
