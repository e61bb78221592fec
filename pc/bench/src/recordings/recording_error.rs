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
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// Not found, a folder, no permission, a failing disk: what the system says.
    #[error("can't be read ({0}); check the path")]
    NotReadable(String),
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
    #[error("is over {LONGEST} bytes long; give a CSV file with one sample a line")]
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
