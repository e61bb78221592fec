//! The page on the calibration file names every key of it, and none that isn't there.

use std::collections::BTreeSet;

use serde_json::Value;

use super::bench::*;

const PAGE: &str = include_str!("../../../docs/calibration-format.md");

/// Every key at any depth.
fn keys(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(fields) => fields.iter().for_each(|(key, value)| {
            found.insert(key.clone());
            keys(value, found);
        }),
        Value::Array(items) => items.iter().for_each(|item| keys(item, found)),
        _ => {}
    }
}

#[test]
fn every_key_of_a_calibration_file_is_documented() {
    let folder = Folder::new("documents");
    let one = folder.file("one.csv", SQUARE.record(up));
    let kept = folder.path("kept.json");
    replay_well(&folder, &[&one, "--save-calibration", &kept]);
    let file: Value = serde_json::from_str(&std::fs::read_to_string(kept).unwrap()).unwrap();
    let mut written = BTreeSet::new();
    keys(&file, &mut written);
    let rows = PAGE.lines().filter_map(|line| line.strip_prefix("| `"));
    let mut documented: BTreeSet<String> = rows
        .filter_map(|row| Some(row.split_once('`')?.0.to_owned()))
        .collect();
    // `temperature` is null in a calibration from poses; its fields belong to that of a motor.
    for inner in ["offset1_q8", "offset2_q16", "gain1_q38", "gain2_q46"] {
        assert!(documented.remove(inner), "{inner}");
    }
    assert_eq!(written, documented);
    assert!(PAGE.contains(&format!("version {}", file["version"])));
}
