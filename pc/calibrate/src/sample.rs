//! What tests share: reports made up, and whether a page has every key.

use output::check::keys;

use serde::Serialize;
use tilt::rate::{RateCorrection, RealRateCorrection};

use super::data::*;

fn channel(letter: &str, node: u8) -> Channel {
    let point = |axis: &str, reference_deg: f64, error_deg: f64| Point {
        axis: axis.to_owned(),
        reference_deg,
        reading_deg: Some(reference_deg + error_deg),
        error_deg: Some(error_deg),
        reason: None,
    };
    let points = |error: f64| {
        ["X", "Y"]
            .iter()
            .flat_map(|axis| [-52.5, 7.5, 52.5].map(|at| point(axis, at, error)))
            .collect::<Vec<_>>()
    };
    Channel {
        channel: letter.to_owned(),
        node,
        serial_number: u32::from(node),
        product_code: 0x504C_0000 + u32::from(node),
        software: "0.1.0".to_owned(),
        kind: 1,
        calibrated_before: true,
        as_found_crc32: "01234567".to_owned(),
        as_left_crc32: "DEADBEEF".to_owned(),
        presented: Vec::new(),
        span_min_degc: Some(24.0),
        span_max_degc: Some(26.5),
        condition: Some(3.5),
        residual_deg: Some(0.011),
        residual_mg: None,
        as_found: points(0.3),
        residuals: points(0.01),
        as_left: points(0.02),
        poses: Vec::new(),
        thermal: None,
        gyroscope: None,
        gyroscope_turns: None,
        uncertainty: vec![Contribution::new("Reference", "B", 0.0134, "stated by it")],
        combined_uncertainty_deg: 0.0134,
        expanded_uncertainty_deg: 0.0268,
    }
}

/// A gyroscope's correction with round numbers.
pub fn rates() -> RateCorrection {
    let deg_s = |values: [f64; 3], unit: f64| values.map(|value| (value * unit).to_radians());
    let real = RealRateCorrection {
        matrix: [
            [1.01, 0.002, -0.001],
            [0.003, 0.995, 0.0025],
            [-0.00125, 0.001, 0.995],
        ],
        scale1: [2e-5, 1e-4, -3e-5],
        bias: deg_s([0.5, -0.25, 1.0], 1.0),
        bias1: deg_s([5.0, 3.0, -4.0], 1e-3),
        bias2: deg_s([0.01, 0.02, -0.03], 1e-3),
    };
    RateCorrection::from_real(&real).unwrap()
}

/// A report of two channels by a motor.
pub fn report() -> Report {
    let difference = |difference_deg| Difference {
        axis: "X".to_owned(),
        reference_deg: 7.5,
        difference_deg: Some(difference_deg),
    };
    Report {
        format: FORMAT.to_owned(),
        version: VERSION,
        plumb_version: "0.1.0".to_owned(),
        identifier: "plumb-1-20261122T021700Z".to_owned(),
        method: Method::Motor,
        begun_utc: "2026-11-22T02:17:00Z".to_owned(),
        ended_utc: "2026-11-22T02:27:00Z".to_owned(),
        laboratory: None,
        operator: None,
        customer: None,
        bus: "socketcand://127.0.0.1:29536/plumb".to_owned(),
        reference: Reference {
            name: "Plumb,Virtual motor,1,0.1.0".to_owned(),
            standard_uncertainty_deg: Some(0.0134),
            statement: "as the motor states it".to_owned(),
        },
        environment: Environment {
            sensor_min_degc: Some(25.0),
            sensor_max_degc: Some(25.0),
            statement: "by the sensors, to a degree".to_owned(),
        },
        decision: Decision {
            tolerance_deg: 0.2,
            rule: "accepted when error and expanded uncertainty are within".to_owned(),
            accepted: true,
            largest_error_deg: Some(0.02),
        },
        channels: vec![channel("A", 1), channel("B", 2)],
        difference_as_found: vec![difference(0.1)],
        difference_as_left: vec![difference(0.01)],
        faces: None,
        dcc_sha256: Some("5a".repeat(32)),
    }
}

/// What a chamber run has told of a channel.
fn thermal() -> Thermal {
    let dwell = |run: u32, branch: &str, set_degc: f64, left: f64| ThermalDwell {
        run,
        branch: branch.to_owned(),
        set_degc,
        air_degc: Some(set_degc),
        sensor_degc: set_degc + 3.0,
        residuals_mg: [left, -left, 0.0],
        largest_mg: left.abs(),
        repeated: 0,
    };
    Thermal {
        model: "quadratic".to_owned(),
        sensor_min_degc: -7.0,
        sensor_max_degc: 73.0,
        unchanged_at_degc: Some(28.0),
        coefficients: vec![Coefficient {
            name: "Offset".to_owned(),
            axis: "x".to_owned(),
            value: 0.2,
            unit: "mg/degC".to_owned(),
            expanded: None,
        }],
        without_model_mg: 5.2,
        hysteresis_mg: Some([0.4, 0.3, 0.1]),
        between_runs_mg: Some(0.12),
        dwells: vec![
            dwell(1, "start", 25.0, 0.1),
            dwell(1, "up", 70.0, 0.3),
            dwell(2, "down", 25.0, -0.2),
        ],
        gyroscope_bias: None,
        gyroscope_scale: None,
    }
}

/// A report of two channels by a chamber.
pub fn chamber() -> Report {
    let mut report = report();
    report.method = Method::ChamberQuadratic;
    report.difference_as_found.clear();
    report.difference_as_left.clear();
    for channel in &mut report.channels {
        channel.residual_deg = None;
        channel.residual_mg = Some(0.31);
        for points in [
            &mut channel.as_found,
            &mut channel.residuals,
            &mut channel.as_left,
        ] {
            points.clear();
        }
        channel.thermal = Some(thermal());
    }
    report
}

/// Whether the part of a page behind a heading names every key of what a program writes.
pub fn assert_documented(value: &impl Serialize, page: &str, heading: &str) {
    let found = keys(value);
    let (_, page) = page.split_once(heading).unwrap();
    let missing: Vec<_> = found
        .iter()
        .filter(|key| !page.contains(&format!("`{key}`")))
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
}
