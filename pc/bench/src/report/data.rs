//! `report.json`: every figure of a demo run, as named fields.
//!
//! In: what the demo measured. Out: plain structs that serde writes; the format has a
//! name and a version and each field is described, with its unit, in `docs/report-format.md`.
//! A figure that was not obtained is `None`, written as `null`. Angles and errors are degrees.
//! Drawing, printing and writing to disk are done by the modules beside this one.

use serde::Serialize;
use sim::rig::Mount;

use output::series::{Bin, Point};

/// Name of the format, the field `format`.
pub const FORMAT: &str = "plumb-report";
/// Version of the format. It rises when a field changes its meaning or goes away.
pub const VERSION: u32 = 1;

/// How the instrument computes its angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// The paper's, read so that its own results hold: 50 Hz, one pole, one-axis tables, straight
    /// lines between their points, both nodes at one instant.
    Paper,
    /// The paper's to the letter: the nearest point, each node's newest sample.
    #[serde(rename = "as printed")]
    AsPrinted,
    /// The default: 400 Hz, Butterworth, three-axis correction.
    Product,
}

/// Which slope is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Slope X, the paper's X axis (CiA 410 "long").
    X,
    /// Slope Y, the paper's Y axis (CiA 410 "lateral").
    Y,
}

impl From<Mount> for Axis {
    fn from(mount: Mount) -> Self {
        match mount {
            Mount::X | Mount::Z => Self::X,
            Mount::Y => Self::Y,
        }
    }
}

/// At which angles the static test stood.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Angles {
    /// Every 10 degrees, which are knots of the calibration table.
    Knots,
    /// Random angles between the knots.
    Random,
}

/// How a fault period ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Outcome {
    /// No fault was reported.
    #[serde(rename = "none")]
    None,
    /// After the stop the channels agreed again, so the data had been late.
    #[serde(rename = "data delay, resumed")]
    DataDelay,
    /// Single warnings, not enough to act.
    #[serde(rename = "warnings only")]
    Warnings,
    /// A fault was reported, the supply was found good, and the instrument was reset.
    #[serde(rename = "fault without cause, reset")]
    FaultWithoutCause,
    /// After the stop the channels still differed; a supply check and a reset cured it.
    #[serde(rename = "physical fault, supply checked and reset")]
    PhysicalFault,
    /// The fault was still there when the run ended.
    #[serde(rename = "fault not cured")]
    NotCured,
}

/// The two error types of the paper's Table I.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum ErrorType {
    /// Data of one node arrive late.
    #[serde(rename = "data delay")]
    DataDelay,
    /// Power supply problem.
    #[serde(rename = "physical fault")]
    PhysicalFault,
}

/// How a value is held against its limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Relation {
    /// Passes when value <= limit.
    #[serde(rename = "at most")]
    AtMost,
    /// Passes when value >= limit.
    #[serde(rename = "at least")]
    AtLeast,
    /// Passes when value = limit; for counts.
    #[serde(rename = "exactly")]
    Exactly,
}

/// One line of the specification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpecificationRow {
    /// What is limited, in words.
    pub name: String,
    /// How value and limit are compared.
    pub relation: Relation,
    /// The limit, in `unit`.
    pub limit: f64,
    /// Unit of limit and value, empty for counts.
    pub unit: String,
    /// The figure obtained, in `unit`.
    pub value: Option<f64>,
    /// Whether the value keeps the limit; a figure that was not obtained does not.
    pub pass: bool,
}

impl SpecificationRow {
    /// Holds a value against its limit. A value that is not finite fails.
    pub fn new(name: &str, value: f64, relation: Relation, limit: f64, unit: &str) -> Self {
        let pass = match relation {
            Relation::AtMost => value <= limit,
            Relation::AtLeast => value >= limit,
            Relation::Exactly => value == limit,
        };
        let value = output::series::finite(value);
        let (name, unit) = (name.to_owned(), unit.to_owned());
        Self {
            name,
            relation,
            limit,
            unit,
            value,
            pass: pass && value.is_some(),
        }
    }
}

/// The static test of one node on one axis (paper Table II).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StaticRow {
    /// Chain in use.
    pub mode: Mode,
    /// Axis under test.
    pub axis: Axis,
    /// Node, 1 or 2.
    pub node: u8,
    /// On knots or at random angles.
    pub angles: Angles,
    /// Root mean square error; the median of the units.
    pub rmse_deg: Option<f64>,
    /// Greatest absolute error of any unit.
    pub max_deg: Option<f64>,
    /// Mean absolute difference between the nodes; the same on both nodes' rows.
    pub mean_node_difference_deg: Option<f64>,
    /// Cross-check warnings during this test, all units together; the same on both nodes' rows.
    pub warnings: u64,
}

/// The dynamic test of one node on one axis (paper Table III).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DynamicRow {
    /// Chain in use.
    pub mode: Mode,
    /// Axis under test.
    pub axis: Axis,
    /// Node, 1 or 2.
    pub node: u8,
    /// Distance of the sensor from the motor's axis, cm.
    pub lever_arm_cm: u32,
    /// Root mean square error against the reference at the instant of arrival.
    pub rmse_deg: Option<f64>,
    /// The same, against the reference at the instant of arrival less `latency_ms`.
    pub rmse_aligned_deg: Option<f64>,
    /// Latency that the chain declares, ms.
    pub latency_ms: Option<f64>,
    /// Greatest absolute error as it arrives.
    pub max_deg: Option<f64>,
    /// Greatest absolute error, aligned.
    pub max_aligned_deg: Option<f64>,
    /// Mean absolute difference between the nodes; the same on both nodes' rows.
    pub mean_node_difference_deg: Option<f64>,
    /// Cross-check warnings during this test, all units together; the same on both nodes' rows.
    pub warnings: u64,
}

/// One day on the excavator in one mode.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WeekRow {
    /// Chain and cross-check in use.
    pub mode: Mode,
    /// Day, from 1.
    pub day: u32,
    /// Hours worked that day.
    pub hours: f64,
    /// Compared pairs whose difference passed the threshold.
    pub warnings: u64,
    /// Times that the machine was stopped.
    pub stops: u64,
    /// Faults declared, that is errors shown to the user (paper Fig 20).
    pub faults: u64,
    /// How the day's faults ended.
    pub outcome: Outcome,
}

/// The one-axis 360 degree instrument, product mode.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OneAxisRow {
    /// Node, 1 or 2.
    pub node: u8,
    /// Number of angles tried, all units together.
    pub angle_count: u64,
    /// Root mean square error; the median of the units.
    pub rmse_deg: Option<f64>,
    /// Greatest absolute error of any unit.
    pub max_deg: Option<f64>,
}

/// Calibration of one node and the verification round after it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibrationRow {
    /// Chain that was calibrated.
    pub mode: Mode,
    /// Node, 1 or 2.
    pub node: u8,
    /// Residual of the fit, both axes; the largest of the units; none for a table.
    pub residual_deg: Option<f64>,
    /// Condition figure of the fit, no unit; the largest of the units; none for a table.
    pub condition: Option<f64>,
    /// Greatest absolute error of the verification round, both axes; the largest of the units.
    pub verification_max_deg: Option<f64>,
    /// Tolerance of the verification round.
    pub tolerance_deg: f64,
    /// Calibration rounds that were needed; 1 when the first was good.
    pub rounds: u32,
    /// Whether the last round kept the tolerance.
    pub accepted: bool,
}

/// One line of the paper's Table I, provoked on purpose.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Table1Row {
    /// Cross-check in use.
    pub mode: Mode,
    /// What was provoked.
    pub error_type: ErrorType,
    /// Warnings before the stop.
    pub warnings: u64,
    /// Length of the stop, s.
    pub stop_s: f64,
    /// Difference between the nodes after the stop.
    pub delta_after_stop_deg: Option<f64>,
    /// What the cross-check concluded.
    pub outcome: Outcome,
    /// Whether that is what Table I asks for.
    pub as_expected: bool,
}

/// A curve of one node over the angle or over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// Chain in use.
    pub mode: Mode,
    /// Axis under test.
    pub axis: Axis,
    /// Node, 1 or 2; none where the curve is of both.
    pub node: Option<u8>,
    /// `[angle in degrees, value in degrees]`.
    pub points: Vec<Point>,
}

/// What one node said during the dynamic test.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeTrace {
    /// Node, 1 or 2.
    pub node: u8,
    /// `[time s, angle]` as it arrives.
    pub angle: Vec<Point>,
    /// `[time s, angle - reference]` as it arrives.
    pub error: Vec<Point>,
    /// `[time s, angle - reference]` aligned by the declared latency.
    pub error_aligned: Vec<Point>,
}

/// The first seconds of the dynamic test on one axis, lever arm 0 (paper Fig 17, 18).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DynamicTrace {
    /// Chain in use.
    pub mode: Mode,
    /// Axis under test.
    pub axis: Axis,
    /// `[time s, angle of the motor]`.
    pub reference: Vec<Point>,
    /// Both nodes.
    pub nodes: Vec<NodeTrace>,
}

/// Difference between the nodes over one day (paper Fig 21).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DeltaTrace {
    /// Cross-check in use.
    pub mode: Mode,
    /// Day, from 1.
    pub day: u32,
    /// `[time s, least, greatest]` of node 1 - node 2, at most 600 bins.
    pub bins: Vec<Bin>,
}

/// What the charts are drawn from. Fig 20 is drawn from `week`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Figures {
    /// Fig 14 (X) and 15 (Y): angle - reference over the reference angle, on the 10 deg knots.
    pub static_error: Vec<Curve>,
    /// Fig 16: node 1 - node 2 over the reference angle.
    pub static_delta: Vec<Curve>,
    /// Fig 17 (X) and 18 (Y).
    pub dynamic: Vec<DynamicTrace>,
    /// Fig 21.
    pub delta: Vec<DeltaTrace>,
}

/// Everything `plumb demo` found; the content of `report.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DemoReport {
    /// Always [`FORMAT`].
    pub format: String,
    /// Always [`VERSION`].
    pub version: u32,
    /// Version of the program.
    pub plumb_version: String,
    /// Seed of every random draw.
    pub seed: u64,
    /// Number of virtual instruments.
    pub units: u32,
    /// Days on the excavator.
    pub days: u32,
    /// Whether product mode keeps every line of the specification.
    pub within_specification: bool,
    /// The specification, line by line.
    pub specification: Vec<SpecificationRow>,
    /// Table II.
    #[serde(rename = "static")]
    pub static_test: Vec<StaticRow>,
    /// Table III.
    pub dynamic: Vec<DynamicRow>,
    /// The excavator week.
    pub week: Vec<WeekRow>,
    /// The 360 degree instrument.
    pub one_axis: Vec<OneAxisRow>,
    /// Calibration and verification round.
    pub calibration: Vec<CalibrationRow>,
    /// Table I.
    pub table1: Vec<Table1Row>,
    /// What the charts are drawn from.
    pub figures: Figures,
}

impl DemoReport {
    /// A report with its specification judged and everything else still empty. A report without
    /// any specification line is not within specification.
    pub fn new(seed: u64, units: u32, days: u32, specification: Vec<SpecificationRow>) -> Self {
        let pass = !specification.is_empty() && specification.iter().all(|row| row.pass);
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            plumb_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed,
            units,
            days,
            within_specification: pass,
            specification,
            ..Self::default()
        }
    }

    /// The static test of one node.
    pub fn static_row(
        &self,
        mode: Mode,
        axis: Axis,
        angles: Angles,
        node: u8,
    ) -> Option<&StaticRow> {
        let wanted = (mode, axis, angles, node);
        let mut rows = self.static_test.iter();
        rows.find(|row| (row.mode, row.axis, row.angles, row.node) == wanted)
    }

    /// The dynamic test of one node at one lever arm.
    pub fn dynamic_row(&self, mode: Mode, axis: Axis, arm: u32, node: u8) -> Option<&DynamicRow> {
        let wanted = (mode, axis, arm, node);
        let mut rows = self.dynamic.iter();
        rows.find(|row| (row.mode, row.axis, row.lever_arm_cm, row.node) == wanted)
    }
}

/// The serialised word of an enum, for tables: they have the same words as `report.json`.
pub fn word<T: Serialize>(value: T) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(text)) => text,
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use output::check::as_written;
    use serde_json::Value;

    use super::super::sample;
    use super::*;

    #[test]
    fn the_keys_and_words_that_the_issue_names_are_there() {
        let value = as_written(&sample::demo());
        assert_eq!(value["format"], "plumb-report");
        assert_eq!(value["version"], 1);
        assert_eq!(value["within_specification"], true);
        let row = &value["static"][0];
        assert_eq!(row["mode"], "paper");
        assert_eq!(row["axis"], "x");
        assert_eq!(row["node"], 1);
        assert_eq!(row["angles"], "knots");
        assert!(row["rmse_deg"].is_number() && row["max_deg"].is_number());
        assert!(row["mean_node_difference_deg"].is_number());
        let row = &value["dynamic"][0];
        assert!(row["lever_arm_cm"].is_u64() && row["rmse_deg"].is_number());
        assert!(row["rmse_aligned_deg"].is_number() && row["latency_ms"].is_number());
        let outcome = &value["week"][4]["outcome"];
        assert_eq!(outcome, "physical fault, supply checked and reset");
    }

    #[test]
    fn a_number_that_is_not_finite_is_written_as_null() {
        let mut report = sample::demo();
        report.static_test[0].rmse_deg = Some(f64::NAN);
        report.dynamic[0].latency_ms = Some(f64::INFINITY);
        let value = as_written(&report);
        // An index gives null for a field that is missing as well.
        assert_eq!(value["static"][0].get("rmse_deg"), Some(&Value::Null));
        assert_eq!(value["dynamic"][0].get("latency_ms"), Some(&Value::Null));
    }

    #[test]
    fn the_specification_decides_the_verdict() {
        let row = |value, relation, limit| SpecificationRow::new("r", value, relation, limit, "");
        assert!(row(0.04, Relation::AtMost, 0.04).pass);
        assert!(!row(0.0401, Relation::AtMost, 0.04).pass);
        assert!(row(1.0, Relation::AtLeast, 1.0).pass);
        assert!(!row(0.0, Relation::Exactly, 1.0).pass);
        let unknown = row(f64::NAN, Relation::AtMost, 1.0);
        assert!(!unknown.pass && unknown.value.is_none());
        assert!(!row(f64::INFINITY, Relation::AtLeast, 1.0).pass);
        let good = row(0.0, Relation::AtMost, 1.0);
        assert!(DemoReport::new(1, 1, 7, vec![good.clone()]).within_specification);
        assert!(!DemoReport::new(1, 1, 7, vec![good, unknown]).within_specification);
        assert!(!DemoReport::new(1, 1, 7, Vec::new()).within_specification);
    }

    #[test]
    fn words_are_those_of_the_json() {
        assert_eq!(word(Mode::Product), "product");
        assert_eq!(word(Outcome::DataDelay), "data delay, resumed");
        assert_eq!(word(3), "");
    }
}
