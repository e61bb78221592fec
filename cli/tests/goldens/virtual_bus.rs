//! `serve` by a script, in virtual time, and `twin` beside a server whose time has not begun.
//!
//! Nothing of either depends on the machine's time: a script that ends the server runs as fast as
//! it can, and with `--await-client` the clock stands at 0. Angles are simulated, so numbers with a
//! fraction are left out.

use std::io::Write as _;
use std::net::TcpListener;
use std::process::Stdio;

use super::bus::plumb;
use super::golden::{check, check_with, decimals};
use super::program::Served;
use super::sensors::Folder;
use super::transcript::Transcript;

const SCRIPT: &str = "\
# Both are at rest, and then one is not.
rate 20
pitch 30
roll -5
temp 40 now
wait 4
status
fault b bias x 20 mg
vibration 20
wait 2
status
heal b
power a off
wire b off
wait 1
status
level
wait
help
quit
";

/// A server that runs the script to its end.
fn serve(told: &mut Transcript, folder: &Folder, more: &str) {
    let line = format!("serve --listen 127.0.0.1:0 --no-stdin --script day.txt --speed max {more}");
    let words: Vec<_> = line.split_whitespace().collect();
    told.run(plumb(&words).current_dir(&folder.0));
}

#[test]
fn a_script_is_served_to_its_end() {
    let folder = Folder::new("golden-serve");
    folder.file("day.txt", SCRIPT);
    let mut told = Transcript::default();
    for more in [
        "--uncalibrated --seed 7",
        "--uncalibrated --mode one-axis",
        "--uncalibrated --mode paper",
        "--uncalibrated --node-ids none",
    ] {
        serve(&mut told, &folder, more);
    }
    check("serve-text", &decimals(&told.text));
    let mut told = Transcript::default();
    serve(&mut told, &folder, "--uncalibrated --json");
    check("serve-json", &decimals(&told.text));
}

/// All ways to the bus that there are on every machine.
#[test]
fn what_a_server_offers() {
    let folder = Folder::new("golden-offers");
    folder.file("day.txt", "quit\n");
    let more = "--uncalibrated --motor 127.0.0.1:0 --chamber 127.0.0.1:0 --slcan 127.0.0.1:0 \
                --instruments 2 --bus-name other";
    let mut told = Transcript::default();
    serve(&mut told, &folder, more);
    serve(&mut told, &folder, &format!("{more} --json"));
    check("serve-offers", &told.text);
}

#[test]
fn words_are_answered() {
    let free = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .to_string();
    // Its time begins with a client of the bus, and none comes.
    let _served = Served::start(&["--uncalibrated", "--await-client", "--twin", &free]);
    let mut told = Transcript::default();
    for words in [
        &["pitch 30", "roll -5", "rate 20", "level"][..],
        &["status"],
        &["fault", "b", "bias", "x", "-20", "mg"],
        &["+5 s heal b", "power a off", "status"],
        &["levitate"],
        &["pitch", "500"],
        &["fault b melt", "level"],
        &["help"],
        &["level", "status", "pitch x", "--json"],
    ] {
        told.run(plumb(&["twin", "--to", &free]).args(words));
    }
    let mut lines = plumb(&["twin", "--to", &free, "-"]);
    let mut child = lines
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child
        .stdin
        .take()
        .unwrap()
        .write_all(b"level\n\nnothing\n")
        .unwrap();
    told.ended(&lines, &child.wait_with_output().unwrap());
    check_with("twin-session", &told.text, &[]);
}
