//! Why a calibration did not come to its end: one sentence that states who, what, and what to do.

use std::io;
use std::path::{Path, PathBuf};

use tilt::calibration::FitError;

use super::characterise::hold::HoldError;
use super::characterise::profile::ProfileError;
use super::hand::HandError;
use super::reading::Upset;
use super::scpi::DeviceError;
use bus_master::diagnosis::Silence;
use bus_master::fault::Fault;
use bus_master::sdo::SdoError;
use bus_master::{BusEnd, JoinError};
use output::write::{NoPlace, WriteError};

/// Why there is no calibration, or no temperature model.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The bus could not be joined.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// A node did not do its part.
    #[error(transparent)]
    Sdo(SdoError),
    /// A node does not answer, and why.
    #[error("{0}")]
    Silent(Silence),
    /// The two nodes are of one kind, so of two instruments: their node-ids, the channel.
    #[error(
        "nodes {a} and {b} are both channel {1}, of two instruments: name channel A and channel B \
         of one (`plumb scan` shows which belong together)",
        a = .0[0],
        b = .0[1]
    )]
    SameChannel([u8; 2], &'static str),
    /// A node names another one as the other channel: it, the one given, the one named.
    #[error(
        "nodes {a} and {b} are not of one instrument: the other channel of node {a} is node {1} \
         (2001h); name these two, or one node alone (`plumb node-id --pair` makes two nodes a \
         pair)",
        a = .0[0],
        b = .0[1]
    )]
    NotOnePair([u8; 2], u32),
    /// The bus was lost.
    #[error("the bus is lost: {0}")]
    Lost(io::Error),
    /// The user has ended it.
    #[error("interrupted; the calibration that was there counts")]
    Interrupted,
    /// A motor or a chamber did not do its part.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The profile of a chamber run is none.
    #[error(transparent)]
    Profile(#[from] ProfileError),
    /// A dwell has come to nothing.
    #[error(transparent)]
    Hold(#[from] HoldError),
    /// Poses make no calibration.
    #[error(transparent)]
    Hand(#[from] HandError),
    /// A report could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// What was asked for is nothing that can be done with these nodes and devices.
    #[error("{0}")]
    Request(&'static str),
    /// A node is named twice.
    #[error("node {0} is named twice")]
    Twice(u8),
    /// A node that is no channel of a Plumb.
    #[error("node {0} is no channel of a Plumb")]
    Stranger(u8),
    /// Tables with points so far apart, deg, may err by this between them, deg.
    #[error(
        "tables with points {0} deg apart err by up to {1:.3} deg between them: give a smaller \
         --step, or the --tolerance that is wanted"
    )]
    Coarse(u32, f64),
    /// A node's calibration can't be read.
    #[error(
        "the calibration of node {0} (2061h) is of a format that this release of plumb does not \
         support"
    )]
    Undecodable(u8),
    /// A node takes no samples.
    #[error("node {0} takes no samples: its sensor does not answer; `plumb info` shows more")]
    NoSamples(u8),
    /// The housing does not stand still: node, where, scatter in mg.
    #[error(
        "the housing does not stand still {1}: node {0} scatters by {2:.1} mg; keep vibration away"
    )]
    Restless(u8, String, f64),
    /// A node refuses a point of its table: node, angle, 2060h sub 8.
    #[error("node {0} does not take the point at {1:.3} deg (2060h sub 8 is {2})")]
    Point(u8, f64, u8),
    /// Readings make no calibration of a node.
    #[error("node {0}: {1}")]
    Fit(u8, FitError),
    /// Something has happened to a node in the middle of the work.
    #[error("node {0} {1}")]
    Upset(u8, Upset),
    /// A node has come back as another one.
    #[error("node {0} has come back with another serial number or calibration")]
    Exchanged(u8),
    /// What a node reads back is not what was written to it.
    #[error("node {0} reads back another calibration than was written to it")]
    Differs(u8),
    /// The poses have ended before all were taken.
    #[error("the input ended before all poses were taken; missing: {0}")]
    Ended(String),
    /// A file could not be read or written.
    #[error("cannot use {0}: {1}")]
    File(PathBuf, io::Error),
    /// A file is not what it should be.
    #[error("{0}: {1}")]
    Content(PathBuf, &'static str),
    /// A file has no entry for a node's serial number.
    #[error("{0} has no entry for node {1} with the serial number {2}")]
    Unknown(PathBuf, u8, u32),
    /// The file of --keep can't be written there.
    #[error("cannot write {0}: {1}; choose another file with --keep")]
    Keep(PathBuf, NoPlace),
    /// A file of an earlier calibration, and what else to name.
    #[error("{0} is there already: choose another {1}, or replace it with --force")]
    Earlier(PathBuf, &'static str),
    /// The instrument was not within its tolerance.
    #[error("the instrument is not within its tolerance")]
    Rejected,
    /// It could not be printed.
    #[error("cannot print: {0}")]
    Print(io::Error),
    /// Something else, and the nodes that could not be given back what they had.
    #[error(
        "{0}; {a} could not be given back what was found: write as-found.json with --restore",
        a = joined(.1)
    )]
    Left(Box<CalibrateError>, Vec<u8>),
    /// Something else while a file was restored, and the nodes that could not be given back what
    /// they had.
    #[error(
        "{0}; {a} could not be given back what was found: run the same command again",
        a = joined(.1)
    )]
    LeftByRestore(Box<CalibrateError>, Vec<u8>),
    /// Something else, and the nodes that had nothing to be given back.
    #[error(
        "{0}; {a} had no calibration before: what this run stored stays until the next one",
        a = joined(.1)
    )]
    First(Box<CalibrateError>, Vec<u8>),
    /// A node has no calibration to keep.
    #[error("node {0} has no calibration yet: there is nothing to keep")]
    NothingToKeep(u8),
    /// The chamber does not reach a temperature of the profile: it, and the chamber's range.
    #[error(
        "the profile has {0} degC, and the chamber goes from {a} to {b} degC: choose another \
         profile with --profile, --from or --to",
        a = .1[0],
        b = .1[1]
    )]
    Range(f64, [f64; 2]),
    /// The orientations do not tell offset from gain: node-id, axis.
    #[error(
        "the orientations are too alike for axis {1} of node {0}: does the motor turn this \
         housing?"
    )]
    Alike(u8, char),
    /// The housing does not stand level: node-id.
    #[error(
        "node {0} does not lie level, which the piecewise model takes: put the housing on its base"
    )]
    Tilted(u8),
    /// A dwell was spoilt too often: set point, and by what the last time.
    #[error("the dwell at {0} degC was begun too often: {1}")]
    Spoilt(f64, Box<CalibrateError>),
    /// There is no run to go on from.
    #[error("{0} is not there: no run to go on from; omit --resume, or name its folder with --out")]
    NoRun(PathBuf),
    /// A folder holds a run that has come to its end, and none that was interrupted.
    #[error("the run in {0} has come to its end: there is nothing to resume")]
    Finished(PathBuf),
    /// A folder holds a run that was interrupted.
    #[error(
        "{0} holds a run that was interrupted: go on with --resume, choose another folder with \
         --out, or start again with --force"
    )]
    Unfinished(PathBuf),
    /// A file is none that a run has written.
    #[error(
        "{0} is damaged, was changed, or was not written by plumb characterise: bring it back from \
         a copy, or choose another folder with --out"
    )]
    Damaged(PathBuf),
    /// A file is of a newer program.
    #[error(
        "{0} is of a newer version of plumb: go on with that one, or choose another folder with \
         --out"
    )]
    Newer(PathBuf),
    /// A file is of a run that was begun with something else.
    #[error(
        "{0} was begun with another {1}: resume with the same instrument and options as then, or \
         begin a new run with another --out"
    )]
    Another(PathBuf, &'static str),
    /// The model does not fit the chain's numbers: node-id.
    #[error(
        "the model of node {0} does not fit its calibration's numbers: the sensor is faulty, or \
         it did not stand still"
    )]
    Beyond(u8),
    /// Something else, and where stands what was measured until then.
    #[error(
        "{0} (what was measured so far is kept: go on with --resume --out {1} and the options of \
         before)"
    )]
    Kept(Box<CalibrateError>, PathBuf),
    /// Something else, and why what was measured until then could not be kept.
    #[error("{0} (what was measured is lost: {1})")]
    Unkept(Box<CalibrateError>, Box<CalibrateError>),
}

fn joined(nodes: &[u8]) -> String {
    let word = if nodes.len() == 1 { "node" } else { "nodes" };
    let nodes: Vec<_> = nodes.iter().map(u8::to_string).collect();
    format!("{word} {}", nodes.join(" and "))
}

impl From<BusEnd> for CalibrateError {
    fn from(end: BusEnd) -> Self {
        match end {
            BusEnd::Interrupted => Self::Interrupted,
            BusEnd::Lost(error) => Self::Lost(error),
        }
    }
}

impl From<SdoError> for CalibrateError {
    fn from(error: SdoError) -> Self {
        match error {
            // The nodes are given back what they had, whether one has taken the write or not.
            SdoError::Behind(..) => Self::Interrupted,
            SdoError::Amid(why, ..) => Self::from(*why),
            SdoError::Bus(end) => end.into(),
            error => Self::Sdo(error),
        }
    }
}

impl From<Fault> for CalibrateError {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Bus(end) => end.into(),
            Fault::Sdo(error) => error.into(),
            Fault::Silent(why) => Self::Silent(why),
            other => Self::Lost(io::Error::other(other.to_string())),
        }
    }
}

impl CalibrateError {
    /// Whether something has happened to a node that may be over: it was disturbed, or is silent.
    pub fn is_upset(&self) -> bool {
        matches!(self, Self::Upset(..)) || self.is_silence()
    }

    /// Whether a node did not answer: it may do so later.
    pub fn is_silence(&self) -> bool {
        matches!(self, Self::Sdo(error) if error.is_silence())
    }

    /// Of two ways to do it one has to be named.
    ///
    /// Errors: [`CalibrateError::Request`] with one of both sentences.
    pub fn unless_one(
        named: [bool; 2],
        neither: &'static str,
        both: &'static str,
    ) -> Result<(), Self> {
        match named {
            [false, false] => Err(Self::Request(neither)),
            [true, true] => Err(Self::Request(both)),
            _ => Ok(()),
        }
    }

    /// What it means that this file could not be read or written.
    pub fn file(path: &Path) -> impl Fn(io::Error) -> Self {
        move |error| Self::File(path.to_owned(), error)
    }
}
