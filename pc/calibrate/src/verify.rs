//! `plumb verify`: does a calibration report belong to the instrument on the bus?
//!
//! In: dcc.xml of `plumb calibrate`, and the nodes. Out: for each node whether the
//! calibration in force is the one in the file and whether it vouches for this very file (2062h,
//! 2063h). docs/calibration-report.md lists what is compared.
//!
//! Left out: whether the report's figures are right.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use quick_xml::Reader;
use quick_xml::escape::resolve_predefined_entity;
use quick_xml::events::{BytesStart, Event};
use serde::Serialize;

use crate::data::FORMAT;
use crate::{CalibrateError, Session, dcc};
use bus_master::BusOptions;
use output::{hex, object, stdout};

/// What to compare.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// dcc.xml of a calibration
    pub file: PathBuf,
    /// The nodes to compare
    #[arg(long, value_delimiter = ',', default_value = "1,2", value_name = "ID,ID",
          value_parser = clap::value_parser!(u8).range(1..=127))]
    pub nodes: Vec<u8>,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
    /// The bus.
    #[command(flatten)]
    pub bus: BusOptions,
}

/// What a node and a file have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The calibration in force is that of the file, and the node vouches for it.
    Match,
    /// Another calibration is in force.
    AnotherCalibration,
    /// The calibration may be the file's, but the node vouches for another report.
    AnotherReport,
    /// The calibration may be the file's, but the node vouches for no report.
    NoReport,
    /// The file is of another instrument.
    AnotherInstrument,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Match => "the calibration in force and the report are those of the file",
            Self::AnotherCalibration => "another calibration is in force",
            Self::AnotherReport => "it has this calibration, and another report belongs to it",
            Self::NoReport => "it has this calibration, and no report belongs to it",
            Self::AnotherInstrument => "the file is of another instrument",
        })
    }
}

/// One node.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct NodeVerdict {
    node: u8,
    serial_number: u32,
    crc32: String,
    report_sha256: Option<String>,
    verdict: Verdict,
}

/// What a file states of the nodes.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Claim {
    /// The hash that the nodes should have.
    hash: Vec<u8>,
    /// Serial number and check sum of each channel.
    channels: Vec<(u32, String)>,
}

/// Compares. Exit status 1: a node does not match.
///
/// Errors: see [`CalibrateError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, CalibrateError> {
    let file = &arguments.file;
    let bytes = std::fs::read(file).map_err(CalibrateError::file(file))?;
    let claim = claim(file, &bytes)?;
    let session = Session::look(arguments.bus.join()?, &arguments.nodes)?;
    let nodes: Vec<_> = session
        .nodes
        .iter()
        .map(|node| NodeVerdict {
            node: node.id,
            serial_number: node.serial,
            crc32: format!("{:08X}", node.found_sum()),
            report_sha256: node.hash.as_deref().map(hex::digits),
            verdict: claim.judge(node.serial, node.found_sum(), node.hash.as_deref()),
        })
        .collect();
    let matches = nodes.iter().all(|node| node.verdict == Verdict::Match);
    let verified = object! {
        format: "plumb-verify",
        version: 1,
        file_sha256: hex::digits(&hmac_sha256::Hash::hash(&bytes)),
        matches: matches,
        nodes: &nodes,
    };
    stdout::print_as(arguments.json, &verified, || text(&nodes)).map_err(CalibrateError::Print)?;
    Ok(match matches {
        true => ExitCode::SUCCESS,
        false => ExitCode::from(1),
    })
}

fn text(nodes: &[NodeVerdict]) -> String {
    let line = |node: &NodeVerdict| {
        format!(
            "node {} (serial number {}, calibration {}): {}\n",
            node.node, node.serial_number, node.crc32, node.verdict
        )
    };
    nodes.iter().map(line).collect()
}

impl Claim {
    fn judge(&self, serial: u32, sum: u32, hash: Option<&[u8]>) -> Verdict {
        let of = |(number, _): &&(u32, String)| *number == serial;
        let Some((_, crc)) = self.channels.iter().find(of) else {
            return Verdict::AnotherInstrument;
        };
        if *crc != format!("{sum:08X}") {
            return Verdict::AnotherCalibration;
        }
        match hash {
            Some(hash) if hash == self.hash => Verdict::Match,
            Some(_) => Verdict::AnotherReport,
            None => Verdict::NoReport,
        }
    }
}

/// What a file claims.
///
/// Errors: [`CalibrateError::Content`] for a file that `plumb calibrate` has not written.
fn claim(path: &Path, bytes: &[u8]) -> Result<Claim, CalibrateError> {
    let wrong = |what| CalibrateError::Content(path.to_owned(), what);
    let text = std::str::from_utf8(bytes).map_err(|_| wrong(NO_REPORT))?;
    let text = text.trim_start_matches('\u{feff}');
    if !text.starts_with("<?xml") {
        let json = serde_json::from_str(text).ok();
        let twin = json.is_some_and(|json: serde_json::Value| json["format"] == FORMAT);
        return Err(wrong(if twin { TWIN } else { NO_REPORT }));
    }
    let channels = identities(text).map_err(wrong)?;
    if channels.is_empty() {
        return Err(wrong(NO_REPORT));
    }
    let hash = hmac_sha256::Hash::hash(bytes).to_vec();
    Ok(Claim { hash, channels })
}

/// What a file is not.
const NO_REPORT: &str = "this is no dcc.xml of plumb calibrate";

/// Of report.json: nothing that a node keeps tells whether its figures are as they were written.
const TWIN: &str = "the nodes keep a hash of dcc.xml and of no other file, so the figures in \
                    report.json cannot be checked: give the dcc.xml of the same folder";

/// Of a copy that was cut, or changed by hand.
const DAMAGED: &str = "it is cut or damaged: take a whole copy of the dcc.xml";

/// Of a certificate of another program, or of a later one of this.
const RELEASE: &str = "this dcc.xml is of another release of the format than 3.2.1, which plumb \
                       calibrate writes";

/// Where the value of an identification stands.
const VALUE: &str = "/dcc:item/dcc:identifications/dcc:identification/dcc:value";

/// Serial number and check sum of each item of a DCC that this program wrote: the values of the
/// first and the last identification of an item.
///
/// Errors: what the document is, where it is not one that this program writes.
fn identities(text: &str) -> Result<Vec<(u32, String)>, &'static str> {
    let mut reader = Reader::from_str(text);
    let mut walk = Walk::default();
    loop {
        match reader.read_event().map_err(|_| DAMAGED)? {
            Event::Start(tag) => walk.enter(&tag)?,
            Event::End(_) => walk.leave(),
            Event::Text(text) => walk.text(&text)?,
            Event::GeneralRef(name) => walk.entity(&name)?,
            Event::Decl(_) => {}
            Event::Eof => break,
            // What this program does not write could mean something else than is read here.
            _ => return Err(NO_REPORT),
        }
    }
    let identity = |values: &Vec<String>| {
        let serial = values.first()?.parse().ok()?;
        let crc = values.get(1..)?.last().filter(|crc| crc.len() == 8)?;
        Some((serial, crc.clone()))
    };
    match walk.path.is_empty() {
        true => Ok(walk.items.iter().filter_map(identity).collect()),
        false => Err(DAMAGED),
    }
}

/// The way through a certificate.
#[derive(Default)]
struct Walk {
    /// Names of the elements that are open, each behind a slash.
    path: String,
    /// Whether the root has begun.
    begun: bool,
    /// Whether the identification that is open has its value.
    has_value: bool,
    /// Of each item the values of its identifications.
    items: Vec<Vec<String>>,
}

impl Walk {
    fn enter(&mut self, tag: &BytesStart) -> Result<(), &'static str> {
        let name = tag.name().0;
        if self.path.is_empty() {
            let release = tag.try_get_attribute("schemaVersion");
            let release = release.map_err(|_| DAMAGED)?.map(|release| release.value);
            match release {
                _ if self.begun || name != dcc::ROOT => return Err(NO_REPORT),
                Some(release) if release == dcc::RELEASE => self.begun = true,
                _ => return Err(RELEASE),
            }
        }
        self.path = format!("{}/{name}", self.path);
        if self.path.ends_with("/dcc:item") {
            self.items.push(Vec::new());
        } else if self.path.ends_with("/dcc:identification") {
            self.has_value = false;
        } else if self.path.ends_with(VALUE) {
            if std::mem::replace(&mut self.has_value, true) {
                return Err(NO_REPORT);
            }
            self.items.last_mut().ok_or(NO_REPORT)?.push(String::new());
        }
        Ok(())
    }

    fn leave(&mut self) {
        let parent = self.path.rfind('/').unwrap_or(0);
        self.path.truncate(parent);
    }

    fn text(&mut self, text: &str) -> Result<(), &'static str> {
        if self.path.is_empty() && !text.trim().is_empty() {
            return Err(NO_REPORT);
        }
        if self.path.ends_with(VALUE) {
            let value = self.items.last_mut().and_then(|values| values.last_mut());
            value.ok_or(NO_REPORT)?.push_str(text);
        }
        Ok(())
    }

    /// An entity: those that the writer escapes with, and none in a value.
    fn entity(&self, name: &str) -> Result<(), &'static str> {
        let written = resolve_predefined_entity(name).is_some();
        match written && !self.path.ends_with(VALUE) {
            true => Ok(()),
            false => Err(NO_REPORT),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{sample_dcc, sample_report};

    fn path() -> PathBuf {
        PathBuf::from("f")
    }

    #[test]
    fn a_certificate_names_its_channels_by_serial_number_and_check_sum() {
        let text = sample_dcc();
        let claim = claim(&path(), text.as_bytes()).unwrap();
        let crc = "DEADBEEF".to_owned();
        assert_eq!(claim.channels, [(1, crc.clone()), (2, crc)]);
        let hash = claim.hash.clone();
        assert_eq!(claim.judge(1, 0xDEAD_BEEF, Some(&hash)), Verdict::Match);
        assert_eq!(
            claim.judge(2, 0xDEAD_BEEF, Some(&[0; 32])),
            Verdict::AnotherReport
        );
        assert_eq!(claim.judge(2, 0xDEAD_BEEF, None), Verdict::NoReport);
        assert_eq!(claim.judge(2, 1, Some(&hash)), Verdict::AnotherCalibration);
        assert_eq!(
            claim.judge(3, 0xDEAD_BEEF, Some(&hash)),
            Verdict::AnotherInstrument
        );
    }

    #[test]
    fn a_changed_byte_of_the_certificate_is_another_report() {
        let whole = claim(&path(), sample_dcc().as_bytes()).unwrap();
        let text = sample_dcc().replace("52.500000", "52.400000");
        let other = claim(&path(), text.as_bytes()).unwrap();
        assert_eq!(
            other.judge(1, 0xDEAD_BEEF, Some(&whole.hash)),
            Verdict::AnotherReport
        );
    }

    #[test]
    fn another_figure_of_the_gyroscope_is_another_report() {
        let mut report = sample_report();
        report.channels[0].gyroscope = Some(crate::gyroscope::of(&crate::sample::rates()));
        let text = crate::dcc::document(&report, "IT");
        let whole = claim(&path(), text.as_bytes()).unwrap();
        let judged = whole.judge(1, 0xDEAD_BEEF, Some(&whole.hash));
        assert_eq!(judged, Verdict::Match);
        let changed = text.replacen("0.250000", "0.240000", 1);
        assert_ne!(changed, text);
        let other = claim(&path(), changed.as_bytes()).unwrap();
        let judged = other.judge(1, 0xDEAD_BEEF, Some(&whole.hash));
        assert_eq!(judged, Verdict::AnotherReport);
    }

    #[test]
    fn a_forged_report_in_json_was_said_to_match() {
        let text = serde_json::to_string(&sample_report()).unwrap();
        let forged = text.replace("7.52", "45.0");
        assert_ne!(forged, text);
        for text in [text, forged] {
            let told = claim(&path(), text.as_bytes()).unwrap_err().to_string();
            assert_eq!(told, format!("f: {TWIN}"));
        }
    }

    #[test]
    fn anything_else_is_no_report() {
        for (bytes, what) in [
            (&b""[..], NO_REPORT),
            (b"\xFF\xFE", NO_REPORT),
            (b"{}", NO_REPORT),
            (b"<?xml version=\"1.0\"?><a/>", NO_REPORT),
            (b"[]", NO_REPORT),
            (b"{\"format\":\"plumb-period\"}", NO_REPORT),
        ] {
            let told = claim(&path(), bytes).unwrap_err().to_string();
            assert_eq!(told, format!("f: {what}"));
        }
    }

    #[test]
    fn what_a_certificate_can_not_be_is_refused_with_its_reason() {
        let whole = sample_dcc();
        let told = |text: &str| {
            let told = claim(&path(), text.as_bytes()).unwrap_err().to_string();
            told.strip_prefix("f: ").unwrap().to_owned()
        };
        let changed = |from: &str, to: &str| {
            assert!(whole.contains(from), "{from}");
            told(&whole.replacen(from, to, 1))
        };
        for cut in [60, whole.len() / 2, whole.len() - 10] {
            assert!(
                [DAMAGED, RELEASE].contains(&told(&whole[..cut]).as_str()),
                "{cut}"
            );
        }
        assert_eq!(changed("</dcc:items>", "</dcc:item>"), DAMAGED);
        assert_eq!(changed("3.2.1", "3.3.0"), RELEASE);
        let root = "dcc:digitalCalibrationCertificate";
        assert_eq!(told(&whole.replace(root, "dcc:other")), NO_REPORT);
        let (_, body) = whole.split_once('\n').unwrap();
        assert_eq!(told(&format!("{whole}{body}")), NO_REPORT);
        assert_eq!(told(&format!("{whole}more")), NO_REPORT);
        let value = "<dcc:value>1</dcc:value>";
        assert_eq!(changed(value, &format!("{value}{value}")), NO_REPORT);
        assert_eq!(changed(value, "<dcc:value>&#49;</dcc:value>"), NO_REPORT);
        assert_eq!(
            changed(value, "<dcc:value><![CDATA[1]]></dcc:value>"),
            NO_REPORT
        );
        assert_eq!(changed(value, "<dcc:value>&one;</dcc:value>"), NO_REPORT);
        let doctype = "<!DOCTYPE d [<!ENTITY one \"1\">]>\n<dcc:digital";
        assert_eq!(changed("<dcc:digital", doctype), NO_REPORT);
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_a_report_or_an_error(
            bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..400),
            cut in 0_usize..8000,
        ) {
            let _ = claim(&path(), &bytes);
            let whole = sample_dcc();
            let _ = claim(&path(), &whole.as_bytes()[..cut.min(whole.len())]);
        }
    }
}
