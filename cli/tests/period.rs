//! `plumb report` and `plumb faults` from the outside, against the nodes of `plumb serve`.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::Output;
use std::time::Duration;

use serde_json::Value;

mod program;

use program::{Folder, Served, plumb};

/// A bus with two nodes in OPERATIONAL, of which the second one has got noisy.
struct Bench {
    served: Served,
    bus: String,
    log: String,
}

impl Bench {
    fn new() -> Self {
        let arguments = ["--speed", "20", "--bit-rate", "1000", "--await-client"];
        let served = Served::start(&arguments);
        let mut bench = Self {
            bus: served.bus(),
            served,
            log: String::new(),
        };
        bench.record();
        bench
    }

    fn word(&mut self, word: &str) {
        self.served.word(word);
    }

    /// Writes down what is on the bus until a fault has been told and some SYNCs have passed.
    fn record(&mut self) {
        let mut bus = TcpStream::connect(&self.bus).unwrap();
        bus.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut text = String::new();
        for (order, answer) in [("", "hi"), ("< open plumb >", "ok"), ("< rawmode >", "ok")] {
            bus.write_all(order.as_bytes()).unwrap();
            while !text.contains(answer) {
                take(&mut bus, &mut text);
            }
            text.clear();
        }
        std::thread::sleep(Duration::from_millis(150));
        bus.write_all(b"< send 0 2 1 0 >").unwrap();
        let (mut from, mut broken, mut told) = (None, false, None);
        loop {
            take(&mut bus, &mut text);
            while let Some((line, rest)) = text.split_once('>') {
                let words: Vec<&str> = line.split_whitespace().collect();
                if let ["<", "frame", id, time, data @ ..] = &words[..] {
                    let at: f64 = time.parse().unwrap();
                    let since = at - *from.get_or_insert(at);
                    let us = 1_795_154_400_000_000 + (since * 1e6) as u64;
                    self.log += &format!(
                        "({}.{:06}) can0 {id:0>3}#{}\n",
                        us / 1_000_000,
                        us % 1_000_000,
                        data.concat()
                    );
                    if !broken && since > 4.0 {
                        broken = true;
                        self.word("fault b noise 40");
                    }
                    if broken && matches!(*id, "81" | "082" | "081" | "82") {
                        told.get_or_insert(since);
                    }
                    if broken && told.is_some_and(|told| since > told + 4.0) {
                        return;
                    }
                    assert!(since < 60.0, "no fault was told");
                }
                text = rest.to_owned();
            }
        }
    }
}

fn take(bus: &mut TcpStream, text: &mut String) {
    let mut bytes = [0; 65_536];
    let count = bus.read(&mut bytes).unwrap();
    assert!(count > 0, "the server has gone");
    text.push_str(std::str::from_utf8(&bytes[..count]).unwrap());
}

fn said(output: &Output) -> (Option<i32>, String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

#[test]
fn a_fault_is_in_the_log_in_the_memory_of_the_nodes_and_on_the_page() {
    let bench = Bench::new();
    let folder = Folder::new();
    let (log, out) = (folder.path("day.log"), folder.path("out"));
    fs::write(&log, &bench.log).unwrap();
    let url = format!("socketcand://{}/plumb", bench.bus);
    let arguments = [
        "report",
        &log,
        "--out",
        &out,
        "--bitrate",
        "1000000",
        "--bus",
        &url,
    ];
    let (status, text, err) = said(&plumb(&arguments).output().unwrap());
    assert_eq!(status, Some(0), "{err}");
    assert!(text.starts_with("One instrument, "), "{text}");
    assert!(text.contains("the sensor is too noisy"), "{text}");
    let page = fs::read_to_string(folder.0.path().join("out/report.html")).unwrap();
    assert!(page.contains("Fault memory: node 2") && page.contains("Plot 1"));
    let report = fs::read_to_string(folder.0.path().join("out/report.json")).unwrap();
    let report: Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["format"], "plumb-period");
    assert_eq!(report["memories"].as_array().unwrap().len(), 2);
    let codes = report["instruments"][0]["events"].as_array().unwrap();
    assert!(
        codes.iter().any(|event| event["code"] == "FF05h"),
        "{codes:?}"
    );
    asked_alone_and_read_later(&folder, &url);
}

/// The same from the nodes alone, and later from the files.
fn asked_alone_and_read_later(folder: &Folder, url: &str) {
    let boxes = folder.path("boxes");
    let asked = ["faults", "--bus", url, "--boxes", &boxes, "--json"];
    let (status, text, err) = said(&plumb(&asked).output().unwrap());
    assert_eq!(status, Some(0), "{err}");
    let faults: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        (&faults["format"], &faults["version"]),
        (&"plumb-faults".into(), &1.into())
    );
    let entries = faults["memories"][1]["entries"].as_array().unwrap();
    assert!(
        entries.iter().any(|entry| entry["code"] == "FF05h"),
        "{entries:?}"
    );
    assert!(
        !faults["memories"][1]["boxes"]
            .as_array()
            .unwrap()
            .is_empty()
    );
    let table = fs::read_to_string(folder.0.path().join("boxes/node-2-box-1.csv")).unwrap();
    assert!(table.lines().count() > 20, "{table}");
    let saved = folder.path("boxes/node-2-box-1.bin");
    let log = folder.path("boxes/node-2-fault-log.bin");
    let (status, text, err) = said(&plumb(&["faults", &log, &saved]).output().unwrap());
    assert_eq!(status, Some(0), "{err}");
    assert!(
        text.contains("the sensor is too noisy") && text.contains("Box 1"),
        "{text}"
    );
    let out = folder.path("remembered");
    let arguments = ["report", "--black-box", &saved, &log, "--out", &out];
    let (status, text, err) = said(&plumb(&arguments).output().unwrap());
    assert_eq!(status, Some(0), "{err}");
    assert!(text.starts_with("2 fault memories contain "), "{text}");
}

#[test]
fn a_node_that_is_not_there_is_named_and_what_the_other_told_is_printed() {
    let bench = Bench::new();
    let url = format!("socketcand://{}/plumb", bench.bus);
    let asked = ["faults", "--bus", &url, "--node", "9,2"];
    let (status, text, err) = said(&plumb(&asked).output().unwrap());
    assert_eq!(status, Some(2));
    assert!(text.contains("the sensor is too noisy"), "{text}");
    assert!(err.contains("node 9") && err.lines().count() == 1, "{err}");
}

#[test]
fn what_can_not_be_reported_on_is_said_in_a_sentence() {
    let folder = Folder::new();
    let log = folder.path("a.log");
    fs::write(&log, "(1795154400.000000) can0 080#\n").unwrap();
    let empty = folder.path("empty.log");
    fs::write(&empty, "").unwrap();
    let refused = |arguments: &[&str], sentence: &str| {
        let out = folder.path("out");
        let arguments = [&["report", "--out", &out], arguments].concat();
        let (status, text, err) = said(&plumb(&arguments).output().unwrap());
        assert_eq!((status, text.as_str()), (Some(2), ""), "{err}");
        assert!(err.contains(sentence), "{err}");
        assert_eq!(err.lines().count(), 1, "{err}");
        assert!(!folder.0.path().join("out").exists());
    };
    refused(&[], "nothing to report on");
    refused(&["no such file"], "no such file");
    refused(&[&log, "--to", "2020-01-01"], "outside the time asked for");
    refused(
        &[&log, "--from", "9", "--to", "8"],
        "--to is not after --from",
    );
    refused(&["--black-box", &log], "a.log can't be used");
    refused(&[&empty], "empty.log is no log of a CAN bus");
    refused(&[&log, "--eds", "none.eds@1"], "none.eds");
    refused(&[&log, "--bus", "127.0.0.1:9"], "127.0.0.1:9");
}
