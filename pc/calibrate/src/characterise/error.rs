//! Why a run over temperature did not come to its end: one sentence.

use std::io;
use std::path::PathBuf;

use super::chamber::ChamberError;
use super::hold::HoldError;
use super::profile::ProfileError;
use crate::CalibrateError;
use crate::motor::MotorError;

/// Why there is no temperature model.
#[derive(Debug, thiserror::Error)]
pub enum CharacteriseError {
    /// What the work with the nodes, the motor and the report has come to.
    #[error("{0}")]
    Work(#[from] CalibrateError),
    /// The chamber did not do its part.
    #[error("{0}")]
    Chamber(#[from] ChamberError),
    /// The profile is none.
    #[error("{0}")]
    Profile(#[from] ProfileError),
    /// A dwell has come to nothing; the sentence, with the node named.
    #[error("{0}")]
    Hold(String),
    /// Neither a chamber nor a hand was named.
    #[error(
        "state what controls the temperature: --chamber URL or --by-hand; --keep and --restore \
         FILE work without"
    )]
    Method,
    /// Both were.
    #[error("a program or a person sets the chamber: give --chamber URL or --by-hand, not both")]
    Both,
    /// The motor turns one axis only.
    #[error(
        "the motor turns one axis only, and the quadratic model takes both: leave --motor out and \
         turn the housing by hand (docs/chamber.md)"
    )]
    OneAxis,
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
    Spoilt(f64, CalibrateError),
    /// There is no run to go on from.
    #[error(
        "{path} is not there: no run to go on from; leave --resume out, or name its folder with \
         --out",
        path = .0.display()
    )]
    NoRun(PathBuf),
    /// A folder holds a run that was interrupted.
    #[error(
        "{path} holds a run that was interrupted: go on with --resume, choose another folder with \
         --out, or start again with --force",
        path = .0.display()
    )]
    Unfinished(PathBuf),
    /// A file is none that a run has written.
    #[error(
        "{path} is damaged, was changed, or was not written by plumb characterise: bring it back \
         from a copy, or choose another folder with --out",
        path = .0.display()
    )]
    Content(PathBuf),
    /// A file is of a newer program.
    #[error(
        "{path} is of a newer version of plumb: go on with that one, or choose another folder \
         with --out",
        path = .0.display()
    )]
    Newer(PathBuf),
    /// A file is of a run that was begun with something else.
    #[error(
        "{path} was begun with another {1}: start again with --force, or with another --out",
        path = .0.display()
    )]
    Another(PathBuf, &'static str),
    /// A file could not be read or written.
    #[error("cannot use {path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// The model does not fit the chain's numbers: node-id.
    #[error(
        "the model of node {0} does not fit its calibration's numbers: the sensor is faulty, or \
         it did not stand still"
    )]
    Beyond(u8),
    /// Something else, and where stands what was measured until then.
    #[error(
        "{0} (what was measured so far is kept: go on with --resume --out {path})",
        path = .1.display()
    )]
    Kept(Box<CharacteriseError>, PathBuf),
    /// Something else, and why what was measured until then could not be kept.
    #[error("{0} (what was measured is lost: {1})")]
    Lost(Box<CharacteriseError>, Box<CharacteriseError>),
}

impl From<MotorError> for CharacteriseError {
    fn from(error: MotorError) -> Self {
        Self::Work(error.into())
    }
}

impl CharacteriseError {
    /// The same of a dwell; `node` gives the node-id of a place.
    pub fn of_hold(error: &HoldError, node: impl Fn(usize) -> u8) -> Self {
        Self::Hold(error.sentence(node))
    }
}
