//! The figures that real recordings must give. They lie beside the checkout, not in it; where
//! they are missing each test prints this and passes.

use std::path::{Path, PathBuf};

use super::calibrate::{Fit, align, calibrate_from_poses, calibrate_from_reference, overlapping};
use super::recording::{Options, Recording};
use super::reference::angle_between_deg;
use super::repeatability::{matching, repeatability_deg};
use super::segments::{self, Segment, Standstill};
use super::skips::{Count, Reason};

fn recordings() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data")
}

/// The recording and its standstills, or `None` with a word on it.
fn open(name: &str) -> Option<(Recording, Standstill)> {
    let path = recordings().join(name);
    if !path.exists() {
        println!("skipped: recording not present ({name})");
        return None;
    }
    let recording = Recording::open(&path, Options::default(), None).unwrap();
    let options = segments::Options::for_recording(&recording);
    let found = segments::find(&recording, options);
    Some((recording, found))
}

const ONE: &str = "mimu4444/exp1_imu1.csv.gz";
const OTHER: &str = "mimu4444/exp1_imu3.csv.gz";

#[test]
fn poses_of_a_hand_turned_board() {
    for name in [ONE, OTHER] {
        let Some((recording, found)) = open(name) else {
            return;
        };
        assert_eq!(recording.scale.per_g, 2048.0);
        assert_eq!((recording.rows.len(), recording.skips.total()), (37_439, 0));
        assert_eq!((recording.period_us, recording.gaps.rows), (16_000, 0));
        let fit = calibrate_from_poses(&found.segments).unwrap();
        println!(
            "{name}: {} poses, noise {:.2?} mg, norm residual {:.3} mg, worst {:.2} mg, \
             condition {:.1}",
            found.segments.len(),
            found.noise_g.map(|g| 1000.0 * g),
            fit.norm_residual_mg,
            fit.worst_norm_mg,
            fit.condition
        );
        assert_eq!(found.segments.len(), 21, "{name}");
        assert!(
            fit.norm_residual_mg <= 0.25,
            "{name}: {}",
            fit.norm_residual_mg
        );
        // The last pose is two seconds, after a minute and a half of hard shaking.
        assert!(fit.worst_norm_mg < 1.0, "{name}: {}", fit.worst_norm_mg);
        let channel = fit.channel(&recording, &found).unwrap();
        assert_eq!((channel.check(), channel.poses), (Ok(()), 21));
        assert_eq!(channel.source, name.rsplit('/').next().unwrap());
        assert!((channel.matrix[1][1] - fit.matrix[1][1]).abs() < 1e-8);
    }
}

#[test]
fn two_channels_of_one_board_agree_once_aligned() {
    let (Some((_, one)), Some((_, other))) = (open(ONE), open(OTHER)) else {
        return;
    };
    let master = calibrate_from_poses(&one.segments).unwrap();
    let fit = calibrate_from_poses(&other.segments).unwrap();
    let pairs = overlapping(&other.segments, &one.segments);
    let aligned = align(&fit, &master, &pairs).unwrap();
    let left = aligned.angle_residual_deg.unwrap();
    println!("aligned over {} poses, {left:.3} deg rms left", pairs.len());
    assert!(pairs.len() >= 20);
    // Means over 20 s; what is left is the two fits, not the noise.
    assert!(left < 0.05, "{left}");
}

/// What one sensor of the robot gave on its two runs.
struct Robot {
    slow: Standstill,
    fast: Standstill,
    fit: Fit,
    pairs: Vec<(Segment, Segment)>,
}

fn robot(sensor: &str) -> Option<Robot> {
    let (_, slow) = open(&format!("abb-robot/300mm_s_{sensor}.csv"))?;
    let (_, fast) = open(&format!("abb-robot/500mm_s_{sensor}.csv"))?;
    let fit = calibrate_from_reference(&slow.segments).unwrap();
    let pairs = matching(&slow.segments, &fast.segments);
    Some(Robot {
        slow,
        fast,
        fit,
        pairs,
    })
}

/// Neighbouring plateaus with one direction of gravity by the reference count once.
fn reference_plateaus(segments: &[Segment]) -> usize {
    let ups: Vec<_> = segments
        .iter()
        .filter_map(|s| Some(s.reference?.up))
        .collect();
    let turns = ups
        .windows(2)
        .filter(|pair| angle_between_deg(pair[0], pair[1]) > 2.0);
    1 + turns.count()
}

#[test]
fn plateaus_of_the_robot_come_back() {
    for sensor in ["lsm9ds0", "mpu9150"] {
        let Some(robot) = robot(sensor) else { return };
        let (fit, back) = (&robot.fit, repeatability_deg(&robot.fit, &robot.pairs));
        let absolute = fit.angle_residual_deg.unwrap();
        println!(
            "{sensor}: {} and {} standstills, {} pairs, plateaus come back within {back:.3} deg \
             rms, {absolute:.2} deg rms to the robot, norm residual {:.1} mg, condition {:.1}",
            robot.slow.segments.len(),
            robot.fast.segments.len(),
            robot.pairs.len(),
            fit.norm_residual_mg,
            fit.condition
        );
        for run in [&robot.slow, &robot.fast] {
            assert_eq!(
                reference_plateaus(&run.segments),
                6,
                "{sensor}: {:?}",
                run.segments
            );
            assert_eq!(run.segments.len(), 8, "{sensor}");
        }
        assert_eq!(robot.pairs.len(), 8, "{sensor}");
        assert!(back <= 0.30, "{sensor}: {back}");
        // The mount gives: this is what it costs, not what the chain costs.
        assert!((1.0..2.5).contains(&absolute), "{sensor}: {absolute}");
    }
}

#[test]
fn what_the_robot_logs_get_wrong_is_counted() {
    // The quaternions without a length are interpolated across a change of sign.
    let cases = [
        ("300mm_s_lsm9ds0", 370, 0, 11),
        ("500mm_s_lsm9ds0", 369, 10, 35),
    ];
    for (name, empty, gaps, no_attitude) in cases {
        let Some((recording, _)) = open(&format!("abb-robot/{name}.csv")) else {
            return;
        };
        let skipped = |reason| recording.skips.of(reason);
        assert_eq!(
            skipped(Reason::AllZero),
            Count {
                rows: 1,
                first_line: 2
            }
        );
        assert_eq!(
            skipped(Reason::MissingCell),
            Count {
                rows: 1,
                first_line: empty
            }
        );
        assert_eq!(recording.skips.total(), 2);
        assert_eq!(recording.gaps.rows, gaps, "{name}");
        assert_eq!(recording.unread_extras.rows, no_attitude, "{name}");
        assert!(
            (90.0..130.0).contains(&recording.rate_hz()),
            "{}",
            recording.rate_hz()
        );
    }
}
