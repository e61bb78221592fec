//! Why a file can't be used: one sentence that names the file, the line and what to do.
//!
//! In: what those who read, calibrate and compare have found. Out: [`FileError`]. Its text is one
//! line that a terminal shows as it is, whatever the names of the files are.

use std::io;

use bus_logs::LONGEST_LINE;
use output::printable;
use tilt::calibration::FitError;

use super::skips::{Reason, Skips};

/// What to do about a calibration file that is none.
const ANEW: &str = "make it again with --save-calibration";

/// A file that can't be used, or not together with the others.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{a}", a = printable(&format!("{file}{}: {problem}", of_line(*line))))]
pub struct FileError {
    /// The file as the caller named it.
    pub file: String,
    /// The line it is about, counted from 1, where there is one.
    pub line: Option<u64>,
    /// What is wrong.
    pub problem: Problem,
}

impl FileError {
    /// About the file as a whole.
    pub fn of_file(file: impl Into<String>, problem: Problem) -> Self {
        Self {
            file: file.into(),
            line: None,
            problem,
        }
    }

    /// About one line.
    pub fn of_line(file: &str, line: u64, problem: Problem) -> Self {
        Self {
            line: Some(line),
            ..Self::of_file(file, problem)
        }
    }
}

fn of_line(line: Option<u64>) -> String {
    line.map_or_else(String::new, |line| format!(", line {line}"))
}

/// What is wrong with a file: of any kind, then a recording, then two of them, then a calibration
/// file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// Not found, a folder, no permission, a failing disk: what the system reports.
    #[error("can't be read ({0}); check the path")]
    NotReadable(String),
    /// It could not be written: what the system reports.
    #[error("can't be written ({0}); give another path")]
    NotWritable(String),
    /// A file is where the calibration is to be saved.
    #[error(
        "is there already; choose another file with --save-calibration, or replace it with --force"
    )]
    Taken,
    /// More than two recordings: this is the third.
    #[error("a third recording; give one for one channel or two for a cross-check")]
    TooManyFiles,
    /// Both recordings are this file.
    #[error("given as both channels, and would agree with itself; give two recordings")]
    SameFile,
    /// The calibration would overwrite this file, which is read.
    #[error("is read by this replay; give --save-calibration another path")]
    SaveOverInput,
    /// Counts per g that are no positive number.
    #[error("--lsb-per-g {0} is no scale; give a positive number of counts")]
    LsbPerG(f64),
    /// A delay that no gyroscope has.
    #[error("--rate-delay {0} is no delay of a gyroscope; give 0 to 4 ms")]
    RateDelay(f64),

    /// No line at all, or blank and comment lines only.
    #[error("holds no line; give a CSV file with a header")]
    Empty,
    /// The header holds bytes that are no text.
    #[error(
        "is no text; give a CSV file of a sensor, or a log of a bus as candump -L or an ASC \
         logger writes it, plain or gzip"
    )]
    Binary,
    /// The gzip stream breaks off after this many usable rows.
    #[error(
        "the gzip stream breaks off after {0} good rows; copy the file again, or recover the rows \
         with `gunzip -c` and give the plain CSV"
    )]
    GzipTruncated(usize),
    /// The gzip stream is damaged after this many usable rows.
    #[error("the gzip stream is damaged after {0} good rows; copy the file again")]
    GzipCorrupt(usize),
    /// The line is over 64 kB.
    #[error("is over {LONGEST_LINE} bytes long; give a CSV file with one sample a line")]
    LineTooLong,
    /// Over this many rows.
    #[error("more than {0} rows; cut the file in parts")]
    TooManyRows(usize),
    /// This stands between the names of the header instead of a comma.
    #[error(
        "the columns are separated by '{a}'; use commas, and points in numbers",
        a = .0.escape_default()
    )]
    Separator(char),
    /// The first line holds numbers.
    #[error(
        "holds numbers where the header should be; put a first line such as \
         `time_s,ax_g,ay_g,az_g`"
    )]
    NoHeader,
    /// A column isn't there.
    #[error("no column {wanted}; there is {a}; {b}", a = listed(.there), b = renamed(.nearest))]
    MissingColumn {
        /// The column that is missing.
        wanted: String,
        /// The columns that are there.
        there: Vec<String>,
        /// The name among them that is nearest to the one that is missing.
        nearest: Option<String>,
    },
    /// The three axes differ in unit.
    #[error("the axes differ in unit ({a}); give all in one", a = listed(.0))]
    MixedUnits(Vec<String>),
    /// A column of time or acceleration whose unit isn't known.
    #[error("`{column}` has no unit; name it {a}", a = .known.join(" or "))]
    UnknownUnit {
        /// The column.
        column: String,
        /// The names that would do.
        known: Vec<String>,
    },
    /// Two columns give the same quantity.
    #[error("`{0}` and `{1}` give the same quantity; take one of them out")]
    DuplicateColumn(String, String),
    /// Counts whose length at standstill is near no usual number of counts per g.
    #[error(
        "the length at standstill is {0:.1} counts, near no usual counts per g; use --lsb-per-g"
    )]
    UnknownScale(f64),
    /// The length at standstill isn't near 1 g.
    #[error("the length at standstill is {norm_g:.4} g instead of 1 g; {advice}")]
    WrongUnit {
        /// Median length at standstill, g by the header's unit.
        norm_g: f64,
        /// What to do about it.
        advice: String,
    },
    /// The rates of a gyroscope are in the unit that the header does not name.
    #[error(
        "its acceleration turns as if the rates were in {fits} and not in {named}: name the \
         columns `gx{suffix}`, `gy{suffix}` and `gz{suffix}`"
    )]
    RateUnit {
        /// The unit that the header names.
        named: &'static str,
        /// The one that fits.
        fits: &'static str,
        /// How the columns are called then.
        suffix: &'static str,
    },
    /// The rates of a gyroscope turn the other way than the acceleration.
    #[error(
        "its rates turn the other way than its acceleration: a sign is wrong, or axes are swapped"
    )]
    RateSign,
    /// Too few usable rows.
    #[error("only {rows} usable rows ({skips}); at least 50 are needed")]
    TooFewRows {
        /// How many there are.
        rows: usize,
        /// What was left out.
        skips: Box<Skips>,
    },
    /// More rows were left out than kept.
    #[error("more rows skipped than the {rows} kept ({skips}); mend {a}", a = to_mend(.skips))]
    MostlySkipped {
        /// How many were kept.
        rows: usize,
        /// What was left out.
        skips: Box<Skips>,
    },
    /// Under 25 or over 10 000 samples per second by the header's unit of time.
    #[error("{hz:.3} samples per second is outside 25 to 10000; {a}", a = rate_advice(*.fits))]
    Rate {
        /// Samples per second, from the median difference of time.
        hz: f64,
        /// The header that would fit, if one would.
        fits: Option<&'static str>,
    },
    /// `--from reference`, but the recording has no reference columns.
    #[error("has no reference columns, or empty ones; calibrate with --from poses")]
    NoReference,
    /// The standstills of the recording don't make a calibration.
    #[error(
        "no calibration from it: {0}, or give one with --calibration, or take the sensor as \
         nominal with --from nominal"
    )]
    Calibrate(CalibrateError),

    /// The standstills that both recordings show don't tell how the second is turned.
    #[error(
        "can't be turned onto the first recording, since of what stands still in both, {0}, or \
         give a calibration of both with --calibration"
    )]
    Align(CalibrateError),
    /// Both recordings have standstills, but of different motions.
    #[error(
        "doesn't show the motion of {other}: their common standstills are {left_deg:.1} deg \
         apart; give two recordings of one run"
    )]
    OtherMotion {
        /// The first recording.
        other: String,
        /// Median angle between the standstills that are left, deg.
        left_deg: f64,
    },
    /// The recordings have no time in common.
    #[error(
        "its time runs from {:.3} s to {:.3} s and that of {one} from {:.3} s to {:.3} s; give \
         two recordings of one run with a common clock",
        .own_s[0], .own_s[1], .one_s[0], .one_s[1]
    )]
    NoOverlap {
        /// First and last time of this recording, s.
        own_s: [f64; 2],
        /// The first recording.
        one: String,
        /// Its first and last time, s.
        one_s: [f64; 2],
    },

    /// The calibration was made for another scale.
    #[error(
        "was made for {made_for} numbers per g and {recording} has {found}; give the recordings \
         of that sensor in their order, or use --lsb-per-g"
    )]
    OtherScale {
        /// The recording.
        recording: String,
        /// Numbers per g that the calibration was made for.
        made_for: f64,
        /// Numbers per g of the recording.
        found: f64,
    },
    /// The calibration makes something else than 1 g of the standstills.
    #[error(
        "makes {length_g:.3} g of the standstills of {recording} instead of 1 g: it belongs to \
         another sensor; give that sensor's own, or leave it out"
    )]
    OtherSensor {
        /// The recording.
        recording: String,
        /// Median length at standstill by the calibration, g.
        length_g: f64,
    },
    /// Over 1 MiB.
    #[error("too large for a calibration file; {ANEW}")]
    TooLarge,
    /// No JSON, or a field of the wrong kind.
    #[error("is no calibration file ({0}); {ANEW}")]
    Malformed(String),
    /// `format` is something else than this.
    #[error("`format` is not \"{0}\"; {ANEW}")]
    Format(&'static str),
    /// A version that isn't read here, and the one that is.
    #[error("version {0} can't be read here, only version {1}; {ANEW}")]
    Version(String, u64),
    /// `channels` was changed after it was written.
    #[error(
        "the CRC-32 of its channels is {computed:08x} and not {stated}: it was changed or \
         damaged; {ANEW}"
    )]
    Crc {
        /// Of the channels as they stand.
        computed: u32,
        /// As stated in the file.
        stated: String,
    },
    /// Another number of channels than recordings.
    #[error(
        "holds {found} channels for {expected} recordings; give as many recordings, in the same \
         order"
    )]
    ChannelCount {
        /// In the file.
        found: usize,
        /// Recordings given.
        expected: usize,
    },
    /// A channel, counted from 1, with values that no sensor has.
    #[error("channel {0}: {1}; {ANEW}")]
    Channel(usize, Impossible),
}

impl Problem {
    /// What the system reports of a file that is read.
    pub fn not_readable(error: &io::Error) -> Self {
        Self::NotReadable(plain(error))
    }

    /// What the system reports of a file that is written.
    pub fn not_writable(error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::AlreadyExists => Self::Taken,
            _ => Self::NotWritable(plain(error)),
        }
    }
}

fn plain(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file or folder".to_owned(),
        io::ErrorKind::IsADirectory => "it is a folder".to_owned(),
        io::ErrorKind::PermissionDenied => "no permission".to_owned(),
        _ => error.to_string(),
    }
}

/// Why standstills don't make a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// Too few standstills; the directions that no standstill comes near.
    #[error("{have} standstills are too few, it takes {need}; add poses {a}", a = near(.missing))]
    TooFew {
        /// Standstills there are.
        have: usize,
        /// Standstills needed.
        need: usize,
        /// Directions of gravity in the sensor's axes that are missing, as in `+x`.
        missing: Vec<&'static str>,
    },
    /// Too few of the standstills have a reference.
    #[error(
        "{have} standstills with a reference are too few, it takes {need}; record more plateaus \
         or calibrate from poses"
    )]
    NoReference {
        /// Those that have one.
        have: usize,
        /// Those needed.
        need: usize,
    },
    /// Enough standstills, but too alike.
    #[error(
        "the standstills are too alike (condition {condition:.3e}); add poses {a}",
        a = near(.missing)
    )]
    IllConditioned {
        /// Condition figure; 1 is best, over 1e6 is refused.
        condition: f64,
        /// Directions of gravity in the sensor's axes that are missing.
        missing: Vec<&'static str>,
    },
    /// The fit didn't settle or is not what a working sensor can have.
    #[error("{0}")]
    Implausible(FitError),
}

/// Why a channel's values can't be those of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Impossible {
    /// A matrix entry of 2 g/g or more.
    #[error("a matrix entry is 2 g/g or more")]
    Gain,
    /// An offset of over 1 g.
    #[error("an offset is over 1 g")]
    Offset,
    /// A number that isn't finite, or negative where it can't be.
    #[error("a residual, rate or scale is negative or not finite")]
    Number,
    /// The matrix has lost an axis.
    #[error("the matrix is singular")]
    Singular,
    /// The matrix makes a left hand of a right one.
    #[error("the matrix mirrors, which no sensor does")]
    Mirrored,
    /// Two axes are over 20 deg off a right angle.
    #[error("two axes are more than 20 deg off a right angle")]
    Shear,
    /// Some acceleration comes out at less than half or more than twice its length.
    #[error("the matrix halves or doubles some acceleration")]
    Stretch,
    /// The integers and the numbers for the reader disagree.
    #[error("`matrix_q30` or `offset_q26` disagrees with `matrix` or `offset_g`")]
    Disagree,
}

fn near(missing: &[&str]) -> String {
    match missing {
        [] => "in directions between those there are".to_owned(),
        some => format!("with gravity near {}", some.join(", ")),
    }
}

fn to_mend(skips: &Skips) -> &'static str {
    match skips.worst().map(|(reason, _)| reason) {
        Some(Reason::BackwardTime | Reason::ForwardJump | Reason::RepeatedTime) => {
            "the time column"
        }
        Some(Reason::CellCount) => {
            "the number of cells in each row, with points and no commas in numbers"
        }
        Some(Reason::OverRange) => "the unit of those columns",
        Some(Reason::AllZero) => "the logger: the sensor did not answer",
        _ => "those cells",
    }
}

fn renamed(nearest: &Option<String>) -> String {
    match nearest {
        Some(name) => format!("rename `{name}` if it is meant"),
        None => "name it in the header".to_owned(),
    }
}

fn rate_advice(fits: Option<&str>) -> String {
    match fits {
        Some(name) => format!("the time looks as if it were `{name}`"),
        None => "check the time column, or record faster".to_owned(),
    }
}

fn listed(names: &[String]) -> String {
    const MOST: usize = 12;
    let shown = names.iter().take(MOST);
    let quoted: Vec<String> = shown.map(|name| format!("`{name}`")).collect();
    match names.len().saturating_sub(MOST) {
        _ if names.is_empty() => "none".to_owned(),
        0 => quoted.join(", "),
        more => format!("{} and {more} more", quoted.join(", ")),
    }
}
