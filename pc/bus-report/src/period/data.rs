//! `report.json` of `plumb report`.
//!
//! In: what was collected. Out: plain structs that serde writes; the format has a name
//! and a version, and each field is described, with its unit, in `docs/period-report.md`. Times
//! are seconds since 1970 (UTC) or since the log's own time 0, as `clock` states. What is not
//! known is `null`.

use serde::{Deserialize, Serialize};

use crate::blackbox::data::{MemoryReport, PlotReport};
use output::series::{Bin, Point};

/// Name of the format, the field `format`.
pub const FORMAT: &str = "plumb-period";
/// Version of the format. It rises when a field changes its meaning or goes away.
pub const VERSION: u32 = 1;

/// Everything `plumb report` found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PeriodReport {
    /// Always [`FORMAT`].
    pub format: String,
    /// Always [`VERSION`].
    pub version: u32,
    /// Version of the program.
    pub plumb_version: String,
    /// The period in one sentence.
    pub verdict: String,
    /// True when no fault was seen and something was.
    pub clean: bool,
    /// `utc` or `relative`.
    pub clock: String,
    /// First frame.
    pub from_s: Option<f64>,
    /// Last frame.
    pub to_s: Option<f64>,
    /// Time of which there is data.
    pub covered_s: f64,
    /// What was read; none where no log was given.
    pub logs: Option<LogsReport>,
    /// Each bus that was logged, by interface; none where no log was read.
    pub buses: Vec<BusReport>,
    /// Each instrument that was seen.
    pub instruments: Vec<InstrumentReport>,
    /// What nodes remember of their faults.
    pub memories: Vec<MemoryReport>,
    /// Sentences that the reader should know.
    pub notes: Vec<String>,
}

/// The logs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LogsReport {
    /// Their names.
    pub files: Vec<String>,
    /// Frames read.
    pub frames: u64,
    /// What gave no frame, by reason.
    pub skipped: Vec<Skipped>,
    /// Files whose end is missing, and how.
    pub damaged: Vec<String>,
    /// Files in folders that are no logs.
    pub not_logs: Vec<String>,
    /// Files that were begun before another one had ended.
    pub overlapping: u64,
    /// Files without a date that were taken as following another one.
    pub undated: Vec<String>,
}

/// Lines that are no frame.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Skipped {
    /// Why.
    pub reason: String,
    /// How many.
    pub count: u64,
    /// The file of the first of them.
    pub file: String,
    /// Its line, counted from 1.
    pub first_line: u64,
}

/// The bus.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BusReport {
    /// The interface that logged it, such as `can0`.
    pub interface: String,
    /// Frames in the period.
    pub frames: u64,
    /// SYNCs.
    pub syncs: u64,
    /// Frames before and after the period that was asked for.
    pub outside: u64,
    /// Frames without a date among those with one, which are left out.
    pub undated: u64,
    /// Frames older than the one before them.
    pub backwards: u64,
    /// Frames of instruments in another form than delivered.
    pub malformed: u64,
    /// Frames with a 29-bit identifier.
    pub extended: u64,
    /// Remote frames.
    pub remote: u64,
    /// NMT commands.
    pub commands: u64,
    /// Nodes that are of no instrument.
    pub foreign: Vec<ForeignNode>,
    /// Mean of what was on the bus while there is data.
    pub rate_bit_s: Option<f64>,
    /// The bit rate that was given.
    pub bit_rate_bit_s: Option<f64>,
    /// Mean share of the bit rate.
    pub load_percent: Option<f64>,
    /// Mean rate per bin of time.
    pub rate_bins: Vec<Point>,
    /// Width of such a bin.
    pub bin_s: f64,
    /// Time without any frame.
    pub gaps: GapsReport,
}

/// A node of no instrument.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ForeignNode {
    /// Its node-id, by the identifiers as delivered.
    pub node_id: u8,
    /// Its frames.
    pub frames: u64,
}

/// Stretches without data.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GapsReport {
    /// How many.
    pub count: u64,
    /// How long together.
    pub sum_s: f64,
    /// The longest of them, in order of time.
    pub longest: Vec<GapReport>,
}

/// A stretch without data.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GapReport {
    /// The last frame before it.
    pub from_s: f64,
    /// The first frame after it.
    pub to_s: f64,
    /// True when nothing at all was on the bus.
    pub whole_bus: bool,
}

/// An instrument.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct InstrumentReport {
    /// Counted from 1.
    pub number: usize,
    /// The interface that logged its bus.
    pub interface: String,
    /// First frame of it.
    pub from_s: f64,
    /// Last frame of it.
    pub to_s: f64,
    /// Time of which there is data.
    pub covered_s: f64,
    /// Time without a frame of it.
    pub gaps: GapsReport,
    /// Channel A and channel B.
    pub channels: Vec<ChannelReport>,
    /// The difference between them.
    pub difference: DifferenceReport,
    /// One row per day of the period, also for those without data.
    pub days: Vec<DayReport>,
    /// What happened, in order of time.
    pub events: Vec<EventReport>,
    /// Faults for which there was no room.
    pub faults_left_out: u64,
    /// Other events for which there was no room.
    pub others_left_out: u64,
    /// The SYNCs around events.
    pub plots: Vec<PlotReport>,
    /// Events for whose plot there was no room.
    pub plots_left_out: u64,
}

/// A channel.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ChannelReport {
    /// `A` or `B`.
    pub channel: String,
    /// Its node-id.
    pub node_id: u8,
    /// True when it sent anything.
    pub seen: bool,
    /// Vendor-ID, where somebody has read it (1018h sub 1).
    pub vendor_id: Option<u32>,
    /// Product code (1018h sub 2).
    pub product_code: Option<u32>,
    /// Revision (1018h sub 3).
    pub revision: Option<u32>,
    /// Serial number (1018h sub 4).
    pub serial_number: Option<u32>,
    /// Version of the software (100Ah).
    pub software: Option<String>,
    /// Check sum of the calibration (2062h sub 1), eight hexadecimal digits.
    pub calibration_crc32: Option<String>,
    /// SHA-256 of the calibration's report (2063h); empty when the node has none.
    pub report_sha256: Option<String>,
    /// Slope X and slope Y.
    pub slopes: Vec<SlopeReport>,
    /// Time with a slope that could be used.
    pub usable_s: f64,
    /// Time without one, by reason.
    pub unusable: Vec<UnusableReport>,
    /// Standard uncertainty (2022h sub 3), deg.
    pub uncertainty: QuantityReport,
    /// Messages that said it was not known.
    pub uncertainty_unknown: u64,
    /// Temperature of the sensor, degC.
    pub temperature: QuantityReport,
    /// Energy above 150 Hz (2010h sub 9), 8 steps per doubling, 64 for the channel's own noise.
    pub activity: QuantityReport,
    /// Angle now and rates of turn, of a channel with a gyroscope.
    pub motion: Option<MotionReport>,
    /// EMCY messages by code.
    pub emergencies: Vec<CodeReport>,
    /// Boot-up messages.
    pub boots: u64,
    /// Times that the heartbeat stayed away.
    pub heartbeat_losses: u64,
    /// How long it stayed away.
    pub heartbeat_lost_s: f64,
    /// Frames of another form than delivered.
    pub malformed: u64,
    /// What does not fit together in what it sends.
    pub findings: Vec<FindingReport>,
}

/// The motion of a channel with a gyroscope.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MotionReport {
    /// Messages with the angle now (TPDO 5).
    pub angles: u64,
    /// Slope X and slope Y at the SYNC itself (2029h).
    pub slopes: Vec<AxisFigures>,
    /// Its standard uncertainty (2029h sub 3), deg.
    pub uncertainty: QuantityReport,
    /// Messages with rates of turn (TPDO 6).
    pub messages: u64,
    /// About the housing's X, Y and Z (202Ah).
    pub rates: Vec<RateReport>,
    /// Least and greatest size of the fastest of the three per bin of time, deg/s.
    pub fastest_bins: Vec<Bin>,
}

/// A rate of turn.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RateReport {
    /// `x`, `y` or `z`.
    pub axis: String,
    /// Values.
    pub count: u64,
    /// Least, deg/s.
    pub min_dps: Option<f64>,
    /// Greatest.
    pub max_dps: Option<f64>,
    /// Mean: over a long time, what is left of the gyroscope's bias.
    pub mean_dps: Option<f64>,
    /// Root of the mean square.
    pub rms_dps: Option<f64>,
}

/// Something that does not fit together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FindingReport {
    /// What, in a word.
    pub check: String,
    /// The same in words.
    pub text: String,
    /// How often.
    pub count: u64,
    /// When first.
    pub first_s: f64,
}

/// The values of one axis, in figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisFigures {
    /// `x` or `y`.
    pub axis: String,
    /// Values.
    pub count: u64,
    /// Least.
    pub min_deg: Option<f64>,
    /// Greatest.
    pub max_deg: Option<f64>,
    /// Mean.
    pub mean_deg: Option<f64>,
    /// Standard deviation about the mean.
    pub std_deg: Option<f64>,
    /// Percentiles, each true to the step below.
    pub percentiles: Vec<Percentile>,
    /// Step of the percentiles.
    pub step_deg: f64,
}

/// A slope while it could be used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlopeReport {
    /// Its values.
    #[serde(flatten)]
    pub values: AxisFigures,
    /// Least and greatest per bin of time.
    pub bins: Vec<Bin>,
}

/// A percentile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Percentile {
    /// Share of the values, in per cent.
    pub percent: f64,
    /// The value that this share does not exceed.
    pub value_deg: f64,
}

/// Time without a usable slope.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct UnusableReport {
    /// State of the pair (2021h); `null` where it was not sent.
    pub state: Option<u8>,
    /// The same in words.
    pub state_text: String,
    /// The channel's own reason (2025h), 0 where it had an angle.
    pub reason: u8,
    /// The same in words.
    pub reason_text: Option<String>,
    /// True where the slopes were in another unit (6000h) than they were taken in.
    pub other_unit: bool,
    /// How long.
    pub time_s: f64,
}

/// A quantity over time.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct QuantityReport {
    /// Values.
    pub count: u64,
    /// Least.
    pub min: Option<f64>,
    /// Greatest.
    pub max: Option<f64>,
    /// Mean.
    pub mean: Option<f64>,
    /// Least and greatest per bin of time.
    pub bins: Vec<Bin>,
}

/// How often a code came.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CodeReport {
    /// EMCY code, such as `FF13h`.
    pub code: String,
    /// The same in words.
    pub text: String,
    /// How often.
    pub count: u64,
}

/// The difference of the two channels.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DifferenceReport {
    /// SYNCs compared by TPDO 3, as measured.
    pub syncs_measured: u64,
    /// SYNCs compared by TPDO 1, presets and offsets included.
    pub syncs_slopes: u64,
    /// X and Y.
    pub slopes: Vec<SlopeDifference>,
    /// The larger of both per bin of time.
    pub bins: Vec<Bin>,
    /// SYNCs at which the uncertainty of both channels was known.
    pub judged: u64,
    /// Those of them above the expanded uncertainty of the difference (k = 2).
    pub above: u64,
    /// What the nodes have told (2024h sub 3), values.
    pub told_count: u64,
    /// Greatest size of what they have told.
    pub told_max_deg: Option<f64>,
    /// Mean size by which that was off the own calculation.
    pub told_off_mean_deg: Option<f64>,
    /// Greatest such size.
    pub told_off_max_deg: Option<f64>,
}

/// The difference on one axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlopeDifference {
    /// Its values.
    #[serde(flatten)]
    pub values: AxisFigures,
    /// How often: middle of a bar and count.
    pub histogram: Vec<Point>,
    /// Width of a bar.
    pub bar_deg: f64,
}

/// A day.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DayReport {
    /// `2026-11-20`, or `day 1` of a log without dates.
    pub day: String,
    /// Time of which there is data; 0 for a day without.
    pub covered_s: f64,
    /// SYNCs.
    pub syncs: u64,
    /// Warnings and faults that stand apart by more than a second.
    pub incidents: u64,
    /// Events by kind, those that happened.
    pub kinds: Vec<KindReport>,
    /// Greatest size of a difference.
    pub difference_max_deg: Option<f64>,
}

/// Events of a kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KindReport {
    /// Which.
    pub kind: String,
    /// How many.
    pub count: u64,
}

/// An event.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EventReport {
    /// When.
    pub time_s: f64,
    /// `A` or `B`: who told it, or whose heartbeat it is.
    pub channel: String,
    /// Its node-id.
    pub node_id: u8,
    /// Its kind.
    pub kind: String,
    /// EMCY code, such as `FF13h`; none for what the log itself shows.
    pub code: Option<String>,
    /// In words.
    pub text: String,
    /// The channel that is blamed: `A`, `B`, or `A and B`.
    pub blamed: Option<String>,
    /// Why, in words.
    pub reason_text: Option<String>,
    /// State of the pair (2021h) after it.
    pub state: Option<u8>,
    /// How it ended: `over`, `restart`, `momentary` or `standing`.
    pub end: String,
    /// How long it stood; none while it stands, and for what has no end of its own.
    pub duration_s: Option<f64>,
    /// How often it came again within a second of its end.
    pub repeats: u32,
    /// Number of the plot that shows it, from 1.
    pub plot: Option<usize>,
}
