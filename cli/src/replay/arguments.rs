//! What `plumb replay` is told on the command line.
//!
//! In: the words of the command line, through `clap`. Out: [`Arguments`]. What only makes sense
//! together with the files themselves (their number, their names) is checked by
//! [`Arguments::check`].

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::calibration_file;
use super::error::ReplayError;
use crate::playback;
use bus_logs::Moment;

/// Which chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// One pole, newest sample, 110 warnings above 0.40 deg within 600 s ask for a stop
    Paper,
    /// Second-order Butterworth at 10 Hz, aligned in time, threshold by the uncertainty
    Product,
}

/// What to calibrate from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CalibrateFrom {
    /// Standstill poses in all directions, gravity being 1 g long in each
    Poses,
    /// The recording's reference columns at its plateaus
    Reference,
}

/// What `--from` can mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum From {
    /// Where the calibration of a recording comes from.
    Calibrate(CalibrateFrom),
    /// Where a log begins.
    Time(Moment),
}

impl std::str::FromStr for From {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let words = <CalibrateFrom as ValueEnum>::from_str(text, false);
        words.map(Self::Calibrate).or_else(|_| {
            let time = text.parse().map(Self::Time);
            time.map_err(|why| format!("poses or reference for a recording; for a log {why}"))
        })
    }
}

/// What to replay and how.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Recordings of one or two sensors (CSV), or logs of a bus: candump -L, ASC, folders, - for
    /// standard input; plain or gzip
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Use the calibration in this file instead of calibrating from the recordings
    #[arg(long, value_name = "FILE", conflicts_with = "from")]
    pub calibration: Option<PathBuf>,
    /// Keep the calibration in this file
    #[arg(long, value_name = "FILE")]
    pub save_calibration: Option<PathBuf>,
    /// Folder for report.html and report.json [default: plumb-report]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print JSON on stdout instead of the tables
    #[arg(long)]
    pub json: bool,
    /// Signal chain and cross-check [default: product]
    #[arg(long, value_enum)]
    pub mode: Option<Mode>,
    /// Counts per g of `_lsb` columns; found from the standstills when not given
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub lsb_per_g: Option<f64>,
    /// Of recordings: calibrate from poses or reference, from the reference columns where there
    /// are any when not given. Of logs: begin at this time, seconds since the first frame or a
    /// date as 2026-11-22T12:30:00
    #[arg(long, value_name = "poses|reference|TIME")]
    pub from: Option<From>,
    /// What only logs of a bus have.
    #[command(flatten)]
    pub log: playback::Options,
}

impl Arguments {
    /// Where the report goes.
    pub fn folder(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new("plumb-report"))
    }

    /// What a recording is to be calibrated from.
    pub fn calibrate_from(&self) -> Option<CalibrateFrom> {
        match self.from {
            Some(From::Calibrate(from)) => Some(from),
            _ => None,
        }
    }

    /// Where a log is to begin.
    pub fn begin(&self) -> Option<Moment> {
        match self.from {
            Some(From::Time(moment)) => Some(moment),
            _ => None,
        }
    }

    /// The first option that only recordings have, for a sentence.
    pub fn given(&self) -> Option<&'static str> {
        let options = [
            (self.calibration.is_some(), "--calibration"),
            (self.save_calibration.is_some(), "--save-calibration"),
            (self.out.is_some(), "--out"),
            (self.mode.is_some(), "--mode"),
            (self.lsb_per_g.is_some(), "--lsb-per-g"),
            (self.calibrate_from().is_some(), "--from poses or reference"),
        ];
        let given = options.into_iter().find(|(given, _)| *given);
        given.map(|(_, name)| name)
    }

    /// Refuses what can't be meant, before any file is read.
    pub fn check(&self) -> Result<(), ReplayError> {
        if let Some(third) = self.files.get(2) {
            return Err(ReplayError::TooManyFiles(third.display().to_string()));
        }
        if let Some(counts) = self.lsb_per_g
            && !(counts.is_finite() && counts > 0.0)
        {
            let file = self.files.first().map(|file| file.display().to_string());
            return Err(ReplayError::LsbPerG(file.unwrap_or_default(), counts));
        }
        if let [one, other] = self.files.as_slice()
            && is_same(one, other)
        {
            return Err(ReplayError::SameFile(other.display().to_string()));
        }
        let inputs = || self.files.iter().chain(&self.calibration);
        if let Some(save) = &self.save_calibration
            && inputs().any(|input| is_same(input, save))
        {
            return Err(ReplayError::SaveOverInput(save.display().to_string()));
        }
        if let Some(save) = &self.save_calibration {
            calibration_file::check_place(save)?;
        }
        Ok(())
    }
}

/// True when both name one file that exists, links followed, or are the same words.
fn is_same(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => one == other,
    }
}
