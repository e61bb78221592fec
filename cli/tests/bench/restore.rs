//! `plumb calibrate --restore`, cut short in the middle of a calibration.

use std::process::Stdio;

use super::stand::*;
use crate::program::relay::{Next, Relay};

/// Segments of the block download behind which the bus is lost.
const SEGMENTS: usize = 9;

/// The command that begins a block download, with its length and a check sum (CiA 301).
const BLOCK_DOWNLOAD: u8 = 0xC6;

/// The node took the next requests for segments of the download that had been left.
#[test]
fn a_restore_that_lost_its_bus_left_a_silent_node() {
    let bench = Bench::new("1", &[]);
    let file = bench.path("kept.json");
    let kept = |more: &[&str]| said(&bench.command(more).output().unwrap());
    assert_eq!(kept(&["calibrate", "--keep", &file]).0, Some(0));

    let relay = Relay::to(&bench.bus);
    let words = ["calibrate", "--restore", &file, "--bus", &relay.address()];
    let mut program = plumb(&words);
    let program = program.stdout(Stdio::piped()).stderr(Stdio::piped());
    let program = program.spawn().unwrap();
    let mut behind: Option<usize> = None;
    let cut = relay.pass(|_, data| {
        behind = match (behind, data) {
            (None, [BLOCK_DOWNLOAD, 0x61, 0x20, ..]) => Some(0),
            (behind, _) => behind.map(|count| count + 1),
        };
        match behind {
            Some(SEGMENTS) => Next::Ends,
            _ => Next::Goes,
        }
    });
    assert!(cut);
    let (status, _, err) = said(&program.wait_with_output().unwrap());
    assert_eq!(status, Some(2), "{err}");
    let advice = "node 1 could not be given back what was found: run the same command again";
    assert!(
        err.contains("the bus is lost") && err.ends_with(advice),
        "{err}"
    );

    let (status, _, err) = kept(&["calibrate", "--keep", &file, "--force"]);
    assert_eq!(status, Some(0), "{err}");
    let (status, out, err) = kept(&["calibrate", "--restore", &file]);
    assert_eq!(status, Some(0), "{err}");
    assert_eq!(out.matches("restored").count(), 2, "{out}");
}
