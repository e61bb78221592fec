//! What verbs that put a calibration into the nodes share: their options, and how they end.
//!
//! In: a session with something new in its nodes, and its report. Out: the report on disk and its
//! hash in the nodes, or the nodes with what they had. Calibrations are kept in a file and given
//! back from it.
//!
//! Left out: how the new calibration came about.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;

use super::console::tell;
use super::data::{Channel, Report};
use super::error::CalibrateError;
use super::folder::Folder;
use super::kept::{self, Kept, KeptNode};
use super::session::{Node, Session};
use super::{dcc, page};
use bus_master::{BusOptions, fault};
use output::write::{Existing, NoPlace, check_place};
use output::{hex, stdout};

/// More or fewer nodes than an instrument has.
pub const NODES: CalibrateError =
    CalibrateError::Request("give one node or the two of an instrument, as --nodes 1,2");

/// Which nodes, for whom, and where to.
#[derive(Clone, Debug, Args)]
pub struct Common {
    /// The nodes of the instrument, or one of them
    #[arg(long, value_delimiter = ',', default_value = "1,2", value_name = "ID,ID",
          value_parser = clap::value_parser!(u8).range(1..=127))]
    pub nodes: Vec<u8>,
    /// Replace an earlier report in that folder, or the file of --keep; what is not accepted
    /// replaces nothing and goes into a folder of its own in there
    #[arg(long)]
    pub force: bool,
    /// Who calibrates, for the report
    #[arg(long, value_name = "NAME")]
    pub laboratory: Option<String>,
    /// Who stands at the bench, for the report
    #[arg(long, value_name = "NAME")]
    pub operator: Option<String>,
    /// For whom, for the report
    #[arg(long, value_name = "NAME")]
    pub customer: Option<String>,
    /// Country of the laboratory, two letters of ISO 3166, for dcc.xml; ZZ is not stated
    #[arg(long, default_value = "ZZ", value_parser = country, value_name = "CODE")]
    pub country: String,
    /// Only write the calibrations that the nodes have to this file
    #[arg(long, value_name = "FILE", conflicts_with_all = ["motor", "by_hand", "restore"])]
    pub keep: Option<PathBuf>,
    /// Only give the nodes the calibrations in this file, by their serial numbers
    #[arg(long, value_name = "FILE", conflicts_with_all = ["motor", "by_hand"])]
    pub restore: Option<PathBuf>,
    /// Print the report as one JSON object
    #[arg(long)]
    pub json: bool,
    /// The bus.
    #[command(flatten)]
    pub bus: BusOptions,
}

fn country(text: &str) -> Result<String, String> {
    let fits = text.len() == 2 && text.bytes().all(|b| b.is_ascii_uppercase());
    fits.then(|| text.to_owned())
        .ok_or_else(|| "write two capital letters, as IT".to_owned())
}

/// A report, and the folder that it is in.
pub type Done = Result<(Report, PathBuf), CalibrateError>;

impl Common {
    /// One node, or two that differ.
    ///
    /// Errors: [`CalibrateError::Twice`], [`CalibrateError::Request`].
    pub fn ids(&self) -> Result<Vec<u8>, CalibrateError> {
        match self.nodes[..] {
            [one, other] if one == other => Err(CalibrateError::Twice(one)),
            [_] | [_, _] => Ok(self.nodes.clone()),
            _ => Err(NODES),
        }
    }

    /// Does `work` with the nodes, takes them back to the NMT state in which they were found, and
    /// prints what has come of it.
    ///
    /// Errors: those of the work, and of the nodes before it.
    pub fn with_nodes(
        &self,
        ids: &[u8],
        figures: fn(&Report) -> String,
        work: impl FnOnce(&mut Session) -> Done,
    ) -> Result<ExitCode, CalibrateError> {
        let mut session = self.open(ids)?;
        let done = work(&mut session);
        leave(&mut session);
        let (report, place) = done?;
        let shown = report.channels.iter().filter_map(Channel::as_shown);
        shown.for_each(|line| tell(&line));
        self.end(figures(&report), &report, &place)
    }

    /// Joins the bus and takes the nodes to PRE-OPERATIONAL.
    ///
    /// Errors: see [`Session::open`].
    fn open(&self, ids: &[u8]) -> Result<Session, CalibrateError> {
        Session::open(self.bus.join()?, ids)
    }

    /// Does what --keep or --restore ask for; `None` when neither is given.
    ///
    /// Errors: a file that is there already or is none of --keep's, and those of the nodes.
    pub fn keep_or_restore(&self, ids: &[u8]) -> Result<Option<ExitCode>, CalibrateError> {
        match (&self.keep, &self.restore) {
            (Some(path), _) => self.keep(ids, path).map(Some),
            (None, Some(path)) => self.restore(ids, path).map(Some),
            (None, None) => Ok(None),
        }
    }

    /// Prints what has come of it: `figures` and the verdict, or the report with --json. Exit
    /// status 1: the instrument was not accepted.
    ///
    /// Errors: [`CalibrateError::Print`].
    fn end(
        &self,
        figures: String,
        report: &Report,
        place: &Path,
    ) -> Result<ExitCode, CalibrateError> {
        let text = || figures + &verdict(report, place);
        stdout::print_as(self.json, report, text).map_err(CalibrateError::Print)?;
        Ok(match report.decision.accepted {
            true => ExitCode::SUCCESS,
            false => ExitCode::from(1),
        })
    }

    fn keep(&self, ids: &[u8], path: &Path) -> Result<ExitCode, CalibrateError> {
        let existing = Existing::of(self.force);
        // Before the nodes are asked.
        check_place(path, existing).map_err(|why| match why {
            NoPlace::Taken => CalibrateError::Earlier(path.to_owned(), "file with --keep"),
            why => CalibrateError::Keep(path.to_owned(), why),
        })?;
        let mut session = Session::look(self.bus.join()?, ids)?;
        session.one_instrument()?;
        let blank = session.nodes.iter().find(|node| node.is_blank());
        let blank = blank.map(|node| node.id);
        let kept = kept::as_found(&session);
        if let Some(id) = blank {
            return Err(CalibrateError::NothingToKeep(id));
        }
        kept::save(path, &kept, existing)?;
        self.print_kept(&kept, "kept")
    }

    fn restore(&self, ids: &[u8], path: &Path) -> Result<ExitCode, CalibrateError> {
        let kept = kept::load(path)?;
        let mut session = self.open(ids)?;
        let done = kept::restore(&mut session, path, &kept);
        let left = match done {
            Ok(()) => Vec::new(),
            Err(_) => session.roll_back(),
        };
        let written = kept.of(&session);
        leave(&mut session);
        match (done, left.is_empty()) {
            (Ok(()), _) => self.print_kept(&written, "restored"),
            (Err(error), true) => Err(error),
            (Err(error), false) => Err(CalibrateError::LeftByRestore(Box::new(error), left)),
        }
    }

    fn print_kept(&self, kept: &Kept, word: &str) -> Result<ExitCode, CalibrateError> {
        let line = |node: &KeptNode| {
            let (serial, crc) = (node.serial_number, &node.crc32);
            format!("serial number {serial}: calibration {crc} {word}\n")
        };
        let text = || kept.nodes.iter().map(line).collect();
        stdout::print_as(self.json, kept, text).map_err(CalibrateError::Print)?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Takes the nodes back to the state in which they were found, and names those of which none is
/// known.
fn leave(session: &mut Session) {
    for id in session.leave() {
        tell(&fault::unknown(id));
    }
}

/// Whether it was accepted, and where the report is.
fn verdict(report: &Report, place: &Path) -> String {
    let tolerance = report.decision.tolerance_deg;
    let mut text = match report.decision.accepted {
        true => format!("accepted: within {tolerance} deg; stored, read back, the same\n"),
        false => format!(
            "NOT accepted: not within {tolerance} deg; the nodes have the calibration that they \
             had\n"
        ),
    };
    let folder = place.display();
    text += &format!("report: {folder}/report.html, report.json, dcc.xml\n");
    if let Some(hash) = &report.dcc_sha256 {
        text += &format!("the nodes keep the SHA-256 of dcc.xml: {hash}\n");
    }
    text
}

/// Gives back what the nodes had unless all went well.
pub fn settle(folder: &Folder, session: &mut Session, done: Done) -> Done {
    if done
        .as_ref()
        .is_ok_and(|(report, _)| report.decision.accepted)
    {
        return done;
    }
    let left = session.roll_back();
    let error = match (done, left.is_empty()) {
        (Ok(done), true) => return Ok(done),
        (Err(error), true) => {
            // The nodes have it again.
            folder.forget();
            return Err(error);
        }
        (Err(error), false) => error,
        (Ok(_), false) => CalibrateError::Rejected,
    };
    let mut kept = session.nodes.iter().filter(|node| left.contains(&node.id));
    if kept.all(Node::is_blank) {
        return Err(CalibrateError::First(Box::new(error), left));
    }
    tell(&format!(
        "what the nodes had is in {}",
        folder.found().display()
    ));
    Err(CalibrateError::Left(Box::new(error), left))
}

/// Writes certificate, data and page, and the certificate's hash into the nodes of an instrument
/// that was accepted.
///
/// Errors: a folder that can't be written, and a node that does not take the hash.
pub fn publish(folder: &Folder, session: &mut Session, mut report: Report, country: &str) -> Done {
    let certificate = dcc::document(&report, country);
    if report.decision.accepted {
        let hash = hmac_sha256::Hash::hash(certificate.as_bytes());
        for place in 0..session.nodes.len() {
            session.write_hash(place, &hash)?;
        }
        report.dcc_sha256 = Some(hex::digits(&hash));
    }
    let json = serde_json::to_string_pretty(&report);
    let json = json.map_err(|e| CalibrateError::Print(e.into()))? + "\n";
    let files = [
        ("dcc.xml", certificate.as_str()),
        ("report.json", &json),
        ("report.html", &page::page(&report)),
    ];
    let place = folder.write(&files, report.decision.accepted)?;
    if place != folder.out() {
        let (place, out) = (place.display(), folder.out().display());
        tell(&format!(
            "not accepted: its report is in {place}, the one in {out} stays"
        ));
    }
    Ok((report, place))
}

/// 2061h of each node as it is now.
///
/// Errors: a node that does not answer.
pub fn made(session: &mut Session) -> Result<Vec<Vec<u8>>, CalibrateError> {
    (0..session.nodes.len())
        .map(|place| session.calibration(place))
        .collect()
}
