//! What is told of a node's memory, for people and as JSON.
//!
//! In: decoded fault logs and boxes. Out: plain structs that serde writes, described in
//! `docs/period-report.md`, and the table of a fault log. What is not known is `null`.

use device::fault_log::Entry;
use serde::Serialize;

use super::decode::{FaultLog, Frame, Memory, Samples};
use codes::words;
use output::plural;
use output::series::rounded;
use output::table::{Rows, Table};

/// What a node remembers, or what a file holds of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MemoryReport {
    /// Where it comes from: a node of a bus, or a file.
    pub source: String,
    /// The node's id; none for a file.
    pub node_id: Option<u8>,
    /// Entries of the fault log, newest first.
    pub entries: Vec<MemoryEntry>,
    /// Entries made since the log was emptied, 255 for more; none for the file of a box.
    pub entries_made: Option<u8>,
    /// The boxes that are not empty.
    pub boxes: Vec<PlotReport>,
}

/// An entry of a fault log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MemoryEntry {
    /// Time since the start of the node.
    pub since_start_s: f64,
    /// SYNCs obeyed until then.
    pub sync_count: u32,
    /// EMCY code, such as `FF13h`.
    pub code: String,
    /// In words.
    pub text: String,
    /// The faults that stand after it, in words.
    pub faults: Vec<String>,
    /// State of the pair (2021h).
    pub state: u8,
    /// The same in words.
    pub state_text: String,
    /// The channel that is blamed, seen from the node: `own`, `other` or `both`.
    pub blamed: Option<String>,
    /// Why, in words.
    pub reason_text: Option<String>,
    /// Number of the box with the samples around it.
    pub box_number: Option<u8>,
    /// How often the same event came again.
    pub repeats: u16,
}

/// The SYNCs around an event.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlotReport {
    /// Counted from 1.
    pub number: usize,
    /// What it shows.
    pub title: String,
    /// The names of the channels `a` and `b` of the rows.
    pub names: [String; 2],
    /// The event's time, which is 0 in the rows; of a box since the start of the node.
    pub time_s: f64,
    /// One row per SYNC.
    pub rows: Vec<PlotRow>,
}

/// One SYNC of a plot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PlotRow {
    /// Time since the event.
    pub since_s: f64,
    /// Channel A, slope X.
    pub a_x_deg: Option<f64>,
    /// Channel A, slope Y.
    pub a_y_deg: Option<f64>,
    /// Channel B, slope X.
    pub b_x_deg: Option<f64>,
    /// Channel B, slope Y.
    pub b_y_deg: Option<f64>,
    /// Channel A minus channel B, X.
    pub difference_x_deg: Option<f64>,
    /// Channel A minus channel B, Y.
    pub difference_y_deg: Option<f64>,
}

impl MemoryReport {
    /// Nothing yet, of this node or file.
    pub const fn of(source: String, node_id: Option<u8>) -> Self {
        Self {
            source,
            node_id,
            entries: Vec::new(),
            entries_made: None,
            boxes: Vec::new(),
        }
    }

    /// Takes what was read; `number` is that of a box.
    pub fn take(&mut self, memory: &Memory, number: usize) {
        match memory {
            Memory::Log(log) => self.take_log(log),
            Memory::Box(samples) => self.boxes.push(plot(samples, number)),
        }
    }

    fn take_log(&mut self, log: &FaultLog) {
        self.entries = log.entries.iter().map(entry).collect();
        self.entries_made = Some(log.made);
    }
}

/// Keys for who is blamed: the channel that has the memory, the other one, both.
pub const BLAMED: [&str; 3] = ["own", "other", "both"];

fn entry(entry: &Entry) -> MemoryEntry {
    MemoryEntry {
        since_start_s: f64::from(entry.at_ms) / 1e3,
        sync_count: entry.sync,
        code: format!("{:04X}h", entry.code),
        text: words::code(entry.code).into_owned(),
        faults: words::faults(entry.faults)
            .map(|f| f.text().to_owned())
            .collect(),
        state: entry.state,
        state_text: words::state(entry.state, words::CHANNELS).into_owned(),
        blamed: words::blamed(entry.blamed, BLAMED).map(str::to_owned),
        reason_text: words::reason(entry.reason).map(Into::into),
        box_number: (entry.box_number > 0).then_some(entry.box_number),
        repeats: entry.repeats,
    }
}

/// A box as a plot.
pub fn plot(samples: &Samples, number: usize) -> PlotReport {
    let row = |(at, frame): (usize, &Frame)| {
        let [own, other] = &frame.measured;
        let deg = |mdeg: Option<i32>| mdeg.map(|mdeg| rounded(f64::from(mdeg) * 1e-3));
        PlotRow {
            since_s: rounded(samples.since_s(at)),
            a_x_deg: deg(own.mdeg(0)),
            a_y_deg: deg(own.mdeg(1)),
            b_x_deg: deg(other.mdeg(0)),
            b_y_deg: deg(other.mdeg(1)),
            difference_x_deg: deg(own.minus(other, 0)),
            difference_y_deg: deg(own.minus(other, 1)),
        }
    };
    let entry = &samples.entry;
    let since_s = f64::from(entry.at_ms) / 1e3;
    PlotReport {
        number,
        title: format!(
            "Box {number}: {} ({:04X}h), {since_s:.3} s after the start",
            words::code(entry.code),
            entry.code
        ),
        names: ["This channel", "The other channel"].map(str::to_owned),
        time_s: since_s,
        rows: samples.frames.iter().enumerate().map(row).collect(),
    }
}

/// The entries of a fault log.
pub fn table(memory: &MemoryReport, title: &str) -> Table {
    let word = |text: &Option<String>| text.clone().unwrap_or_default();
    let above_zero = |count: u16| match count {
        0 => String::new(),
        count => count.to_string(),
    };
    let mut table = Rows::of(title, &memory.entries)
        .number("Since the start, s", 3, |entry| entry.since_start_s)
        .count("SYNC", |entry| entry.sync_count)
        .text("What", |entry| &entry.text)
        .text("Code", |entry| &entry.code)
        .text("State of the pair", |entry| &entry.state_text)
        .text("Blamed", |entry| word(&entry.blamed))
        .text("Why", |entry| word(&entry.reason_text))
        .count("Again", |entry| above_zero(entry.repeats))
        .count("Box", |entry| {
            above_zero(entry.box_number.unwrap_or(0).into())
        })
        .table();
    if let Some(made) = memory
        .entries_made
        .filter(|made| usize::from(*made) > memory.entries.len())
    {
        let made = match made {
            u8::MAX => "255 or more entries were".to_owned(),
            made => plural(made, "entry was", "entries were"),
        };
        let left = match memory.entries.len() {
            0 => "none is left".to_owned(),
            left => format!("the last {} left", plural(left as u64, "is", "are")),
        };
        table
            .notes
            .push(format!("{made} made since the log was emptied; {left}."));
    }
    table
}
