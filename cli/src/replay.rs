//! `plumb replay`: logs of a bus summed up or played, recordings of sensors put through the chain.
//!
//! In: files. Out: what `bus_report::playback` makes of logs, or `bench::recordings` of recordings.
//! Which of both they are is read from the files; options of the other kind are refused. A file
//! that can't be opened is left to those who read it.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, ValueEnum as _};

use bench::recordings::{self, CalibrateFrom};
use bus_logs::Moment;
use bus_report::playback::{self, PlaybackError};
use output::progress::Progress;
use output::write::Existing;

/// What only one of both kinds is told by.
const RECORDINGS: &str = "recordings of sensors (CSV)";
const LOGS: &str = "logs of a bus";

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
        let words = CalibrateFrom::from_str(text, false);
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
    /// What only recordings have.
    #[command(flatten)]
    pub recordings: recordings::Options,
    /// Print JSON on stdout instead of the tables
    #[arg(long)]
    pub json: bool,
    /// Replace the file of --export or --save-calibration if it is there already
    #[arg(long)]
    pub force: bool,
    /// Of recordings: calibrate from poses or reference, from the reference columns where there
    /// are any when not given. Of logs: begin at this time, seconds since the first frame or a
    /// date as 2026-11-22T12:30:00
    #[arg(long, value_name = "poses|reference|TIME")]
    pub from: Option<From>,
    /// What only logs of a bus have.
    #[command(flatten)]
    pub log: playback::Options,
}

/// Why nothing was replayed, or not all of it.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The first file is a recording, the second one the log of a bus.
    #[error("{0} is a recording of a sensor and {1} the log of a bus; replay one kind at a time")]
    BothKinds(String, String),
    /// This option doesn't go with this file, and what it goes with.
    #[error("{0} is for {2}, which {1} is not; leave it away")]
    WrongKind(&'static str, String, &'static str),
    /// A log of a bus that can't be played back.
    #[error("{0}")]
    Log(#[from] PlaybackError),
    /// Recordings that can't be replayed.
    #[error("{0}")]
    Recordings(#[from] bench::Error),
}

/// Replays; exit status 0 whatever the verdicts are, since finding a fault is what it is for.
///
/// Errors: see [`ReplayError`].
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, ReplayError> {
    let Arguments { files, json, .. } = arguments;
    let existing = Existing::of(arguments.force);
    if are_logs(arguments)? {
        let from = arguments.begin();
        let asked = playback::Asked {
            from,
            json: *json,
            existing,
        };
        return Ok(playback::run(files, &arguments.log, asked, progress)?);
    }
    let arguments = recordings::Arguments {
        files: files.clone(),
        from: arguments.calibrate_from(),
        json: *json,
        existing,
        options: arguments.recordings.clone(),
    };
    Ok(recordings::run(&arguments, progress)?)
}

impl Arguments {
    /// What recordings are to be calibrated from.
    fn calibrate_from(&self) -> Option<CalibrateFrom> {
        match self.from {
            Some(From::Calibrate(from)) => Some(from),
            _ => None,
        }
    }

    /// Where a log is to begin.
    fn begin(&self) -> Option<Moment> {
        match self.from {
            Some(From::Time(moment)) => Some(moment),
            _ => None,
        }
    }

    /// The first option that only recordings have, for a sentence.
    fn only_of_recordings(&self) -> Option<&'static str> {
        let from = || self.calibrate_from().map(|_| "--from poses or reference");
        self.recordings.given().or_else(from)
    }

    /// The first option that only logs have, for a sentence.
    fn only_of_logs(&self) -> Option<&'static str> {
        let from = || self.begin().map(|_| "--from with a time");
        self.log.given().or_else(from)
    }
}

/// True for logs of a bus; options of the other kind are refused.
pub fn are_logs(arguments: &Arguments) -> Result<bool, ReplayError> {
    let name = |path: &Path| path.display().to_string();
    for file in arguments.files.iter().filter(|file| file.is_file()) {
        if let Ok(Some(why)) = bus_logs::refusal(file) {
            return Err(ReplayError::Log(why.into()));
        }
    }
    let log = arguments.files.iter().find(|file| is_log(file));
    let other = arguments.files.iter().find(|file| !is_log(file));
    let first = arguments.files.first().map(|file| name(file));
    let refuse = |option, kind| ReplayError::WrongKind(option, first.unwrap_or_default(), kind);
    match (log, other) {
        (Some(log), Some(other)) if is_recording(other) => {
            Err(ReplayError::BothKinds(name(other), name(log)))
        }
        (Some(_), _) => arguments
            .only_of_recordings()
            .map_or(Ok(true), |option| Err(refuse(option, RECORDINGS))),
        // Of what can't be opened nobody can tell what it is.
        (None, _) if !arguments.files.iter().all(|file| can_be_opened(file)) => Ok(false),
        (None, _) => arguments
            .only_of_logs()
            .map_or(Ok(false), |option| Err(refuse(option, LOGS))),
    }
}

/// Folders and standard input hold logs; a file is looked into.
fn is_log(path: &Path) -> bool {
    let is_folder = path.is_dir();
    let can_be_opened_again = path.is_file();
    // What can't be opened twice is no recording either.
    is_folder || !can_be_opened_again && (path.exists() || path.as_os_str() == "-") || {
        can_be_opened_again && matches!(bus_logs::kind_of(path), Ok(Some(_)))
    }
}

/// True unless opening it fails; a pipe is not opened, which would wait for its writer.
fn can_be_opened(path: &Path) -> bool {
    match path.is_file() {
        true => File::open(path).is_ok(),
        false => path.exists() || path.as_os_str() == "-",
    }
}

fn is_recording(path: &Path) -> bool {
    path.is_file() && matches!(bus_logs::kind_of(path), Ok(None))
}
