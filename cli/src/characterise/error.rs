//! Why a run over temperature did not come to its end: one sentence.

use std::fmt;
use std::io;
use std::path::PathBuf;

use super::chamber::ChamberError;
use super::hold::HoldError;
use super::profile::ProfileError;
use crate::calibrate::CalibrateError;
use crate::calibrate::motor::MotorError;

/// Why there is no temperature model.
#[derive(Debug)]
pub enum CharacteriseError {
    /// What the work with the nodes, the motor and the report has come to.
    Work(CalibrateError),
    /// The chamber did not do its part.
    Chamber(ChamberError),
    /// The profile is none.
    Profile(ProfileError),
    /// A dwell has come to nothing; the sentence, with the node named.
    Hold(String),
    /// Neither a chamber nor a hand was named.
    Method,
    /// Both were.
    Both,
    /// The motor turns one axis only.
    OneAxis,
    /// The chamber does not reach a temperature of the profile: it, and the chamber's range.
    Range(f64, [f64; 2]),
    /// The orientations do not tell offset from gain: node-id, axis.
    Alike(u8, char),
    /// The housing does not stand level: node-id.
    Tilted(u8),
    /// A dwell was spoilt too often: set point, and by what the last time.
    Spoilt(f64, CalibrateError),
    /// There is no run to go on from.
    NoRun(PathBuf),
    /// A folder holds a run that was interrupted.
    Unfinished(PathBuf),
    /// A file is none that a run has written.
    Content(PathBuf),
    /// A file is of a newer program.
    Newer(PathBuf),
    /// A file is of a run that was begun with something else.
    Another(PathBuf, &'static str),
    /// A file could not be read or written.
    File(PathBuf, io::Error),
    /// The model does not fit the chain's numbers: node-id.
    Beyond(u8),
    /// Something else, and where stands what was measured until then.
    Kept(Box<CharacteriseError>, PathBuf),
    /// Something else, and why what was measured until then could not be kept.
    Lost(Box<CharacteriseError>, Box<CharacteriseError>),
}

impl std::error::Error for CharacteriseError {}

impl From<CalibrateError> for CharacteriseError {
    fn from(error: CalibrateError) -> Self {
        Self::Work(error)
    }
}

impl From<MotorError> for CharacteriseError {
    fn from(error: MotorError) -> Self {
        Self::Work(error.into())
    }
}

impl From<ChamberError> for CharacteriseError {
    fn from(error: ChamberError) -> Self {
        Self::Chamber(error)
    }
}

impl From<ProfileError> for CharacteriseError {
    fn from(error: ProfileError) -> Self {
        Self::Profile(error)
    }
}

impl CharacteriseError {
    /// The same of a dwell; `node` gives the node-id of a place.
    pub fn of_hold(error: &HoldError, node: impl Fn(usize) -> u8) -> Self {
        Self::Hold(error.sentence(node))
    }
}

impl CharacteriseError {
    /// What is wrong with a file or a folder.
    fn fmt_file(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRun(path) => write!(
                f,
                "{} is not there: no run to go on from; leave --resume out, or name its folder \
                 with --out",
                path.display()
            ),
            Self::Content(path) => write!(
                f,
                "{} is damaged, was changed, or was not written by plumb characterise: bring it \
                 back from a copy, or choose another folder with --out",
                path.display()
            ),
            Self::Newer(path) => write!(
                f,
                "{} is of a newer version of plumb: go on with that one, or choose another folder \
                 with --out",
                path.display()
            ),
            Self::Unfinished(path) => write!(
                f,
                "{} holds a run that was interrupted: go on with --resume, choose another folder \
                 with --out, or start again with --force",
                path.display()
            ),
            Self::Another(path, what) => write!(
                f,
                "{} was begun with another {what}: start again with --force, or with another --out",
                path.display()
            ),
            Self::File(path, error) => write!(f, "cannot use {}: {error}", path.display()),
            // Every other one has its sentence in `fmt`.
            _ => write!(f, "{self:?}"),
        }
    }
}

impl fmt::Display for CharacteriseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Work(CalibrateError::Interrupted) => {
                write!(f, "interrupted; the calibration that was there counts")
            }
            Self::Work(error) => write!(f, "{error}"),
            Self::Chamber(error) => write!(f, "{error}"),
            Self::Profile(error) => write!(f, "{error}"),
            Self::Hold(sentence) => write!(f, "{sentence}"),
            Self::Method => write!(
                f,
                "state what controls the temperature: --chamber URL or --by-hand; --keep and \
                 --restore FILE work without"
            ),
            Self::Both => write!(
                f,
                "a program or a person sets the chamber: give --chamber URL or --by-hand, not both"
            ),
            Self::OneAxis => write!(
                f,
                "the motor turns one axis only, and the quadratic model takes both: leave --motor \
                 out and turn the housing by hand (docs/chamber.md)"
            ),
            Self::Range(degc, [low, high]) => write!(
                f,
                "the profile has {degc} degC, and the chamber goes from {low} to {high} degC: \
                 choose another profile with --profile, --from or --to"
            ),
            Self::Alike(node, axis) => write!(
                f,
                "the orientations are too alike for axis {axis} of node {node}: does the motor \
                 turn this housing?"
            ),
            Self::Tilted(node) => write!(
                f,
                "node {node} does not lie level, which the piecewise model takes: put the housing \
                 on its base"
            ),
            Self::Spoilt(degc, error) => {
                write!(f, "the dwell at {degc} degC was begun too often: {error}")
            }
            Self::Beyond(node) => write!(
                f,
                "the model of node {node} does not fit its calibration's numbers: the sensor is \
                 faulty, or it did not stand still"
            ),
            Self::Kept(error, path) => write!(
                f,
                "{error} (what was measured so far is kept: go on with --resume --out {})",
                path.display()
            ),
            Self::Lost(error, why) => write!(f, "{error} (what was measured is lost: {why})"),
            of_a_file => of_a_file.fmt_file(f),
        }
    }
}
