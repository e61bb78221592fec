//! The calibration report as a Digital Calibration Certificate, PTB's XML format, release 3.2.1.
//!
//! In: a [`Report`]. Out: the document, which is the machine-readable twin of the page. It is a
//! report of whoever made it, and no certificate of an accredited laboratory: it contains this
//! statement, because the format's root has no other name.
//!
//! Left out: the schema, which is PTB's and stays outside, signatures, and translations.

use super::data::{Channel, Difference, Method, Point, Report, said};
use super::gyroscope;
use super::over_temperature;
use super::quantity::{
    METRE_PER_SECOND2, SI_PER_MG, content, list, name, real, result_of, result_of_lists,
};
use super::xml::Xml;

/// The format's root, and its release.
pub const ROOT: &str = "dcc:digitalCalibrationCertificate";
pub const RELEASE: &str = "3.2.1";

/// What the report is and is not.
const NO_CERTIFICATE: &str = "This is a calibration report made with open software. It is not a \
    calibration certificate of an accredited laboratory.";

/// Space for a release as the format's rules want it.
fn release(version: &str) -> String {
    let version = version.trim().trim_start_matches('v');
    format!("v{version}")
}

/// The document. `country` is the two-letter code of where it was made.
pub fn document(report: &Report, country: &str) -> String {
    let mut xml = Xml::new();
    let root = [
        ("xmlns:dcc", "https://ptb.de/dcc"),
        ("xmlns:si", "https://ptb.de/si"),
        ("schemaVersion", RELEASE),
    ];
    xml.element(ROOT, &root, |xml| {
        xml.of("dcc:administrativeData", |xml| {
            administration(xml, report, country);
        });
        xml.of("dcc:measurementResults", |xml| {
            for channel in &report.channels {
                let of = [("refId", item_id(channel))];
                let of = of.each_ref().map(|(key, value)| (*key, value.as_str()));
                xml.element("dcc:measurementResult", &of, |xml| {
                    result(xml, report, channel)
                });
            }
            if !report.difference_as_left.is_empty() {
                let both: Vec<_> = report.channels.iter().map(item_id).collect();
                let of = [("refId", both.join(" "))];
                let of = of.each_ref().map(|(key, value)| (*key, value.as_str()));
                xml.element("dcc:measurementResult", &of, |xml| differences(xml, report));
            }
        });
    });
    xml.finish()
}

/// The name by which results refer to a channel.
fn item_id(channel: &Channel) -> String {
    format!("channel{}", channel.channel)
}

fn description(xml: &mut Xml, text: &str) {
    xml.of("dcc:description", |xml| content(xml, text));
}

fn software(xml: &mut Xml, called: &str, version: &str, kind: &str) {
    xml.of("dcc:software", |xml| {
        name(xml, called);
        xml.text("dcc:release", &[], &release(version));
        xml.text("dcc:type", &[], kind);
    });
}

fn administration(xml: &mut Xml, report: &Report, country: &str) {
    xml.of("dcc:dccSoftware", |xml| {
        software(xml, "plumb", &report.plumb_version, "application");
    });
    xml.of("dcc:coreData", |xml| {
        xml.text("dcc:countryCodeISO3166_1", &[], country);
        xml.text("dcc:usedLangCodeISO639_1", &[], "en");
        xml.text("dcc:mandatoryLangCodeISO639_1", &[], "en");
        xml.text("dcc:uniqueIdentifier", &[], &report.identifier);
        let day = |time: &str| time.split('T').next().unwrap_or_default().to_owned();
        xml.text("dcc:beginPerformanceDate", &[], &day(&report.begun_utc));
        xml.text("dcc:endPerformanceDate", &[], &day(&report.ended_utc));
        xml.text("dcc:performanceLocation", &[], "other");
        xml.text("dcc:issueDate", &[], &day(&report.ended_utc));
    });
    xml.of("dcc:items", |xml| {
        name(xml, "Plumb, a redundant inclinometer");
        report
            .channels
            .iter()
            .for_each(|channel| item(xml, channel));
    });
    xml.of("dcc:calibrationLaboratory", |xml| {
        xml.of("dcc:contact", |xml| {
            contact(xml, &said(&report.laboratory), country)
        });
    });
    xml.of("dcc:respPersons", |xml| {
        xml.of("dcc:respPerson", |xml| {
            xml.of("dcc:person", |xml| name(xml, &said(&report.operator)));
            xml.text("dcc:mainSigner", &[], "true");
        });
    });
    xml.of("dcc:customer", |xml| {
        contact(xml, &said(&report.customer), country)
    });
    xml.of("dcc:statements", |xml| statements(xml, report));
}

fn contact(xml: &mut Xml, called: &str, country: &str) {
    name(xml, called);
    xml.of("dcc:location", |xml| {
        xml.text("dcc:countryCode", &[], country);
    });
}

fn item(xml: &mut Xml, channel: &Channel) {
    xml.element("dcc:item", &[("id", &item_id(channel))], |xml| {
        name(xml, &format!("Channel {}", channel.channel));
        xml.of("dcc:installedSoftwares", |xml| {
            software(xml, "Program of the node", &channel.software, "firmware");
        });
        xml.text("dcc:model", &[], &format!("{:08X}", channel.product_code));
        xml.of("dcc:identifications", |xml| {
            let identities = [
                (
                    "manufacturer",
                    "Serial number",
                    channel.serial_number.to_string(),
                ),
                ("other", "Node-id", channel.node.to_string()),
                (
                    "calibrationLaboratory",
                    "Check sum of the calibration as left (2062h sub 1)",
                    channel.as_left_crc32.clone(),
                ),
            ];
            for (issuer, what, value) in identities {
                xml.of("dcc:identification", |xml| {
                    xml.text("dcc:issuer", &[], issuer);
                    xml.text("dcc:value", &[], &value);
                    name(xml, what);
                });
            }
        });
    });
}

fn statements(xml: &mut Xml, report: &Report) {
    xml.of("dcc:statement", |xml| {
        name(xml, "Status");
        xml.of("dcc:declaration", |xml| content(xml, NO_CERTIFICATE));
    });
    xml.of("dcc:statement", |xml| {
        name(xml, "Decision rule");
        xml.of("dcc:declaration", |xml| content(xml, &report.decision.rule));
        let conformity = if report.decision.accepted {
            "pass"
        } else {
            "fail"
        };
        xml.text("dcc:conformity", &[], conformity);
    });
    xml.of("dcc:statement", |xml| {
        name(xml, "Reference");
        xml.of("dcc:declaration", |xml| {
            content(xml, &report.reference.statement)
        });
    });
    xml.of("dcc:statement", |xml| {
        name(
            xml,
            "Temperatures of the uncertainty that the channels state",
        );
        xml.of("dcc:declaration", |xml| content(xml, &report.spans()));
    });
}

fn method(report: &Report) -> (&'static str, &'static str) {
    match report.method {
        Method::Motor => (
            "Comparison with a motor's angle",
            "The housing was turned about both axes, upwards and downwards; parameters and \
             harmonics were fitted by least squares and verified at other angles.",
        ),
        Method::MotorTables => (
            "Comparison with a motor's angle, tables",
            "The housing was turned about both axes; each node memorised a table of its own, \
             which was verified at other angles.",
        ),
        Method::ByHand => (
            "Length of gravity in poses by hand",
            "The housing was put down in poses. Nine parameters of each channel follow from \
             gravity's length, the zero from two poses on the base turned by 180 deg between.",
        ),
        Method::ChamberQuadratic => (
            "Climatic chamber, four orientations",
            "The instrument was taken through temperatures, up and down, in four orientations at \
             each. Offset and gain of each axis were fitted as quadratics of the sensor's own \
             temperature by least squares.",
        ),
        Method::ChamberPiecewise => (
            "Climatic chamber, level",
            "The instrument was taken through rising temperatures, level. The slopes of each axis \
             between them are those of the sensor's own temperature.",
        ),
    }
}

fn result(xml: &mut Xml, report: &Report, channel: &Channel) {
    name(xml, &format!("Channel {}", channel.channel));
    circumstances(xml, report);
    xml.of("dcc:results", |xml| results(xml, channel));
}

/// How, with what, and under which conditions a result came about.
fn circumstances(xml: &mut Xml, report: &Report) {
    let (called, how) = method(report);
    xml.of("dcc:usedMethods", |xml| {
        xml.of("dcc:usedMethod", |xml| {
            name(xml, called);
            description(xml, how);
        });
    });
    xml.of("dcc:usedSoftware", |xml| {
        software(xml, "plumb", &report.plumb_version, "application");
    });
    xml.of("dcc:measuringEquipments", |xml| {
        xml.of("dcc:measuringEquipment", |xml| {
            name(xml, &report.reference.name);
            description(xml, &report.reference.statement);
        });
    });
    let environment = &report.environment;
    let temperatures = [
        (
            "Lowest temperature of the sensors",
            environment.sensor_min_degc,
        ),
        (
            "Highest temperature of the sensors",
            environment.sensor_max_degc,
        ),
    ];
    if temperatures.iter().any(|(_, t)| t.is_some()) {
        xml.of("dcc:influenceConditions", |xml| {
            for (what, t) in temperatures {
                let Some(t) = t else { continue };
                xml.of("dcc:influenceCondition", |xml| {
                    name(xml, what);
                    description(xml, &environment.statement);
                    xml.of("dcc:data", |xml| real(xml, what, t, "\\degreecelsius"));
                });
            }
        });
    }
}

fn results(xml: &mut Xml, channel: &Channel) {
    let u = channel.expanded_uncertainty_deg;
    for (what, points) in [
        ("As found", &channel.as_found),
        ("As left", &channel.as_left),
    ] {
        for axis in ["X", "Y"] {
            points_of(xml, &format!("{what}, slope {axis}"), axis, points, u);
        }
    }
    if !channel.poses.is_empty() {
        let mg: Vec<f64> = channel.poses.iter().map(|p| p.length_error_mg).collect();
        let si: Vec<f64> = mg.iter().map(|mg| mg * SI_PER_MG).collect();
        result_of_lists(xml, "Length of gravity less 1 g, by pose", |xml| {
            list(xml, "Length", &si, METRE_PER_SECOND2, None);
        });
    }
    if let Some(thermal) = &channel.thermal {
        over_temperature::results(xml, thermal);
    }
    if let Some(gyroscope) = &channel.gyroscope {
        gyroscope::result(xml, gyroscope);
    }
    if let Some(turns) = &channel.gyroscope_turns {
        gyroscope::turns_result(xml, turns);
    }
    result_of(xml, "Uncertainty of an angle as left, k = 1", |xml| {
        for one in &channel.uncertainty {
            real(xml, &one.name, one.standard_uncertainty_deg, DEGREE);
        }
        real(xml, "Combined", channel.combined_uncertainty_deg, DEGREE);
    });
}

/// The units, as the format writes them (SIunitx).
const DEGREE: &str = "\\degree";
fn points_of(xml: &mut Xml, what: &str, axis: &str, points: &[Point], u_deg: f64) {
    let there: Vec<_> = points
        .iter()
        .filter(|p| p.axis == axis)
        .filter_map(|p| Some((p.reference_deg, p.reading_deg?, p.error_deg?)))
        .collect();
    if there.is_empty() {
        return;
    }
    let column = |of: fn(&(f64, f64, f64)) -> f64| there.iter().map(of).collect::<Vec<_>>();
    result_of_lists(xml, what, |xml| {
        list(xml, "Reference", &column(|p| p.0), DEGREE, None);
        list(xml, "Reading", &column(|p| p.1), DEGREE, None);
        list(xml, "Error", &column(|p| p.2), DEGREE, Some(u_deg));
    });
}

fn differences(xml: &mut Xml, report: &Report) {
    name(xml, "Channel A less channel B");
    circumstances(xml, report);
    xml.of("dcc:results", |xml| {
        for (what, all) in [
            ("As found", &report.difference_as_found),
            ("As left", &report.difference_as_left),
        ] {
            for axis in ["X", "Y"] {
                difference(xml, &format!("{what}, slope {axis}"), axis, all);
            }
        }
    });
}

fn difference(xml: &mut Xml, what: &str, axis: &str, all: &[Difference]) {
    let there: Vec<_> = all
        .iter()
        .filter(|d| d.axis == axis)
        .filter_map(|d| Some((d.reference_deg, d.difference_deg?)))
        .collect();
    if there.is_empty() {
        return;
    }
    let (at, difference): (Vec<f64>, Vec<f64>) = there.into_iter().unzip();
    result_of_lists(xml, what, |xml| {
        list(xml, "Reference", &at, DEGREE, None);
        list(xml, "Difference", &difference, DEGREE, None);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn every_element_is_closed_and_names_from_outside_stay_text() {
        let mut report = sample::report();
        report.laboratory = Some("<Lab> & \"Sons\"".to_owned());
        let text = document(&report, "IT");
        assert!(text.contains("&lt;Lab&gt; &amp; &quot;Sons&quot;"));
        let mut open = Vec::new();
        for piece in text.split('<').skip(2) {
            let (tag, _) = piece.split_once('>').unwrap();
            match tag.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name.to_owned())),
                None => open.push(tag.split(' ').next().unwrap().to_owned()),
            }
        }
        assert!(open.is_empty());
    }

    #[test]
    fn a_chamber_s_run_is_told_by_temperature_with_its_range() {
        let text = document(&sample::chamber(), "IT");
        for part in [
            "Climatic chamber, four orientations",
            "Left by the model, axis x",
            "-7.000000",
            "Lowest temperature at which the model holds",
        ] {
            assert!(text.contains(part), "{part}");
        }
        assert!(!text.contains("As left, slope"), "{text}");
    }

    #[test]
    fn it_states_what_it_is_of_and_that_it_is_no_certificate() {
        let text = document(&sample::report(), "IT");
        for part in [
            "v0.1.0",
            "not a calibration certificate",
            "DEADBEEF",
            "\\degree",
        ] {
            assert!(text.contains(part), "{part}");
        }
    }
}
