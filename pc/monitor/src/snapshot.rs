//! All that a view shows, at one moment.
//!
//! In: the model fills it. Out: plain values with their units in the names; the object that
//! `--json` prints and the web page gets. What is not there is absent with a reason in words,
//! never an old or a magic number.
//!
//! Left out: traces and the list of events, which have memories of their own.

use serde::Serialize;

use super::level::Level;

/// Name of the format.
pub const FORMAT: &str = "plumb-monitor";

/// Version of the format.
pub const VERSION: u32 = 1;

/// One fault that stands.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StandingFault {
    /// Its number, as in EMCY bytes 3 to 5.
    pub number: u8,
    /// Its EMCY code.
    pub code: u16,
    /// In words.
    pub text: &'static str,
}

/// Something in what a channel sends that does not fit together.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FindingCount {
    /// Its name.
    pub name: &'static str,
    /// The same in words.
    pub text: &'static str,
    /// How often it was found.
    pub count: u64,
}

/// One channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Channel {
    /// `A` or `B`.
    pub name: &'static str,
    /// Its node-id.
    pub node_id: u8,
    /// Slope X, deg; absent when it is old or must not be used.
    pub slope_x_deg: Option<f64>,
    /// Slope Y, deg.
    pub slope_y_deg: Option<f64>,
    /// Why there is no slope X.
    pub slope_x_reason: Option<String>,
    /// Why there is no slope Y.
    pub slope_y_reason: Option<String>,
    /// True where its slopes are in another unit (6000h) than they are taken in; it has no slope
    /// then, and the reason states it.
    #[serde(skip)]
    pub other_unit: bool,
    /// True when its latest slopes are too old to be shown.
    pub stale: bool,
    /// Age of its latest TPDO 1, s.
    pub slopes_age_s: Option<f64>,
    /// 2020h of its latest fresh TPDO 1; `None` too where no PDO carries it.
    pub validity: Option<u8>,
    /// The same in words; `None` only where there is no fresh TPDO 1.
    pub validity_text: Option<String>,
    /// 2021h of its latest fresh TPDO 1; `None` too where no PDO carries it.
    pub state: Option<u8>,
    /// Expanded uncertainty (k = 2) of its slopes, deg.
    pub uncertainty_deg: Option<f64>,
    /// The larger difference to the other channel as the node has formed it (2024h), deg.
    pub difference_deg: Option<f64>,
    /// Group delay of its filter (2023h), ms.
    pub latency_ms: Option<u8>,
    /// Temperature of its sensor, degC.
    pub temperature_degc: Option<i8>,
    /// Why uncertainty, difference, latency and temperature are absent.
    pub detail_reason: Option<String>,
    /// Slope X at the SYNC itself (2029h), deg; of an instrument with a gyroscope, while TPDO 5
    /// comes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slope_x_now_deg: Option<f64>,
    /// Slope Y at the SYNC itself, deg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slope_y_now_deg: Option<f64>,
    /// Expanded uncertainty (k = 2) of these, deg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uncertainty_now_deg: Option<f64>,
    /// Rate of turn about the housing's X, Y and Z (202Ah), deg/s; of an instrument with a
    /// gyroscope, while TPDO 6 comes and has rates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rates_deg_s: Option<[f64; 3]>,
    /// NMT state by its latest heartbeat.
    pub nmt: Option<String>,
    /// Age of its latest heartbeat, s.
    pub heartbeat_age_s: Option<f64>,
    /// True when heartbeats came and have stopped.
    pub heartbeat_lost: bool,
    /// Boot-up messages seen.
    pub boots: u32,
    /// Faults that stand, by its latest EMCY.
    pub faults: Vec<StandingFault>,
    /// What does not fit together in what it sends.
    pub findings: Vec<FindingCount>,
}

impl Channel {
    /// The slope along an axis, 0 for X.
    pub const fn slope_deg(&self, axis: usize) -> Option<f64> {
        if axis == 0 {
            self.slope_x_deg
        } else {
            self.slope_y_deg
        }
    }

    /// Why there is none.
    pub fn slope_reason(&self, axis: usize) -> &str {
        let reason = if axis == 0 {
            &self.slope_x_reason
        } else {
            &self.slope_y_reason
        };
        reason.as_deref().unwrap_or("")
    }
}

/// What the pair makes of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// How bad it is.
    pub level: Level,
    /// In words.
    pub text: String,
    /// Channels that are blamed, by name.
    pub blamed: Vec<&'static str>,
    /// Why, in words.
    pub reason: Option<String>,
}

/// Of what the difference is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Compared {
    /// Of the angles as measured, which the channels tell each other (TPDO 3).
    Measured,
    /// Of the slopes (TPDO 1), since there is no TPDO 3: different presets are part of it.
    Slopes,
}

/// One instrument.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Instrument {
    /// From 1 on.
    pub number: usize,
    /// Channel A and B.
    pub channels: [Channel; 2],
    /// Of what the difference is.
    pub difference_of: Compared,
    /// X of A minus X of B at the same SYNC, deg.
    pub difference_x_deg: Option<f64>,
    /// Y of A minus Y of B, deg.
    pub difference_y_deg: Option<f64>,
    /// Why one of them is absent.
    pub difference_reason: Option<String>,
    /// Expanded uncertainty (k = 2) of the difference, deg: what two sound channels may differ by.
    pub band_deg: Option<f64>,
    /// True when the differences that are there lie inside the band.
    pub inside_band: Option<bool>,
    /// State of the pair, in words.
    pub verdict: Verdict,
}

/// How the source is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceState {
    /// Nothing has come yet.
    Waiting,
    /// Frames come.
    Running,
    /// None has come for a while.
    Silent,
    /// A log has come to its end.
    Ended,
    /// The connection is lost.
    Lost,
}

/// The bus, or the log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bus {
    /// What the user called it.
    pub name: String,
    /// How it is.
    pub state: SourceState,
    /// More about it, in words: how long it has been silent, why it is lost.
    pub state_text: Option<String>,
    /// Frames seen.
    pub frames: u64,
    /// Frames in the last second.
    pub frames_per_s: u32,
    /// SYNCs in the last second.
    pub syncs_per_s: u32,
    /// Bits on the wire in the last second.
    pub bits_per_s: u64,
    /// The bit rate that the load refers to, bit/s.
    pub bit_rate_per_s: Option<u32>,
    /// Load of the last second, per cent.
    pub load_percent: Option<f64>,
    /// Why there is no load.
    pub load_reason: Option<String>,
    /// Frames of the instruments that had not their form.
    pub malformed: u64,
    /// Lines of the adapter that can't be read, of a bus: what was in them is missing.
    pub unreadable: u64,
    /// Frames of others.
    pub others: u64,
    /// Frames that were older than one before.
    pub backwards: u64,
    /// Where frames are recorded to.
    pub recording: Option<String>,
    /// Frames recorded.
    pub recorded: u64,
    /// Why recording has ended.
    pub recording_reason: Option<String>,
}

/// Everything.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Snapshot {
    /// Always [`FORMAT`].
    pub format: &'static str,
    /// Always [`VERSION`].
    pub version: u32,
    /// Always `state`; events have `event`.
    pub record: &'static str,
    /// Time on the source's clock, s; of a bus since 1970.
    pub time_s: f64,
    /// The bus, or the log.
    pub bus: Bus,
    /// The instruments.
    pub instruments: Vec<Instrument>,
}
