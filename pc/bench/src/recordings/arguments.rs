//! What is replayed, and how.
//!
//! In: files, and the words of the command line, through `clap`. Out: [`Arguments`]. What only
//! makes sense together with the files themselves (their number, their names) is checked by
//! [`Arguments::check`].

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use output::write::Existing;

use super::calibration_file;
use super::error::{FileError, Problem};

/// Which chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// One pole, newest sample, 110 warnings above 0.40 deg within 600 s ask for a stop
    Paper,
    /// Second-order Butterworth at 10 Hz, aligned in time, threshold by the uncertainty
    Product,
}

/// The longest delay of a gyroscope that is made up for, ms: eight periods at 2 000 rows a second
/// (`tilt::motion` takes sixteen).
const LONGEST_DELAY_MS: f64 = 4.0;

/// What to calibrate from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CalibrateFrom {
    /// Standstill poses in all directions, gravity being 1 g long in each
    Poses,
    /// The recording's reference columns at its plateaus
    Reference,
    /// Nothing: the sensor is taken as its data sheet has it
    Nominal,
}

/// How to replay recordings.
#[derive(Clone, Debug, Default, Args)]
// The options of logs stand beside these in one command, and a group has the name of its type.
#[group(skip)]
pub struct Options {
    /// Use the calibration in this file instead of calibrating from the recordings
    #[arg(long, value_name = "FILE", conflicts_with = "from")]
    pub calibration: Option<PathBuf>,
    /// Keep the calibration in this file
    #[arg(long, value_name = "FILE")]
    pub save_calibration: Option<PathBuf>,
    /// Folder for report.html and report.json [default: plumb-report]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Signal chain and cross-check [default: product]
    #[arg(long, value_enum)]
    pub mode: Option<Mode>,
    /// Counts per g of `_lsb` columns; found from the standstills when not given
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub lsb_per_g: Option<f64>,
    /// How late the gyroscope is by its own filter, ms; the vertical makes up for it [default: 0]
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    pub rate_delay: Option<f64>,
}

/// What to replay and how.
#[derive(Clone, Debug, Default)]
pub struct Arguments {
    /// The recordings, one for each channel.
    pub files: Vec<PathBuf>,
    /// What to calibrate from; from the reference columns where there are any when not given.
    pub from: Option<CalibrateFrom>,
    /// Print JSON on the standard output instead of the tables.
    pub json: bool,
    /// What becomes of a file where the calibration is to be saved.
    pub existing: Existing,
    /// The rest.
    pub options: Options,
}

impl Options {
    /// The first option that was given, for a sentence.
    pub fn given(&self) -> Option<&'static str> {
        let options = [
            (self.calibration.is_some(), "--calibration"),
            (self.save_calibration.is_some(), "--save-calibration"),
            (self.out.is_some(), "--out"),
            (self.mode.is_some(), "--mode"),
            (self.lsb_per_g.is_some(), "--lsb-per-g"),
            (self.rate_delay.is_some(), "--rate-delay"),
        ];
        let given = options.into_iter().find(|(given, _)| *given);
        given.map(|(_, name)| name)
    }
}

impl Arguments {
    /// Where the report goes.
    pub fn folder(&self) -> &Path {
        self.options
            .out
            .as_deref()
            .unwrap_or(Path::new("plumb-report"))
    }

    /// Refuses what can't be meant, before any file is read.
    pub fn check(&self) -> Result<(), FileError> {
        let refuse =
            |file: &Path, problem| Err(FileError::of_file(file.display().to_string(), problem));
        if let Some(third) = self.files.get(2) {
            return refuse(third, Problem::TooManyFiles);
        }
        if let (Some(counts), Some(file)) = (self.options.lsb_per_g, self.files.first())
            && !(counts.is_finite() && counts > 0.0)
        {
            return refuse(file, Problem::LsbPerG(counts));
        }
        if let (Some(delay_ms), Some(file)) = (self.options.rate_delay, self.files.first())
            && !(0.0..=LONGEST_DELAY_MS).contains(&delay_ms)
        {
            return refuse(file, Problem::RateDelay(delay_ms));
        }
        if let [one, other] = self.files.as_slice()
            && is_same(one, other)
        {
            return refuse(other, Problem::SameFile);
        }
        let mut inputs = self.files.iter().chain(&self.options.calibration);
        let Some(save) = &self.options.save_calibration else {
            return Ok(());
        };
        if inputs.any(|input| is_same(input, save)) {
            return refuse(save, Problem::SaveOverInput);
        }
        calibration_file::check_place(save, self.existing)
    }
}

/// True when both name one file that exists, links followed, or are the same words.
fn is_same(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => one == other,
    }
}
