//! What a node's calibration has of a gyroscope, for the report's page and its certificate.
//!
//! In: the [`RateCorrection`] of a calibration as left, and what has come of the turns. Out: its
//! coefficients with their units, a section of the page and a result of the certificate. The
//! uncertainty is stated where this calibration has found it; a calibration does not hold it.
//!
//! Left out: how it was found (`gains`); what was not found comes with the calibration from before.

use tilt::rate::RateCorrection;

use super::data::{Channel, Coefficient, LeftOut, Report, Turns};
use super::gains::{Found, Outcome};
use super::over_temperature::{AXES, coefficients, put_coefficients};
use super::quantity::{self, real};
use super::xml::Xml;
use output::html;

/// Names of coefficients that the turns show.
const SCALE: &str = "Scale";
const SCALE_SLOPE: &str = "Scale, slope";
const SHARE: &str = "Alignment, share of sensor axis ";
const BIAS: &str = "Bias at 25 degC";
const BIAS_SLOPE: &str = "Bias, slope";
const BIAS_SQUARE: &str = "Bias, quadratic";

/// How the coefficients give a rate.
const NOTE: &str = "The rate about an axis of the housing is the sum over the sensor's axes of \
    each one's share times its reading without bias. The share of the axis of the same name is \
    100 % and its scale; the others are the alignment. Bias and scale are those at 25 degC plus \
    their change with the distance from 25 degC.";

/// What is said of the uncertainty where it is not known.
const UNKNOWN: &str = " The calibration holds no uncertainty of them.";

/// What is said of it where there was a chamber.
const IN_CHAMBER: &str = " The expanded uncertainty (k = 2) of the bias and its change is by what \
    the dwells and their orientations leave, that at 25 degC also by the turn of the earth. That \
    of the scale's slope is of the turns between the rests, with gravity by the channel's own \
    accelerometer as the reference; of an axis that the turns do not show it is that of a part as \
    it comes. What has none is as it was found.";

/// What is said of it where there were turns.
const KNOWN: &str = " The expanded uncertainty (k = 2) of scale and alignment is that of the turns \
    between rests, with gravity by the channel's own accelerometer as the reference; of an axis \
    that the turns do not show it is that of a part as it comes. That of the bias is of the rests, \
    at their temperature. What has none is as it was found.";

/// The coefficients in the order of the axes: scale and alignment, then bias.
pub fn of(rates: &RateCorrection) -> Vec<Coefficient> {
    let real = rates.real();
    let mut all = Vec::new();
    for (row, axis) in AXES.iter().enumerate() {
        let mut put = |called: &str, value: f64, unit: &str| {
            all.push(Coefficient {
                name: called.to_owned(),
                axis: (*axis).to_owned(),
                value,
                unit: unit.to_owned(),
                expanded: None,
            });
        };
        put(SCALE, 100.0 * (real.matrix[row][row] - 1.0), "%");
        put(SCALE_SLOPE, 100.0 * real.scale1[row], "%/degC");
        for (column, other) in AXES.iter().enumerate().filter(|(c, _)| *c != row) {
            let called = format!("{SHARE}{other}");
            put(&called, 100.0 * real.matrix[row][column], "%");
        }
        let (b0, b1) = (real.bias[row].to_degrees(), real.bias1[row].to_degrees());
        put(BIAS, b0, "deg/s");
        put(BIAS_SLOPE, 1e3 * b1, "(mdeg/s)/degC");
        let b2 = 1e3 * real.bias2[row].to_degrees();
        put(BIAS_SQUARE, b2, "(mdeg/s)/degC^2");
    }
    all
}

/// Puts into the report what has come of the turns, channel by channel.
pub fn put(report: &mut Report, outcomes: &[Outcome]) {
    for (channel, outcome) in report.channels.iter_mut().zip(outcomes) {
        channel.gyroscope_turns = Some(turns(outcome));
        if let (Ok(found), Some(all)) = (&outcome.found, &mut channel.gyroscope) {
            put_uncertainty(all, found);
        }
    }
}

fn turns(outcome: &Outcome) -> Turns {
    let left_out = outcome.bad.iter().map(|(number, reason)| LeftOut {
        turn: *number as u32,
        why: reason.to_string(),
    });
    let found = outcome.found.as_ref();
    let open = found.map_or([false; 3], |found| found.open);
    let open_axes = AXES.iter().zip(open).filter(|(_, open)| *open);
    Turns {
        used: outcome.used as u32,
        left_out: left_out.collect(),
        refused: found.err().map(ToString::to_string),
        turns_residual_deg: found.ok().map(|found| found.gains.residual_rms_deg),
        check_deg: found.ok().and_then(|found| found.check_deg),
        open_axes: open_axes.map(|(axis, _)| (*axis).to_owned()).collect(),
    }
}

/// U of each coefficient that was found.
fn put_uncertainty(all: &mut [Coefficient], found: &Found) {
    for coefficient in all {
        let axis = AXES.iter().position(|axis| *axis == coefficient.axis);
        let row = axis.unwrap_or(0);
        let share = coefficient.name.strip_prefix(SHARE);
        let column = share.and_then(|other| AXES.iter().position(|axis| *axis == other));
        let gain = |column: usize| 100.0 * found.gains.uncertainty[row][column];
        let u = match (coefficient.name.as_str(), column) {
            (SCALE, _) => Some(gain(row)),
            (BIAS, _) => Some(found.bias.uncertainty[row].to_degrees()),
            (_, Some(column)) => Some(gain(column)),
            _ => None,
        };
        coefficient.expanded = u.map(|u| 2.0 * u);
    }
}

/// U of the bias over the temperatures of a chamber run, from the standard uncertainties of b0, b1
/// and b2 of each axis, in rad/s and degC.
pub fn put_bias_uncertainty(all: &mut [Coefficient], uncertainty: &[[f64; 3]; 3]) {
    for (axis, [b0, b1, b2]) in AXES.iter().zip(uncertainty) {
        for coefficient in all.iter_mut().filter(|c| c.axis == *axis) {
            let u = match coefficient.name.as_str() {
                BIAS => b0.to_degrees(),
                BIAS_SLOPE => 1e3 * b1.to_degrees(),
                BIAS_SQUARE => 1e3 * b2.to_degrees(),
                _ => continue,
            };
            coefficient.expanded = Some(2.0 * u);
        }
    }
}

/// U of the slope of each axis' scale, from its standard uncertainty, 1 per degC.
pub fn put_slope_uncertainty(all: &mut [Coefficient], uncertainty: [f64; 3]) {
    for (axis, u) in AXES.iter().zip(uncertainty) {
        let slope = |c: &&mut Coefficient| c.axis == *axis && c.name == SCALE_SLOPE;
        for coefficient in all.iter_mut().filter(slope) {
            coefficient.expanded = Some(2.0 * 100.0 * u);
        }
    }
}

/// A line about each gyroscope.
pub fn figures(report: &Report) -> String {
    let mut text = String::new();
    for channel in &report.channels {
        let letter = &channel.channel;
        let Some(turns) = &channel.gyroscope_turns else {
            continue;
        };
        text += &match &turns.refused {
            Some(refused) => {
                format!("gyroscope {letter}: NOT calibrated, as it was: {refused}\n")
            }
            None => format!(
                "gyroscope {letter}: {} turns, U of its gains {:.2} % (k = 2){}\n",
                turns.used,
                largest_gain(channel),
                match &turns.open_axes[..] {
                    [] => String::new(),
                    open => format!("; not turned enough about axis {}", open.join(", ")),
                }
            ),
        };
    }
    text
}

/// The largest U of the gains that the turns show, %.
fn largest_gain(channel: &Channel) -> f64 {
    let open = channel.gyroscope_turns.iter().flat_map(|t| &t.open_axes);
    let open: Vec<&String> = open.collect();
    let shown = |c: &&Coefficient| {
        let of = c.name.strip_prefix(SHARE).unwrap_or(&c.axis);
        c.unit == "%" && !open.iter().any(|open| *open == of)
    };
    let all = channel.gyroscope.iter().flatten().filter(shown);
    all.filter_map(|c| c.expanded).fold(0.0, f64::max)
}

/// The section of the page; empty where no channel has a gyroscope.
pub fn page(report: &Report) -> String {
    let mut out = String::new();
    for channel in &report.channels {
        if let Some(turns) = &channel.gyroscope_turns {
            let title = format!("Turns for the gyroscope of channel {}", channel.channel);
            out += &format!("<h3>{}</h3>\n", html::escape(&title));
            out += &html::facts(&facts(turns));
        }
        if let Some(gyroscope) = &channel.gyroscope {
            let title = format!("Gyroscope of channel {}", channel.channel);
            out += &html::table(&coefficients(&title, gyroscope));
        }
    }
    match out.is_empty() {
        true => out,
        false => html::paragraph(&(NOTE.to_owned() + note(&report.channels))) + &out,
    }
}

fn note(channels: &[Channel]) -> &'static str {
    let all = channels.iter().flat_map(|c| c.gyroscope.iter().flatten());
    match all.map(|c| c.expanded).any(|u| u.is_some()) {
        true if channels.iter().any(|c| c.thermal.is_some()) => IN_CHAMBER,
        true => KNOWN,
        false => UNKNOWN,
    }
}

fn facts(turns: &Turns) -> Vec<(&'static str, String)> {
    let deg = |value: Option<f64>| value.map_or("none".to_owned(), |deg| format!("{deg:.3} deg"));
    let mut facts = vec![("Turns used", turns.used.to_string())];
    if let Some(refused) = &turns.refused {
        facts.push((
            "Not calibrated",
            format!("{refused}; its correction is as it was found"),
        ));
    } else {
        facts.push((
            "Left by the fit in one direction, rms",
            deg(turns.turns_residual_deg),
        ));
        facts.push(("Turns that check it, largest error", deg(turns.check_deg)));
    }
    if !turns.open_axes.is_empty() {
        facts.push((
            "Axes not turned, gains as before",
            turns.open_axes.join(", "),
        ));
    }
    for left in &turns.left_out {
        facts.push(("Left out", format!("turn {}: {}", left.turn, left.why)));
    }
    facts
}

/// The result of the certificate.
pub fn result(xml: &mut Xml, gyroscope: &[Coefficient]) {
    let what = "Gyroscope, as stored in the calibration as left";
    quantity::result_of(xml, what, |xml| put_coefficients(xml, gyroscope));
}

/// The result about the turns.
pub fn turns_result(xml: &mut Xml, turns: &Turns) {
    let refused = turns.refused.as_ref();
    let what = refused.map_or("Turns for the gyroscope".to_owned(), |refused| {
        format!("Turns for the gyroscope, which is as it was found: {refused}")
    });
    let left = "Left by the fit in one direction of a turn's end, rms";
    let largest = "Largest error of the turns that check the fit";
    quantity::result_of(xml, &what, |xml| {
        real(xml, "Turns used", f64::from(turns.used), "\\one");
        for (what, deg) in [(left, turns.turns_residual_deg), (largest, turns.check_deg)] {
            if let Some(deg) = deg {
                real(xml, what, deg, "\\degree");
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{GyroscopeScale, TurnsLeftOut};
    use crate::{dcc, page as whole_page, sample};

    fn value(all: &[Coefficient], name: &str, axis: &str) -> (f64, String) {
        let mut here = all.iter().filter(|c| c.name == name && c.axis == axis);
        let found = here.next().unwrap();
        assert_eq!(here.count(), 0, "{name} {axis}");
        (found.value, found.unit.clone())
    }

    #[test]
    fn each_number_of_the_calibration_has_its_name_its_axis_and_its_unit() {
        let all = of(&sample::rates());
        assert_eq!(all.len(), 9 + 4 * 3);
        for (name, axis, expected, unit) in [
            ("Scale", "x", 1.0, "%"),
            ("Scale", "z", -0.5, "%"),
            ("Scale, slope", "y", 0.01, "%/degC"),
            ("Alignment, share of sensor axis z", "y", 0.25, "%"),
            ("Alignment, share of sensor axis x", "z", -0.125, "%"),
            ("Bias at 25 degC", "x", 0.5, "deg/s"),
            ("Bias, slope", "z", -4.0, "(mdeg/s)/degC"),
            ("Bias, quadratic", "y", 0.02, "(mdeg/s)/degC^2"),
        ] {
            let (value, found) = value(&all, name, axis);
            assert!((value - expected).abs() < 1e-5, "{name} {axis}: {value}");
            assert_eq!(found, unit);
        }
    }

    #[test]
    fn page_and_certificate_state_it_where_there_is_a_gyroscope_only() {
        let without = sample::report();
        let mut with = without.clone();
        with.channels[1].gyroscope = Some(of(&sample::rates()));
        let told = |report: &Report| (whole_page::page(report), dcc::document(report, "IT"));
        let (page, certificate) = told(&with);
        output::check::assert_balanced(&page);
        output::check::assert_stands_alone(&page);
        assert!(
            page.contains("Gyroscope of channel B") && !page.contains("Gyroscope of channel A")
        );
        let called = "Bias at 25 degC, axis x, in deg/s";
        assert!(certificate.contains(called) && certificate.contains("0.500000"));
        assert_eq!(certificate.matches(called).count(), 1);
        let (page, certificate) = told(&without);
        assert!(!page.contains("yroscope") && !certificate.contains("yroscope"));
    }

    #[test]
    fn page_and_certificate_state_what_has_come_of_the_turns_in_a_chamber() {
        let mut report = sample::chamber();
        let mut all = of(&sample::rates());
        put_slope_uncertainty(&mut all, [1e-5, 2e-5, 1e-4]);
        let slopes = all.iter().filter(|c| c.name == SCALE_SLOPE);
        let expanded: Vec<f64> = slopes.map(|c| c.expanded.unwrap()).collect();
        for (found, expected) in expanded.iter().zip([0.002, 0.004, 0.02]) {
            assert!((found - expected).abs() < 1e-12, "{found}");
        }
        assert_eq!(all.iter().filter(|c| c.expanded.is_some()).count(), 3);
        report.channels[0].gyroscope = Some(all);
        let scale = GyroscopeScale {
            used: 45,
            left_out: vec![TurnsLeftOut {
                why: "nobody looked".to_owned(),
                turns: 20,
            }],
            scale_residual_deg: Some(0.031),
            open_axes: vec!["z".to_owned()],
            refused: None,
        };
        let thermal = |place: usize, report: &mut Report, scale| {
            let thermal = report.channels[place].thermal.as_mut();
            thermal.unwrap().gyroscope_scale = Some(scale);
        };
        thermal(0, &mut report, scale.clone());
        let none = GyroscopeScale {
            scale_residual_deg: None,
            refused: Some("nobody knows".to_owned()),
            ..scale
        };
        thermal(1, &mut report, none);
        let page = whole_page::page(&report);
        output::check::assert_balanced(&page);
        for what in [
            "slopes from 45 turns",
            "20: nobody looked",
            "0.031 deg",
            "slopes as before",
            "as it was: nobody knows",
            "of the scale&#39;s slope",
        ] {
            assert!(page.contains(what), "{what}");
        }
        let certificate = dcc::document(&report, "IT");
        for what in [
            "Scale of the gyroscope over temperature",
            "whose slopes are as they were found: nobody knows",
            "Left at the end of a turn, rms",
            "Scale, slope, axis z, in %/degC",
        ] {
            assert!(certificate.contains(what), "{what}");
        }
    }
}
