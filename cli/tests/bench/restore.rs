//! `plumb calibrate --restore`, cut short in the middle of a calibration.

use super::stand::*;
use crate::program::relay::{self, Next};

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

    let mut behind: Option<usize> = None;
    let words = ["calibrate", "--restore", &file];
    let (status, _, err) = relay::run(&bench.bus, &words, |_, _, data| {
        behind = match (behind, data) {
            (None, [BLOCK_DOWNLOAD, 0x61, 0x20, ..]) => Some(0),
            (behind, _) => behind.map(|count| count + 1),
        };
        match behind {
            Some(SEGMENTS) => Next::Ends,
            _ => Next::Goes,
        }
    });
    assert_eq!(behind, Some(SEGMENTS));
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
