//! Calibrations in a file, byte for byte as the nodes have them.
//!
//! In: a session and a path. Out: a file of JSON with 2061h of each node, its check sum and the
//! hash of its report (2063h); or the nodes with what such a file holds for their serial numbers.
//!
//! Left out: what the bytes mean (docs/calibration-report.md tells where that stands).

use std::path::Path;

use device::calibration::encoding::identity;
use serde::{Deserialize, Serialize};

use output::hex;
use output::write::{Existing, Staged};

use super::error::CalibrateError;
use super::session::{Session, decode};

/// Name of the format.
const FORMAT: &str = "plumb-kept-calibration";

/// One node's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KeptNode {
    /// Node-id then.
    pub node: u8,
    /// 1018h sub 4.
    pub serial_number: u32,
    /// 2062h sub 1, eight hexadecimal digits.
    pub crc32: String,
    /// 2061h, two hexadecimal digits a byte.
    pub calibration_hex: String,
    /// 2063h; none when no report belonged to it.
    pub report_sha256: Option<String>,
}

/// The file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// "plumb-kept-calibration".
    pub format: String,
    /// 1.
    pub version: u32,
    /// The nodes.
    pub nodes: Vec<KeptNode>,
}

impl Kept {
    /// The same of the nodes of this session alone: a file may have more than are written.
    pub fn of(&self, session: &Session) -> Self {
        let is_there = |kept: &&KeptNode| {
            let mut nodes = session.nodes.iter();
            nodes.any(|node| node.serial == kept.serial_number)
        };
        Self {
            format: self.format.clone(),
            version: self.version,
            nodes: self.nodes.iter().filter(is_there).cloned().collect(),
        }
    }
}

/// What the nodes of a session had when they were found.
pub fn as_found(session: &Session) -> Kept {
    let nodes = session.nodes.iter();
    let nodes = nodes.map(|node| KeptNode {
        node: node.id,
        serial_number: node.serial,
        crc32: format!("{:08X}", node.found_sum()),
        calibration_hex: hex::digits(&node.bytes),
        report_sha256: node.hash.as_deref().map(hex::digits),
    });
    Kept {
        format: FORMAT.to_owned(),
        version: 1,
        nodes: nodes.collect(),
    }
}

/// Writes a file; it appears whole or not at all.
///
/// Errors: [`CalibrateError::File`].
pub fn save(path: &Path, kept: &Kept, existing: Existing) -> Result<(), CalibrateError> {
    let text = serde_json::to_string_pretty(kept);
    let text = text.map_err(|error| CalibrateError::File(path.to_owned(), error.into()))?;
    put(path, &(text + "\n"), existing)
}

/// Reads a file.
///
/// Errors: [`CalibrateError::File`], [`CalibrateError::Content`].
pub fn load(path: &Path) -> Result<Kept, CalibrateError> {
    let wrong = |what| CalibrateError::Content(path.to_owned(), what);
    let text = std::fs::read(path).map_err(CalibrateError::file(path))?;
    let kept: Kept = serde_json::from_slice(&text).map_err(|_| wrong(NOT_KEPT))?;
    if kept.format != FORMAT || kept.version != 1 {
        return Err(wrong(NOT_KEPT));
    }
    match kept.nodes.iter().find_map(flaw) {
        Some(what) => Err(wrong(what)),
        None => Ok(kept),
    }
}

/// What is wrong with one node's, if anything is.
fn flaw(node: &KeptNode) -> Option<&'static str> {
    let decoded = hex::bytes(&node.calibration_hex).and_then(|bytes| decode(&bytes));
    let Some(calibration) = decoded else {
        return Some("a calibration in it is damaged: its check sum is wrong");
    };
    if node.crc32 != format!("{:08X}", identity(&calibration)) {
        return Some("it was changed: crc32 in it is not that of its calibration");
    }
    let hash = node.report_sha256.as_deref().map(hex::bytes);
    let whole = hash.is_none_or(|hash| hash.is_some_and(|hash| hash.len() == 32));
    (!whole).then_some("it was changed: report_sha256 in it is no SHA-256")
}

/// What a file is not.
const NOT_KEPT: &str =
    "this is no file that --keep has written (plumb-kept-calibration, version 1)";

/// Gives each node what the file has for its serial number, reads it back and compares.
///
/// Errors: a node that is not in the file, a refusal. Nothing has
/// changed when a node is not in the file.
pub fn restore(session: &mut Session, path: &Path, kept: &Kept) -> Result<(), CalibrateError> {
    let mut all = Vec::new();
    for node in &session.nodes {
        let found = kept.nodes.iter().find(|k| k.serial_number == node.serial);
        let unknown = || CalibrateError::Unknown(path.to_owned(), node.id, node.serial);
        let found = found.ok_or_else(unknown)?;
        let content = hex::bytes(&found.calibration_hex);
        let content = content.ok_or_else(|| CalibrateError::Content(path.to_owned(), NOT_KEPT))?;
        all.push((content, found.report_sha256.as_deref().and_then(hex::bytes)));
    }
    for (place, (content, hash)) in all.into_iter().enumerate() {
        session.write(place, &content)?;
        if let Some(hash) = hash {
            session.write_hash(place, &hash)?;
        }
    }
    Ok(())
}

/// Writes a file; it appears whole or not at all, and a loss of power finds it on the disk.
///
/// Errors: [`CalibrateError::File`].
pub fn put(path: &Path, text: &str, existing: Existing) -> Result<(), CalibrateError> {
    let placed = Staged::write(path, text, existing).and_then(Staged::put_in_place);
    placed.map_err(CalibrateError::file(path))
}

#[cfg(test)]
mod tests {
    use super::super::session::encode;
    use super::*;

    #[test]
    fn a_changed_field_was_printed_and_never_checked() {
        let calibration = tilt::chain::Calibration::NOMINAL;
        let whole = Kept {
            format: FORMAT.to_owned(),
            version: 1,
            nodes: vec![KeptNode {
                node: 1,
                serial_number: 1,
                crc32: format!("{:08X}", identity(&calibration)),
                calibration_hex: hex::digits(&encode(&calibration)),
                report_sha256: Some("5a".repeat(32)),
            }],
        };
        let name = format!("plumb-kept-changed-{}.json", std::process::id());
        let path = std::env::temp_dir().join(name);
        let told = |change: &dyn Fn(&mut KeptNode)| {
            let mut kept = whole.clone();
            change(&mut kept.nodes[0]);
            save(&path, &kept, Existing::Replace).unwrap();
            load(&path).map_err(|error| error.to_string())
        };
        assert_eq!(told(&|_| ()), Ok(whole.clone()));
        let bad = |change: &dyn Fn(&mut KeptNode)| told(change).unwrap_err();
        let text = bad(&|node| node.crc32.replace_range(..1, "Z"));
        assert!(text.contains("crc32 in it is not"), "{text}");
        let text = bad(&|node| node.report_sha256 = Some("5a".to_owned()));
        assert!(text.contains("no SHA-256"), "{text}");
        let text = bad(&|node| node.calibration_hex.truncate(20));
        assert!(text.contains("damaged"), "{text}");
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn a_file_of_another_kind_is_named() {
        let path = std::env::temp_dir().join(format!("plumb-kept-{}", std::process::id()));
        for other in [
            "",
            "[]",
            "{}",
            "{\"format\":\"x\",\"version\":1,\"nodes\":[]}",
        ] {
            std::fs::write(&path, other).unwrap();
            let told = load(&path).unwrap_err().to_string();
            assert!(told.contains("no file that --keep has written"), "{told}");
        }
        std::fs::remove_file(&path).unwrap();
    }
}
