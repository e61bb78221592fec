//! Why a recording can't be used: one sentence that names the file, the line and what to do.

use std::fmt;

use super::lines::LONGEST;
use super::skips::{Reason, Skips};

/// A recording that can't be used.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingError {
    /// The file as the caller named it.
    pub file: String,
    /// The line it is about, counted from 1, where there is one.
    pub line: Option<u64>,
    /// What is wrong.
    pub problem: Problem,
}

/// What is wrong with a recording.
#[derive(Clone, Debug, PartialEq)]
pub enum Problem {
    /// Not found, a folder, no permission, a failing disk: what the system says.
    NotReadable(String),
    /// No line at all, or blank and comment lines only.
    Empty,
    /// The header holds bytes that are no text.
    Binary,
    /// The gzip stream breaks off after this many usable rows.
    GzipTruncated(usize),
    /// The gzip stream is damaged after this many usable rows.
    GzipCorrupt(usize),
    /// The line is over 64 kB.
    LineTooLong,
    /// Over this many rows.
    TooManyRows(usize),
    /// This stands between the names of the header instead of a comma.
    Separator(char),
    /// The first line holds numbers.
    NoHeader,
    /// A column isn't there.
    MissingColumn {
        /// The column that is missing.
        wanted: String,
        /// The columns that are there.
        there: Vec<String>,
        /// The name among them that is nearest to the one that is missing.
        nearest: Option<String>,
    },
    /// The three axes differ in unit.
    MixedUnits(Vec<String>),
    /// A column of time or acceleration whose unit isn't known.
    UnknownUnit {
        /// The column.
        column: String,
        /// The names that would do.
        known: Vec<String>,
    },
    /// Two columns give the same quantity.
    DuplicateColumn(String, String),
    /// Counts whose length at standstill is near no usual number of counts per g.
    UnknownScale(f64),
    /// The length at standstill isn't near 1 g.
    WrongUnit {
        /// Median length at standstill, g by the header's unit.
        norm_g: f64,
        /// What to do about it.
        advice: String,
    },
    /// Too few usable rows.
    TooFewRows {
        /// How many there are.
        rows: usize,
        /// What was left out.
        skips: Box<Skips>,
    },
    /// More rows were left out than kept.
    MostlySkipped {
        /// How many were kept.
        rows: usize,
        /// What was left out.
        skips: Box<Skips>,
    },
    /// Under 25 or over 10 000 samples per second by the header's unit of time.
    Rate {
        /// Samples per second, from the median difference of time.
        hz: f64,
        /// The header that would fit, if one would.
        fits: Option<&'static str>,
    },
}

impl RecordingError {
    /// About the file as a whole.
    pub fn of_file(file: &str, problem: Problem) -> Self {
        Self {
            file: file.to_owned(),
            line: None,
            problem,
        }
    }

    /// About one line.
    pub fn of_line(file: &str, line: u64, problem: Problem) -> Self {
        Self {
            file: file.to_owned(),
            line: Some(line),
            problem,
        }
    }
}

impl std::error::Error for RecordingError {}

impl fmt::Display for RecordingError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}", self.file)?;
        if let Some(line) = self.line {
            write!(f, ", line {line}")?;
        }
        write!(f, ": {}", self.problem)
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::NotReadable(why) => write!(f, "can't be read ({why}); check the path"),
            Self::Empty => f.write_str("holds no line; give a CSV file with a header"),
            Self::Binary => f.write_str(
                "is no text; give a CSV file of a sensor, or a log of a bus as candump -L or an \
                 ASC logger writes it, plain or gzip",
            ),
            Self::GzipTruncated(rows) => write!(
                f,
                "the gzip stream breaks off after {rows} good rows; copy the file again, or \
                 recover the rows with `gunzip -c` and give the plain CSV"
            ),
            Self::GzipCorrupt(rows) => {
                write!(
                    f,
                    "the gzip stream is damaged after {rows} good rows; copy the file again"
                )
            }
            Self::LineTooLong => {
                write!(
                    f,
                    "is over {LONGEST} bytes long; give a CSV file with one sample a line"
                )
            }
            Self::TooManyRows(most) => write!(f, "more than {most} rows; cut the file in parts"),
            Self::Separator(separator) => write!(
                f,
                "the columns are separated by '{}'; use commas, and points in numbers",
                separator.escape_default()
            ),
            Self::NoHeader => f.write_str(
                "holds numbers where the header should be; put a first line such as \
                 `time_s,ax_g,ay_g,az_g`",
            ),
            _ => self.about_columns(f),
        }
    }
}

impl Problem {
    fn about_columns(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::MissingColumn {
                wanted,
                there,
                nearest,
            } => {
                write!(f, "no column {wanted}; there is {}", listed(there))?;
                match nearest {
                    Some(name) => write!(f, "; rename `{name}` if it is meant"),
                    None => f.write_str("; name it in the header"),
                }
            }
            Self::MixedUnits(names) => {
                write!(
                    f,
                    "the axes differ in unit ({}); give all in one",
                    listed(names)
                )
            }
            Self::UnknownUnit { column, known } => {
                write!(f, "`{column}` has no unit; name it {}", known.join(" or "))
            }
            Self::DuplicateColumn(one, other) => {
                write!(
                    f,
                    "`{one}` and `{other}` give the same quantity; take one of them out"
                )
            }
            _ => self.about_values(f),
        }
    }

    fn about_values(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::UnknownScale(norm) => write!(
                f,
                "the length at standstill is {norm:.1} counts, near no usual counts per g; \
                 use --lsb-per-g"
            ),
            Self::WrongUnit { norm_g, advice } => {
                write!(
                    f,
                    "the length at standstill is {norm_g:.4} g instead of 1 g; {advice}"
                )
            }
            Self::TooFewRows { rows, skips } => {
                write!(
                    f,
                    "only {rows} usable rows ({skips}); at least 50 are needed"
                )
            }
            Self::MostlySkipped { rows, skips } => {
                write!(f, "more rows skipped than the {rows} kept ({skips}); mend ")?;
                let worst = skips.worst().map(|(reason, _)| reason);
                f.write_str(match worst {
                    Some(Reason::BackwardTime | Reason::ForwardJump | Reason::RepeatedTime) => {
                        "the time column"
                    }
                    Some(Reason::CellCount) => {
                        "the number of cells in each row, with points and no commas in numbers"
                    }
                    Some(Reason::OverRange) => "the unit of those columns",
                    Some(Reason::AllZero) => "the logger: the sensor did not answer",
                    _ => "those cells",
                })
            }
            Self::Rate { hz, fits } => {
                write!(f, "{hz:.3} samples per second is outside 25 to 10000; ")?;
                match fits {
                    Some(name) => write!(f, "the time looks as if it were `{name}`"),
                    None => f.write_str("check the time column, or record faster"),
                }
            }
            _ => Ok(()),
        }
    }
}

fn listed(names: &[String]) -> String {
    const MOST: usize = 12;
    let quoted: Vec<String> = names
        .iter()
        .take(MOST)
        .map(|name| format!("`{name}`"))
        .collect();
    let more = names.len().saturating_sub(MOST);
    match (quoted.is_empty(), more) {
        (true, _) => "none".to_owned(),
        (false, 0) => quoted.join(", "),
        (false, more) => format!("{} and {more} more", quoted.join(", ")),
    }
}
