//! When nobody answers, and the ways to a bus.

use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::process::Stdio;
use std::time::{Duration, Instant};

use super::bench::*;

#[test]
fn when_nobody_answers_it_is_said_why() {
    let mut bench = Bench::quick(&[]);
    let told = bench.refused(&["get", "heartbeat", "--node", "5"]);
    assert_eq!(
        told,
        "plumb: there is no node 5; nodes 1 and 2 are there: name one of these"
    );
    bench.nmt(2, 1);
    let told = bench.refused(&["get", "heartbeat", "--node", "1"]);
    assert!(told.starts_with("plumb: node 1 is in STOPPED"), "{told}");
    let scan = bench.json(&["scan"]);
    assert_eq!(scan["nodes"][0]["reason"], "its SDO server does not answer");
    bench.word("power all off");
    bench.pass(0.3);
    let told = bench.refused(&["scan"]);
    assert!(
        told.contains("no frame is received on socketcand://127.0.0.1:"),
        "{told}"
    );
}

#[test]
fn a_bus_that_cannot_be_joined_is_told_with_what_to_do() {
    let refused = |words: &[&str]| {
        let (status, out, err) = said(&plumb(words).output().unwrap());
        assert_eq!((status, out.as_str()), (Some(2), ""), "{words:?}: {err}");
        assert_eq!(err.lines().count(), 1, "{err}");
        err
    };
    let free = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let told = refused(&["scan", "--bus", &free.to_string()]);
    assert!(
        told.contains(&format!(
            "nothing accepts a connection at {free}: start `plumb serve`"
        )),
        "{told}"
    );
    let told = refused(&["scan", "--bus", "slcan:///dev/no-such-port"]);
    assert!(
        told.contains("there is no serial port /dev/no-such-port"),
        "{told}"
    );
    let told = refused(&["scan", "--bus", "http://x:1"]);
    assert!(told.contains("is no bus: write socketcand://"), "{told}");
    let told = refused(&["scan", "--bus", "can0", "-c", "can1"]);
    assert!(told.contains("--bus and -c both name a bus"), "{told}");
    let told = refused(&["scan", "-i", "pcan"]);
    assert!(
        told.contains("take socketcand, slcan or socketcan"),
        "{told}"
    );
    // No machine has this interface; most test machines have no CAN at all.
    if cfg!(target_os = "linux") {
        let told = refused(&["scan", "-i", "socketcan", "-c", "nocan77"]);
        assert!(told.contains("CAN interface nocan77"), "{told}");
    }
}

/// On a busy machine a scan may be at its start for a second: then it has not joined the bus yet,
/// and is given longer. What is joined ends at once; a scan left to itself goes on for more than
/// forty seconds.
const WAITS: [Duration; 3] = [
    Duration::from_secs(1),
    Duration::from_secs(4),
    Duration::from_secs(16),
];
const AT_ONCE: Duration = Duration::from_secs(20);

/// What a scan ends with whose server goes away so much after its start: its status, its message,
/// and how long after that it ends.
fn left_alone(after: Duration) -> (Option<i32>, String, Duration) {
    let mut bench = Bench::quick(&[]);
    let scan = plumb(&["scan", "--time", "60", "--bus", &bench.bus])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(after);
    bench.served.child.kill().unwrap();
    let from = Instant::now();
    let (status, _, err) = said(&scan.wait_with_output().unwrap());
    (status, err, from.elapsed())
}

#[test]
fn a_server_that_goes_away_ends_a_verb_at_once() {
    let gone = "the server has closed the connection";
    let mut ends = WAITS.into_iter().map(left_alone);
    let joined = ends.find(|(_, err, _)| err.contains(gone));
    let (status, err, took) = joined.expect("a scan that joins the bus within 16 s");
    assert_eq!(status, Some(2), "{err}");
    assert!(took < AT_ONCE, "{took:?}");
}

#[test]
fn slcan_over_tcp_is_as_good_and_variables_name_the_bus() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap().to_string();
    drop(listener);
    let _bench = Bench::quick(&["--slcan", &at]);
    let url = format!("slcan://{at}");
    let output = plumb(&["get", "calibration-data", "serial-number", "--bus", &url]).output();
    let (status, out, err) = said(&output.unwrap());
    assert_eq!(status, Some(0), "{err}");
    assert!(out.contains("serial-number"), "{out}");
    let by_variables = plumb(&["get", "serial-number", "--node", "2"])
        .env("CAN_INTERFACE", "slcan")
        .env("CAN_CHANNEL", format!("socket://{at}"))
        .env("CAN_BITRATE", "250000")
        .output();
    let (status, out, err) = said(&by_variables.unwrap());
    assert_eq!(status, Some(0), "{err}");
    assert!(out.ends_with('2'), "{out}");
}

/// Waits until an adapter answers: a busy machine may let it be silent longer than a verb waits.
#[cfg(target_os = "linux")]
fn await_adapter(bus: &str) {
    let until = Instant::now() + Duration::from_secs(60);
    loop {
        let output = plumb(&["get", "serial-number", "--node", "1", "--bus", bus]).output();
        let (status, _, err) = said(&output.unwrap());
        if status == Some(0) {
            return;
        }
        assert!(Instant::now() < until, "{err}");
    }
}

/// A pseudo-terminal is a serial port to a client; when the server goes it is unplugged.
///
/// What a scan ends with whose adapter is unplugged so much after its start: its status, its
/// message, and how long after that it ends.
#[cfg(target_os = "linux")]
fn unplugged(after: Duration) -> (Option<i32>, String, Duration) {
    let mut server = plumb(&[
        "serve",
        "--listen",
        "127.0.0.1:0",
        "--uncalibrated",
        "--pty",
    ])
    .stdin(Stdio::piped())
    .stdout(Stdio::piped())
    .stderr(Stdio::null())
    .spawn()
    .unwrap();
    let lines = BufReader::new(server.stdout.take().unwrap()).lines();
    let ready: Vec<_> = lines.map_while(Result::ok).take(8).collect();
    let title = ready.iter().find_map(|line| line.strip_prefix("SLCAN on "));
    let path = title.unwrap_or_else(|| panic!("{ready:?}")).to_owned();
    let bus = format!("slcan://{path}");
    await_adapter(&bus);
    let scan = plumb(&["scan", "--time", "60", "--bus", &bus])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(after);
    server.kill().unwrap();
    server.wait().unwrap();
    let from = Instant::now();
    let (status, _, err) = said(&scan.wait_with_output().unwrap());
    (status, err, from.elapsed())
}

#[cfg(target_os = "linux")]
#[test]
fn a_serial_adapter_that_is_unplugged_is_named() {
    let joined = WAITS
        .into_iter()
        .map(unplugged)
        .find(|(_, err, _)| !err.contains("cannot join the bus"));
    let (status, err, took) = joined.expect("a scan that joins the bus within 16 s");
    assert_eq!(status, Some(2), "{err}");
    assert!(
        err.contains("the adapter is gone") && err.contains("unplugged"),
        "{err}"
    );
    assert!(took < AT_ONCE, "{took:?}");
}
