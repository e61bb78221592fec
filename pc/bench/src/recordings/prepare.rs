//! From files to channels that are ready to be played: read, placed in time, calibrated.
//!
//! In: [`Arguments`]. Out: one [`Prepared`] per recording, the second turned into the frame of
//! the first. Two recordings are taken to share a clock, that of their time columns.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use tilt::uncertainty::Uncertainty;

use super::alignment::{Aligned, align_robustly};
use super::arguments::{Arguments, CalibrateFrom};
use super::calibrate::{Fit, calibrate_from_poses, calibrate_from_reference, overlapping};
use super::calibration_file::{self, Channel, Method};
use super::columns::AccelUnit;
use super::error::{CalibrateError, FileError, Problem};
use super::recording::{Options, Recording, Row};
use super::segments::{self, Segment, Standstill};
use super::steady::{Steady, steady};
use super::windows::{norm, quantile};
use crate::report::replay_data::{CalibrationKind, ReplayCalibration};
use output::printable;
use output::progress::Progress;

/// A recording with everything that its chain needs.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// The samples.
    pub recording: Recording,
    /// Where they stand still.
    pub standstill: Standstill,
    /// From the first row of all recordings to the first of this one, microseconds.
    pub offset_us: u64,
    /// The calibration.
    pub record: Channel,
    /// How it was come by, for the report.
    pub how: ReplayCalibration,
    /// The rows on a steady clock, where their own times jitter.
    pub steady: Option<Steady>,
    /// How late its gyroscope is, s.
    pub rate_delay_s: f64,
}

impl Prepared {
    /// The rows that go into the chain.
    pub fn fed(&self) -> &[Row] {
        match &self.steady {
            Some(steady) => &steady.rows,
            None => &self.recording.rows,
        }
    }

    /// Time between them, microseconds.
    pub fn period_us(&self) -> u64 {
        match &self.steady {
            Some(steady) => steady.period_us,
            None => self.recording.period_us,
        }
    }

    /// Gaps after which the chain starts anew.
    pub fn gaps(&self) -> u64 {
        match &self.steady {
            Some(steady) => steady.gaps,
            None => self.recording.gaps.rows,
        }
    }
}

/// The channels, and what the reader should know of how they were calibrated.
pub type Ready = (Vec<Prepared>, Vec<String>);

/// Reads and calibrates.
pub fn prepare(arguments: &Arguments, progress: &Progress) -> Result<Ready, FileError> {
    arguments.check()?;
    let kept = match &arguments.options.calibration {
        Some(path) => Some(calibration_file::load(path, arguments.files.len())?),
        None => None,
    };
    let mut recordings = Vec::new();
    for path in &arguments.files {
        recordings.push(open(path, arguments.options.lsb_per_g, progress)?);
    }
    let offsets = offsets(&recordings)?;
    let standstills: Vec<Standstill> = recordings.iter().map(find).collect();
    let (calibrated, mut notes) = match kept {
        Some(records) => from_file(arguments, records, &recordings, &standstills)?,
        None => fitted(arguments.from, &recordings, &standstills, &offsets)?,
    };
    if arguments.options.lsb_per_g.is_some() {
        notes.extend(recordings.iter().zip(1..).filter_map(about_unused_scale));
    }
    let parts = recordings.into_iter().zip(standstills).zip(offsets);
    let channels = parts
        .zip(calibrated)
        .map(
            |(((recording, standstill), offset_us), (record, how))| Prepared {
                steady: steady(&recording),
                rate_delay_s: arguments.options.rate_delay.unwrap_or(0.0) / 1000.0,
                recording,
                standstill,
                offset_us,
                record,
                how,
            },
        )
        .collect();
    Ok((channels, notes))
}

fn open(path: &Path, lsb_per_g: Option<f64>, progress: &Progress) -> Result<Recording, FileError> {
    let bytes = fs::metadata(path).map_or(0, |about| about.len());
    let task = progress.task("Reading", bytes);
    let options = Options { lsb_per_g };
    Recording::open(path, options, Some(Arc::new(task)))
}

fn find(recording: &Recording) -> Standstill {
    segments::find(recording, segments::Options::for_recording(recording))
}

/// Where each recording begins on the common clock, from the earliest of them; an error when two
/// recordings have no time in common.
fn offsets(recordings: &[Recording]) -> Result<Vec<u64>, FileError> {
    let ends = |r: &Recording| [r.start_us, r.start_us.saturating_add_unsigned(length_us(r))];
    if let [one, other] = recordings {
        let ([from, to], [other_from, other_to]) = (ends(one), ends(other));
        if from.max(other_from) >= to.min(other_to) {
            let seconds = |ends: [i64; 2]| ends.map(|us| us as f64 / 1e6);
            let problem = Problem::NoOverlap {
                own_s: seconds([other_from, other_to]),
                one: one.file.clone(),
                one_s: seconds([from, to]),
            };
            return Err(FileError::of_file(&*other.file, problem));
        }
    }
    let earliest = recordings.iter().map(|r| r.start_us).min().unwrap_or(0);
    let from_earliest = |r: &Recording| r.start_us.abs_diff(earliest);
    Ok(recordings.iter().map(from_earliest).collect())
}

fn length_us(recording: &Recording) -> u64 {
    recording.rows.last().map_or(0, |row| row.time_us)
}

type Calibrated = (Channel, ReplayCalibration);

fn from_file(
    arguments: &Arguments,
    records: Vec<Channel>,
    recordings: &[Recording],
    standstills: &[Standstill],
) -> Result<(Vec<Calibrated>, Vec<String>), FileError> {
    let path = arguments.options.calibration.as_deref();
    let path = path.map_or_else(String::new, |path| path.display().to_string());
    let mut notes = Vec::new();
    let channels = records.iter().zip(recordings).zip(standstills).zip(1..);
    for (((record, recording), standstill), number) in channels {
        let (made_for, found) = (record.numbers_per_g, recording.scale.per_g);
        // The file keeps nine decimals.
        if (made_for - found).abs() > 1e-6 * found {
            let problem = Problem::OtherScale {
                recording: recording.file.clone(),
                made_for,
                found,
            };
            return Err(FileError::of_file(path, problem));
        }
        let source = printable(&record.source);
        notes.push(format!("Channel {number}: calibrated on {source}."));
        if let Some(length_g) = length_g(record, standstill) {
            notes.extend(judge_length(&path, recording, length_g, number)?);
        }
    }
    let how = |record: &Channel| ReplayCalibration {
        kind: CalibrationKind::File,
        poses: None,
        residual_mg: Some(record.norm_residual_mg),
        residual_deg: record.angle_residual_deg,
        condition: None,
    };
    let calibrated = records.into_iter().map(|record| {
        let how = how(&record);
        (record, how)
    });
    Ok((calibrated.collect(), notes))
}

/// Further from 1 g than this at standstill, g, a kept calibration belongs to another sensor.
const OTHER_SENSOR_G: f64 = 0.05;

/// Further from 1 g than this at standstill, g, a kept calibration is worth a word.
const DOUBTFUL_G: f64 = 0.01;

/// Median length over the standstills by a kept calibration, g. One repeated code is no
/// standstill but a sensor that has died, unless there is nothing else.
fn length_g(record: &Channel, found: &Standstill) -> Option<f64> {
    let lengths = |alive: bool| {
        let counts = |segment: &&Segment| !alive || norm(segment.std_g) > DEAD_G;
        let segments = found.segments.iter().filter(counts);
        quantile(
            segments.map(|s| norm(record.apply(s.mean_g))).collect(),
            0.5,
        )
    };
    lengths(true).or_else(|| lengths(false))
}

/// Less scatter than this, g, is the rounding of sums over one repeated code.
const DEAD_G: f64 = 1e-5;

fn judge_length(
    calibration: &str,
    recording: &Recording,
    length_g: f64,
    number: u8,
) -> Result<Option<String>, FileError> {
    let off_g = (length_g - 1.0).abs();
    if off_g > OTHER_SENSOR_G {
        let recording = recording.file.clone();
        let problem = Problem::OtherSensor {
            recording,
            length_g,
        };
        return Err(FileError::of_file(calibration, problem));
    }
    Ok((off_g > DOUBTFUL_G).then(|| {
        format!(
            "Channel {number}: by its calibration file the sensor reads {length_g:.3} g at \
             standstill; the calibration is worth {:.0} mg at best.",
            1000.0 * off_g
        )
    }))
}

fn about_unused_scale((recording, number): (&Recording, u8)) -> Option<String> {
    let unit = match recording.columns.unit {
        AccelUnit::Lsb => return None,
        AccelUnit::G => "g",
        AccelUnit::MetrePerSecond2 => "m/s^2",
    };
    Some(format!(
        "Channel {number}: --lsb-per-g was not used, since its columns are in {unit} and not in \
         counts."
    ))
}

/// Calibrates each recording from itself and turns the second onto the first.
fn fitted(
    from: Option<CalibrateFrom>,
    recordings: &[Recording],
    standstills: &[Standstill],
    offsets: &[u64],
) -> Result<(Vec<Calibrated>, Vec<String>), FileError> {
    let mut fits = Vec::new();
    for (recording, found) in recordings.iter().zip(standstills) {
        fits.push(fit(from, recording, found)?);
    }
    let mut notes = Vec::new();
    let mut left_deg = 0.0;
    if let ([one, other], [first, second]) = (recordings, fits.as_mut_slice()) {
        let shared = shared(standstills, offsets);
        let aligned = align_robustly(second, first, &shared);
        match (aligned, second.method) {
            (Ok(aligned), _) => {
                check_motion(one, other, &aligned)?;
                notes.push(about_alignment(&aligned));
                left_deg = aligned.left_deg;
                *second = aligned_with_residual(second, aligned.fit);
            }
            // Both are in the reference's frame already.
            (Err(why), Method::Reference) => notes.push(format!(
                "Channel 2 was not turned onto channel 1, beyond what the reference columns do: \
                 of what stands still in both, {why}."
            )),
            (Err(why), _) => return Err(FileError::of_file(&*other.file, Problem::Align(why))),
        }
    }
    let mut calibrated = Vec::new();
    for ((fit, left), (recording, found)) in fits
        .iter()
        .zip([0.0, left_deg])
        .zip(recordings.iter().zip(standstills))
    {
        calibrated.push(record(fit, left, recording, found)?);
    }
    Ok((calibrated, notes))
}

fn fit(
    from: Option<CalibrateFrom>,
    recording: &Recording,
    found: &Standstill,
) -> Result<Fit, FileError> {
    let refuse = |problem| FileError::of_file(&*recording.file, problem);
    let fitted = match from {
        Some(CalibrateFrom::Reference) if !recording.has_reference() => {
            return Err(refuse(Problem::NoReference));
        }
        Some(CalibrateFrom::Nominal) => return Ok(Fit::nominal(&found.segments)),
        Some(CalibrateFrom::Poses) => calibrate_from_poses(&found.segments),
        None if !recording.has_reference() => calibrate_from_poses(&found.segments),
        _ => calibrate_from_reference(&found.segments),
    };
    fitted.map_err(|why| refuse(Problem::Calibrate(why)))
}

/// Mean readings over the standstills that both recordings show at the same time.
fn shared(standstills: &[Standstill], offsets: &[u64]) -> Vec<super::alignment::Pair> {
    let placed = |found: &Standstill, offset: u64| -> Vec<Segment> {
        let later = |segment: &Segment| Segment {
            start_us: segment.start_us.saturating_add(offset),
            end_us: segment.end_us.saturating_add(offset),
            ..*segment
        };
        found.segments.iter().map(later).collect()
    };
    match (standstills, offsets) {
        ([one, other], [first, second]) => {
            overlapping(&placed(other, *second), &placed(one, *first))
        }
        _ => Vec::new(),
    }
}

/// Further apart than this at most of their common standstills, two recordings show two motions.
const OTHER_MOTION_DEG: f64 = 5.0;

fn check_motion(one: &Recording, other: &Recording, aligned: &Aligned) -> Result<(), FileError> {
    if aligned.median_deg <= OTHER_MOTION_DEG {
        return Ok(());
    }
    let problem = Problem::OtherMotion {
        other: one.file.clone(),
        left_deg: aligned.median_deg,
    };
    Err(FileError::of_file(&*other.file, problem))
}

/// The turned fit with the residual to the reference that it had before; the angle left between
/// the channels is another matter.
fn aligned_with_residual(before: &Fit, turned: Fit) -> Fit {
    Fit {
        angle_residual_deg: before.angle_residual_deg,
        ..turned
    }
}

fn about_alignment(aligned: &Aligned) -> String {
    let Aligned {
        used,
        left_out,
        left_deg,
        ..
    } = aligned;
    let left_out = match left_out {
        0 => String::new(),
        some => format!(" {some} more contradict them and were left out."),
    };
    format!(
        "Channel 2 was turned onto channel 1 by {used} standstills that both show at the same \
         time; {left_deg:.3} deg rms are left.{left_out}"
    )
}

fn record(
    fit: &Fit,
    left_deg: f64,
    recording: &Recording,
    found: &Standstill,
) -> Result<Calibrated, FileError> {
    let implausible = || {
        let why = CalibrateError::Implausible(tilt::calibration::FitError::Implausible);
        FileError::of_file(&*recording.file, Problem::Calibrate(why))
    };
    let mut record = fit.channel(recording, found).ok_or_else(implausible)?;
    let residual = Uncertainty(record.budget.residual_steps);
    let left = Uncertainty::from_degrees(left_deg);
    record.budget.residual_steps = residual.combined_with(left).0;
    // What could not be kept in a file must not be played either.
    if record.check().is_err() {
        return Err(implausible());
    }
    let how = ReplayCalibration {
        kind: match fit.method {
            Method::Poses => CalibrationKind::Poses,
            Method::Reference | Method::Motor => CalibrationKind::Reference,
            Method::Nominal => CalibrationKind::Nominal,
        },
        poses: Some(fit.poses as u64),
        residual_mg: Some(fit.norm_residual_mg),
        residual_deg: fit.angle_residual_deg,
        condition: Some(fit.condition),
    };
    Ok((record, how))
}
