//! Made-up reports for tests: every field is filled, the numbers only look like a real run.

use std::f64::consts::TAU;

use super::data::*;
use super::replay_data::*;
use output::series::{Bin, Binner, Point, points, rounded};

/// A small repeatable noise, about -1 to 1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
    }
}

const BOTH: [(Mode, Axis); 4] = [
    (Mode::Paper, Axis::X),
    (Mode::Paper, Axis::Y),
    (Mode::Product, Axis::X),
    (Mode::Product, Axis::Y),
];

/// A demo report with every field filled.
pub fn demo() -> DemoReport {
    let at_most =
        |name, value, limit| SpecificationRow::new(name, value, Relation::AtMost, limit, "deg");
    let count =
        |name, value, relation, limit| SpecificationRow::new(name, value, relation, limit, "");
    let specification = vec![
        at_most("static RMSE, random angles, 25 degC", 0.031, 0.040),
        at_most("static largest error, every unit", 0.113, 0.20),
        at_most("dynamic RMSE aligned, 80 deg/s, no lever arm", 0.038, 0.045),
        at_most("one-axis 360 deg RMSE", 0.030, 0.035),
        count("faults on day 5", 3.0, Relation::AtLeast, 1.0),
        count("faults on other days", 0.0, Relation::Exactly, 0.0),
    ];
    let mut report = DemoReport::new(2021, 3, 7, specification);
    report.static_test = BOTH.into_iter().flat_map(static_rows).collect();
    report.dynamic = BOTH.into_iter().flat_map(dynamic_rows).collect();
    report.week = [Mode::Paper, Mode::Product]
        .into_iter()
        .flat_map(week_rows)
        .collect();
    report.one_axis = [1, 2].map(one_axis_row).to_vec();
    report.calibration = [Mode::Paper, Mode::Product]
        .into_iter()
        .flat_map(calibration_rows)
        .collect();
    report.table1 = table1_rows();
    report.figures = figures();
    report
}

fn static_rows((mode, axis): (Mode, Axis)) -> Vec<StaticRow> {
    let rmse = |node: u8, angles| match (mode, angles) {
        (Mode::Paper | Mode::AsPrinted, Angles::Knots) => 0.111 + 0.002 * f64::from(node),
        (Mode::Paper | Mode::AsPrinted, Angles::Random) => 0.39 + 0.01 * f64::from(node),
        (Mode::Product, _) => 0.029 + 0.001 * f64::from(node),
    };
    let row = |node, angles| StaticRow {
        mode,
        axis,
        node,
        angles,
        rmse_deg: Some(rounded(rmse(node, angles))),
        max_deg: Some(rounded(3.4 * rmse(node, angles))),
        mean_node_difference_deg: Some(if mode == Mode::Paper { 0.021 } else { 0.012 }),
        warnings: 0,
    };
    let angles = [Angles::Knots, Angles::Random];
    angles
        .into_iter()
        .flat_map(|angles| [1, 2].map(|node| row(node, angles)))
        .collect()
}

fn dynamic_rows((mode, axis): (Mode, Axis)) -> Vec<DynamicRow> {
    let (arrives, aligned, latency) = match mode {
        Mode::Paper | Mode::AsPrinted => (1.21, 0.27, 16.0),
        Mode::Product => (1.63, 0.038, 25.0),
    };
    let row = |node: u8, lever_arm_cm: u32| {
        let arm = 0.2 * f64::from(lever_arm_cm) + 0.004 * f64::from(node);
        DynamicRow {
            mode,
            axis,
            node,
            lever_arm_cm,
            rmse_deg: Some(rounded(arrives + 0.3 * arm)),
            rmse_aligned_deg: Some(rounded(aligned + arm)),
            latency_ms: Some(latency),
            max_deg: Some(rounded(1.9 * arrives + arm)),
            max_aligned_deg: Some(rounded(2.5 * aligned + arm)),
            mean_node_difference_deg: Some(0.03),
            warnings: 0,
        }
    };
    [0, 2, 5]
        .into_iter()
        .flat_map(|arm| [1, 2].map(|node| row(node, arm)))
        .collect()
}

fn week_rows(mode: Mode) -> Vec<WeekRow> {
    let row = |day| WeekRow {
        mode,
        day,
        hours: 3.0,
        warnings: match (mode, day) {
            (Mode::Paper, 5) => 4321,
            (Mode::Paper, day) => u64::from(37 * day % 29),
            (Mode::Product, 5) => 1730,
            _ => 0,
        },
        stops: u64::from(day == 5),
        faults: if day == 5 { 3 } else { 0 },
        outcome: if day == 5 {
            Outcome::PhysicalFault
        } else {
            Outcome::None
        },
    };
    (1..=7).map(row).collect()
}

fn one_axis_row(node: u8) -> OneAxisRow {
    OneAxisRow {
        node,
        angle_count: 600,
        rmse_deg: Some(0.030),
        max_deg: Some(0.104),
    }
}

fn calibration_rows(mode: Mode) -> Vec<CalibrationRow> {
    let table = mode == Mode::Paper;
    let row = |node| CalibrationRow {
        mode,
        node,
        residual_deg: (!table).then_some(0.012),
        condition: (!table).then_some(2.4),
        verification_max_deg: Some(if table { 0.19 } else { 0.08 }),
        tolerance_deg: 0.20,
        rounds: 1,
        accepted: true,
    };
    [1, 2].map(row).to_vec()
}

fn table1_rows() -> Vec<Table1Row> {
    let row = |mode, error_type, outcome, delta| Table1Row {
        mode,
        error_type,
        warnings: 111,
        stop_s: 45.0,
        delta_after_stop_deg: Some(delta),
        outcome,
        as_expected: true,
    };
    let both = |mode| {
        [
            row(mode, ErrorType::DataDelay, Outcome::DataDelay, 0.02),
            row(mode, ErrorType::PhysicalFault, Outcome::PhysicalFault, 0.91),
        ]
    };
    [Mode::Paper, Mode::Product]
        .into_iter()
        .flat_map(both)
        .collect()
}

fn figures() -> Figures {
    let mut noise = Noise(1);
    let mut made = Figures::default();
    for (mode, axis) in BOTH {
        for node in [1, 2] {
            let points = knots(|angle| error_at(mode, angle, &mut noise));
            made.static_error.push(Curve {
                mode,
                axis,
                node: Some(node),
                points,
            });
        }
        let points = knots(|angle| 0.3 * error_at(mode, angle, &mut noise));
        made.static_delta.push(Curve {
            mode,
            axis,
            node: None,
            points,
        });
        made.dynamic.push(dynamic_trace(mode, axis, &mut noise));
    }
    made.delta = [Mode::Paper, Mode::Product]
        .map(|mode| delta_trace(mode, &mut noise))
        .to_vec();
    made
}

fn knots(value: impl FnMut(f64) -> f64) -> Vec<Point> {
    let mut value = value;
    points(
        (-9..=9)
            .map(|step| 10.0 * f64::from(step))
            .map(|angle| (angle, value(angle))),
    )
}

/// The error of paper mode grows towards 90 deg, that of product mode much less.
fn error_at(mode: Mode, angle_deg: f64, noise: &mut Noise) -> f64 {
    let ends = (angle_deg / 90.0).powi(8);
    match mode {
        Mode::Paper | Mode::AsPrinted => 0.02 * noise.next() + 0.35 * ends * noise.next(),
        Mode::Product => 0.03 * noise.next() + 0.03 * ends * noise.next(),
    }
}

fn dynamic_trace(mode: Mode, axis: Axis, noise: &mut Noise) -> DynamicTrace {
    let swing = |time: f64| 40.0 * (2.0 / TAU * 2.0) * (TAU * time / 2.0).sin().asin();
    let delay = if mode == Mode::Paper { 0.016 } else { 0.025 };
    let times = || (0..300).map(|i| f64::from(i) * 0.02);
    let mut node = |node: u8| {
        let jitter: Vec<f64> = times().map(|_| 0.04 * noise.next()).collect();
        let at = |shift: f64| {
            let jitter = jitter.iter();
            points(
                times()
                    .zip(jitter)
                    .map(|(t, e)| (t, swing(t - delay) - swing(t - shift) + e)),
            )
        };
        NodeTrace {
            node,
            angle: points(times().zip(&jitter).map(|(t, e)| (t, swing(t - delay) + e))),
            error: at(0.0),
            error_aligned: at(delay),
        }
    };
    DynamicTrace {
        mode,
        axis,
        reference: points(times().map(|time| (time, swing(time)))),
        nodes: vec![node(1), node(2)],
    }
}

fn delta_trace(mode: Mode, noise: &mut Noise) -> DeltaTrace {
    let mut binner = Binner::new(0.0, 10_800.0, 600);
    for i in 0..54_000_u32 {
        let time = f64::from(i) * 0.2;
        let sag = (4000.0..5200.0).contains(&time) && (time as u64 / 40).is_multiple_of(3);
        let scale = if sag { 9.0 } else { 0.15 };
        binner.push(time, scale * noise.next());
    }
    DeltaTrace {
        mode,
        day: 5,
        bins: binner.finish(),
    }
}

/// A replay report with every field filled.
pub fn replay() -> ReplayReport {
    let channels = [1, 2].map(replay_channel).to_vec();
    let mut report = ReplayReport::new(Mode::Product, channels);
    let slope = |axis| SlopeDelta {
        axis,
        rms_deg: Some(0.21),
        max_deg: Some(4.1),
        standstill_rms_deg: Some(0.14),
        warnings: 812,
        bins: bins(|time, noise| 0.2 * noise + if time > 400.0 { 1.5 * noise } else { 0.0 }),
    };
    report.cross_check = Some(CrossCheck {
        threshold_deg: 0.40,
        compared: 37_430,
        stops: 1,
        faults: 0,
        slopes: vec![slope(Axis::X), slope(Axis::Y)],
    });
    let verdict = |from_s, to_s, verdict: &str, trusted| VerdictInterval {
        from_s,
        to_s,
        verdict: verdict.to_owned(),
        trusted,
    };
    report.verdicts = vec![
        verdict(0.0, 412.0, "agree", true),
        verdict(412.0, 431.5, "disagree", false),
        verdict(431.5, 599.0, "agree", true),
    ];
    let note = "2048 LSB per g was taken as the scale, because the median standstill norm is 2051.";
    report.notes.push(note.to_owned());
    report
}

/// Bins over ten minutes.
fn bins(mut value: impl FnMut(f64, f64) -> f64) -> Vec<Bin> {
    let mut noise = Noise(7);
    let mut binner = Binner::new(0.0, 599.0, 600);
    for i in 0..6000_u32 {
        let time = f64::from(i) * 0.1;
        binner.push(time, value(time, noise.next()));
    }
    binner.finish()
}

/// Mean, root mean square and greatest error, deg.
fn accuracy(compared: u64, [mean, rmse, max]: [f64; 3]) -> Option<Accuracy> {
    Some(Accuracy {
        compared,
        mean_deg: Some(mean),
        rmse_deg: Some(rmse),
        max_deg: Some(max),
    })
}

fn moving() -> MovingVertical {
    MovingVertical {
        compared: 36_000,
        without: 16,
        rms_deg: Some(0.61),
        max_deg: Some(2.4),
        uncertainty_deg: Some(0.55),
        within_2u_percent: Some(96.2),
        within_3u_percent: Some(99.5),
    }
}

fn replay_channel(channel: u8) -> ReplayChannel {
    let pose = |time: f64| 60.0 * ((time / 27.0).floor() * 1.7).sin();
    let slope = |axis| SlopeSeries {
        axis,
        angle: bins(|time, noise| {
            pose(time)
                + if time > 400.0 {
                    20.0 * noise
                } else {
                    0.1 * noise
                }
        }),
        uncertainty: bins(|time, _| 0.02 / pose(time).to_radians().cos()),
        reference: bins(|time, _| pose(time)),
        accuracy: accuracy(5000, [0.4, 1.6, 5.2]),
        accuracy_at_plateaus: accuracy(6, [0.2, 1.4, 2.1]),
        standstill: Some(StandstillUncertainty {
            readings: 21_000,
            uncertainty_deg: 0.11,
            noise_deg: 0.105,
            scatter_deg: 0.102,
        }),
    };
    ReplayChannel {
        channel,
        file: format!("exp1_imu{channel}.csv.gz"),
        rows: 37_440,
        skipped: vec![
            SkippedRows {
                reason: "all-zero row".to_owned(),
                count: 1,
                first_line: 2,
            },
            SkippedRows {
                reason: "missing cell".to_owned(),
                count: 3,
                first_line: 118,
            },
        ],
        gaps: 2,
        rate_hz: 62.5,
        duration_s: 599.0,
        lsb_per_g: Some(2048.0),
        ignored_columns: vec!["mx_ut".to_owned(), "my_ut".to_owned()],
        calibration: ReplayCalibration {
            kind: CalibrationKind::Poses,
            poses: Some(21),
            residual_mg: Some(0.22),
            residual_deg: Some(1.4),
            condition: Some(3.1),
        },
        latency_ms: Some(25.1),
        slopes: vec![slope(Axis::X), slope(Axis::Y)],
        moving: Some(moving()),
        plateaus: vec![Plateau {
            from_s: 1.0,
            to_s: 20.5,
            x_deg: Some(0.12),
            y_deg: Some(-30.4),
            reference_x_deg: Some(0.0),
            reference_y_deg: Some(-30.0),
        }],
    }
}
