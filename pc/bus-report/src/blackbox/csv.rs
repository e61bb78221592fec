//! A box as CSV, for spreadsheets.
//!
//! In: [`Samples`]. Out: a head line and one line per SYNC; a cell without a value is empty. The
//! `csv` crate is for reading other people's files; what is written here has no quotes to escape.

use std::fmt::Write;

use super::data::BLAMED;
use super::decode::{Frame, Samples};
use codes::words;

/// Columns of one channel.
const CHANNEL: [&str; 10] = [
    "x_deg",
    "y_deg",
    "x_uncertainty_deg",
    "y_uncertainty_deg",
    "x_quality",
    "y_quality",
    "force_x_g",
    "force_y_g",
    "force_z_g",
    "noise_ratio",
];

/// The box.
pub fn samples(samples: &Samples) -> String {
    let mut out = "sync,since_s".to_owned();
    for who in ["own", "other"] {
        for column in CHANNEL {
            let _ = write!(out, ",{who}_{column}");
        }
    }
    out.push_str(",difference_x_deg,difference_y_deg,state,blamed,reason\r\n");
    for (number, frame) in samples.frames.iter().enumerate() {
        let sync = number as i64 - samples.before.saturating_sub(1) as i64;
        let _ = write!(out, "{sync},{:.6}", samples.since_s(number));
        push_frame(frame, &mut out);
    }
    out
}

fn push_frame(frame: &Frame, out: &mut String) {
    let mut cell = |value: Option<f64>, decimals: usize| {
        out.push(',');
        if let Some(value) = value {
            let _ = write!(out, "{value:.decimals$}");
        }
    };
    let deg = |mdeg: Option<i32>| mdeg.map(|mdeg| f64::from(mdeg) * 1e-3);
    for (measured, activity) in frame.measured.iter().zip(&frame.activity) {
        let axes = [0, 1];
        for axis in axes {
            cell(deg(measured.mdeg(axis)), 3);
        }
        for axis in axes {
            cell(measured.uncertainty_mdeg(axis).map(|u| u * 1e-3), 4);
        }
        for axis in axes {
            cell(measured.quality(axis).map(f64::from), 0);
        }
        for force_g in activity.force_g {
            cell(force_g, 4);
        }
        cell(activity.noise(), 2);
    }
    let [own, other] = &frame.measured;
    for axis in [0, 1] {
        cell(deg(own.minus(other, axis)), 3);
    }
    let blamed = words::blamed(frame.blamed, BLAMED).unwrap_or_default();
    let reason = words::reason(frame.reason).unwrap_or_default();
    let _ = write!(out, ",{},{blamed},{reason}\r\n", frame.state);
}

#[cfg(test)]
mod tests {
    use super::super::decode;
    use super::*;

    #[test]
    fn every_line_has_the_columns_of_the_head() {
        let mut bytes = vec![1, 34, 1, 1, 0x10, 0x27, 0, 0];
        bytes.extend([0; 20]);
        let mut frame = [0; 34];
        frame[..8].copy_from_slice(&[0, 0, 0x20, 0, 0, 0xE0, 48, 48]);
        frame[33] = 2 << 6 | 15;
        bytes.extend(frame);
        bytes.extend(frame);
        let text = samples(&decode::samples(&bytes).unwrap());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        let head = lines[0].split(',').count();
        assert!(lines.iter().all(|line| line.split(',').count() == head));
        assert!(lines[1].starts_with("0,0.000000,45.000,-45.000,0.0020"));
        assert!(lines[2].starts_with("1,0.010000,"));
        assert!(lines[2].ends_with(",0,other,silent"));
    }
}
