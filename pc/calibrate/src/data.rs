//! The calibration report as data: what report.json holds and the page shows.
//!
//! In: figures of a calibration. Out: a structure that turns into JSON; every key is explained in
//! docs/calibration-report.md. What is not known is `null`, with a reason where there is one.
//!
//! Left out: judging, fitting, and the two other forms of the report (`page`, `dcc`).

use std::time::{SystemTime, UNIX_EPOCH};

use chrono::{DateTime, SecondsFormat};
use serde::Serialize;

use super::presented::Presented;

/// Name of the format.
pub const FORMAT: &str = "plumb-calibrate";

/// Its version.
pub const VERSION: u32 = 1;

/// How the calibration was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// A motor turned the housing; parameters were fitted on the host.
    Motor,
    /// A motor turned the housing; the nodes made tables of their own (the paper's procedure).
    MotorTables,
    /// A person put the housing down in poses.
    ByHand,
    /// A chamber took the instrument through temperatures: offset and gain as quadratics.
    ChamberQuadratic,
    /// The same level, by the paper's eq 6.
    ChamberPiecewise,
}

/// The reference and what is known of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reference {
    /// What it is, as it names itself.
    pub name: String,
    /// Its standard uncertainty (k = 1).
    pub standard_uncertainty_deg: Option<f64>,
    /// Where that comes from, and what the reference cannot tell.
    pub statement: String,
}

/// The surroundings.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Environment {
    /// Lowest temperature that a sensor told.
    pub sensor_min_degc: Option<f64>,
    /// Highest temperature that a sensor told.
    pub sensor_max_degc: Option<f64>,
    /// What was not measured.
    pub statement: String,
}

/// Whether the instrument is within its tolerance, and by which rule.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Decision {
    /// Largest error that is accepted, the expanded uncertainty included.
    pub tolerance_deg: f64,
    /// The rule in words.
    pub rule: String,
    /// Whether it was kept.
    pub accepted: bool,
    /// The largest error without sign, of any channel as left.
    pub largest_error_deg: Option<f64>,
}

/// One angle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// X or Y.
    pub axis: String,
    /// The reference's angle.
    pub reference_deg: f64,
    /// What the channel read.
    pub reading_deg: Option<f64>,
    /// Reading less reference.
    pub error_deg: Option<f64>,
    /// Reason of 2025h where it read nothing.
    pub reason: Option<u8>,
}

/// One pose of a calibration by hand.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pose {
    /// How the housing lay.
    pub words: String,
    /// Length of the calibrated vector less 1 g.
    pub length_error_mg: f64,
    /// What the channel read as found, X and Y.
    pub as_found_deg: [Option<f64>; 2],
    /// The same vector with the calibration as left.
    pub as_left_deg: [f64; 2],
}

/// One contribution to the uncertainty.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Contribution {
    /// What it is.
    pub name: String,
    /// A: from the scatter of readings; B: from elsewhere.
    pub evaluation: String,
    /// Its standard uncertainty (k = 1).
    pub standard_uncertainty_deg: f64,
    /// Where it comes from.
    pub source: String,
}

/// One coefficient of a temperature model, or of a gyroscope.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coefficient {
    /// What it is.
    pub name: String,
    /// x, y or z of the sensor; of a gyroscope's scale and alignment those of the housing.
    pub axis: String,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: String,
    /// Its expanded uncertainty (k = 2), where this calibration has found it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expanded: Option<f64>,
}

/// A turn that could not be used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Its number, from 1.
    pub turn: u32,
    /// Why.
    pub why: String,
}

/// The turns by which a gyroscope was calibrated, or was to be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Turns {
    /// Turns that were used.
    pub used: u32,
    /// The others.
    pub left_out: Vec<LeftOut>,
    /// Why the gyroscope keeps the correction that it had; none where it has a new one.
    pub refused: Option<String>,
    /// Root mean square of what the fit leaves in one direction of a turn's end.
    pub turns_residual_deg: Option<f64>,
    /// How far turns that took no part in the fit end from where it leads, at most; none where no
    /// turn was kept out.
    pub check_deg: Option<f64>,
    /// Axes of the sensor about which the housing was hardly turned: their gains are as before.
    pub open_axes: Vec<String>,
}

/// One dwell of a chamber run, of one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ThermalDwell {
    /// Run, from 1.
    pub run: u32,
    /// Branch of the hysteresis: start, up or down.
    pub branch: String,
    /// What the chamber was asked for.
    pub set_degc: f64,
    /// What it stated of its air.
    pub air_degc: Option<f64>,
    /// What the sensor told, mean of the orientations.
    pub sensor_degc: f64,
    /// What the model leaves on x, y and z, mean of the orientations.
    pub residuals_mg: [f64; 3],
    /// The largest of them without sign, of any orientation.
    pub largest_mg: f64,
    /// How often the dwell was begun anew because a node had restarted or was commanded.
    pub repeated: u32,
}

/// What a chamber run has told of one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Thermal {
    /// quadratic or piecewise.
    pub model: String,
    /// The lowest temperature that the sensor told: the model holds from here on.
    pub sensor_min_degc: f64,
    /// The highest: it holds up to here.
    pub sensor_max_degc: f64,
    /// Where the angles are those of before; none where there was a model before.
    pub unchanged_at_degc: Option<f64>,
    /// The model.
    pub coefficients: Vec<Coefficient>,
    /// Root mean square of what the readings would differ by without it.
    pub without_model_mg: f64,
    /// What both branches of the hysteresis are apart, at most, half of it, on x, y and z.
    pub hysteresis_mg: Option<[f64; 3]>,
    /// Root mean square of the difference between runs.
    pub between_runs_mg: Option<f64>,
    /// The dwells.
    pub dwells: Vec<ThermalDwell>,
    /// The bias of the gyroscope; none where there is no gyroscope.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyroscope_bias: Option<GyroscopeBias>,
    /// The scale of the gyroscope over temperature; none where no turn was followed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyroscope_scale: Option<GyroscopeScale>,
}

/// How the bias of a gyroscope over temperature was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GyroscopeBias {
    /// Rests that went into it.
    pub rests: u32,
    /// Rests that did not: their dwells were not followed whole.
    pub rests_left_out: u32,
    /// Root mean square of what it leaves at a rest.
    pub bias_residual_deg_s: Option<f64>,
    /// Half the difference of both branches of each axis, at most; none where no temperature was
    /// met on both.
    pub bias_hysteresis_deg_s: Option<[f64; 3]>,
    /// Root mean square of the difference between runs; none of a single one.
    pub bias_between_runs_deg_s: Option<f64>,
    /// Why the gyroscope keeps the bias that it had; none where it has a new one.
    pub refused: Option<String>,
}

/// Turns of a chamber run that could not be used for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TurnsLeftOut {
    /// Why.
    pub why: String,
    /// How many they are.
    pub turns: u32,
}

/// How the scale of a gyroscope over temperature was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GyroscopeScale {
    /// Turns that were used.
    pub used: u32,
    /// The others.
    pub left_out: Vec<TurnsLeftOut>,
    /// Root mean square of what the fit leaves in one direction of a turn's end.
    pub scale_residual_deg: Option<f64>,
    /// Axes of the sensor about which the housing was hardly turned: their slopes are as before.
    pub open_axes: Vec<String>,
    /// Why the gyroscope keeps the slopes that it had; none where it has new ones.
    pub refused: Option<String>,
}

/// One channel.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Channel {
    /// A or B.
    pub channel: String,
    /// Node-id at the calibration.
    pub node: u8,
    /// 1018h sub 4.
    pub serial_number: u32,
    /// 1018h sub 2.
    pub product_code: u32,
    /// 100Ah.
    pub software: String,
    /// 2062h sub 2.
    pub kind: u8,
    /// Whether it had a calibration of its own before.
    pub calibrated_before: bool,
    /// 2062h sub 1 as found, eight hexadecimal digits.
    pub as_found_crc32: String,
    /// 2062h sub 1 as left, eight hexadecimal digits.
    pub as_left_crc32: String,
    /// Slopes that the node does not show as measured: a calibration changes none of it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub presented: Vec<Presented>,
    /// Lowest temperature for which the uncertainty that the channel states holds as left.
    pub span_min_degc: Option<f64>,
    /// The highest.
    pub span_max_degc: Option<f64>,
    /// Condition figure of the fit; none where the node made tables.
    pub condition: Option<f64>,
    /// Root mean square of what the fit leaves.
    pub residual_deg: Option<f64>,
    /// The same of gravity's length, by hand, or of the temperature model, by a chamber.
    pub residual_mg: Option<f64>,
    /// Readings before anything was changed.
    pub as_found: Vec<Point>,
    /// What the fit leaves at each stand: its error is the residual.
    pub residuals: Vec<Point>,
    /// Readings of the verification round, at other angles.
    pub as_left: Vec<Point>,
    /// Poses, by hand.
    pub poses: Vec<Pose>,
    /// By a chamber: the temperature model.
    pub thermal: Option<Thermal>,
    /// What the calibration as left has of a gyroscope; none where it has none.
    pub gyroscope: Option<Vec<Coefficient>>,
    /// The turns for it; none where nothing was turned for a gyroscope.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyroscope_turns: Option<Turns>,
    /// Uncertainty of the errors as left.
    pub uncertainty: Vec<Contribution>,
    /// All of it together, k = 1.
    pub combined_uncertainty_deg: f64,
    /// The same with k = 2.
    pub expanded_uncertainty_deg: f64,
}

/// Both channels at one angle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// X or Y.
    pub axis: String,
    /// The reference's angle.
    pub reference_deg: f64,
    /// A less B.
    pub difference_deg: Option<f64>,
}

/// What the faces of the housing have told, by hand.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Faces {
    /// Tilt of the surface under the base.
    pub base_surface_deg: f64,
    /// Tilt of the surface under the side.
    pub side_surface_deg: f64,
    /// What the side is off the right angle to the base.
    pub off_square_deg: f64,
    /// Angle left between the channels, root mean square over the poses.
    pub between_channels_deg: f64,
}

/// The whole report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// "plumb-calibrate".
    pub format: String,
    /// 1.
    pub version: u32,
    /// Release of the program.
    pub plumb_version: String,
    /// Name of this report, different for each.
    pub identifier: String,
    /// How.
    pub method: Method,
    /// Begin, UTC, ISO 8601.
    pub begun_utc: String,
    /// End, the same.
    pub ended_utc: String,
    /// Who calibrated, as given.
    pub laboratory: Option<String>,
    /// Who stood at the bench, as given.
    pub operator: Option<String>,
    /// For whom, as given.
    pub customer: Option<String>,
    /// The bus.
    pub bus: String,
    /// The reference.
    pub reference: Reference,
    /// The surroundings.
    pub environment: Environment,
    /// The verdict.
    pub decision: Decision,
    /// The channels, A first.
    pub channels: Vec<Channel>,
    /// A less B as found.
    pub difference_as_found: Vec<Difference>,
    /// A less B as left.
    pub difference_as_left: Vec<Difference>,
    /// By hand: what the faces have told.
    pub faces: Option<Faces>,
    /// SHA-256 of dcc.xml, which 2063h of each channel holds; none when the calibration was not
    /// accepted.
    pub dcc_sha256: Option<String>,
}

impl Point {
    /// What was read at an angle of the reference, or the reason why nothing was.
    pub fn new(axis: &str, reference_deg: f64, reading_deg: Result<f64, u8>) -> Self {
        Self {
            axis: axis.to_owned(),
            reference_deg,
            reading_deg: reading_deg.ok(),
            error_deg: reading_deg.ok().map(|read| read - reference_deg),
            reason: reading_deg.err(),
        }
    }
}

impl Channel {
    /// The largest error as left without sign.
    pub fn largest_error_deg(&self) -> Option<f64> {
        largest_error_deg(&self.as_left)
    }

    /// What its node adds to the angles that were calibrated, in a sentence; `None` where it shows
    /// them as measured.
    pub fn as_shown(&self) -> Option<String> {
        let all: Vec<_> = self.presented.iter().map(Presented::words).collect();
        (!all.is_empty()).then(|| {
            format!(
                "node {}: {}, from before this calibration, which is of the angles as measured; \
                 zero it again (plumb zero) where it was zeroed",
                self.node,
                all.join(" and ")
            )
        })
    }
}

/// Who or what it is, where it was stated.
pub fn said(text: &Option<String>) -> String {
    text.clone().unwrap_or_else(|| "not stated".to_owned())
}

/// The largest error of these angles without sign; `None` where none was read.
pub fn largest_error_deg(points: &[Point]) -> Option<f64> {
    let errors = points.iter().filter_map(|p| p.error_deg);
    errors.map(f64::abs).reduce(f64::max)
}

impl Report {
    /// At which temperatures the uncertainty that each channel states holds.
    pub fn spans(&self) -> String {
        let each = self.channels.iter().map(|channel| {
            let Channel { channel: name, .. } = channel;
            match (channel.span_min_degc, channel.span_max_degc) {
                (Some(low), Some(high)) => {
                    format!("Channel {name}: from {low:.1} to {high:.1} degC.")
                }
                _ => format!("Channel {name}: at no temperature that both of its runs had."),
            }
        });
        let each = each.collect::<Vec<_>>().join(" ");
        format!(
            "The uncertainty that a channel states with its angles (2022h) holds at these \
             temperatures of its sensor and grows with the distance from them. {each}"
        )
    }
}

impl Contribution {
    /// A contribution by its name, evaluation A or B, size and source.
    pub fn new(name: &str, evaluation: &str, deg: f64, source: &str) -> Self {
        Self {
            name: name.to_owned(),
            evaluation: evaluation.to_owned(),
            standard_uncertainty_deg: deg,
            source: source.to_owned(),
        }
    }

    /// All of them as independent, k = 1.
    pub fn combined_deg(all: &[Self]) -> f64 {
        let squares = all.iter().map(|c| c.standard_uncertainty_deg.powi(2));
        squares.sum::<f64>().sqrt()
    }
}

/// Seconds since 1970, now.
pub fn now() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |time| time.as_secs())
}

/// A day and time, UTC, of seconds since 1970: `2026-11-22T02:17:00Z`; the begin of 1970 for what
/// no calendar has.
pub fn utc(seconds: u64) -> String {
    let seconds = i64::try_from(seconds).unwrap_or_default();
    let time = DateTime::from_timestamp(seconds, 0).unwrap_or_default();
    time.to_rfc3339_opts(SecondsFormat::Secs, true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::assert_documented;

    #[test]
    fn every_key_of_the_report_is_documented() {
        let mut report = crate::sample_report();
        report.faces = Some(Faces {
            base_surface_deg: 0.0,
            side_surface_deg: 0.0,
            off_square_deg: 0.0,
            between_channels_deg: 0.0,
        });
        report.channels[0].poses.push(Pose {
            words: String::new(),
            length_error_mg: 0.0,
            as_found_deg: [None; 2],
            as_left_deg: [0.0; 2],
        });
        report.channels[0].thermal = crate::sample::chamber().channels[0].thermal.clone();
        let gyroscope = crate::gyroscope::of(&crate::sample::rates());
        report.channels[0].gyroscope = Some(gyroscope);
        report.channels[0].gyroscope.as_mut().unwrap()[0].expanded = Some(0.1);
        let thermal = report.channels[0].thermal.as_mut().unwrap();
        thermal.gyroscope_bias = Some(GyroscopeBias {
            rests: 1,
            rests_left_out: 0,
            bias_residual_deg_s: None,
            bias_hysteresis_deg_s: None,
            bias_between_runs_deg_s: None,
            refused: None,
        });
        thermal.gyroscope_scale = Some(GyroscopeScale {
            used: 1,
            left_out: vec![TurnsLeftOut {
                why: String::new(),
                turns: 1,
            }],
            scale_residual_deg: None,
            open_axes: Vec::new(),
            refused: None,
        });
        report.channels[0].gyroscope_turns = Some(Turns {
            used: 1,
            left_out: vec![LeftOut {
                turn: 1,
                why: String::new(),
            }],
            refused: None,
            turns_residual_deg: None,
            check_deg: None,
            open_axes: Vec::new(),
        });
        let page = include_str!("../../../docs/calibration-report.md");
        assert_documented(&report, page, "## report.json");
    }

    #[test]
    fn the_span_of_the_stated_uncertainty_is_told_of_each_channel() {
        let mut report = crate::sample_report();
        report.channels[1].span_min_degc = None;
        let told = report.spans();
        assert!(
            told.contains("Channel A: from 24.0 to 26.5 degC."),
            "{told}"
        );
        assert!(told.contains("Channel B: at no temperature"), "{told}");
        for document in [
            crate::dcc::document(&report, "DE"),
            crate::page::page(&report),
        ] {
            assert!(document.contains("from 24.0 to 26.5 degC"));
        }
    }

    #[test]
    fn days_are_those_of_the_calendar() {
        assert_eq!(utc(0), "1970-01-01T00:00:00Z");
        assert_eq!(utc(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(utc(1_709_251_199), "2024-02-29T23:59:59Z");
        assert_eq!(utc(4_107_542_400), "2100-03-01T00:00:00Z");
        let mut before = utc(0);
        for day in 1..60_000 {
            let next = utc(day * 86_400);
            assert!(next > before, "{next}");
            before = next;
        }
    }
}
