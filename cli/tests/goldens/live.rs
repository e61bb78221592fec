//! `monitor` on a bus that works, and `replay --onto` such a bus.
//!
//! When a verb joins the bus and how much it hears in a second differs from run to run: of its
//! lines the last one is kept, without numbers. What it shows of given frames is compared to the
//! digit in `logs.rs`.

use super::bus::{Bench, plumb};
use super::golden::{check, decimals, members, numbers};
use super::log_text;
use super::sensors::Folder;
use super::transcript::{Transcript, text};

/// Lines of the standard output of a monitor that runs for a while.
fn monitored(bench: &Bench, line: &str) -> Vec<String> {
    let words: Vec<_> = line.split(' ').collect();
    let output = plumb(&words).args(["--bus", &bench.bus]).output().unwrap();
    let status = (output.status.code(), text(&output.stderr));
    assert_eq!(status, (Some(0), String::new()), "{line}");
    text(&output.stdout).lines().map(str::to_owned).collect()
}

#[test]
fn monitor_shows_a_bus() {
    let bench = Bench::new(&[]);
    let lines = monitored(&bench, "monitor --start --for 3s --bitrate 250000 --plain");
    // The first lines depend on when the nodes heard of each other, an event may come last.
    let settled = |words: &str| {
        let line = lines.iter().rfind(|line| line.contains(words));
        numbers(line.expect("both channels agree"))
    };
    check("monitor-live-text", &settled("ok: both agree"));
    let lines = monitored(&bench, "monitor --for 3s --json");
    let both = |line: &String, words: &str| line.matches(words).count() == 2;
    let settled = |line: &&String| {
        let words = ["\"detail_reason\":null", "\"stale\":false", "\"state\":1,"];
        words.iter().all(|words| both(line, words))
    };
    let mut told = Transcript::default();
    told.part(
        "a line",
        lines.iter().rfind(settled).expect("both channels agree"),
    );
    check("monitor-live-json", &members(&told.text));
}

#[test]
fn replay_sends_a_log_onto_a_bus() {
    let bench = Bench::quick(&[]);
    let folder = Folder::new("golden-onto");
    folder.file("moment.log", log_text::moment());
    let mut told = Transcript::default();
    for more in ["--speed 2", "--json"] {
        let line = format!("replay moment.log --onto {} {more}", bench.bus);
        let words: Vec<_> = line.split(' ').collect();
        told.run(plumb(&words).current_dir(&folder.0));
    }
    // How late a frame was is the machine's own.
    check("replay-onto", &decimals(&told.text));
}
