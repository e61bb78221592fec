//! Standstills in made-up recordings whose truth is known.

use std::fmt::Write as _;
use std::io::Cursor;

use super::*;
use crate::recordings::recording;

/// Stands at each pose for its seconds, with a swing of 0.4 s between; 100 samples per second.
fn recording(poses: &[([f64; 3], f64)], noise_g: f64) -> Recording {
    let mut text = "time_s,ax_g,ay_g,az_g\n".to_owned();
    let (mut i, mut state) = (0u32, 1u32);
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (f64::from(state >> 8) / f64::from(1 << 24) - 0.5) * 12f64.sqrt() * noise_g
    };
    let mut last = poses[0].0;
    for &(pose, seconds) in poses {
        let (still, swing) = ((seconds * 100.0) as u32, if i == 0 { 0 } else { 40 });
        for k in 0..swing + still {
            let share = if k < swing {
                f64::from(k) / f64::from(swing)
            } else {
                1.0
            };
            let shake = if k < swing {
                0.3 * f64::from(k % 4)
            } else {
                0.0
            };
            write!(text, "{:.2}", f64::from(i) * 0.01).unwrap();
            for (from, to) in last.iter().zip(pose) {
                let a = from + share * (to - from) + shake + noise();
                write!(text, ",{a:.5}").unwrap();
            }
            text.push('\n');
            i += 1;
        }
        last = pose;
    }
    Recording::read("made up", Cursor::new(text), recording::Options::default()).unwrap()
}

const LEVEL: [f64; 3] = [0.0, 0.0, 1.0];
const SIDE: [f64; 3] = [0.0, 1.0, 0.0];
const EDGE: [f64; 3] = [0.6, 0.0, 0.8];

#[test]
fn poses_are_found_with_their_means() {
    let recording = recording(
        &[(LEVEL, 3.0), (SIDE, 2.0), (EDGE, 2.5), (LEVEL, 0.6)],
        0.003,
    );
    let found = find(&recording, Options::POSES);
    assert_eq!(found.segments.len(), 3, "{found:?}");
    for (segment, pose) in found.segments.iter().zip([LEVEL, SIDE, EDGE]) {
        assert!(
            angle_between_deg(segment.mean_g, pose) < 0.05,
            "{segment:?}"
        );
        assert!(
            segment.std_g.iter().all(|std| (0.002..0.005).contains(std)),
            "{segment:?}"
        );
    }
    assert!(
        found
            .noise_g
            .iter()
            .all(|noise| (0.002..0.0035).contains(noise)),
        "{found:?}"
    );
    let short = find(
        &recording,
        Options {
            shortest_s: 0.3,
            ..Options::POSES
        },
    );
    assert_eq!(short.segments.len(), 4);
}

#[test]
fn a_knock_in_the_middle_of_a_pose_does_not_part_it() {
    let near = [0.003, 0.0, 1.0];
    let recording = recording(&[(LEVEL, 2.0), (near, 2.0), (SIDE, 2.0)], 0.003);
    let found = find(&recording, Options::POSES);
    assert_eq!(found.segments.len(), 2, "{found:?}");
    let first = found.segments[0];
    // Both halves, without the knock: its 0.4 s do not count.
    assert!((320..=400).contains(&first.count), "{first:?}");
    assert!(first.std_g.iter().all(|std| *std < 0.005), "{first:?}");
}

#[test]
fn coming_back_after_a_while_is_another_standstill() {
    let mut journey = vec![(LEVEL, 2.0)];
    journey.extend((0..8).map(|i| (if i % 2 == 0 { SIDE } else { EDGE }, 0.05)));
    journey.push((LEVEL, 2.0));
    let found = find(&recording(&journey, 0.003), Options::POSES);
    assert_eq!(found.segments.len(), 2, "{found:?}");
}

#[test]
fn a_slow_turn_is_no_standstill() {
    let mut text = "time_s,ax_g,ay_g,az_g\n".to_owned();
    for i in 0..2000 {
        // 9 deg/s: slow enough for the scatter in a quarter of a second to be small.
        let angle = (f64::from(i) * 0.09).to_radians();
        let t = f64::from(i) * 0.01;
        writeln!(text, "{t:.2},{:.5},0.001,{:.5}", angle.sin(), angle.cos()).unwrap();
    }
    let read = Recording::read("turn", Cursor::new(text), recording::Options::default()).unwrap();
    let found = find(&read, Options::POSES);
    assert!(found.segments.is_empty(), "{found:?}");
}

#[test]
fn the_reference_over_a_plateau_ignores_its_sign_and_its_early_leave() {
    let mut text = "time_s,ax_g,ay_g,az_g,ref_qw,ref_qx,ref_qy,ref_qz\n".to_owned();
    for i in 0..200 {
        let sign = if i % 3 == 0 { -1.0 } else { 1.0 };
        let half = if i < 180 {
            0.0
        } else {
            f64::from(i - 180).to_radians()
        };
        let (w, y) = (sign * half.cos(), -sign * half.sin());
        let wobble = 0.001 * f64::from(i % 3);
        writeln!(
            text,
            "{:.2},{wobble},0.001,1,{w},0,{y},0",
            f64::from(i) * 0.01
        )
        .unwrap();
    }
    let read = Recording::read("ref", Cursor::new(text), recording::Options::default()).unwrap();
    assert_eq!(Options::for_recording(&read), Options::PLATEAUS);
    let found = find(&read, Options::PLATEAUS);
    let reference = found.segments[0].reference.unwrap();
    assert!(
        angle_between_deg(reference.up, LEVEL) < 1e-6,
        "{reference:?}"
    );
    assert!(
        reference.spread_deg > 3.0 && reference.spread_deg < 12.0,
        "{reference:?}"
    );
}
