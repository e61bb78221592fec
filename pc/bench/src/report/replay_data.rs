//! The report of `plumb replay`: what real recordings gave.
//!
//! In: what the replay measured. Out: plain structs that serde writes, a format of its
//! own with its own version; each field is described in `docs/report-format.md`. Series are
//! bounded bins, so a long recording gives no larger a report than a short one. Times are seconds
//! from the first good row of channel 1, angles are degrees.

use serde::Serialize;

use super::data::{Axis, Mode};
use output::series::Bin;

/// Name of the format, the field `format`. A summary of logs of a bus bears it, too, in a layout
/// of its own; `docs/report-format.md` describes how to tell them apart.
pub const REPLAY_FORMAT: &str = "plumb-replay";
/// Version of the format. It rises when a field changes its meaning or goes away.
pub const REPLAY_VERSION: u32 = 1;

/// Rows that were left out for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SkippedRows {
    /// Why, in words.
    pub reason: String,
    /// How many.
    pub count: u64,
    /// Line of the first one, from 1.
    pub first_line: u64,
}

/// Where a calibration came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CalibrationKind {
    /// Standstill poses, the norm of each being 1 g.
    Poses,
    /// The recording's own reference columns.
    Reference,
    /// A calibration file.
    File,
    /// None.
    Nominal,
}

/// How one channel was calibrated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReplayCalibration {
    /// Where it came from.
    pub kind: CalibrationKind,
    /// Standstill poses that were used.
    pub poses: Option<u64>,
    /// Residual of the fit, mg rms.
    pub residual_mg: Option<f64>,
    /// Residual of the fit against the reference direction, deg rms.
    pub residual_deg: Option<f64>,
    /// Condition figure of the fit, no unit.
    pub condition: Option<f64>,
}

/// Error of a slope against the recording's reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// Number of compared values.
    pub compared: u64,
    /// Mean error.
    pub mean_deg: Option<f64>,
    /// Root mean square error.
    pub rmse_deg: Option<f64>,
    /// Greatest absolute error.
    pub max_deg: Option<f64>,
}

/// What a channel reports of its uncertainty at standstill, and how much it scatters there.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StandstillUncertainty {
    /// Readings at standstill.
    pub readings: u64,
    /// Standard uncertainty that was reported with them, root mean square.
    pub uncertainty_deg: f64,
    /// The part of it that is noise, by the budget.
    pub noise_deg: f64,
    /// Standard deviation about the mean of each standstill, as observed.
    pub scatter_deg: f64,
}

/// One slope of one channel over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlopeSeries {
    /// Which slope.
    pub axis: Axis,
    /// `[time s, least, greatest]` of the angle.
    pub angle: Vec<Bin>,
    /// `[time s, least, greatest]` of the standard uncertainty, deg.
    pub uncertainty: Vec<Bin>,
    /// `[time s, least, greatest]` of the reference angle; empty without reference columns.
    pub reference: Vec<Bin>,
    /// Error against the reference at the instants that the angles belong to, over the whole
    /// recording, when there is one.
    pub accuracy: Option<Accuracy>,
    /// Error of the mean angles at the plateaus against the reference, when there is one.
    pub accuracy_at_plateaus: Option<Accuracy>,
    /// Uncertainty and scatter at standstill, when it stood still.
    pub standstill: Option<StandstillUncertainty>,
}

/// The vertical by gyroscope and accelerometer at each row, against the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MovingVertical {
    /// Rows with a vertical and a reference, without those that do not count.
    pub compared: u64,
    /// Rows with a reference and without a vertical.
    pub without: u64,
    /// Angle between the vertical and the reference, root mean square.
    pub rms_deg: Option<f64>,
    /// The greatest.
    pub max_deg: Option<f64>,
    /// Standard uncertainty stated with the verticals, in one direction, root mean square.
    pub uncertainty_deg: Option<f64>,
    /// Errors in one direction within twice the standard uncertainty stated with them.
    pub within_2u_percent: Option<f64>,
    /// The same within three times.
    pub within_3u_percent: Option<f64>,
}

/// Mean angles while the sensor stood still.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plateau {
    /// Begin, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Mean slope X.
    pub x_deg: Option<f64>,
    /// Mean slope Y.
    pub y_deg: Option<f64>,
    /// Mean reference slope X, when there is one.
    pub reference_x_deg: Option<f64>,
    /// Mean reference slope Y, when there is one.
    pub reference_y_deg: Option<f64>,
}

/// One recording, which is one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReplayChannel {
    /// Channel, 1 or 2.
    pub channel: u8,
    /// Name of the file, without folders.
    pub file: String,
    /// Data rows in the file.
    pub rows: u64,
    /// Rows that were left out, by reason.
    pub skipped: Vec<SkippedRows>,
    /// Gaps in time after which the chain started anew.
    pub gaps: u64,
    /// Rate of the good rows, Hz.
    pub rate_hz: f64,
    /// Time between the first and the last good row, s.
    pub duration_s: f64,
    /// Scale that was used for counts, LSB per g; none for other units.
    pub lsb_per_g: Option<f64>,
    /// Columns that were not understood and not used.
    pub ignored_columns: Vec<String>,
    /// How the channel was calibrated.
    pub calibration: ReplayCalibration,
    /// Latency that the chain declares, ms.
    pub latency_ms: Option<f64>,
    /// Both slopes.
    pub slopes: Vec<SlopeSeries>,
    /// The vertical with the gyroscope; none without one.
    pub moving: Option<MovingVertical>,
    /// Standstill plateaus.
    pub plateaus: Vec<Plateau>,
}

/// Difference of the two channels in one slope.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlopeDelta {
    /// Which slope.
    pub axis: Axis,
    /// Root mean square difference.
    pub rms_deg: Option<f64>,
    /// Greatest absolute difference.
    pub max_deg: Option<f64>,
    /// Root mean square difference while both channels stood still.
    pub standstill_rms_deg: Option<f64>,
    /// Compared pairs whose difference passed the threshold.
    pub warnings: u64,
    /// `[time s, least, greatest]` of channel 1 - channel 2.
    pub bins: Vec<Bin>,
}

/// The comparison of two channels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CrossCheck {
    /// Threshold in use.
    pub threshold_deg: f64,
    /// Compared pairs.
    pub compared: u64,
    /// Times that a stop was asked for.
    pub stops: u64,
    /// Faults declared.
    pub faults: u64,
    /// Both slopes.
    pub slopes: Vec<SlopeDelta>,
}

/// A stretch of time under one verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VerdictInterval {
    /// Begin, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// The verdict, in words.
    pub verdict: String,
    /// Whether the angle may be used during that time.
    pub trusted: bool,
}

/// Everything `plumb replay` found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReplayReport {
    /// Always [`REPLAY_FORMAT`].
    pub format: String,
    /// Always [`REPLAY_VERSION`].
    pub version: u32,
    /// Version of the program.
    pub plumb_version: String,
    /// Chain in use.
    pub mode: Mode,
    /// One or two recordings.
    pub channels: Vec<ReplayChannel>,
    /// The comparison; none for one recording.
    pub cross_check: Option<CrossCheck>,
    /// Verdicts in order of time.
    pub verdicts: Vec<VerdictInterval>,
    /// Sentences that the reader should know, such as a unit that was assumed.
    pub notes: Vec<String>,
}

impl ReplayReport {
    /// A report of these channels, without comparison, verdicts and notes.
    pub fn new(mode: Mode, channels: Vec<ReplayChannel>) -> Self {
        Self {
            format: REPLAY_FORMAT.to_owned(),
            version: REPLAY_VERSION,
            plumb_version: env!("CARGO_PKG_VERSION").to_owned(),
            mode,
            channels,
            cross_check: None,
            verdicts: Vec::new(),
            notes: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample;

    #[test]
    fn a_replay_report_begins_with_format_and_version() {
        let text = output::check::text(&sample::replay());
        let begin = "{\n  \"format\": \"plumb-replay\",\n  \"version\": 1,";
        assert!(text.starts_with(begin), "{text}");
    }
}
