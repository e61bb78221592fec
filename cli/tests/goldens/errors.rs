//! What each verb says when it can't do its work: one sentence and status 2.
//!
//! In: for each verb, lines with an unknown file, a file that is something else, a wrong node, a
//! wrong argument, a bus that refuses the connection. Out: a golden for each verb. Errors of
//! arguments have clap's form, with several lines; all others are one sentence, which is checked.

use std::fs;

use super::bus::{Bench, plumb};
use super::golden::check;
use super::log_text;
use super::sensors::Folder;
use super::transcript::Transcript;

/// Nobody listens there.
const NOBODY: &str = "--bus 127.0.0.1:1";

/// Verbs on a bus: what they need besides, and arguments that are wrong.
const ON_A_BUS: [(&str, &str, &[&str]); 12] = [
    ("scan", "", &["--time x", "extra"]),
    ("info", "", &["0", "128", "1 --node 2"]),
    (
        "get",
        "heartbeat",
        &[
            "",
            "heartbaet",
            "9999h",
            "1018h:99",
            "heartbeat fault-log --output f",
        ],
    ),
    (
        "set",
        "heartbeat 1s",
        &[
            "",
            "heartbeat",
            "heartbeat 70s --node 1",
            "heartbeat x --node 1",
            "slope-long 0deg --node 1",
        ],
    ),
    (
        "zero",
        "",
        &["--axis z", "--to x", "--to 1g", "--to 500deg"],
    ),
    ("save", "", &["--only all", "all"]),
    ("restore", "", &["--only all", "all"]),
    (
        "node-id",
        "5 --node 1",
        &["", "0", "128", "--pair 1", "--pair 1,1", "5 --pair 1,2"],
    ),
    ("bitrate", "", &["123", "fast", "500 --delay 99999999"]),
    (
        "monitor",
        "",
        &[
            "--for x",
            "--sync 0",
            "--nodes 1",
            "--json --plain",
            "--web x",
        ],
    ),
    ("calibrate", "--by-hand", CALIBRATE),
    ("characterise", "--by-hand", CHARACTERISE),
];

const CALIBRATE: &[&str] = &[
    "",
    "--motor nowhere",
    "--motor tcp://127.0.0.1:1",
    "--by-hand --poses 3",
    "--by-hand --country Italy",
    "--by-hand --nodes 1,1",
    "--by-hand --tolerance 0",
    "--restore missing.json",
    "--restore garbage.bin",
    "--restore note.txt",
];

const CHARACTERISE: &[&str] = &[
    "",
    "--chamber nowhere",
    "--chamber tcp://127.0.0.1:1",
    "--by-hand --profile missing.txt",
    "--by-hand --profile note.txt",
    "--by-hand --model cubic",
    "--by-hand --from 50 --to 20",
    "--by-hand --resume",
    "--restore missing.json",
    "--restore garbage.bin",
];

/// The other verbs, each with whole lines.
const OTHERS: [(&str, &[&str]); 12] = [
    (
        "faults",
        &[
            "missing.bin",
            "garbage.bin",
            "note.txt",
            "a.log",
            "note.txt --boxes boxes",
            "note.txt --node 1",
            "note.txt --bus 127.0.0.1:1",
            "--bus 127.0.0.1:1",
            "--bus http://x:1",
            "--nonsense",
        ],
    ),
    (
        "verify",
        &[
            "",
            "missing.xml",
            "garbage.bin",
            "note.txt",
            "a.log",
            "other.xml --nodes 0",
        ],
    ),
    (
        "update",
        &[
            "",
            "missing.bin",
            "garbage.bin",
            "note.txt",
            "p.bin --bus 127.0.0.1:1",
            "p.bin --nodes 0",
        ],
    ),
    (
        "image",
        &[
            "",
            "f.bin",
            "f.bin --version 1.2",
            "f.bin --from missing.bin",
            "f.bin --from garbage.bin",
            "f.bin --version 1.2.3 --key missing.key",
            "f.bin --version 1.2.3 --key zeros.key",
            "--public --key zeros.key",
            "f.bin --version 1.2.3 --key note.txt",
            "f.bin --version 1.2.3 --a missing.bin",
            "no/folder.bin --version 1.2.3",
        ],
    ),
    (
        "replay",
        &[
            "",
            "missing.log",
            "garbage.bin",
            "note.txt",
            "empty.log",
            "folder",
            "a.blf",
            "a.log note.txt",
            "a.log --mode paper",
            "a.log --nodes 1,2,3",
            "a.log --interface can7",
            "a.log --export x.txt",
            "a.log --export a.log",
            "a.log --export no/folder.csv",
            "a.log --export folder.csv",
            "a.log --eds missing.eds@1",
            "a.log --eds note.txt@5",
            "a.log --from poses",
            "a.log --from 9 --to 8",
            "a.log --onto 127.0.0.1:1",
            "a.log --speed 2",
            "note.txt --nodes 1,2",
            "one.csv --calibration missing.txt",
            "one.csv --calibration note.txt",
            "one.csv --lsb-per-g 0",
        ],
    ),
    (
        "report",
        &[
            "",
            "missing.log",
            "garbage.bin",
            "note.txt",
            "empty.log",
            "folder",
            "a.log --to 2020-01-01",
            "a.log --from 9 --to 8",
            "a.log --from yesterday",
            "a.log --nodes 1",
            "a.log --eds missing.eds@1",
            "a.log --bus 127.0.0.1:1",
            "a.log --out note.txt",
            "--black-box a.log",
            "--black-box missing.bin",
        ],
    ),
    (
        "serve",
        &[
            "--listen nowhere",
            "--bit-rate 123",
            "--mode best",
            "--node-ids 1",
            "--node-ids 1,1",
            "--speed 0",
            "--speed fast",
            "--chamber-speed 1000",
            "--instruments 0",
            "--can nocan77",
            "--script missing.txt",
            "--script note.txt",
            "--script empty.log",
            "--script garbage.bin",
            "--state note.txt",
        ],
    ),
    (
        "twin",
        &[
            "",
            "--to nowhere level",
            "--to 127.0.0.1:1 level",
            "--to 127.0.0.1:1 pitch x",
        ],
    ),
    (
        "demo",
        &[
            "--units 0",
            "--days x",
            "--seed x",
            "--out note.txt --units 1 --days 0",
            "extra",
        ],
    ),
    (
        "describe",
        &[
            "",
            "xdd",
            "dbc --channel a",
            "eds --node-id 3",
            "dcf --node-id 0",
            "eds --output no/a.eds",
        ],
    ),
    ("completions", &["", "cmd"]),
    ("man", &["nothing", "--output note.txt", "--nonsense"]),
];

/// A folder with files of every wrong kind, in which the program runs.
fn folder(name: &str) -> Folder {
    let folder = Folder::new(&format!("golden-errors-{name}"));
    folder.file(
        "garbage.bin",
        [0x9D, 0x00, 0xFF, 0x13, 0x80, 0x0A, 0xFE, 0xC0].repeat(64),
    );
    folder.file("note.txt", "nothing of the kind\n");
    folder.file("empty.log", "");
    folder.file("a.log", log_text::moment());
    folder.file("a.blf", b"LOGG\x90\0\0\0");
    folder.file("one.csv", "time_s,ax_g,ay_g,az_g\n0,0,0,1\n");
    folder.file(
        "other.xml",
        "<?xml version=\"1.0\"?><note>nothing of the kind</note>\n",
    );
    folder.file("zeros.key", "0".repeat(64));
    for name in ["folder", "folder.csv"] {
        fs::create_dir(folder.0.join(name)).unwrap();
    }
    let image = ["image", "p.bin", "--version", "1.2.3"];
    assert!(
        plumb(&image)
            .current_dir(&folder.0)
            .output()
            .unwrap()
            .status
            .success()
    );
    folder
}

/// Runs a line that has to fail.
fn run(told: &mut Transcript, folder: &Folder, line: &str) {
    let words: Vec<_> = line.split_whitespace().collect();
    let mut command = plumb(&words);
    let output = command.current_dir(&folder.0).output().unwrap();
    told.ended(&command, &output);
    let said = String::from_utf8_lossy(&output.stderr);
    let by_clap = said.starts_with("error: ") || said.contains("Usage: ");
    assert_eq!(output.status.code(), Some(2), "{line}: {said}");
    assert!(by_clap || said.lines().count() == 1, "{line}: {said}");
    assert!(!said.contains("panicked"), "{line}: {said}");
}

#[test]
fn verbs_on_a_bus() {
    let folder = folder("bus");
    let bench = Bench::quick(&[]);
    for (verb, needed, wrong) in ON_A_BUS {
        let mut told = Transcript::default();
        for line in wrong {
            run(
                &mut told,
                &folder,
                &format!("{verb} {line} --bus {}", bench.bus),
            );
        }
        for line in [NOBODY, "--bus http://x:1", "--nonsense"] {
            run(&mut told, &folder, &format!("{verb} {needed} {line}"));
        }
        check(&format!("{verb}-errors"), &told.text);
    }
}

#[test]
fn all_other_verbs() {
    let folder = folder("others");
    for (verb, lines) in OTHERS {
        let mut told = Transcript::default();
        for line in lines {
            run(&mut told, &folder, &format!("{verb} {line}"));
        }
        check(&format!("{verb}-errors"), &told.text);
    }
}

/// Verbs that are told a node that is not there.
const OF_A_NODE: [&str; 12] = [
    "info 9",
    "get heartbeat --node 9",
    "set heartbeat 1s --node 9",
    "zero --node 9",
    "save --node 9",
    "restore --node 9",
    "node-id 5 --node 9",
    "bitrate --node 9",
    "faults --node 9",
    "calibrate --keep kept.json --nodes 9",
    "characterise --keep kept.json --nodes 9",
    "update p.bin --nodes 9",
];

/// Each on a bus of its own, and all at once: a verb looks for the node with requests to it and to
/// others, which another verb on the same bus takes for those of a stranger.
#[test]
fn a_node_that_is_not_there() {
    let folder = folder("node");
    let look = |line: &str| {
        let bench = Bench::quick(&[]);
        let mut told = Transcript::default();
        run(&mut told, &folder, &format!("{line} --bus {}", bench.bus));
        let (verb, _) = line.split_once(' ').unwrap();
        check(&format!("{verb}-wrong-node"), &told.text);
    };
    std::thread::scope(|scope| {
        for line in &OF_A_NODE {
            scope.spawn(|| look(line));
        }
    });
}
