//! Why a calibration did not come to its end: one sentence that says who, what, and what to do.

use std::io;
use std::path::PathBuf;

use tilt::calibration::FitError;

use super::hand::HandError;
use super::motor::MotorError;
use super::session::Upset;
use bus_master::JoinError;
use bus_master::sdo::SdoError;
use output::write::WriteError;

/// Why there is no calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The bus could not be joined.
    #[error("{0}")]
    Join(JoinError),
    /// A node did not do its part.
    #[error("{0}")]
    Sdo(SdoError),
    /// The bus was lost.
    #[error("the bus is lost: {0}")]
    Lost(io::Error),
    /// The user has ended it.
    #[error("interrupted; the calibration that was there counts")]
    Interrupted,
    /// The motor did not do its part.
    #[error("{0}")]
    Motor(#[from] MotorError),
    /// Neither a motor nor a hand was named.
    #[error("state how to calibrate: --motor URL, --by-hand, or --keep or --restore FILE")]
    Method,
    /// Both were.
    #[error(
        "either a motor turns the housing or a person does: give --motor URL or --by-hand, not \
         both"
    )]
    Both,
    /// More or fewer nodes than an instrument has.
    #[error("give one node or the two of an instrument, as --nodes 1,2")]
    Nodes,
    /// A node is named twice.
    #[error("node {0} is named twice")]
    Twice(u8),
    /// A node that is no channel of a Plumb.
    #[error("node {0} is no channel of a Plumb")]
    Stranger(u8),
    /// The nodes measure in different ways.
    #[error(
        "the nodes measure in different ways (2030h, 2062h sub 2): calibrate them one by one with \
         --nodes"
    )]
    Mixed,
    /// Tables with points so far apart, deg, may err by this between them, deg.
    #[error(
        "tables with points {0} deg apart err by up to {1:.3} deg between them: give a smaller \
         --step, or the --tolerance that is wanted"
    )]
    Coarse(u32, f64),
    /// This way to calibrate is not for instruments of this kind.
    #[error("{0}")]
    Kind(&'static str),
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
    /// Poses make no calibration.
    #[error("{0}")]
    Hand(#[from] HandError),
    /// Something has happened to a node in the middle of the work.
    #[error("node {0} {a}", a = upset(.1))]
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
    /// A report could not be written.
    #[error("{0}")]
    Write(WriteError),
    /// A file could not be read or written.
    #[error("cannot use {path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// A file is not what it should be.
    #[error("{path}: {1}", path = .0.display())]
    Content(PathBuf, &'static str),
    /// A file says nothing of a node's serial number.
    #[error("{path} has no entry for node {1} with the serial number {2}", path = .0.display())]
    Unknown(PathBuf, u8, u32),
    /// A file of an earlier calibration, and what else to name.
    #[error(
        "{path} is there already: choose another {1}, or replace it with --force",
        path = .0.display()
    )]
    Earlier(PathBuf, &'static str),
    /// The instrument was not within its tolerance.
    #[error("the instrument is not within its tolerance")]
    Rejected,
    /// It could not be printed.
    #[error("cannot print: {0}")]
    Print(io::Error),
    /// Something else, and the nodes that could not be given back what they had.
    #[error(
        "{0}; node {a} could not be given back the calibration that it had: write as-found.json \
         with --restore",
        a = joined(.1)
    )]
    Left(Box<CalibrateError>, Vec<u8>),
}

const fn upset(what: &Upset) -> &'static str {
    match what {
        Upset::Restarted => "has restarted in the middle: look at its supply",
        Upset::Commanded => {
            "was taken out of PRE-OPERATIONAL (NMT) in the middle: no other master may command it \
             meanwhile"
        }
    }
}

fn joined(nodes: &[u8]) -> String {
    let nodes: Vec<_> = nodes.iter().map(u8::to_string).collect();
    nodes.join(" and ")
}

impl From<SdoError> for CalibrateError {
    fn from(error: SdoError) -> Self {
        match error {
            SdoError::Interrupted => Self::Interrupted,
            SdoError::Lost(error) => Self::Lost(error),
            error => Self::Sdo(error),
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

    /// What it means that the bus could not be read or written.
    pub fn lost(error: io::Error) -> Self {
        SdoError::lost(error).into()
    }
}
