//! `report.json` of a fleet.
//!
//! In: what the Python package has found out of the summaries of the machines. Out: plain structs
//! that serde reads and writes; each field is described in `docs/fleet.md`.

use serde::{Deserialize, Serialize};

/// Everything on the page of a fleet.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FleetReport {
    /// Always `plumb-fleet`.
    pub format: String,
    /// Version of the form.
    pub version: u32,
    /// Version of the program.
    #[serde(default)]
    pub plumb_version: String,
    /// The fleet in one sentence.
    pub verdict: String,
    /// True when no machine needs a visit and every log could be read.
    pub clean: bool,
    /// First day with data.
    pub from: Option<String>,
    /// Last day with data.
    pub to: Option<String>,
    /// Small facts: name and value.
    pub facts: Vec<(String, String)>,
    /// Machines that need a visit, the most urgent first.
    pub visits: Vec<Visit>,
    /// The parts of the page behind them.
    pub sections: Vec<Section>,
}

/// A machine that needs a visit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Visit {
    /// Its name.
    pub machine: String,
    /// Its model, where it is known.
    pub model: Option<String>,
    /// Its software, where it is known.
    pub firmware: Option<String>,
    /// Greater is sooner.
    pub urgency: u32,
    /// Its own page of the period, from the folder of this one.
    pub page: Option<String>,
    /// Why.
    pub reasons: Vec<Reason>,
}

/// Why a machine needs a visit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Reason {
    /// In a word.
    pub kind: String,
    /// In a sentence.
    pub text: String,
}

/// A part of the page.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Section {
    /// Its heading.
    pub title: String,
    /// Paragraphs.
    pub text: Vec<String>,
    /// Charts, which stand before the tables.
    pub charts: Vec<ChartData>,
    /// Tables.
    pub tables: Vec<TableData>,
}

/// A table.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TableData {
    /// Its title.
    pub title: String,
    /// Heads of its columns.
    pub columns: Vec<ColumnData>,
    /// Its rows.
    pub rows: Vec<Vec<CellData>>,
    /// Sentences below it.
    pub notes: Vec<String>,
}

/// The head of a column.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ColumnData {
    /// Its name.
    pub name: String,
    /// Whether numbers stand in it.
    #[serde(default)]
    pub number: bool,
}

/// A cell.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum CellData {
    /// Plain text.
    Text(String),
    /// Text with a meaning or a link.
    Marked {
        /// What it shows.
        text: String,
        /// `pass`, `fail` or nothing.
        #[serde(default)]
        tone: String,
        /// Where it leads, or nothing.
        #[serde(default)]
        link: String,
    },
}

/// A chart.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ChartData {
    /// Stands above it.
    pub title: String,
    /// What a reader who does not see it should know.
    pub description: String,
    /// Name and unit of the horizontal axis.
    pub x_label: String,
    /// Name and unit of the vertical axis.
    pub y_label: String,
    /// The series, drawn in this order.
    pub series: Vec<SeriesData>,
    /// Horizontal lines.
    #[serde(default)]
    pub levels: Vec<LevelData>,
    /// Ticks with names of their own.
    #[serde(default)]
    pub x_names: Vec<(f64, String)>,
}

/// A series of a chart.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SeriesData {
    /// Its name.
    pub name: String,
    /// How it is drawn.
    pub kind: SeriesKind,
    /// `[x, y]`, or `[x, least, greatest]` of a band; `null` is a gap.
    pub points: Vec<Vec<Option<f64>>>,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SeriesKind {
    /// A line.
    Line,
    /// Markers.
    Markers,
    /// Bars from zero.
    Bars,
    /// The area between two values.
    Band,
}

/// A horizontal line.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LevelData {
    /// Where, in the unit of y.
    pub at: f64,
    /// What it is.
    pub name: String,
}
