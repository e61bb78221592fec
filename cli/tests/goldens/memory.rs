//! What nodes remember, through `faults` and `report --black-box`: files of 2070h and 2071h as
//! docs/canopen.md lays them out, and a bus whose nodes have nothing to tell.

use super::bus::{Bench, plumb};
use super::golden::check;
use super::page::seen;
use super::sensors::Folder;
use super::transcript::Transcript;

/// An event: time in ms, SYNC, EMCY code, the faults after it, state, channel blamed, reason, box.
fn entry(at_ms: u32, code: u16, faults: &[u8], verdict: [u8; 4]) -> Vec<u8> {
    let set = faults.iter().fold(0_u32, |set, fault| set | 1 << fault);
    let mut bytes = at_ms.to_le_bytes().to_vec();
    bytes.extend((at_ms / 10).to_le_bytes());
    bytes.extend(code.to_le_bytes());
    bytes.extend(set.to_le_bytes());
    bytes.extend(verdict);
    bytes.extend([3, 0]);
    bytes
}

fn fault_log() -> Vec<u8> {
    let mut bytes = vec![1, 20, 4, 9];
    bytes.extend(entry(95_000, 0x0000, &[], [1, 0, 0, 0]));
    bytes.extend(entry(90_500, 0xFF15, &[14], [8, 2, 13, 1]));
    bytes.extend(entry(90_250, 0xFF13, &[12], [6, 0, 17, 0]));
    bytes.extend(entry(12, 0xFF20, &[7], [0, 0, 0, 0]));
    bytes
}

/// Four SYNCs up to the event and two after it; the other channel leaves at the third.
fn samples() -> Vec<u8> {
    let mut bytes = vec![1, 34, 4, 2];
    bytes.extend(10_000_u32.to_le_bytes());
    bytes.extend(entry(90_500, 0xFF15, &[14], [8, 2, 13, 1]));
    for number in 0..6_u8 {
        let off = if number < 2 { 0 } else { 0x40 };
        bytes.extend([
            0,
            0x10 * number,
            0x10,
            0,
            0,
            0xE0,
            48,
            48,
            0x55,
            1,
            0,
            0xF0,
            0,
            0x20,
            7,
            64,
        ]);
        bytes.extend([
            0, off, 0x10, 0, 0, 0xE0, 48, 15, 0x55, 1, 0, 0xF0, 0, 0x20, 7, 72,
        ]);
        bytes.extend(if number < 3 { [1, 0] } else { [8, 2 << 6 | 13] });
    }
    bytes
}

#[test]
fn files_of_a_memory_are_read() {
    let folder = Folder::new("golden-memory");
    folder.file("node-2-fault-log.bin", fault_log());
    folder.file("node-2-box-1.bin", samples());
    let both = ["node-2-fault-log.bin", "node-2-box-1.bin"];
    let mut told = Transcript::default();
    told.run(plumb(&["faults"]).args(both).current_dir(&folder.0));
    check("faults-text", &told.text);
    let mut told = Transcript::default();
    told.run(
        plumb(&["faults", "--json"])
            .args(both)
            .current_dir(&folder.0),
    );
    check("faults-json", &told.text);
    let mut told = Transcript::default();
    for more in ["--out", "--json"] {
        let mut command = plumb(&["report", "--black-box"]);
        let command = command.args(both).current_dir(&folder.0);
        told.run(if more == "--json" {
            command.arg(more)
        } else {
            command.args([more, "out"])
        });
    }
    check("report-memory", &told.text);
    let page = std::fs::read_to_string(folder.0.join("out/report.html")).unwrap();
    check("report-memory-page", &seen(&page));
}

#[test]
fn nodes_are_asked() {
    let folder = Folder::new("golden-asked");
    let bench = Bench::quick(&[]);
    let mut told = Transcript::default();
    for line in ["faults", "faults --node 1 --boxes boxes --json"] {
        let words: Vec<_> = line.split(' ').collect();
        told.run(
            plumb(&words)
                .args(["--bus", &bench.bus])
                .current_dir(&folder.0),
        );
    }
    check("faults-session", &told.text);
}
