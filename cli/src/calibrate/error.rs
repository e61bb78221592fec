//! Why a calibration did not come to its end: one sentence that says who, what, and what to do.

use std::fmt;
use std::io;
use std::path::PathBuf;

use tilt::calibration::FitError;

use super::hand::HandError;
use super::motor::MotorError;
use super::session::Upset;
use crate::bus::JoinError;
use crate::bus::sdo::SdoError;
use crate::report::write::WriteError;

/// Why there is no calibration.
#[derive(Debug)]
pub enum CalibrateError {
    /// The bus could not be joined.
    Join(JoinError),
    /// A node did not do its part.
    Sdo(SdoError),
    /// The bus was lost.
    Lost(io::Error),
    /// The user has ended it.
    Interrupted,
    /// The motor did not do its part.
    Motor(MotorError),
    /// Neither a motor nor a hand was named.
    Method,
    /// Both were.
    Both,
    /// More or fewer nodes than an instrument has.
    Nodes,
    /// A node is named twice.
    Twice(u8),
    /// A node that is no channel of a Plumb.
    Stranger(u8),
    /// The nodes measure in different ways.
    Mixed,
    /// Tables with points so far apart, deg, may err by this between them, deg.
    Coarse(u32, f64),
    /// This way to calibrate is not for instruments of this kind.
    Kind(&'static str),
    /// A node's calibration can't be read.
    Undecodable(u8),
    /// A node takes no samples.
    NoSamples(u8),
    /// The housing does not stand still: node, where, scatter in mg.
    Restless(u8, String, f64),
    /// A node refuses a point of its table: node, angle, 2060h sub 8.
    Point(u8, f64, u8),
    /// Readings make no calibration of a node.
    Fit(u8, FitError),
    /// Poses make no calibration.
    Hand(HandError),
    /// Something has happened to a node in the middle of the work.
    Upset(u8, Upset),
    /// A node has come back as another one.
    Exchanged(u8),
    /// What a node reads back is not what was written to it.
    Differs(u8),
    /// The poses have ended before all were taken.
    Ended(String),
    /// A report could not be written.
    Write(WriteError),
    /// A file could not be read or written.
    File(PathBuf, io::Error),
    /// A file is not what it should be.
    Content(PathBuf, &'static str),
    /// A file says nothing of a node's serial number.
    Unknown(PathBuf, u8, u32),
    /// A file of an earlier calibration, and what else to name.
    Earlier(PathBuf, &'static str),
    /// The instrument was not within its tolerance.
    Rejected,
    /// It could not be printed.
    Print(io::Error),
    /// Something else, and the nodes that could not be given back what they had.
    Left(Box<CalibrateError>, Vec<u8>),
}

impl std::error::Error for CalibrateError {}

impl From<SdoError> for CalibrateError {
    fn from(error: SdoError) -> Self {
        match error {
            SdoError::Interrupted => Self::Interrupted,
            SdoError::Lost(error) => Self::Lost(error),
            error => Self::Sdo(error),
        }
    }
}

impl From<MotorError> for CalibrateError {
    fn from(error: MotorError) -> Self {
        Self::Motor(error)
    }
}

impl From<HandError> for CalibrateError {
    fn from(error: HandError) -> Self {
        Self::Hand(error)
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

impl fmt::Display for CalibrateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Join(error) => write!(f, "{error}"),
            Self::Sdo(error) => write!(f, "{error}"),
            Self::Lost(error) => write!(f, "the bus is lost: {error}"),
            Self::Interrupted => write!(f, "interrupted; the calibration that was there counts"),
            Self::Motor(error) => write!(f, "{error}"),
            Self::Hand(error) => write!(f, "{error}"),
            Self::Write(error) => write!(f, "{error}"),
            Self::Print(error) => write!(f, "cannot print: {error}"),
            Self::Method => write!(
                f,
                "state how to calibrate: --motor URL, --by-hand, or --keep or --restore FILE"
            ),
            Self::Both => write!(
                f,
                "either a motor turns the housing or a person does: give --motor URL or --by-hand, \
                 not both"
            ),
            Self::Earlier(path, other) => write!(
                f,
                "{} is there already: choose another {other}, or replace it with --force",
                path.display()
            ),
            Self::Nodes => write!(
                f,
                "give one node or the two of an instrument, as --nodes 1,2"
            ),
            Self::Mixed => write!(
                f,
                "the nodes measure in different ways (2030h, 2062h sub 2): calibrate them one by \
                 one with --nodes"
            ),
            Self::Kind(what) => write!(f, "{what}"),
            Self::Coarse(step, deg) => write!(
                f,
                "tables with points {step} deg apart err by up to {deg:.3} deg between them: give \
                 a smaller --step, or the --tolerance that is wanted"
            ),
            Self::Rejected => write!(f, "the instrument is not within its tolerance"),
            Self::Ended(missing) => write!(
                f,
                "the input ended before all poses were taken; missing: {missing}"
            ),
            Self::File(path, error) => write!(f, "cannot use {}: {error}", path.display()),
            Self::Content(path, what) => write!(f, "{}: {what}", path.display()),
            Self::Unknown(path, node, serial) => write!(
                f,
                "{} has no entry for node {node} with the serial number {serial}",
                path.display()
            ),
            Self::Left(error, nodes) => {
                let nodes: Vec<_> = nodes.iter().map(u8::to_string).collect();
                write!(
                    f,
                    "{error}; node {} could not be given back the calibration that it had: write \
                     as-found.json with --restore",
                    nodes.join(" and ")
                )
            }
            node => node.fmt_node(f),
        }
    }
}

impl CalibrateError {
    /// The sentence of an error that names a node.
    fn fmt_node(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Twice(node) => write!(f, "node {node} is named twice"),
            Self::Stranger(node) => write!(f, "node {node} is no channel of a Plumb"),
            Self::Undecodable(node) => write!(
                f,
                "the calibration of node {node} (2061h) is of a format that this release of plumb \
                 does not support"
            ),
            Self::NoSamples(node) => write!(
                f,
                "node {node} takes no samples: its sensor does not answer; `plumb info` shows more"
            ),
            Self::Restless(node, place, mg) => write!(
                f,
                "the housing does not stand still {place}: node {node} scatters by {mg:.1} mg; \
                 keep vibration away"
            ),
            Self::Point(node, deg, result) => write!(
                f,
                "node {node} does not take the point at {deg:.3} deg (2060h sub 8 is {result})"
            ),
            Self::Fit(node, error) => write!(f, "node {node}: {error}"),
            Self::Upset(node, Upset::Restarted) => write!(
                f,
                "node {node} has restarted in the middle: look at its supply"
            ),
            Self::Upset(node, Upset::Commanded) => write!(
                f,
                "node {node} was taken out of PRE-OPERATIONAL (NMT) in the middle: no other master \
                 may command it meanwhile"
            ),
            Self::Exchanged(node) => write!(
                f,
                "node {node} has come back with another serial number or calibration"
            ),
            Self::Differs(node) => write!(
                f,
                "node {node} reads back another calibration than was written to it"
            ),
            // The others name none.
            _ => Ok(()),
        }
    }
}
