//! The page on the calibration file names every key of it, and none that isn't there.

use output::check::{documented, keys};
use serde_json::Value;

use super::bench::*;

const PAGE: &str = include_str!("../../../docs/calibration-format.md");

#[test]
fn every_key_of_a_calibration_file_is_documented() {
    let folder = Folder::new("documents");
    let one = folder.file("one.csv", SQUARE.record(up));
    let kept = folder.path("kept.json");
    replay_well(&folder, &[&one, "--save-calibration", &kept]);
    let file: Value = serde_json::from_str(&std::fs::read_to_string(kept).unwrap()).unwrap();
    let written = keys(&file);
    let mut documented = documented(PAGE);
    // `temperature` is null in a calibration from poses; its fields belong to that of a motor.
    for inner in ["offset1_q8", "offset2_q16", "gain1_q38", "gain2_q46"] {
        assert!(documented.remove(inner), "{inner}");
    }
    assert_eq!(written, documented);
    assert!(PAGE.contains(&format!("version {}", file["version"])));
}
