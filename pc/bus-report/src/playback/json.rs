//! The summary of logs as one JSON object, which the text is made of as well.
//!
//! In: a [`Summary`] and the [`Source`] it came from. Out: [`Report`].

use serde::Serialize;

use super::export::Exported;
use super::foreign::Seen;
use super::summary::Summary;
use crate::totals::{ChannelSummary, Collected, Instrument, Last, Tally};
use bus_logs::{Source, Tally as Lines};
use codes::words;

/// Name of the format, the field `format`.
pub const FORMAT: &str = "plumb-log";
/// Version of the format. It rises when a field changes its meaning or goes away.
pub const VERSION: u32 = 2;

/// What is counted of frames that are used all the same.
const BACKWARDS: &str = "frames older than the one before";

/// All of it.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Always [`FORMAT`].
    pub format: &'static str,
    /// Always [`VERSION`].
    pub version: u32,
    /// The logs in the order in which they were found.
    pub files: Vec<String>,
    /// Frames read.
    pub frames: u64,
    /// Lines that gave no frame, by kind.
    pub skipped: Vec<SkippedJson>,
    /// Frames older than the one before them in their file.
    pub backwards: Option<SkippedJson>,
    /// Files whose end is missing.
    pub damaged: Vec<DamagedJson>,
    /// Files of a folder that are no logs.
    pub not_logs: Vec<String>,
    /// Files that were merged with another one, since they overlap.
    pub overlapping_files: u64,
    /// Files without a date that were taken as following the one before.
    pub undated_files: Vec<String>,
    /// Frames before --from and behind --to.
    pub outside: u64,
    /// What each interface has shown.
    pub interfaces: Vec<InterfaceJson>,
    /// Nodes with a data sheet.
    pub devices: Vec<Seen>,
    /// The table that was written.
    pub export: Option<Exported>,
}

/// Lines of a kind.
#[derive(Debug, Serialize)]
pub struct SkippedJson {
    /// The kind.
    pub kind: &'static str,
    /// In words.
    pub words: &'static str,
    /// How many.
    pub count: u64,
    /// The file of the first.
    pub first_file: String,
    /// Its line, counted from 1.
    pub first_line: u64,
}

/// A file whose end is missing.
#[derive(Debug, Serialize)]
pub struct DamagedJson {
    /// The file.
    pub file: String,
    /// Why.
    pub why: &'static str,
}

/// One interface.
#[derive(Debug, Serialize)]
pub struct InterfaceJson {
    /// Its name in the log.
    pub interface: String,
    /// Time of the first frame, s since 1970 or since the start of a log without a date.
    pub first_time_s: f64,
    /// Time of the latest frame.
    pub last_time_s: f64,
    /// Frames.
    pub frames: u64,
    /// SYNCs.
    pub syncs: u64,
    /// Frames of the instruments of a wrong length.
    pub malformed: u64,
    /// Frames whose time is no date although most of those before have one; they are left out.
    pub undated: u64,
    /// Frames with a date where most have none, or the other way round, as before a logger's clock
    /// is set; they are used, and outside of the first and the last time.
    pub other_clock: u64,
    /// Frames of other nodes and services.
    pub others: OthersJson,
    /// Times that nothing was seen for more than 2 s, which is taken as a hole in the log.
    pub holes: u64,
    /// The longest of these.
    pub longest_hole_s: f64,
    /// By the plan.
    pub instruments: Vec<InstrumentJson>,
}

/// Frames that are none of the instruments' PDOs, EMCY and heartbeats.
#[derive(Debug, Serialize)]
pub struct OthersJson {
    /// All of them.
    pub frames: u64,
    /// NMT commands.
    pub nmt: u64,
    /// SDO, of any node.
    pub sdo: u64,
    /// LSS, TIME, SRDO and GFC.
    pub services: u64,
    /// Of nodes of the plan, but not in it.
    pub unplanned: u64,
    /// Of other nodes.
    pub strangers: u64,
    /// With 29-bit identifiers.
    pub extended: u64,
    /// Remote frames.
    pub remote: u64,
    /// Node-ids of others that have sent a PDO, an EMCY or a heartbeat.
    pub node_ids: Vec<u8>,
}

/// One instrument.
#[derive(Debug, Serialize)]
pub struct InstrumentJson {
    /// Channel A and B.
    pub nodes: [NodeJson; 2],
    /// Channel A minus B at the same SYNC, of X and Y: as measured (TPDO 3) where that was sent.
    pub delta: [SpreadJson; 2],
}

/// One channel.
#[derive(Debug, Serialize)]
pub struct NodeJson {
    /// Node-id.
    pub node_id: u8,
    /// Whether anything of it was seen.
    pub seen: bool,
    /// TPDO 1 seen.
    pub readings: u64,
    /// Slope X where it may be used.
    pub slope_x: SpreadJson,
    /// Slope Y.
    pub slope_y: SpreadJson,
    /// Largest standard uncertainty.
    pub largest_uncertainty_deg: Option<f64>,
    /// Lowest temperature.
    pub lowest_temperature_degc: Option<i32>,
    /// Highest temperature.
    pub highest_temperature_degc: Option<i32>,
    /// How often each state of the pair (2021h) was told.
    pub states: Vec<StateJson>,
    /// What does not fit together in what it sends.
    pub findings: Vec<FindingJson>,
    /// How often its heartbeat was lost.
    pub heartbeats_lost: u64,
    /// Whether it is lost at the end.
    pub heartbeat_is_lost: bool,
    /// Boot-up messages.
    pub boots: u64,
    /// EMCY messages.
    pub emergencies: u64,
    /// Each fault that one of them told of, by its number in docs/canopen.md.
    pub faults: Vec<FaultJson>,
}

/// A fault.
#[derive(Debug, Serialize)]
pub struct FaultJson {
    /// Its number.
    pub fault: u8,
    /// Its EMCY code.
    pub code: u16,
    /// What it is.
    pub text: String,
    /// Whether it stands at the end.
    pub stands: bool,
}

/// A thing that does not fit.
#[derive(Debug, Serialize)]
pub struct FindingJson {
    /// Which.
    pub check: &'static str,
    /// In words.
    pub words: &'static str,
    /// How often.
    pub count: u64,
    /// When first.
    pub first_time_s: f64,
}

/// How often a state was told.
#[derive(Debug, Serialize)]
pub struct StateJson {
    /// 2021h; 10 for all that do not exist.
    pub state: u8,
    /// In words.
    pub words: String,
    /// TPDO 1 with it.
    pub count: u64,
}

/// Extremes and mean of angles.
#[derive(Debug, Serialize)]
pub struct SpreadJson {
    /// How many.
    pub count: u64,
    /// The smallest.
    pub min_deg: Option<f64>,
    /// The mean.
    pub mean_deg: Option<f64>,
    /// The largest.
    pub max_deg: Option<f64>,
    /// Root of the mean square.
    pub rms_deg: Option<f64>,
}

impl Report {
    /// Of all that was read.
    pub fn new(summary: Summary, source: &Source) -> Self {
        let (foreign, buses) = summary.finish();
        let all = source.skipped();
        let kinds = all.kinds();
        let damaged = all.damaged.iter();
        Self {
            format: FORMAT,
            version: VERSION,
            files: source.files().to_vec(),
            frames: source.frames(),
            skipped: kinds
                .map(|(kind, lines)| skipped(source, kind.name(), kind.words(), lines))
                .collect(),
            backwards: (all.backwards.count > 0)
                .then(|| skipped(source, "backwards", BACKWARDS, all.backwards)),
            damaged: damaged
                .map(|(file, damage)| DamagedJson {
                    file: source.name(*file),
                    why: damage.words(),
                })
                .collect(),
            not_logs: all.not_logs.clone(),
            overlapping_files: all.overlapping,
            undated_files: all.undated.iter().map(|file| source.name(*file)).collect(),
            outside: 0,
            devices: foreign.into_seen(),
            export: None,
            interfaces: buses
                .iter()
                .map(|(place, bus)| interface(source.interfaces().get(*place), bus))
                .collect(),
        }
    }
}

fn skipped(source: &Source, kind: &'static str, words: &'static str, of: Lines) -> SkippedJson {
    SkippedJson {
        kind,
        words,
        count: of.count,
        first_file: source.name(of.file),
        first_line: of.line,
    }
}

fn interface(name: Option<&String>, bus: &Collected) -> InterfaceJson {
    let (counts, traffic) = (&bus.counts, &bus.traffic);
    let (first, last) = traffic.span_ns().unwrap_or_default();
    InterfaceJson {
        interface: name.cloned().unwrap_or_default(),
        first_time_s: first as f64 / 1e9,
        last_time_s: last as f64 / 1e9,
        frames: counts.frames,
        syncs: counts.syncs,
        malformed: counts.malformed,
        undated: bus.undated,
        other_clock: traffic.by_other_clock(),
        others: others(bus),
        holes: traffic.gaps.count(),
        longest_hole_s: traffic.gaps.longest_ns() as f64 / 1e9,
        instruments: bus
            .instruments
            .iter()
            .map(|(last, one)| instrument(last, one))
            .collect(),
    }
}

fn others(bus: &Collected) -> OthersJson {
    let counts = &bus.counts;
    OthersJson {
        frames: counts.others,
        nmt: counts.nmt,
        sdo: counts.sdo,
        services: counts.services,
        unplanned: counts.unplanned,
        strangers: counts.strangers,
        extended: counts.extended,
        remote: counts.remote,
        node_ids: bus.strangers.clone(),
    }
}

fn instrument(last: &[Last; 2], one: &Instrument) -> InstrumentJson {
    let ([last_a, last_b], [a, b]) = (last, &one.summary.channels);
    InstrumentJson {
        nodes: [node(last_a, a), node(last_b, b)],
        delta: one.summary.difference.own.each_ref().map(spread),
    }
}

/// 2021h in words; what does not exist is counted as the last.
fn state_words(state: u8) -> String {
    match state {
        ..=9 => words::state(state, words::CHANNELS).into_owned(),
        _ => "states that do not exist".to_owned(),
    }
}

fn node(last: &Last, channel: &ChannelSummary) -> NodeJson {
    let temperature = channel.temperature.extremes();
    let uncertainty = channel.uncertainty.extremes();
    let states = (0..).zip(channel.states);
    NodeJson {
        node_id: last.node_id,
        seen: last.seen,
        readings: channel.readings,
        slope_x: spread(&channel.slope[0]),
        slope_y: spread(&channel.slope[1]),
        largest_uncertainty_deg: uncertainty.map(|(_, most)| f64::from(most) / 1000.0),
        lowest_temperature_degc: temperature.map(|(least, _)| least),
        highest_temperature_degc: temperature.map(|(_, most)| most),
        states: states
            .filter(|(_, count)| *count > 0)
            .map(|(state, count)| StateJson {
                state,
                words: state_words(state),
                count,
            })
            .collect(),
        findings: channel
            .checks
            .found()
            .map(|(check, finding)| FindingJson {
                check: check.name(),
                words: check.words(),
                count: finding.count,
                first_time_s: finding.first_ns as f64 / 1e9,
            })
            .collect(),
        heartbeats_lost: channel.heartbeat_losses,
        heartbeat_is_lost: last.heartbeat_is_lost,
        boots: channel.boots,
        emergencies: channel.emergencies.values().sum(),
        faults: faults(channel.faults, last.faults),
    }
}

fn faults(seen: u32, stand: u32) -> Vec<FaultJson> {
    let all = words::faults(seen).map(|fault| FaultJson {
        fault: fault as u8,
        code: fault.report().0,
        text: fault.text().to_owned(),
        stands: stand & (1 << fault as u32) != 0,
    });
    all.collect()
}

fn spread(of: &Tally) -> SpreadJson {
    let extremes = of.extremes();
    SpreadJson {
        count: of.count(),
        min_deg: extremes.map(|(least, _)| f64::from(least) / 1000.0),
        mean_deg: of.mean_angle().map(|mdeg| mdeg / 1000.0),
        max_deg: extremes.map(|(_, most)| f64::from(most) / 1000.0),
        rms_deg: of.rms().map(|mdeg| mdeg / 1000.0),
    }
}
