//! What a node's calibration has of a gyroscope, for the report's page and its certificate.
//!
//! In: the [`RateCorrection`] of a calibration as left. Out: its coefficients with their units, a
//! section of the page and a result of the certificate. No uncertainty is stated: a calibration
//! does not hold it.
//!
//! Left out: how it was found (`tilt::calibration::gyroscope`); what is not written here comes with
//! the calibration from before.

use tilt::rate::RateCorrection;

use super::data::{Coefficient, Report};
use super::over_temperature::{AXES, coefficients, put_coefficients};
use super::quantity::name;
use super::xml::Xml;
use output::html;

/// How the coefficients give a rate.
const NOTE: &str = "The rate about an axis of the housing is the sum over the sensor's axes of \
    each one's share times its reading without bias. The share of the axis of the same name is \
    100 % and its scale; the others are the alignment. Bias and scale are those at 25 degC plus \
    their change with the distance from 25 degC. The calibration holds no uncertainty of them.";

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
            });
        };
        put("Scale", 100.0 * (real.matrix[row][row] - 1.0), "%");
        put("Scale, slope", 100.0 * real.scale1[row], "%/degC");
        for (column, other) in AXES.iter().enumerate().filter(|(c, _)| *c != row) {
            let called = format!("Alignment, share of sensor axis {other}");
            put(&called, 100.0 * real.matrix[row][column], "%");
        }
        let (b0, b1) = (real.bias[row].to_degrees(), real.bias1[row].to_degrees());
        put("Bias at 25 degC", b0, "deg/s");
        put("Bias, slope", 1e3 * b1, "(mdeg/s)/degC");
        let b2 = 1e3 * real.bias2[row].to_degrees();
        put("Bias, quadratic", b2, "(mdeg/s)/degC^2");
    }
    all
}

/// The section of the page; empty where no channel has a gyroscope.
pub fn page(report: &Report) -> String {
    let mut out = String::new();
    for channel in &report.channels {
        if let Some(gyroscope) = &channel.gyroscope {
            let title = format!("Gyroscope of channel {}", channel.channel);
            out += &html::table(&coefficients(&title, gyroscope));
        }
    }
    match out.is_empty() {
        true => out,
        false => html::paragraph(NOTE) + &out,
    }
}

/// The result of the certificate.
pub fn result(xml: &mut Xml, gyroscope: &[Coefficient]) {
    xml.of("dcc:result", |xml| {
        name(xml, "Gyroscope, as stored in the calibration as left");
        xml.of("dcc:data", |xml| put_coefficients(xml, gyroscope));
    });
}

#[cfg(test)]
mod tests {
    use super::*;
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
}
