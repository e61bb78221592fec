//! Fits to made-up standstills with known truth, and to sets that can't be fitted.

use super::*;
use crate::recordings::reference::slopes_deg;
use crate::recordings::repeatability::matching;
use crate::recordings::segments::ReferenceMean;

fn segment(mean_g: [f64; 3], up: Option<[f64; 3]>) -> Segment {
    Segment {
        start_us: 0,
        end_us: 1_000_000,
        first_line: 2,
        count: 100,
        mean_g,
        std_g: [0.003; 3],
        temperature_c: None,
        reference: up.map(|up| ReferenceMean {
            up,
            spread_deg: 0.0,
            attitude: None,
        }),
    }
}

/// Directions spread over the sphere.
fn sphere(n: usize) -> Vec<[f64; 3]> {
    let direction = |i: usize| {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
        let (s, c) = (2.399_963 * i as f64).sin_cos();
        [(1.0 - z * z).sqrt() * c, (1.0 - z * z).sqrt() * s, z]
    };
    (0..n).map(direction).collect()
}

/// A sensor with bent axes and offsets.
fn bent(up: [f64; 3]) -> [f64; 3] {
    let matrix = [[1.03, 0.01, 0.0], [0.01, 0.97, 0.02], [0.0, 0.02, 1.01]];
    plus(times(&matrix, up), [0.02, -0.03, 0.04])
}

/// A sensor lying on its side, with offsets.
fn on_its_side(up: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = up;
    [z + 0.02, x - 0.01, y + 0.03]
}

#[test]
fn poses_give_scale_and_offset() {
    let segments: Vec<_> = sphere(21)
        .into_iter()
        .map(|up| segment(bent(up), None))
        .collect();
    let fit = calibrate_from_poses(&segments).unwrap();
    assert!(fit.norm_residual_mg < 1e-6, "{fit:?}");
    assert_eq!((fit.poses, fit.method), (21, Method::Poses));
    let back = fit.apply(bent([0.0, 0.6, 0.8]));
    assert!(angle_between_deg(back, [0.0, 0.6, 0.8]) < 1e-4, "{back:?}");
    assert!(fit.vector().is_some());
}

#[test]
fn too_few_poses_are_told_with_the_directions_to_add() {
    let upper = sphere(30).into_iter().filter(|up| up[2] > 0.3);
    let segments: Vec<_> = upper.take(8).map(|up| segment(up, None)).collect();
    let error = calibrate_from_poses(&segments).unwrap_err();
    let CalibrateError::TooFew {
        have: 8,
        need: 9,
        missing,
    } = &error
    else {
        panic!("{error:?}")
    };
    assert!(missing.contains(&"-z"), "{error}");
    let text = error.to_string();
    assert!(
        text.starts_with("8 standstills are too few, it takes 9; add poses with"),
        "{text}"
    );
}

#[test]
fn the_same_pose_again_is_no_further_pose() {
    let ups = sphere(4);
    let segments: Vec<_> = ups
        .iter()
        .cycle()
        .take(20)
        .map(|up| segment(bent(*up), None))
        .collect();
    let error = calibrate_from_poses(&segments).unwrap_err();
    assert!(
        matches!(error, CalibrateError::TooFew { have: 4, .. }),
        "{error:?}"
    );
}

#[test]
fn poses_in_a_plane_are_ill_conditioned() {
    let flat = (0..20).map(|i| (0.3 * f64::from(i)).sin_cos());
    let segments: Vec<_> = flat
        .map(|(s, c)| segment(bent([s, c, 0.0]), None))
        .collect();
    let error = calibrate_from_poses(&segments).unwrap_err();
    let text = error.to_string();
    assert!(
        matches!(error, CalibrateError::IllConditioned { .. }),
        "{error:?}"
    );
    assert!(
        text.contains("condition") && text.contains("gravity near +z, -z"),
        "{text}"
    );
}

#[test]
fn what_is_no_sensor_is_refused() {
    let huge: Vec<_> = sphere(15)
        .into_iter()
        .map(|up| segment(up.map(|c| 5.0 * c), None))
        .collect();
    assert!(calibrate_from_poses(&huge).is_err());
    let nothing: Vec<_> = (0..15).map(|_| segment([f64::NAN; 3], None)).collect();
    assert!(calibrate_from_poses(&nothing).is_err());
    assert!(calibrate_from_reference(&[segment([f64::NAN; 3], Some([0.0, 0.0, 1.0])); 5]).is_err());
}

#[test]
fn a_reference_gives_rotation_and_offset() {
    let plateaus: Vec<_> = sphere(6)
        .into_iter()
        .map(|up| segment(on_its_side(up), Some(up)))
        .collect();
    let fit = calibrate_from_reference(&plateaus).unwrap();
    assert!(
        fit.angle_residual_deg.unwrap() < 1e-6 && fit.norm_residual_mg < 1e-6,
        "{fit:?}"
    );
    let slopes = slopes_deg(fit.apply(on_its_side([0.5, 0.0, 0.75f64.sqrt()])));
    assert!(
        (slopes[0] - 30.0).abs() < 1e-6 && slopes[1].abs() < 1e-6,
        "{slopes:?}"
    );
}

#[test]
fn plateaus_that_leave_the_rotation_open_are_refused() {
    let two = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]].map(|up| segment(up, Some(up)));
    let error = calibrate_from_reference(&two).unwrap_err();
    assert_eq!(error, CalibrateError::NoReference { have: 2, need: 3 });
    let line: Vec<_> = two.iter().cycle().take(7).copied().collect();
    let error = calibrate_from_reference(&line).unwrap_err();
    assert!(
        matches!(error, CalibrateError::IllConditioned { .. }),
        "{error:?}"
    );
    let without = sphere(9)
        .into_iter()
        .map(|up| segment(up, None))
        .collect::<Vec<_>>();
    assert!(calibrate_from_reference(&without).is_err());
}

#[test]
fn two_channels_are_brought_into_one_frame() {
    let ups = sphere(12);
    let one: Vec<_> = ups.iter().map(|up| segment(bent(*up), None)).collect();
    let turned = |up: [f64; 3]| [up[1], -up[0], up[2]];
    let other: Vec<_> = ups.iter().map(|up| segment(turned(*up), None)).collect();
    let pairs: Vec<_> = one
        .iter()
        .zip(&other)
        .map(|(a, b)| (a.mean_g, b.mean_g))
        .collect();
    let (fit, master) = (
        calibrate_from_poses(&one).unwrap(),
        calibrate_from_poses(&other).unwrap(),
    );
    let aligned = align(&fit, &master, &pairs).unwrap();
    assert!(aligned.angle_residual_deg.unwrap() < 1e-4, "{aligned:?}");
    assert!(align(&fit, &master, &pairs[..2]).is_err());
}

#[test]
fn standstills_are_paired_by_time_and_plateaus_by_reference() {
    let at = |start: u64, end: u64| Segment {
        start_us: start,
        end_us: end,
        ..segment([0.0, 0.0, 1.0], Some([0.0, 0.0, 1.0]))
    };
    assert_eq!(
        overlapping(&[at(0, 100), at(200, 300)], &[at(40, 110), at(290, 400)]).len(),
        1
    );
    let side = segment([1.0, 0.0, 0.0], Some([1.0, 0.0, 0.0]));
    let level = at(0, 1);
    let pairs = matching(&[level, side, level], &[level, level, side, level]);
    assert_eq!(pairs.len(), 3);
    assert_eq!(matching(&[side], &[level]).len(), 0);
}
