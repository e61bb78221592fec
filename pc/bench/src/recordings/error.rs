//! Why a replay could not be carried out: one sentence that names the file and what to do.

use std::fmt;

use super::calibrate::CalibrateError;
use super::calibration_file::CalibrationFileError;
use super::recording_error::RecordingError;
use output::printable;
use output::write::WriteError;

/// A replay that could not be carried out. Nothing has been written when one is returned.
#[derive(Debug)]
pub enum ReplayError {
    /// More than two recordings: the third.
    TooManyFiles(String),
    /// Both recordings are the same file.
    SameFile(String),
    /// The calibration would overwrite a file that is read.
    SaveOverInput(String),
    /// Counts per g that are no positive number, for this recording.
    LsbPerG(String, f64),
    /// A recording that can't be used.
    Recording(RecordingError),
    /// `--from reference`, but this recording has no reference columns.
    NoReference(String),
    /// The standstills of this recording don't make a calibration.
    Calibrate(String, CalibrateError),
    /// The standstills that both recordings show don't tell how the second is turned.
    Align(String, CalibrateError),
    /// Both recordings have standstills, but of different motions.
    OtherMotion {
        /// The second recording.
        file: String,
        /// The first recording.
        other: String,
        /// Median angle between the standstills that are left, deg.
        left_deg: f64,
    },
    /// The recordings have no time in common.
    NoOverlap {
        /// The first recording.
        one: String,
        /// Its first and last time, s.
        one_s: [f64; 2],
        /// The second recording.
        other: String,
        /// Its first and last time, s.
        other_s: [f64; 2],
    },
    /// A calibration file that can't be used or written.
    CalibrationFile(CalibrationFileError),
    /// The calibration was made for another scale.
    OtherScale {
        /// The calibration file.
        calibration: String,
        /// The recording.
        file: String,
        /// Numbers per g that the calibration was made for.
        made_for: f64,
        /// Numbers per g of the recording.
        found: f64,
    },
    /// The calibration makes something else than 1 g of the standstills.
    OtherSensor {
        /// The calibration file.
        calibration: String,
        /// The recording.
        file: String,
        /// Median length at standstill by the calibration, g.
        length_g: f64,
    },
    /// The report could not be written.
    Write(WriteError),
    /// The report could not be turned into JSON.
    Json(serde_json::Error),
    /// Standard output could not be written.
    Stdout(std::io::Error),
}

impl std::error::Error for ReplayError {}

impl fmt::Display for ReplayError {
    /// One line, whatever the names of the files are.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&printable(&Sentence(self).to_string()))
    }
}

/// The message as it is, with file names that may hold anything.
struct Sentence<'a>(&'a ReplayError);

impl fmt::Display for Sentence<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        use ReplayError as Error;
        match self.0 {
            Error::TooManyFiles(third) => write!(
                f,
                "{third}: a third recording; give one for one channel or two for a cross-check"
            ),
            Error::SameFile(file) => write!(
                f,
                "{file}: given as both channels, and would agree with itself; give two recordings"
            ),
            Error::SaveOverInput(file) => write!(
                f,
                "{file}: is read by this replay; give --save-calibration another path"
            ),
            Error::LsbPerG(file, given) => write!(
                f,
                "{file}: --lsb-per-g {given} is no scale; give a positive number of counts"
            ),
            Error::Recording(error) => write!(f, "{error}"),
            Error::CalibrationFile(error) => write!(f, "{error}"),
            Error::Write(error) => write!(f, "{error}"),
            Error::Json(error) => write!(f, "the report can't be written as JSON: {error}"),
            Error::Stdout(error) => write!(f, "standard output can't be written: {error}"),
            _ => self.0.about_calibration(f),
        }
    }
}

impl ReplayError {
    fn about_calibration(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::NoReference(file) => write!(
                f,
                "{file}: has no reference columns, or empty ones; calibrate with --from poses"
            ),
            Self::Calibrate(file, why) => write!(
                f,
                "{file}: no calibration from it: {why}, or give one with --calibration"
            ),
            Self::Align(file, why) => write!(
                f,
                "{file}: can't be turned onto the first recording, since of what stands still in \
                 both, {why}, or give a calibration of both with --calibration"
            ),
            Self::OtherMotion {
                file,
                other,
                left_deg,
            } => write!(
                f,
                "{file}: doesn't show the motion of {other}: their common standstills are \
                 {left_deg:.1} deg apart; give two recordings of one run"
            ),
            Self::NoOverlap {
                one,
                one_s,
                other,
                other_s,
            } => write!(
                f,
                "{other}: its time runs from {:.3} s to {:.3} s and that of {one} from {:.3} s to \
                 {:.3} s; give two recordings of one run with a common clock",
                other_s[0], other_s[1], one_s[0], one_s[1]
            ),
            Self::OtherScale {
                calibration,
                file,
                made_for,
                found,
            } => write!(
                f,
                "{calibration}: was made for {made_for} numbers per g and {file} has {found}; \
                 give the recordings of that sensor in their order, or use --lsb-per-g"
            ),
            Self::OtherSensor {
                calibration,
                file,
                length_g,
            } => write!(
                f,
                "{calibration}: makes {length_g:.3} g of the standstills of {file} instead of \
                 1 g: it belongs to another sensor; give that sensor's own, or leave it out"
            ),
            // Each one of these has its sentence above.
            Self::TooManyFiles(_)
            | Self::SameFile(_)
            | Self::SaveOverInput(_)
            | Self::LsbPerG(..)
            | Self::Recording(_)
            | Self::CalibrationFile(_)
            | Self::Write(_)
            | Self::Json(_)
            | Self::Stdout(_) => Ok(()),
        }
    }
}

impl From<RecordingError> for ReplayError {
    fn from(error: RecordingError) -> Self {
        Self::Recording(error)
    }
}

impl From<CalibrationFileError> for ReplayError {
    fn from(error: CalibrationFileError) -> Self {
        Self::CalibrationFile(error)
    }
}
